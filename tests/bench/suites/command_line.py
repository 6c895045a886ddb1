"""The command line: its cold start, and a map with an empty and with a full compile cache."""

import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from metric import Metric, Times, duration

ROOT = Path(__file__).resolve().parents[3]
MODULE = "jaxkin.cli.main"
MAP = [
    "map",
    "rpr3-analytic",
    "--fix",
    "rho2=1",
    "--grid",
    "rho1=0:4:2000",
    "--grid",
    "rho3=0:4:2000",
    "--out",
]


def measure() -> list[Metric]:
    """Times whole processes; nothing, if there is no command line."""
    if importlib.util.find_spec("jaxkin.cli") is None or importlib.util.find_spec(MODULE) is None:
        return []
    return [*_help(), *_map()]


def _python(*arguments: str, **environment: str) -> None:
    # The suite's own process forbids the compile cache; the command line is what is measured with it.
    inherited = {key: value for key, value in os.environ.items() if key != "JAX_ENABLE_COMPILATION_CACHE"}
    variables = {**inherited, "PYTHONPATH": str(ROOT), **environment}
    subprocess.run([sys.executable, *arguments], check=True, capture_output=True, env=variables)


def _help() -> list[Metric]:
    runs = {"help": lambda: _python("-m", MODULE, "--help"), "python": lambda: _python("-c", "import click")}
    times = Times(runs, rounds=11)
    return [
        duration("command line: --help", times.median("help"), 0.3),
        Metric("command line: --help / import click", times.ratio("help", "python"), "x", "lower", 0.5),
    ]


def _map() -> list[Metric]:
    with tempfile.TemporaryDirectory() as folder:
        numbers = iter(range(1000))
        cache = ""

        def first() -> None:
            nonlocal cache
            cache = f"{folder}/cache{next(numbers)}"
            second()

        def second() -> None:
            _python("-m", MODULE, *MAP, f"{folder}/map{next(numbers)}", JAXKIN_CACHE_DIR=cache)

        times = Times({"first": first, "second": second}, rounds=5)
    return [
        duration("command line: map of 4 M samples, empty compile cache", times.median("first"), 20),
        duration("command line: map of 4 M samples, kernels in the cache", times.median("second"), 5),
        Metric("command line: map, second / first", times.ratio("second", "first"), "x", "lower", 0.3),
    ]
