"""Assembly modes of the 3-PPPS: numbers, statuses and labels, next to singularities and self-motions above all."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import spatial_checks as checks
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.mechanisms import ppps3

Status = jk.Status
MIRRORED = pytest.mark.parametrize("mirrored", [False, True], ids=["as Eqs. (8)-(24)", "as Eq. (4)"])
#: (R22, R33) lane by lane.
LABELS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])


def statuses(branches):
    return [Status(int(code)) for code in np.asarray(branches.status)]


def reduced_to_joints(m2, p, m3):
    """Returns joints with y1 = z1 = y2 = 0, where the change of variables rounds nothing."""
    return np.array([0.0, 0.0, 0.0, m2, p, m3])


# --- numbers of modes ---


def test_four_modes_at_home():
    # R12 = R31 = R32 = 0: the diagonal rotations, x = +-sqrt3/2 less rho2y.
    branches = jk.forward(ppps3.create(), checks.HOME_JOINTS)
    assert statuses(branches) == [Status.OK] * 4
    found = checks.matrices(branches.values)
    wanted = [np.diag(d) for d in ((1, 1, 1), (-1, 1, -1), (-1, -1, 1), (1, -1, -1))]
    np.testing.assert_allclose(found, wanted, atol=1e-15)
    np.testing.assert_allclose(branches.values[:, 0], [0, -checks.ROOT3, -checks.ROOT3, 0], atol=1e-15)
    assert np.all(np.asarray(branches.residual) < 1e-15)


@pytest.mark.parametrize(
    ("reduced", "count", "multiplicity", "status"),
    [
        ((0.0, 0.0, 0.0), 4, [1, 1, 1, 1], Status.OK),
        # b = 1 - (m2 - m3)^2 - p^2 = 0: R22 = 0, and R33 = +-1.
        ((0.0, 1.0, 0.0), 2, [2, 2, 0, 0], Status.SINGULAR),
        ((0.3, 0.8, -0.3), 2, [2, 2, 0, 0], Status.SINGULAR),
        # 4 (m2^2 - m2 m3 + m3^2) = 3: R33 = 0.
        ((checks.ROOT3 / 2, 0.0, checks.ROOT3 / 2), 2, [2, 0, 2, 0], Status.SINGULAR),
        # Both vanish, R31 = -1 and R12 = +-1: one pose of multiplicity four.
        ((checks.ROOT3 / 2, 1.0, checks.ROOT3 / 2), 1, [4, 0, 0, 0], Status.SINGULAR),
        ((checks.ROOT3 / 2, -1.0, checks.ROOT3 / 2), 1, [4, 0, 0, 0], Status.SINGULAR),
        # b < 0 alone, a < 0 alone.
        ((0.0, 1.1, 0.0), 0, [0, 0, 0, 0], Status.NO_REAL_SOLUTION),
        ((1.0, 0.0, 1.0), 0, [0, 0, 0, 0], Status.NO_REAL_SOLUTION),
    ],
)
def test_numbers_and_statuses(reduced, count, multiplicity, status):
    robot, joints = ppps3.create(), reduced_to_joints(*reduced)
    branches = jk.forward(robot, joints)
    assert int(branches.count) == count
    np.testing.assert_array_equal(branches.multiplicity, multiplicity)
    lanes = np.asarray(branches.valid) if count else np.ones(4, bool)
    assert {s for s, here in zip(statuses(branches), lanes, strict=True) if here} == {status}
    for pose in np.asarray(branches.values)[np.asarray(branches.valid)]:
        assert np.abs(checks.ppps3_joints(pose)[[1, 3, 4, 5]] - joints[[1, 3, 4, 5]]).max() < 3e-8
    number, undecided = checks.count_many(robot, joints[None])
    assert (int(number[0]), bool(undecided[0])) == (count, status == Status.SINGULAR)


def test_both_arguments_negative_is_no_pose():
    # The square root of Eq. (25) is that of a b = (-7)(-7.25) > 0, real; both factors are negative.
    joints = reduced_to_joints(math.sqrt(6), 2.0, 2.0)
    m2, p, m3 = math.sqrt(6), 2.0, 2.0
    a, b = 1 - 4 / 3 * (m2 * m2 - m2 * m3 + m3 * m3), 1 - (m2 - m3) ** 2 - p * p
    assert a < 0 > b
    branches = jk.forward(ppps3.create(), joints)
    assert statuses(branches) == [Status.NO_REAL_SOLUTION] * 4
    assert int(checks.count_many(ppps3.create(), joints[None]).number[0]) == 0
    assert np.isnan(np.asarray(branches.values)).all()


def test_volume_of_joints_with_four_modes():
    # The region is a bicylinder of volume 8 / sqrt3 in (mu2z, mu3y, mu3z).
    rng = np.random.default_rng(0)
    joints, n = np.zeros((400_000, 6)), 400_000
    half = np.array([1.2, 1.2, 1.2])
    joints[:, 3:] = rng.uniform(-half, half, (n, 3))
    share = np.mean(checks.count_many(ppps3.create(), joints).number == 4)
    volume = share * np.prod(2 * half)
    spread = np.prod(2 * half) * math.sqrt(share * (1 - share) / n)
    assert abs(volume - 8 / checks.ROOT3) < 4 * spread
    assert spread < 0.02


@MIRRORED
def test_count_and_forward_and_frames_agree_everywhere(mirrored):
    rng, robot = np.random.default_rng(1), ppps3.create(0.8, mirrored=mirrored)
    n = 9_000
    parts = [checks.joints_of_entries(rng, rng.uniform(-1.1, 1.1, (60_000, 3)), 0.8, mirrored)]
    for kind in checks.KINDS:
        entries = checks.singular_entries(rng, n, kind)
        entries += np.resize(checks.LAYERS, n)[:, None] * rng.uniform(-1, 1, (n, 3))
        parts.append(checks.joints_of_entries(rng, entries, 0.8, mirrored))
    joints = np.concatenate(parts)
    branches, count, frames = (f(robot, joints) for f in (checks.forward_many, checks.count_many, checks.frames_many))
    np.testing.assert_array_equal(branches.count, count.number)
    np.testing.assert_array_equal(checks.flagged(branches.status), count.undecided)
    assert set(np.unique(count.number)) == {0, 1, 2, 4}
    for name in ("valid", "status", "multiplicity"):
        np.testing.assert_array_equal(getattr(frames, name), getattr(branches, name))
    valid = np.asarray(branches.valid)
    np.testing.assert_allclose(frames.position[valid], branches.values[..., :3][valid], atol=2e-15)
    # The matrix of a pose that is one within a blur only is no exact rotation, and its angles give a nearby one.
    regular = valid & np.isin(np.asarray(branches.status), (Status.OK, Status.UNDECIDED))
    found = checks.matrices(np.asarray(branches.values)[regular])
    assert checks.rotation_gap(np.asarray(frames.rotation)[regular], found).max() < 1e-10
    assert np.nanmax(np.where(regular, branches.residual, np.nan)) < 1e-12


@pytest.mark.slow
def test_count_and_forward_agree_on_a_million_random_joints():
    rng, robot = np.random.default_rng(2), ppps3.create()
    for _ in range(4):
        joints = rng.uniform(-1.2, 1.2, (250_000, 6))
        branches, count = checks.forward_many(robot, joints), checks.count_many(robot, joints)
        np.testing.assert_array_equal(branches.count, count.number)
        np.testing.assert_array_equal(checks.flagged(branches.status), count.undecided)


# --- forward after inverse ---


@MIRRORED
def test_forward_finds_the_pose_of_the_inverse(mirrored):
    rng, robot = np.random.default_rng(3), ppps3.create(1.7, mirrored=mirrored)
    poses = checks.random_poses(rng, 100_000, 3.0)
    # Half of them next to R33 = cos(phi) cos(theta) = 0 or R22 = 0, down to 1e-6.
    off = np.resize([1e-6, -1e-6, 1e-5, -1e-4, 1e-3], 25_000)
    poses[:50_000, 4] *= 0.9
    poses[:25_000, 3] = rng.choice([-1, 1], 25_000) * (np.pi / 2 + off / np.cos(poses[:25_000, 4]))
    near = poses[25_000:50_000]
    cosine, sine = np.cos(near[:, 3]), np.sin(near[:, 3]) * np.sin(near[:, 4])
    near[:, 5] = np.arctan2(cosine, sine) + off / np.hypot(cosine, sine)
    joints = np.asarray(checks.inverse_many(robot, poses).values)[:, 0]
    branches = checks.forward_many(robot, joints)
    wanted = checks.matrices(poses)
    clearance = np.minimum(np.abs(wanted[:, 1, 1]), np.abs(wanted[:, 2, 2]))
    assert np.mean((clearance > 0.99e-6) & (clearance < 1.01e-6)) > 0.19
    clear = clearance > 5e-7
    assert np.mean(clear) > 0.9999
    assert np.all(branches.status[clear] == Status.OK)
    lane = np.argmax(np.all(np.sign(wanted[:, [1, 2], [1, 2]])[:, None] == LABELS, axis=2), axis=1)
    values = np.asarray(branches.values)[np.arange(len(poses)), lane]
    gap = checks.rotation_gap(checks.matrices(values), wanted)
    # The square root of a small number passes the joints' rounding on divided by it; 1 - R32^2 divides once more.
    level = np.sqrt((1 - wanted[:, 2, 1]) * (1 + wanted[:, 2, 1]))
    assert np.max((gap * clearance * level)[clear]) < 1e-14
    assert np.quantile(gap[50_000:], 0.999) < 1e-11
    shift = np.max(np.abs(values[:, :3] - poses[:, :3]), axis=1)
    assert np.max((shift * clearance * level)[clear]) < 1e-14


@MIRRORED
def test_labels_are_the_signs_of_the_matrix(mirrored):
    rng, robot = np.random.default_rng(4), ppps3.create(mirrored=mirrored)
    poses = checks.random_poses(rng, 5000)
    branches = checks.forward_many(robot, checks.ppps3_joints(poses, mirrored=mirrored))
    found = checks.matrices(branches.values)
    np.testing.assert_array_equal(np.sign(found[..., [1, 2], [1, 2]]), np.broadcast_to(LABELS, (5000, 4, 2)))
    names = tuple(f"R22 {'>' if a > 0 else '<'} 0, R33 {'>' if b > 0 else '<'} 0" for a, b in LABELS)
    assert robot.forward_labels == names
    factors = robot.factors(branches.values[0, 2])
    assert [name for name, value in factors.items() if float(value) > 0] == ["R33"]
    # The four matrices have R12, R31, R32 in common: what the joints know.
    for i, j in ((0, 1), (2, 0), (2, 1)):
        np.testing.assert_allclose(found[..., i, j], found[..., :1, i, j] + np.zeros(4), atol=1e-13)


def test_modes_satisfy_the_distances_of_the_corners():
    rng, robot = np.random.default_rng(5), ppps3.create(0.6)
    joints = checks.ppps3_joints(checks.random_poses(rng, 3000), 0.6)
    branches = checks.forward_many(robot, joints)
    again = checks.ppps3_joints(np.asarray(branches.values), 0.6)
    assert np.abs(again - joints[:, None]).max() < 2e-14


# --- next to singularities ---


@MIRRORED
@pytest.mark.parametrize("kind", checks.KINDS)
def test_flags_are_for_the_neighbourhood_alone(kind, mirrored):
    rng, robot = np.random.default_rng(6), ppps3.create(mirrored=mirrored)
    n = 9000
    layer = np.resize(checks.LAYERS, n)
    entries = checks.singular_entries(rng, n, kind) + layer[:, None] * rng.uniform(-1, 1, (n, 3))
    status = np.asarray(checks.forward_many(robot, checks.joints_of_entries(rng, entries, 1, mirrored)).status)
    doubtful = checks.flagged(status)
    assert doubtful[layer <= 1e-15].all()
    assert doubtful[layer >= 1e-10].mean() < 0.01
    if kind == "self-motion":
        assert np.all(status[layer <= 1e-15] == Status.SELF_MOTION)
    else:
        assert not np.any(status == Status.SELF_MOTION)
        assert np.any(status[layer == 1e-14] == Status.UNDECIDED)


def test_undecided_on_either_side_of_a_boundary():
    # a = 3e-14 and -3e-14 at R12 = R32 = 0: four modes, or none, and float64 should not say.
    for excess, count in ((-1.5e-14, 4), (1.5e-14, 0)):
        branches = jk.forward(
            ppps3.create(), reduced_to_joints(*[checks.ROOT3 / 2 * (1 + excess) * k for k in (1, 0, 1)])
        )
        assert statuses(branches) == [Status.UNDECIDED] * 4
        assert int(branches.count) == count


# --- self-motions ---


@MIRRORED
@pytest.mark.parametrize("up", [1, -1])
def test_self_motion_keeps_its_joints_all_the_way_round(mirrored, up):
    side = 0.7
    robot = ppps3.create(side, mirrored=mirrored)
    joints = np.array([0.2, -0.4, 0.3, -0.4 - up * side / 2, -0.3, -0.4 + up * side / 2])
    branches = jk.forward(robot, joints)
    assert statuses(branches) == [Status.SELF_MOTION] * 4
    number, undecided = checks.count_many(robot, joints[None])
    assert (int(number[0]), bool(undecided[0])) == (0, True)
    turns = jnp.linspace(-4.0, 4.0, 57)
    poses = np.asarray(jax.vmap(lambda t: ppps3.self_motion(robot, joints, t))(turns))
    assert np.abs(checks.ppps3_joints(poses, side, mirrored) - joints).max() < 1e-15
    found = checks.matrices(poses)
    np.testing.assert_allclose(found[:, 2, 1], (-up if mirrored else up) + np.zeros(57), atol=1e-15)
    np.testing.assert_allclose(found[:, 0, 0], np.cos(turns), atol=1e-15)
    np.testing.assert_allclose(found[:, 1, 0], np.sin(turns), atol=1e-15)
    # The trammel: x + rho2y runs over an interval of length sqrt3 s, and every pose is singular.
    swing = poses[:, 0] + joints[2]
    np.testing.assert_allclose(swing, side * checks.ROOT3 / 2 * np.cos(turns), atol=1e-15)
    assert np.abs(np.stack([found[:, 1, 1], found[:, 2, 2]])).max() < 1e-15


def test_self_motion_refuses_other_joints():
    robot = ppps3.create()
    for joints in (checks.HOME_JOINTS, reduced_to_joints(-0.5, 1e-6, 0.5), reduced_to_joints(-0.5, 0.0, 0.5 + 1e-9)):
        with pytest.raises(jk.InputError, match=r"has no self-motion: it must be \(-1/2, 0, 1/2\)"):
            ppps3.self_motion(robot, joints, 0.3)
    with pytest.raises(jk.InputError, match=r"turn has shape \(2,\).*vmap"):
        ppps3.self_motion(robot, reduced_to_joints(-0.5, 0.0, 0.5), np.zeros(2))


def test_joints_beside_a_self_motion_have_isolated_modes_that_meet_it():
    # 1e-6 inside, four regular modes; all nearly vertical.
    branches = jk.forward(ppps3.create(), reduced_to_joints(-0.5 + 1e-6, 0.0, 0.5 - 1e-6))
    assert statuses(branches) == [Status.OK] * 4
    found = checks.matrices(branches.values)
    np.testing.assert_allclose(found[:, 2, 1], 1 - 2e-6, atol=1e-12)


# --- symmetries ---

angles = st.floats(-math.pi, math.pi)
poses_strategy = st.tuples(*[st.floats(-3, 3)] * 3, angles, st.floats(-math.pi / 2, math.pi / 2), angles)


@given(poses_strategy, st.floats(0.05, 20))
@settings(max_examples=60)
def test_scaling_all_lengths(pose, factor):
    joints = checks.ppps3_joints(np.array(pose))
    small, large = jk.forward(ppps3.create(1.0), joints), jk.forward(ppps3.create(factor), joints * factor)
    if not (checks.flagged(small.status) | checks.flagged(large.status)):
        np.testing.assert_array_equal(small.valid, large.valid)
        clearance = np.nanmin(np.abs(checks.matrices(small.values)[:, [1, 2], [1, 2]]), initial=1)
        scale = np.array([factor] * 3)
        gap = np.abs(small.values[:, :3] * scale - large.values[:, :3]) / factor
        assert np.nanmax(gap, initial=0) < 1e-13 / clearance**2


def test_shifting_the_robot_and_its_joints():
    rng, robot = np.random.default_rng(7), ppps3.create()
    poses = checks.random_poses(rng, 2000)
    shift = rng.uniform(-2, 2, (2000, 3))
    x, y, z = shift.T
    joints = checks.ppps3_joints(poses)
    here = checks.forward_many(robot, joints)
    there = checks.forward_many(robot, joints + np.stack([y, z, -x, z, x, z], axis=1))
    np.testing.assert_allclose(there.values[..., :3] - shift[:, None], here.values[..., :3], atol=1e-9)
    assert checks.rotation_gap(checks.matrices(there.values), checks.matrices(here.values)).max() < 1e-9


def test_the_printed_robot_is_the_mirror_image():
    rng = np.random.default_rng(8)
    joints = checks.joints_of_entries(rng, rng.uniform(-1, 1, (3000, 3)))
    here, there = (checks.forward_many(ppps3.create(mirrored=flag), joints) for flag in (False, True))
    np.testing.assert_array_equal(here.valid, there.valid)
    np.testing.assert_array_equal(here.status, there.status)
    np.testing.assert_allclose(there.values[..., :3], here.values[..., :3], atol=1e-11)
    turned = checks.matrices(here.values * np.array([1, 1, 1, -1, 1, -1]))
    valid = np.asarray(here.valid)
    assert checks.rotation_gap(checks.matrices(there.values)[valid], turned[valid]).max() < 1e-11


def test_left_symmetries_permute_the_modes():
    # diag(-1, -1, 1) R has R12, R31, R32 -> -R12, R31, R32, and the other signs likewise: aspects are copies.
    rng, robot = np.random.default_rng(9), ppps3.create()
    entries = checks.singular_entries(rng, 500, "both") * rng.uniform(0.1, 0.7, (500, 1))
    joints = checks.joints_of_entries(rng, entries, shift=0.0)
    base = checks.matrices(checks.forward_many(robot, joints).values)
    for signs, order in (((1, -1, -1), (3, 2, 1, 0)), ((-1, 1, -1), (1, 0, 3, 2)), ((-1, -1, 1), (2, 3, 0, 1))):
        flips = np.array([signs[0], signs[2], signs[2]])
        there = checks.forward_many(robot, checks.joints_of_entries(rng, entries * flips, shift=0.0))
        wanted = (np.diag(signs) @ base)[:, order]
        assert checks.rotation_gap(checks.matrices(there.values), wanted).max() < 1e-12


@pytest.mark.parametrize(("size", "tolerance"), [(1e3, 1e-10), (1e6, 1e-7), (1e9, 1e-4)])
def test_far_from_the_origin_rounded_joints_are_answered_exactly(size, tolerance):
    # Joints far out are rounded by size * 1e-16: the modes move by that over the clearance, and the differences of the
    # joints as given are exact, so that nothing is lost on top and no status is spent on it.
    rng, robot = np.random.default_rng(10), ppps3.create()
    poses = checks.random_poses(rng, 4000, size)
    wanted = checks.matrices(poses)
    clear = np.minimum(np.abs(wanted[:, 1, 1]), np.abs(wanted[:, 2, 2])) > 0.1
    joints = checks.ppps3_joints(poses)
    branches = checks.forward_many(robot, joints)
    assert np.all(np.asarray(branches.status)[clear] == Status.OK)
    found = checks.matrices(branches.values)
    assert np.min(checks.rotation_gap(found, wanted[:, None]), axis=1)[clear].max() < tolerance
    near = joints - np.array([1, 0, 0, 0, 0, 0]) * joints[:, :1]
    near[:, [1, 3, 5]] -= joints[:, 1:2]
    near[:, 4] += near[:, 2]
    near[:, 2] = 0
    same = checks.matrices(checks.forward_many(robot, near).values)
    assert checks.rotation_gap(found, same)[clear].max() < 1e-13


# --- batches and bad input ---


def test_batches_of_robots_and_robots_as_arguments():
    rng = np.random.default_rng(11)
    side = rng.uniform(0.3, 3, 40)
    joints = np.stack([checks.ppps3_joints(p, s) for p, s in zip(checks.random_poses(rng, 40), side, strict=True)])
    robots = ppps3.create(side)
    assert robots.limits.low.shape == (40, 6)
    assert robots.passive_limits.high.shape == (40, 3)
    batch = jax.jit(jax.vmap(jk.forward))(robots, joints)
    jitted = jax.jit(jk.forward)
    for k in (0, 13, 39):
        one = jitted(ppps3.create(side[k]), joints[k])
        np.testing.assert_allclose(batch.values[k], one.values, atol=1e-12)
    with pytest.raises(jk.InputError, match=r"batch of robots of shape \(40,\)"):
        jk.forward(robots, joints[0])


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e70])
@pytest.mark.parametrize("place", range(6))
def test_numbers_that_are_none_are_refused_in_every_joint(bad, place):
    robot = ppps3.create()
    joints = np.array(checks.HOME_JOINTS)
    joints[place] = bad
    branches, frames = jk.forward(robot, joints), jk.forward_frames(robot, joints)
    assert statuses(branches) == [Status.INVALID_INPUT] * 4
    np.testing.assert_array_equal(frames.status, branches.status)
    assert not np.asarray(frames.valid).any()
    pose = np.zeros(6)
    pose[place] = bad
    assert statuses(jk.inverse(robot, pose)) == [Status.INVALID_INPUT]


@pytest.mark.parametrize(
    "change", [{"side": 0.0}, {"side": -1.0}, {"side": math.nan}, {"side": math.inf}, {"base_radius": math.nan}]
)
def test_records_with_bad_geometry_have_a_status(change):
    robot = dataclasses.replace(ppps3.create(), **{name: jnp.asarray(value) for name, value in change.items()})
    for branches in (
        jk.forward(robot, checks.HOME_JOINTS),
        jk.inverse(robot, np.zeros(6)),
        jk.forward_frames(robot, checks.HOME_JOINTS),
    ):
        assert set(statuses(branches)) == {Status.INVALID_GEOMETRY}


def test_limits_are_the_same_in_all_forms():
    rng = np.random.default_rng(12)
    limits = jk.Limits(jnp.full(6, -0.6), jnp.array([0.6, 0.6, 0.9, 0.6, 0.6, jnp.inf]))
    robot = ppps3.create(limits=limits)
    joints = rng.uniform(-1, 1, (2000, 6))
    joints[0] = limits.low
    outside = np.any((joints < limits.low) | (joints > limits.high), axis=1)
    branches, frames = checks.forward_many(robot, joints), checks.frames_many(robot, joints)
    np.testing.assert_array_equal(np.all(np.asarray(branches.status) == Status.OUTSIDE_LIMITS, axis=1), outside)
    np.testing.assert_array_equal(frames.status, branches.status)
    free = checks.forward_many(ppps3.create(), joints[~outside])
    np.testing.assert_array_equal(np.asarray(branches.status)[~outside], free.status)
    assert 0.05 < outside.mean() < 1
    poses = checks.random_poses(rng, 500)
    inverse = checks.inverse_many(robot, poses)
    own = checks.ppps3_joints(poses)
    np.testing.assert_array_equal(
        np.asarray(inverse.valid)[:, 0], np.all((own >= limits.low) & (own <= limits.high), axis=1)
    )


@pytest.mark.parametrize("call", [jk.forward_frames, lambda r, q: ppps3.self_motion(r, q, 0.0), jk.forward])
@pytest.mark.parametrize("shape", [(5,), (7,), (2, 6), ()])
def test_wrong_shapes_are_named(call, shape):
    with pytest.raises(jk.InputError, match=r"shape.*\(6,\)"):
        call(ppps3.create(), np.zeros(shape))


def test_kernels_are_elementwise():
    # The hot kernels take arrays of any one shape.
    robot, joints = ppps3.create(), np.array(checks.HOME_JOINTS)
    block = tuple(jnp.full((2, 3), value) for value in joints)
    for lanes in (robot.forward_kernel(block), robot.frame_kernel(block)):
        assert len(lanes) == 4
        for lane in lanes:
            assert {v.shape for v in (*lane.values, lane.status, lane.multiplicity, lane.residual)} == {(2, 3)}
    np.testing.assert_array_equal(robot.count_kernel(block).number, np.full((2, 3), 4))
