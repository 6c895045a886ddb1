"""The 3-PPPS' aspects and its joints with four solutions in closed form, against the robot's own equations."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxkin.core.errors import InputError
from jaxkin.mechanisms import ppps3
from jaxkin.mechanisms import ppps3_closed_forms as closed
from jaxkin.numerics import rotations

RIGHT = math.pi / 2
right_angles = st.one_of(st.floats(-RIGHT, RIGHT), st.sampled_from([0.0, RIGHT, -RIGHT, 1e-12, RIGHT - 1e-9]))


def r22(phi, theta, sigma):
    return jnp.cos(phi) * jnp.cos(sigma) - jnp.sin(phi) * jnp.sin(theta) * jnp.sin(sigma)


@pytest.fixture(scope="module")
def robot() -> ppps3.PPPS3:
    return ppps3.create(1.3)


@given(phi=right_angles, theta=right_angles)
def test_the_interval_ends_where_r22_vanishes_and_has_the_length_pi(phi: float, theta: float):
    low, high = (float(end) for end in closed.home_interval(phi, theta))
    assert high - low == pytest.approx(math.pi, abs=1e-15 * 4)
    assert abs(float(r22(phi, theta, low))) < 1e-15 * 3
    assert abs(float(r22(phi, theta, high))) < 1e-15 * 3
    assert -math.pi - 1e-15 <= low <= 1e-15
    assert -1e-15 <= high <= math.pi + 1e-15
    assert float(r22(phi, theta, (low + high) / 2)) >= 0


def test_the_interval_agrees_with_the_textbook_form_and_has_finite_derivatives():
    phi, theta = np.random.default_rng(1).uniform(-1.55, 1.55, (2, 500))
    low, high = closed.home_interval(phi, theta)
    delta = -np.arctan(np.tan(phi) * np.sin(theta))
    np.testing.assert_allclose(low, delta - RIGHT, atol=1e-14)
    np.testing.assert_allclose(high, delta + RIGHT, atol=1e-14)
    slope = jax.jacfwd(lambda angles: closed.home_interval(angles[0], angles[1])[1])
    for angles in ([RIGHT, 0.0], [RIGHT, 0.3], [-RIGHT, -0.1], [0.0, 0.0]):
        assert bool(jnp.isfinite(slope(jnp.array(angles))).all())


def test_aspects_are_numbered_as_the_forward_modes(robot: ppps3.PPPS3):
    rng = np.random.default_rng(2)
    poses = rng.uniform(-1, 1, (400, 6)) * np.array([2, 2, 2, math.pi, RIGHT, math.pi])
    number = np.asarray(closed.aspect_of(poses))
    factors = jax.vmap(robot.factors)(jnp.asarray(poses))
    expected = 2 * (np.asarray(factors["R22"]) < 0) + (np.asarray(factors["R33"]) < 0)
    np.testing.assert_array_equal(number, expected)
    assert set(number) == {0, 1, 2, 3}
    np.testing.assert_array_equal(closed.aspect_of(poses[:, 3:]), number)
    for r22_sign, r33_sign in closed.SIGNS:
        k = closed.SIGNS.index((r22_sign, r33_sign))
        assert robot.forward_labels[k] == f"R22 {'>' if r22_sign > 0 else '<'} 0, R33 {'>' if r33_sign > 0 else '<'} 0"
    singular = [
        [RIGHT, 0.1, 0.2],
        [0.3, RIGHT, 0.2],
        [0.0, 0.0, RIGHT],
        [0.3, -0.4, float(closed.home_interval(0.3, -0.4)[0])],
    ]
    np.testing.assert_array_equal(closed.aspect_of(singular), -1)


def test_home_is_where_the_interval_says():
    angles = np.random.default_rng(3).uniform(-1, 1, (4000, 3)) * np.array([math.pi, RIGHT, math.pi])
    phi, theta, sigma = angles.T
    low, high = (np.asarray(end) for end in closed.home_interval(phi, theta))
    inside = (np.abs(phi) < RIGHT) & (low < sigma) & (sigma < high)
    np.testing.assert_array_equal(np.asarray(closed.aspect_of(angles)) == 0, inside)
    assert inside.mean() == pytest.approx(0.25, abs=0.03)


def test_the_factors_in_the_chart_zxy_and_home_as_a_cube():
    angles = np.random.default_rng(4).uniform(-1, 1, (2000, 3)) * np.array([math.pi, RIGHT, math.pi])
    matrix = rotations.matrix_from_zxy(*angles.T)
    found = closed.zxy_factors(*angles.T)
    np.testing.assert_allclose(found[0], matrix[1][1], atol=1e-15)
    np.testing.assert_allclose(found[1], matrix[2][2], atol=1e-15)
    number = np.asarray(closed.aspect_of(np.stack(rotations.xyz_from_matrix(matrix), axis=-1)))
    np.testing.assert_array_equal(number == 0, (np.abs(angles) < RIGHT).all(axis=1))
    np.testing.assert_array_equal(number, 2 * (np.abs(angles[:, 0]) > RIGHT) + (np.abs(angles[:, 2]) > RIGHT))


def test_half_turns_from_the_left_exchange_the_aspects():
    angles = np.random.default_rng(5).uniform(-1, 1, (500, 3)) * np.array([math.pi, RIGHT, math.pi])
    matrix = np.asarray(rotations.as_array(rotations.matrix_from_xyz(*angles.T)))
    number = np.asarray(closed.aspect_of(angles))
    for diagonal, change in (([1, -1, -1], 3), ([-1, 1, -1], 1), ([-1, -1, 1], 2)):
        turned = rotations.from_array(jnp.asarray(np.diag(diagonal) @ matrix))
        new = np.asarray(closed.aspect_of(np.stack(rotations.xyz_from_matrix(turned), axis=-1)))
        np.testing.assert_array_equal(new, number ^ change)


def test_slices_are_a_square_in_the_middle_and_two_rectangles_at_the_ends():
    (middle,) = closed.home_slice(0.0)
    np.testing.assert_allclose([middle.theta[0], middle.theta[-1]], [-RIGHT, RIGHT])
    np.testing.assert_allclose(middle.low, -RIGHT)
    np.testing.assert_allclose(middle.high, RIGHT)
    for side in (1, -1):
        pieces = closed.home_slice(side * RIGHT)
        corners = [(p.theta.min(), p.theta.max(), p.low.min(), p.high.max()) for p in pieces]
        up, down = (0, math.pi), (-math.pi, 0)
        expected = [(-RIGHT, 0, *up), (0, RIGHT, *down)] if side > 0 else [(-RIGHT, 0, *down), (0, RIGHT, *up)]
        np.testing.assert_allclose(corners, expected, atol=1e-15)
        # A hair inside, at the middle of each rectangle, there is the home aspect, and beside it there is not.
        for t0, t1, s0, s1 in corners:
            place = [side * (RIGHT - 1e-6), (t0 + t1) / 2, (s0 + s1) / 2]
            assert int(closed.aspect_of(place)) == 0
            assert int(closed.aspect_of([place[0], place[1], -place[2]])) == 2
    for piece in closed.home_slice(1.5):
        assert np.abs(np.diff(piece.high)).max() < 1.0
        assert np.abs(r22(1.5, piece.theta, piece.low)).max() < 1e-15
    with pytest.raises(InputError, match="phi"):
        closed.home_slice(1.6)


def test_saddles_lie_on_the_surface_with_their_local_form():
    found = closed.saddles()
    assert [s.angles for s in found if s.printed] == [(RIGHT, 0.0, 0.0), (-RIGHT, 0.0, 0.0)]
    for saddle in found:
        gradient = np.array(jax.grad(lambda a: r22(*a))(jnp.array(saddle.angles)))
        hessian = np.array(jax.hessian(lambda a: r22(*a))(jnp.array(saddle.angles)))
        others = [k for k in range(3) if k != saddle.axis]
        assert abs(float(r22(*saddle.angles))) < 1e-15
        np.testing.assert_allclose(gradient[others], 0, atol=1e-15)
        assert abs(gradient[saddle.axis]) == pytest.approx(1.0)
        # The graph's second derivatives, by implicit differentiation: no squares, a product.
        graph = -hessian[np.ix_(others, others)] / gradient[saddle.axis]
        np.testing.assert_allclose(np.diag(graph), 0, atol=1e-15)
        assert graph[0, 1] == pytest.approx(saddle.product)


def test_feasibility_is_the_squared_factors(robot: ppps3.PPPS3):
    mirrored = ppps3.create(0.7, mirrored=True)
    poses = np.random.default_rng(6).uniform(-1, 1, (300, 6)) * np.array([2, 2, 2, math.pi, RIGHT, math.pi])
    for machine in (robot, mirrored):
        joints = jnp.stack(machine.inverse_kernel(tuple(jnp.asarray(poses.T)))[0].values, axis=-1)
        a, b = closed.feasibility(machine, ppps3.reduced_joints(joints))
        factors = jax.vmap(machine.factors)(jnp.asarray(poses))
        np.testing.assert_allclose(a, factors["R33"] ** 2, atol=2e-14)
        np.testing.assert_allclose(b, factors["R22"] ** 2, atol=2e-14)


def test_joints_from_the_cube_are_the_inverse_kinematics(robot: ppps3.PPPS3):
    angles = np.random.default_rng(7).uniform(-RIGHT, RIGHT, (200, 3))
    for machine in (robot, ppps3.create(0.7, mirrored=True)):
        xyz = rotations.xyz_from_matrix(rotations.matrix_from_zxy(*angles.T))
        pose = (0.3 * jnp.ones(200), 0.1 * jnp.ones(200), -2 * jnp.ones(200), *xyz)
        joints = jnp.stack(machine.inverse_kernel(pose)[0].values, axis=-1)
        np.testing.assert_allclose(closed.joints_from_zxy(machine, *angles.T), ppps3.reduced_joints(joints), atol=5e-15)


def test_the_cubes_faces_are_the_boundary(robot: ppps3.PPPS3):
    one, two = np.random.default_rng(8).uniform(-RIGHT, RIGHT, (2, 100))
    for side in (RIGHT, -RIGHT):
        a, b = closed.feasibility(robot, closed.joints_from_zxy(robot, side, one, two))
        assert np.abs(b).max() < 1e-15
        assert (np.asarray(a) > -1e-15).all()
        a, b = closed.feasibility(robot, closed.joints_from_zxy(robot, one, two, side))
        assert np.abs(a).max() < 2e-15
        assert (np.asarray(b) > -1e-15).all()
        np.testing.assert_allclose(
            closed.joints_from_zxy(robot, one, side, two) - 1.3 * np.sign(side) * np.array([-0.5, 0, 0.5]),
            0,
            atol=1e-15,
        )


def test_the_volume_of_the_joints_is_exact_differentiable_and_what_counting_says(robot: ppps3.PPPS3):
    assert float(closed.joints_volume(ppps3.create())) == pytest.approx(8 / math.sqrt(3), abs=1e-12)
    assert float(closed.joints_volume(robot, nodes=10)) == pytest.approx(8 / math.sqrt(3) * 1.3**3, rel=1e-9)
    slope = jax.grad(closed.joints_volume)(robot).side
    assert float(slope) == pytest.approx(3 * 8 / math.sqrt(3) * 1.3**2, rel=1e-12)
    # Independent: the share of a box in which the robot counts four modes.
    n = 60
    ticks = 1.3 * ((np.arange(n) + 0.5) / n * 2 - 1) * 1.05
    m2, p, m3 = (axis.ravel() for axis in np.meshgrid(ticks, ticks, ticks, indexing="ij"))
    zero = jnp.zeros(n**3)
    count = robot.count_kernel((zero, zero, zero, jnp.asarray(m2), jnp.asarray(p), jnp.asarray(m3)))
    box = (2 * 1.3 * 1.05) ** 3
    assert float((count.number == 4).mean()) * box == pytest.approx(8 / math.sqrt(3) * 1.3**3, rel=5e-3)


def test_singular_rotations_nearest_to_home():
    turn = np.linspace(-math.pi, math.pi, 50)
    for factor, (i, axis) in {"R22": (1, 1), "R33": (2, 2)}.items():
        found = np.asarray(closed.nearest_singular_rotation(factor, turn))
        np.testing.assert_allclose(found[:, i, i], 0, atol=5e-16)
        np.testing.assert_allclose(np.swapaxes(found, 1, 2) @ found - np.eye(3), 0, atol=1e-15)
        angle = rotations.rotation_angle(rotations.from_array(jnp.asarray(found)))
        np.testing.assert_allclose(angle, RIGHT, atol=1e-15)
        vector = found[:, [2, 0, 1], [1, 2, 0]] - found[:, [1, 2, 0], [2, 0, 1]]
        np.testing.assert_allclose(vector[:, axis], 0, atol=1e-15)
    with pytest.raises(InputError, match="factor"):
        closed.nearest_singular_rotation("R11", 0.0)
