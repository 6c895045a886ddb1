"""Derivatives of branches with respect to joints, poses and geometry, to the second order."""

from functools import cache

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mechanisms import rpr3

REFERENCE = tuple(float(getattr(rpr3.reference(), name)) for name in ("c2", "c3", "d3", "l2", "l3", "beta"))
# Parameters are the geometry and then the joints; the last column is how many lanes are valid.
CASES = {
    "analytic, 6 lanes": ((1.0, 0.1, 1.0, 1.2, 1.0, 1.1), 6),
    "analytic, 2 lanes": ((1.0, 0.1, 1.0, 2.0, 1.0, 1.5), 2),
    "general, 6 lanes": ((*REFERENCE, *zoo.REFERENCE_JOINTS), 6),
    "general, 4 lanes": ((1.0, 0.3, 0.9, 0.8, 1.1, 0.7, 1.3, 1.1, 0.9), 4),
}
CASE = pytest.mark.parametrize(("parameters", "lanes"), CASES.values(), ids=CASES)
LANES = 6


def poses(parameters):
    """Returns the lanes' values ``(6, 3)`` as a function of geometry and joints."""
    geometry = parameters[:-3]
    robot = rpr3.analytic(*geometry) if len(geometry) == 3 else rpr3.general(*geometry)
    return jk.forward(robot, parameters[-3:]).values


@cache
def compiled(size):
    """Returns jitted functions of ``size`` parameters: values, first derivatives, second derivatives."""
    del size
    return {
        "values": jax.jit(jax.vmap(poses)),
        "fwd": jax.jit(jax.vmap(jax.jacfwd(poses))),
        "rev": jax.jit(jax.jacrev(poses)),
        "fwd over rev": jax.jit(jax.jacfwd(jax.jacrev(poses))),
        "rev over rev": jax.jit(jax.jacrev(jax.jacrev(poses))),
    }


def central_differences(function, point, step=1e-4):
    """Returns the derivative along a new last axis by central differences of the fourth order."""
    point = np.asarray(point)
    size = step * np.maximum(np.abs(point), 0.1)
    shifts = np.array([-2.0, -1.0, 1.0, 2.0])
    points = point + (shifts[:, None, None] * np.diag(size)).reshape(-1, len(point))
    values = np.asarray(function(points)).reshape(4, len(point), *np.shape(function(point[None]))[1:])
    slopes = np.einsum("s,s...->...", np.array([1, -8, 8, -1]) / 12, values)
    return np.moveaxis(slopes / size.reshape(-1, *[1] * (slopes.ndim - 1)), 0, -1)


def relative_error(found, wanted):
    return np.max(np.abs(found - wanted)) / np.max(np.abs(wanted))


@CASE
def test_first_derivatives(parameters, lanes):
    functions, point = compiled(len(parameters)), np.array(parameters)
    valid = np.isfinite(np.asarray(functions["values"](point[None]))[0, :, 0])
    assert valid.sum() == lanes
    forward, reverse = np.asarray(functions["fwd"](point[None]))[0], np.asarray(functions["rev"](point))
    np.testing.assert_allclose(forward, reverse, rtol=1e-11, atol=1e-12 * np.abs(forward).max())
    assert np.all(forward[~valid] == 0)
    wanted = central_differences(functions["values"], point)
    assert relative_error(forward[valid], wanted[valid]) < 1e-8


@CASE
def test_second_derivatives(parameters, lanes):
    functions, point = compiled(len(parameters)), np.array(parameters)
    found = np.asarray(functions["fwd over rev"](point))
    assert np.isfinite(found).all()
    assert np.all(found[lanes:] == 0)
    np.testing.assert_allclose(found, np.swapaxes(found, -1, -2), atol=1e-9 * np.abs(found).max())
    wanted = central_differences(functions["fwd"], point)[:lanes]
    assert relative_error(found[:lanes], wanted) < 1e-7


@pytest.mark.parametrize("case", ["analytic, 2 lanes", pytest.param("general, 4 lanes", marks=pytest.mark.slow)])
def test_second_derivatives_in_reverse_over_reverse(case):
    parameters = CASES[case][0]
    functions, point = compiled(len(parameters)), np.array(parameters)
    found, wanted = (np.asarray(functions[name](point)) for name in ("rev over rev", "fwd over rev"))
    assert np.isfinite(found).all()
    assert relative_error(found, wanted) < 1e-11


def test_derivative_with_respect_to_joints_is_the_ratio_of_the_jacobians():
    robot, joints = rpr3.reference(), np.array(zoo.REFERENCE_JOINTS)
    found = jax.jacfwd(lambda q: jk.forward(robot, q).values)(joints)
    for k, pose in enumerate(zoo.REFERENCE_POSES):
        direct, inverse = jk.jacobians(robot, pose, joints)
        np.testing.assert_allclose(found[k], -np.linalg.solve(direct, inverse), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("make", [lambda: rpr3.analytic(1.0, 0.1, 1.0), rpr3.reference], ids=["analytic", "general"])
def test_gradient_shaped_like_the_robot(make):
    robot = make()
    joints = jnp.array([1.2, 1.0, 1.1] if robot.id == "rpr3-analytic" else zoo.REFERENCE_JOINTS)

    def total(robot):
        branches = jk.forward(robot, joints)
        return jnp.sum(jnp.where(branches.valid[:, None], branches.values, 0.0) ** 2)

    slope = jax.grad(total)(robot)
    assert type(slope) is type(robot)
    names = [name for name in ("c2", "c3", "d3", "l2", "l3", "beta") if hasattr(robot, name)]
    point = np.array([*(getattr(robot, name) for name in names), *joints])
    functions = compiled(len(point))
    values, slopes = (
        np.asarray(functions["values"](point[None]))[0],
        np.asarray(functions["fwd"](point[None]))[0],
    )
    by_parameters = np.nansum(2 * values[..., None] * slopes, axis=(0, 1))[:-3]
    np.testing.assert_allclose([getattr(slope, name) for name in names], by_parameters, rtol=1e-9)
    assert np.abs(by_parameters).min() > 0
    np.testing.assert_array_equal(slope.limits.low, np.zeros(3))
    np.testing.assert_array_equal(slope.limits.high, np.zeros(3))


def test_inverse_derivatives_equal_the_closed_form():
    parameters = np.array([1.3, 0.4, 0.9, 1.1, 0.8, 0.5, 0.3, 0.8, 0.4])

    def found(parameters):
        return jk.inverse(rpr3.general(*parameters[:6]), parameters[6:]).values[0]

    def closed_form(parameters):
        c2, c3, d3, l2, l3, beta, x, y, phi = parameters
        ends = [(x, y), (x + l2 * jnp.cos(phi) - c2, y + l2 * jnp.sin(phi))]
        ends.append((x + l3 * jnp.cos(phi + beta) - c3, y + l3 * jnp.sin(phi + beta) - d3))
        return jnp.stack([jnp.hypot(*end) for end in ends])

    wanted = jax.jit(jax.jacfwd(closed_form))(parameters)
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(jax.jit(mode(found))(parameters), wanted, atol=1e-13)
    second, curvature = jax.jit(lambda p: (jax.jacfwd(jax.jacrev(found))(p), jax.hessian(closed_form)(p)))(parameters)
    np.testing.assert_allclose(second, curvature, atol=1e-12)


def test_a_singular_lane_has_no_derivative_and_spoils_no_other():
    # One double pose, f1 = 0, beside regular ones.
    robot = rpr3.analytic(*zoo.EXAMPLE)
    rng = np.random.default_rng(0)
    many = zoo.parallel_poses(rng, 200)
    robots = zoo.build(np.repeat([zoo.EXAMPLE], 200, axis=0))
    branches = zoo.forward_batch(robots, jnp.asarray(zoo.legs(robots, many)))
    status = np.asarray(branches.status)
    mixed = np.any(status == jk.Status.SINGULAR, axis=1) & np.any(status == jk.Status.OK, axis=1)
    joints = jnp.asarray(zoo.legs(robots, many)[np.flatnonzero(mixed)[0]])
    status = np.asarray(jk.forward(robot, joints).status)
    singular, regular = status == jk.Status.SINGULAR, status == jk.Status.OK
    forward = np.asarray(jax.jacfwd(lambda q: jk.forward(robot, q).values)(joints))
    reverse = np.asarray(jax.jacrev(lambda q: jk.forward(robot, q).values)(joints))
    assert np.isnan(forward[singular]).all()
    assert np.all(reverse[singular] == 0)
    assert np.isfinite(reverse).all()
    np.testing.assert_allclose(forward[regular], reverse[regular], rtol=1e-12)
    assert np.abs(forward[regular]).max() > 0


def test_derivatives_where_nothing_is_solved_are_zero():
    robot = rpr3.analytic(*zoo.EXAMPLE)
    for joints in ((5.0, 0.5, 0.5), (1.0, -1.0, 1.0), (np.nan, 1.0, 1.0)):
        for mode in (jax.jacfwd, jax.jacrev):
            slopes = mode(lambda q: jk.forward(robot, q).values)(jnp.array(joints))
            np.testing.assert_array_equal(slopes, np.zeros((LANES, 3, 3)))


def test_newton_on_a_design_problem():
    # Moves c3 until the first mode of the example has a wanted angle: derivatives that work in use.
    joints = jnp.array([1.2, 1.0, 1.1])

    def angle(c3):
        return jk.forward(rpr3.analytic(1.0, c3, 1.0), joints).values[-1, 2]

    wanted, c3 = angle(0.13), jnp.asarray(0.1)
    step = jax.jit(lambda c3: c3 - (angle(c3) - wanted) / jax.grad(angle)(c3))
    for _ in range(6):
        c3 = step(c3)
    assert float(c3) == pytest.approx(0.13, abs=1e-13)
