"""Equations (13) to (23) of Fu and Gao and the conditions after them, against this package's wrist [ours]."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.mechanisms import _tlpm_wrist, tlpm
from jaxkin.papers import _fg_print as printed
from jaxkin.papers._fg_equations import HEIGHT, RADIUS, SEED
from jaxkin.papers._samples import ROUNDING, SAMPLES, at_random, off_by
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Table

#: The points |x|, |y|, |z| <= 200 mm in which the error of (23) is stated: a grid with its corners.
_REACH, _GRID = 200.0, 21


def wrist() -> Part:
    """Checks Eqs. (13) to (23), the limits of angles and the condition for distances."""
    points = np.random.default_rng(SEED).uniform(-_REACH, _REACH, (SAMPLES, 3))
    angles, table = _reference_angles()
    checks = (*_axes(points), *_frames(points), *_matrices(), *_angles(points), *angles, *_conditions())
    return Part("Equations (13)-(23)", checks, tables={"wrist_angles": table})


def _axes(points: np.ndarray) -> list[Check]:
    robot = tlpm.create(RADIUS, HEIGHT)
    links = np.asarray(_links(robot, points))
    # Link 2 begins at p + b z1.
    own = (links[:, :3, 0] - points[:, None]) / float(robot.b)
    expected = printed.limb_axes(RADIUS, HEIGHT, points)
    what = f"unit vectors from p to q_i, {at_random('points')}"
    checks = [Check("eq13-14", "Eqs. (13), (14)", what, "as printed", "equal", off_by(own, expected), ROUNDING)]
    tangent = printed.turn(2, printed.ETA) @ np.array([0.0, 1.0, 0.0])
    level = printed.base_points(RADIUS, HEIGHT) * [1.0, 1.0, 0.0]
    worst = float(np.max(np.abs(np.sum(tangent * level, axis=1)))) / RADIUS
    what = "y_i1 . q_i: the axis of the universal joint is tangent to the circle"
    return [*checks, Check("eq15", "Eq. (15)", what, "0", f"{worst:.1g}", worst, ROUNDING)]


def _frames(points: np.ndarray) -> list[Check]:
    """(16) to (18): R_i0 is no rotation."""
    z = printed.limb_axes(RADIUS, HEIGHT, points)
    tangent = printed.turn(2, printed.ETA) @ np.array([0.0, 1.0, 0.0])
    old, new = (printed.limb_frames(RADIUS, HEIGHT, points, corrected=c) for c in (False, True))
    skew = np.einsum("nikj,nikl->nijl", old, old)[..., 1, 2]
    expected = -points @ tangent.T / printed.lengths(RADIUS, HEIGHT, points)
    where = "Eqs. (16)-(18)"
    what = f"y . z of R_i0 as printed = -t_i . p/|q_i - p|, {at_random('points')}; largest"
    got = f"{np.max(np.abs(skew)):.4f}"
    checks = [Check("eq18-printed", where, what, "0", got, off_by(skew, expected), ROUNDING, "so it is no rotation")]
    gram = np.einsum("nikj,nikl->nijl", new, new) - np.eye(3)
    worst = float(np.max(np.abs(gram)))
    what = f"R_i0^T R_i0 - 1 with y = z x x, {at_random('points')}"
    checks.append(Check("eq18", where, what, "0", f"{worst:.1g}", worst, ROUNDING))
    off = off_by(new[..., 2], z)
    what = "the third column is z_i1 still"
    return [*checks, Check("eq18-z", where, what, "z_i1", "equal", off, ROUNDING)]


def _matrices() -> list[Check]:
    """(19), (20): the matrices."""
    rng = np.random.default_rng(SEED)
    first, second = rng.uniform(-np.pi, np.pi, (2, SAMPLES))
    literal, product = printed.wrist(first, second), printed.turn(2, first) @ printed.turn(1, second)
    gap = literal - product
    expected = np.zeros_like(gap)
    expected[:, 1, 2] = -2 * np.sin(first) * np.sin(second)
    what = f"matrix under (19) less Rz(theta1) Ry(theta2), {at_random('angles')}: -2 s1 s2 in row 2, column 3; largest"
    got = f"{np.max(np.abs(gap)):.4f}"
    checks = [Check("eq19-matrix", "Eq. (19)", what, "0", got, off_by(gap, expected), ROUNDING, "so it is no rotation")]
    axes = printed.platform_frames()[:, :, 1]
    level = printed.turn(2, printed.ETA) @ np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5)])
    what = "second column of v_i: the R2 axis Rz(eta_i) (sin 45, 0, cos 45)"
    note = "for the platform's orientation 1 and eta_i2 = eta_i1; beta2 = 45 degrees"
    checks.append(Check("eq20", "Eq. (20)", what, "not said", "equal", off_by(axes, level), ROUNDING, note))
    links = np.asarray(_links(tlpm.create(RADIUS, HEIGHT), np.zeros((1, 3))))[0]
    own = links[3:, 1] / float(tlpm.create().r2)
    what = "R2 axes of this package, platform's orientation 1"
    return [*checks, Check("eq20-here", "Eq. (20)", what, "second column", "equal", off_by(own, axes), ROUNDING)]


def _angles(points: np.ndarray) -> list[Check]:
    """(21) to (23): what they give, read with R_i1 = 1."""
    robot = tlpm.create(RADIUS, HEIGHT)
    own = _wrist_angles(robot, points)
    theta2, psi = np.asarray(own.theta2), np.asarray(own.psi)
    exact = printed.limb_frames(RADIUS, HEIGHT, points, corrected=True)
    first, second = printed.angles(printed.remaining(exact))
    what = (
        f"(22) with R_i1 = 1 and R_i0 corrected is psi_i + pi/2, the active angle and not R1's, {at_random('points')}"
    )
    note = "a rotation about z_i1, while theta_i1 turns about z_i2"
    checks = [
        Check("eq22", "Eq. (22)", what, "theta_i1", "equal", _apart(first, psi + np.pi / 2), ROUNDING, note),
        Check(
            "eq23",
            "Eq. (23)",
            f"(23) with R_i1 = 1 and R_i0 corrected is -theta_i2 of this package, {at_random('points')}",
            "theta_i2",
            "equal",
            _apart(second, -theta2),
            ROUNDING,
            "the sign is that of a left-handed angle",
        ),
    ]
    other = _wrist_angles(tlpm.create(RADIUS, HEIGHT, elbows=(-1, -1, -1)), points)
    matrix = printed.remaining(exact)
    flipped = np.arctan2(-matrix[..., 2, 0], -matrix[..., 2, 2])
    what = f"theta_i2 of the other elbow = atan2(-M31, -M33), half a turn further, {at_random('points')}"
    off = max(_apart(np.asarray(other.theta2), flipped), _apart(np.asarray(other.theta2), theta2 + np.pi))
    checks.append(Check("eq23-elbow", "Eq. (23)", what, "not said", "equal", off, ROUNDING, "[ours]"))

    checks += _printed_errors(robot)
    return [*checks, _closure(own, exact)]


def _printed_errors(robot: tlpm.TLPM) -> list[Check]:
    """How far (23) is off with R_i0 as printed, and how far R1 is from standing still."""
    grid = np.array(list(itertools.product(np.linspace(-_REACH, _REACH, _GRID), repeat=3)))
    right, wrong = (
        printed.angles(printed.remaining(printed.limb_frames(RADIUS, HEIGHT, grid, corrected=c)))[1]
        for c in (True, False)
    )
    largest = float(np.degrees(np.max(np.abs(_wrapped(wrong - right)))))
    what = (
        f"error of (23) with R_i0 as printed on a grid |x|, |y|, |z| <= {_REACH:g} mm, L = h = {RADIUS:g} mm; largest, "
        "degrees"
    )
    note = "passes from 20 degrees on"
    checks = [Check("eq23-printed", "Eqs. (18), (23)", what, "0", f"{largest:.2f}", max(0.0, 20 - largest), 0.0, note)]
    skew = np.abs(np.degrees(_wrapped(np.asarray(_wrist_angles(robot, grid).theta1) - np.pi / 2)))
    what = (
        "theta_i1 of this package less 90 degrees, which Rz(theta1) Ry(theta2) alone takes for granted; largest, "
        "degrees"
    )
    got, off = f"{np.max(skew):.2f}", float(max(0.0, 15 - np.max(skew)))
    note = "a general rotation needs three angles; passes from 15 degrees on"
    checks.append(Check("eq19-two-angles", "Eq. (19)", what, "0", got, off, 0.0, note))
    return checks


def _closure(own: _tlpm_wrist.WristAngles, frames: np.ndarray) -> Check:
    """R_i0 Rz(psi) Rx(pi/2) Rz(theta1) Ry(pi/2 - theta2) = v_i, our reading of (19)."""
    psi, theta1, theta2 = (np.asarray(angle) for angle in (own.psi, own.theta1, own.theta2))
    chain = frames @ printed.turn(2, psi) @ printed.turn(0, np.pi / 2)
    chain = chain @ printed.turn(2, theta1) @ printed.turn(1, np.pi / 2 - theta2)
    off = float(np.max(np.abs(chain - printed.platform_frames())))
    what = f"v_i = R_i0 Rz(psi_i) Rx(pi/2) Rz(theta_i1) Ry(pi/2 - theta_i2), {at_random('points')}"
    note = "our reading of (19), with R_i1 = Rz(psi_i) Rx(pi/2)"
    return Check("eq19-closure", "Eqs. (19), (20) [ours]", what, "w_i = v_i", "equal", off, ROUNDING, note)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """Returns the largest difference of angles, whole turns left out."""
    return float(np.max(np.abs(_wrapped(one - other))))


def _reference_angles() -> tuple[list[Check], Table]:
    """Angles at home and at P1."""
    robot = tlpm.create(RADIUS, HEIGHT)
    found = _wrist_angles(robot, np.array([(0.0, 0.0, 0.0), printed.P1]))
    # Roundings of zero are no news.
    degrees = np.round(np.degrees(np.stack([found.theta1, found.theta2, found.psi], axis=1)), 12) + 0.0
    where = "Eqs. (21)-(23) [ours]"
    off = float(np.max(np.abs(degrees[0] - [[90.0], [90.0], [0.0]])))
    what = "theta_i1, theta_i2, psi_i at home for L = h, degrees: well within the printed limits"
    checks = [Check("wrist-home", where, what, "90, 90, 0", "equal", off, 1e-12)]
    inside = np.stack([degrees[:, k] - np.degrees(low) for k, (low, _) in enumerate(printed.ANGLES)])
    inside = min(float(np.min(inside)), 180.0 - float(np.max(degrees[:, :2])))
    what = "least distance of these angles from the printed limits, home and P1, degrees"
    checks.append(Check("wrist-limits", where, what, "above 0", f"{inside:.2f}", max(0.0, -inside), 0.0))
    rows = [
        (name, limb + 1, *degrees[k, :, limb].tolist()) for k, name in enumerate(("home", "P1")) for limb in range(3)
    ]
    title = "Wrist angles (degrees) for the platform's orientation 1, L = h = 590 mm [ours]"
    return checks, Table(title, ("pose", "limb", "theta_i1", "theta_i2", "psi_i"), rows)


def _conditions() -> list[Check]:
    """The limits of angles, and the least distance."""
    robot = tlpm.create(RADIUS, HEIGHT)
    limits = np.stack([np.asarray(robot.wrist_limits.low), np.asarray(robot.wrist_limits.high)], axis=1)
    where = "text after (23)"
    what = "limits of theta_i1 and theta_i2, rad"
    off = float(np.max(np.abs(limits - printed.ANGLES)))
    checks = [Check("limits", where, what, "pi/10, pi; pi/6, pi", "equal", off, 1e-15)]

    side = float(robot.a)
    rolls = np.radians(np.arange(0.0, 91.0, 1.0))
    # How far a square of side a reaches towards its neighbour.
    extent = side / 2 * (np.abs(np.cos(rolls)) + np.abs(np.sin(rolls)))
    needed = float(2 * np.max(extent))
    what = f"least distance of parallel axes that excludes contact at every roll, a = {side:g} mm: sqrt2 a"
    note = f"printed sqrt(a) is no length; as a number it is {np.sqrt(side):g}, less than a itself"
    off = abs(needed - np.sqrt(2.0) * side)
    checks.append(Check("distance", "D > sqrt(a)", what, "sqrt(a)", f"{needed:.6f} mm", off, 1e-12, note))
    names = [name.split("-") for name in _tlpm_wrist.CLEARANCE_NAMES]
    mixed = sum({one[-1], other[-1]} == {"2", "3"} for one, other in names)
    what = "pairs of a link L_i2 and a link L_j3 of another limb; printed: i = 1, 2, 3"
    return [*checks, count_check("pairs", "D_23i", what, 6, mixed, "the pairs are ordered")]


@jax.jit
def _links(robot: tlpm.TLPM, points: Array) -> Array:
    return jax.vmap(lambda p: _tlpm_wrist.links(robot, p))(points)


@jax.jit
def _wrist_angles(robot: tlpm.TLPM, points: Array) -> _tlpm_wrist.WristAngles:
    return jax.vmap(lambda p: _tlpm_wrist.wrist_angles(robot, p))(jnp.asarray(points))
