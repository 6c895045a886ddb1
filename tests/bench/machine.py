"""The machine: what it has, and worker processes pinned to some of its cores."""

import os
import platform
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any


def has_avx512() -> bool:
    """Tells whether the processor has 512-bit vectors."""
    info = Path("/proc/cpuinfo")
    return info.exists() and "avx512f" in info.read_text()


def description() -> dict[str, Any]:
    """Returns what the ratios depend on."""
    cores = len(os.sched_getaffinity(0))
    return {"cores": cores, "avx512": has_avx512(), "architecture": platform.machine()}


def worker(cores: int | None = None) -> ProcessPoolExecutor:
    """Starts one fresh process, pinned before it can import JAX: the thread pools of XLA keep to the cores.

    Args:
        cores: How many cores it may use; all by default.
    """
    return ProcessPoolExecutor(1, get_context("spawn"), _prepare, (cores,))


def _prepare(cores: int | None) -> None:
    # Whatever was compiled before must not hide how long it takes.
    os.environ["JAX_ENABLE_COMPILATION_CACHE"] = "false"
    # The last cores: interrupts mostly go to the first.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[-(cores or 0) :])
