"""Singular curves of a section from a mechanism's closed forms: labelled, with their virtual parts, cut to the box."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping import search
from jaxkin.mapping.batch import in_blocks
from jaxkin.mapping.loci import evaluated
from jaxkin.mapping.records import Crossings, Curve, SingularCurves
from jaxkin.mapping.section import Section
from jaxkin.numerics.gluing import short_way
from jaxkin.sweep.grid import Span


def closed_form_curves(section: Section) -> SingularCurves:
    """Returns the pieces that the mechanism's ``closed_form_curves`` gives, cut where they leave the section's box.

    Raises:
        InputError: The mechanism declares no closed forms.
    """
    robot: Any = section.robot
    if not hasattr(robot, "closed_form_curves"):
        raise InputError(
            f"jk.singular_curves: {robot} declares no closed forms of its singular curves (rpr3.analytic does): use "
            "method='trace'."
        )
    axis = next(k for k, value in enumerate(section.grid.values) if not isinstance(value, Span))
    pieces = robot.closed_form_curves(axis, section.grid.values[axis])
    curves = [curve for piece in pieces for curve in _inside(section, piece)]
    joints, poses, residual = evaluated(section, _crossing_points(section, pieces))
    return SingularCurves(
        curves=tuple(sorted(curves, key=lambda curve: -len(curve))),
        crossings=Crossings(joints, poses, residual),
        **section.record("closed form"),
    )


def _crossing_points(section: Section, pieces: list[Any]) -> np.ndarray:
    """Returns the crossings, from the poses of the real pieces: the search starts beside every one of them."""
    poses = [piece.poses for piece in pieces if not piece.virtual]
    if not poses:
        return np.zeros((0, section.chart.dimension))
    points = np.concatenate(poses) / np.asarray(section.data.pose_unit)
    points = points[np.min(search.margins(section, points), axis=1) >= 0]
    return search.crossings(section, points)[0]


def _inside(section: Section, piece: Any) -> list[Curve]:
    """Cuts one piece to the box."""
    free = list(section.grid.free)
    values = piece.joints[:, free]
    low, high = np.asarray(section.data.low), np.asarray(section.data.high)
    here = np.all((values >= low) & (values <= high), axis=1)
    if here.all():
        ends = ("", "") if piece.closed else (_natural(section, piece, 0), _natural(section, piece, -1))
        return [_curve(section, piece, piece.joints, piece.poses, piece.closed, ends)]
    joints, poses = piece.joints, piece.poses
    if piece.closed:  # Begin outside, so that no run goes over the end of the list.
        start = int(np.flatnonzero(~here)[0])
        joints, poses, here = (np.concatenate([a[start:], a[: start + 1]]) for a in (joints, poses, here))
    edges = np.diff(np.concatenate([[0], here.astype(int), [0]]))
    curves = []
    for first, last in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True):
        parts, ends = [(joints[first : last + 1], poses[first : last + 1])], []
        for inner, outer, natural in ((first, first - 1, 0), (last, last + 1, -1)):
            if outer < 0 or outer >= len(here):
                ends.append(_natural(section, piece, natural))
                continue
            joint, pose, edge = _border(section, piece, joints[[inner, outer]], poses[[inner, outer]])
            parts.insert(0 if natural == 0 else len(parts), (joint[None], pose[None]))
            ends.append(section.border_name(edge))
        whole = [np.concatenate(part) for part in zip(*parts, strict=True)]
        curves.append(_curve(section, piece, whole[0], whole[1], False, (ends[0], ends[1])))
    return [curve for curve in curves if len(curve) > 1]


def _natural(section: Section, piece: Any, k: int) -> str:
    """Says what a whole piece ends on: a leg of zero length, or a crossing."""
    names = [axis.name for axis in section.robot.joint_axes]
    zero = [name for name, value in zip(names, piece.joints[k], strict=True) if value == 0.0]
    return f"{zero[0]} = 0" if zero else "crossing"


def _border(section: Section, piece: Any, joints: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Returns the point of a piece on the border between a point inside and one outside, and the border's number."""
    free = list(section.grid.free)
    low, high = np.asarray(section.data.low), np.asarray(section.data.high)
    inner, outer = joints[:, free]
    bounds = np.stack([low, high], axis=1).ravel()
    room = np.stack([outer - low, high - outer], axis=1).ravel()
    step = np.repeat(outer - inner, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(room < 0, (bounds - np.repeat(inner, 2)) / step, np.inf)
    edge = int(np.argmin(share))  # The border that is crossed first.
    guess = joints[0] + share[edge] * (joints[1] - joints[0])
    if piece.virtual:
        other = free[1 - edge // 2]
        guess[free[edge // 2]] = bounds[edge]
        solved = _solve_virtual(section.robot, piece.label, guess, other, float(abs(joints[1, other] - guess[other])))
        return solved, np.full(poses.shape[1], np.nan), edge
    unit = np.asarray(section.data.pose_unit)
    a, b = poses / unit
    start = a + share[edge] * short_way(b - a, section.period)
    point = search.border_points(section, start[None], np.array([edge]))[0]
    joint, pose, _ = evaluated(section, point)
    return joint[0], pose[0], edge


def _solve_virtual(robot: Mechanism, label: str, joints: np.ndarray, other: int, width: float) -> np.ndarray:
    """Solves the labelled polynomial for one joint by secants."""

    def value(t: float) -> float:
        point = joints.copy()
        point[other] = t
        return float(_forms(robot, point[None])[label][0])

    a, b = joints[other], joints[other] + 1e-3 * width + 1e-9
    fa, fb = value(a), value(b)
    for _ in range(40):
        if fb == fa or abs(b - a) <= 1e-15 * abs(b):
            break
        a, b, fa = b, b - fb * (b - a) / (fb - fa), fb
        fb = value(b)
    solved = joints.copy()
    solved[other] = b
    return solved


@jax.jit
def _forms(robot: Any, joints: Array) -> dict[str, Array]:
    return jax.vmap(robot.closed_forms)(joints)


@jax.jit
def _virtual_residuals(robot: Any, joints: Array) -> dict[str, Array]:
    """Returns each form's value against its change over the joints' own size, to first and second order."""

    def one(q: Array) -> dict[str, Array]:
        value = robot.closed_forms(q)
        first, second = jax.jacfwd(robot.closed_forms)(q), jax.hessian(robot.closed_forms)(q)
        return {
            name: jnp.abs(value[name])
            / (jnp.sum(jnp.abs(first[name] * q)) + jnp.sum(jnp.abs(second[name] * q * q[:, None])))
            for name in value
        }

    return jax.vmap(one)(joints)


def _curve(
    section: Section, piece: Any, joints: np.ndarray, poses: np.ndarray, closed: bool, ends: tuple[str, str]
) -> Curve:
    if piece.virtual:
        residual = in_blocks(partial(_virtual_residuals, section.robot), joints)[piece.label]
    else:
        residual = evaluated(section, poses / np.asarray(section.data.pose_unit))[2]
    return Curve(joints, poses, closed, float(np.max(residual)), piece.label, piece.virtual, ends)
