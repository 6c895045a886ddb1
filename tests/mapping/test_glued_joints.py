"""Sections over glued joint angles: the five-bar's torus, against circle geometry.

The rods are aligned where the crank ends are l3 + l4 or |l3 - l4| apart.
"""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mapping.cusps import _Fact, _grouped
from jaxkin.mapping.section import bind_section
from jaxkin.mechanisms import five_bar

TURN = (-math.pi, math.pi, 200)
TORUS = jk.Grid(theta1=TURN, theta2=TURN)
EQUAL = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
ROBOTS = {
    "equal rods": EQUAL,
    "unequal rods": five_bar.create(5.0, (3.0, 4.0), (6.0, 4.5)),
    "one curve round the torus": five_bar.create(1.0, (3.0, 4.0), (6.0, 4.5)),
    "cranks about one pivot": five_bar.create(0.0, (8.0, 8.0), (5.0, 4.0)),
}
#: Crank ends of the five-bar with equal rods meet here, and P may be anywhere on a circle.
MEETING = np.array([math.acos(4.5 / 8), math.pi - math.acos(4.5 / 8)])


def elbows(robot, joints):
    l1, l2 = np.asarray(robot.proximal)
    a, b = np.asarray(joints).T
    first = np.stack([l1 * np.cos(a), l1 * np.sin(a)], axis=1)
    return first, np.stack([float(robot.base) + l2 * np.cos(b), l2 * np.sin(b)], axis=1)


def span(robot, joints):
    """The distance of the crank ends."""
    first, second = elbows(robot, joints)
    return np.hypot(*(second - first).T)


def reaches(robot):
    l3, l4 = np.asarray(robot.distal)
    return np.array([l3 + l4, abs(l3 - l4)])


@pytest.fixture(scope="module", params=list(ROBOTS))
def traced(request):
    robot = ROBOTS[request.param]
    return robot, jk.singular_curves(robot, TORUS)


def test_the_rods_are_aligned_at_every_point(traced):
    robot, curves = traced
    assert len(curves) > 0
    assert curves.complete
    for curve in curves:
        away = np.abs(span(robot, curve.joints)[:, None] - reaches(robot)).min(axis=0).min()
        assert np.abs(span(robot, curve.joints)[:, None] - reaches(robot)).min(axis=1).max() < 1e-12
        assert away < 1e-12
        first, second = elbows(robot, curve.joints)
        off = np.cross(np.pad(curve.poses - first, ((0, 0), (0, 1))), np.pad(second - first, ((0, 0), (0, 1))))
        assert np.max(np.abs(off)) < 1e-11
        assert curve.residual < 1e-13


def test_the_torus_has_no_border(traced):
    _, curves = traced
    for curve in curves:
        assert curve.closed
        assert curve.ends == ("", "")
        assert np.all((curve.joints >= -np.pi) & (curve.joints < np.pi))
        around = np.vstack([curve.joints, curve.joints[:1]])
        steps = (np.diff(around, axis=0) + np.pi) % (2 * np.pi) - np.pi
        assert np.max(np.abs(steps)) < 0.2
        # Once round, or not at all: the steps add up to whole turns.
        turns = steps.sum(axis=0) / (2 * np.pi)
        np.testing.assert_allclose(turns, np.round(turns), atol=1e-12)
    assert curves.evidence["ends on borders: traced, found by a search of their own"] == [0, 0]


def test_every_meridian_is_crossed_as_often_as_the_circles_say(traced):
    robot, curves = traced
    l1, l2, base = float(robot.proximal[0]), float(robot.proximal[1]), float(robot.base)
    for theta1 in np.linspace(-3.1, 3.1, 41):
        r = np.hypot(l1 * np.cos(theta1) - base, l1 * np.sin(theta1))
        expected = 0
        for reach in reaches(robot):
            cosine = (r**2 + l2**2 - reach**2) / (2 * r * l2) if reach > 0 else 2.0
            expected += 2 * (abs(cosine) < 1)
        found = 0
        for curve in curves:
            away = (np.append(curve.joints[:, 0], curve.joints[0, 0]) - theta1 + np.pi) % (2 * np.pi) - np.pi
            found += int(np.sum((away[:-1] * away[1:] < 0) & (np.abs(away[1:] - away[:-1]) < 1)))
        assert found == expected, theta1


def test_curves_do_not_depend_on_where_the_turn_begins():
    curve = jk.singular_curves(EQUAL, TORUS)[0]
    other = jk.singular_curves(EQUAL, jk.Grid(theta1=(0.0, 2 * math.pi, 200), theta2=TURN))
    assert len(other) == 1
    assert other[0].closed
    assert np.min(other[0].joints[:, 0]) >= 0
    assert np.max(other[0].joints[:, 0]) < 2 * math.pi
    assert np.max(np.abs(span(EQUAL, other[0].joints) - 10)) < 1e-12

    def length(c):
        steps = (np.diff(np.vstack([c.joints, c.joints[:1]]), axis=0) + np.pi) % (2 * np.pi) - np.pi
        return np.sum(np.hypot(*steps.T))

    assert length(other[0]) == pytest.approx(length(curve), rel=1e-3)


def test_a_range_over_the_seam_has_borders_at_its_own_ends():
    curves = jk.singular_curves(EQUAL, jk.Grid(theta1=(2.0, 4.0, 200), theta2=(2.0, 4.0, 200)))
    assert sorted(end for curve in curves for end in curve.ends) == [
        "theta1 = 2", "theta1 = 4", "theta2 = 2", "theta2 = 4",
    ]  # fmt: skip
    for curve in curves:
        assert np.all((curve.joints >= 2.0) & (curve.joints <= 4.0))
        assert np.max(np.abs(span(EQUAL, curve.joints) - 10)) < 1e-12
        assert curve.joints[0].tolist().count(2.0) + curve.joints[0].tolist().count(4.0) == 1


def test_limits_cut_a_turn():
    robot = EQUAL.with_limits(theta1=(-1.0, 2.5))
    curves = jk.singular_curves(robot, TORUS)
    assert {end for curve in curves for end in curve.ends} == {"theta1 = -1", "theta1 = 2.5"}
    # A turn from 0 on meets the limits in 0 .. 2.5 and in 2 pi - 1 .. 2 pi.
    with pytest.raises(jk.InputError, match=r"jk\.singular_curves: theta1 .*-1 to 2\.5 cut in two"):
        jk.singular_curves(robot, jk.Grid(theta1=(0.0, 2 * math.pi, 200), theta2=TURN))
    with pytest.raises(jk.InputError, match=r"theta1 goes from 3 to 4, outside its limits -1 to 2\.5"):
        jk.singular_curves(robot, jk.Grid(theta1=(3.0, 4.0, 200), theta2=TURN))


def test_more_than_a_turn_is_refused():
    with pytest.raises(
        jk.InputError, match=r"theta1 goes from -4 to 4, farther than its period 6\.28319: give one turn"
    ):
        jk.singular_curves(EQUAL, jk.Grid(theta1=(-4.0, 4.0, 200), theta2=TURN))


def test_self_motions_are_told_apart_from_curves():
    curves = jk.singular_curves(EQUAL, TORUS)
    assert len(curves) == 1
    assert len(curves.self_motions) == 2
    found = sorted((motion.joints[0] for motion in curves.self_motions), key=lambda q: q[0])
    np.testing.assert_allclose(found, [-MEETING, MEETING], atol=1e-14)
    for motion in curves.self_motions:
        assert motion.closed
        np.testing.assert_allclose(motion.joints, np.tile(motion.joints[0], (len(motion), 1)), atol=1e-14)
        first, _ = elbows(EQUAL, motion.joints)
        away = motion.poses - first
        np.testing.assert_allclose(np.hypot(*away.T), 5.0, rtol=1e-14)
        angles = np.sort(np.arctan2(away[:, 1], away[:, 0]))
        assert np.max(np.diff(angles)) < 0.2
    assert "self-motion at theta1 = 0.97338991014954" in str(curves)
    assert '"self_motions"' in curves.to_json()
    cusps = jk.cusps(EQUAL, TORUS)
    assert len(cusps) == 0
    others = sorted((other.joints for other in cusps.others if other.kind == "self-motion"), key=lambda q: q[0])
    np.testing.assert_allclose(others, [-MEETING, MEETING], atol=1e-14)


@pytest.mark.parametrize("proximal", [(8.0, 8.0), (8.0, 7.0)])
def test_a_whole_curve_of_self_motions_or_double_points_is_refused(proximal):
    """Cranks about one pivot: equal ones meet at all theta1 = theta2; or are never nearer than the rods' difference."""
    robot = five_bar.create(0.0, proximal, (5.0, 5.0 if proximal[1] == 8.0 else 4.0))
    with pytest.raises(jk.GeometryError, match=r"jk\.singular_curves: .*whole curve of self-motions.*a little"):
        jk.singular_curves(robot, TORUS)


@jk.mechanism
class SeamCusp(jk.Mechanism):
    """x^3 + sin(t) x = q with y = -1 or 1: cusps at t = 0 and at the seam t = pi, each of two poses."""

    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.angle("t"), jk.Axis("q", "length"))
    size: jax.Array

    def constraints(self, pose, joints):
        (x, y), (t, q) = pose, joints
        return jnp.stack([x**3 + jnp.sin(t) * x - q * self.size, y**2 - 1])


def test_poses_on_both_sides_of_the_seam_are_over_one_cusp():
    bound = bind_section("test", EQUAL, TORUS)
    side = [[math.pi - 1e-11, 0.3], [-math.pi + 1e-11, 0.3], [3.0, 0.3], [3.0, -math.pi], [3.0, math.pi - 1e-12]]
    facts = [_Fact(np.array(q), np.array([k, 0.0]), 0.0, 1e-15, 1.0, 0.0, 1.0, 1.0) for k, q in enumerate(side)]
    grouped = _grouped(bound, facts, [], {})
    assert sorted(sorted(poses[:, 0].tolist()) for poses in grouped.poses) == [[0.0, 1.0], [2.0], [3.0, 4.0]]


@pytest.mark.slow
def test_cusps_at_the_seam_are_grouped_over_it():
    cusps = jk.cusps(SeamCusp(size=jnp.asarray(1.0)), jk.Grid(t=TURN, q=(-1.0, 1.0, 200)))
    assert len(cusps) == 2
    assert [len(poses) for poses in cusps.poses] == [2, 2]
    turn = np.sort(np.abs(cusps.joints[:, 0]))
    np.testing.assert_allclose(turn, [0.0, math.pi], atol=1e-9)
    np.testing.assert_allclose(cusps.joints[:, 1], 0.0, atol=1e-12)
    assert np.max(cusps.error) < 1e-6
