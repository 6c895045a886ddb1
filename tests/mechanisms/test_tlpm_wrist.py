"""Wrists and links of the TLPM against certified balls, loop closure, symmetries, and what the paper prints."""

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.core.errors import InputError
from jaxkin.mechanisms import _tlpm_wrist as wrist
from jaxkin.mechanisms import tlpm
from tests.oracles import tlpm_exact

ROBOT = tlpm.create()
HOME = np.zeros(3)
P1 = np.array([100.0, 100.0, 100.0])
BOUND = math.sqrt(2) * 25.0
GENERAL = {
    "base_radius": 520.0,
    "height": 640.0,
    "limb_angles": (0.1, 2.0, -2.3),
    "platform_angles": (-0.2, 2.2, -1.9),
    "beta2": 0.6,
    "a": 20.0,
    "b": 140.0,
    "r1": 155.0,
    "r2": 105.0,
}
#: Limb 1 at p = 0 and L = h: its R2 axis on the limb's axis, towards the base and away from it.
ON_AXIS = ((math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0), (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0))


def rotation(axis, angle):
    c, s = math.cos(angle), math.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    return matrix


def matrix_of(quaternion):
    w, *v = np.asarray(quaternion, float) / np.linalg.norm(quaternion)
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def product(p, q):
    """The Hamilton product of two quaternions."""
    w, v, x, u = p[0], np.asarray(p[1:]), q[0], np.asarray(q[1:])
    return np.array([w * x - v @ u, *(w * u + x * v + np.cross(v, u))])


def about_z(angle):
    return np.array([math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)])


def turned(angle):
    """An angle as the nearest one to zero."""
    return np.abs(np.angle(np.exp(1j * np.asarray(angle))))


def base_point(robot, k):
    return rotation(2, float(robot.limb_angles[k])) @ [float(robot.base_radius), 0.0, -float(robot.height)]


def limb_frame(robot, pose, k):
    """R_i0 with the tangent, where limb k has a length and is not along its tangent."""
    z = base_point(robot, k) - pose
    z = z / np.linalg.norm(z)
    tangent = rotation(2, float(robot.limb_angles[k])) @ [0.0, 1.0, 0.0]
    x = np.cross(tangent, z)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1), tangent


def platform_frame(robot, k):
    """v_i, a product of rotations (Eq. (20), with the platform's rotation)."""
    fixed = rotation(2, float(robot.platform_angles[k])) @ rotation(1, float(robot.beta2)) @ rotation(0, math.pi / 2)
    return matrix_of(robot.orientation) @ fixed


def chain(theta1, theta2, psi):
    """The wrist's rotations from the limb to the platform."""
    active = rotation(2, psi) @ rotation(0, math.pi / 2)
    return active @ rotation(2, theta1) @ rotation(1, math.pi / 2 - theta2)


@jax.jit
def solved(robot, pose):
    """Margins ``(24,)``, angles and links by one compilation for each choice of elbows, which are most of the time."""
    margins = wrist.margins(robot, (pose[0], pose[1], pose[2]))
    return jnp.stack(list(margins.values())), wrist.wrist_angles(robot, pose), wrist.links(robot, pose)


def all_margins(robot, pose):
    return solved(robot, pose)[0]


def wrist_angles(robot, pose):
    return wrist.WristAngles(*map(np.asarray, solved(robot, pose)[1]))


def clearances(robot, pose):
    return dict(zip(wrist.CLEARANCE_NAMES, map(float, all_margins(robot, pose)[12:]), strict=True))


def assume_bent(robot, pose):
    """Leaves out where the R2 axis is within 1e-4 of the limb's axis: there angles carry a rounding of 1e-16 / sine."""
    assume(np.abs(np.sin(wrist_angles(robot, pose).theta1)).min() > 1e-4)


quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-3)
poses = st.tuples(*[st.floats(-250, 250)] * 3).map(np.array)
#: Every choice of elbows is compiled apart; these have equal and unequal ones at all pairs of limbs.
signs = st.sampled_from([(1, 1, 1), (1, -1, -1)])


# --- known numbers ----------------------------------------------------------------------------------------------------


def by_kind(values):
    """Distances of links 2, of links 3, and of links 2 with links 3."""
    numbers = np.array([float(value) for value in values.values()]) + BOUND
    return numbers[:3], numbers[3:6], numbers[6:]


def test_home():
    angles = wrist.wrist_angles(ROBOT, HOME)
    np.testing.assert_allclose(angles.theta1, math.pi / 2, atol=1e-14)
    np.testing.assert_allclose(angles.theta2, math.pi / 2, atol=1e-14)
    np.testing.assert_allclose(angles.psi, 0, atol=1e-14)
    two, three, mixed = by_kind(wrist.link_clearances(ROBOT, HOME))
    np.testing.assert_allclose(two, 113.4431, atol=5e-5)
    np.testing.assert_allclose(three, 86.7110, atol=5e-5)
    assert mixed.min() == pytest.approx(119.9654, abs=5e-5)


def test_first_position_of_table_1():
    angles = wrist.wrist_angles(ROBOT, P1)
    np.testing.assert_allclose(np.rad2deg(angles.theta1), [99.5526, 96.1958, 88.5209], atol=5e-5)
    np.testing.assert_allclose(np.rad2deg(angles.theta2), [83.1658, 98.8314, 87.9073], atol=5e-5)
    smallest = [kind.min() for kind in by_kind(wrist.link_clearances(ROBOT, P1))]
    np.testing.assert_allclose(smallest, [102.2446, 76.8709, 107.6574], atol=5e-5)


@pytest.mark.parametrize("elbow", [1, -1])
def test_yaw_at_home_is_free_from_60_to_47_degrees(elbow):
    # At +-180 degrees all R2 axes lie on the limbs' axes, theta1 = pi: on the limit, and so not free.
    def least(yaw):
        turn = jnp.stack([jnp.cos(yaw / 2), 0 * yaw, 0 * yaw, jnp.sin(yaw / 2)])
        return jnp.min(all_margins(ROBOT.replace(orientation=turn, elbows=(elbow,) * 3), HOME))

    degrees = np.arange(-1800, 1801) / 10
    free = degrees[np.asarray(jax.vmap(least)(jnp.deg2rad(degrees))) > 0] * elbow
    low, high = free.min(), free.max()
    assert (low, high) == pytest.approx((-60.5, 47.3), abs=0.11)
    assert len(free) == round((high - low) * 10) + 1


@pytest.mark.slow
def test_angles_and_clearances_over_the_workspace():
    """Strokes of +-200 mm: the upper mode is free throughout, the lower one, no mirror image, almost nowhere."""
    strokes = np.random.default_rng(2).uniform(-200, 200, (20000, 3))
    upper, lower = ROBOT.forward_kernel(tuple(jnp.asarray(strokes.T)))
    angles = np.min(list(wrist.angle_margins(ROBOT, upper.values).values()), axis=0)
    clearances = np.min(list(wrist.clearances(ROBOT, upper.values).values()), axis=0)
    assert np.rad2deg(angles.min()) > 25
    assert clearances.min() > 0
    free = np.min(list(wrist.margins(ROBOT, lower.values).values()), axis=0) >= 0
    assert 0 < free.mean() < 0.003


# --- the oracle -------------------------------------------------------------------------------------------------------


def test_certified_balls_agree():
    rng = np.random.default_rng(7)
    calls = jax.jit(lambda r, x: (wrist.wrist_angles(r, x), wrist.links(r, x), wrist.clearances(r, tuple(x))))
    worst = 0.0
    for k in range(96):
        radius, height, b, r1, r2 = rng.uniform((500, 500, 100, 100, 80), (700, 700, 200, 200, 150))
        pose, quaternion = rng.uniform(-300, 300, 3), rng.normal(size=4) * 10 ** rng.uniform(-3, 3)
        if k % 4 == 0:
            quaternion[0] = 20 * np.linalg.norm(quaternion)
        elbows = wrist.ELBOW_MODES[k % 8 if k % 3 == 0 else 2]
        robot = tlpm.create(radius, height, orientation=quaternion, elbows=elbows, b=b, r1=r1, r2=r2)
        limbs = tlpm_exact.wrist(tlpm_exact.Machine(radius, height), pose, quaternion, elbows, prec=128)
        angles, links, clearances = calls(robot, pose)
        for found, name in zip(angles, ("theta1", "theta2", "psi"), strict=True):
            worst = max(worst, turned(np.asarray(found) - [float(getattr(limb, name)) for limb in limbs]).max())
        exact = tlpm_exact.distances(pose, limbs, b, r1, r2, prec=128)
        values = [float(v) - BOUND for v in (*exact.d22, *exact.d33, *exact.d23)]
        np.testing.assert_allclose([clearances[n] for n in wrist.CLEARANCE_NAMES], values, atol=1e-9, rtol=0)
        two, three = zip(*(tlpm_exact.links(pose, limb, b, r1, r2) for limb in limbs), strict=True)
        ends = np.array([[[float(v) for v in end] for end in link] for link in (*two, *three)])
        np.testing.assert_allclose(links, ends, atol=1e-9, rtol=0)
    assert worst < 1e-9


# --- laws -------------------------------------------------------------------------------------------------------------


@given(poses, quaternions, signs)
@settings(max_examples=60)
def test_the_wrist_closes_the_loop(pose, quaternion, elbows):
    """v_i = R_i0 Rz(psi) Rx(pi/2) Rz(theta1) Ry(pi/2 - theta2) for a robot without symmetry."""
    robot = tlpm.create(**GENERAL).replace(orientation=jnp.asarray(quaternion), elbows=elbows)
    angles = wrist_angles(robot, pose)
    for k in range(3):
        frame, _ = limb_frame(robot, pose, k)
        closed = frame @ chain(*(float(angle[k]) for angle in angles))
        np.testing.assert_allclose(closed, platform_frame(robot, k), atol=1e-12)
        assert 0 <= elbows[k] * angles.theta1[k] <= math.pi


@given(poses, quaternions, signs)
@settings(max_examples=25)
def test_links_lie_on_the_axes(pose, quaternion, elbows):
    robot = tlpm.create(**GENERAL).replace(orientation=jnp.asarray(quaternion), elbows=elbows)
    links = np.asarray(solved(robot, pose)[2]) - pose
    angles = wrist_angles(robot, pose)
    for k in range(3):
        (begin, joint), (same, end) = links[k], links[3 + k]
        frame, _ = limb_frame(robot, pose, k)
        np.testing.assert_allclose(begin, 140.0 * frame[:, 2], atol=1e-10)
        np.testing.assert_allclose(same, joint, atol=1e-10)
        np.testing.assert_allclose(end, 105.0 * platform_frame(robot, k)[:, 1], atol=1e-10)
        r1_axis = frame @ rotation(2, float(angles.psi[k])) @ rotation(0, math.pi / 2) @ [0.0, 0.0, 1.0]
        np.testing.assert_allclose(joint, 155.0 * r1_axis, atol=1e-9)


@given(poses, quaternions, signs)
@settings(max_examples=25)
def test_a_turn_by_120_degrees_renames_the_limbs(pose, quaternion, elbows):
    third = 2 * math.pi / 3
    robot = ROBOT.replace(orientation=jnp.asarray(quaternion), elbows=elbows)
    around = product(product(about_z(third), quaternion), about_z(-third))
    other = ROBOT.replace(orientation=jnp.asarray(around), elbows=(elbows[2], elbows[0], elbows[1]))
    moved = rotation(2, third) @ pose
    assume_bent(robot, pose)
    for old, new in zip(wrist_angles(robot, pose), wrist_angles(other, moved), strict=True):
        assert turned(np.roll(old, 1) - new).max() < 1e-9
    names = {"1": "2", "2": "3", "3": "1"}
    old, new = clearances(robot, pose), clearances(other, moved)
    for name, value in old.items():
        (i, m), (j, n) = ((names[link[1]], link[2]) for link in name.split("-"))
        partner = f"L{i}{m}-L{j}{n}"
        assert value == pytest.approx(new[partner if partner in new else f"L{j}{n}-L{i}{m}"], abs=1e-9)


@given(poses, quaternions, signs)
@settings(max_examples=25)
def test_a_mirror_image_exchanges_limbs_2_and_3_and_the_elbows(pose, quaternion, elbows):
    """y -> -y negates every angle, psi but for half a turn; the limits on e theta are those of the image."""
    w, x, y, z = quaternion
    image = ROBOT.replace(orientation=jnp.asarray([w, -x, y, -z]), elbows=tuple(-elbows[k] for k in (0, 2, 1)))
    robot, seen = ROBOT.replace(orientation=jnp.asarray(quaternion), elbows=elbows), pose * (1, -1, 1)
    assume_bent(robot, pose)
    old, new = wrist_angles(robot, pose), wrist_angles(image, seen)
    swap = np.array([0, 2, 1])
    assert turned(old.theta1 + new.theta1[swap]).max() < 1e-9
    assert turned(old.theta2 + new.theta2[swap]).max() < 1e-9
    assert turned(old.psi + new.psi[swap] + math.pi).max() < 1e-9
    np.testing.assert_allclose(np.sort(all_margins(robot, pose)), np.sort(all_margins(image, seen)), atol=1e-9)


@given(poses, quaternions, signs, st.floats(-3, 3), st.floats(-400, 400))
@settings(max_examples=25)
def test_the_place_of_the_whole_robot_does_not_matter(pose, quaternion, elbows, angle, lift):
    """Base and platform turned about z together, and the base plane moved with p."""
    robot = tlpm.create(**GENERAL).replace(orientation=jnp.asarray(quaternion), elbows=elbows)
    moved = robot.replace(
        limb_angles=robot.limb_angles + angle,
        orientation=jnp.asarray(product(about_z(angle), quaternion)),
        height=robot.height - lift,
    )
    place = rotation(2, angle) @ pose + [0.0, 0.0, lift]
    assume_bent(robot, pose)
    for old, new in zip(wrist_angles(robot, pose), wrist_angles(moved, place), strict=True):
        assert turned(old - new).max() < 1e-9
    np.testing.assert_allclose(all_margins(robot, pose), all_margins(moved, place), atol=1e-9)
    turn = solved(robot, pose)[2] @ rotation(2, angle).T + np.array([0.0, 0.0, lift])
    np.testing.assert_allclose(turn, solved(moved, place)[2], atol=1e-8)


@given(poses, quaternions)
@settings(max_examples=25)
def test_the_other_elbow_turns_psi_and_theta2_by_pi_and_negates_theta1(pose, quaternion):
    robot = ROBOT.replace(orientation=jnp.asarray(quaternion))
    one, other = (wrist_angles(robot.replace(elbows=(e,) * 3), pose) for e in (1, -1))
    np.testing.assert_array_equal(one.theta1, -other.theta1)
    assert turned(one.theta2 - other.theta2 + math.pi).max() < 1e-12
    assert turned(one.psi - other.psi + math.pi).max() < 1e-12


@given(poses, quaternions, signs)
@settings(max_examples=15)
def test_elbow_modes_are_the_margins_of_the_eight_robots(pose, quaternion, elbows):
    robot = ROBOT.replace(orientation=jnp.asarray(quaternion), elbows=elbows)
    assume_bent(robot, pose)
    modes = wrist.elbow_modes(robot, pose)
    assert [tuple(row) for row in np.asarray(modes.elbows)] == list(itertools.product((1, -1), repeat=3))
    for k, choice in enumerate(wrist.ELBOW_MODES):
        margins = all_margins(robot.replace(elbows=choice), pose)
        assert modes.angle[k] == pytest.approx(float(jnp.min(margins[:12])), abs=1e-10)
        assert modes.clearance[k] == pytest.approx(float(jnp.min(margins[12:])), abs=1e-9)
        assert modes.free[k] == (jnp.min(margins) > 0)


def test_only_equal_elbows_are_free_at_home():
    """Unequal elbows of two limbs make their links 2 meet, in the plane halfway between the limbs."""
    modes = wrist.elbow_modes(ROBOT, HOME)
    assert modes.free.tolist() == [True] + 6 * [False] + [True]
    np.testing.assert_allclose(modes.clearance[1:7], -BOUND, atol=1e-9)


# --- margins ----------------------------------------------------------------------------------------------------------


def test_names_and_order():
    names = list(wrist.margins(ROBOT, (0.0, 0.0, 0.0)))
    assert names[:4] == ["theta11_low", "theta11_high", "theta12_low", "theta12_high"]
    assert names[8:12] == ["theta31_low", "theta31_high", "theta32_low", "theta32_high"]
    assert names[12:15] == ["L12-L22", "L12-L32", "L22-L32"]
    assert names[15:18] == ["L13-L23", "L13-L33", "L23-L33"]
    assert names[18:] == ["L12-L23", "L12-L33", "L22-L13", "L22-L33", "L32-L13", "L32-L23"]
    assert list(wrist.link_clearances(ROBOT, HOME)) == names[12:]
    assert names == list(jk.margins(ROBOT, HOME, np.zeros(3)))[-24:]


@pytest.mark.parametrize("elbow", [1, -1])
def test_angle_margins_pass_their_limits_and_the_whole_circle_continuously(elbow):
    """The platform turns once about R2 axis 1, so that theta_12 runs through every value and theta_11 stays."""
    axis = np.array([math.sqrt(0.5), 0.0, math.sqrt(0.5)])
    turns = np.linspace(-math.pi, math.pi, 2001)
    robot = ROBOT.replace(elbows=(elbow,) * 3)

    def margins(turn):
        quaternion = jnp.concatenate([jnp.cos(turn / 2)[None], jnp.sin(turn / 2) * axis])
        found = wrist.margins(robot.replace(orientation=quaternion), (0.0, 0.0, 0.0))
        return jnp.stack([found[f"theta1{name}"] for name in ("1_low", "1_high", "2_low", "2_high")])

    one_low, one_high, low, high = np.asarray(jax.vmap(margins)(turns)).T
    np.testing.assert_allclose(one_low, math.pi / 2 - math.pi / 10, atol=1e-12)
    np.testing.assert_allclose(one_high, math.pi / 2, atol=1e-12)
    np.testing.assert_allclose(low + high, 5 * math.pi / 6, atol=1e-12)
    # At Q = 1 it is 90 degrees; a turn of the platform takes its own zero along.
    assert turned(low + math.pi / 6 - (math.pi / 2 - elbow * turns)).max() < 1e-12
    smaller = np.minimum(low, high)
    assert np.abs(np.diff(smaller)).max() < 1.01 * (turns[1] - turns[0])
    assert smaller.max() == pytest.approx(5 * math.pi / 12, abs=2e-3)
    assert smaller.min() == pytest.approx(5 * math.pi / 12 - math.pi, abs=2e-3)
    assert (smaller > 0).mean() == pytest.approx(5 / 12, abs=2e-3)
    across = np.flatnonzero(np.diff(np.sign(high)) != 0)
    assert np.abs(high[across]).min() < 0.01


def test_limits_may_be_infinite():
    wide = jk.Limits(jnp.array([-jnp.inf, -jnp.inf]), jnp.array([jnp.inf, 3.0]))
    robot = ROBOT.replace(wrist_limits=wide)
    margins = wrist.margins(robot, tuple(P1))
    assert margins["theta11_low"] == margins["theta12_low"] == margins["theta11_high"] == jnp.inf
    assert margins["theta12_high"] == pytest.approx(3.0 - np.deg2rad(83.1658), abs=1e-6)
    gradient = jax.grad(lambda x: wrist.margins(robot, tuple(x))["theta12_high"])(P1)
    assert np.all(np.isfinite(gradient))
    assert np.linalg.norm(gradient) > 1e-4


@pytest.mark.slow
def test_a_positive_clearance_excludes_contact_and_no_smaller_bound_does():
    """Two bars of square section at any roll about their axes, by the points of their bodies."""
    rng = np.random.default_rng(5)
    links = np.asarray(wrist.links(ROBOT, P1))
    apart = np.array(list(wrist.link_clearances(ROBOT, P1).values()))

    def body(link, roll):
        """Points over the four sides of a bar and over its end faces."""
        along = (link[1] - link[0]) / np.linalg.norm(link[1] - link[0])
        across = np.cross(along, [0.3, 0.5, 0.8])
        across /= np.linalg.norm(across)
        u, v = across, np.cross(along, across)
        u, v = math.cos(roll) * u + math.sin(roll) * v, math.cos(roll) * v - math.sin(roll) * u
        grid = np.stack(np.meshgrid(np.linspace(0, 1, 31), [-1, 0, 1], [-1, 0, 1]), -1).reshape(-1, 3)
        return link[0] + grid[:, :1] * (link[1] - link[0]) + 12.5 * (grid[:, 1:2] * u + grid[:, 2:] * v)

    for _ in range(20):
        bodies = [body(link, roll) for link, roll in zip(links, rng.uniform(0, 2 * math.pi, 6), strict=True)]
        for (i, j), clearance in zip(wrist._PAIRS, apart, strict=True):
            gaps = np.linalg.norm(bodies[i][:, None] - bodies[j][None], axis=-1)
            assert gaps.min() >= clearance
    # Parallel bars whose edges face each other touch at sqrt(2) a.
    bar = np.array([[0.0, 0, 0], [100, 0, 0]])
    lower = body(bar, 0.0)
    edge = lower[np.argmax(np.linalg.norm(lower[:, 1:], axis=1))] * (0, 1, 1)
    upper = body(bar + 2 * edge, 0.0)
    assert 2 * np.linalg.norm(edge) == pytest.approx(BOUND)
    assert np.linalg.norm(lower[:, None] - upper[None], axis=-1).min() < 1e-9


@given(poses, quaternions, signs, st.floats(0, 40))
@settings(max_examples=20)
def test_overhang_makes_the_links_longer(pose, quaternion, elbows, overhang):
    robot = tlpm.create(**GENERAL).replace(orientation=jnp.asarray(quaternion), elbows=elbows)
    axes = np.asarray(wrist.links(robot, pose))
    run = axes[:, 1] - axes[:, 0]
    lengths = np.linalg.norm(run, axis=1)
    np.testing.assert_allclose(lengths, 3 * [math.hypot(140, 155)] + 3 * [math.hypot(155, 105)])
    more = overhang * run / lengths[:, None]
    ends = np.stack([axes[:, 0] - more, axes[:, 1] + more], axis=1)
    longer = [tuple(tuple(tlpm_exact.ball(float(v)) for v in end) for end in link) for link in ends]
    found = wrist.link_clearances(robot, pose, overhang)
    for (i, j), clearance in zip(wrist._PAIRS, found.values(), strict=True):
        exact = float(tlpm_exact.segment_distance(longer[i], longer[j])) - math.sqrt(2) * 20.0
        assert clearance == pytest.approx(exact, abs=1e-9)


# --- derivatives ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_derivatives_are_difference_quotients():
    rng = np.random.default_rng(11)

    def everything(vector):
        robot = tlpm.create(**GENERAL).replace(
            orientation=vector[:4], beta2=vector[4], b=vector[5], r1=vector[6], r2=vector[7], elbows=(1, -1, 1)
        )
        margins, angles, links = solved(robot, vector[8:])
        return jnp.concatenate([margins, *angles, links.ravel()])

    slopes, values = jax.jit(jax.jacfwd(everything)), jax.jit(jax.vmap(everything))
    scale = np.array([1, 1, 1, 1, 1, 100, 100, 100, 100, 100, 100.0])
    steps = np.diag(1e-5 * scale)
    for _ in range(20):
        sizes, point = rng.uniform(100, 200, 3), rng.uniform(-200, 200, 3)
        vector = np.concatenate([rng.normal(size=4), [rng.uniform(0.3, 1)], sizes, point])
        vector[0] += 3
        slope = np.asarray(slopes(vector))
        quotient = (np.asarray(values(vector + steps)) - np.asarray(values(vector - steps))).T / (2e-5 * scale)
        # Away from kinks of the distances, where the closest point leaves an end of a segment, to second order.
        np.testing.assert_allclose(slope * scale, quotient * scale, rtol=2e-5, atol=2e-3)


def _everything(robot, pose, orientation):
    turned_robot = robot.replace(orientation=orientation)
    return jnp.concatenate([all_margins(turned_robot, pose), *solved(turned_robot, pose)[1]])


_reverse = jax.jit(jax.jacrev(_everything, argnums=(1, 2)))
_forward = jax.jit(jax.jacfwd(_everything, argnums=(1, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("derivative", [_reverse, pytest.param(_forward, marks=pytest.mark.slow)], ids=["vjp", "jvp"])
@pytest.mark.parametrize(
    ("pose", "orientation", "elbows"),
    [
        (HOME, ON_AXIS[0], (1, 1, 1)),
        (HOME, ON_AXIS[0], (-1, 1, 1)),
        (HOME, ON_AXIS[1], (1, 1, 1)),
        (HOME, ON_AXIS[1], (-1, 1, 1)),
        ((590.0, 0.0, -590.0), (1.0, 0, 0, 0), (1, 1, 1)),
        ((590.0, 0.0, -590.0), (0.0, 1.0, 0, 0), (-1, 1, 1)),
        ((590.0, 100.0, -590.0), (1.0, 0, 0, 0), (1, 1, 1)),
        ((590.0, -100.0, -590.0), (0.5, 0.5, 0.5, 0.5), (-1, 1, 1)),
        (HOME, (1.0, 0, 0, 0), (-1, 1, 1)),
    ],
    ids=["R2 down", "R2 down, e=-1", "R2 up", "R2 up, e=-1", "p=q1", "p=q1, over", "tangent", "tangent 2", "touching"],
)
def test_derivatives_are_finite_where_nothing_is_determined(pose, orientation, elbows, derivative):
    robot, pose = ROBOT.replace(orientation=jnp.asarray(orientation), elbows=elbows), jnp.asarray(pose)

    assert all(np.all(np.isfinite(part)) for part in jax.tree_util.tree_leaves(solved(robot, pose)))
    assert all(np.all(np.isfinite(slope)) for slope in derivative(robot, pose, robot.orientation))


@pytest.mark.parametrize("elbow", [1, -1])
@pytest.mark.parametrize(("orientation", "angle"), list(zip(ON_AXIS, (0.0, math.pi), strict=True)), ids=["0", "pi"])
def test_the_loop_closes_where_psi_and_theta2_turn_about_one_line(orientation, angle, elbow):
    robot = ROBOT.replace(orientation=jnp.asarray(orientation), elbows=(elbow, 1, 1))
    angles = wrist.wrist_angles(robot, HOME)
    # Neither an exact multiple of pi in float64 nor off by more than rounding.
    assert angles.theta1[0] == pytest.approx(elbow * angle, abs=1e-15)
    assert angles.theta2[0] == pytest.approx(elbow * math.pi / 2)
    frame, _ = limb_frame(robot, HOME, 0)
    closed = frame @ chain(*(float(value[0]) for value in angles))
    np.testing.assert_allclose(closed, platform_frame(robot, 0), atol=1e-14)
    assert float(wrist.margins(robot, tuple(HOME))["theta11_low"]) == pytest.approx(angle - math.pi / 10)
    # Close to it, the angles are those of the direction of approach, and the loop closes just as well.
    for tilt in np.logspace(-12, -3, 10):
        near = product((math.cos(tilt), 0.0, math.sin(tilt), 0.0), product(about_z(tilt / 2), orientation))
        moved = robot.replace(orientation=jnp.asarray(near))
        values = wrist_angles(moved, HOME)
        closed = frame @ chain(*(float(value[0]) for value in values))
        np.testing.assert_allclose(closed, platform_frame(moved, 0), atol=2e-15 / tilt + 1e-14)


@pytest.mark.parametrize("side", [100.0, -100.0])
def test_the_limb_along_its_tangent_has_the_radial_x_axis(side):
    pose = np.array([590.0, side, -590.0])
    angles = wrist.wrist_angles(ROBOT, pose)
    z = np.array([0.0, -math.copysign(1, side), 0.0])
    x = np.array([-1.0, 0.0, 0.0])
    frame = np.stack([x, np.cross(z, x), z], axis=1)
    closed = frame @ chain(*(float(value[0]) for value in angles))
    np.testing.assert_allclose(closed, platform_frame(ROBOT, 0), atol=1e-14)


def test_a_limb_without_length_points_down():
    pose = np.array([590.0, 0.0, -590.0])
    links = np.asarray(wrist.links(ROBOT, pose))
    np.testing.assert_allclose(links[0, 0] - pose, [0, 0, -150.0], atol=1e-12)
    assert float(wrist.wrist_angles(ROBOT, pose).theta1[0]) == pytest.approx(3 * math.pi / 4)


# --- the print --------------------------------------------------------------------------------------------------------


def printed(pose, k, invert):
    """(22) and (23) with R_i0 of (16)-(18), R_i1 = 1; also that R_i0."""
    frame, tangent = limb_frame(ROBOT, pose, k)
    wrong = np.stack([frame[:, 0], tangent, frame[:, 2]], axis=1)
    rest = invert(wrong) @ platform_frame(ROBOT, k)
    return -math.atan2(rest[0, 1], rest[1, 1]), -math.atan2(rest[2, 0], rest[2, 2]), wrong


@pytest.mark.parametrize("k", range(3))
def test_the_print_holds_in_the_vertical_plane_of_the_limb(k):
    """(22) gives psi + pi/2, not theta1, and (23) -theta2; for Q = 1 they are 90 and -90 degrees."""
    for radius, z in ((0.0, 0.0), (120.0, -50.0), (-200.0, 200.0), (300.0, 100.0)):
        pose = rotation(2, float(ROBOT.limb_angles[k])) @ [radius, 0.0, z]
        angles = wrist.wrist_angles(ROBOT, pose)
        first, second, frame = printed(pose, k, np.linalg.inv)
        np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-14)
        assert first == pytest.approx(float(angles.psi[k]) + math.pi / 2, abs=1e-12)
        assert second == pytest.approx(-float(angles.theta2[k]), abs=1e-12)


def test_the_print_elsewhere():
    """Off that plane R_i0 is no rotation; its inverse makes (23) constant, its transpose spares (23), not (22)."""
    errors = {np.linalg.inv: [], np.transpose: []}
    grid = np.linspace(-200, 200, 5)
    for pose in map(np.array, itertools.product(grid, repeat=3)):
        angles = wrist_angles(ROBOT, pose)
        for k, invert in itertools.product(range(3), errors):
            first, second, frame = printed(pose, k, invert)
            _, tangent = limb_frame(ROBOT, pose, k)
            skew = -tangent @ pose / np.linalg.norm(base_point(ROBOT, k) - pose)
            np.testing.assert_allclose((frame.T @ frame)[1, 2], skew, atol=1e-14)
            if invert is np.linalg.inv:
                assert second == pytest.approx(-math.pi / 2, abs=1e-12)
            errors[invert].append((turned(first - angles.psi[k] - math.pi / 2), turned(second + angles.theta2[k])))
    inverse, transpose = (np.rad2deg(np.max(errors[invert], axis=0)) for invert in errors)
    assert inverse[1] == pytest.approx(23.078, abs=1e-3)
    assert transpose == pytest.approx([4.961, 0.0], abs=1e-3)


def test_the_matrix_under_19_has_a_wrong_sign():
    c1, s1, c2, s2 = math.cos(0.4), math.sin(0.4), math.cos(1.1), math.sin(1.1)
    print_ = np.array([[c1 * c2, -s1, c1 * s2], [c2 * s1, c1, -s1 * s2], [-s2, 0, c2]])
    right = rotation(2, 0.4) @ rotation(1, 1.1)
    wrong = np.abs(print_ - right) > 1e-15
    assert np.argwhere(wrong).tolist() == [[1, 2]]
    assert np.abs(print_.T @ print_ - np.eye(3)).max() > 0.1


# --- use --------------------------------------------------------------------------------------------------------------


def test_batches_of_poses_and_of_robots():
    rng = np.random.default_rng(3)
    points = rng.uniform(-200, 200, (5, 3))
    columns = wrist.margins(ROBOT, tuple(jnp.asarray(points.T)))
    mapped = jax.vmap(lambda x: all_margins(ROBOT, x))(points)
    np.testing.assert_allclose(np.stack(list(columns.values()), 1), mapped, atol=1e-11)
    turns = jnp.array([[1.0, 0, 0, 0], [2.0, 0.1, 0, 0]])
    robots = tlpm.create(base_radius=jnp.array([500.0, 590.0]), orientation=turns)
    together = jax.vmap(wrist.wrist_angles, in_axes=(0, None))(robots, P1)
    for k in range(2):
        one = jax.tree_util.tree_map(lambda leaf, k=k: leaf[k], robots)
        for batch, single in zip(together, wrist.wrist_angles(one, P1), strict=True):
            np.testing.assert_allclose(batch[k], single, atol=1e-13)


@pytest.mark.parametrize("function", [wrist.wrist_angles, wrist.links, wrist.link_clearances, wrist.elbow_modes])
def test_a_pose_has_three_coordinates(function):
    with pytest.raises(InputError, match=r"\(4, 3\).*vmap"):
        function(ROBOT, np.zeros((4, 3)))
