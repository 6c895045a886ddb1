"""The machine's bandwidth: what merely writing a result of the same size takes, beside every sweep."""

from collections.abc import Callable

import numpy as np

#: Labels of ``writes``.
HELD, FRESH = "write, held array", "write, fresh memory"


def writes(bytes_written: int) -> dict[str, Callable[[], object]]:
    """Returns runs that write one number everywhere, into an array that is there and into a new one."""
    held = np.zeros(bytes_written // 8)
    return {HELD: lambda: held.fill(1.0), FRESH: lambda: np.full(len(held), 1.0)}
