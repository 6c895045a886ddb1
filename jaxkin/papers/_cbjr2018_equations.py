"""Equations (1) to (24) and (29) of Chablat, Baron, Jha and Rolland 2018 against this package, at random poses."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array

import jaxkin as jk
from jaxkin.mechanisms import ppps3
from jaxkin.numerics import rotations
from jaxkin.papers import _cbjr2018_print as printed
from jaxkin.papers._samples import ROUNDING, SAMPLES, at_random, off_by
from jaxkin.papers.report import Check, Part

SEED = 2018


class Poses(NamedTuple):
    """Random poses of the paper's robot with their joints, each a tuple of columns.

    Attributes:
        position: x, y, z.
        angles: phi, theta, sigma, of all their ranges.
        joints: The six actuated joints, by this package.
        passive: rho1x, rho2x, rho3x, by this package.
    """

    position: tuple[Any, ...]
    angles: tuple[Any, ...]
    joints: tuple[Any, ...]
    passive: tuple[Any, ...]

    @property
    def rows(self) -> np.ndarray:
        """The poses as rows."""
        return np.stack([*self.position, *self.angles], axis=1)


def random_poses(robot: ppps3.PPPS3, size: int = SAMPLES) -> Poses:
    """Returns poses of order one."""
    rng = np.random.default_rng(SEED)
    position = rng.uniform(-2, 2, (size, 3))
    angles = rng.uniform(-np.pi, np.pi, (size, 3)) * [1.0, 0.5, 1.0]
    joints, passive = _joints(robot, np.concatenate([position, angles], axis=1))
    return Poses(tuple(position.T), tuple(angles.T), tuple(np.asarray(joints).T), tuple(np.asarray(passive).T))


def equations() -> Part:
    """Checks Eqs. (1) to (24) and (29)."""
    robot = ppps3.create()
    poses = random_poses(robot)
    checks = (*_rotation(poses), *_platform(robot, poses), *_variables(poses), *_reduced(robot, poses))
    return Part("Equations (1)-(24), (29)", (*checks, *_inverse(poses), *_determinant(robot, poses)))


def _rotation(poses: Poses) -> list[Check]:
    expected = np.array(printed.rotation(poses.angles))
    found = np.moveaxis(np.asarray(_matrices(np.stack(poses.angles, 1))), 0, -1)
    what = f"rotation matrix {at_random('angles')}"
    checks = [Check("eq1", "Eq. (1)", what, "as printed", "equal", off_by(found, expected), ROUNDING)]
    turned = np.einsum("nij,nkj->nik", found.transpose(2, 0, 1), found.transpose(2, 0, 1)) - np.eye(3)
    worst = float(np.max(np.abs(turned)))
    what = f"R R^T - 1 of the printed matrix {at_random('angles')}"
    return [*checks, Check("eq1-rotation", "Eq. (1)", what, "0", f"{worst:.1e}", worst, ROUNDING)]


def _platform(robot: ppps3.PPPS3, poses: Poses) -> list[Check]:
    """(2) to (5): the legs' ends are the platform's corners, if V2 and V3 are exchanged."""
    checks = []
    ends = np.array(printed.legs_ends(poses.joints, poses.passive))
    right, wrong = (
        np.array(printed.corners(poses.position, poses.angles, platform))
        for platform in (printed.PLATFORM, printed.PRINTED_PLATFORM)
    )
    what = f"C_i of (3) with this package's joints are W_i of (5), V2 and V3 exchanged, {at_random('poses')}"
    checks.append(Check("eq3-5", "Eqs. (3)-(5)", what, "C_i = W_i", "equal", off_by(ends, right), ROUNDING))

    turn = printed.rotation(poses.angles)
    gap = wrong[1] - right[1]
    expected = np.array([turn[k][1] for k in range(3)])
    what = (
        f"W2 by (4) as printed less W2 as (8) and (9) need it, {at_random('poses')}: the second column of R, length 1"
    )
    got = f"{float(np.mean(np.linalg.norm(gap, axis=0))):.6f}"
    note = "the difference is that from the column"
    checks.append(Check("eq4-printed", "Eq. (4)", what, "0", got, off_by(gap, expected), ROUNDING, note))

    mirror = ppps3.create(mirrored=True)
    mirrored = np.asarray(_joints(mirror, poses.rows)[0]).T
    legs = np.array(printed.legs_ends(tuple(mirrored), poses.passive))
    own = np.stack([legs[1, [0, 2]], legs[2, [0, 2]]])
    found = np.stack([wrong[1, [0, 2]], wrong[2, [0, 2]]])
    what = f"W2 and W3 by (4) as printed belong to this package's mirrored robot, {at_random('poses')}"
    checks.append(Check("eq4-mirrored", "Eq. (4)", what, "not said", "equal", off_by(own, found), ROUNDING))

    residuals = np.array(printed.constraints(poses.position, poses.angles, poses.joints))
    checks.append(_zero("eq6-11", "Eqs. (6)-(11)", "(6) to (11) with this package's joints", residuals))
    found = _constraint_values(robot, poses.rows, np.stack(poses.joints, 1) + 0.5)
    shifted = tuple(joint + 0.5 for joint in poses.joints)
    expected = np.stack(printed.constraints(poses.position, poses.angles, shifted), 1)
    what = f"this package's equations off the solutions, {at_random('poses')}"
    checks.append(Check("eq6-11-off", "Eqs. (6)-(11)", what, "as printed", "equal", off_by(found, expected), ROUNDING))
    far = ppps3.create(base_radius=float(printed.LEGS[0][0]) + 1)
    moved = off_by(_joints(far, poses.rows)[0], np.stack(poses.joints, 1))
    what = f"change of the joints when A_i of (2) stand 3 instead of 2 from O, {at_random('poses')}"
    note = "A_i shift where a passive joint is counted from, and are in no equation"
    checks.append(Check("eq2", "Eq. (2)", what, "not said", f"{moved:.1g}", moved, 0.0, note))
    return checks


def _zero(key: str, where: str, what: str, values: np.ndarray) -> Check:
    worst = float(np.max(np.abs(values)))
    return Check(key, where, f"{what}, {at_random('poses')}", "0", f"{worst:.1e}", worst, ROUNDING)


def _variables(poses: Poses) -> list[Check]:
    """(12) to (15): moved to where C1 has y = z = 0 and C2 has x = 0, the legs' ends have the new variables."""
    x1, x2, x3 = printed.passive_variables(poses.joints, poses.passive, corrected=True)
    m2, p, m3 = printed.variables(poses.joints, corrected=True)
    zero = np.zeros(SAMPLES)
    shift = np.stack(printed.moved((zero, zero, zero), poses.joints, corrected=True))
    ends = np.array(printed.legs_ends(poses.joints, poses.passive)) + shift
    expected = np.array([(x1, zero, zero), (zero, x2, m2), (p, -x3, m3)])
    what = f"C_i moved by (15) have the coordinates (12) to (14), signs corrected, {at_random('poses')}"
    where = "Eqs. (12)-(15)"
    checks = [Check("eq12-15", where, what, "(3) with mu for rho", "equal", off_by(ends, expected), ROUNDING)]

    y1, y2 = poses.joints[0], poses.joints[2]
    old_x1, old_x2, old_x3 = printed.passive_variables(poses.joints, poses.passive, corrected=False)
    old = [old_x1, old_x3, printed.variables(poses.joints, corrected=False)[1]]
    old.append(printed.moved(poses.position, poses.joints, corrected=False)[0])
    new = [x1, x3, p, printed.moved(poses.position, poses.joints, corrected=True)[0]]
    amounts = [-2 * y2, y2 - y1, -2 * y2, -2 * y2]
    words = ("mu1x", "mu3x", "mu3y", "x'")
    texts = ("-2 rho2y", "rho2y - rho1y", "-2 rho2y", "-2 rho2y")
    numbers = ("12", "14", "14", "15")
    for name, text, number, one, other, amount in zip(words, texts, numbers, old, new, amounts, strict=True):
        gap = one - other
        what = f"{name} as printed less {name} corrected, {at_random('poses')}: {text}; largest"
        key, got = f"eq{number}-{name.strip(chr(39))}", f"{np.max(np.abs(gap)):.3f}"
        checks.append(Check(key, f"Eq. ({number})", what, "0", got, off_by(gap, amount), ROUNDING))
    what = f"mu2x of (13) as printed, {at_random('poses')}"
    return [*checks, Check("eq13", "Eq. (13)", what, "as printed", "equal", off_by(old_x2, x2), ROUNDING)]


def _reduced(robot: ppps3.PPPS3, poses: Poses) -> list[Check]:
    mu = printed.variables(poses.joints, corrected=True)
    x = printed.moved(poses.position, poses.joints, corrected=True)[0]
    values = np.array(printed.reduced_constraints(poses.angles, mu, x))
    checks = [_zero("eq16-19", "Eqs. (16)-(19)", "(16) to (19) with (12) to (15) corrected", values)]

    old = printed.variables(poses.joints, corrected=False)
    old_x = printed.moved(poses.position, poses.joints, corrected=False)[0]
    first = np.array(printed.reduced_constraints(poses.angles, old, old_x))[0]
    what = f"(16) with (15) as printed, {at_random('poses')}: 4 rho2y; largest"
    off = off_by(first, 4 * poses.joints[2])
    checks.append(Check("eq16-printed", "Eqs. (15), (16)", what, "0", f"{np.max(np.abs(first)):.3f}", off, ROUNDING))

    turn = np.array(printed.rotation(poses.angles))
    m2, p, m3 = mu
    found = np.array([p, -(m2 + m3) / printed.ROOT3, m3 - m2, x])
    expected = np.array([turn[0, 1], turn[2, 0], turn[2, 1], (printed.ROOT3 * turn[0, 0] + turn[0, 1]) / 2])
    what = f"mu3y = R12, -(mu2z + mu3z)/sqrt3 = R31, mu3z - mu2z = R32, x' = (sqrt3 R11 + R12)/2, {at_random('poses')}"
    checks.append(Check("eq16-entries", "Eqs. (16)-(19)", what, "not said", "equal", off_by(found, expected), ROUNDING))
    own = _reduced_variables(robot, poses.rows, np.stack(poses.joints, 1))
    found = np.concatenate([np.asarray(part).T for part in own])
    passive = printed.passive_variables(poses.joints, poses.passive, corrected=True)
    expected = np.stack([*mu, *passive, *printed.moved(poses.position, poses.joints, corrected=True)])
    what = f"this package's change of variables, {at_random('poses')}"
    note = "printed signs corrected"
    return [*checks, Check("reduced", "Eqs. (12)-(15)", what, "", "equal", off_by(found, expected), ROUNDING, note)]


def _inverse(poses: Poses) -> list[Check]:
    found, expected = np.stack(poses.joints), np.stack(printed.inverse(poses.position, poses.angles))
    what = f"inverse kinematics {at_random('poses')}"
    return [Check("eq20-24", "Eqs. (20)-(24)", what, "as printed", "equal", off_by(found, expected), ROUNDING)]


def _determinant(robot: ppps3.PPPS3, poses: Poses) -> list[Check]:
    direct, own, chart, twist = _derivatives(robot, poses.rows, np.stack(poses.joints, 1))
    value = printed.singular(poses.angles)
    determinant = np.linalg.det(np.asarray(direct))
    where = "Eq. (29)"
    what = f"det dF/d(x, y, z, phi, theta, sigma) by autodiff of (6) to (11) = 8 sqrt3 times (29), {at_random('poses')}"
    off = off_by(determinant, 8 * printed.ROOT3 * value)
    checks = [Check("eq29", where, what, "(29) = 0", "equal", off, ROUNDING)]
    r22, r33, cosine = np.asarray(own["R22"]), np.asarray(own["R33"]), np.asarray(chart["cos(theta)"])
    what = f"(29) = -cos(theta) R22 R33, {at_random('poses')}"
    checks.append(
        Check("eq29-factors", where, what, "three terms", "equal", off_by(-cosine * r22 * r33, value), ROUNDING)
    )
    what = f"det d(joints)/d(velocity, angular velocity) = (sqrt3/2) R22 R33, without cos(theta), {at_random('poses')}"
    off = off_by(np.linalg.det(np.asarray(twist)), printed.ROOT3 / 2 * r22 * r33)
    checks.append(Check("eq29-twist", where, what, "not said", "equal", off, ROUNDING))

    locked = (poses.angles[0], np.full(SAMPLES, np.pi / 2), poses.angles[2])
    turn = np.array(printed.rotation(locked))
    worst = float(max(np.max(np.abs(turn[2, 2])), np.max(np.abs(turn[1, 2]))))
    what = f"|R33| and |R23| where cos(theta) = 0, {at_random('angles')}: those poses are singular already"
    return [*checks, Check("eq29-gimbal", where, what, "a surface of its own", f"{worst:.1e}", worst, 1e-15)]


@jax.jit
@jax.vmap
def _matrices(angles: Array) -> Array:
    return rotations.as_array(rotations.matrix_from_xyz(angles[0], angles[1], angles[2]))


@jax.jit
def _joints(robot: ppps3.PPPS3, poses: Array) -> tuple[Array, Array]:
    return jax.vmap(lambda x: (jk.inverse(robot, x).values[0], ppps3.passive_joints(robot, x)))(poses)


@jax.jit
def _constraint_values(robot: ppps3.PPPS3, poses: Array, joints: Array) -> Array:
    return jax.vmap(robot.constraints)(poses, joints)


@jax.jit
def _reduced_variables(robot: ppps3.PPPS3, poses: Array, joints: Array) -> tuple[Array, Array, Array]:
    found = jax.vmap(lambda x, q: ppps3.reduced(robot, x, q))(poses, joints)
    return found.joints, found.passive, found.position


@jax.jit
def _derivatives(robot: ppps3.PPPS3, poses: Array, joints: Array) -> tuple[Any, ...]:
    return jax.vmap(
        lambda x, q: (
            jax.jacfwd(robot.constraints)(x, q),
            robot.factors(x),
            robot.chart_factors(x),
            ppps3.twist_jacobian(robot, x),
        )
    )(poses, joints)
