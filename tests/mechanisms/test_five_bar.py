"""The five-bar: the generic solvers against circle intersections, the constructor's messages, batches, derivatives."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mechanisms import five_bar

ROBOT = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
UNEQUAL = five_bar.create(5.0, (3.0, 4.0), (6.0, 4.5))
robots = pytest.mark.parametrize("robot", [ROBOT, UNEQUAL], ids=["equal", "unequal"])
forward_batch = jax.jit(jax.vmap(jk.forward, in_axes=(None, 0)))
inverse_batch = jax.jit(jax.vmap(jk.inverse, in_axes=(None, 0)))


def elbows(robot, joints):
    """C1 and C2, ``(n, 2)`` each."""
    arms = np.stack([np.cos(joints), np.sin(joints)], axis=-1) * np.asarray(robot.proximal)[:, None]
    return arms[..., 0, :], arms[..., 1, :] + [float(robot.base), 0.0]


def assembly_modes(robot, joints):
    """The two intersections of the circles about C1 and C2 ``(2, n, 2)``, and half the distance between, squared."""
    (first, second), (l3, l4) = elbows(robot, joints), np.asarray(robot.distal)
    across = second - first
    d2 = np.sum(across**2, axis=-1)
    along = (d2 + l3**2 - l4**2) / (2 * d2)
    height2 = l3**2 - along**2 * d2
    normal = np.stack([-across[..., 1], across[..., 0]], axis=-1) / np.sqrt(d2)[..., None]
    foot = first + along[..., None] * across
    h = np.sqrt(np.maximum(height2, 0.0))[..., None]
    return np.stack([foot + h * normal, foot - h * normal]), height2


def crank_angles(robot, pose):
    """For each crank its two angles ``(n, 2 cranks, 2)``, and the cosines of their angles to the line of sight."""
    both, cosines = [], []
    for k, pivot in enumerate((0.0, float(robot.base))):
        crank, rod = float(robot.proximal[k]), float(robot.distal[k])
        x, y = pose[:, 0] - pivot, pose[:, 1]
        r = np.hypot(x, y)
        cosine = (crank**2 + r**2 - rod**2) / (2 * crank * r)
        turn = np.arccos(np.clip(cosine, -1, 1))
        both.append(np.stack([np.arctan2(y, x) + turn, np.arctan2(y, x) - turn], axis=1))
        cosines.append(cosine)
    return np.stack(both, axis=1), np.stack(cosines, axis=1)


def near_singular(rng, robot, n):
    """Crank angles at which C1 and C2 are so far apart as both rods reach, but for a share from 1e-13 to 1e-3."""
    reach = float(np.sum(np.asarray(robot.distal)))
    joints = []
    while len(joints) < n:
        q = rng.uniform(-np.pi, np.pi, 2)
        target = reach * (1 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-13, -3))
        l2, base = float(robot.proximal[1]), float(robot.base)
        c1 = elbows(robot, q)[0] - [base, 0.0]
        r = np.hypot(*c1)
        cosine = (r**2 + l2**2 - target**2) / (2 * r * l2)
        if abs(cosine) < 0.99:
            joints.append([q[0], np.arctan2(c1[1], c1[0]) + np.arccos(cosine)])
    return np.array(joints)


def gap(found, wanted, valid):
    """The distance from each wanted point ``(n, m)`` to the nearest valid lane ``(n, lanes, m)``."""
    away = np.max(np.abs(found - wanted[:, None]), axis=2)
    return np.min(np.where(valid, away, np.inf), axis=1)


@robots
def test_forward_finds_both_intersections_of_the_rods_circles(robot):
    rng = np.random.default_rng(0)
    joints = np.concatenate([rng.uniform(-np.pi, np.pi, (300, 2)), near_singular(rng, robot, 100)])
    modes = forward_batch(robot, jnp.asarray(joints))
    wanted, height2 = assembly_modes(robot, joints)
    values, valid = np.asarray(modes.values), np.asarray(modes.valid)
    # Nearer to the fold than this the two are one double pose in float64.
    clear = np.abs(height2) > 1e-6
    real = clear & (height2 > 0)
    np.testing.assert_array_equal(valid.sum(axis=1)[clear], np.where(real, 2, 0)[clear])
    for mode in wanted:
        slack = 1e-13 / np.sqrt(np.maximum(height2[real], 1e-300)) + 1e-12
        assert np.all(gap(values[real], mode[real], valid[real]) < 10 * slack)
    status = np.asarray(modes.status)[real][valid[real]]
    assert set(status.tolist()) == {int(jk.Status.COMPLETENESS_UNKNOWN)}
    assert np.nanmax(np.asarray(modes.residual)) <= 1e-12


@robots
def test_inverse_finds_all_four_working_modes(robot):
    rng = np.random.default_rng(1)
    pose = rng.uniform([-6, -8], [14, 8], (400, 2))
    # On the circles where a leg is stretched, but for shares from 1e-13 to 1e-3.
    phi = rng.uniform(-np.pi, np.pi, 100)
    r = (float(robot.proximal[0]) + float(robot.distal[0])) * (1 - 10.0 ** rng.uniform(-13, -3, 100))
    pose = np.concatenate([pose, np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)])
    modes = inverse_batch(robot, jnp.asarray(pose))
    angles, cosine = crank_angles(robot, pose)
    clear = np.min(np.abs(1 - np.abs(cosine)), axis=1) > 1e-6
    reached = clear & np.all(np.abs(cosine) < 1, axis=1)
    values, valid = np.asarray(modes.values), np.asarray(modes.valid)
    np.testing.assert_array_equal(valid.sum(axis=1)[clear], np.where(reached, 4, 0)[clear])
    assert reached.sum() > 100
    for first in (0, 1):
        for second in (0, 1):
            wanted = np.stack([angles[:, 0, first], angles[:, 1, second]], axis=1)[reached]
            turned = (values[reached] - wanted[:, None] + np.pi) % (2 * np.pi) - np.pi
            away = np.min(np.where(valid[reached], np.max(np.abs(turned), axis=2), np.inf), axis=1)
            slack = 1e-13 / np.min(np.sqrt(1 - cosine[reached] ** 2), axis=1)
            assert np.all(away < 10 * slack + 1e-12)
    assert np.all((values[valid] >= -np.pi) & (values[valid] < np.pi))
    assert set(np.asarray(modes.status)[reached][valid[reached]].tolist()) == {int(jk.Status.COMPLETENESS_UNKNOWN)}


def test_crank_ends_that_meet_are_a_self_motion():
    theta = math.acos(4.5 / 8)
    modes = jk.forward(ROBOT, [theta, math.pi - theta])
    assert set(np.asarray(modes.status).tolist()) == {int(jk.Status.SELF_MOTION)}
    assert modes.count == 0


def test_a_batch_of_robots_is_solved_robot_by_robot():
    rng = np.random.default_rng(2)
    base = rng.uniform(4, 9, 20)
    batch = five_bar.create(base, rng.uniform(5, 8, (20, 2)), rng.uniform(6, 9, (20, 2)))
    joints = rng.uniform(-np.pi, np.pi, (20, 2))
    together = jax.jit(jax.vmap(jk.forward))(batch, jnp.asarray(joints))
    for k in range(0, 20, 7):
        one = jax.tree.map(lambda leaf, k=k: leaf[k], batch)
        alone = jk.forward(one, joints[k])
        np.testing.assert_array_equal(np.asarray(alone.valid), np.asarray(together.valid)[k])
        np.testing.assert_allclose(np.asarray(alone.values), np.asarray(together.values)[k], atol=1e-12)


def test_the_derivatives_are_those_of_the_circles():
    joints = np.array([1.0, 1.9])
    pose = jk.forward(ROBOT, joints).values[0]
    slope = np.asarray(jax.jacobian(lambda q: jk.forward(ROBOT, q).values[0])(jnp.asarray(joints)))
    wanted = assembly_modes(ROBOT, joints[None])[0][:, 0]
    which = int(np.argmin(np.linalg.norm(wanted - np.asarray(pose), axis=1)))
    h = 1e-6
    numeric = np.stack(
        [
            (assembly_modes(ROBOT, (joints + h * e)[None])[0] - assembly_modes(ROBOT, (joints - h * e)[None])[0])[
                which, 0
            ]
            / (2 * h)
            for e in np.eye(2)
        ],
        axis=1,
    )
    np.testing.assert_allclose(slope, numeric, atol=1e-7)
    gradient = jax.grad(lambda r: jk.forward(r, joints).values[0, 0])(ROBOT)
    moved = [five_bar.create(9.0 + s * h, (8.0, 8.0), (5.0, 5.0)) for s in (1, -1)]
    numeric_base = np.diff([assembly_modes(r, joints[None])[0][which, 0, 0] for r in moved[::-1]]) / (2 * h)
    np.testing.assert_allclose(float(gradient.base), numeric_base[0], atol=1e-7)
    assert gradient.proximal.shape == (2,)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((-1.0, (8, 8), (5, 5)), ["base is -1", "not be negative"]),
        ((9.0, (8, 0), (5, 5)), ["proximal is (8, 0)", "positive"]),
        ((9.0, (8, 8), (5, -5)), ["distal is (5, -5)", "positive"]),
        ((30.0, (8, 8), (5, 5)), ["base is 30", "only 26", "does not close"]),
        ((1.0, (20, 8), (5, 5)), ["proximal[0] is 20", "only 19", "does not close"]),
        ((9.0, (8, 8, 8), (5, 5)), ["proximal has shape (3,)", "2 numbers"]),
        ((9.0, "long", (5, 5)), ["proximal is 'long'", "must be a number"]),
        ((math.nan, (8, 8), (5, 5)), ["base is nan", "finite"]),
    ],
)
def test_the_constructor_says_what_is_wrong(arguments, words):
    with pytest.raises(jk.GeometryError) as caught:
        five_bar.create(*arguments)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [([-1.0, 0.0], [-2.0, 1.0], ["theta1", "exchange"]), ([0.0, 0.0], [1.0, 6.0], ["6 rad", "between -pi and pi"])],
)
def test_the_constructor_refuses_limits_that_no_crank_angle_can_keep(low, high, words):
    with pytest.raises(jk.GeometryError) as caught:
        five_bar.create(9.0, (8, 8), (5, 5), jk.Limits(jnp.array(low), jnp.array(high)))
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_limits_leave_out_the_working_modes_beyond_them():
    robot = five_bar.create(9.0, (8, 8), (5, 5)).with_limits(theta1=(0.0, math.pi))
    pose = np.array([4.5, 1.0])
    free, kept = jk.inverse(ROBOT, pose), jk.inverse(robot, pose)
    inside = np.asarray(free.valid) & (np.asarray(free.values)[:, 0] >= 0)
    assert int(kept.count) == int(inside.sum()) < int(free.count)
