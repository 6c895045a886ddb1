"""Conditioning: the determinant and singular values of the rates, next to singularities too."""

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mechanisms import rpr3

SIZE = 500


def scaled_rates(robots, poses, joints):
    """Returns dq/dx = -B^-1 A with lengths divided by the characteristic length, by numpy."""
    direct, inverse = (np.asarray(a) for a in jax.jit(jax.vmap(jk.jacobians))(robots, poses, joints))
    length = np.asarray(robots.characteristic_length())
    rates = -np.linalg.solve(inverse, direct)
    rates[:, :, 2] /= length[:, None]
    return direct, rates


@pytest.mark.parametrize("sampler", [zoo.random_analytic, zoo.random_general])
def test_measures_equal_numpy(sampler):
    rng = np.random.default_rng(0)
    robots, poses = zoo.build(sampler(rng, SIZE)), zoo.random_poses(rng, SIZE)
    joints = zoo.legs(robots, poses)
    found = zoo.conditioning_batch(robots, poses, joints)
    direct, rates = scaled_rates(robots, poses, joints)
    values = np.linalg.svd(rates, compute_uv=False)
    np.testing.assert_allclose(found.determinant, np.linalg.det(direct), atol=1e-12)
    np.testing.assert_allclose(found.smallest_singular_value, values[:, 2], atol=1e-13 * values[:, 0].max())
    np.testing.assert_allclose(found.inverse_condition_number, values[:, 2] / values[:, 0], atol=1e-13)


def test_measures_vanish_on_the_singularities():
    rng = np.random.default_rng(1)
    geometry = zoo.random_analytic(rng, SIZE)
    robots = zoo.build(geometry)
    for poses in (zoo.parallel_poses(rng, SIZE), zoo.concurrent_poses(rng, geometry)):
        joints = zoo.legs(robots, poses)
        clear = joints.min(axis=1) > 0.05
        found = zoo.conditioning_batch(robots, poses, joints)
        assert np.asarray(found.smallest_singular_value)[clear].max() < 1e-12
        assert np.asarray(found.inverse_condition_number)[clear].max() < 1e-12


def test_clearance_shrinks_in_proportion_to_the_distance():
    robot = rpr3.analytic(*zoo.EXAMPLE)

    def clearance(p):
        phi, h = 0.7, 0.9
        pose = np.array([p * np.cos(phi / 2) - h * np.sin(phi / 2), p * np.sin(phi / 2) + h * np.cos(phi / 2), phi])
        return float(jk.conditioning(robot, pose, jk.inverse(robot, pose).values[0]).smallest_singular_value)

    assert clearance(1e-6) / clearance(1e-3) == pytest.approx(1e-3, rel=1e-2)
    assert clearance(1e-9) / clearance(1e-6) == pytest.approx(1e-3, rel=1e-4)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_measures_do_not_depend_on_the_unit_of_length(factor):
    geometry = np.array([1.3, 0.4, 0.9, 1.1, 0.8, 0.5])
    pose = np.array([0.3, 0.8, 0.4])
    small, large = (zoo.build(geometry * ([f] * 5 + [1])) for f in (1.0, factor))
    moved = pose * [factor, factor, 1]
    here = jk.conditioning(small, pose, jk.inverse(small, pose).values[0])
    there = jk.conditioning(large, moved, jk.inverse(large, moved).values[0])
    np.testing.assert_allclose(there[1:], here[1:], rtol=1e-12)
    assert float(there.determinant) == pytest.approx(float(here.determinant) * factor**4, rel=1e-12)


def test_conditioning_of_a_mechanism_with_two_coordinates():
    robot = zoo.FiveBar(jnp.asarray(1.0), jnp.asarray(0.8), jnp.asarray(1.3))
    joints = np.array([2.0, 0.9])
    pose = jk.forward(robot, joints).values[0]
    found = jk.conditioning(robot, pose, joints)
    direct, inverse = (np.asarray(a) for a in jk.jacobians(robot, pose, joints))
    # One radian moves a pose by lengths in units of the crank.
    values = np.linalg.svd(np.linalg.solve(inverse, direct) * 0.8, compute_uv=False)
    np.testing.assert_allclose(found, [np.linalg.det(direct), values[1], values[1] / values[0]], rtol=1e-12)


def test_conditioning_can_be_differentiated():
    robot, pose = rpr3.analytic(*zoo.EXAMPLE), jnp.array([0.3, 0.8, 0.4])

    def clearance(pose):
        return jk.conditioning(robot, pose, jk.inverse(robot, pose).values[0]).smallest_singular_value

    slope = jax.grad(clearance)(pose)
    step = 1e-6 * np.eye(3)
    wanted = [(float(clearance(pose + e)) - float(clearance(pose - e))) / 2e-6 for e in step]
    np.testing.assert_allclose(slope, wanted, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("name", ["analytic", "general", "tlpm", "ppps3"])
def test_closed_jacobians_are_those_of_the_constraints(name):
    robot = {
        "analytic": lambda: rpr3.analytic(*zoo.EXAMPLE),
        "general": rpr3.reference,
        "tlpm": jk.mechanisms.tlpm.create,
        "ppps3": lambda: jk.mechanisms.ppps3.create(side=1.3, mirrored=True),
    }[name]()
    rng = np.random.default_rng(7)
    for _ in range(10):
        pose, joints = (jnp.asarray(rng.uniform(-1, 1, len(axes))) for axes in (robot.pose_axes, robot.joint_axes))
        rows, diagonal = robot.jacobian_kernel(tuple(pose), tuple(joints))
        wanted = jk.jacobians(robot, pose, joints)
        scale = float(jnp.max(jnp.abs(wanted.direct)))
        np.testing.assert_allclose([[float(e) for e in row] for row in rows], wanted.direct, atol=1e-14 * scale)
        np.testing.assert_allclose(np.diag([float(e) for e in diagonal]), wanted.inverse, rtol=1e-14)
