"""The exact oracles checked on answers known by other means."""

from __future__ import annotations

import math
import random
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpq, fmpq_poly

from .rpr3_exact import (
    ExactCount,
    SelfMotion,
    count_analytic,
    count_general,
    poses_general,
    rational,
    tarski_query,
)

BETA = 0.88260310976443155
BENCHMARK = (
    (17.04, 0.0),
    (20.84 * math.cos(BETA), 20.84 * math.sin(BETA)),
    15.91,
    0.0,
    10.0,
)
SIX_MODES = [
    (-8.7265953318629088, 12.175669752170042, -0.98697423784544515),
    (-5.4956608154528646, -13.935498276039359, -0.047331369366917773),
    (-14.896128100172762, 1.5829616619626078, 0.24530953099162642),
    (-13.419939013974376, -6.6562479567101796, 0.58567278325855305),
    (14.920133247154399, -1.3379177430462295, 1.0020385399022499),
    (14.673943655735036, -3.0126031249259319, 2.1329043651290889),
]
EXAMPLE = (1, 0, 1)  # c2, c3, d3


def legs_of(pose, b2, b3, c2, c3, d3):
    """Returns squared leg lengths of the pose (x, y, cos, sin)."""
    x, y, cos, sin = pose
    ends = [(x + cos * u - sin * v, y + sin * u + cos * v) for u, v in ((0, 0), b2, b3)]
    base = (0, 0), (c2, 0), (c3, d3)
    return [(p - a) ** 2 + (q - b) ** 2 for (p, q), (a, b) in zip(ends, base, strict=True)]


def residual(pose, robot, r):
    x, y, phi = pose
    found = legs_of((x, y, math.cos(phi), math.sin(phi)), *robot)
    return max(abs(a - float(b)) for a, b in zip(found, r, strict=True))


def rational_rotation(rng):
    t = Fraction(rng.randint(-9, 9), rng.randint(1, 9))
    return t, (1 - t * t) / (1 + t * t), 2 * t / (1 + t * t)


def rational_draw(rng, low=-4, high=4, denominator=2):
    return Fraction(rng.randint(low * denominator, high * denominator), denominator)


def mirrored(c2, c3, d3):
    """Returns the analytic member as a general robot."""
    return (c2, 0), (c3, -d3), c2, c3, d3


def test_tarski_query():
    x = fmpq_poly([0, 1])
    f = (x - 1) ** 2 * (x + 2) * (x**2 + 1) * (x - 3)
    assert tarski_query(f) == 3
    assert tarski_query(f, x) == 1
    assert tarski_query(f, x - 3) == -2
    assert tarski_query(fmpq_poly([5])) == 0


def test_six_modes():
    poses = poses_general(*BENCHMARK, 14.98, 15.38, 12)
    assert count_general(*BENCHMARK, 14.98, 15.38, 12) == ExactCount(6, False)
    np.testing.assert_allclose(poses, SIX_MODES, rtol=0, atol=2e-13)


def test_alias_platform():
    robot = ((4, 0), (2, 2), 10, 3, 10)
    legs = (50, 26, 25)
    poses = poses_general(*robot, *legs, squared=True)
    assert count_general(*robot, *legs, squared=True) == ExactCount(2, False)
    assert (5.0, 5.0, 0.0) in poses
    assert len(poses) == 2
    assert max(residual(p, robot, legs) for p in poses) < 1e-12


@pytest.mark.parametrize(
    ("legs", "expected"),
    [
        ((2, 1, 2), (2, False)),  # only phi = pi: X = (7/4, +-sqrt(15)/4)
        ((1, 1, 1), (4, True)),  # phi = 0 and phi = pi with h^2 = rho1^2, phi = -pi/2 with two poses
        ((1, 1, 0.5), None),  # phi = 0 is a root without a pose
        ((1, 1, 1.5), (6, False)),  # phi = 0 carries two poses
        ((0.25, 1, 3), (0, False)),  # triangle inequality
        ((0, 1, 1), None),
    ],
)
def test_analytic_section(legs, expected):
    result = count_analytic(*EXAMPLE, *legs)
    assert result == count_general(*mirrored(*EXAMPLE), *legs)
    if expected:
        assert result == expected
    poses = poses_general(*mirrored(*EXAMPLE), *legs)
    assert len(poses) == result.count
    assert all(residual(p, mirrored(*EXAMPLE), [v * v for v in legs]) < 1e-14 for p in poses)


def test_pose_at_pi():
    poses = poses_general(*mirrored(*EXAMPLE), 2, 1, 2)
    y = math.sqrt(15) / 4
    np.testing.assert_allclose(poses, [(1.75, -y, -math.pi), (1.75, y, -math.pi)], atol=1e-15)


def test_cusp_is_a_triple_root():
    # r1 = r2 + 2, r3 = r2: t = -1 three times.
    assert count_analytic(*EXAMPLE, 3, 1, 1, squared=True) == (2, True)
    poses = poses_general(*mirrored(*EXAMPLE), 3, 1, 1, squared=True)
    s = math.sqrt(0.5)
    expected = [(1 - s, 1 + s, -math.pi / 2), (1 + s, 1 - s, -math.pi / 2)]
    np.testing.assert_allclose(poses, expected, atol=1e-15)


def test_parallel_legs_are_singular():
    # (rho1 - rho2)^2 + (rho1 - rho3)^2 = 4 (c2 = d3 = 1) puts three parallel legs at a pose.
    legs = fmpq(11, 5), fmpq(1), fmpq(3, 5)
    assert count_analytic(*EXAMPLE, *legs).degenerate
    assert count_general(*mirrored(*EXAMPLE), *legs).degenerate
    inside, outside = (count_analytic(*EXAMPLE, legs[0], 1, legs[2] + fmpq(e, 10**12)) for e in (1, -1))
    assert abs(inside.count - outside.count) == 2
    assert not inside.degenerate
    assert not outside.degenerate


def test_analytic_equals_general():
    rng = random.Random(1)
    seen = set()
    for _ in range(300):
        denominator = rng.choice([1, 2, 10])  # coarse grids meet degenerate samples
        c2, d3 = (rng.choice([-1, 1]) * rational_draw(rng, 1, 3, denominator) for _ in range(2))
        c3 = rational_draw(rng, -2, 2, denominator)
        legs = [rational_draw(rng, 0, 4, denominator) for _ in range(3)]
        result = count_analytic(c2, c3, d3, *legs)
        robot = mirrored(c2, c3, d3)
        assert result == count_general(*robot, *legs), (c2, c3, d3, legs)
        assert result.count == len(poses_general(*robot, *legs))
        seen.add(result)
    assert {n for n, _ in seen} >= {0, 2, 4, 6}
    assert {d for _, d in seen} == {True, False}


def test_count_is_even_unless_degenerate_and_poses_satisfy_the_legs():
    rng = random.Random(2)
    for _ in range(150):
        robot = [
            tuple(rational_draw(rng) for _ in range(2)),
            tuple(rational_draw(rng) for _ in range(2)),
            rational_draw(rng, 1, 4),
            rational_draw(rng),
            rational_draw(rng, 1, 4),
        ]
        if robot[0] == (0, 0) or robot[1] == (0, 0):
            continue
        t, cos, sin = rational_rotation(rng)
        x, y = rational_draw(rng), rational_draw(rng)
        r = legs_of((x, y, cos, sin), *robot)
        count, degenerate = count_general(*robot, *r, squared=True)
        poses = poses_general(*robot, *r, squared=True)
        numbers = [[float(v) for v in p] for p in robot[:2]] + [float(v) for v in robot[2:]]
        assert len(poses) == count >= 1
        assert degenerate or count % 2 == 0
        assert max(residual(p, numbers, r) for p in poses) < 1e-11
        given = float(x), float(y), 2 * math.atan(t)
        assert min(math.dist(p, given) for p in poses) < 1e-14


def four_bar_scan(robot, r, grid=1 << 15):
    """Counts poses by another route: the four-bar of legs 1 and 2, sign changes of the third leg's error."""
    (b2x, b2y), b3, c2, c3, d3 = robot
    length, tilt = math.hypot(b2x, b2y), math.atan2(b2y, b2x)
    crank = np.linspace(-math.pi, math.pi, grid + 1)
    x, y = math.sqrt(r[0]) * np.cos(crank), math.sqrt(r[0]) * np.sin(crank)
    dist = np.hypot(c2 - x, y)
    cosine = (length**2 + dist**2 - r[1]) / (2 * length * dist)
    closed = np.abs(cosine) <= 1
    count, ends_clear = 0, True
    for sign in (1, -1):
        phi = np.arctan2(-y, c2 - x) + sign * np.arccos(np.clip(cosine, -1, 1)) - tilt
        u = x + np.cos(phi) * b3[0] - np.sin(phi) * b3[1] - c3
        v = y + np.sin(phi) * b3[0] + np.cos(phi) * b3[1] - d3
        error = u**2 + v**2 - r[2]
        both = closed[1:] & closed[:-1]
        count += int(np.sum(both & (error[1:] * error[:-1] < 0)))
        # A root within one cell of the limit of the four-bar or of a tangency is beyond this scan.
        step = np.abs(np.diff(error))
        edge = closed[1:] != closed[:-1]
        near = np.minimum(np.abs(error[1:]), np.abs(error[:-1])) < 30 * np.maximum(step, 1e-6)
        ends_clear &= not np.any(edge & near)
        turning = both[1:] & both[:-1] & (np.diff(error)[1:] * np.diff(error)[:-1] <= 0)
        ends_clear &= not np.any(turning & (np.abs(error[1:-1]) < 1e-5))
    return count if ends_clear else None


def test_general_equals_a_four_bar_scan():
    rng = random.Random(3)
    compared = 0
    for _ in range(80):
        b2, b3 = (rng.uniform(1, 5), rng.uniform(-2, 2)), (rng.uniform(-3, 3), rng.uniform(-3, 3))
        robot = (b2, b3, rng.uniform(2, 5), rng.uniform(-3, 3), rng.uniform(1, 5))
        phi = rng.uniform(-3, 3)
        r = legs_of((rng.uniform(-4, 4), rng.uniform(-4, 4), math.cos(phi), math.sin(phi)), *robot)
        scan = four_bar_scan(robot, r)
        if scan is not None:
            compared += 1
            assert scan == count_general(*robot, *r, squared=True).count
    assert compared > 40


@pytest.mark.parametrize("half_turn", [False, True])
@pytest.mark.parametrize(("reach", "at_zero"), [(3, 2), (5, 1), (6, 0)])
def test_coincident_lines(half_turn, reach, at_zero):
    # At phi = 0 (or pi) w2 = (2, 0), w3 = (3, 0): both lines are x = reach, the circle is |X| = 5.
    sign = -1 if half_turn else 1
    robot = ((sign * 6, 0), (sign * 4, sign * 3), 4, 1, 3)
    legs = (25, 25 + 4 + 4 * reach, 25 + 9 + 6 * reach)
    poses = poses_general(*robot, *legs, squared=True)
    angle = -math.pi if half_turn else 0.0
    there = [p for p in poses if p[2] == angle]
    y = math.sqrt(max(25 - reach**2, 0))
    assert there == [(reach, -y, angle), (reach, y, angle)][:at_zero] if y else len(there) == at_zero
    count, degenerate = count_general(*robot, *legs, squared=True)
    assert count == len(poses)
    assert degenerate == (reach == 5)
    assert max((residual(p, robot, legs) for p in poses), default=0) < 1e-12


def test_random_coincident_lines():
    rng = random.Random(4)
    for _ in range(60):
        t, cos, sin = rational_rotation(rng)
        c2, c3, d3, x, y = (rational_draw(rng, 1, 4) for _ in range(5))
        w = rational_draw(rng, 1, 4), rational_draw(rng)
        # With a factor 0 the equation of that leg is 0 = 0.
        factors = rng.choice([(1, 2), (2, -1), (0, 1), (1, 0), (3, Fraction(1, 2))])
        ends = [(c2 + factors[0] * w[0], factors[0] * w[1]), (c3 + factors[1] * w[0], d3 + factors[1] * w[1])]
        b2, b3 = ((cos * u + sin * v, -sin * u + cos * v) for u, v in ends)
        robot = (b2, b3, c2, c3, d3)
        r = legs_of((x, y, cos, sin), *robot)
        poses = poses_general(*robot, *r, squared=True)
        count, degenerate = count_general(*robot, *r, squared=True)
        along = 2 * (x * w[0] + y * w[1]) / (w[0] ** 2 + w[1] ** 2)
        mirror = along * w[0] - x, along * w[1] - y  # in the line through 0 along w
        for px, py in ((x, y), mirror):
            given = float(px), float(py), 2 * math.atan(t)
            assert min(math.dist(p, given) for p in poses) < 1e-14
        assert count == len(poses)
        assert degenerate or count % 2 == 0


def test_self_motions():
    with pytest.raises(SelfMotion):  # congruent base and platform, equal legs
        count_general((4, 0), (1, 3), 4, 1, 3, 2, 2, 2)
    assert count_general((4, 0), (1, 3), 4, 1, 3, 0, 0, 0) == (1, True)
    with pytest.raises(SelfMotion):  # B1 rests on A2 = A3, the platform turns about it
        count_general((1, 0), (0, 2), 4, 4, 0, 4, 1, 2)


def test_float_inputs_are_exact():
    assert rational(0.1) != fmpq(1, 10)
    exact = count_analytic(1, 0, 1, 3, 1, 1, squared=True)
    rounded = count_analytic(1, 0, 1, math.sqrt(3), 1, 1)
    assert exact.degenerate
    assert not rounded.degenerate


def test_refusals():
    with pytest.raises(ValueError, match="negative"):
        count_analytic(1, 0, 1, -1, 1, 1, squared=True)
    with pytest.raises(ValueError, match="c2"):
        count_analytic(0, 0, 1, 1, 1, 1)
    with pytest.raises(ValueError, match="coincide"):  # legs 1 and 3 are the same leg
        count_general((4, 0), (0, 0), 4.5, 0, 0, 2, 2, 2)
