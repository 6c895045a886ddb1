"""float64 for every test; property tests without deadlines and always with the same examples."""

import gc
import os
from pathlib import Path

import hypothesis
import jax
import pytest

import jaxkin

jaxkin.enable_x64()
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    # What one run, or one worker, has compiled serves the next one, and processes that tests start.
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(Path(__file__).resolve().parents[1] / ".pytest_cache" / "kernels")
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
hypothesis.settings.register_profile("jaxkin", deadline=None, derandomize=True)
hypothesis.settings.load_profile("jaxkin")


def _memory_maps() -> int:
    try:
        with open("/proc/self/maps", encoding="ascii", errors="replace") as file:
            return sum(1 for _ in file)
    except OSError:
        return 0


@pytest.fixture(autouse=True, scope="session")
def _kernel_cache():
    """The command line moves the cache of this process to its own: to the one there is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXKIN_CACHE_DIR", os.environ["JAX_COMPILATION_CACHE_DIR"])
        yield


@pytest.fixture(autouse=True, scope="module")
def _few_kernels():
    """Drops compiled kernels before their memory maps reach Linux's limit of 65530, at which XLA crashes."""
    yield
    if _memory_maps() > 30000:
        jax.clear_caches()
        gc.collect()
