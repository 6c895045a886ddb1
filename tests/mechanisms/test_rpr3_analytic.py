"""The kernels of the analytic family against the exact oracle and each other, next to singularities above all."""

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk

SIZE = 1500


@jax.jit
@jax.vmap
def count_batch(robot, joints):
    return robot.count_kernel((joints[0], joints[1], joints[2]))


def sample(kind, seed, n=SIZE):
    """Returns geometries and joints; all but the "random" ones are singular up to ``zoo.LAYERS``."""
    rng = np.random.default_rng(seed)
    geometry = zoo.random_analytic(rng, n)
    if kind == "random":
        return geometry, rng.uniform(0, 4, (n, 3))
    poses = zoo.parallel_poses(rng, n) if kind == "f1" else zoo.concurrent_poses(rng, geometry)
    return geometry, zoo.perturbed(rng, zoo.legs(zoo.build(geometry), poses))


def assert_exact_or_flagged(geometry, joints):
    robots, exact = zoo.build(geometry), zoo.exact_counts(geometry, joints)
    branches = zoo.forward_batch(robots, jnp.asarray(joints))
    singular = np.any(np.asarray(branches.status) == jk.Status.SINGULAR, axis=1)
    count = count_batch(robots, jnp.asarray(joints))
    doubtful = singular | np.any(np.asarray(branches.status) == jk.Status.UNDECIDED, axis=1)
    bad_poses = (np.asarray(branches.count) != exact) & ~doubtful
    bad_counts = (np.asarray(count.number) != exact) & ~np.asarray(count.undecided)
    assert not bad_counts.any(), (geometry[bad_counts], joints[bad_counts])
    assert not bad_poses.any(), (geometry[bad_poses], joints[bad_poses])
    return exact, singular, np.asarray(count.undecided)


def test_random_samples_equal_the_exact_count():
    exact, singular, undecided = assert_exact_or_flagged(*sample("random", 0))
    assert set(exact) == {0, 2, 4, 6}
    assert not singular.any()
    assert not undecided.any()


@pytest.mark.parametrize("kind", ["f1", "f2"])
def test_samples_next_to_a_singularity_are_exact_or_flagged(kind):
    _, singular, undecided = assert_exact_or_flagged(*sample(kind, 1))
    layer = np.resize(zoo.LAYERS, SIZE)
    # Flags are for the neighbourhood alone: a relative 1e-6 off, almost every sample must be decided.
    assert singular[layer == 1e-6].mean() < 0.01
    assert undecided[layer == 1e-6].mean() < 0.05
    assert singular[layer <= 1e-15].mean() > 0.8


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["random", "f1", "f2"])
def test_many_samples_are_exact_or_flagged(kind):
    assert_exact_or_flagged(*sample(kind, 2, 60_000))


def test_special_lines_of_the_joint_space():
    # Equal lengths, zero lengths, symmetric bases: where coefficients vanish exactly.
    values = np.array([0.0, 0.5, 1.0, 1.3, 2.0])
    joints = np.stack(np.meshgrid(values, values, values)).reshape(3, -1).T
    for geometry in [(1.0, 0.0, 1.0), (1.0, 0.5, 1.0), (1.0, 1.0, 1.0), (2.0, 1.0, -0.7), (-1.0, -0.5, 0.8)]:
        assert_exact_or_flagged(np.repeat([geometry], len(joints), axis=0), joints)


def test_isosceles_bases_with_two_equal_legs():
    # c3 = c2 / 2 and rho1 = rho2: the cubic is odd in S, and a single root sits midway between its complex partners.
    rng = np.random.default_rng(3)
    geometry, joints = zoo.random_analytic(rng, SIZE), rng.uniform(0, 4, (SIZE, 3))
    geometry[:, 1], joints[:, 1] = geometry[:, 0] / 2, joints[:, 0]
    _, singular, undecided = assert_exact_or_flagged(geometry, joints)
    branches = zoo.forward_batch(zoo.build(geometry), jnp.asarray(joints))
    np.testing.assert_array_equal(branches.count, zoo.exact_counts(geometry, joints))
    assert not singular.any()
    assert undecided.mean() < 0.01


def test_forward_and_count_kernels_agree_on_a_large_sample():
    rng = np.random.default_rng(4)
    geometry, joints = zoo.random_analytic(rng, 200_000), jnp.asarray(rng.uniform(0, 4, (200_000, 3)))
    robots = zoo.build(geometry)
    branches, count = zoo.forward_batch(robots, joints), count_batch(robots, joints)
    decided = ~np.asarray(count.undecided) & ~np.any(np.asarray(branches.status) == jk.Status.SINGULAR, axis=1)
    assert decided.mean() > 0.999
    np.testing.assert_array_equal(np.asarray(branches.count)[decided], np.asarray(count.number)[decided])


def test_lanes_come_in_pairs():
    geometry, joints = sample("random", 5)
    robots = zoo.build(geometry)
    branches = zoo.forward_batch(robots, jnp.asarray(joints))
    values, valid = np.asarray(branches.values), np.asarray(branches.valid)
    np.testing.assert_array_equal(valid[:, ::2], valid[:, 1::2])
    np.testing.assert_array_equal(values[:, ::2, 2], values[:, 1::2, 2])
    half = values[..., 2] / 2
    p = values[..., 0] * np.cos(half) + values[..., 1] * np.sin(half)
    real = valid[:, ::2]
    np.testing.assert_allclose(p[:, ::2][real], -p[:, 1::2][real], atol=1e-13)
    assert np.all(p[:, ::2][real] > 0)


def test_half_of_the_modes_lie_in_each_aspect():
    # The sign of det dF/dpose tells the two aspects apart.
    geometry, joints = sample("random", 6)
    robots = zoo.build(geometry)
    branches = zoo.forward_batch(robots, jnp.asarray(joints))
    signs = jax.jit(jax.vmap(jax.vmap(zoo.direct_determinant, (None, 0))))(robots, branches.values)
    np.testing.assert_array_equal(np.sum(np.asarray(signs) > 0, axis=1), np.sum(np.asarray(signs) < 0, axis=1))
