"""``jk.mode_change``: paths between assembly modes that meet no singularity, and pairs that no path joins."""

import functools
import itertools
import json

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.core.errors import InputError
from jaxkin.mapping._mode_change_loops import Undecided, _number, encircled
from jaxkin.mapping._mode_change_records import ModeChange
from jaxkin.mapping.cusp_curves import CuspCurve
from jaxkin.mapping.mode_change import mode_change as _mode_change
from jaxkin.mechanisms import five_bar, ppps3, rpr3, tlpm

JOINTS = np.array(zoo.REFERENCE_JOINTS)
#: Cusp curves take longer to find than paths.
mode_change = functools.partial(_mode_change, encircle=False)


def modes_at(robot: jk.Mechanism, joints: np.ndarray) -> np.ndarray:
    found = jk.forward(robot, joints)
    return np.asarray(found.values)[np.asarray(found.valid)]


@jax.jit
def _determinants(robot: jk.Mechanism, poses: jax.Array) -> jax.Array:
    return jax.vmap(lambda pose: zoo.direct_determinant(robot, pose))(poses)  # type: ignore[arg-type]


def assert_holds(robot: rpr3.GeneralRPR3 | rpr3.AnalyticRPR3, change: ModeChange, start: np.ndarray, goal: np.ndarray):
    """Checks a path without the code that made it: closed loop, equations, ends, one sign of det A in between."""
    assert change.found
    assert change.verified
    length = float(robot.characteristic_length())
    assert zoo.glued_distance(change.poses[0], start, length) < 1e-9
    assert zoo.glued_distance(change.poses[-1], goal, length) < 1e-9
    np.testing.assert_allclose(change.joints[-1], change.joints[0], atol=1e-9)
    points = map(robot.outline, change.poses[::16])
    legs = [np.linalg.norm(platform - base, axis=1) for base, platform in points]
    np.testing.assert_allclose(change.joints[::16], legs, atol=1e-9 * length)
    between = np.linspace(change.poses[:-1], change.poses[1:], 9).reshape(-1, 3)
    signs = np.sign(np.asarray(_determinants(robot, jnp.asarray(between))))
    assert np.all(signs == signs[0])
    assert 0 < change.clearance <= np.min(change.clearances) * (1 + 1e-12)
    assert np.max(np.abs(np.diff(change.poses, axis=0))) < 0.2 * max(length, 1.0)


def test_known_path_of_the_reference_robot():
    """A non-singular path joins these two modes (Innocenti and Parenti-Castelli 1998)."""
    robot = rpr3.reference()
    start, goal = zoo.REFERENCE_POSES[5], np.add(zoo.REFERENCE_POSES[1], [0, 0, 2 * np.pi])
    change = mode_change(robot, JOINTS, start, goal)
    assert_holds(robot, change, start, goal)
    assert change.clearance > 0.2  # A lattice of 90 points an axis has no path wider than 0.30.
    assert change.aspects == ("det > 0", "det > 0")
    assert change.encircled == ()
    assert change.linking is None
    assert "cusp curves: not looked for" in str(change)
    content = json.loads(change.to_json())
    assert content["found"] is True
    assert len(content["poses"]) == len(change.poses)


def test_pairs_of_the_reference_robot_by_the_sign_of_the_determinant():
    """Two aspects of three modes each (Coste 2012)."""
    robot, signs = rpr3.reference(), np.sign(zoo.REFERENCE_DETERMINANTS)
    for i, j in itertools.combinations(range(6), 2):
        if signs[i] != signs[j]:
            change = mode_change(robot, JOINTS, zoo.REFERENCE_POSES[i], zoo.REFERENCE_POSES[j])
            assert not change.found
            assert change.certain
            assert change.reason.startswith("not in the same aspect: start has det ")
            assert change.aspects[0] != change.aspects[1]
            assert len(change.poses) == 0
    for i, j in ((0, 4), (1, 2)):
        change = mode_change(robot, JOINTS, zoo.REFERENCE_POSES[i], zoo.REFERENCE_POSES[j])
        assert_holds(robot, change, zoo.REFERENCE_POSES[i], zoo.REFERENCE_POSES[j])


@pytest.mark.parametrize("joints", [(1.2, 1.0, 1.5), (3.0, 3.0, 3.2)])
def test_analytic_robot_with_two_aspects(joints):
    """In the analytic family each aspect is connected: all modes of one sign are joined.

    Its singular surfaces cross along a curve, across which det A keeps its sign: a search that looks at signs alone
    goes through it. The legs of the second case are long, and its modes close to that curve.
    """
    robot = rpr3.analytic(*zoo.EXAMPLE)
    modes = modes_at(robot, np.array(joints))
    signs = np.sign(np.asarray(_determinants(robot, jnp.asarray(modes))))
    assert sorted(signs) == [-1] * 3 + [1] * 3
    i, *others = np.flatnonzero(signs < 0)
    for j in others:
        assert_holds(robot, mode_change(robot, joints, modes[i], modes[j]), modes[i], modes[j])


def test_robots_without_a_mode_change():
    robot = ppps3.create()
    q = np.asarray(jk.inverse(robot, [0.1, 0.2, 0.3, 0.1, 0.2, 0.3]).values[0])
    modes = modes_at(robot, q)
    assert len(modes) == 4
    for start, goal in itertools.combinations(modes, 2):
        change = mode_change(robot, q, start, goal)
        assert change.certain
        assert not change.found
        assert "R22" in change.reason
    for robot, q in (
        (tlpm.create(), [17.8, 60.6, 168.3]),
        (five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0)), [1.6, 1.7]),
    ):
        start, goal = modes_at(robot, np.array(q))
        change = mode_change(robot, q, start, goal)
        assert change.certain
        assert not change.found
        assert "not in the same aspect" in str(change)


def test_working_modes_of_start_and_goal_are_named():
    robot = five_bar.create(9.0, (3.0, 3.0), (7.0, 7.0))
    start, goal = modes_at(robot, np.array([1.0, 2.0]))
    change = mode_change(robot, [1.0, 2.0], start, goal)
    assert change.certain
    assert "start is in working mode (+, -) det < 0, goal in (-, -) det > 0" in change.reason


def test_limits_hold_along_the_path():
    free, start, goal = rpr3.reference(), zoo.REFERENCE_POSES[5], zoo.REFERENCE_POSES[1]
    widest = mode_change(free, JOINTS, start, goal)
    assert np.min(widest.joints[:, 0]) < 2.0
    robot = free.with_limits(rho1=(2.5, 14.98), rho2=(3.0, 16.0))
    change = mode_change(robot, JOINTS, start, goal)
    assert_holds(robot, change, start, goal)  # type: ignore[arg-type]
    assert np.min(change.joints[:, 0]) >= 2.5
    assert np.max(change.joints[:, 0]) <= 14.98 + 1e-12
    assert np.min(change.joints[:, 1]) >= 3.0
    beyond = mode_change(free.with_limits(rho1=(0.0, 14.0)), JOINTS, start, goal)
    assert not beyond.found
    assert "start lies in no aspect: its margin rho1_high is -0.98" in beyond.reason


@pytest.mark.slow
def test_narrow_limits_separate_modes_and_that_is_no_proof():
    robot = rpr3.reference().with_limits(rho1=(14.0, 16.0), rho2=(14.5, 16.5), rho3=(11.0, 13.0))
    grid = jk.Grid(x=(-25, 25, 64), y=(-25, 25, 64), phi=(-np.pi, np.pi, 64))
    change = mode_change(robot, JOINTS, zoo.REFERENCE_POSES[5], zoo.REFERENCE_POSES[1], grid)
    assert not change.found
    assert not change.certain
    assert "jk.aspects finds det > 0 #" in change.reason
    assert change.searched["x"] == [-25.0, 25.0, 64]
    assert "no proof" in str(change)


def test_one_pose_is_no_change():
    robot, pose = rpr3.reference(), zoo.REFERENCE_POSES[2]
    change = mode_change(robot, JOINTS, pose, np.add(pose, [0, 0, 2 * np.pi]))
    assert change.found
    assert "one pose" in change.reason
    assert change.clearance == pytest.approx(float(jk.conditioning(robot, pose, JOINTS).smallest_singular_value))


def test_wrong_input_is_named():
    robot, start, goal = rpr3.reference(), zoo.REFERENCE_POSES[5], zoo.REFERENCE_POSES[1]
    with pytest.raises(InputError, match=r"jk\.mode_change: the goal .* is no solution .* residual is 0\."):
        mode_change(robot, JOINTS, start, np.add(goal, [0.5, 0, 0]))
    with pytest.raises(InputError, match="the start has shape"):
        mode_change(robot, JOINTS, start[:2], goal)
    with pytest.raises(InputError, match="the joints are"):
        mode_change(robot, [np.nan, 1.0, 1.0], start, goal)
    with pytest.raises(InputError, match=r"goal has x = -5\.49.*outside the grid, which is from 0 to 20"):
        mode_change(robot, JOINTS, start, goal, jk.Grid(x=(0, 20, 20), y=(-20, 20, 20), phi=(-4, 4, 20)))
    with pytest.raises(InputError, match=r"outside the grid, which is fixed at 1"):
        mode_change(robot, JOINTS, start, goal, jk.Grid(x=(-20, 20, 20), y=(-20, 20, 20), phi=1.0))
    analytic, pose = rpr3.analytic(*zoo.EXAMPLE), np.array([1.0, 0.0, np.pi])
    joints = np.asarray(jk.inverse(analytic, pose).values[0])
    with pytest.raises(InputError, match=r"start .* is singular"):
        mode_change(analytic, joints, pose, pose)


def _curve(joints: np.ndarray, *, closed: bool) -> CuspCurve:
    nothing = np.zeros((len(joints), 3))
    return CuspCurve("curve", joints, nothing, closed, 0.0, ("", ""), "", nothing.astype(bool))


def test_linking_of_loops_with_curves_of_every_kind():
    a = np.linspace(0, 2 * np.pi, 101)
    loop = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    loop[-1] = loop[0]
    low, high = np.full(3, -2.0), np.full(3, 2.0)
    ring = np.stack([1 + 0.5 * np.cos(a), 0 * a, 0.5 * np.sin(a)], axis=1)[:-1]
    assert abs(_number(loop, _curve(ring, closed=True), low, high)) == 1
    assert _number(loop, _curve(np.add(ring, [0, 0, 0.9]), closed=True), low, high) == 0
    line = np.stack([0 * a + 0.2, 0 * a + 0.1, np.linspace(-2, 2, 101)], axis=1)
    assert _number(loop, _curve(line, closed=False), low, high) == 1
    assert _number(loop, _curve(line[::-1], closed=False), low, high) == -1
    assert _number(loop, _curve(np.add(line, [1.5, 0, 0]), closed=False), low, high) == 0
    assert _number(loop, _curve(line[:80], closed=False), low, high) is None  # Ends inside.
    assert _number(loop, _curve(np.add(line, [0.799, -0.1, 0]), closed=False), low, high) is None  # Too near.


def test_loops_of_which_nothing_can_be_said():
    with pytest.raises(Undecided, match="with 6 joints"):
        encircled(ppps3.create(), np.zeros((4, 6)))
    robot = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
    with pytest.raises(Undecided, match="runs around a glued joint"):
        encircled(robot, np.array([[0.0, 0.0], [3.0, 0.1], [2 * np.pi, 0.0]]))
    with pytest.raises(Undecided, match="over the seam"):
        encircled(robot, np.array([[3.0, 0.0], [3.3, 0.1], [3.0, 0.0]]))


@pytest.mark.slow
def test_loop_of_the_reference_robot_encircles_cusp_curves():
    """A loop once around two cusp curves; the same loop run backwards has the opposite numbers."""
    robot, start, goal = rpr3.reference(), zoo.REFERENCE_POSES[5], zoo.REFERENCE_POSES[1]
    change = mode_change(robot, JOINTS, start, goal, encircle=True)
    assert_holds(robot, change, start, goal)
    assert change.linking is not None
    assert set(change.encircled) == {name for name, number in change.linking.items() if number}
    assert "encircles: " in str(change)
    assert change.cusp_curves is not None
    assert {curve.name for curve in change.cusp_curves} == set(change.linking)
    back = encircled(robot, change.joints[::-1]).linking
    assert {name: -number for name, number in back.items() if number is not None} == {
        name: number for name, number in change.linking.items() if number is not None
    }


@jk.mechanism
class CoupledLegs(jk.Mechanism):
    """The analytic 3-RPR with legs driven through a linear transmission: equations hold two joints."""

    id = "coupled-legs"
    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"), jk.angle("phi"))
    joint_axes = (jk.Axis("u", "length"), jk.Axis("v", "length"), jk.Axis("w", "length"))
    c2: jax.Array

    def constraints(self, pose, joints):
        u, v, w = joints
        return rpr3.analytic(*zoo.EXAMPLE).constraints(pose, jnp.stack([u, v + 0.2 * u, w - 0.1 * v]))

    def characteristic_length(self):
        return self.c2


@pytest.mark.slow
def test_robot_whose_working_modes_are_no_sign_vectors():
    robot, plain = CoupledLegs(c2=jnp.asarray(1.0)), rpr3.analytic(*zoo.EXAMPLE)
    legs = np.array([1.2, 1.0, 1.5])
    v = legs[1] - 0.2 * legs[0]
    joints = np.array([legs[0], v, legs[2] + 0.1 * v])
    modes = modes_at(plain, legs)
    change = mode_change(robot, joints, modes[2], modes[5])
    assert change.found
    assert change.verified
    assert change.aspects[0] == "det B < 0, det > 0"
    signs = np.sign(np.asarray(_determinants(plain, jnp.asarray(change.poses))))
    assert np.all(signs == signs[0])
    np.testing.assert_allclose(change.joints[-1], change.joints[0], atol=1e-9)
