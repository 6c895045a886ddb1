"""The 3-PPPS with U-shaped base: equations, conversions, Jacobians, derivatives, constructors."""

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

MIRRORED = pytest.mark.parametrize("mirrored", [False, True], ids=["as Eqs. (8)-(24)", "as Eq. (4)"])
MODES = pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev], ids=["forward", "reverse"])
HOME = np.zeros(6)


def many(function, robot, rows, *more):
    return np.asarray(jax.jit(jax.vmap(function, in_axes=(None, *[0] * (1 + len(more)))))(robot, rows, *more))


# --- geometry and equations ---


@MIRRORED
@pytest.mark.parametrize("side", [1.0, 0.35])
def test_joints_and_passive_joints_are_coordinates_of_the_corners(side, mirrored):
    rng, robot = np.random.default_rng(0), ppps3.create(side, mirrored=mirrored)
    poses = checks.random_poses(rng, 2000, 2.0)
    joints = checks.ppps3_joints(poses, side, mirrored)
    branches = checks.inverse_many(robot, poses)
    np.testing.assert_allclose(branches.values[:, 0], joints, atol=2e-15)
    assert np.all(branches.status == jk.Status.OK)
    passive = many(ppps3.passive_joints, robot, poses)
    np.testing.assert_allclose(passive, checks.ppps3_passive(poses, side, mirrored), atol=2e-15)
    assert np.abs(many(jk.constraints, robot, poses, joints)).max() < 1e-14


def test_home():
    # Chablat et al. 2018 at phi = theta = sigma = 0: Eqs. (20)-(24) give 0 and +-sqrt3/2.
    found = jk.inverse(ppps3.create(), HOME)
    np.testing.assert_allclose(found.values[0], checks.HOME_JOINTS, atol=1e-16)
    np.testing.assert_allclose(ppps3.passive_joints(ppps3.create(), HOME), [0, -0.5, -0.5], atol=1e-16)
    np.testing.assert_allclose(ppps3.passive_joints(ppps3.create(mirrored=True), HOME), [0, 0.5, 0.5], atol=1e-16)


def test_printed_inverse_kinematics():
    # Eqs. (20)-(24), written out by the angles.
    rng = np.random.default_rng(1)
    poses = checks.random_poses(rng, 500)
    x, y, z, phi, theta, sigma = poses.T
    cp, sp, ct, st_, cs, ss = np.cos(phi), np.sin(phi), np.cos(theta), np.sin(theta), np.cos(sigma), np.sin(sigma)
    r11, r12 = ct * cs, -ct * ss
    r31, r32 = sp * ss - cp * st_ * cs, cp * st_ * ss + sp * cs
    wanted = [y, z, (checks.ROOT3 * r11 + r12) / 2 - x, z - (checks.ROOT3 * r31 + r32) / 2]
    wanted += [x - (checks.ROOT3 * r11 - r12) / 2, z - (checks.ROOT3 * r31 - r32) / 2]
    found = checks.inverse_many(ppps3.create(), poses).values[:, 0]
    np.testing.assert_allclose(found, np.stack(wanted, axis=1), atol=1e-15)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("side", [1.0, 2.5])
def test_change_of_variables(side, mirrored):
    # Eqs. (12)-(15) as corrected satisfy (16)-(19): R12 = mu3y, R31 = -(mu2z + mu3z) / sqrt3, R32 = mu3z - mu2z,
    # x' = (sqrt3 R11 + R12) / 2, in units of the side; y' = z' = 0, and the passive ones are R21, R22 alone.
    rng, robot = np.random.default_rng(2), ppps3.create(side, mirrored=mirrored)
    poses = checks.random_poses(rng, 1000, 3.0)
    joints = checks.ppps3_joints(poses, side, mirrored)
    found = jax.vmap(lambda p, q: ppps3.reduced(robot, p, q))(jnp.asarray(poses), jnp.asarray(joints))
    m, r = (-1 if mirrored else 1), checks.matrices(poses)
    (mu2z, mu3y, mu3z), (mu1x, mu2x, mu3x) = np.asarray(found.joints).T / side, np.asarray(found.passive).T / side
    np.testing.assert_allclose(mu3y, m * r[:, 0, 1], atol=1e-14)
    np.testing.assert_allclose(-(mu2z + mu3z) / checks.ROOT3, r[:, 2, 0], atol=1e-14)
    np.testing.assert_allclose(m * (mu3z - mu2z), r[:, 2, 1], atol=1e-14)
    first = (checks.ROOT3 * r[:, 0, 0] + m * r[:, 0, 1]) / 2
    np.testing.assert_allclose(
        np.asarray(found.position) / side, np.stack([first, 0 * first, 0 * first], 1), atol=1e-14
    )
    np.testing.assert_allclose(mu1x, first, atol=1e-14)
    np.testing.assert_allclose(mu2x, -(checks.ROOT3 * r[:, 1, 0] + m * r[:, 1, 1]) / 2, atol=1e-14)
    np.testing.assert_allclose(mu3x, (checks.ROOT3 * r[:, 1, 0] - m * r[:, 1, 1]) / 2, atol=1e-14)
    np.testing.assert_array_equal(ppps3.reduced_joints(joints), found.joints)


def test_axes():
    # theta is an interval, no circle: all rotations are reached with it in [-pi/2, pi/2].
    axes = {axis.name: axis for axis in ppps3.PPPS3.pose_axes}
    assert [axis.period for axis in axes.values()] == [None] * 3 + [2 * math.pi, None, 2 * math.pi]
    assert (axes["theta"].low, axes["theta"].high) == (-math.pi / 2, math.pi / 2)
    assert all(axis.unit == "length" for axis in ppps3.PPPS3.joint_axes)


# --- conversions ---


def test_conversions_of_random_rotations():
    rng = np.random.default_rng(3)
    wanted, place = checks.random_rotations(rng, 3000), rng.uniform(-1, 1, (3000, 3))
    poses = np.asarray(jax.jit(jax.vmap(ppps3.pose_from_rotation))(place, wanted))
    assert checks.rotation_gap(checks.matrices(poses), wanted).max() < 5e-15
    assert np.all(np.abs(poses[:, 4]) <= np.pi / 2)
    assert np.all((poses[:, [3, 5]] >= -np.pi) & (poses[:, [3, 5]] < np.pi))
    position, rotation = jax.vmap(ppps3.position_and_rotation)(poses)
    np.testing.assert_array_equal(position, place)
    assert checks.rotation_gap(np.asarray(rotation), wanted).max() < 5e-15
    position, quaternion = jax.jit(jax.vmap(ppps3.position_and_quaternion))(poses)
    assert np.all(np.asarray(quaternion)[:, 0] >= 0)
    np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1, atol=1e-15)
    factor = rng.choice([-1, 1], (3000, 1)) * 10 ** rng.uniform(-300, 300, (3000, 1))
    again = jax.jit(jax.vmap(ppps3.pose_from_quaternion))(position, quaternion * factor)
    assert checks.rotation_gap(checks.matrices(np.asarray(again)), wanted).max() < 5e-15


@pytest.mark.parametrize("lock", [0.0, 1e-16, 1e-12, 1e-9, 1e-6, 1e-3])
def test_conversions_at_and_next_to_gimbal_lock(lock):
    rng = np.random.default_rng(4)
    poses = checks.random_poses(rng, 400)
    poses[:, 4] = rng.choice([-1, 1], 400) * (np.pi / 2 - lock)
    wanted = checks.matrices(poses)
    if lock == 0:
        # cos(pi / 2) is not zero in floats; this is the exact lock.
        turn = poses[:, 3] + np.sign(poses[:, 4]) * poses[:, 5]
        c, s, up, o = np.cos(turn), np.sin(turn), np.sign(poses[:, 4]), 0 * turn
        wanted = np.moveaxis(np.array([[o, o, up], [up * s, c, o], [-up * c, s, o]]), -1, 0)
    back = np.asarray(jax.jit(jax.vmap(ppps3.pose_from_rotation))(poses[:, :3], wanted))
    assert checks.rotation_gap(checks.matrices(back), wanted).max() < 1e-15 * 8
    if lock == 0:
        assert np.all(back[:, 5] == 0)
        np.testing.assert_allclose(np.abs(back[:, 4]), np.pi / 2)
    _, quaternion = jax.jit(jax.vmap(ppps3.position_and_quaternion))(back)
    again = np.asarray(jax.jit(jax.vmap(ppps3.pose_from_quaternion))(poses[:, :3], quaternion))
    assert checks.rotation_gap(checks.matrices(again), wanted).max() < 1e-15 * 8
    slopes = jax.jit(jax.vmap(jax.jacrev(ppps3.pose_from_rotation, argnums=1)))(poses[:, :3], wanted)
    assert np.isfinite(np.asarray(slopes)).all()


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(v * v for v in q) > 1e-6))
@settings(max_examples=40)
def test_quaternions_turn_vectors_as_they_should(q):
    # v' = q v q*, by Hamilton's product.
    w, u = q[0], np.array(q[1:])
    pose = ppps3.pose_from_quaternion(np.zeros(3), q)
    for v in np.eye(3):
        wanted = (w * w - u @ u) * v + 2 * (u @ v) * u + 2 * w * np.cross(u, v)
        np.testing.assert_allclose(checks.matrices(pose) @ v * (w * w + u @ u), wanted, atol=1e-14)


@pytest.mark.parametrize(
    ("matrix", "words"),
    [
        (np.diag([1.0, 1.0, -1.0]), ["reflection", "det = -1"]),
        (-np.eye(3), ["reflection"]),
        (2 * np.eye(3), ["off by 3", "orthonormalise"]),
        (np.eye(3) + 1e-6 * np.eye(3, k=1), ["off by 1e-06"]),
        (np.zeros((3, 3)), ["off by 1", "no rotation"]),
        (np.full((3, 3), np.nan), ["off by nan"]),
        (np.full((3, 3), np.inf), ["no rotation"]),
        (np.eye(2), [r"(2, 2)", "(3, 3)"]),
        (np.eye(3)[None], ["(1, 3, 3)", "vmap"]),
    ],
)
def test_what_is_no_rotation_is_refused(matrix, words):
    with pytest.raises(jk.InputError) as error:
        ppps3.pose_from_rotation(np.zeros(3), matrix)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("position", "quaternion", "word"),
    [
        (np.zeros(3), np.zeros(4), "not zero"),
        (np.zeros(3), (math.nan, 0, 0, 1), "finite"),
        (np.zeros(3), (math.inf, 0, 0, 1), "finite"),
        (np.zeros(3), (1, 0, 0), "(3,)"),
        (np.zeros(2), (1, 0, 0, 0), "(2,)"),
        (np.zeros(3), np.ones((2, 4)), "vmap"),
    ],
)
def test_what_is_no_quaternion_is_refused(position, quaternion, word):
    with pytest.raises(jk.InputError) as error:
        ppps3.pose_from_quaternion(position, quaternion)
    assert word in str(error.value)


@pytest.mark.parametrize(
    "call",
    [
        lambda v: ppps3.passive_joints(ppps3.create(), v),
        lambda v: ppps3.twist_jacobian(ppps3.create(), v),
        lambda v: ppps3.reduced(ppps3.create(), v, np.zeros(6)),
        lambda v: ppps3.reduced(ppps3.create(), np.zeros(6), v),
        ppps3.reduced_joints,
        ppps3.position_and_rotation,
        ppps3.position_and_quaternion,
    ],
)
@pytest.mark.parametrize("shape", [(3,), (5,), (7,), ()])
def test_wrong_shapes_are_refused(call, shape):
    with pytest.raises(jk.InputError, match=r"\(6,\)"):
        call(np.zeros(shape))


# --- Jacobians ---


@MIRRORED
def test_determinants_factorise(mirrored):
    rng, side = np.random.default_rng(5), 1.3
    robot = ppps3.create(side, mirrored=mirrored)
    poses = checks.random_poses(rng, 500)
    r22, r33 = (checks.matrices(poses)[:, k, k] for k in (1, 2))
    twist = np.linalg.det(many(ppps3.twist_jacobian, robot, poses))
    np.testing.assert_allclose(twist, checks.ROOT3 / 2 * side**3 * r22 * r33, atol=1e-14)
    direct = jax.vmap(lambda p, q: jk.jacobians(robot, p, q).direct)(
        jnp.asarray(poses), jnp.asarray(checks.ppps3_joints(poses, side, mirrored))
    )
    # Eq. (29) times 8 sqrt3 s^3; R33 holds one of the two cos(theta), the other is the Euler angles'.
    phi, theta, sigma = poses[:, 3:].T
    printed = np.sin(phi) * np.sin(theta) * np.sin(sigma) - np.cos(phi) * np.cos(sigma)
    printed = printed * np.cos(phi) * np.cos(theta) ** 2
    np.testing.assert_allclose(np.linalg.det(direct), 8 * checks.ROOT3 * side**3 * printed, atol=1e-13)
    factors = jax.vmap(robot.factors)(jnp.asarray(poses))
    chart = jax.vmap(robot.chart_factors)(jnp.asarray(poses))
    np.testing.assert_allclose(factors["R22"], r22, atol=1e-15)
    np.testing.assert_allclose(factors["R33"], r33, atol=1e-15)
    product = -chart["cos(theta)"] * factors["R22"] * factors["R33"]
    np.testing.assert_allclose(product, printed, atol=1e-15)
    assert (set(factors), set(chart)) == ({"R22", "R33"}, {"cos(theta)"})


def test_gimbal_lock_is_singular_already():
    # cos(theta) = 0 forces R33 = 0: the Euler angles are regular inside every aspect.
    rng, robot = np.random.default_rng(6), ppps3.create()
    poses = checks.random_poses(rng, 100)
    poses[:, 4] = rng.choice([-1, 1], 100) * np.pi / 2
    values = jax.vmap(robot.factors)(jnp.asarray(poses))
    assert np.abs(values["R33"]).max() < 1e-16
    assert np.abs(values["R22"]).max() > 0.5


@MIRRORED
def test_jacobian_with_respect_to_the_twist(mirrored):
    # Joints moved along v and exp(omega t) R, by differences; at home det J = sqrt3 / 2.
    rng, side = np.random.default_rng(7), 0.8
    robot = ppps3.create(side, mirrored=mirrored)
    poses = checks.random_poses(rng, 50)
    own = checks.corners(np.zeros(6), side, mirrored)

    def joints_of(position, rotation):
        w = position[:, None] + own @ np.swapaxes(rotation, 1, 2)
        return np.stack([w[:, 0, 1], w[:, 0, 2], -w[:, 1, 0], w[:, 1, 2], w[:, 2, 0], w[:, 2, 2]], axis=1)

    found, rotation, step = many(ppps3.twist_jacobian, robot, poses), checks.matrices(poses), 1e-5
    for k in range(3):
        unit = np.eye(3)[k]
        turn = checks.matrices(np.concatenate([np.zeros(3), step * unit]))
        moved = joints_of(poses[:, :3] + step * unit, rotation) - joints_of(poses[:, :3] - step * unit, rotation)
        np.testing.assert_allclose(found[:, :, k], moved / (2 * step), atol=1e-10)
        moved = joints_of(poses[:, :3], turn @ rotation) - joints_of(poses[:, :3], turn.T @ rotation)
        np.testing.assert_allclose(found[:, :, 3 + k], moved / (2 * step), atol=1e-9)
    assert np.linalg.det(ppps3.twist_jacobian(ppps3.create(), HOME)) == pytest.approx(checks.ROOT3 / 2, rel=1e-14)


@MIRRORED
def test_jacobians_of_pose_and_twist_agree(mirrored):
    # d(joints)/d(pose) = J diag(1, E), and it is -B^-1 A of the constraints.
    rng, robot = np.random.default_rng(8), ppps3.create(1.4, mirrored=mirrored)
    poses = checks.random_poses(rng, 200)
    twist = many(ppps3.twist_jacobian, robot, poses)
    rates = jax.jit(jax.vmap(jax.jacrev(lambda p: jk.inverse(robot, p).values[0])))(jnp.asarray(poses))
    for pose, j, found in zip(poses, twist, np.asarray(rates), strict=True):
        wide = np.eye(6)
        wide[3:, 3:] = checks.euler_rates(pose)
        np.testing.assert_allclose(found, j @ wide, atol=1e-14)
    joints = checks.ppps3_joints(poses, 1.4, mirrored)
    direct, inverse = jax.vmap(lambda p, q: jk.jacobians(robot, p, q))(jnp.asarray(poses), jnp.asarray(joints))
    np.testing.assert_allclose(-np.linalg.solve(inverse, direct), rates, atol=1e-13)


# --- derivatives ---


def regular_poses(n=12):
    """Returns home and poses well inside all four aspects."""
    poses = checks.random_poses(np.random.default_rng(9), 200)
    r = checks.matrices(poses)
    poses = poses[(np.abs(r[:, 1, 1]) > 0.3) & (np.abs(r[:, 2, 2]) > 0.3)][: n - 1]
    r = checks.matrices(poses)
    assert len(np.unique(np.sign(r[:, [1, 2], [1, 2]]), axis=0)) == 4
    return np.concatenate([HOME[None], poses])


def lane_of(pose):
    r22, r33 = checks.matrices(pose)[[1, 2], [1, 2]]
    return 2 * int(r22 < 0) + int(r33 < 0)


@MIRRORED
@MODES
def test_forward_derivative_is_the_inverse_of_the_jacobian(mode, mirrored):
    robot = ppps3.create(mirrored=mirrored)
    derivative = jax.jit(jax.vmap(mode(lambda q: jk.forward(robot, q).values)))
    poses = regular_poses()
    slopes = np.asarray(derivative(checks.ppps3_joints(poses, 1.0, mirrored)))
    assert np.isfinite(slopes).all()
    for pose, slope in zip(poses, slopes, strict=True):
        wide = np.eye(6)
        wide[3:, 3:] = checks.euler_rates(pose)
        product = np.asarray(ppps3.twist_jacobian(robot, pose)) @ wide @ slope[lane_of(pose)]
        np.testing.assert_allclose(product, np.eye(6), atol=1e-12)


def parameters_to_poses(parameters):
    # The three other modes at home have angles of pi, where the angles themselves jump.
    values = jk.forward(ppps3.create(parameters[0]), parameters[1:]).values
    return jnp.concatenate([values[:, :3], jnp.cos(values[:, 3:]), jnp.sin(values[:, 3:])], axis=1)


def parameters_to_frames(parameters):
    frames = jk.forward_frames(ppps3.create(parameters[0]), parameters[1:])
    return jnp.concatenate([frames.position, frames.rotation.reshape(4, 9)], axis=1)


@pytest.mark.parametrize("function", [parameters_to_poses, pytest.param(parameters_to_frames, marks=pytest.mark.slow)])
def test_first_and_second_derivatives_equal_differences(function):
    # At home, where the paper's arccosines have infinite slopes, and elsewhere; side and joints together.
    values = jax.jit(jax.vmap(function))
    first = {mode: jax.jit(jax.vmap(mode(function))) for mode in (jax.jacfwd, jax.jacrev)}
    second = {"forward over reverse": jax.jit(jax.vmap(jax.jacfwd(jax.jacrev(function))))}
    poses = regular_poses()[:3]
    points = np.concatenate([np.ones((3, 1)), checks.ppps3_joints(poses)], axis=1)
    slopes = {mode: np.asarray(f(points)) for mode, f in first.items()}
    curvatures = {modes: np.asarray(f(points)) for modes, f in second.items()}
    for k, point in enumerate(points):
        wanted = checks.central_differences(values, point, np.full(7, 2e-4))
        bends = checks.central_differences(first[jax.jacfwd], point, np.full(7, 2e-4))
        for found in slopes.values():
            np.testing.assert_allclose(found[k], wanted, atol=1e-8 * np.abs(wanted).max())
        for found in curvatures.values():
            np.testing.assert_allclose(found[k], bends, atol=1e-8 * np.abs(bends).max())
            np.testing.assert_allclose(found[k], np.swapaxes(found[k], -1, -2), atol=1e-11 * np.abs(bends).max())


def test_frames_have_the_derivatives_of_the_poses():
    robot, joints = ppps3.create(), jnp.asarray(checks.ppps3_joints(regular_poses()[3]))

    def by_angles(q):
        values = jk.forward(robot, q).values
        return jax.vmap(ppps3.position_and_rotation)(values)

    def by_frames(q):
        frames = jk.forward_frames(robot, q)
        return frames.position, frames.rotation

    found, wanted = (jax.jit(jax.jacrev(f))(joints) for f in (by_frames, by_angles))
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize("solve", [jk.forward, jk.forward_frames])
def test_empty_and_singular_lanes_do_not_poison_the_gradient(solve):
    # A batch of regular, impossible, exactly singular, self-moving and invalid joints: the gradient with respect to
    # the robot is that of the regular ones.
    home = np.array(checks.HOME_JOINTS)
    bad = [home + 5 * np.eye(6)[1], np.array([0, 0, 0, 0, 1.0, 0]), np.array([0, 0, 0, -0.5, 0, 0.5]), home * math.nan]
    regular = np.stack([home, checks.ppps3_joints(regular_poses()[2])])

    def total(robot, joints):
        found = jax.vmap(solve, in_axes=(None, 0))(robot, joints)
        values = found.values if isinstance(found, jk.Branches) else found.rotation.reshape(*found.status.shape, 9)
        keep = found.valid & (found.status == jk.Status.OK)
        # No sum of rows and columns: those of a rotation have constant lengths.
        weights = jnp.arange(1.0, 4 * values.shape[-1] + 1).reshape(4, -1) ** 2
        return jnp.sum(jnp.where(keep[..., None], values, 0.0) ** 2 * weights)

    gradient = jax.jit(jax.grad(total, argnums=(0, 1)))
    wanted, slopes = gradient(ppps3.create(), jnp.asarray(regular))
    found, mixed = gradient(ppps3.create(), jnp.asarray(np.concatenate([regular, bad])))
    assert abs(float(wanted.side)) > 0.1
    assert float(found.side) == pytest.approx(float(wanted.side), rel=1e-12)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(found))
    np.testing.assert_allclose(mixed[:2], slopes, atol=1e-13)
    np.testing.assert_array_equal(mixed[2:], np.zeros((4, 6)))


def test_gradient_is_shaped_like_the_robot():
    robot, joints = ppps3.create(), jnp.asarray(checks.HOME_JOINTS)
    slope = jax.jit(jax.grad(lambda r: jk.forward(r, joints).values[0, 0]))(robot)
    # At fixed joints and R12 = R31 = R32 = 0 the rotation stays, and x = s sqrt3 / 2 - rho2y.
    assert float(slope.side) == pytest.approx(checks.ROOT3 / 2, rel=1e-14)
    assert float(slope.base_radius) == 0
    assert slope.passive_limits.low.shape == (3,)


def test_create_is_traceable():
    def x(side):
        return jk.forward(ppps3.create(side), jnp.asarray(checks.HOME_JOINTS)).values[0, 0]

    assert float(jax.jit(jax.grad(x))(1.0)) == pytest.approx(checks.ROOT3 / 2)
    status = jax.jit(lambda side: jk.forward(ppps3.create(side), jnp.asarray(checks.HOME_JOINTS)).status)
    assert set(np.asarray(status(-1.0))) == {jk.Status.INVALID_GEOMETRY}
    np.testing.assert_allclose(
        jax.jit(jax.vmap(x))(jnp.array([1.0, 2.0])), checks.ROOT3 / 2 * np.array([0, 1.0]), atol=1e-15
    )


# --- margins and conditioning ---


def test_margins_of_active_and_passive_joints():
    limits = jk.Limits(jnp.array([-1.0, -1, -1, -1, -1, -1]), jnp.array([1.0, 1, 0.5, 1, 1, jnp.inf]))
    passive = jk.Limits(jnp.array([-0.25, -0.75, -0.125]), jnp.array([0.5, 1.0, 1.0]))
    robot = ppps3.create(limits=limits, passive_limits=passive)
    found = {k: float(v) for k, v in jk.margins(robot, HOME, checks.HOME_JOINTS).items()}
    names = (*(axis.name for axis in robot.joint_axes), "rho1x", "rho2x", "rho3x")
    assert list(found) == [f"{name}_{end}" for name in names for end in ("low", "high")]
    assert found["rho2y_high"] == pytest.approx(0.5 - checks.ROOT3 / 2)
    assert found["rho2y_low"] == pytest.approx(1 + checks.ROOT3 / 2)
    assert found["rho3z_high"] == math.inf
    assert [found[f"rho1x_{end}"] for end in ("low", "high")] == [0.25, 0.5]
    assert [found[f"rho2x_{end}"] for end in ("low", "high")] == [0.25, 1.5]
    # rho3x = -1/2 violates its lower limit -1/8.
    assert found["rho3x_low"] == -0.375
    assert {robot.margin_unit(name) for name in found} == {"length"}


def test_conditioning_in_units_of_the_side():
    rng, pose = np.random.default_rng(10), checks.random_poses(np.random.default_rng(11), 1)[0]
    small, large = (
        jk.conditioning(ppps3.create(s), pose * [s, s, s, 1, 1, 1], checks.ppps3_joints(pose * [s, s, s, 1, 1, 1], s))
        for s in (1.0, 1e4 * float(rng.uniform(1, 2)))
    )
    assert float(large.smallest_singular_value) == pytest.approx(float(small.smallest_singular_value), rel=1e-10)
    assert float(large.inverse_condition_number) == pytest.approx(float(small.inverse_condition_number), rel=1e-10)
    home = jk.conditioning(ppps3.create(), HOME, checks.HOME_JOINTS)
    assert float(home.determinant) == pytest.approx(-8 * checks.ROOT3, rel=1e-14)


# --- constructors ---


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"side": 0.0}, ["side", "0", "positive"]),
        ({"side": -2.0}, ["side", "-2", "positive"]),
        ({"side": math.nan}, ["side", "nan", "finite"]),
        ({"side": [1.0, 0.0]}, ["side", "positive"]),
        ({"side": "x"}, ["side", "'x'", "number"]),
        ({"base_radius": 0.0}, ["base_radius", "0", "positive"]),
        ({"base_radius": -1.0}, ["base_radius", "-1", "positive"]),
        ({"side": [1.0, 2.0], "base_radius": [1.0, 2.0, 3.0]}, ["shapes", "side (2,)"]),
        ({"limits": jk.Limits.lengths(6, 1.0, 0.0)}, ["limits", "not greater"]),
        ({"limits": jk.Limits.lengths(3)}, ["limits", "6 low"]),
        ({"passive_limits": jk.Limits.lengths(3, 1.0, 0.0)}, ["passive_limits", "not greater"]),
        ({"passive_limits": jk.Limits.none(6)}, ["passive_limits", "3 low"]),
        ({"passive_limits": (0.0, 1.0)}, ["passive_limits", "jaxkin.Limits"]),
    ],
)
def test_create_refuses(arguments, words):
    with pytest.raises(jk.GeometryError) as error:
        ppps3.create(**arguments)
    for word in words:
        assert word in str(error.value)
