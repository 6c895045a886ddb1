"""Equations (25) to (28) of Chablat, Baron, Jha and Rolland 2018: the printed way to the poses, and what it loses.

The printed way has three arccosines, whose signs and supplements are tried against the constraints. It is written out
in ``_cbjr2018_print`` for comparison only: this package takes two square roots and no trigonometric function.
"""

from collections import Counter

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxkin as jk
from jaxkin.mechanisms import ppps3
from jaxkin.papers import _cbjr2018_print as printed
from jaxkin.papers._cbjr2018_equations import SEED
from jaxkin.papers._samples import ROUNDING, at_random, off_by
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Table

#: Joints at which all candidates are tried; they stay off the singularities, where solutions coincide.
_JOINTS, _MARGIN = 200, 0.02
#: A candidate is a solution where (16) to (19) are met this well.
_SOLVED = 1e-9
#: Joints of the unit cube |mu| <= 1 at which solutions are counted.
_CUBE = 20000
#: Angles around home at which accuracy is measured.
_NEAR = (0.0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4)
_TURNS = 200


def direct_kinematics() -> Part:
    """Checks Eqs. (25) to (28), with tables of the candidates and of the accuracy around home."""
    robot = ppps3.create()
    mu = _random_variables(np.random.default_rng(SEED), _JOINTS)
    tried, candidates = _candidates(mu)
    accuracy, near = _near_home(robot)
    checks = (*_values(robot, mu), *tried, *_numbers(robot), *accuracy, *_derivatives(robot))
    return Part("Eqs. (25)-(28)", checks, tables={"candidates": candidates, "near_home": near})


def feasibility(mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns a = R33^2 and b = R22^2 at ``(..., 3)`` variables (mu2z, mu3y, mu3z)."""
    m2, p, m3 = np.moveaxis(mu, -1, 0)
    return 1 - 4 / 3 * (m2 * m2 - m2 * m3 + m3 * m3), 1 - (m2 - m3) ** 2 - p * p


def _random_variables(rng: np.random.Generator, size: int) -> np.ndarray:
    cube = rng.uniform(-1, 1, (16 * size, 3))
    return cube[np.min(feasibility(cube), axis=0) > _MARGIN][:size]


def _joints_of(mu: np.ndarray) -> np.ndarray:
    """Returns joints ``(n, 6)`` with these variables, and rho1y = rho1z = rho2y = 0, so that x' = x."""
    zero = np.zeros(len(mu))
    return np.stack([zero, zero, zero, mu[:, 0], mu[:, 1], mu[:, 2]], axis=1)


def _values(robot: ppps3.PPPS3, mu: np.ndarray) -> list[Check]:
    """What the printed formulas are, in entries of the rotation of this package's four poses."""
    frames = _frames(robot, _joints_of(mu))
    x, turn = np.asarray(frames.position)[..., 0], np.asarray(frames.rotation)
    columns = tuple(mu.T)
    first, second = (printed.abscissa(columns, sign) for sign in (1.0, -1.0))
    off = off_by(np.sort(x, axis=1), np.sort(np.stack([first, first, second, second], axis=1), axis=1))
    where = at_random("joints").replace("500", str(_JOINTS))
    what = f"x' of (25), both signs, against x + rho2y of the four poses (each twice), {where}"
    checks = [Check("eq25", "Eq. (25)", what, "x", "equal, as x'", off, ROUNDING)]
    a, b = feasibility(mu)
    root = np.abs(first - second) / 2 * (1 - (mu[:, 0] - mu[:, 2]) ** 2)
    what = f"the root of (25) = (sqrt3/2) |R22 R33|, {where}"
    off = off_by(root, printed.ROOT3 / 2 * np.sqrt(a) * np.sqrt(b))
    checks.append(Check("eq25-root", "Eq. (25)", what, "not said", "equal", off, ROUNDING))

    p = mu[:, 1, None]
    square = p**2 - p * x + x**2
    level = np.hypot(turn[..., 0, 0], turn[..., 0, 1])
    found = np.array(
        [
            2 * np.sqrt(square / 3),
            (p - 2 * x) / (2 * np.sqrt(square)),
            np.sqrt((0.75 - mu[:, 0] ** 2 + mu[:, 0] * mu[:, 2] - mu[:, 2] ** 2)[:, None] / square),
        ]
    )
    expected = np.array([level, -turn[..., 0, 0] / level, np.abs(turn[..., 2, 2]) / level])
    words = (
        ("26", "argument of (26) = |cos(theta)|, x meaning x'", "arccos of it is in [0, pi/2]"),
        ("27", "argument of (27) = -R11/|cos(theta)|, x meaning x'", "so sigma1 belongs to theta2, not to theta1"),
        ("28", "argument of (28) = |R33/cos(theta)|, mu for rho and x' for x", "with rho as printed it is no solution"),
    )
    for (number, what, note), one, other in zip(words, found, expected, strict=True):
        checks.append(
            Check(f"eq{number}", f"Eq. ({number})", f"{what}, {where}", "", "equal", off_by(one, other), ROUNDING, note)
        )
    return checks


def _tried(mu: np.ndarray) -> tuple[dict[tuple[str, str, int], np.ndarray], dict[tuple[str, str, int], np.ndarray]]:
    """Returns the candidates at ``(n, 3)`` variables, each ``(16, 4, n)``, and which are solutions, ``(16, n)``."""
    columns = tuple(mu.T)
    with np.errstate(invalid="ignore"):
        every = printed.candidates(columns)
    values = {
        key: np.array(printed.reduced_constraints(tuple(np.moveaxis(t[:, :3], 1, 0)), columns, t[:, 3]))
        for key, t in every.items()
    }
    return every, {key: np.max(np.abs(value), axis=0) < _SOLVED for key, value in values.items()}


#: Which candidates, in words; which of their kinds, and whether only theta >= 0; how many there are and are solutions.
_SETS = (
    ("all signs of theta, sigma, phi, both kinds, both x'", ("theta1", "theta2"), ("sigma1", "sigma2"), (1, -1), False),
    ("theta2 both signs, +-sigma1, four phi, both x'", ("theta2",), ("sigma1",), (1, -1), False),
    ("theta2 both signs, +-sigma1, four phi, one x'", ("theta2",), ("sigma1",), (1,), False),
    ("theta in [pi/2, pi] as the text says, +-sigma1, four phi, both x'", ("theta2",), ("sigma1",), (1, -1), True),
    ("theta1 with the printed +-sigma1, four phi, both x'", ("theta1",), ("sigma1",), (1, -1), False),
)
_EXPECTED = ((128, 8, 4), (32, 4, 4), (16, 2, 2), (16, 2, 2), (32, 0, 0))


def _candidates(mu: np.ndarray) -> tuple[list[Check], Table]:
    """How many candidates of (25) to (28) there are, are solutions, and are different rotations."""
    every, solved = _tried(mu)
    checks, rows = [], []
    for number, ((words, thetas, sigmas, roots, above), expected) in enumerate(zip(_SETS, _EXPECTED, strict=True)):
        keys = [key for key in every if key[0] in thetas and key[1] in sigmas and key[2] in roots]
        triples = np.concatenate([every[key] for key in keys])
        there = np.ones_like(triples[:, 1], bool) if not above else triples[:, 1] >= 0
        good = np.concatenate([solved[key] for key in keys]) & there
        met = np.stack([there.sum(axis=0), good.sum(axis=0), _rotations(triples, good)], axis=1)
        wrong = int(np.sum(np.any(met != expected, axis=1)))
        what = (
            f"joints, of {len(mu)}, where not {expected[1]} of {expected[0]} candidates solve (16)-(19), "
            f"{expected[2]} rotations: {words}"
        )
        checks.append(count_check(f"candidates-{number}", "text after (28)", what, 0, wrong))
        rows.append((words, *Counter(map(tuple, met.tolist())).most_common(1)[0][0]))
    header = ("candidates", "number", "solutions", "different rotations")
    return checks, Table(f"Candidates of Eqs. (25)-(28) at {len(mu)} random joints with four poses", header, rows)


def _rotations(triples: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Returns how many different rotations are among the solutions: they differ in the signs of R22 and R33."""
    turn = printed.rotation(tuple(np.moveaxis(triples[:, :3], 1, 0)))
    kind = 2 * (turn[1][1] > 0) + (turn[2][2] > 0)
    return np.sum([np.any(good & (kind == k), axis=0) for k in range(4)], axis=0)


def _numbers(robot: ppps3.PPPS3) -> list[Check]:
    """How many poses there are: four or none, and none where both radicands of (25) are negative."""
    cube = np.random.default_rng(SEED).uniform(-1, 1, (_CUBE, 3))
    count = np.asarray(_counts(robot, _joints_of(cube)))
    a, b = feasibility(cube)
    wrong = int(np.sum(count != np.where((a > 0) & (b > 0), 4, 0)))
    what = f"joints, of {_CUBE} with |mu| <= 1, where the number of poses is not 4 for a, b > 0 and 0 otherwise"
    checks = [
        count_check("poses", "text after (28)", what, 0, wrong, "a = R33^2 and b = R22^2 are the radicands of (25)")
    ]
    share = float(np.mean(count == 0))
    what = "share of |mu| <= 1 without any pose; the difference is that from 1 - 1/sqrt3, which is exact"
    off = abs(share - 1 + 1 / printed.ROOT3)
    checks.append(
        Check("no-pose", "text after (28)", what, "four for any joints", f"{share:.1%}", off, 0.02, "random joints")
    )
    # Over a larger cube, as within the unit cube both are rarely negative.
    wide = np.random.default_rng(SEED).uniform(-2, 2, (_CUBE, 3))
    both = wide[np.max(feasibility(wide), axis=0) < -_MARGIN]
    real = np.isfinite(printed.abscissa(tuple(both.T), 1.0))
    counted = np.asarray(_counts(robot, _joints_of(wide)))[np.max(feasibility(wide), axis=0) < -_MARGIN]
    what = f"joints, of {len(both)} random ones with a < 0 and b < 0, where (25) is not real or there is a pose"
    off = int(np.sum(~real | (counted > 0)))
    checks.append(count_check("no-pose-real-x", "Eq. (25)", what, 0, off, "the root of a product is real, no pose is"))
    x = float(printed.abscissa((1.0, 1.0, -1.0), 1.0))
    solved = int(sum(good.sum() for good in _tried(np.array([[1.0, 1.0, -1.0]]))[1].values()))
    what = f"candidates that solve (16)-(19) at mu = (1, 1, -1), where (25) gives x' = {x:.6f}"
    checks.append(count_check("no-pose-example", "Eq. (25)", what, 0, solved))
    return [*checks, *_boundary(robot)]


def _boundary(robot: ppps3.PPPS3) -> list[Check]:
    """Joints between four poses and none: double ones, a quadruple one, and infinitely many."""
    where = "text after (28) [ours]"
    mu = np.array([(1.0, 0.0, 0.5), (0.0, 1.0, 0.0), (printed.ROOT3 / 2, 1.0, printed.ROOT3 / 2)])
    counted = np.asarray(_counts(robot, _joints_of(mu))).tolist()
    what = "numbers of poses where a = 0, b = 0, a = b = 0: mu = (1, 0, 1/2), (0, 1, 0), (sqrt3/2, 1, sqrt3/2)"
    off = float(np.sum(np.abs(np.array(counted) - [2, 2, 1])))
    checks = [Check("boundary", where, what, "2, 2, 1", ", ".join(map(str, counted)), off, 0.0)]
    still = _joints_of(np.array([(0.5, 0.0, -0.5)]))[0]
    poses = np.asarray(_self_motion(robot, still, np.linspace(-3, 3, 13)))
    values = printed.reduced_constraints(tuple(poses[:, 3:].T), (0.5, 0.0, -0.5), poses[:, 0])
    worst = float(np.max(np.abs(values)))
    what = "(16) to (19) along the self-motion at mu = (1/2, 0, -1/2), where (25) divides by zero"
    moved = float(np.ptp(poses[:, 0]))
    note = f"x' moves by {moved:.2f} at joints that stand still"
    return [*checks, Check("self-motion", where, what, "0", f"{worst:.1e}", worst + (moved < 1.0), ROUNDING, note)]


def _near_home(robot: ppps3.PPPS3) -> tuple[list[Check], Table]:
    """Errors of the rotations that the printed way and this package find, for poses close to home."""
    rng, rows = np.random.default_rng(SEED), []
    for size in _NEAR:
        angles = rng.uniform(-size, size, (_TURNS, 3))
        joints = np.stack(printed.inverse((0.0 * angles[:, 0],) * 3, tuple(angles.T)), axis=1)
        true = np.array(printed.rotation(tuple(angles.T)))
        mode = np.moveaxis(np.asarray(_frames(robot, joints).rotation)[:, 0], 0, -1)
        own, theirs = np.max(np.abs(mode - true)), _best(joints, true)
        lost = int(np.sum(np.isnan(theirs)))
        kept = theirs[~np.isnan(theirs)] if lost < len(theirs) else np.array([np.inf])
        rows.append((size, lost, float(np.max(kept)), float(np.median(kept)), float(own)))
    worst, here = max(row[2] for row in rows), max(row[4] for row in rows)
    where = "Eqs. (26)-(28)"
    what = "largest error of R by the printed way, up to 1e-4 rad around home; the difference is in decades from 1e-8"
    note = (
        f"all three arguments of arccos are 1 at home; {sum(row[1] for row in rows)} of {_TURNS * len(_NEAR)} poses "
        "are lost altogether, as rounding makes one larger than 1"
    )
    checks = [Check("home-printed", where, what, "exact", f"{worst:.1e}", abs(np.log10(worst) + 8), 0.7, note)]
    what = "largest error of R by this package at the same joints"
    checks.append(Check("home-here", where, what, "", f"{here:.1e}", here, 1e-14))
    header = (
        "angles up to (rad)",
        "printed way: lost",
        "its largest error",
        "its median error",
        "this package, largest",
    )
    return checks, Table(f"Error of R around home, {_TURNS} random poses a row, best of all candidates", header, rows)


def _best(joints: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Returns the error of the best candidate at ``(n, 6)`` joints, ``(n,)``; NaN where all are NaN."""
    mu = np.stack(printed.variables(tuple(joints.T), corrected=True), axis=1)
    triples = np.concatenate(list(_tried(mu)[0].values()))
    found = np.array(printed.rotation(tuple(np.moveaxis(triples[:, :3], 1, 0))))
    return np.fmin.reduce(np.max(np.abs(found - turn[:, :, None]), axis=(0, 1)), axis=0)


def _derivatives(robot: ppps3.PPPS3) -> list[Check]:
    """Derivatives at home with respect to the joints, of both ways."""
    home = jnp.zeros(3)
    slopes = np.asarray(_printed_slopes(home))
    joints = jnp.array([0.0, 0.0, printed.ROOT3 / 2, 0.0, -printed.ROOT3 / 2, 0.0])
    own = np.asarray(_own_slopes(robot, joints))
    twist = np.linalg.inv(np.asarray(ppps3.twist_jacobian(robot, jnp.zeros(6))))
    # At home an infinitesimal rotation omega = (phi, theta, sigma) changes R by (R32, R13, R21).
    found = np.stack([own[2, 1], own[0, 2], own[1, 0]])
    # The joints (rho2z, rho3y, rho3z), which are mu2z, mu3y and mu3z but for constants.
    right = int(np.sum(np.all(np.abs(np.abs(slopes) - np.abs(twist[3:, [3, 4, 5]])) < 1e-6, axis=1)))
    where, lost = "Eqs. (26)-(28)", int(np.sum(~np.isfinite(slopes)))
    what = "angles of (phi1, theta1, sigma1) whose derivatives with respect to mu at home are right, by autodiff"
    note = f"{lost} of 9 derivatives are no numbers, as arccos has none at 1"
    checks = [count_check("home-gradient", where, what, 0, right, note)]
    what = "derivative of this package's home mode at home against the inverse of the velocity equations"
    off = off_by(found, twist[3:])
    return [*checks, Check("home-gradient-here", where, what, "", "equal", off, ROUNDING)]


@jax.jit
def _frames(robot: ppps3.PPPS3, joints: Array) -> jk.Frames:
    return jax.vmap(lambda q: jk.forward_frames(robot, q))(joints)


@jax.jit
def _counts(robot: ppps3.PPPS3, joints: Array) -> Array:
    return jax.vmap(lambda q: jk.forward(robot, q).count)(joints)


@jax.jit
def _self_motion(robot: ppps3.PPPS3, joints: Array, turns: Array) -> Array:
    return jax.vmap(lambda turn: ppps3.self_motion(robot, joints, turn))(turns)


@jax.jit
def _printed_slopes(mu: Array) -> Array:
    def angles(mu: Array) -> Array:
        columns = (mu[0], mu[1], mu[2])
        return jnp.stack(printed.first_angles(columns, printed.abscissa(columns, -1.0, jnp), jnp))

    return jax.jacfwd(angles)(mu)


@jax.jit
def _own_slopes(robot: ppps3.PPPS3, joints: Array) -> Array:
    return jax.jacfwd(lambda q: jk.forward_frames(robot, q).rotation[0])(joints)
