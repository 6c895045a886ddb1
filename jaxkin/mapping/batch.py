"""Many points by one compiled function: the only loop of this room over what is independent."""

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
def _block(function: PointFunction, chart: Chart, data: SectionData, *columns: Array) -> Any:
    return jax.vmap(lambda *point: function(chart, data, *point))(*columns)


def over_points(function: PointFunction, chart: Chart, data: SectionData, *columns: np.ndarray) -> Any:
    """Applies a function to points given as columns of equal length.

    Args:
        function: ``(chart, data, u, ...)`` of one point; hashable, it is compiled for.
        chart: Structure of the equations.
        data: Their numbers.
        columns: ``(k, ...)`` each; k may be 0.

    Returns:
        What the function returns, as NumPy arrays with a leading axis k.
    """
    return in_blocks(partial(_block, function, chart, data), *columns)


def in_blocks(kernel: Callable[..., Any], *columns: np.ndarray, block: int = BLOCK, axis: int = 0) -> Any:
    """Calls a compiled function on blocks of rows, all padded to one length.

    Args:
        kernel: Takes as many arrays as there are columns, ``(block, ...)`` each.
        columns: ``(k, ...)`` each; k may be 0.
        block: Rows a call.
        axis: Where the rows stand in what the kernel returns.

    Returns:
        What the kernel returns (an array, or a tuple or dict of them), as NumPy arrays with k rows.
    """
    columns = tuple(map(np.asarray, columns))
    count, parts = len(columns[0]), []
    for start in range(0, max(count, 1), block):
        some = [column[start : start + block] for column in columns]
        fills = [s[-1:] if len(s) else np.ones((1, *s.shape[1:]), s.dtype) for s in some]
        padded = [np.concatenate([s, np.repeat(f, block - len(s), axis=0)]) for s, f in zip(some, fills, strict=True)]
        parts.append(jax.tree.map(np.asarray, kernel(*padded)))
    return jax.tree.map(lambda *a: np.concatenate(a, axis)[(*[slice(None)] * (axis % a[0].ndim), slice(count))], *parts)
