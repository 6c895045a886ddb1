"""Rotations: round trips and derivatives at random, nearly singular and singular rotations; SciPy is the oracle."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from jaxkin.numerics import rotations

RIGHT = math.pi / 2
#: Distances from a singular rotation, down to rounding and to nothing.
NEAR = (0.0, 1e-17, 1e-12, 1e-9, 1e-6, 1e-3)
angles = st.floats(-math.pi, math.pi, exclude_max=True)
small = st.sampled_from([sign * value for value in NEAR for sign in (1, -1)])
TRIPLES = {
    "xyz": (rotations.matrix_from_xyz, rotations.xyz_from_matrix, "XYZ", 1),
    "zxy": (rotations.matrix_from_zxy, rotations.zxy_from_matrix, "ZXY", 1),
}

as_array = jax.jit(rotations.as_array)


def random(count: int, seed: int) -> np.ndarray:
    return Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()


def mapped(function, matrices: np.ndarray) -> np.ndarray:
    return np.stack(jax.jit(function)(rotations.from_array(jnp.asarray(matrices))), axis=-1)


@pytest.mark.parametrize("chart", TRIPLES)
def test_triples_of_angles_are_those_of_scipy_and_come_back(chart: str):
    make, take, order, middle = TRIPLES[chart]
    matrices = random(2000, 1)
    found = mapped(take, matrices)
    np.testing.assert_allclose(found, Rotation.from_matrix(matrices).as_euler(order), atol=2e-13)
    assert (np.abs(found) <= math.pi).all()
    assert (np.abs(found[:, middle]) <= RIGHT).all()
    np.testing.assert_allclose(as_array(make(*found.T)), matrices, atol=5e-15)


@pytest.mark.parametrize("chart", TRIPLES)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_matrix_comes_back_at_gimbal_lock_and_near_it(chart: str, side: float):
    make, take, _, middle = TRIPLES[chart]
    rng = np.random.default_rng(3)
    triple = rng.uniform(-math.pi, math.pi, (600, 3))
    triple[:, middle] = side * (RIGHT - np.repeat(NEAR, 100))
    matrices = np.asarray(as_array(make(*triple.T)))
    found = mapped(take, matrices)
    np.testing.assert_allclose(as_array(make(*found.T)), matrices, atol=2e-15)


@pytest.mark.parametrize("chart", TRIPLES)
def test_at_exact_gimbal_lock_one_angle_is_zero(chart: str):
    _, take, _, middle = TRIPLES[chart]
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    # xyz: R13 = 1, R21..R32 a turn; the axes of zxy are renamed.
    matrix = np.zeros((3, 3))
    order = (0, 1, 2) if chart == "xyz" else (2, 0, 1)
    plain = np.array([[0.0, 0.0, 1.0], [*quarter[0], 0.0], [*quarter[1], 0.0]])
    matrix[np.ix_(order, order)] = plain
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    found = mapped(take, matrix)
    assert found[middle] == pytest.approx(RIGHT)
    assert found[2] == 0.0


@pytest.mark.parametrize("chart", TRIPLES)
@pytest.mark.parametrize("near", NEAR)
def test_derivatives_are_finite_everywhere(chart: str, near: float):
    make, take, _, _ = TRIPLES[chart]

    def there_and_back(triple: jax.Array) -> jax.Array:
        return jnp.stack(take(make(*triple)))

    triple = jnp.array([0.4, RIGHT - near, -0.9])
    first = jax.jacfwd(there_and_back)(triple)
    assert bool(jnp.isfinite(first).all())
    assert bool(jnp.isfinite(jax.jacrev(there_and_back)(triple)).all())


@pytest.mark.parametrize("chart", TRIPLES)
def test_derivatives_are_right_away_from_gimbal_lock(chart: str):
    make, take, _, _ = TRIPLES[chart]
    jacobian = jax.jit(jax.jacfwd(lambda triple: jnp.stack(take(make(*triple)))))
    for triple in ([0.4, 1.2, -0.9], [0.0, 0.0, 0.0], [3.0, -1.5, 2.0], [-3.1, 0.3, -3.1]):
        np.testing.assert_allclose(jacobian(jnp.array(triple)), np.eye(3), atol=1e-13)


def test_matrices_from_angles_are_products_of_turns():
    rng = np.random.default_rng(5)
    triple = rng.uniform(-4, 4, (3, 500))
    for make, _, order, _ in TRIPLES.values():
        expected = Rotation.from_euler(order, triple.T).as_matrix()
        np.testing.assert_allclose(as_array(make(*triple)), expected, atol=1e-14)


def test_quaternions_come_back_and_are_those_of_scipy():
    matrices = random(2000, 6)
    found = mapped(rotations.quaternion_from_matrix, matrices)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-15)
    assert (found[:, 0] >= 0).all()
    expected = Rotation.from_matrix(matrices).as_quat(canonical=True, scalar_first=True)
    np.testing.assert_allclose(found, expected, atol=1e-14)
    back = as_array(rotations.matrix_from_quaternion(tuple(jnp.asarray(found.T))))
    np.testing.assert_allclose(back, matrices, atol=2e-15)


def test_both_quaternions_of_a_rotation_and_all_lengths_give_it():
    quaternions = np.random.default_rng(7).normal(size=(4, 300))
    plain = as_array(rotations.matrix_from_quaternion(tuple(quaternions)))
    np.testing.assert_array_equal(as_array(rotations.matrix_from_quaternion(tuple(-quaternions))), plain)
    for length in (1e-8, 3.0, 1e8):
        np.testing.assert_allclose(
            as_array(rotations.matrix_from_quaternion(tuple(length * quaternions))), plain, atol=2e-15
        )
    np.testing.assert_allclose(np.linalg.det(plain), 1.0, atol=1e-14)


@given(axis=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda a: sum(x * x for x in a) > 1e-4), off=small)
def test_quaternions_near_half_turns(axis: tuple[float, float, float], off: float):
    vector = np.array(axis) / np.linalg.norm(axis) * (math.pi - abs(off))
    matrix = Rotation.from_rotvec(vector).as_matrix()
    q = np.array(rotations.quaternion_from_matrix(rotations.from_array(jnp.asarray(matrix))))
    back = as_array(rotations.matrix_from_quaternion(tuple(jnp.asarray(q))))
    np.testing.assert_allclose(back, matrix, atol=3e-15)
    assert q[0] >= 0


def test_the_derivative_of_quaternions_is_finite_at_every_branch():
    @jax.jit
    @jax.jacfwd
    def slope(matrix: jax.Array) -> jax.Array:
        return jnp.stack(rotations.quaternion_from_matrix(rotations.from_array(matrix)))

    for matrix in (np.eye(3), np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])):
        assert bool(jnp.isfinite(slope(jnp.asarray(matrix))).all())
    # All four rows are equally large at a turn by 120 degrees about (1, 1, 1).
    assert bool(jnp.isfinite(slope(jnp.asarray(np.roll(np.eye(3), 1, axis=0)))).all())


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-4, 0.5, RIGHT, 3.0, math.pi - 1e-8, math.pi])
def test_the_angle_of_a_rotation(angle: float):
    for axis in np.random.default_rng(8).normal(size=(20, 3)):
        matrix = Rotation.from_rotvec(axis / np.linalg.norm(axis) * angle).as_matrix()
        found = float(rotations.rotation_angle(rotations.from_array(jnp.asarray(matrix))))
        assert found == pytest.approx(angle, abs=1e-15 + 2e-15 * angle + 4e-16 / max(angle, 1) + 2e-16)


def test_the_angle_is_a_distance_on_the_group():
    one, two, three = (random(200, seed) for seed in (11, 12, 13))

    def distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(rotations.rotation_angle(rotations.from_array(jnp.asarray(np.swapaxes(a, 1, 2) @ b))))

    np.testing.assert_allclose(distance(one, two), distance(two, one), atol=1e-13)
    np.testing.assert_allclose(distance(three @ one, three @ two), distance(one, two), atol=1e-13)
    np.testing.assert_allclose(distance(one @ three, two @ three), distance(one, two), atol=1e-13)
    assert (distance(one, three) <= distance(one, two) + distance(two, three) + 1e-13).all()


def test_a_reflection_is_no_rotation_and_does_not_come_back():
    # Nothing here checks det = 1; what comes out of a reflection is a rotation, and so not what went in.
    reflection = np.diag([1.0, 1.0, -1.0])
    for make, take, _, _ in TRIPLES.values():
        back = np.asarray(as_array(make(*take(rotations.from_array(jnp.asarray(reflection))))))
        assert np.linalg.det(back) == pytest.approx(1.0)
        assert np.abs(back - reflection).max() > 0.5


@given(y=st.floats(-1e3, 1e3), x=st.floats(-1e3, 1e3))
def test_the_angle_of_a_direction(y: float, x: float):
    found = float(rotations.direction_angle(jnp.asarray(y), jnp.asarray(x)))
    size = math.hypot(x, y)
    assert -math.pi <= found < math.pi
    if size > 1e-150:
        expected = math.atan2(y, x)
        gap = abs(found - expected)
        assert min(gap, 2 * math.pi - gap) <= 1e-15 * 4


def test_the_angle_of_no_direction_is_zero_with_a_finite_derivative():
    zero = jnp.asarray(0.0)
    assert float(rotations.direction_angle(zero, zero)) == 0.0
    assert all(bool(jnp.isfinite(part)) for part in jax.grad(rotations.direction_angle, argnums=(0, 1))(zero, zero))


def test_products_and_transposes():
    one, two = random(50, 21), random(50, 22)
    m, n = rotations.from_array(jnp.asarray(one)), rotations.from_array(jnp.asarray(two))
    np.testing.assert_allclose(as_array(rotations.multiply(m, n)), one @ two, atol=1e-15)
    np.testing.assert_array_equal(as_array(rotations.transpose(m)), np.swapaxes(one, 1, 2))
    v = np.random.default_rng(1).normal(size=(3, 50))
    np.testing.assert_allclose(np.stack(rotations.apply(m, tuple(v))), np.einsum("nij,jn->in", one, v), atol=1e-14)
    np.testing.assert_array_equal(as_array(m), one)
