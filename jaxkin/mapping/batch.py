"""One point's function over many points: the only loop of this room over what is independent."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import numpy as np
from jax import Array

from jaxkin.mapping.chart import Chart, SectionData

#: Points that one compiled call takes; shorter calls are padded, so that a function is compiled once for a chart.
BLOCK = 512

#: ``(chart, data, u, ...) -> array or tuple of arrays`` of one point; a module's own function, compiled for.
PointFunction = Callable[..., Any]


@partial(jax.jit, static_argnames=("function", "chart"))
def _block(function: PointFunction, chart: Chart, data: SectionData, columns: tuple[Array, ...]) -> Any:
    return jax.vmap(lambda *point: function(chart, data, *point))(*columns)


def over_points(function: PointFunction, chart: Chart, data: SectionData, *columns: np.ndarray) -> Any:
    """Applies a function to points given as columns of equal length.

    Args:
        function: ``(chart, data, u, ...)`` of one point; hashable, it is compiled for.
        chart: Structure of the equations.
        data: Their numbers.
        columns: ``(k, ...)`` each, k at least 1.

    Returns:
        What the function returns, as NumPy arrays with a leading axis k.
    """
    count = len(columns[0])
    parts = []
    for start in range(0, count, BLOCK):
        some = [np.asarray(column)[start : start + BLOCK] for column in columns]
        padded = tuple(np.concatenate([s, np.repeat(s[-1:], BLOCK - len(s), axis=0)]) for s in some)
        parts.append(jax.tree.map(np.asarray, _block(function, chart, data, padded)))
    return jax.tree.map(lambda *arrays: np.concatenate(arrays)[:count], *parts)
