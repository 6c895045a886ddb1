"""Declaring mechanisms: axes, limits, margins, geometry, text."""

import math

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from jax import Array

import jaxkin as jk
from jaxkin.core.mechanism import scale_vector
from jaxkin.mechanisms import rpr3

X, Y, U, V = (jk.Axis(name, "length") for name in "xyuv")


def declare(pose, joints):
    """Declares a mechanism with these axes."""

    @jk.mechanism
    class Declared(jk.Mechanism):
        pose_axes = pose
        joint_axes = joints
        size: Array

    return Declared


def test_an_angle_is_periodic():
    axis = jk.angle("phi")
    assert (axis.name, axis.unit, axis.low, axis.high, axis.period) == (
        "phi",
        "rad",
        -math.pi,
        math.pi,
        2 * math.pi,
    )
    assert axis.is_angle
    assert not X.is_angle
    assert X.period is None


@pytest.mark.parametrize(
    ("pose", "joints", "words"),
    [
        ((), (U,), ["Declared.pose_axes", "()", "non-empty"]),
        ((X,), None, ["joint_axes", "None"]),
        (("x", "y"), (U, V), ["pose_axes", "'x'", "jaxkin.Axis"]),
        ((X, Y), (U,), ["2 pose axes", "1 joint axes", "passive"]),
        ((X, Y), (U, X), ["name of its own", "'x'"]),
    ],
)
def test_the_decorator_refuses(pose, joints, words):
    with pytest.raises(jk.InputError) as error:
        declare(pose, joints)
    for word in words:
        assert word in str(error.value)


def test_missing_axes_are_refused():
    with pytest.raises(jk.InputError, match=r"Bare\.pose_axes is None"):

        @jk.mechanism
        class Bare(jk.Mechanism):
            size: Array


def test_a_mechanism_is_a_frozen_pytree():
    robot = declare((X,), (U,))(jnp.asarray(2.0))
    assert jax.tree_util.tree_leaves(robot) == [2.0]
    assert float(jax.tree_util.tree_map(lambda v: 3 * v, robot).size) == 6.0
    with pytest.raises(AttributeError):
        robot.size = 1.0
    with pytest.raises(NotImplementedError):
        robot.constraints(jnp.zeros(1), jnp.zeros(1))


def test_limits():
    lengths = jk.Limits.lengths(3, 0.5, 2.0)
    np.testing.assert_array_equal(lengths.low, [0.5] * 3)
    np.testing.assert_array_equal(lengths.high, [2.0] * 3)
    np.testing.assert_array_equal(jk.Limits.lengths(2).high, [np.inf] * 2)
    none = jk.Limits.none(2)
    np.testing.assert_array_equal([none.low, none.high], [[-np.inf] * 2, [np.inf] * 2])


def test_a_mechanism_without_limits_has_none():
    robot = zoo.TwoSliders(jnp.asarray(1.5), jnp.asarray(1.2))
    np.testing.assert_array_equal(robot.limit_values().high, [np.inf] * 2)
    margins = jk.margins(robot, (0.0, 1.0), (-0.5, 0.5))
    assert set(margins) == {"u1_low", "u1_high", "u2_low", "u2_high"}
    assert all(float(v) == np.inf for v in margins.values())


def test_geometry_that_is_not_finite_is_not_ok():
    assert bool(zoo.TwoSliders(jnp.asarray(1.5), jnp.asarray(1.2)).geometry_ok())
    bad = zoo.TwoSliders(jnp.asarray(1.5), jnp.asarray(jnp.nan))
    assert not bool(bad.geometry_ok())
    branches = jk.forward(bad, (-0.4, 0.7))
    assert {int(s) for s in branches.status} == {jk.Status.INVALID_GEOMETRY}


def test_geometry_by_name():
    geometry = rpr3.analytic(1.0, 0.5, -2.0).geometry()
    assert {name: geometry[name] for name in ("c2", "c3", "d3")} == {"c2": 1.0, "c3": 0.5, "d3": -2.0}
    assert geometry["limits.low"] == [0.0, 0.0, 0.0]


def test_text():
    assert str(rpr3.analytic(1.0, 0.5, -2.0)) == "rpr3-analytic(c2=1, c3=0.5, d3=-2)"
    batch = zoo.build(zoo.random_analytic(np.random.default_rng(0), 4))
    assert str(batch) == "rpr3-analytic (batched or traced)"


def test_scale_vector_scales_lengths_alone():
    np.testing.assert_array_equal(scale_vector((X, jk.angle("phi"), Y), jnp.asarray(2.5)), [2.5, 1.0, 2.5])


def test_generic_constraint_scales_follow_the_unit_of_length():
    pose, joints = jnp.array([0.3, 0.9]), jnp.array([-0.4, 0.7])
    scales = [
        np.asarray(zoo.TwoSliders(jnp.asarray(1.5 * f), jnp.asarray(1.2 * f)).constraint_scales(f * pose, f * joints))
        for f in (1.0, 1e6)
    ]
    assert np.all(scales[0] > 0.1)
    np.testing.assert_allclose(scales[1], 1e12 * scales[0], rtol=1e-12)


def test_classes_with_like_fields_never_share_a_kernel():
    """In JAX 0.10 and 0.12 structures of such dataclasses compare equal, and only their hashes tell them apart."""
    first, second = declare((X,), (U,)), declare((X, Y), (U, V))
    one, other = (jax.tree_util.tree_structure(cls(size=jnp.asarray(2.0))) for cls in (first, second))
    assert one != other
    assert one == jax.tree_util.tree_structure(first(size=jnp.asarray(3.0)))
    assert list(first(size=jnp.asarray(2.0)).geometry()) == ["size"]
    assert repr(first(size=2.0)) == repr(first(size=2.0))
    assert "_kind" not in repr(first(size=2.0))
