"""The equations of a section of the workspace: two pose coordinates are free, and so are all joints.

Unknown are the two pose coordinates and the joints that the pose does not give. The curve det A = 0 is smooth in them
also where a leg is stretched or folded (det B = 0): there it goes on in the next working mode, while its joints turn
back. So all working modes are traced at once, and told apart along the curves.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import Array

from jaxkin.mapping.chart import SQUARE, Chart, SectionData, picked
from jaxkin.numerics.small_linalg import any_determinant

#: What vanishes on the curves: det A; the entry of B of one leg; the square that the pose gives for a joint; det B.
PARALLEL, ENTRY, ZERO_LENGTH, SERIAL = "det A", "entry of B", "zero length", "det B"


class PoseNumbers(NamedTuple):
    """The numbers of a section of the workspace that a section of the joint space does not have.

    Attributes:
        fixed: ``(n_pose,)`` pose coordinates, zero for the free ones.
        free: ``(2, n_pose)`` picks each free coordinate.
        unit: ``(2,)`` one unit per free coordinate.
        low: ``(2,)`` lower ends.
        high: ``(2,)`` upper ends.
        whole: ``(2,)`` True where a glued coordinate runs over its whole period.
        entry: ``(n_rows, n_unknown)`` picks the entry of B that vanishes.
        square: ``(n_joint,)`` picks the joint whose length vanishes.
    """

    fixed: Array
    free: Array
    unit: Array
    low: Array
    high: Array
    whole: Array
    entry: Array
    square: Array


@dataclass(frozen=True)
class PoseChart(Chart):
    """The structure of the equations of a section of the workspace.

    Attributes:
        vanishing: PARALLEL, ENTRY, ZERO_LENGTH or SERIAL.
    """

    vanishing: str = PARALLEL

    @property
    def n_moving(self) -> int:
        """Number of pose coordinates that are unknowns."""
        return 2

    def pose(self, data: SectionData, u: Array) -> Array:
        """Returns the pose in its own units, angles as they come."""
        numbers: PoseNumbers = data.workspace
        return numbers.fixed + picked(numbers.free.T, u[:2] * numbers.unit)

    def inverse_matrix(self, data: SectionData, u: Array) -> Array:
        """Returns B = dF/djoints of the unknown joints and the equations that hold, square and dimensionless."""
        return jax.jacfwd(partial(self.section, data))(u)[:, self.n_moving :]

    @partial(jax.jit, static_argnums=0)
    def determinant(self, data: SectionData, u: Array) -> Array:
        """Returns what vanishes on the curves, dimensionless."""
        if self.vanishing == PARALLEL:
            return super().determinant(data, u)
        if self.vanishing == ZERO_LENGTH:
            squares = [k for k, kind in enumerate(self.kinds) if kind == SQUARE]
            parts = (data.workspace.square[k] * self.free_value(data, u, k) / data.free_unit[k] ** 2 for k in squares)
            return sum(parts, start=jnp.zeros(()))
        inverse = self.inverse_matrix(data, u)
        return any_determinant(inverse) if self.vanishing == SERIAL else jnp.sum(data.workspace.entry * inverse)

    def determinant_size(self, data: SectionData, u: Array) -> Array:
        """Returns the size by which it is judged: an entry of B over its equation's magnitude is of order one."""
        return super().determinant_size(data, u) if self.vanishing == PARALLEL else jnp.ones(())

    @partial(jax.jit, static_argnums=0)
    def margins(self, data: SectionData, u: Array) -> Array:
        """Returns smooth functions, not negative inside: the free coordinates' low and high ends, then the joints'."""
        numbers: PoseNumbers = data.workspace
        parts = []
        for k in range(2):
            value = u[k] * numbers.unit[k]
            for gap in (value - numbers.low[k], numbers.high[k] - value):
                parts.append(jnp.where(numbers.whole[k], 1.0, gap / numbers.unit[k]))
        return jnp.concatenate([jnp.stack(parts), super().margins(data, u)])
