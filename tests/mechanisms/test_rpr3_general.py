"""The general forward kinematics against the exact oracle, next to singularities and coincident lines above all."""

import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk

SIZE = 1500


def solved(geometry, joints):
    """Returns the branches, the exact counts, and which samples are flagged as singular."""
    branches = zoo.forward_batch(zoo.build(geometry), jnp.asarray(joints))
    singular = np.any(np.asarray(branches.status) == jk.Status.SINGULAR, axis=1)
    return branches, zoo.exact_counts(geometry, joints), singular


def assert_exact_or_flagged(geometry, joints):
    branches, exact, singular = solved(geometry, joints)
    doubtful = singular | np.any(np.asarray(branches.status) == jk.Status.UNDECIDED, axis=1)
    bad = (np.asarray(branches.count) != exact) & ~doubtful
    assert not bad.any(), (bad.sum(), geometry[bad][:9], joints[bad][:9])
    return branches, exact, singular


def layered(seed, n):
    rng = np.random.default_rng(seed)
    geometry = zoo.random_general(rng, n)
    return geometry, zoo.perturbed(rng, zoo.legs(zoo.build(geometry), zoo.singular_poses(rng, geometry)))


def coincident(rng, n, offset):
    """Returns geometries and poses at which both lines are one line, RV - SU = 0, but for an offset of phi."""
    geometry = zoo.random_general(rng, 3 * n)
    c2, c3, d3, l2, l3, beta = geometry.T
    # v2 x v3 = k + a cos phi + b sin phi
    ex, ey = l3 * np.cos(beta), l3 * np.sin(beta)
    k, a, b = l2 * ey + c2 * d3, -l2 * d3 - c2 * ey, l2 * c3 - c2 * ex
    size = np.hypot(a, b)
    some = np.flatnonzero(np.abs(k) < 0.999 * size)[:n]
    assert len(some) == n
    turn = rng.choice([-1, 1], n) * np.arccos(-k[some] / size[some])
    phi = np.arctan2(b[some], a[some]) + turn + offset
    phi = (phi + np.pi) % (2 * np.pi) - np.pi
    return geometry[some], np.concatenate([rng.uniform(-2, 2, (n, 2)), phi[:, None]], axis=1)


def test_random_samples_equal_the_exact_count():
    rng = np.random.default_rng(0)
    _, exact, singular = assert_exact_or_flagged(zoo.random_general(rng, SIZE), rng.uniform(0, 4, (SIZE, 3)))
    assert set(exact) >= {0, 2, 4}
    assert not singular.any()


def test_joints_of_random_poses_equal_the_exact_count():
    rng = np.random.default_rng(1)
    geometry = zoo.random_general(rng, SIZE)
    joints = zoo.legs(zoo.build(geometry), zoo.random_poses(rng, SIZE))
    _, exact, singular = assert_exact_or_flagged(geometry, joints)
    assert set(exact) == {2, 4, 6}
    assert not singular.any()


def test_samples_next_to_a_singularity_are_exact_or_flagged():
    _, _, singular = assert_exact_or_flagged(*layered(2, SIZE))
    layer = np.resize(zoo.LAYERS, SIZE)
    assert singular[layer == 1e-6].mean() < 0.01
    assert singular[layer == 0].mean() > 0.9


def test_the_number_of_modes_with_multiplicity_is_even_or_flagged():
    branches, _, singular = solved(*layered(3, SIZE))
    odd = np.asarray(branches.multiplicity).sum(axis=1) % 2 == 1
    flagged = singular | np.any(np.asarray(branches.status) == jk.Status.UNDECIDED, axis=1)
    assert not (odd & ~flagged).any()
    assert odd.mean() < 0.1


@pytest.mark.slow
def test_many_samples_are_exact_or_flagged():
    rng = np.random.default_rng(4)
    geometry = zoo.random_general(rng, 20_000)
    assert_exact_or_flagged(geometry, rng.uniform(0, 4, (20_000, 3)))
    assert_exact_or_flagged(*layered(5, 6_000))


@pytest.mark.parametrize("offset", [0.0, 1e-9, -1e-6, 1e-4])
def test_coincident_lines(offset):
    # The elimination breaks down, the poses are regular: none may be lost.
    geometry, poses = coincident(np.random.default_rng(6), SIZE, offset)
    robots = zoo.build(geometry)
    joints = zoo.legs(robots, poses)
    branches, exact, singular = assert_exact_or_flagged(geometry, joints)
    assert singular.mean() < 0.02
    clear = regular(robots, poses, joints) & ~singular
    assert clear.mean() > 0.8
    np.testing.assert_array_equal(np.asarray(branches.count)[clear], exact[clear])
    lengths = np.asarray(robots.characteristic_length())
    assert zoo.nearest(branches.values, poses, lengths)[clear].max() < 1e-9
    assert np.nanmax(branches.residual) <= 1e-12


def regular(robots, poses, joints):
    """Tells which poses are well away from parallel singularities."""
    measures = zoo.conditioning_batch(robots, jnp.asarray(poses), jnp.asarray(joints))
    return np.asarray(measures.smallest_singular_value) > 1e-3


def test_analytic_geometry_gives_the_same_set_of_poses():
    # There RV - SU = 0 at every angle, and every root of the characteristic function is double.
    rng = np.random.default_rng(7)
    geometry, joints = zoo.random_analytic(rng, SIZE), rng.uniform(0.2, 3, (SIZE, 3))
    geometry[:, 0] = np.abs(geometry[:, 0])
    c2, c3, d3 = geometry.T
    general = np.stack([c2, c3, d3, c2, np.hypot(c3, d3), np.arctan2(-d3, c3)], axis=1)
    closed = zoo.forward_batch(zoo.build(geometry), jnp.asarray(joints))
    found = zoo.forward_batch(zoo.build(general), jnp.asarray(joints))
    np.testing.assert_array_equal(found.count, closed.count)
    for ours, theirs in zip(np.asarray(found.values), np.asarray(closed.values), strict=True):
        real = [v[np.isfinite(v[:, 0])] for v in (ours, theirs)]
        assert zoo.set_distance(*real) < 1e-7


def test_aligned_joints():
    # All base joints, or all platform joints, on one line.
    rng = np.random.default_rng(8)
    geometry = zoo.random_general(rng, SIZE)
    geometry[:700, 2] = 0.0
    geometry[700:, 5] = rng.choice([0.0, np.pi], SIZE - 700)
    joints = zoo.legs(zoo.build(geometry), zoo.random_poses(rng, SIZE))
    _, _, singular = assert_exact_or_flagged(geometry, joints)
    assert singular.mean() < 0.01
