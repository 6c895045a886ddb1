"""Where a leg is stretched or folded (det B = 0, B = dF/djoints) over a section: there two working modes meet."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import scale_vector
from jaxkin.kinematics.legs import Legs
from jaxkin.mapping.assembly import Arc, strands_of
from jaxkin.mapping.chart import UNKNOWN, Chart, SectionData
from jaxkin.mapping.section import Section
from jaxkin.mapping.tracing import trace_section
from jaxkin.numerics.small_linalg import any_determinant


@dataclass(frozen=True)
class SerialChart(Chart):
    """The equations of a section on which not A but B is singular.

    Attributes:
        rows: The equation of each joint, whose entries of B vanish one by one; empty where det B itself is meant.
    """

    rows: tuple[int, ...] = ()

    @partial(jax.jit, static_argnums=0)
    def determinant(self, data: SectionData, u: Array) -> Array:
        """Returns the entry of B that ``data.factor`` picks, or det B, dimensionless."""
        pose, joints = self.configuration(data, u)
        unit = scale_vector(data.robot.joint_axes, data.robot.characteristic_length())
        inverse = jax.jacfwd(data.robot.constraints, argnums=1)(pose, joints) * unit / data.row_scale[:, None]
        if not self.rows:
            return any_determinant(inverse)
        return sum((data.factor[k] * inverse[row, k] for k, row in enumerate(self.rows)), start=jnp.zeros(()))

    def determinant_size(self, data: SectionData, u: Array) -> Array:
        """Returns 1: an entry of B over its equation's magnitude is of order one already."""
        del data, u
        return jnp.ones(())


@dataclass(frozen=True, eq=False)
class SerialCurve:
    """A curve of poses at which a leg is stretched or folded.

    Attributes:
        section: The section bound to its equations, for points between its points.
        points: ``(k, m)`` in the section's unknowns.
        closed: True where the last point is followed by the first.
        leg: The joint whose entry of B vanishes, -1 where only det B is known.
        ends: What it ends on.
    """

    section: Section
    points: np.ndarray
    closed: bool
    leg: int
    ends: tuple[str, str]


def serial_sections(section: Section, legs: Legs | None) -> list[tuple[int, Section]]:
    """Returns the section once for every leg that has two working modes, with the leg's number.

    A leg that the pose gives as a length, squared, has one working mode: its length is not negative.
    """
    n = len(section.robot.joint_axes)
    explicit = {section.grid.free[k] for k, kind in enumerate(section.chart.kinds) if kind != UNKNOWN}
    if legs is None:
        if explicit:
            return []
        chart = SerialChart(section.chart.n_pose, section.chart.kinds)
        return [(-1, replace(section, chart=chart, data=section.data._replace(factor=jnp.zeros(0))))]
    chart = SerialChart(section.chart.n_pose, section.chart.kinds, legs.rows)
    twofold = [k for k in range(n) if len(legs.signs[k]) > 1 and k not in explicit]
    return [(k, replace(section, chart=chart, data=section.data._replace(factor=jnp.eye(n)[k]))) for k in twofold]


def serial_curves(section: Section, legs: Legs | None) -> tuple[list[SerialCurve], int]:
    """Traces all curves of a section on which B is singular.

    Returns:
        The curves, by leg, and by how many points and pieces the searches disagree about them.
    """
    curves, doubts = list[SerialCurve](), 0
    for leg, own in serial_sections(section, legs):
        traced = trace_section(own)
        doubts += int(traced.evidence["of these on no traced curve"]) + int(traced.evidence["contradictory pieces"])
        curves += [_curve(own, strand, leg) for strand in strands_of(traced.arcs, own.period)]
    return curves, doubts


def _curve(section: Section, strand: Arc, leg: int) -> SerialCurve:
    ends = strand.start.kind, strand.end.kind
    return SerialCurve(section, strand.points, strand.closed, leg, ends)


def pieces(curve: SerialCurve, labels: np.ndarray) -> list[tuple[np.ndarray, bool]]:
    """Cuts a curve where what it bounds changes.

    Args:
        curve: The curve.
        labels: ``(k, n)`` at its points: equal where it bounds the same aspects.

    Returns:
        Points of each piece, ``(j, m)``, and whether it is the whole closed curve.
    """
    change = np.any(labels != np.roll(labels, 1, axis=0), axis=1)
    change[0] &= curve.closed
    cuts = np.flatnonzero(change)
    if len(cuts) == 0:
        return [(curve.points, curve.closed)]
    if curve.closed:
        runs = np.split(np.roll(np.arange(len(labels)), -cuts[0]), np.cumsum(np.diff(cuts)))
    else:
        runs = np.split(np.arange(len(labels)), cuts)
    return [(curve.points[run], False) for run in runs if len(run) > 1]
