"""The 3-PPPS and the TLPM against their oracles: distances in certified balls and exact rational numbers of modes."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import spatial_checks as checks
from flint import ctx
from oracles import ppps3_exact, rpr3_exact, tlpm_exact

import jaxkin as jk
from jaxkin.mechanisms import ppps3, tlpm

Status = jk.Status
#: (side, mirrored): floats whose division rounds, and one that does not.
PLATFORMS = ((1.0, False), (0.37, False), (2.9, True))
MANY = 120


def exact_count(joints, platform):
    """Returns the exact number of poses, -1 for infinitely many."""
    try:
        return ppps3_exact.count(joints, platform).count
    except rpr3_exact.SelfMotion:
        return -1


def exact_modes(joints, platform):
    """Returns positions ``(n, 3)`` and rotations ``(n, 3, 3)`` to the last place, in the lanes' order of labels."""
    poses = [pose.floats() for pose in ppps3_exact.forward(joints, platform)]
    poses.sort(key=lambda pose: (-np.sign(pose[1][1][1]), -np.sign(pose[1][2][2])))
    return np.array([pose[0] for pose in poses]), np.array([pose[1] for pose in poses])


# --- 3-PPPS ---


@pytest.mark.parametrize(("side", "mirrored"), PLATFORMS)
@pytest.mark.parametrize("shift", [1.0, 1e4])
def test_ppps3_modes_of_random_joints(side, mirrored, shift):
    rng, platform = np.random.default_rng(0), ppps3_exact.Platform(side, mirrored)
    robot = ppps3.create(side, mirrored=mirrored)
    joints = checks.joints_of_entries(rng, rng.uniform(-0.8, 0.8, (MANY, 3)), side, mirrored, shift)
    branches, frames = checks.forward_many(robot, joints), checks.frames_many(robot, joints)
    counts = [exact_count(row, platform) for row in joints.tolist()]
    np.testing.assert_array_equal(branches.count, counts)
    real = np.flatnonzero(branches.count)
    assert len(real) >= 50
    for k in real:
        position, rotation = exact_modes(joints[k].tolist(), platform)
        clearance = np.abs(rotation[:, [1, 2], [1, 2]]).min()
        tolerance = 4e-15 / clearance
        for found in (checks.matrices(branches.values[k]), frames.rotation[k]):
            assert checks.rotation_gap(found, rotation).max() < tolerance
        for found in (branches.values[k, :, :3], frames.position[k]):
            np.testing.assert_allclose(found, position, atol=2 * side * tolerance, rtol=1e-15)
        signs = np.sign(frames.rotation[k][:, [1, 2], [1, 2]])
        np.testing.assert_array_equal(signs, [(1, 1), (1, -1), (-1, 1), (-1, -1)])


@pytest.mark.parametrize(("side", "mirrored"), PLATFORMS)
@pytest.mark.parametrize("kind", checks.KINDS)
@pytest.mark.parametrize("steep", [False, True])
def test_ppps3_number_next_to_singularities_is_exact_or_flagged(kind, side, mirrored, steep):
    rng, platform = np.random.default_rng(1), ppps3_exact.Platform(side, mirrored)
    robot, n = ppps3.create(side, mirrored=mirrored), 900
    layer = np.resize(checks.LAYERS, n)
    entries = checks.singular_entries(rng, n, kind, steep) + layer[:, None] * rng.uniform(-1, 1, (n, 3))
    joints = np.concatenate(
        [checks.joints_of_entries(rng, entries[k::3], side, mirrored, shift) for k, shift in enumerate((0.0, 1.0, 1e3))]
    )
    exact = np.array([exact_count(row, platform) for row in joints.tolist()])
    branches, count = checks.forward_many(robot, joints), checks.count_many(robot, joints)
    doubtful = checks.flagged(branches.status)
    bad = (branches.count != exact) & ~doubtful
    assert not bad.any(), joints[bad]
    bad = (count.number != exact) & ~count.undecided
    assert not bad.any(), joints[bad]
    assert {0, 4} <= set(exact)
    assert (~doubtful).sum() > n / 8
    if kind == "self-motion" and side == 1.0:
        assert np.all(branches.status[exact == -1] == Status.SELF_MOTION)
        assert np.any(exact == -1)


@pytest.mark.parametrize(("side", "mirrored"), PLATFORMS)
@pytest.mark.parametrize("kind", checks.KINDS[:3])
def test_ppps3_modes_next_to_singularities(kind, side, mirrored):
    # 1e-6 to 1e-12 inside and outside: as close to the exact poses as the square root lets them be.
    rng, platform = np.random.default_rng(2), ppps3_exact.Platform(side, mirrored)
    robot, layer = ppps3.create(side, mirrored=mirrored), np.resize([1e-6, 1e-8, 1e-10, 1e-12], MANY)
    entries = checks.singular_entries(rng, MANY, kind) * (1 - layer * rng.uniform(-0.3, 1, MANY))[:, None]
    joints = checks.joints_of_entries(rng, entries, side, mirrored)
    branches, frames = checks.forward_many(robot, joints), checks.frames_many(robot, joints)
    compared = 0
    for k, row in enumerate(joints.tolist()):
        number = exact_count(row, platform)
        if number == 0:
            assert not branches.valid[k].any() or checks.flagged(branches.status[k])
            continue
        position, rotation = exact_modes(row, platform)
        clearance = np.abs(rotation[:, [1, 2], [1, 2]]).min()
        level = np.sqrt(1 - rotation[0, 2, 1] ** 2)
        assert branches.count[k] == 4
        compared += 1
        tolerance = 4e-15 / (clearance * level)
        assert checks.rotation_gap(frames.rotation[k], rotation).max() < tolerance
        assert checks.rotation_gap(checks.matrices(branches.values[k]), rotation).max() < tolerance + 1e-13
        np.testing.assert_allclose(branches.values[k, :, :3], position, atol=2 * side * tolerance)
    assert compared >= 50


@pytest.mark.parametrize(("side", "mirrored"), PLATFORMS)
def test_ppps3_inverse_and_jacobian(side, mirrored):
    rng, platform = np.random.default_rng(3), ppps3_exact.Platform(side, mirrored)
    robot, poses = ppps3.create(side, mirrored=mirrored), checks.random_poses(rng, 50)
    twist = np.asarray(jax.jit(jax.vmap(ppps3.twist_jacobian, in_axes=(None, 0)))(robot, poses))
    joints = checks.inverse_many(robot, poses).values[:, 0]
    passive = np.asarray(jax.vmap(lambda p: ppps3.passive_joints(robot, p))(jnp.asarray(poses)))
    for k, pose in enumerate(poses.tolist()):
        exact = ppps3_exact.inverse(pose, platform)
        np.testing.assert_allclose(joints[k], [float(v.mid()) for v in exact.active], atol=2e-15)
        np.testing.assert_allclose(passive[k], [float(v.mid()) for v in exact.passive], atol=2e-15)
        with ctx.workprec(128):
            wanted = ppps3_exact.jacobian(ppps3_exact.rotation_of(*pose[3:]), platform)
        np.testing.assert_allclose(twist[k], [[float(v.mid()) for v in row] for row in wanted.tolist()], atol=2e-15)


# --- TLPM ---

#: Radius, height, angles, initial lengths; None as in the paper.
MACHINES = {
    "paper": (590.0, 590.0, None, None),
    "unequal lengths": (640.0, 520.0, None, (800.0, 750.0, 900.0)),
    "any angles": (640.0, 520.0, (0.2, 1.9, -2.4), (800.0, 750.0, 900.0)),
}


def machine(name):
    """Returns the oracle's and the library's robot, without limits."""
    radius, height, eta, initial = MACHINES[name]
    angles = {} if eta is None else {"limb_angles": eta}
    robot = tlpm.create(radius, height, (-1, 1), initial, **angles)
    robot = dataclasses.replace(robot, limits=jk.Limits.none(3))
    # The library's 2 pi / 3 and sqrt(L^2 + h^2) are rounded; what it is given is what the oracle has to solve.
    return tlpm_exact.Machine(radius, height, robot.initial_lengths.tolist(), robot.limb_angles.tolist()), robot


@pytest.mark.parametrize("name", MACHINES)
def test_tlpm_modes_of_random_strokes(name):
    oracle, robot = machine(name)
    rng = np.random.default_rng(4)
    strokes = rng.uniform(-250, 250, (MANY, 3))
    strokes[:20] = rng.uniform(-950, 500, (20, 3))
    branches = checks.forward_many(robot, strokes)
    found = [tlpm_exact.forward(oracle, row) for row in strokes.tolist()]
    np.testing.assert_array_equal(branches.count, [positions.count for positions in found])
    compared = 0
    for k, positions in enumerate(found):
        if positions.count:
            wanted = np.array([[float(v.mid()) for v in point] for point in positions.points])
            rise = abs(wanted[0, 2] + float(robot.height))
            np.testing.assert_allclose(branches.values[k][:, :2], wanted[:, :2], atol=2e-12)
            np.testing.assert_allclose(branches.values[k][:, 2], wanted[:, 2], atol=2e-9 / rise + 1e-12)
            compared += 1
    assert compared >= 50


@pytest.mark.parametrize("name", MACHINES)
def test_tlpm_number_next_to_the_base_plane_is_exact_or_flagged(name):
    oracle, robot = machine(name)
    rng, n = np.random.default_rng(5), 400
    points = rng.uniform(-400, 400, (n, 3)) * [1, 1, 0] - [0, 0, float(robot.height)]
    layer = np.resize([0.0, 1e-16, 1e-15, 1e-14, 1e-13, 1e-12, 1e-10, 1e-6], n)[:, None]
    lengths = checks.tlpm_lengths(robot, points) * (1 + layer * rng.uniform(-1, 1, (n, 3)))
    strokes = lengths - np.asarray(robot.initial_lengths)
    exact = np.array([tlpm_exact.forward(oracle, row).count for row in strokes.tolist()])
    branches, count = checks.forward_many(robot, strokes), checks.count_many(robot, strokes)
    doubtful = checks.flagged(branches.status)
    np.testing.assert_array_equal(branches.count[~doubtful], exact[~doubtful])
    np.testing.assert_array_equal(count.number[~count.undecided], exact[~count.undecided])
    assert {0, 2} <= set(exact)
    assert doubtful[layer[:, 0] <= 1e-16].all()
    assert doubtful[layer[:, 0] == 1e-6].mean() < 0.1
    # Where a lane holds a pose it solves the equations.
    assert np.nanmax(branches.residual) < 1e-12


def test_tlpm_inverse():
    rng = np.random.default_rng(6)
    for name in MACHINES:
        oracle, robot = machine(name)
        points = rng.uniform(-300, 300, (50, 3))
        strokes = checks.inverse_many(robot, points).values[:, 0]
        for point, found in zip(points.tolist(), strokes, strict=True):
            wanted = [float(v.mid()) for v in tlpm_exact.strokes(oracle, point)]
            np.testing.assert_allclose(found, wanted, atol=5e-13)


def test_tlpm_with_ideal_angles_and_lengths():
    # The paper's robot, exact: what the library's rounded angles and lengths cost.
    oracle, robot = tlpm_exact.Machine(590.0, 590.0), tlpm.create()
    rng = np.random.default_rng(7)
    strokes = rng.uniform(-150, 150, (60, 3))
    values = checks.forward_many(robot, strokes).values
    for row, found in zip(strokes.tolist(), values, strict=True):
        points = tlpm_exact.forward(oracle, row).points
        np.testing.assert_allclose(found, [[float(v.mid()) for v in point] for point in points], atol=1e-11)
