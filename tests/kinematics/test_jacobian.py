"""Jacobians against finite differences and the closed forms of the 3-RPR."""

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mechanisms import rpr3

SAMPLERS = {"analytic": zoo.random_analytic, "general": zoo.random_general}
SIZE = 500


def problem(family, seed):
    rng = np.random.default_rng(seed)
    robots = zoo.build(SAMPLERS[family](rng, SIZE))
    return robots, zoo.random_poses(rng, SIZE), rng.uniform(0.1, 3, (SIZE, 3))


jacobians = jax.jit(jax.vmap(jk.jacobians))
constraints = jax.jit(jax.vmap(jk.constraints))


@pytest.mark.parametrize("family", SAMPLERS)
def test_jacobians_equal_central_differences(family):
    robots, poses, joints = problem(family, 0)
    direct, inverse = jacobians(robots, poses, joints)
    step = 1e-5
    for k, unit in enumerate(step * np.eye(3)):
        # The constraints are quadratic in x, y and rho; the third derivative in phi is of order one.
        moved = constraints(robots, poses + unit, joints) - constraints(robots, poses - unit, joints)
        np.testing.assert_allclose(direct[:, :, k], moved / (2 * step), atol=1e-8)
        moved = constraints(robots, poses, joints + unit) - constraints(robots, poses, joints - unit)
        np.testing.assert_allclose(inverse[:, :, k], moved / (2 * step), atol=1e-8)


@pytest.mark.parametrize("family", SAMPLERS)
def test_jacobians_equal_the_closed_form(family):
    robots, poses, joints = problem(family, 1)
    direct, inverse = jacobians(robots, poses, joints)
    np.testing.assert_allclose(inverse, -2 * joints[:, :, None] * np.eye(3), atol=1e-15)
    base = np.array([[np.asarray(v) for v in p] for p in robots.base_points()]).transpose(2, 0, 1)
    own = np.array([[np.asarray(v) for v in p] for p in robots.platform_points()]).transpose(2, 0, 1)
    cos, sin = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    arm = np.stack([own[..., 0] * cos - own[..., 1] * sin, own[..., 0] * sin + own[..., 1] * cos], axis=-1)
    leg = poses[:, None, :2] + arm - base
    moment = arm[..., 0] * leg[..., 1] - arm[..., 1] * leg[..., 0]
    np.testing.assert_allclose(direct, 2 * np.concatenate([leg, moment[..., None]], axis=-1), atol=1e-13)


def test_jacobians_of_a_five_bar():
    robot = zoo.FiveBar(jnp.asarray(1.0), jnp.asarray(0.8), jnp.asarray(1.3))
    pose, joints = np.array([0.4, 1.1]), np.array([2.0, 0.9])
    elbows = 0.8 * np.stack([np.cos(joints), np.sin(joints)], axis=1) + [[0, 0], [1, 0]]
    couplers = pose - elbows
    found = jk.jacobians(robot, pose, joints)
    np.testing.assert_allclose(found.direct, 2 * couplers, rtol=1e-14)
    swing = 0.8 * np.stack([-np.sin(joints), np.cos(joints)], axis=1)
    np.testing.assert_allclose(found.inverse, np.diag(-2 * np.sum(couplers * swing, axis=1)), atol=1e-14)


def test_margins_are_named_and_signed():
    robot = rpr3.reference(limits=jk.Limits(jnp.array([0.0, 1.0, 2.0]), jnp.array([20.0, 15.0, jnp.inf])))
    found = jk.margins(robot, (0.0, 0.0, 0.0), zoo.REFERENCE_JOINTS)
    wanted = {"rho1_low": 14.98, "rho1_high": 5.02, "rho2_low": 14.38, "rho2_high": -0.38, "rho3_low": 10.0}
    assert {name: float(value) for name, value in found.items()} == pytest.approx({**wanted, "rho3_high": np.inf})


@pytest.mark.parametrize("call", [jk.constraints, jk.jacobians, jk.margins, jk.conditioning])
def test_wrong_shapes_are_refused(call):
    robot = rpr3.reference()
    with pytest.raises(jk.InputError, match=r"the pose has shape \(2,\).*x, y, phi"):
        call(robot, (0.0, 1.0), (1.0, 1.0, 1.0))
    with pytest.raises(jk.InputError, match=r"the joints has shape \(2, 3\).*vmap"):
        call(robot, (0.0, 1.0, 0.0), np.ones((2, 3)))
    with pytest.raises(jk.InputError, match=r"Mechanism"):
        call("robot", (0.0, 1.0, 0.0), (1.0, 1.0, 1.0))
