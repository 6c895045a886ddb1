"""Glued axes: differences the short way round."""

from types import ModuleType
from typing import Any

import numpy as np


def short_way(difference: Any, period: Any, xp: ModuleType = np) -> Any:
    """Returns differences of points the short way round the glued axes.

    Args:
        difference: ``(..., m)``.
        period: ``(m,)``; inf where an axis is not glued.
        xp: ``numpy``, or ``jax.numpy`` inside a kernel.
    """
    turn = xp.where(xp.isfinite(period), period, 1.0)
    return xp.where(xp.isfinite(period), difference - turn * xp.round(difference / turn), difference)
