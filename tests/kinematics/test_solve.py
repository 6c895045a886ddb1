"""Laws of inverse and forward kinematics over thousands of robots, and the statuses of what cannot be solved."""

import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mechanisms import rpr3

SIZE = 1500
SAMPLERS = {"analytic": zoo.random_analytic, "general": zoo.random_general}
FAMILIES = pytest.mark.parametrize("family", SAMPLERS)


def random_problem(family, seed):
    """Returns geometries, poses and the joints of the poses."""
    rng = np.random.default_rng(seed)
    geometry, poses = SAMPLERS[family](rng, SIZE), zoo.random_poses(rng, SIZE)
    return geometry, poses, zoo.legs(zoo.build(geometry), poses)


def solve(geometry, joints):
    return zoo.forward_batch(zoo.build(geometry), jnp.asarray(joints))


# --- laws ---


@FAMILIES
def test_forward_after_inverse_gives_the_pose_back(family):
    geometry, poses, joints = random_problem(family, 0)
    robots = zoo.build(geometry)
    measures = zoo.conditioning_batch(robots, jnp.asarray(poses), jnp.asarray(joints))
    regular = np.asarray(measures.smallest_singular_value) > 1e-3
    assert regular.mean() > 0.9
    lengths = np.asarray(robots.characteristic_length())
    assert zoo.nearest(solve(geometry, joints).values, poses, lengths)[regular].max() < 1e-9


@FAMILIES
def test_inverse_after_forward_gives_the_joints_back(family):
    geometry, _, joints = random_problem(family, 1)
    branches = solve(geometry, joints)
    back = jax.jit(jax.vmap(jax.vmap(jk.inverse, (None, 0))))(zoo.build(geometry), branches.values)
    legs, valid = np.asarray(back.values[:, :, 0]), np.asarray(branches.valid)
    np.testing.assert_array_equal(np.asarray(back.valid[..., 0]), valid)
    squares = np.abs(legs**2 - joints[:, None] ** 2)
    assert squares[valid].max() < 1e-11


@FAMILIES
def test_every_lane_keeps_its_promises(family):
    geometry, _, joints = random_problem(family, 2)
    robots, branches = zoo.build(geometry), solve(geometry, joints)
    values, valid, status = (np.asarray(a) for a in (branches.values, branches.valid, branches.status))
    residual, multiplicity = np.asarray(branches.residual), np.asarray(branches.multiplicity)

    def measured(robot, pose, joints):
        return jnp.max(jnp.abs(robot.constraints(pose, joints)) / robot.constraint_scales(pose, joints))

    again = jax.jit(jax.vmap(jax.vmap(measured, (None, 0, None))))(robots, branches.values, jnp.asarray(joints))
    assert np.asarray(again)[valid].max() <= 2e-12
    assert residual[valid].max() <= 1e-12
    assert np.isnan(residual[~valid]).all()
    assert np.isnan(values[~valid]).all()
    assert np.all(multiplicity[~valid] == 0)
    assert np.all(multiplicity[valid] >= 1)
    assert np.all(status[~valid] == jk.Status.NO_REAL_SOLUTION)
    assert np.all((values[valid][:, 2] >= -np.pi) & (values[valid][:, 2] < np.pi))


@FAMILIES
def test_generic_counts_are_even(family):
    geometry, _, joints = random_problem(family, 3)
    branches = solve(geometry, joints)
    generic = ~np.any(np.asarray(branches.status) == jk.Status.SINGULAR, axis=1)
    count = np.asarray(branches.count)[generic]
    assert generic.mean() > 0.99
    assert set(count) <= {2, 4, 6}


@FAMILIES
def test_lanes_are_ordered(family):
    geometry, _, joints = random_problem(family, 4)
    branches = solve(geometry, joints)
    valid, phi = np.asarray(branches.valid), np.asarray(branches.values[..., 2])
    assert not np.any(valid[:, 1:] & ~valid[:, :-1])
    both = valid[:, 1:] & valid[:, :-1]
    assert np.all(np.diff(phi, axis=1)[both] >= 0)


@FAMILIES
@pytest.mark.parametrize("factor", [1e-6, 2.0**-20, 3.7, 1e6])
def test_scaling_all_lengths_scales_the_poses(family, factor):
    geometry, _, joints = random_problem(family, 5)
    scaled = geometry.copy()
    scaled[:, : 3 if family == "analytic" else 5] *= factor
    branches, bigger = solve(geometry, joints), solve(scaled, factor * joints)
    np.testing.assert_array_equal(bigger.count, branches.count)
    np.testing.assert_array_equal(bigger.status, branches.status)
    gaps = zoo.glued_distance(np.asarray(bigger.values), np.asarray(branches.values) * [factor, factor, 1], factor)
    assert np.nanmax(gaps) < 1e-6
    assert np.nanquantile(gaps, 0.99) < 1e-11


def assert_poses_map(first, second, move):
    """Asserts that the poses of the second branches are those of the first, moved; samples on leading axes."""
    np.testing.assert_array_equal(second.count, first.count)
    valid = np.asarray(first.valid)
    moved = np.where(valid[..., None], move(np.asarray(first.values)), np.nan)
    worst = np.max([zoo.nearest(second.values, moved[:, k]) for k in range(6)], axis=0, where=valid.T, initial=0)
    assert worst.max() < 1e-6
    assert np.quantile(worst, 0.99) < 1e-10


def column(values):
    """Makes numbers of a robot broadcast against its lanes."""
    return np.asarray(values)[:, None]


@FAMILIES
def test_mirror_image(family):
    geometry, _, joints = random_problem(family, 6)
    mirrored = geometry * ([1, 1, -1] if family == "analytic" else [1, 1, -1, 1, 1, -1])
    assert_poses_map(solve(geometry, joints), solve(mirrored, joints), lambda pose: pose * [1, -1, -1])


@FAMILIES
def test_half_turn_of_the_base(family):
    geometry, _, joints = random_problem(family, 7)
    if family == "analytic":
        # The platform, being the mirrored base, turns in its own frame as well.
        turned, turn = -geometry, 0.0
    else:
        turned, turn = geometry * [-1, -1, -1, 1, 1, 1], np.pi
    assert_poses_map(solve(geometry, joints), solve(turned, joints), lambda pose: pose * [-1, -1, 1] + [0, 0, turn])


def test_relabelling_legs_2_and_3():
    geometry, _, joints = random_problem("general", 8)
    c2, c3, d3, l2, l3, beta = geometry.T
    tilt = np.arctan2(d3, c3)
    other = np.stack([np.hypot(c3, d3), c2 * np.cos(tilt), -c2 * np.sin(tilt), l3, l2, -beta], axis=1)

    def move(pose):
        x, y, phi = np.moveaxis(pose, -1, 0)
        cos, sin = np.cos(column(tilt)), np.sin(column(tilt))
        return np.stack([x * cos + y * sin, y * cos - x * sin, phi + column(beta - tilt)], axis=-1)

    assert_poses_map(solve(geometry, joints), solve(other, joints[:, [0, 2, 1]]), move)


def test_relabelling_legs_1_and_2():
    geometry, _, joints = random_problem("general", 9)
    c2, c3, d3, l2, l3, beta = geometry.T
    # Seen from A2 and B2, both x axes turned by pi.
    x, y = l2 - l3 * np.cos(beta), -l3 * np.sin(beta)
    other = np.stack([c2, c2 - c3, -d3, l2, np.hypot(x, y), np.arctan2(y, x)], axis=1)

    def move(pose):
        x, y, phi = np.moveaxis(pose, -1, 0)
        return np.stack([column(c2) - x - column(l2) * np.cos(phi), -y - column(l2) * np.sin(phi), phi], axis=-1)

    assert_poses_map(solve(geometry, joints), solve(other, joints[:, [1, 0, 2]]), move)


def test_inverse_is_the_distance_of_the_joints():
    robot = rpr3.general(2.0, 0.5, 1.5, 1.0, 1.2, 0.6)
    branches = jk.inverse(robot, (0.3, -0.4, 1.1))
    base, platform = robot.outline((0.3, -0.4, 1.1))
    np.testing.assert_allclose(branches.values[0], np.linalg.norm(platform - base, axis=1), rtol=1e-15)
    assert [int(s) for s in branches.status] == [jk.Status.OK]
    assert int(branches.count) == 1


def test_a_leg_of_zero_length_is_a_serial_singularity():
    branches = jk.inverse(rpr3.analytic(1.0, 0.0, 1.0), (0.0, 0.0, 0.7))
    assert int(branches.status[0]) == jk.Status.SINGULAR
    assert float(branches.values[0, 0]) == 0.0


# --- statuses ---


def statuses(branches):
    return {jk.Status(int(code)) for code in np.asarray(branches.status)}


ROBOTS = {"analytic": lambda **kw: rpr3.analytic(1.0, 0.0, 1.0, **kw), "general": rpr3.reference}
ROBOT = pytest.mark.parametrize("make", ROBOTS.values(), ids=ROBOTS)


def assert_empty(branches, status):
    assert statuses(branches) == {status}
    assert int(branches.count) == 0
    assert np.isnan(branches.values).all()
    assert np.isnan(branches.residual).all()
    assert not np.asarray(branches.multiplicity).any()


@ROBOT
def test_a_negative_length_is_outside(make):
    assert_empty(jk.forward(make(), (1.2, -1.0, 1.1)), jk.Status.OUTSIDE_LIMITS)


@ROBOT
def test_limits_are_inclusive_and_honoured_both_ways(make):
    robot = make()
    joints = np.array([1.2, 1.0, 1.1]) if robot.id == "rpr3-analytic" else np.array(zoo.REFERENCE_JOINTS)
    inside = make(limits=jk.Limits(jnp.asarray(joints), jnp.asarray(joints)))
    assert int(jk.forward(inside, joints).count) == int(jk.forward(robot, joints).count) == 6
    for leg in range(3):
        high = jnp.asarray(np.where(np.arange(3) == leg, 0.99 * joints, np.inf))
        limited = make(limits=jk.Limits(jnp.zeros(3), high))
        assert_empty(jk.forward(limited, joints), jk.Status.OUTSIDE_LIMITS)
        pose = jk.forward(robot, joints).values[0]
        assert_empty(jk.inverse(limited, pose), jk.Status.OUTSIDE_LIMITS)
        assert int(jk.inverse(robot, pose).count) == 1
        assert float(jk.margins(limited, pose, joints)[f"rho{leg + 1}_high"]) == pytest.approx(-0.01 * joints[leg])


@ROBOT
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_input_that_is_not_finite(make, bad):
    for position in range(3):
        given = np.where(np.arange(3) == position, bad, 1.0)
        assert_empty(jk.forward(make(), given), jk.Status.INVALID_INPUT)
        assert_empty(jk.inverse(make(), given), jk.Status.INVALID_INPUT)


def test_a_record_made_past_the_constructor():
    limits = jk.Limits.lengths(3)
    robots = [rpr3.AnalyticRPR3(jnp.asarray(c2), jnp.zeros(()), jnp.ones(()), limits) for c2 in (0.0, np.nan, np.inf)]
    # The second robot's legs 1 and 2 share both joints.
    for number in ((np.nan, 0.0, 1.0, 1.0, 1.0, 0.5), (0.0, 1.0, 1.0, 0.0, 1.0, 0.3)):
        robots.append(rpr3.GeneralRPR3(*map(jnp.asarray, number), limits))
    for robot in robots:
        assert_empty(jk.forward(robot, (1.0, 1.2, 1.1)), jk.Status.INVALID_GEOMETRY)
        assert_empty(jk.inverse(robot, (1.0, 1.2, 0.3)), jk.Status.INVALID_GEOMETRY)


def test_one_bad_robot_does_not_spoil_its_batch():
    geometry, _, joints = random_problem("analytic", 10)
    wanted = solve(geometry, joints)
    geometry[3, 0], geometry[5, 2], joints[7, 1] = 0.0, np.nan, np.inf
    columns = [jnp.asarray(c) for c in geometry.T]
    low, high = jnp.zeros((SIZE, 3)), jnp.full((SIZE, 3), jnp.inf)
    found = zoo.forward_batch(rpr3.AnalyticRPR3(*columns, jk.Limits(low, high)), jnp.asarray(joints))
    assert set(np.asarray(found.status)[[3, 5]].ravel()) == {jk.Status.INVALID_GEOMETRY}
    assert set(np.asarray(found.status)[7]) == {jk.Status.INVALID_INPUT}
    good = np.setdiff1d(np.arange(SIZE), [3, 5, 7])
    np.testing.assert_array_equal(np.asarray(found.values)[good], np.asarray(wanted.values)[good])


# --- refusals ---


@pytest.mark.parametrize("call", [jk.forward, jk.inverse], ids=["forward", "inverse"])
def test_a_batch_is_told_of_vmap(call):
    with pytest.raises(jk.InputError, match=r"shape \(5, 3\).*jax\.vmap") as error:
        call(rpr3.reference(), np.ones((5, 3)))
    assert isinstance(error.value, ValueError)
    assert f"jk.{call.__name__}" in str(error.value)


@pytest.mark.parametrize("bad", [(1.0, 2.0), (1.0, 2.0, 3.0, 4.0), 1.0])
def test_the_wrong_number_of_joints(bad):
    with pytest.raises(jk.InputError, match=r"rho1, rho2, rho3"):
        jk.forward(rpr3.reference(), bad)


def test_a_text_is_no_pose():
    with pytest.raises(jk.InputError, match="3 numbers"):
        jk.inverse(rpr3.reference(), ("here", 0.0, 0.0))


@pytest.mark.parametrize("bad", [None, 3.0, (1.0, 0.0, 1.0), "rpr3"])
def test_what_is_no_mechanism(bad):
    with pytest.raises(jk.InputError, match=f"{type(bad).__name__}.*jaxkin.Mechanism"):
        jk.forward(bad, (1.0, 1.0, 1.0))


def test_float32_is_refused_with_the_remedy():
    code = """
import jaxkin as jk
from jaxkin.mechanisms import rpr3
robot = rpr3.analytic(1.0, 0.0, 1.0)
for call in (jk.forward, jk.inverse):
    try:
        call(robot, (1.0, 1.0, 1.0))
    except jk.PrecisionError as error:
        assert isinstance(error, RuntimeError)
        print(error)
jk.enable_x64()
print(jk.forward(rpr3.analytic(1.0, 0.0, 1.0), (1.2, 1.0, 1.1)).values.dtype)
"""
    root = Path(jk.__file__).parents[1]
    result = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    lines = result.stdout.splitlines()
    assert lines[-1] == "float64"
    assert len(lines) == 3
    assert all("jaxkin.enable_x64()" in line for line in lines[:2])


# --- the generic search ---


def test_search_finds_both_poses_of_two_sliders():
    robot = zoo.TwoSliders(jnp.asarray(1.5), jnp.asarray(1.2))
    branches = jk.forward(robot, (-0.4, 0.7))
    poses = np.asarray(branches.values)[np.asarray(branches.valid)]
    x = (1.5**2 - 1.2**2 + 0.7**2 - 0.4**2) / (2 * 1.1)
    y = np.sqrt(1.5**2 - (x + 0.4) ** 2)
    np.testing.assert_allclose(poses, [[x, -y], [x, y]], atol=1e-12)
    assert statuses(branches) == {jk.Status.COMPLETENESS_UNKNOWN}
    assert np.nanmax(branches.residual) <= 1e-12


def test_search_finds_all_working_modes():
    robot = zoo.TwoSliders(jnp.asarray(1.5), jnp.asarray(1.2))
    found = np.asarray(jk.inverse(robot, (0.2, 0.9)).values)
    reach = [np.sqrt(1.5**2 - 0.81), np.sqrt(1.2**2 - 0.81)]
    wanted = {(round(0.2 + i * reach[0], 9), round(0.2 + j * reach[1], 9)) for i in (1, -1) for j in (1, -1)}
    assert {tuple(map(float, np.round(row, 9))) for row in found[np.isfinite(found[:, 0])]} == wanted


def test_search_finds_the_modes_of_a_five_bar():
    robot = zoo.FiveBar(jnp.asarray(1.0), jnp.asarray(0.8), jnp.asarray(1.3))
    theta = np.array([2.0, 0.9])
    poses = np.asarray(jk.forward(robot, theta).values)
    poses = poses[np.isfinite(poses[:, 0])]
    assert len(poses) == 2
    for pose in poses:
        assert np.abs(np.asarray(jk.constraints(robot, pose, theta))).max() < 1e-12
        modes = np.asarray(jk.inverse(robot, pose).values)
        modes = modes[np.isfinite(modes[:, 0])]
        assert len(modes) == 4
        assert np.abs(modes - theta).max(axis=1).min() < 1e-9
        assert np.all((modes >= -np.pi) & (modes < np.pi))


def test_search_reports_nothing_where_nothing_is():
    robot = zoo.TwoSliders(jnp.asarray(0.5), jnp.asarray(0.4))
    branches = jk.forward(robot, (-2.0, 2.0))
    assert_empty(branches, jk.Status.COMPLETENESS_UNKNOWN)
    assert_empty(jk.forward(robot, (np.nan, 2.0)), jk.Status.INVALID_INPUT)


def test_search_solutions_have_derivatives():
    robot = zoo.TwoSliders(jnp.asarray(1.5), jnp.asarray(1.2))

    def x(joints):
        return jk.forward(robot, joints).values[1]

    def closed_form(joints):
        u1, u2 = joints
        x = (1.5**2 - 1.2**2 + u2**2 - u1**2) / (2 * (u2 - u1))
        return jnp.stack([x, jnp.sqrt(1.5**2 - (x - u1) ** 2)])

    joints = jnp.array([-0.4, 0.7])
    np.testing.assert_allclose(x(joints), closed_form(joints), atol=1e-12)
    np.testing.assert_allclose(jax.jacrev(x)(joints), jax.jacfwd(closed_form)(joints), rtol=1e-10)
    np.testing.assert_allclose(jax.jacfwd(jax.jacrev(x))(joints), jax.hessian(closed_form)(joints), rtol=1e-9)
    slope = jax.grad(lambda robot: jk.forward(robot, joints).values[1, 0])(robot)
    assert float(slope.first) == pytest.approx(1.5 / 1.1, rel=1e-10)
    assert float(slope.second) == pytest.approx(-1.2 / 1.1, rel=1e-10)


def test_inputs_whose_squares_overflow_are_invalid():
    for robot in (jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0), jk.mechanisms.rpr3.reference()):
        for joints in ([1e155] * 3, [1e300] * 3, [1.0, 2.0, 1e300]):
            found = jk.forward(robot, joints)
            assert not found.valid.any()
            assert (found.status == jk.Status.INVALID_INPUT).all()


def test_very_long_legs_are_undecided_and_long_ones_are_not():
    robot = jk.mechanisms.rpr3.reference()
    assert int(jk.forward(robot, [1e4] * 3).count) == 4
    assert not (jk.forward(robot, [1e4] * 3).status == jk.Status.UNDECIDED).any()
    assert (jk.forward(robot, [1e7] * 3).status == jk.Status.UNDECIDED).any()


def test_a_batch_of_robots_and_a_float32_robot_are_named():
    batch = jax.vmap(lambda c3: jk.mechanisms.rpr3.analytic(1.0, c3, 1.0))(jnp.zeros(3))
    with pytest.raises(jk.InputError, match=r"jax\.vmap"):
        jk.forward(batch, [1.0, 1.0, 1.0])
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    single = robot.replace(c2=jnp.asarray(1.0, jnp.float32))
    with pytest.raises(jk.PrecisionError, match="make the mechanism again"):
        jk.forward(single, [1.0, 1.0, 1.0])
