"""Equations (1) to (12) and Table 1 of Fu and Gao against this package: position, Jacobian, singularity."""

from typing import Any

import jax
import numpy as np
from jax import Array

import jaxkin as jk
from jaxkin.mechanisms import tlpm
from jaxkin.papers import _fg_print as printed
from jaxkin.papers._samples import ROUNDING, SAMPLES, at_random, off_by
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Cell, Table

SEED = 7
#: L and h of the examples, mm: h follows from Table 1, L is ours.
RADIUS, HEIGHT = 590.0, 590.0
#: sqrt(2) h, with which home is isotropic.
ISOTROPIC = float(np.sqrt(2.0)) * HEIGHT
#: Another L whose strokes are listed for Table 1, sqrt(2) h to a micrometre.
_RADII = (RADIUS, 834.386)


def random_points(size: int = SAMPLES) -> np.ndarray:
    """Returns points ``(n, 3)`` above and below the base plane, mm."""
    return np.random.default_rng(SEED).uniform([-400, -400, -1000], [400, 400, 400], (size, 3))


def equations() -> Part:
    """Checks Eqs. (1) to (12) and Table 1."""
    robot = tlpm.create(RADIUS, HEIGHT, stroke=np.array([-800.0, 800.0]))
    points = random_points()
    table_1, table = _table_1()
    checks = (
        *_lengths(robot, points),
        *_position(robot, points),
        *table_1,
        *_velocities(robot, points),
        *_determinant(robot, points),
        *_limit(),
        *_isotropy(),
    )
    return Part("Equations (1)-(12), Table 1", checks, tables={"table_1": table})


def _lengths(robot: tlpm.TLPM, points: np.ndarray) -> list[Check]:
    base = np.array([[*map(float, q), -HEIGHT] for q in robot.base_points()])
    expected = printed.base_points(RADIUS, HEIGHT)
    what = "q1, q2, q3 with eta = 0, 120, -120 degrees, L = h = 590 mm"
    checks = [Check("eq1", "Eq. (1)", what, "as printed", "equal", off_by(base, expected), ROUNDING)]
    strokes = np.asarray(_strokes(robot, points))
    found = strokes + np.hypot(RADIUS, HEIGHT)
    what = f"l_i0 + l_i with l_i0 = sqrt(L^2 + h^2), {at_random('points')}"
    note = "p = 0 at l = 0 asks for this l_i0"
    off = off_by(found, printed.lengths(RADIUS, HEIGHT, points))
    return [*checks, Check("eq2", "Eq. (2)", what, "as printed", "equal", off, ROUNDING, note)]


def _position(robot: tlpm.TLPM, points: np.ndarray) -> list[Check]:
    initial = float(np.hypot(RADIUS, HEIGHT))
    strokes = printed.lengths(RADIUS, HEIGHT, points) - initial
    columns = tuple(strokes.T)
    right = np.array(printed.position(RADIUS, HEIGHT, initial, columns, corrected=True))
    wrong = np.array(printed.position(RADIUS, HEIGHT, initial, columns, corrected=False))
    found = _forward(robot, strokes)
    values = np.asarray(found)
    expected = np.stack([np.stack([right[0], right[1], z], axis=1) for z in right[2:]], axis=1)
    where = "Eqs. (3)-(6)"
    what = f"both poses {at_random('strokes')} by (3), (4) corrected, (5), (6)"
    checks = [Check("eq3-6", where, what, "as printed", "equal", off_by(values, expected), ROUNDING)]
    what = f"x of (3) and y of (4) corrected against the points that gave the strokes, {at_random('points')}"
    off = off_by(right[:2], points[:, :2].T)
    checks.append(Check("eq3-4", "Eqs. (3), (4)", what, "x, y", "equal", off, ROUNDING))

    _, l2, l3 = columns
    gap = printed.ROOT3 * (initial * l3 / (3 * RADIUS) - l2**2 / (6 * RADIUS))
    gap -= printed.ROOT3 * (initial * l2 / (3 * RADIUS) - initial * l2**2 / (6 * RADIUS))
    what = f"y corrected less y of (4) as printed, {at_random('points')}: the exchanged terms; largest, mm"
    got = f"{np.max(np.abs(right[1] - wrong[1])):.4g}"
    checks.append(Check("eq4-printed", "Eq. (4)", what, "0", got, off_by(right[1] - wrong[1], gap), ROUNDING))
    one = np.array(printed.P1)
    strokes = tuple(printed.lengths(RADIUS, HEIGHT, one) - initial)
    y = [float(printed.position(RADIUS, HEIGHT, initial, strokes, corrected=c)[1]) for c in (False, True)]
    what = f"y of (4) corrected at the strokes of P1, L = 590 mm; as printed it is {y[0]:.6g} mm"
    checks.append(Check("eq4-P1", "Eq. (4)", what, "100", f"{y[1]:.12g}", abs(y[1] - 100.0), 1e-9))
    middle = (values[:, 0, 2] + values[:, 1, 2]) / 2
    what = f"(z1 + z2)/2 = -h, the poses are mirror images in the base plane, {at_random('strokes')}"
    off = off_by(middle, -HEIGHT)
    checks.append(Check("eq5-6-mirror", "Eqs. (5), (6)", what, "not said", "equal", off, ROUNDING))
    return [*checks, *_numbers()]


def _numbers() -> list[Check]:
    """How many poses there are, and lengths below zero."""
    # With L = 300 and h = 400 a limb is 500 mm long at zero strokes, and p is in the base plane at -200 mm.
    robot = tlpm.create(300.0, 400.0, stroke=np.array([-499.0, 500.0])).replace(limits=jk.Limits.none(3))
    strokes = np.array([0.0, -200.0, -201.0, -1100.0])
    counted = np.asarray(_counts(robot, np.stack([strokes] * 3, axis=1))).tolist()
    what = "numbers of poses for L = 300, h = 400 mm and equal strokes 0, -200, -201, -1100 mm"
    off = float(np.sum(np.abs(np.array(counted) - [2, 1, 0, 0])))
    checks = [Check("counts", "text after (6)", what, "at most 2", ", ".join(map(str, counted)), off, 0.0)]
    z = float(printed.position(300.0, 400.0, 500.0, (-1100.0,) * 3, corrected=True)[2])
    length = 500.0 - 1100.0
    what = f"z of (5) at strokes of -1100 mm, that is limbs of {length:g} mm, against that of limbs of {-length:g} mm"
    expected = float(printed.position(300.0, 400.0, 500.0, (100.0,) * 3, corrected=True)[2])
    off, note = abs(z - expected), "squares do not see the sign: no limb has such a length, and there is no pose"
    return [*checks, Check("negative", "Eqs. (3)-(6)", what, f"{expected:.6f}", f"{z:.6f}", off, 1e-9, note)]


def _table_1() -> tuple[list[Check], Table]:
    """Table 1: h, and strokes for two L, which it leaves open."""
    height = -(printed.P1[2] + printed.P2[2]) / 2
    what = "h from z1 + z2 = -2 h, mm"
    checks = [Check("table1-h", "Table 1", what, "not given", f"{height:g}", abs(height - HEIGHT), 0.0)]
    rows: list[tuple[Cell, ...]] = []
    for radius in _RADII:
        robot = tlpm.create(radius, height, stroke=np.array([-400.0, 400.0]))
        strokes = np.asarray(_strokes(robot, np.array([printed.P1, printed.P2])))
        off = off_by(strokes[1], strokes[0])
        what = f"strokes of P2 are those of P1, L = {radius:g} mm"
        checks.append(Check(f"table1-{radius:g}-strokes", "Table 1", what, "one set", "equal", off, ROUNDING))
        poses = np.asarray(_forward(robot, strokes[:1]))[0]
        off = float(np.max(np.abs(poses - [printed.P1, printed.P2])))
        what = f"both poses at these strokes, L = {radius:g} mm; the difference is in mm"
        expected = "(100, 100, 100), (100, 100, -1280)"
        got = ", ".join("(" + ", ".join(f"{v:.9g}" for v in pose) + ")" for pose in poses)
        checks.append(Check(f"table1-{radius:g}", "Table 1", what, expected, got, off, 1e-9))
        rows.append((radius, height, *strokes[0].tolist(), *poses[0].tolist(), *poses[1].tolist()))
    header = ("L", "h", "l1", "l2", "l3", "x1", "y1", "z1", "x2", "y2", "z2")
    title = "Table 1 with strokes (mm), which depend on L; h follows from the table, L does not [ours: L]"
    return checks, Table(title, header, rows)


def _velocities(robot: tlpm.TLPM, points: np.ndarray) -> list[Check]:
    """(7) to (10): signs and names."""
    rng = np.random.default_rng(SEED)
    velocity = rng.normal(size=points.shape)
    rates = np.asarray(_stroke_rates(robot, points, velocity))
    rows = printed.directions(RADIUS, HEIGHT, points)
    left = np.einsum("nij,nj->ni", rows, velocity)
    what = f"J_dir v = -dl/dt with the rows (8), dl/dt by autodiff, {at_random('points and velocities')}"
    where, note = "Eqs. (7), (8)", "so J_inv = -1, or the rows are (p - q_i)/|p - q_i|"
    checks = [Check("eq7", where, what, "J_dir v = dl/dt", "the opposite", off_by(left, -rates), ROUNDING, note)]
    gap = float(np.max(np.abs(left - rates)) / np.max(np.abs(rates)))
    what = "J_dir v - dl/dt as printed, largest over the largest rate; the difference is that from 2"
    checks.append(Check("eq7-printed", where, what, "0", f"{gap:.6g}", abs(gap - 2), ROUNDING))
    own = np.asarray(_jacobians(robot, points))
    what = f"this package's dl/dp = -J_dir = J_inv^-1 J_dir, {at_random('points')}"
    checks.append(Check("eq9", "Eq. (9)", what, "J_inv^-1 J_dir", "equal", off_by(own, -rows), ROUNDING))
    literal = np.einsum("nij,njk,nk->ni", np.linalg.inv(rows), rows, velocity)
    gap = float(np.max(np.abs(literal - rates)) / np.max(np.abs(rates)))
    what = "J^-1 J_dir v with J = J_inv J_dir as the text has (9): it is v itself"
    note = f"off from dl/dt by up to {gap:.2g} of the largest rate"
    checks.append(Check("eq9-printed", "Eq. (9)", what, "dl/dt", "v", off_by(literal, velocity), 1e-9, note))
    value = float(np.linalg.det(-np.eye(3)))
    what = "det J_inv with the sign that (7) needs"
    checks.append(Check("eq10", "Eq. (10)", what, "not 0", f"{value:g}", abs(value + 1), 0.0))
    return checks


def _determinant(robot: tlpm.TLPM, points: np.ndarray) -> list[Check]:
    expected = printed.determinant(RADIUS, HEIGHT, points)
    found = np.linalg.det(printed.directions(RADIUS, HEIGHT, points))
    what = f"det of the rows (8), {at_random('points')}"
    checks = [Check("eq12", "Eq. (12)", what, "as printed", "equal", off_by(found, expected), ROUNDING)]
    own = np.linalg.det(np.asarray(_jacobians(robot, points)))
    what = f"this package's det(dl/dp), {at_random('points')}"
    checks.append(Check("eq12-sign", "Eq. (12)", what, "(12)", "-(12)", off_by(own, -expected), ROUNDING))
    literal = np.linalg.det(printed.directions_over_squares(RADIUS, HEIGHT, points))
    whole = np.prod(printed.lengths(RADIUS, HEIGHT, points), axis=1)
    what = (
        f"det of (11) with u_i of (12) below its fractions, times |p - q_1| |p - q_2| |p - q_3|, {at_random('points')}"
    )
    off = off_by(literal * whole, expected)
    home = np.zeros(3)
    value, whole = (
        np.linalg.det(f(RADIUS, HEIGHT, home)) for f in (printed.directions_over_squares, printed.directions)
    )
    note = f"at home (11) as printed is {value:.3g} 1/mm^3, (12) {whole:.6f}"
    checks.append(Check("eq11", "Eq. (11)", what, "(12)", "equal", off, ROUNDING, note))
    wrong = int(np.sum(np.sign(own) != np.sign(points[:, 2] + HEIGHT)))
    what = f"points, of {SAMPLES}, where det(dl/dp) has not the sign of z + h"
    checks.append(
        count_check("eq12-plane", "text after (12)", what, 0, wrong, "so z = -h is the only singular surface")
    )
    level = points * [1.0, 1.0, 0.0] - [0.0, 0.0, HEIGHT]
    worst = float(np.max(np.abs(np.linalg.det(np.asarray(_jacobians(robot, level))))))
    what = f"det(dl/dp) in the plane z = -h, {at_random('points')}"
    checks.append(Check("eq12-zero", "text after (12)", what, "0", f"{worst:.1g}", worst, ROUNDING))
    return checks


def _limit() -> list[Check]:
    """The text's limit of det for p towards q_i."""
    rng = np.random.default_rng(SEED)
    direction = rng.normal(size=(SAMPLES, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    worst, largest = 0.0, 0.0
    for corner in printed.base_points(RADIUS, HEIGHT):
        values = printed.determinant(RADIUS, HEIGHT, corner + 1e-4 * direction)
        worst = max(worst, float(np.max(np.abs(values + printed.ROOT3 / 2 * direction[:, 2]))))
        largest = max(largest, float(np.max(np.abs(values))))
    what = (
        f"(12) at 1e-4 mm from q_i in {SAMPLES} directions each against -(sqrt3/2) cos(gamma), gamma the angle to the "
        "z axis; largest value"
    )
    note = "any limit from -0.866 to 0.866, by direction; at q_i itself the row is undefined"
    return [Check("limit", "text after (12)", what, "0", f"{largest:.4f}", worst, 1e-6, note)]


def _isotropy() -> list[Check]:
    """Home of L = sqrt2 h, and a few values of (12)."""
    robot = tlpm.create(ISOTROPIC, HEIGHT)
    sizes = np.linalg.svd(np.asarray(_jacobians(robot, np.zeros((1, 3))))[0], compute_uv=False)
    off = float(np.max(np.abs(sizes - 1)))
    where = "Eqs. (8), (12) [ours]"
    what = "singular values of dl/dp at home for L = sqrt2 h: isotropic"
    checks = [Check("isotropy", where, what, "not said", "1, 1, 1", off, ROUNDING)]
    height = np.linspace(-HEIGHT + 1, 2 * HEIGHT, 4001)
    axis = np.stack([0 * height, 0 * height, height], axis=1)
    value = np.abs(printed.determinant(RADIUS, HEIGHT, axis))
    best = float(height[int(np.argmax(value))] + HEIGHT)
    what = "on the axis |det| is largest at z + h = L/sqrt2, where it is 1; z + h found on a grid, mm"
    off = abs(best - RADIUS / np.sqrt(2))
    step = float(height[1] - height[0])
    checks.append(Check("isotropy-axis", where, what, f"{RADIUS / np.sqrt(2):.3f}", f"{best:.3f}", off, step))
    points = {"home": (0.0, 0.0, 0.0), "P1": printed.P1, "P2": printed.P2}
    here = -np.linalg.det(np.asarray(_jacobians(tlpm.create(RADIUS, HEIGHT), np.array(list(points.values())))))
    for (name, point), own in zip(points.items(), here.tolist(), strict=True):
        value = float(printed.determinant(RADIUS, HEIGHT, np.array(point)))
        what = f"(12) at {name}, L = h = 590 mm, against this package's determinant with the sign changed"
        checks.append(Check(f"eq12-{name}", "Eq. (12)", what, f"{value:.6f}", f"{own:.6f}", abs(value - own), ROUNDING))
    return checks


@jax.jit
def _strokes(robot: tlpm.TLPM, points: Array) -> Array:
    return jax.vmap(lambda p: jk.inverse(robot, p).values[0])(points)


@jax.jit
def _forward(robot: tlpm.TLPM, strokes: Array) -> Array:
    return jax.vmap(lambda q: jk.forward(robot, q).values)(strokes)


@jax.jit
def _counts(robot: tlpm.TLPM, strokes: Array) -> Array:
    return jax.vmap(lambda q: jk.forward(robot, q).count)(strokes)


@jax.jit
def _jacobians(robot: tlpm.TLPM, points: Array) -> Array:
    return jax.vmap(lambda p: tlpm.stroke_jacobian(robot, p))(points)


@jax.jit
def _stroke_rates(robot: tlpm.TLPM, points: Array, velocity: Array) -> Any:
    return jax.vmap(lambda p, v: jax.jvp(lambda x: jk.inverse(robot, x).values[0], (p,), (v,))[1])(points, velocity)
