"""Branches: all solutions of one configuration, padded and masked."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import Status
from jaxkin.core.tracing import is_traced


class Lane(NamedTuple):
    """One padded solution inside a hot kernel: arrays of one batch shape, nothing stacked.

    Attributes:
        values: One array per coordinate.
        status: ``Status`` codes, int8.
        multiplicity: How many solutions coincide here, int8; 0 in an empty lane (that is what empty means).
        residual: Dimensionless residual.
    """

    values: tuple[Array, ...]
    status: Array
    multiplicity: Array
    residual: Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Branches:
    """All solutions of one inverse or forward problem, in padded lanes.

    The order of the lanes is deterministic and documented by the mechanism; it is no identity: along a
    path in joint space modes may change lanes.

    Attributes:
        values: ``(n_branch, n_coordinate)``; NaN in lanes without a solution.
        valid: ``(n_branch,)`` bool, True where the lane holds a solution.
        status: ``(n_branch,)`` int8 codes of ``Status``.
        multiplicity: ``(n_branch,)`` int8, 2 for a double solution, 0 in an empty lane.
        residual: ``(n_branch,)`` dimensionless residual of the constraint equations.
    """

    values: Array
    valid: Array
    status: Array
    multiplicity: Array
    residual: Array

    @property
    def count(self) -> Array:
        """Number of distinct solutions."""
        return jnp.sum(self.valid, axis=-1)

    def sentences(self) -> list[str]:
        """The status of every lane as a sentence (a concrete, unbatched result only)."""
        return [Status(int(code)).sentence for code in np.asarray(self.status)]

    def __str__(self) -> str:
        """A summary of a few lines; batched or traced results print their shapes."""
        if is_traced(self.values) or self.values.ndim != 2:
            return f"Branches(values{tuple(self.values.shape)})"
        valid = np.asarray(self.valid)
        lines = [f"{int(valid.sum())} real solutions in {valid.size} lanes"]
        for lane in np.flatnonzero(valid):
            numbers = "  ".join(f"{value: .12g}" for value in np.asarray(self.values[lane]) + 0.0)
            note = "" if int(self.status[lane]) == Status.OK else f"  {Status(int(self.status[lane])).name.lower()}"
            multiple = int(self.multiplicity[lane])
            lines.append(
                f"  [{lane}] {numbers}  residual {float(self.residual[lane]):.1e}"
                + (f"  multiplicity {multiple}" if multiple > 1 else "")
                + note
            )
        for code in sorted({int(c) for c in np.asarray(self.status)[~valid]}):
            lines.append(f"  other lanes: {Status(code).sentence}")
        return "\n".join(lines)


def stack_lanes(lanes: tuple[Lane, ...]) -> Branches:
    """Stacks the lanes of a kernel into ``Branches``; the last axes are (branch, coordinate)."""
    multiplicity = jnp.stack([lane.multiplicity for lane in lanes], axis=-1)
    return Branches(
        values=jnp.stack([jnp.stack(lane.values, axis=-1) for lane in lanes], axis=-2),
        valid=multiplicity > 0,
        status=jnp.stack([lane.status for lane in lanes], axis=-1),
        multiplicity=multiplicity,
        residual=jnp.stack([lane.residual for lane in lanes], axis=-1),
    )
