"""Working modes from the constraints: how the equations hold the joints, and the joints of each mode."""

import itertools
import math
from typing import ClassVar

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.kinematics.legs import LegKind, leg_discriminants, leg_joints, legs_of, working_mode
from jaxkin.mechanisms import five_bar, ppps3, rpr3, tlpm

FIVE_BAR = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
SLIDERS = zoo.TwoSliders(first=jnp.asarray(1.0), second=jnp.asarray(1.5))
LINEAR, QUADRATIC, TRIGONOMETRIC = LegKind


class _Plane(jk.Mechanism):
    """Two equations of a point (x, y) and two lengths, the equations' order and coupling of choice."""

    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.Axis("u", "length"), jk.Axis("v", "length"))
    size: jax.Array

    def characteristic_length(self) -> jax.Array:
        return self.size


@jk.mechanism
class Swapped(_Plane):
    """The first equation holds the second joint; the other is linear in the first, with a slope that the pose gives."""

    size: jax.Array

    def constraints(self, pose, joints):
        (x, y), (u, v) = pose, joints
        return jnp.stack([x**2 + y**2 - v**2, (x + 5 * self.size) * u - y * self.size])


@jk.mechanism
class Coupled(_Plane):
    """The first equation holds both joints (a coupled drive)."""

    size: jax.Array

    def constraints(self, pose, joints):
        (x, y), (u, v) = pose, joints
        return jnp.stack([(x - u - 0.1 * v) ** 2 + y**2 - self.size**2, (x - v) ** 2 + y**2 - self.size**2])


@jk.mechanism
class Cubic(_Plane):
    """An equation of the third degree in its joint."""

    size: jax.Array

    def constraints(self, pose, joints):
        (x, y), (u, v) = pose, joints
        return jnp.stack([x * self.size**2 - u**3, y - v])


@jk.mechanism
class Shifted(_Plane):
    """Legs whose lengths count from an offset: the sign of the mode follows from the limits and the offset."""

    size: jax.Array
    limits: jk.Limits

    def constraints(self, pose, joints):
        (x, y), (u, v) = pose, joints
        return jnp.stack([x**2 + y**2 - (u + self.size) ** 2, (x - 3) ** 2 + y**2 - (v + self.size) ** 2])


@jk.mechanism
class HalfAngle(jk.Mechanism):
    """A crank that turns twice as fast as its joint: the sine of twice the joint is no sine of the joint."""

    pose_axes: ClassVar = (jk.Axis("x", "length"),)
    joint_axes: ClassVar = (jk.angle("theta"),)
    size: jax.Array

    def constraints(self, pose, joints):
        return pose - self.size * jnp.sin(2 * joints)


def test_each_robots_legs_are_told_from_its_constraints():
    assert legs_of(FIVE_BAR) == legs_of(five_bar.create(1.0, (3, 4), (5, 6)))
    legs = legs_of(FIVE_BAR)
    assert legs.kinds == (TRIGONOMETRIC, TRIGONOMETRIC)
    assert legs.rows == (0, 1)
    assert set(legs.modes) == set(itertools.product((1, -1), repeat=2))
    sliders = legs_of(SLIDERS)
    assert sliders.kinds == (QUADRATIC, QUADRATIC)
    assert len(sliders.modes) == 4
    # A length is not negative: one working mode, B = -2 rho.
    for robot in (rpr3.analytic(1.0, 0.0, 1.0), rpr3.reference()):
        assert legs_of(robot).modes == ((-1, -1, -1),)
    assert legs_of(rpr3.reference()).kinds == (QUADRATIC,) * 3
    spatial = legs_of(ppps3.create())
    assert spatial.kinds == (LINEAR,) * 6
    assert len(spatial.modes) == 1
    tripod = legs_of(tlpm.create())
    assert tripod.kinds == (QUADRATIC,) * 3
    # Its strokes are counted from where the legs start: they stay on one side.
    assert tripod.modes == ((-1, -1, -1),)


def test_rows_follow_the_equations_and_not_their_order():
    legs = legs_of(Swapped(size=jnp.asarray(1.0)))
    assert legs.rows == (1, 0)
    assert legs.kinds == (LINEAR, QUADRATIC)
    # The slope x + 5 changes its sign in the workspace: both signs can occur.
    assert legs.signs[0] == (1, -1)


@pytest.mark.parametrize("kind", [Coupled, Cubic, HalfAngle])
def test_mechanisms_without_sign_vectors_have_no_legs(kind):
    assert legs_of(kind(size=jnp.asarray(1.0))) is None


def test_limits_beyond_the_offset_leave_one_sign():
    free = Shifted(size=jnp.asarray(2.0), limits=jk.Limits.none(2))
    assert len(legs_of(free).modes) == 4
    limited = Shifted(size=jnp.asarray(2.0), limits=jk.Limits(jnp.array([-2.0, -9.0]), jnp.array([5.0, -2.0])))
    # B = -2 (u + 2), not positive for u >= -2; v <= -2 gives the other sign.
    assert legs_of(limited).modes == ((-1, 1),)


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1.0, 1e6])
def test_legs_do_not_depend_on_the_unit_of_length(size):
    rods = zoo.TwoSliders(first=jnp.asarray(size), second=jnp.asarray(1.5 * size))
    assert legs_of(rods).kinds == (QUADRATIC, QUADRATIC)
    assert legs_of(five_bar.create(9 * size, (8 * size, 8 * size), (5 * size, 5 * size))) == legs_of(FIVE_BAR)
    assert legs_of(rpr3.analytic(size, 0.0, size)).modes == ((-1, -1, -1),)


@jk.mechanism
class Unscaled(jk.Mechanism):
    """Two sliders that declare no characteristic length, so that their size is no number of order one."""

    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.Axis("u", "length"), jk.Axis("v", "length"))
    rod: jax.Array

    def constraints(self, pose, joints):
        return jnp.stack([(pose[0] - q) ** 2 + pose[1] ** 2 - self.rod**2 for q in joints])


@pytest.mark.parametrize("rod", [1e-3, 1.0, 1e3, 1e6])
def test_a_large_constant_does_not_hide_that_a_leg_is_quadratic(rod):
    assert legs_of(Unscaled(rod=jnp.asarray(rod))).kinds == (QUADRATIC, QUADRATIC)


ROBOTS = {
    "five-bar": (FIVE_BAR, [-6.0, -8.0], [15.0, 8.0]),
    "unequal five-bar": (five_bar.create(5.0, (3.0, 4.0), (6.0, 4.5)), [-6.0, -8.0], [12.0, 8.0]),
    "sliders": (SLIDERS, [-2.0, -1.2], [2.0, 1.2]),
    "rpr3": (rpr3.analytic(1.0, 0.3, 0.7), [-2.0, -2.0, -math.pi], [2.0, 2.0, math.pi]),
    "ppps3": (ppps3.create(), [-1.0] * 6, [1.0] * 6),
    "tlpm": (tlpm.create(), [-300.0, -300.0, -800.0], [300.0, 300.0, 800.0]),
    "swapped": (Swapped(size=jnp.asarray(1.0)), [-2.0, -2.0], [2.0, 2.0]),
}


def poses_of(name, n, seed):
    _, low, high = ROBOTS[name]
    return np.random.default_rng(seed).uniform(low, high, (n, len(low)))


def solved(robot, legs, poses, signs):
    """Discriminants, joints, residuals and modes of many poses in one working mode."""

    def one(pose):
        q = leg_joints(robot, legs, jnp.asarray(signs, float), pose)
        residual = jnp.abs(robot.constraints(pose, q)) / robot.constraint_scales(pose, q)
        return leg_discriminants(robot, legs, pose), q, residual, working_mode(robot, legs, pose, q)

    return [np.asarray(part) for part in jax.jit(jax.vmap(one))(jnp.asarray(poses))]


@pytest.mark.parametrize("name", list(ROBOTS))
def test_the_joints_of_every_mode_close_the_mechanism_in_that_mode(name):
    robot, *_ = ROBOTS[name]
    legs, poses = legs_of(robot), poses_of(name, 400, 0)
    for signs in legs.modes[:4]:
        discriminants, joints, residual, mode = solved(robot, legs, poses, signs)
        reached = np.all(discriminants > 0, axis=1)
        assert reached.sum() > 40
        assert np.max(residual[reached]) < 1e-14
        twofold = np.array([kind != LINEAR for kind in legs.kinds])
        np.testing.assert_array_equal(mode[reached][:, twofold], np.tile(np.array(signs)[twofold], (reached.sum(), 1)))
        angles = [k for k, axis in enumerate(robot.joint_axes) if axis.is_angle]
        assert np.all((joints[:, angles] >= -np.pi) & (joints[:, angles] < np.pi))


@pytest.mark.parametrize("name", ["five-bar", "sliders", "tlpm"])
def test_discriminants_are_the_squares_of_the_entries_of_b(name):
    robot, *_ = ROBOTS[name]
    legs, poses = legs_of(robot), poses_of(name, 200, 1)
    discriminants, joints, _, _ = solved(robot, legs, poses, legs.modes[0])
    inverse = np.asarray(jax.vmap(lambda x, q: jk.jacobians(robot, x, q).inverse)(poses, joints))
    entries = inverse[:, legs.rows, range(len(legs.rows))]
    reached = np.all(discriminants > 0, axis=1)
    np.testing.assert_allclose(
        entries[reached] ** 2, discriminants[reached], rtol=1e-9, atol=1e-10 * discriminants.max()
    )


def test_the_joints_are_those_of_the_closed_inverse_kinematics():
    for name in ("rpr3", "tlpm", "ppps3"):
        robot, *_ = ROBOTS[name]
        legs, poses = legs_of(robot), poses_of(name, 100, 2)
        lanes = jax.jit(jax.vmap(jk.inverse, in_axes=(None, 0)))(robot.replace(), jnp.asarray(poses))
        values, valid = np.asarray(lanes.values), np.asarray(lanes.valid)
        assert valid.any()
        found = np.stack([solved(robot, legs, poses, signs)[1] for signs in legs.modes], axis=1)
        size = float(robot.characteristic_length())
        away = np.min(np.max(np.abs(values[:, :, None] - found[:, None]), axis=3), axis=2)
        assert np.max(away[valid]) < 1e-9 * size


@pytest.mark.parametrize("share", [0.0, 1e-16, 1e-14, 1e-12, 1e-9, 1e-6])
def test_next_to_a_stretched_leg_the_mechanism_still_closes(share):
    """The joint itself is uncertain there by the root of rounding, the equation is not."""
    phi = np.linspace(0.3, 2.8, 50)
    for radius in (13.0, 3.0):
        r = radius * (1 - share) if radius > 8 else radius * (1 + share)
        pose = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)
        for signs in ((1, 1), (-1, 1)):
            discriminants, joints, residual, _ = solved(FIVE_BAR, legs_of(FIVE_BAR), pose, signs)
            # D = 16 l^2 r^2 sin^2 of the angle between crank and line of sight.
            assert np.all(np.abs(discriminants[:, 0]) < 1e5 * (share + 1e-15))
            assert np.max(residual[:, 0]) < 1e-14
            straight = np.arctan2(pose[:, 1], pose[:, 0])
            turn = (joints[:, 0] - straight + np.pi) % (2 * np.pi) - np.pi
            bound = 3 * math.sqrt(share + 1e-15)
            assert np.max(np.minimum(np.abs(turn), np.pi - np.abs(turn))) < bound


def test_out_of_reach_the_discriminant_is_negative_and_the_joint_is_the_nearest():
    legs = legs_of(SLIDERS)
    discriminants, joints, _, _ = solved(SLIDERS, legs, np.array([[0.4, 1.2]]), (1, -1))
    np.testing.assert_allclose(discriminants[0], [4 * (1 - 1.44), 4 * (1.5**2 - 1.44)], rtol=1e-14)
    assert joints[0, 0] == pytest.approx(0.4, abs=1e-15)


def test_a_batch_of_robots_of_one_structure_shares_its_legs():
    rng = np.random.default_rng(3)
    base = rng.uniform(4, 9, 50)
    batch = five_bar.create(base, rng.uniform(5, 8, (50, 2)), rng.uniform(6, 9, (50, 2)))
    legs, pose = legs_of(FIVE_BAR), jnp.array([3.0, 5.0])

    @jax.jit
    @jax.vmap
    def closing(robot):
        q = leg_joints(robot, legs, jnp.array([1.0, -1.0]), pose)
        return jnp.max(jnp.abs(robot.constraints(pose, q))), jnp.min(leg_discriminants(robot, legs, pose))

    residual, discriminant = map(np.asarray, closing(batch))
    reached = discriminant > 0
    assert reached.sum() > 25
    assert np.max(residual[reached]) < 1e-12


def test_the_joints_derivatives_are_those_of_implicit_differentiation():
    legs, pose = legs_of(FIVE_BAR), jnp.array([4.0, 6.5])
    signs = jnp.array([1.0, -1.0])
    slope = jax.jacobian(lambda x: leg_joints(FIVE_BAR, legs, signs, x))(pose)
    direct, inverse = jk.jacobians(FIVE_BAR, pose, leg_joints(FIVE_BAR, legs, signs, pose))
    np.testing.assert_allclose(slope, -np.linalg.solve(inverse, direct), rtol=1e-12)
    lengths = jax.grad(lambda r: leg_joints(r, legs, signs, pose)[0])(FIVE_BAR)
    q = leg_joints(FIVE_BAR, legs, signs, pose)
    by_length = jax.jacobian(lambda r: r.constraints(pose, q))(FIVE_BAR).proximal
    np.testing.assert_allclose(lengths.proximal[0], -by_length[0, 0] / inverse[0, 0], rtol=1e-12)
