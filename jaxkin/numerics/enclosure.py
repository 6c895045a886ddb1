"""Enclosures of a function, its gradient and its second derivatives over boxes, from its jaxpr.

The function is read once as a list of elementary operations and run in interval arithmetic, with first and second
derivatives carried along, for all boxes at once. Nothing is compiled. What encloses is the arithmetic, up to rounding,
which is not directed: a user of the bounds keeps a margin far above it.

References:
    Moore, R. E., 1966, "Interval Analysis"; Neumaier, A., 1990, "Interval Methods for Systems of Equations" (mean
    value and Taylor forms).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.numerics import _intervals as iv
from jaxkin.numerics._jet_program import Program, program_of
from jaxkin.numerics._jets import Jet, UnsupportedOperation, joined, pairs

__all__ = ["Enclosure", "Jet", "UnsupportedOperation", "enclosure_of", "pairs", "taylor_remainder"]


@dataclass(frozen=True, eq=False)
class Enclosure:
    """A function ``(parameters, x) -> (m,)`` that can be enclosed over boxes of x; make it with ``enclosure_of``."""

    program: Program

    def __call__(self, parameters: Any, low: np.ndarray, high: np.ndarray) -> Jet:
        """Encloses the function and its derivatives over boxes.

        Args:
            parameters: Numbers in the structure for which the function was read.
            low: ``(d, B)`` lower ends.
            high: ``(d, B)`` upper ends.

        Returns:
            The jet: value ``(m, B)``, first ``(d, m, B)`` and second derivatives ``(d (d + 1) / 2, m, B)``, a low and
            a high array each; infinite where nothing is known, for instance where a root may vanish.

        Raises:
            UnsupportedOperation: No enclosure is known of one of its operations.
        """
        d, boxes = low.shape
        leaves = [np.asarray(leaf, float).ravel() for leaf in jax.tree_util.tree_leaves(parameters)]
        constants = [Jet(iv.point(np.full((1, 1), value))) for leaf in leaves for value in leaf]
        centre, half, unit = 0.5 * (low + high), 0.5 * (high - low)[:, None], np.eye(d)[:, :, None, None]
        variables = [
            Jet((low[k : k + 1], high[k : k + 1]), iv.point(unit[k]), None, centre[k : k + 1], half) for k in range(d)
        ]
        with np.errstate(all="ignore"):
            result = joined(self.program.run([*constants, *variables]), d)
        if result.value[0].shape[-1] == boxes:
            return result
        # Nothing depends on x.
        value, first, second = (
            tuple(np.broadcast_to(end, (*end.shape[:-1], boxes)) for end in part)
            for part in (result.value, result.first, result.second)
            if part is not None
        )
        return Jet(value, first, second)  # type: ignore[arg-type]


def enclosure_of(function: Callable[[Any, Any], Any], parameters: Any, dimension: int) -> Enclosure:
    """Reads a function ``(parameters, x) -> (m,)`` of JAX, x of ``(dimension,)``, for enclosures over boxes of x.

    It may hold sums, products, quotients, integer powers, square roots, sines, cosines, two-argument arctangents,
    absolute values, comparisons and choices. Whole numbers that say where entries go must not depend on the parameters.
    """
    closed = jax.make_jaxpr(function)(parameters, jnp.zeros(dimension))
    return Enclosure(program_of(closed.jaxpr, tuple(closed.consts)))


def taylor_remainder(jet: Jet, half: np.ndarray) -> np.ndarray:
    """Bounds what a second-order remainder adds to a linear form about a box's centre, ``(m, B)``.

    Args:
        jet: Enclosure over the box, or over a larger one.
        half: ``(d, B)`` half widths of the box.
    """
    assert jet.second is not None
    total = np.zeros(jet.second[0].shape[1:])
    with np.errstate(invalid="ignore"):
        for k, (i, j) in enumerate(pairs(len(half))):
            size = iv.magnitude((jet.second[0][k], jet.second[1][k]))
            total += (0.5 if i == j else 1.0) * size * half[i] * half[j]
    return total * (1 + 1e-9)
