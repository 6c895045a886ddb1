"""float64 for every test; property tests without deadlines and always with the same examples."""

import gc

import hypothesis
import jax
import pytest

import jaxkin

jaxkin.enable_x64()
hypothesis.settings.register_profile("jaxkin", deadline=None, derandomize=True)
hypothesis.settings.load_profile("jaxkin")


def _memory_maps() -> int:
    try:
        with open("/proc/self/maps", encoding="ascii", errors="replace") as file:
            return sum(1 for _ in file)
    except OSError:
        return 0


@pytest.fixture(autouse=True, scope="module")
def _few_kernels():
    """Drops compiled kernels before their memory maps reach Linux's limit of 65530, at which XLA crashes."""
    yield
    if _memory_maps() > 30000:
        jax.clear_caches()
        gc.collect()
