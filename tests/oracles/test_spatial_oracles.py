"""The oracles of the 3-PPPS and TLPM robots checked on answers known by other means."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from flint import arb, arb_mat, ctx, fmpq

from . import ppps3_exact as ppps3
from . import tlpm_exact as tlpm
from .ppps3_exact import Platform, nearest, turn
from .rpr3_exact import ExactCount, SelfMotion, rational
from .tlpm_exact import Machine

HALF_ROOT3 = math.sqrt(3) / 2
HOME = (0, 0, HALF_ROOT3, 0, -HALF_ROOT3, 0)
MACHINE = Machine(590, 590)
P1 = (100, 100, 100)
NO_TURN = (1, 0, 0, 0)


def joints_of(m2, p, m3, shift=(0, 0, 0)):
    """Returns joints with mu2z = m2, mu3y = p, mu3z = m3 in exact arithmetic."""
    m2, p, m3, y1, z1, y2 = (rational(v) for v in (m2, p, m3, *shift))
    return [y1, z1, y2, z1 + m2, p - y2, z1 + m3]


def floats(values):
    return [float(v.mid()) for v in values]


def matrix(pose):
    return np.array(pose.floats()[1])


def degrees(values):
    return [math.degrees(v) for v in floats(values)]


# --- 3-PPPS -----------------------------------------------------------------------------------------------------------


def test_the_home_joints_have_four_poses_one_per_sign_pair():
    poses = ppps3.forward(HOME)
    np.testing.assert_allclose(matrix(poses[-1]), np.eye(3), atol=1e-15)
    np.testing.assert_allclose(poses[-1].floats()[0], 0, atol=1e-15)
    np.testing.assert_allclose(floats(poses[-1].passive), [0, -0.5, -0.5], atol=1e-15)
    signs = [(matrix(p)[1, 1] > 0, matrix(p)[2, 2] > 0) for p in poses]
    assert signs == [(False, False), (False, True), (True, False), (True, True)]


@pytest.mark.parametrize(
    ("joints", "platform", "expected"),
    [
        (HOME, Platform(), (4, False)),
        (joints_of(1, 0, 0.5), Platform(), (2, True)),  # R33 = 0
        (joints_of(0, 1, 0), Platform(), (2, True)),  # R22 = 0
        (joints_of(-1, fmpq(3, 5), fmpq(-1, 5)), Platform(height=1), (1, True)),  # R22 = R33 = 0
        (joints_of(-0.9, 0.6, 0.1), Platform(), (0, False)),  # R22^2 < 0 only
        (joints_of(0.9, 0, 0.9), Platform(), (0, False)),  # R33^2 < 0 only
        (joints_of(1, 1, -1), Platform(), (0, False)),  # both: equation (25) is real, yet there is no pose
        (joints_of(0.5, 0.25, -0.5), Platform(), (0, False)),  # |R32| = 1 with R12 != 0
        (joints_of(0.75, 0, -0.25), Platform(), (0, False)),  # |R32| = 1 with R31 != 0
        (joints_of(3, 0, 1.5), Platform(side=3), (2, True)),
    ],
)
def test_counts_known_by_hand(joints, platform, expected):
    assert ppps3.count(joints, platform) == ExactCount(*expected)
    assert len(ppps3.forward(joints, platform)) == expected[0]


@pytest.mark.parametrize("half", [0.5, -0.5])
def test_a_vertical_edge_beside_a_level_corner_moves_by_itself(half):
    with pytest.raises(SelfMotion):
        ppps3.count(joints_of(half, 0, -half, (1, 2, 3)))


def test_counts_agree_with_the_two_inequalities():
    rng = random.Random(1)
    seen = set()
    for _ in range(200):
        m2, p, m3 = (rng.uniform(-1.3, 1.3) for _ in range(3))
        a, b = 1 - 4 / 3 * (m2**2 - m2 * m3 + m3**2), 1 - (m2 - m3) ** 2 - p**2
        shift = [rng.uniform(-2, 2) for _ in range(3)]
        expected = 4 if min(a, b) > 0 else 0
        assert ppps3.count(joints_of(m2, p, m3, shift)) == (expected, False)
        seen.add((a > 0, b > 0))
    assert len(seen) == 4


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("side", [1, 2.5])
def test_a_pose_is_among_the_solutions_of_its_joints(side, mirrored):
    rng = random.Random(2)
    platform = Platform(side, mirrored)
    for _ in range(5):
        pose = [rng.uniform(-3, 3) for _ in range(6)]
        joints = ppps3.inverse(pose, platform, 512)
        solutions = ppps3.forward(nearest(joints.active), platform)
        assert len(solutions) == 4
        with ctx.workprec(512):
            wanted = [*ppps3.rotation_of(*pose[3:]).entries(), *pose[:3], *joints.passive]
            found = ([*s.rotation.entries(), *s.position, *s.passive] for s in solutions)
            assert min(max(abs(a - b) for a, b in zip(f, wanted, strict=True)) for f in found) < 1e-60


def test_poses_next_to_a_double_one_are_resolved():
    inside, outside = joints_of(1 - fmpq(1, 10**400), 0, 0.5), joints_of(1 + fmpq(1, 10**400), 0, 0.5)
    poses = ppps3.forward(inside)
    assert len(poses) == 4
    assert all(p.rotation[2, 2] > 0 or p.rotation[2, 2] < 0 for p in poses)
    assert ppps3.forward(outside) == []


def test_an_equation_of_the_paper():
    phi, theta, sigma, x, y, z = 0.3, -0.4, 0.7, 1.0, 2.0, -0.5
    rho = floats(ppps3.inverse((x, y, z, phi, theta, sigma)).active)
    rho2y = math.cos(theta) * (math.cos(sigma) * math.sqrt(3) - math.sin(sigma)) / 2 - x  # equation (21)
    both = math.cos(phi) * math.sin(theta) * math.cos(sigma) - math.sin(phi) * math.sin(sigma)
    one = math.cos(phi) * math.sin(theta) * math.sin(sigma) + math.sin(phi) * math.cos(sigma)
    assert rho[:2] == [y, z]
    assert rho[2] == pytest.approx(rho2y, abs=1e-15)
    assert rho[3] == pytest.approx((math.sqrt(3) * both - one) / 2 + z, abs=1e-15)  # equation (22)
    assert rho[5] == pytest.approx((math.sqrt(3) * both + one) / 2 + z, abs=1e-15)  # equation (24)


def test_exchanging_two_corners_reflects_the_robot():
    joints = joints_of(0.2, -0.3, 0.1, (0.4, 0.5, 0.6))
    mirror = np.diag([1, -1, 1])
    for pose in ppps3.forward(joints):
        reflected = mirror @ matrix(pose) @ mirror
        gaps = [abs(matrix(p) - reflected).max() for p in ppps3.forward(joints, Platform(mirrored=True))]
        assert min(gaps) < 1e-15


@pytest.mark.parametrize(("side", "mirrored"), [(1, False), (1, True), (2, False)])
def test_the_jacobian_determinant(side, mirrored):
    """Compares with sqrt3/2 side^3 R22 R33, and by differences with cos(theta) times that."""
    platform = Platform(side, mirrored)
    pose = [0.5, -1, 2, 0.3, -0.4, 0.7]
    with ctx.workprec(400):
        step = arb(2) ** -120
        rotation = ppps3.rotation_of(*pose[3:])
        formula = arb(3).sqrt() / 2 * side**3 * rotation[1, 1] * rotation[2, 2]
        assert (ppps3.jacobian(rotation, platform).det() - formula).contains(0)
        ends = [
            [ppps3.inverse([*pose[:i], arb(pose[i]) + h, *pose[i + 1 :]], platform, 400).active for h in (step, -step)]
            for i in range(6)
        ]
        columns = [[(a - b) / (2 * step) for a, b in zip(*pair, strict=True)] for pair in ends]
        assert abs(arb_mat(columns).det() - formula * arb(pose[4]).cos()) < 1e-60


# --- TLPM: position ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("radius", "expected"),
    [(590, (17.787689, 60.605061, 168.305874)), (834.386, (-9.278356, 41.677681, 169.836009))],
)
def test_table_1(radius, expected):
    """Two solutions with z1 + z2 = -2 h, whence h = 590; the table fits any radius."""
    machine = Machine(radius, 590)
    stroke = tlpm.strokes(machine, P1)
    np.testing.assert_allclose(floats(stroke), expected, atol=1e-6)
    count, points = tlpm.forward(machine, nearest(stroke))
    assert count == 2
    np.testing.assert_allclose([floats(p) for p in points], [P1, (100, 100, -1280)], rtol=1e-15)


@pytest.mark.parametrize(
    ("machine", "stroke", "count"),
    [
        (Machine(300, 400), (0, 0, 0), 2),
        (Machine(300, 400), (-200, -200, -200), 1),  # on the base plane
        (Machine(300, 400), (math.nextafter(-200, 0),) * 3, 2),
        (Machine(300, 400), (math.nextafter(-200, -500),) * 3, 0),
        (Machine(300, 400), (-1100, -1100, -1100), 0),  # negative lengths, whose squares would do
        (Machine(300, 400, (300, 300, 300)), (0, 0, 0), 1),
        (Machine(1, 1), (0, 0, 0), 2),
        (Machine(500, 600, eta=(0.1, 2.0, 4.5)), (0, 0, 0), 2),
        (Machine(500, 600, (1, 1, 1), (0.1, 2.0, 4.5)), (0, 0, 0), 0),
    ],
)
def test_position_counts(machine, stroke, count):
    found = tlpm.forward(machine, stroke)
    assert found.count == len(found.points) == count


def test_a_tiny_height_over_the_base_plane_is_resolved():
    low = fmpq(-200) + fmpq(1, 10**200)
    count, points = tlpm.forward(Machine(300, 400), [low] * 3)
    assert count == 2
    assert points[0][2] > -400 > points[1][2]


def test_positions_of_other_angles_return():
    machine = Machine(500, 600, (700, 800, 750), (0.1, 2.0, 4.5))
    point = (10.0, -20.0, 30.0)
    count, points = tlpm.forward(machine, nearest(tlpm.strokes(machine, point)))
    assert count == 2
    np.testing.assert_allclose([floats(p) for p in points], [point, (10, -20, -1230)], rtol=1e-15)


@pytest.mark.parametrize(
    ("machine", "point", "expected"),
    [
        (MACHINE, (0, 0, 0), -0.918559),
        (MACHINE, P1, -0.816001),
        (MACHINE, (100, 100, -1280), 0.816001),
        (Machine(math.sqrt(2), 1), (0, 0, 0), -1),
    ],
)
def test_determinant(machine, point, expected):
    assert float(tlpm.determinant(machine, point).mid()) == pytest.approx(expected, abs=5e-7)


# --- TLPM: wrist and links --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("point", "theta1", "theta2", "least"),
    [
        ((0, 0, 0), [90] * 3, [90] * 3, [113.4431, 86.7110, 119.9654]),
        (P1, [99.5526, 96.1958, 88.5209], [83.1658, 98.8314, 87.9073], [102.2446, 76.8709, 107.6574]),
    ],
)
def test_reference_angles_and_distances(point, theta1, theta2, least):
    limbs = tlpm.wrist(MACHINE, point, NO_TURN)
    np.testing.assert_allclose(degrees(limb.theta1 for limb in limbs), theta1, atol=5.1e-5)
    np.testing.assert_allclose(degrees(limb.theta2 for limb in limbs), theta2, atol=5.1e-5)
    found = tlpm.distances(point, limbs)
    assert [len(d) for d in found] == [3, 3, 6]
    np.testing.assert_allclose([min(floats(d)) for d in found], least, atol=5.1e-5)


@pytest.mark.parametrize("elbow", [1, -1])
def test_the_angles_rebuild_the_wrist(elbow):
    """Closes the chain of rotations, and compares with the inverse formulas that follow from it."""
    rng = random.Random(3)
    with ctx.workprec(tlpm.PREC):
        right = arb.pi() / 2
        for _ in range(10):
            point, q = [rng.uniform(-200, 200) for _ in range(3)], [rng.gauss(0, 1) for _ in range(4)]
            etas = (arb(0), 2 * arb.pi() / 3, -2 * arb.pi() / 3)
            for limb, eta in zip(tlpm.wrist(MACHINE, point, q, [elbow] * 3), etas, strict=True):
                frame = arb_mat(limb.frame).transpose()
                v = tlpm.rotation_of(q) * turn(2, eta) * turn(1, right / 2) * turn(0, right)
                wrist = turn(2, limb.theta1) * turn(1, right - limb.theta2)
                gap = frame * turn(2, limb.psi) * turn(0, right) * wrist - v
                assert all(entry.contains(0) and entry.rad() < 1e-80 for entry in gap.entries())
                m, e = frame.transpose() * v, elbow
                assert limb.theta1.overlaps(e * arb.atan2((m[2, 0] ** 2 + m[2, 2] ** 2).sqrt(), m[2, 1]))
                assert limb.theta2.overlaps(arb.atan2(e * m[2, 0], e * m[2, 2]))
                assert limb.psi.overlaps(arb.atan2(-e * m[1, 1], -e * m[0, 1]))


@pytest.mark.parametrize("axis", range(3))
def test_a_quaternion_turns_right_handed(axis):
    vector = [0, 0, 0]
    vector[axis] = 1
    rotation, angle = tlpm.rotation_of((2, *vector)), arb.atan2(arb(4), arb(3))  # cos = 3/5, sin = 4/5
    assert all(entry.contains(0) for entry in (rotation - turn(axis, angle)).entries())


def test_the_elbows_are_mirror_images():
    point, q = (60.0, -80.0, 40.0), (0.9, 0.2, -0.1, 0.3)
    limbs = tlpm.wrist(MACHINE, point, q)
    image = tlpm.wrist(MACHINE, (60.0, 80.0, 40.0), (0.9, -0.2, -0.1, -0.3), (-1, -1, -1))
    for limb, other in zip(limbs, (image[0], image[2], image[1]), strict=True):
        assert (limb.theta1 + other.theta1).contains(0)
        assert (limb.theta2 + other.theta2).contains(0)
        assert (limb.psi + other.psi).cos().overlaps(arb(-1))
    lengths = [sorted(floats(d)) for d in tlpm.distances(point, limbs)]
    mirrored = [sorted(floats(d)) for d in tlpm.distances((60.0, 80.0, 40.0), image)]
    assert lengths == [pytest.approx(d) for d in mirrored]


def test_the_other_elbow_at_home():
    for limb in tlpm.wrist(MACHINE, (0, 0, 0), NO_TURN, (-1, -1, -1)):
        assert degrees((limb.theta1, limb.theta2)) == pytest.approx([-90, -90])
        assert abs(degrees([limb.psi])[0]) == pytest.approx(180)


def test_the_stretched_wrist_has_no_axis():
    with pytest.raises(ZeroDivisionError):
        tlpm.wrist(MACHINE, (0, 0, -1180), NO_TURN)


def balls(*points):
    return tuple(tuple(arb(v) for v in p) for p in points)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (((-1, 0, 0), (1, 0, 0)), ((0, -1, 2), (0, 1, 2)), 2),  # inner points
        (((0, 0, 0), (1, 0, 0)), ((0.5, 3, 0), (0.5, 5, 0)), 3),  # an end and an inner point
        (((0, 0, 0), (1, 0, 0)), ((4, 4, 0), (4, 9, 0)), 5),  # two ends
        (((0, 0, 0), (1, 0, 0)), ((0.5, 2, 0), (1.5, 2, 0)), 2),  # parallel, overlapping
        (((0, 0, 0), (1, 0, 0)), ((4, 4, 0), (9, 4, 0)), 5),  # parallel, apart
        (((0, 0, 0), (2, 0, 0)), ((1, -1, 0), (1, 1, 0)), 0),  # crossing
    ],
)
def test_segment_distance(first, second, expected):
    assert float(tlpm.segment_distance(balls(*first), balls(*second)).mid()) == pytest.approx(expected, abs=1e-7)


def test_segment_distance_against_sampling():
    rng = np.random.default_rng(4)
    s = np.linspace(0, 1, 201)[:, None]
    for _ in range(20):
        a, b, c, d = rng.normal(size=(4, 3))
        gaps = np.linalg.norm((a + s * (b - a))[:, None] - (c + s * (d - c)), axis=-1).min()
        found = float(tlpm.segment_distance(balls(a, b), balls(c, d)).mid())
        assert found - 1e-12 < gaps < found + 0.03
