"""The TLPM's position: known answers, limits of the Jacobian, statuses, derivatives, constructors.

Its wrists and links have tests of their own.
"""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import spatial_checks as checks
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.mechanisms import tlpm

Status = jk.Status
H = 590.0
#: Fu and Gao, Table 1: P1 and P2 at the same strokes; z1 + z2 = -2 h gives h. The strokes follow from L.
TABLE_1 = np.array([(100.0, 100.0, 100.0), (100.0, 100.0, -1280.0)])
STROKES = {590.0: (17.787689, 60.605061, 168.305874), 834.386: (-9.278356, 41.677681, 169.836009)}
#: eta of limbs that are no third of a turn apart, and initial lengths that differ.
SKEW = {"limb_angles": (0.2, 1.9, -2.4), "initial_lengths": (800.0, 750.0, 900.0)}


def statuses(branches):
    return [Status(int(code)) for code in np.asarray(branches.status)]


def unlimited(robot=None):
    """Returns a robot without limits of the strokes, so that limb lengths of zero and less occur."""
    robot = tlpm.create() if robot is None else robot
    return dataclasses.replace(robot, limits=jk.Limits.none(3))


def random_points(rng, n, height=H):
    """Returns points on both sides of the base plane."""
    return rng.uniform(-300, 300, (n, 3)) - [0, 0, height / 2] + rng.uniform(-1, 1, (n, 1)) * [0, 0, height]


# --- known answers ---


@pytest.mark.parametrize("radius", STROKES)
def test_table_1(radius):
    robot = tlpm.create(radius, H)
    branches = jk.forward(robot, STROKES[radius])
    assert statuses(branches) == [Status.OK] * 2
    np.testing.assert_allclose(branches.values, TABLE_1, atol=1e-5)
    for point in TABLE_1:
        np.testing.assert_allclose(jk.inverse(robot, point).values[0], STROKES[radius], atol=1e-6)
    assert robot.forward_labels == ("upper, z > -h", "lower, z < -h")
    signs = [float(robot.factors(pose)["z + h"]) for pose in branches.values]
    assert signs[0] > 0 > signs[1]


def test_determinants_of_the_printed_poses():
    # Eq. (12) at L = h = 590, sign reversed with the rows.
    robot = tlpm.create(590.0, H)
    found = [float(jnp.linalg.det(tlpm.stroke_jacobian(robot, p))) for p in ((0, 0, 0), *TABLE_1)]
    np.testing.assert_allclose(found, [0.918559, 0.816001, -0.816001], atol=5e-7)


def test_home_of_the_isotropic_robot():
    # L = sqrt2 h: the limbs are at right angles in p = 0, and nowhere on the axis is the determinant larger.
    robot = tlpm.create(math.sqrt(2) * H, H)
    rows = np.asarray(tlpm.stroke_jacobian(robot, np.zeros(3)))
    np.testing.assert_allclose(rows @ rows.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(rows) == pytest.approx(1, rel=1e-14)
    found = jk.conditioning(robot, np.zeros(3), np.zeros(3))
    assert float(found.inverse_condition_number) == pytest.approx(1, abs=1e-7)
    for z in (-50.0, 50.0):
        assert float(jnp.linalg.det(tlpm.stroke_jacobian(robot, (0.0, 0.0, z)))) < 1


def test_printed_direct_kinematics():
    # Eqs. (3), (5), (6), and (4) as corrected.
    rng, robot = np.random.default_rng(0), tlpm.create(600.0, 500.0)
    points = random_points(rng, 500, 500.0)
    strokes = checks.tlpm_lengths(robot, points) - math.hypot(600, 500)
    s1, s2, s3 = ((math.hypot(600, 500) + strokes) ** 2).T
    x, y = (s2 + s3 - 2 * s1) / (6 * 600), (s3 - s2) / (2 * checks.ROOT3 * 600)
    z = np.sqrt(s1 - (x - 600) ** 2 - y**2)
    found = checks.forward_many(unlimited(robot), strokes).values
    np.testing.assert_allclose(found[:, 0], np.stack([x, y, z - 500], axis=1), atol=1e-7)
    np.testing.assert_allclose(found[:, 1], np.stack([x, y, -z - 500], axis=1), atol=1e-7)


@pytest.mark.parametrize("geometry", [{}, SKEW], ids=["third turns", "any angles"])
def test_forward_after_inverse(geometry):
    rng, robot = np.random.default_rng(1), unlimited(tlpm.create(640.0, 520.0, (-100, 100), **geometry))
    points = random_points(rng, 100_000, 520.0)
    points[:40_000, 2] = -520 + np.resize([1e-3, -1e-3, 1e-2, -1.0], 40_000)
    strokes = checks.inverse_many(robot, points).values[:, 0]
    np.testing.assert_allclose(strokes, checks.tlpm_lengths(robot, points) - robot.initial_lengths, atol=1e-12)
    branches = checks.forward_many(robot, strokes)
    assert np.all(branches.status == Status.OK)
    lane = (points[:, 2] < -520).astype(int)
    gap = np.abs(branches.values[np.arange(len(points)), lane] - points)
    # (z + h)^2 is known to 1e-10 mm^2.
    assert np.max(gap[:, 2] * np.abs(points[:, 2] + 520)) < 5e-9
    assert gap[:, :2].max() < 1e-11
    mirror = branches.values * [1, 1, -1] - [0, 0, 2 * 520]
    np.testing.assert_allclose(branches.values[:, ::-1], mirror, atol=1e-12)
    assert branches.residual.max() < 1e-14


# --- Jacobian ---


@pytest.mark.parametrize("geometry", [{}, SKEW], ids=["third turns", "any angles"])
def test_jacobians(geometry):
    rng, robot = np.random.default_rng(2), unlimited(tlpm.create(640.0, 520.0, (-100, 100), **geometry))
    points = random_points(rng, 300, 520.0)
    rows = np.asarray(jax.vmap(lambda p: tlpm.stroke_jacobian(robot, p))(jnp.asarray(points)))
    lengths = checks.tlpm_lengths(robot, points)
    for k, unit in enumerate(1e-3 * np.eye(3)):
        moved = checks.tlpm_lengths(robot, points + unit) - checks.tlpm_lengths(robot, points - unit)
        np.testing.assert_allclose(rows[:, :, k], moved / 2e-3, atol=1e-8)
    slopes = jax.jit(jax.vmap(jax.jacrev(lambda p: jk.inverse(robot, p).values[0])))(jnp.asarray(points))
    np.testing.assert_allclose(slopes, rows, atol=1e-13)
    # det = 2 A (z + h) / (r1 r2 r3), with the area A by the cross product.
    base = np.stack([640 * np.cos(robot.limb_angles), 640 * np.sin(robot.limb_angles)], axis=1)
    one, two = base[1] - base[0], base[2] - base[0]
    double_area = one[0] * two[1] - one[1] * two[0]
    wanted = double_area * (points[:, 2] + 520) / np.prod(lengths, axis=1)
    np.testing.assert_allclose(np.linalg.det(rows), wanted, atol=1e-14)
    direct = jax.vmap(lambda p: jk.jacobians(robot, p, p * 0).direct)(jnp.asarray(points))
    np.testing.assert_allclose(np.linalg.det(direct), 8 * double_area * (points[:, 2] + 520), rtol=1e-9)
    if not geometry:
        assert double_area == pytest.approx(3 * checks.ROOT3 / 2 * 640**2)


@pytest.mark.parametrize("limb", range(3))
def test_the_determinant_at_a_base_joint_depends_on_the_approach(limb):
    # The paper's text has det -> 0 for p -> q_i. It tends to (sqrt3 / 2) cos(gamma), gamma from the z axis, at every
    # azimuth: any value in [-0.866, 0.866]; at p = q_i the row is 0 / 0. The printed rows have the opposite sign.
    robot = tlpm.create()
    joint = np.array([*(float(v) for v in robot.base_points()[limb]), -H])
    for gamma in (0.0, 0.4, math.pi / 3, math.pi / 2, 2.5, math.pi):
        for azimuth in (0.0, 1.0, 4.0):
            level = np.array([math.cos(azimuth), math.sin(azimuth)]) * math.sin(gamma)
            away = np.array([*level, math.cos(gamma)])
            errors = []
            for distance in (1.0, 1e-2, 1e-4):
                found = float(jnp.linalg.det(tlpm.stroke_jacobian(robot, joint + distance * away)))
                errors.append(abs(found - checks.ROOT3 / 2 * math.cos(gamma)))
            # The other two rows change in proportion to the distance.
            assert errors[2] < 1e-4 / H
            assert errors[0] < 1 / H
    if limb == 0:
        # The other two base joints are no floats.
        assert np.isnan(np.asarray(tlpm.stroke_jacobian(robot, joint))[limb]).all()
    branches = jk.inverse(unlimited(robot), joint)
    assert statuses(branches) == [Status.SINGULAR]
    assert float(branches.values[0, limb] + robot.initial_lengths[limb]) == pytest.approx(0, abs=1e-9)


def test_the_plane_of_the_base_is_all_there_is():
    rng, robot = np.random.default_rng(3), tlpm.create()
    points = random_points(rng, 2000)
    flat = points * [1, 1, 0] - [0, 0, H]
    for here, singular in ((points, False), (flat, True)):
        values = np.linalg.det(jax.vmap(lambda p: tlpm.stroke_jacobian(robot, p))(jnp.asarray(here)))
        assert (np.abs(values).max() < 1e-14) == singular
        if not singular:
            np.testing.assert_array_equal(np.sign(values), np.sign(here[:, 2] + H))


# --- numbers of modes and statuses ---


@pytest.mark.parametrize("geometry", [{}, SKEW], ids=["third turns", "any angles"])
def test_numbers_agree_with_the_count_and_the_signs(geometry):
    rng, robot = np.random.default_rng(4), unlimited(tlpm.create(640.0, 520.0, (-10, 10), **geometry))
    lengths = rng.uniform(-100, 1500, (150_000, 3))
    flat = rng.uniform(-400, 400, (50_000, 3)) * [1, 1, 0] - [0, 0, 520]
    share = np.resize(checks.LAYERS, 50_000)[:, None]
    near = checks.tlpm_lengths(robot, flat) * (1 + share * rng.uniform(-1, 1, (50_000, 3)))
    strokes = np.concatenate([lengths, near]) - np.asarray(robot.initial_lengths)
    branches, count = checks.forward_many(robot, strokes), checks.count_many(robot, strokes)
    np.testing.assert_array_equal(branches.count, count.number)
    np.testing.assert_array_equal(checks.flagged(branches.status), count.undecided)
    assert set(np.unique(count.number)) == {0, 1, 2}
    height = branches.values[..., 2] + 520
    two = branches.count == 2
    assert np.all(height[two, 0] > 0)
    assert np.all(height[two, 1] < 0)
    negative = np.any(np.asarray(robot.initial_lengths) + strokes <= 0, axis=1)
    np.testing.assert_array_equal(np.all(branches.status == Status.OUTSIDE_LIMITS, axis=1), negative)
    assert np.all(np.isin(branches.status[~negative], (0, 1, 2, 9)))
    assert checks.flagged(branches.status[150_000:])[share[:, 0] <= 1e-16].all()
    assert checks.flagged(branches.status[150_000:])[share[:, 0] == 1e-6].mean() < 0.01
    assert checks.flagged(branches.status[:150_000]).mean() < 1e-4


def test_one_double_pose_on_the_base_plane():
    robot = unlimited()
    # All lengths L: p in the centre of the base.
    branches = jk.forward(robot, [590.0 - math.hypot(590, 590)] * 3)
    assert int(branches.count) == 1
    np.testing.assert_array_equal(branches.multiplicity, [2, 0])
    assert statuses(branches) == [Status.SINGULAR, Status.NO_REAL_SOLUTION]
    np.testing.assert_allclose(branches.values[0], [0, 0, -H], atol=1e-12)
    shorter = jk.forward(robot, [580.0 - math.hypot(590, 590)] * 3)
    assert statuses(shorter) == [Status.NO_REAL_SOLUTION] * 2


@pytest.mark.parametrize(
    ("length", "status"),
    [(-900.0, Status.OUTSIDE_LIMITS), (-1e-9, Status.OUTSIDE_LIMITS), (0.0, Status.OUTSIDE_LIMITS)],
)
@pytest.mark.parametrize("limb", range(3))
def test_lengths_that_are_not_positive_have_no_pose(length, status, limb):
    # Eqs. (3)-(6) know squares alone: -900 would pass for 900.
    robot = unlimited(tlpm.create(stroke=(-100, 100), initial_lengths=900.0))
    strokes = np.zeros(3)
    assert int(jk.forward(robot, strokes).count) == 2
    strokes[limb] = length - 900.0
    branches = jk.forward(robot, strokes)
    assert statuses(branches) == [status] * 2
    assert int(checks.count_many(robot, strokes[None]).number[0]) == 0


def test_limits_of_the_strokes():
    robot = tlpm.create(stroke=((-50, -60, -70), (50, 60, 70)))
    for strokes, status in (
        ((-50, -60, -70), Status.OK),
        ((50, 60, 70), Status.OK),
        ((-50.001, 0, 0), Status.OUTSIDE_LIMITS),
        ((0, 0, 70.001), Status.OUTSIDE_LIMITS),
    ):
        assert set(statuses(jk.forward(robot, strokes))) == {status}
    assert statuses(jk.inverse(robot, (0, 0, 200))) == [Status.OUTSIDE_LIMITS]
    assert statuses(jk.inverse(robot, (0, 0, 20))) == [Status.OK]
    found = {k: float(v) for k, v in jk.margins(robot, (0.0, 0.0, 0.0), (10.0, 0.0, -80.0)).items()}
    names = [f"l{k}_{end}" for k in (1, 2, 3) for end in ("low", "high")] + ["length1", "length2", "length3"]
    assert list(found)[:9] == names
    size = math.hypot(590, 590)
    wanted = [60, 40, 60, 60, -10, 150, size + 10, size, size - 80]
    np.testing.assert_allclose([found[name] for name in names], wanted)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e70])
@pytest.mark.parametrize("place", range(3))
def test_numbers_that_are_none_are_refused(bad, place):
    given = np.zeros(3)
    given[place] = bad
    assert set(statuses(jk.forward(tlpm.create(), given))) == {Status.INVALID_INPUT}
    assert statuses(jk.inverse(tlpm.create(), given)) == [Status.INVALID_INPUT]


@pytest.mark.parametrize(
    "change",
    [
        {"base_radius": 0.0},
        {"base_radius": math.nan},
        {"height": math.inf},
        {"limb_angles": (0.0, 0.0, 1.0)},
        {"initial_lengths": (1.0, math.nan, 1.0)},
        {"a": 0.0},
        {"r2": -1.0},
        {"orientation": (0.0, 0.0, 0.0, 0.0)},
    ],
)
def test_records_with_bad_geometry_have_a_status(change):
    robot = dataclasses.replace(unlimited(), **{name: jnp.asarray(value) for name, value in change.items()})
    assert set(statuses(jk.forward(robot, np.zeros(3)))) == {Status.INVALID_GEOMETRY}
    assert statuses(jk.inverse(robot, np.zeros(3))) == [Status.INVALID_GEOMETRY]


# --- symmetries ---


@given(st.tuples(*[st.floats(-300, 300)] * 3), st.floats(1e-3, 1e3))
@settings(max_examples=40)
def test_scaling_all_lengths(point, factor):
    small = unlimited(tlpm.create())
    large = unlimited(tlpm.create(590 * factor, 590 * factor, (-0.1 * factor, 0.1 * factor)))
    strokes = checks.tlpm_lengths(small, np.array(point)) - np.asarray(small.initial_lengths)
    here, there = jk.forward(small, strokes), jk.forward(large, strokes * factor)
    np.testing.assert_allclose(there.values / factor, here.values, atol=1e-8)
    np.testing.assert_array_equal(there.status, here.status)


def test_turning_all_limbs_turns_the_poses():
    rng = np.random.default_rng(5)
    strokes, turn = rng.uniform(-150, 150, (500, 3)), 0.7
    here = checks.forward_many(tlpm.create(), strokes).values
    angles = np.array(tlpm.LIMB_ANGLES) + turn
    there = checks.forward_many(tlpm.create(limb_angles=angles), strokes).values
    c, s = math.cos(turn), math.sin(turn)
    np.testing.assert_allclose(there, here @ np.array([(c, s, 0), (-s, c, 0), (0, 0, 1)]), atol=1e-10)


def test_permuting_the_limbs_permutes_the_strokes():
    rng, order = np.random.default_rng(6), [2, 0, 1]
    strokes = rng.uniform(-30, 30, (500, 3))
    skew = {name: np.array(value) for name, value in SKEW.items()}
    here = checks.forward_many(unlimited(tlpm.create(stroke=(-1, 1), **skew)), strokes)
    moved = {name: value[order] for name, value in skew.items()}
    there = checks.forward_many(unlimited(tlpm.create(stroke=(-1, 1), **moved)), strokes[:, order])
    np.testing.assert_array_equal(here.status, there.status)
    np.testing.assert_allclose(here.values, there.values, atol=1e-8)


# --- derivatives ---


def poses(parameters):
    """Returns the lanes as a function of L, h, three angles, three initial lengths and three strokes."""
    p = parameters
    robot = tlpm.create(p[0], p[1], (-500, 500), p[5:8], limb_angles=p[2:5])
    return jk.forward(robot, p[8:]).values


def test_first_and_second_derivatives_equal_differences():
    point = np.array([640.0, 520, 0.2, 1.9, -2.4, 800, 750, 900, 12, -30, 41])
    step = np.where(np.abs(point) > 5, 0.5, 1e-3)
    values, slope = jax.jit(jax.vmap(poses)), jax.jit(jax.vmap(jax.jacfwd(poses)))
    wanted = checks.central_differences(values, point, step)
    reverse = np.asarray(jax.jit(jax.jacrev(poses))(point))
    assert np.isfinite(wanted).all()
    scale = np.where(np.abs(point) > 5, 1.0, 100.0)
    for found in (np.asarray(slope(point[None]))[0], reverse):
        np.testing.assert_allclose(found / scale, wanted / scale, atol=1e-7)
    bends = checks.central_differences(slope, point, step)
    found = np.asarray(jax.jit(jax.jacfwd(jax.jacrev(poses)))(point))
    np.testing.assert_allclose(found / scale / scale[:, None], bends / scale / scale[:, None], atol=1e-8)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev], ids=["forward", "reverse"])
def test_forward_derivative_is_the_inverse_of_the_jacobian(mode):
    robot = unlimited()
    derivative = jax.jit(mode(lambda q: jk.forward(robot, q).values))
    for strokes in ((0.0, 0.0, 0.0), STROKES[590.0], (-200.0, 150.0, 90.0)):
        for pose, slope in zip(jk.forward(robot, strokes).values, derivative(jnp.asarray(strokes)), strict=True):
            np.testing.assert_allclose(tlpm.stroke_jacobian(robot, pose) @ slope, np.eye(3), atol=1e-12)


def test_gradient_through_create():
    # At strokes l = 0 and L_i0 = sqrt(L^2 + h^2) the pose stays at 0 whatever L and h; with L_i0 fixed,
    # z = -h + sqrt(L_0^2 - L^2).
    def z(radius, height, initial=None):
        return jk.forward(tlpm.create(radius, height, initial_lengths=initial), jnp.zeros(3)).values[0, 2]

    for found in jax.jit(jax.grad(z, argnums=(0, 1)))(500.0, 400.0):
        assert float(found) == pytest.approx(0, abs=1e-12)
    found = jax.jit(jax.grad(z, argnums=(0, 1, 2)))(500.0, 400.0, 700.0)
    rise = math.sqrt(700**2 - 500**2)
    np.testing.assert_allclose(found, [-500 / rise, -1, 700 / rise], rtol=1e-12)


def test_empty_and_singular_lanes_do_not_poison_the_gradient():
    robot, size = unlimited(), math.hypot(590, 590)
    regular = np.array([(0.0, 0, 0), STROKES[590.0]])
    bad = np.array([[590 - size] * 3, [-size - 100, 0, 0], [-600, -600, 100], [math.nan, 0, 0], [-size, 0, 0]])

    def total(robot, strokes):
        found = jax.vmap(jk.forward, in_axes=(None, 0))(robot, strokes)
        keep = found.valid & (found.status == Status.OK)
        return jnp.sum(jnp.where(keep[..., None], found.values, 0.0) * jnp.arange(1.0, 4.0))

    gradient = jax.jit(jax.grad(total, argnums=(0, 1)))
    wanted, _ = gradient(robot, jnp.asarray(regular))
    found, slopes = gradient(robot, jnp.asarray(np.concatenate([regular, bad])))
    for name in ("base_radius", "height", "limb_angles", "initial_lengths"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-12, atol=1e-9)
    np.testing.assert_array_equal(slopes[2:], np.zeros((5, 3)))
    assert float(np.abs(wanted.initial_lengths).min()) > 0.1


def test_batches_of_robots():
    rng = np.random.default_rng(7)
    radius, height = rng.uniform(400, 800, (2, 20))
    strokes = rng.uniform(-100, 100, (20, 3))
    robots = tlpm.create(radius, height)
    batch = jax.jit(jax.vmap(jk.forward))(robots, strokes)
    for k in (0, 19):
        one = jk.forward(tlpm.create(radius[k], height[k]), strokes[k])
        np.testing.assert_allclose(batch.values[k], one.values, atol=1e-10)
    assert robots.geometry_ok().shape == (20,)


# --- constructors ---


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"stroke": (-900, 200)}, ["stroke", "-900", "-65.6", "longer than zero", "raise"]),
        ({"stroke": (-math.hypot(590, 590), 200)}, ["stroke", "longer than zero"]),
        ({"stroke": ((-1, -1, -900), (1, 1, 1))}, ["stroke", "-900"]),
        ({"stroke": (200, -200)}, ["stroke", "not greater"]),
        ({"stroke": (5, 5)}, ["stroke", "empty", "low < high"]),
        ({"stroke": (math.nan, 5)}, ["stroke", "nan"]),
        ({"stroke": (1, 2, 3)}, ["stroke", "(3,)", "(low, high)"]),
        ({"stroke": "long"}, ["stroke", "'long'", "numbers"]),
        ({"initial_lengths": 100.0}, ["limb -100 mm long", "initial length"]),
        ({"initial_lengths": (1.0, 2.0)}, ["initial_lengths", "(2,)", "3 numbers"]),
        ({"base_radius": 0}, ["base_radius", "0", "positive"]),
        ({"base_radius": -590}, ["base_radius", "-590"]),
        ({"height": math.nan}, ["height", "nan", "finite"]),
        ({"a": 0}, ["a is 0", "positive"]),
        ({"b": -1}, ["b is -1", "positive"]),
        ({"r1": 0}, ["r1", "positive"]),
        ({"r2": 0}, ["r2", "positive"]),
        ({"limb_angles": (0, 0, 1)}, ["limb_angles", "triangle", "apart"]),
        ({"limb_angles": (0, 2 * math.pi, 1)}, ["limb_angles", "triangle"]),
        ({"limb_angles": (0, 1)}, ["limb_angles", "(2,)"]),
        ({"elbows": (1, 1)}, ["elbows", "three signs"]),
        ({"elbows": (1, 0, 1)}, ["elbows", "+1 or -1"]),
        ({"orientation": (0, 0, 0, 0)}, ["orientation", "zero"]),
        ({"orientation": (1, 0, 0)}, ["orientation", "4 numbers"]),
        ({"wrist_limits": jk.Limits(jnp.array([1.0, 2.0]), jnp.array([0.0, 3.0]))}, ["wrist_limits", "not greater"]),
        ({"wrist_limits": jk.Limits.none(3)}, ["wrist_limits", "2 low"]),
        ({"base_radius": [1.0, 2.0], "height": [1.0, 2.0, 3.0]}, ["shapes", "base_radius (2,)"]),
    ],
)
def test_create_refuses(arguments, words):
    with pytest.raises(jk.GeometryError) as error:
        tlpm.create(**arguments)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize("shape", [(), (1,), (2,), (5, 3)])
def test_wrong_shapes_are_refused(shape):
    for call in (tlpm.stroke_jacobian, jk.forward, jk.inverse):
        with pytest.raises(jk.InputError, match=r"shape.*\(3,\)"):
            call(tlpm.create(), np.zeros(shape))
