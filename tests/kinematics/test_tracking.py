"""``jk.track``: one mode along a path, or the fold in which it ends; never another mode."""

import json

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.core.errors import InputError
from jaxkin.kinematics import _following
from jaxkin.kinematics.tracking import track
from jaxkin.mechanisms import five_bar, ppps3, rpr3, tlpm

CUSP = np.array([1.0478913165750139, 1.0, 2.4892071875813455])


def modes_at(robot: jk.Mechanism, joints: np.ndarray) -> np.ndarray:
    found = jk.forward(robot, joints)
    return np.asarray(found.values)[np.asarray(found.valid)]


def circle(centre: np.ndarray, radius: float, begin: float, points: int = 49) -> np.ndarray:
    """Returns a loop in the section rho2 = const."""
    a = np.linspace(0, 2 * np.pi, points) + begin
    return centre + radius * np.stack([np.cos(a), 0 * a, np.sin(a)], axis=1)


def test_tracks_of_all_modes_match_an_independent_solver_at_the_other_end():
    """Two modes never arrive at one, what arrives is a mode, and the ways back from the other modes do not arrive."""
    rng, arrived, folds = np.random.default_rng(5), 0, 0
    geometries = [zoo.EXAMPLE] * 4 + list(zoo.random_analytic(rng, 4)) + list(zoo.random_general(rng, 10))
    for geometry in geometries:
        robot = zoo.build(np.array(geometry))
        path = np.array([np.asarray(jk.inverse(robot, pose).values[0]) for pose in zoo.random_poses(rng, 2)])
        first, last = modes_at(robot, path[0]), modes_at(robot, path[1])
        ends = []
        for pose in first:
            found = track(robot, path, pose)
            assert found.verified
            if found.complete:
                gaps = zoo.glued_distance(last, found.poses[-1])
                assert np.min(gaps) < 1e-9
                ends.append(int(np.argmin(gaps)))
            else:
                folds += 1
                sides = [path[0] + (found.fold + s * 1e-8) * (path[1] - path[0]) for s in (-1, 1)]
                # Nearer to the fold the solver calls its number of modes undecided.
                before, after = (int(jk.forward(robot, q).count) for q in sides)
                # Where a pair of poses is double, as in the analytic family, four modes vanish at once.
                assert before - after in (2, 4)
        assert len(set(ends)) == len(ends)
        for k, pose in enumerate(last):
            assert track(robot, path[::-1], pose).complete == (k in ends)
        arrived += len(ends)
    assert arrived > 20
    assert folds > 10


def test_fold_is_a_double_pose_to_rounding():
    robot = rpr3.analytic(*zoo.EXAMPLE)
    path = circle(CUSP, 0.1, begin=0.5)
    found = track(robot, path, modes_at(robot, path[0])[0])
    assert not found.complete
    assert found.t[-1] == found.fold
    assert "fold at t = " in found.reason
    assert "singular value" in found.reason
    pose, joints = found.poses[-1], found.joints[-1]
    assert abs(float(zoo.direct_determinant(robot, jnp.asarray(pose)))) < 1e-12
    assert np.max(np.abs(robot.constraints(jnp.asarray(pose), jnp.asarray(joints)))) < 1e-13
    assert found.singular_value < 1e-12
    assert "f1" in found.reason or "f2" in found.reason


@pytest.mark.parametrize("radius", [1e-1, 1e-2, 1e-3, 1e-4])
def test_loops_around_a_cusp_meet_the_fold_where_the_count_of_solutions_drops(radius):
    """So near to a cusp three modes lie close together, where steps too long jump to one another."""
    robot = rpr3.analytic(*zoo.EXAMPLE)
    path = circle(CUSP, radius, begin=0.5)
    for pose in modes_at(robot, path[0]):
        found = track(robot, path, pose)
        assert found.verified
        assert not found.complete
        k = int(found.fold)
        joints = [path[k] + (found.fold + s * 1e-6 - k) * (path[k + 1] - path[k]) for s in (-1, 1)]
        assert int(jk.forward(robot, joints[0]).count) > int(jk.forward(robot, joints[1]).count)


def test_small_loop_returns_to_its_start_and_angles_run_on():
    robot = rpr3.reference()
    angle = np.linspace(0, 40 * np.pi, 2001)
    path = np.array(zoo.REFERENCE_JOINTS) + 0.3 * np.stack([np.sin(angle), np.cos(angle) - 1, np.sin(2 * angle)], 1)
    start = zoo.REFERENCE_POSES[5] + [0, 0, 2 * np.pi]
    found = track(robot, path, start)
    assert found.complete
    assert found.verified
    np.testing.assert_allclose(found.poses[-1], start, atol=1e-10)
    assert np.max(np.abs(np.diff(found.poses, axis=0))) < 0.2
    assert np.all(np.isin(np.arange(2001), found.t))


def test_fold_of_a_five_bar_in_closed_form():
    """Two assembly modes meet where the crank ends are as far apart as the rods are long together."""
    robot = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
    start = np.array([1.6, 1.7])
    found = track(robot, [start, np.add(start, [0.0, -1.6])], [3.84576780142, 5.10543169957])

    def gap(theta: float) -> float:
        ends = [8 * np.exp(1.6j), 9 + 8 * np.exp(1j * theta)]
        return abs(ends[0] - ends[1]) - 10

    low, high = 1.7, 0.1
    assert gap(low) < 0 < gap(high)
    for _ in range(60):
        low, high = (0.5 * (low + high), high) if gap(0.5 * (low + high)) < 0 else (low, 0.5 * (low + high))
    assert abs(found.fold - (1.7 - low) / 1.6) < 1e-13


def test_limits_left_and_entered_are_events_that_do_not_stop():
    robot = rpr3.reference().with_limits(rho1=(10.0, 15.5))
    q = np.array(zoo.REFERENCE_JOINTS)
    found = track(robot, [q, np.add(q, [1.0, 0, 0]), q], zoo.REFERENCE_POSES[4])
    assert found.complete
    assert [(e.name, e.kind) for e in found.events] == [("rho1_high", "left"), ("rho1_high", "entered")]
    np.testing.assert_allclose([e.t for e in found.events], [0.52, 1.48], atol=1e-13)
    assert "limit left: rho1_high" in str(found)


def test_a_stretched_leg_is_an_event():
    """Where det B = 0, one rod of the five-bar lies along its crank."""
    robot = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
    pose = np.array([3.0, 10.0])
    joints = np.asarray(jk.inverse(robot, pose).values)
    joints = joints[np.asarray(jk.inverse(robot, pose).valid)]
    seen = 0
    for q in joints:
        for sign in (-1, 1):
            found = track(robot, [q, np.add(q, [1.2 * sign, 0.0])], pose)
            for event in found.events:
                assert event.kind == "serial singularity"
                pivots = np.array([[0.0, 0.0], [9.0, 0.0]])
                crank = 8 * np.stack([np.cos(event.joints), np.sin(event.joints)], axis=1)
                rod = event.pose - pivots - crank
                assert np.min(np.abs(crank[:, 0] * rod[:, 1] - crank[:, 1] * rod[:, 0])) < 1e-9
                seen += 1
    assert seen >= 6


def test_spatial_robots():
    robot = ppps3.create()
    pose = np.array([0.1, 0.2, 0.3, 0.1, 0.2, 0.3])
    q = np.asarray(jk.inverse(robot, pose).values[0])
    found = track(robot, [q, q + np.array([1.0, 3.0, 0, 0, 0, 0])], pose)
    assert found.verified
    assert found.fold is not None
    assert "R33 = 0" in found.reason
    robot = tlpm.create()
    q = np.asarray(jk.inverse(robot, [10.0, 20.0, 200.0]).values[0])
    found = track(robot, [q, q + np.array([-50.0, 30.0, 10.0])], [10.0, 20.0, 200.0])
    lanes = np.asarray(jk.forward(robot, found.joints[-1]).values)
    assert np.min(np.max(np.abs(lanes - found.poses[-1]), axis=1)) < 1e-9


def test_core_maps_over_paths():
    robot = rpr3.reference()
    q = jnp.asarray(zoo.REFERENCE_JOINTS)
    ends = q + 0.2 * jnp.eye(3)
    courses = jax.vmap(lambda end: _following.Course(jnp.stack([q, end, end, end]), jnp.asarray(1.0), jnp.asarray(1.0)))
    start = jnp.asarray(zoo.REFERENCE_POSES[0]) / _following.pose_unit(robot)
    walkers = jax.vmap(lambda course: _following.walk_round(robot, course, _following.started(start)))(courses(ends))
    for k in range(3):
        alone = track(robot, [q, ends[k]], zoo.REFERENCE_POSES[0])
        np.testing.assert_allclose(walkers.pose[k] * _following.pose_unit(robot), alone.poses[-1], atol=1e-11)


def test_start_on_a_fold_and_path_of_one_point():
    robot = rpr3.analytic(*zoo.EXAMPLE)
    start = np.array([1.0, 0.0, np.pi])
    joints = np.asarray(jk.inverse(robot, start).values[0])
    assert abs(float(zoo.direct_determinant(robot, jnp.asarray(start)))) < 1e-12
    found = track(robot, [joints, np.add(joints, [0.1, 0.05, -0.1])], start)
    assert not found.complete
    assert found.t[-1] < 1e-6
    regular = track(robot, [np.add(joints, [0.1, 0.2, 0.0])], modes_at(robot, np.add(joints, [0.1, 0.2, 0.0]))[0])
    assert regular.complete
    assert len(regular) == 1


def test_wrong_input_is_named():
    robot, pose = rpr3.reference(), zoo.REFERENCE_POSES[0]
    q = list(zoo.REFERENCE_JOINTS)
    with pytest.raises(InputError, match=r"jk\.track: the joint path is of shape \(3,\); it must be \(m, 3\)"):
        track(robot, q, pose)
    with pytest.raises(InputError, match="the joint path is no numbers"):
        track(robot, "path", pose)
    with pytest.raises(InputError, match="waypoint 1 is"):
        track(robot, [q, [14.0, float("nan"), 12.0]], pose)
    with pytest.raises(InputError, match=r"no solution at the joints .* residual is 0\.0"):
        track(robot, [q, q], np.add(pose, [0.5, 0, 0]))
    with pytest.raises(InputError, match="the pose has shape"):
        track(robot, [q, q], pose[:2])
    with pytest.raises(InputError, match="is no solution"):
        track(robot, [q, q], [np.nan, 0.0, 0.0])


def test_record():
    robot = rpr3.reference()
    q = np.array(zoo.REFERENCE_JOINTS)
    found = track(robot, [q, q + 0.1], np.round(zoo.REFERENCE_POSES[0], 7))
    text = str(found)
    assert "the mode exists to the end of the path" in text
    assert "smallest clearance" in text
    content = json.loads(found.to_json())
    assert content["fold"] is None
    assert len(content["t"]) == len(found)
    np.testing.assert_allclose(found.poses[0], zoo.REFERENCE_POSES[0], atol=1e-12)
    smallest = jk.conditioning(robot, found.poses[0], q).smallest_singular_value
    np.testing.assert_allclose(found.clearance[0], smallest, rtol=1e-13)
