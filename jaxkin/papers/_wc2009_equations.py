"""The numbered and unnumbered equations of Wenger and Chablat 2009, each against this package at random points."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxkin as jk
from jaxkin.mechanisms import rpr3
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._compiled import counts_at, forms_at
from jaxkin.papers._samples import ROUNDING, SAMPLES, SEED, at_random, off_by, random_geometries, random_poses
from jaxkin.papers._wc2009_equation_8 import cusp_equation
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Table


def equations() -> Part:
    """Checks Eqs. (1) to (8), f1, f2, S, Q1 to Q4, and what the text says of numbers of solutions.

    Cost: 5 s, of which most is compilation.
    """
    rng = np.random.default_rng(SEED)
    counts, counts_table = _counts(rng)
    eighth = cusp_equation()
    checks = (
        *_constraints(rng),
        *_lines(rng),
        *_characteristic_cubic(rng),
        *counts,
        *_determinant(rng),
        *_quartic(rng),
        *_conics(rng),
        *eighth.checks,
    )
    return Part("Equations", checks, tables={"solutions": counts_table, **eighth.tables})


def _constraints(rng: np.random.Generator) -> list[Check]:
    c2, c3, d3 = random_geometries(rng)
    geometry = (c2, c3, d3, rng.uniform(0.3, 2, SAMPLES), rng.uniform(0.3, 2, SAMPLES), rng.uniform(-3, 3, SAMPLES))
    poses, rho = random_poses(rng), rng.uniform(0, 4, (3, SAMPLES))
    robots = rpr3.general(*geometry)
    found = _constraint_values(robots, np.stack(poses, 1), rho.T)
    expected = np.stack(printed.squared_lengths(geometry, poses), 1) - rho.T**2
    what = f"equations of the general robot {at_random('geometries and poses')}, largest difference over largest value"
    return [Check("eq1-3", "Eqs. (1)-(3)", what, "as printed", "equal", off_by(found, expected), ROUNDING)]


def _lines(rng: np.random.Generator) -> list[Check]:
    c2, c3, d3 = random_geometries(rng)
    geometry = (c2, c3, d3, rng.uniform(0.3, 2, SAMPLES), rng.uniform(0.3, 2, SAMPLES), rng.uniform(-3, 3, SAMPLES))
    (x, y, phi), rho = random_poses(rng), tuple(rng.uniform(0, 4, (3, SAMPLES)))
    squares = printed.squared_lengths(geometry, (x, y, phi))
    r, s, q, u, v, w = printed.lines(geometry, phi, rho)
    legs = [square - value**2 for square, value in zip(squares, rho, strict=True)]
    found = np.stack([r * x + s * y + q, u * x + v * y + w])
    expected = np.stack([legs[1] - legs[0], legs[2] - legs[0]])
    what = f"legs 2 and 3 minus leg 1 are linear in x and y, {at_random('geometries and poses')}"
    note = "R to W are not printed; derived here"
    checks = [
        Check("eq4-5", "Eqs. (4), (5)", what, "Rx+Sy+Q, Ux+Vy+W", "equal", off_by(found, expected), ROUNDING, note)
    ]

    family = printed.mirrored((c2, c3, d3))
    r, s, q, u, v, w = printed.lines(family, phi, rho)
    size = np.max(np.abs(r * v) + np.abs(s * u))
    what = f"RV - SU on the analytic family, {at_random('members and angles')}, over its terms"
    worst = float(np.max(np.abs(r * v - s * u)) / size)
    checks.append(Check("eq6", "Eq. (6)", what, "0", f"{worst:.1e}", worst, ROUNDING))

    t = np.tan(phi / 2)
    cubic, _ = printed.value_at(printed.cubic((c2, c3, d3), rho), t)
    square = (1 + t * t) ** 2
    found = np.stack([s * w - v * q, r * w - u * q])
    expected = np.stack([-4 * cubic / square, 4 * t * cubic / square])
    what = f"SW - VQ = -4 P/(1+t^2)^2 and RW - UQ = 4 t P/(1+t^2)^2, {at_random('members, angles and lengths')}"
    note = "so RW - UQ has the root t = 0 besides, where SW - VQ has none"
    checks.append(
        Check("eq7-elimination", "Eq. (7)", what, "P is (7)", "equal", off_by(found, expected), ROUNDING, note)
    )
    return [*checks, _empty_line()]


def _empty_line() -> Check:
    """The line (4) at t = 0 with rho1 = rho2: nothing but zeros."""
    r, s, q, *_ = printed.lines(printed.mirrored(printed.EXAMPLE), 0.0, (1.3, 1.3, 2.1))
    size = float(abs(r) + abs(s) + abs(q))
    what = "|R| + |S| + |Q| of (4) at t = 0, the root of (7) at rho = (1.3, 1.3, 2.1) of the example"
    return Check("eq4-empty", "Eq. (4)", what, "solved for z", f"{size:.1g}", size, 1e-15, "0 = 0: it gives no z")


def _characteristic_cubic(rng: np.random.Generator) -> list[Check]:
    geometry, poses = random_geometries(rng), random_poses(rng)
    rho = tuple(np.sqrt(s) for s in printed.squared_lengths(printed.mirrored(geometry), poses))
    value, size = printed.value_at(printed.cubic(geometry, rho), np.tan(poses[2] / 2))
    worst = float(np.max(np.abs(value) / size))
    what = f"(7) at t of a pose and its lengths, {at_random('members and poses')}, over its terms"
    return [Check("eq7", "Eq. (7)", what, "0", f"{worst:.1e}", worst, ROUNDING)]


def _counts(rng: np.random.Generator) -> tuple[list[Check], Table]:
    """Numbers of solutions of the example against real roots of the printed cubic that carry real poses."""
    robot, size = rpr3.analytic(*printed.EXAMPLE), 4000
    rho = rng.uniform(0, 4, (size, 3))
    found = counts_at(robot, rho)
    by_roots = np.array([_by_roots(tuple(q)) for q in rho])
    what = f"disagreements of forward's number of solutions with (7) and a square root, {size} random lengths"
    wrong = int(np.sum(found != by_roots[:, 1]))
    combinations, table = _combinations(by_roots[:, 0], found)

    grid = jk.Grid(rho1=(0.0, 4.0, 100), rho2=(0.0, 4.0, 100), rho3=(0.0, 4.0, 100))
    share = float((jk.sweep(robot, "forward_count", grid, progress=False).forward_count == 0).mean())
    off = abs(share - float(np.mean(found == 0)))
    where = "share of [0, 4]^3 without any solution; the difference is that between grid and random lengths"
    note = "the paper knows 6, 4 or 2"
    return [
        count_check("counts", "Eq. (7) and text", what, 0, wrong),
        combinations,
        Check("zero-share", "text after (7)", where, "none", f"{share:.1%}", off, 0.03, note),
    ], table


def _combinations(real: np.ndarray, solutions: np.ndarray) -> tuple[Check, Table]:
    """Which numbers of real roots of (7) go with which numbers of solutions."""
    own, all_kinds = ((1, 2), (3, 4), (3, 6)), ((1, 0), (1, 2), (3, 0), (3, 2), (3, 4), (3, 6))
    times = {kind: int(np.sum((real == kind[0]) & (solutions == kind[1]))) for kind in all_kinds}
    table = Table(
        f"Real roots of (7) and solutions, {len(real)} random lengths in [0, 4]^3 of the example",
        ("real roots of (7)", "solutions", "times met", "in the paper"),
        [(*kind, times[kind], "yes" if kind in own else "no") for kind in all_kinds],
    )
    met, other = sum(number > 0 for number in times.values()), len(real) - sum(times.values())
    what = "combinations (real roots, solutions) met, of (1,0) (1,2) (3,0) (3,2) (3,4) (3,6)"
    note = "(1,2), (3,4), (3,6) are the paper's; the others occur too"
    got, off = f"{met}, and {other} others", float(len(all_kinds) - met + other)
    return Check("combinations", "text after (7)", what, "3", got, off, 0.0, note), table


def _by_roots(rho: tuple[float, ...]) -> tuple[int, int]:
    """Returns the number of real roots of (7), and of real solutions (x, y, phi), for lengths of the example."""
    c2, c3, d3 = printed.EXAMPLE
    roots = np.roots(printed.cubic(printed.EXAMPLE, rho))
    t = roots[np.abs(roots.imag) < 1e-9].real
    s, c = t / np.hypot(1, t), 1 / np.hypot(1, t)
    g, k = c3 * s - d3 * c, c2 * s
    # Of (4) and (5), divided by their leading factor, the one that is not empty; y C - x S results.
    first = np.abs(k) > np.abs(g)
    factor, difference = np.where(first, k, g), np.where(first, rho[0] ** 2 - rho[1] ** 2, rho[0] ** 2 - rho[2] ** 2)
    across = -(difference + 4 * factor**2) / (4 * factor)
    return len(t), 2 * int(np.sum(across**2 < rho[0] ** 2))


def _determinant(rng: np.random.Generator) -> list[Check]:
    geometry, poses = random_geometries(rng), random_poses(rng)
    robots = rpr3.analytic(geometry[0], geometry[1], geometry[2])
    points = np.stack(poses, axis=1)
    direct, own = _direct_and_factors(robots, points)
    determinant = np.linalg.det(np.asarray(direct))
    f1, f2 = printed.factors(geometry, poses)
    t = np.tan(poses[2] / 2)
    expected = -16 * geometry[0] * f1 * f2 / (1 + t * t) ** 2
    what = f"det dF/d(x, y, phi) by autodiff = -16 c2 f1 f2/(1+t^2)^2, {at_random('members and poses')}"
    checks = [Check("det", "f1, f2", what, "f1 f2 = 0", "equal", off_by(determinant, expected), ROUNDING)]

    cosine = np.cos(poses[2] / 2)
    found, expected = np.stack([own["f1"], own["f2"]]), np.stack([f1 * cosine, f2 * cosine**3])
    what = f"this package's factors, in sine and cosine of phi/2, {at_random('members and poses')}"
    checks.append(Check("factors", "f1, f2", what, "f1 C, f2 C^3", "equal", off_by(found, expected), ROUNDING))

    rho = tuple(np.sqrt(s) for s in printed.squared_lengths(printed.mirrored(geometry), poses))
    k3, k2, k1, _ = printed.cubic(geometry, rho)
    slope = (3 * k3 * t * t + 2 * k2 * t + k1) * (1 + t * t)
    what = f"derivative of (7) = 4 c2 f2/(1+t^2), {at_random('members and poses')}, over the largest value"
    off = float(np.max(np.abs(slope - 4 * geometry[0] * f2)) / np.max(np.abs(slope)))
    note = "so f2 = 0 where (7) has a double root"
    checks.append(Check("f2-slope", "f2, Eq. (7)", what, "not said", "equal", off, ROUNDING, note))
    return checks


def _quartic(rng: np.random.Generator) -> list[Check]:
    robot, rho = rpr3.analytic(*printed.EXAMPLE), tuple(rng.uniform(0, 3, (3, SAMPLES)))
    true = forms_at(robot, np.stack(rho, 1))["S"]
    a, b, c, d = printed.cubic(printed.EXAMPLE, rho)
    discriminant = 18 * a * b * c * d - 4 * b**3 * d + (b * c) ** 2 - 4 * a * c**3 - 27 * (a * d) ** 2
    corrected = printed.quartic(rho, corrected=True)
    off = max(off_by(corrected, -discriminant / 4), off_by(true, corrected))
    what = f"S with three terms corrected = -discriminant of (7)/4 = this package's, {at_random('lengths')}"
    checks = [Check("S-discriminant", "S", what, "see errata", "equal", off, ROUNDING)]

    point = (np.sqrt(3.0), 1.0, 1.0)
    wrong, right = (float(printed.quartic(point, corrected=c)) for c in (False, True))
    what = "S as it stands at the paper's own cusp (sqrt 3, 1, 1); the difference is that from 189"
    note = (
        f"corrected: {right:.1e}. It is off by -rho1^2 (3 rho1^6 - 16 rho1^4 rho3^4 - 16 rho2^4 + 16 rho3^4), here 189"
    )
    checks.append(Check("S-printed", "S", what, "0", f"{wrong:.12g}", abs(wrong - 189), 1e-9, note))
    return checks


def _conics(rng: np.random.Generator) -> list[Check]:
    robot, rho = rpr3.analytic(*printed.EXAMPLE), tuple(rng.uniform(0, 3, (3, SAMPLES)))
    found = forms_at(robot, np.stack(rho, 1))
    checks = []
    for name, expected in printed.conics(rho).items():
        what = f"this package's {name}, {at_random('lengths')}"
        checks.append(Check(name, name, what, "as printed", "equal", off_by(found[name], expected), ROUNDING))
    x, _, phi = random_poses(rng)
    y = -x / np.tan(phi / 2)
    lengths = np.sqrt(np.stack(printed.squared_lengths(printed.mirrored(printed.EXAMPLE), (x, y, phi))))
    values = np.abs(list(printed.conics(tuple(lengths)).values()))
    worst = float(np.max(np.min(values, axis=0) / np.sum(lengths**2, axis=0)))
    what = f"smallest of |Q1| to |Q4| at {SAMPLES} random poses with f1 = 0, over the squared lengths"
    checks.append(Check("Q-f1", "Q1 to Q4", what, "0", f"{worst:.1e}", worst, ROUNDING))

    rho = (1.3, 1.3, 2.1)
    smallest = float(min(abs(q) for q in printed.conics(rho).values()))
    constant = float(abs(printed.cubic(printed.EXAMPLE, rho)[3])) + _empty_line().difference
    what = "(7) and all of (4) at t = 0, rho = (1.3, 1.3, 2.1) of the example"
    note = f"so their resultant vanishes, while no Q does (smallest {smallest:.2g}): K does"
    checks.append(Check("K", "text before Q1", what, "K is never 0", f"{constant:.1g}", constant, 1e-15, note))
    return checks


@jax.jit
def _constraint_values(robots: Any, poses: Array, joints: Array) -> Array:
    return jax.vmap(lambda robot, pose, q: robot.constraints(pose, q))(robots, poses, joints)


@jax.jit
def _direct_and_factors(robots: Any, poses: Array) -> tuple[Array, dict[str, Array]]:
    def one(robot: Any, pose: Array) -> tuple[Array, dict[str, Array]]:
        return jk.jacobians(robot, pose, jnp.ones(3)).direct, robot.factors(pose)

    return jax.vmap(one)(robots, poses)
