"""Small stores, and processes that can die, for the tests of what happens to a sweep."""

import json
import os
import signal
import subprocess
import sys

import pytest
import small_sweep
from small_sweep import OTHER, run
from store_checks import beside, files


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Files of the uninterrupted stores of both requests."""
    folder = tmp_path_factory.mktemp("whole")
    run(folder / "map.zarr")
    run(folder / "other.zarr", OTHER)
    assert beside(folder / "map.zarr") == ["other.zarr"]
    return {"map": files(folder / "map.zarr"), "other": files(folder / "other.zarr")}


@pytest.fixture(scope="module")
def nursery(tmp_path_factory):
    """Returns a function that runs the small sweep in a process of its own, which meets a fault."""
    command = [sys.executable, small_sweep.__file__]
    environment = os.environ | {
        "PYTHONWARNINGS": "ignore",
        "JAX_PLATFORMS": "cpu",
        "JAX_COMPILATION_CACHE_DIR": str(tmp_path_factory.mktemp("kernels")),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment) as server:

        def ask(**order):
            server.stdin.write(json.dumps(order, default=str) + "\n")
            server.stdin.flush()
            answer = json.loads(server.stdout.readline())
            assert answer.get("end") != "bug", answer["message"]
            return answer

        try:
            yield ask
        finally:
            server.stdin.close()
            server.wait(30)


@pytest.fixture(scope="module")
def pristine(tmp_path_factory):
    store = tmp_path_factory.mktemp("pristine") / "map.zarr"
    run(store)
    return store


@pytest.fixture
def heeds_ctrl_c():
    """A process started in the background may have been told to ignore Ctrl-C."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
