"""float64 for every test; property tests without deadlines and always with the same examples."""

import gc
import os

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


@pytest.fixture(autouse=True, scope="session")
def _kernel_cache(tmp_path_factory):
    """The command line moves the cache of this process to its own: to the one there is, or to one of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.getbasetemp() / "kernels"
        patch.setenv("JAXKIN_CACHE_DIR", os.environ.get("JAX_COMPILATION_CACHE_DIR", str(folder)))
        yield


@pytest.fixture(autouse=True, scope="module")
def _few_kernels():
    """Drops compiled kernels before their memory maps reach Linux's limit of 65530, at which XLA crashes."""
    yield
    if _memory_maps() > 30000:
        jax.clear_caches()
        gc.collect()
