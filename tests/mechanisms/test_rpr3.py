"""The planar 3-RPR: known answers, equations, constructors."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.mechanisms import rpr3

ROOT3 = math.sqrt(3)


def poses_of(branches):
    return np.asarray(branches.values)[np.asarray(branches.valid)]


def statuses(branches):
    return {jk.Status(int(code)) for code in np.asarray(branches.status)}


def as_general(robot):
    """Returns the general robot with the geometry of an analytic one."""
    c2, c3, d3 = (float(v) for v in (robot.c2, robot.c3, robot.d3))
    side, angle = abs(c2), math.atan2(-d3, c3)
    # A platform frame along B1B2 is turned by pi where c2 is negative.
    return rpr3.general(c2, c3, d3, side, math.hypot(c3, d3), angle - (math.pi if c2 < 0 else 0.0))


# --- known answers ---


def test_six_modes_of_the_reference_geometry():
    branches = jk.forward(rpr3.reference(), zoo.REFERENCE_JOINTS)
    assert int(branches.count) == 6
    np.testing.assert_allclose(branches.values, zoo.REFERENCE_POSES, atol=1e-10)
    assert statuses(branches) == {jk.Status.OK}
    np.testing.assert_array_equal(branches.multiplicity, np.ones(6))
    for pose, determinant in zip(zoo.REFERENCE_POSES, zoo.REFERENCE_DETERMINANTS, strict=True):
        found = jk.conditioning(rpr3.reference(), pose, zoo.REFERENCE_JOINTS).determinant
        assert float(found) == pytest.approx(determinant, abs=0.006)


@pytest.mark.parametrize(
    ("joints", "phi", "points"),
    [
        (
            (ROOT3, 1.0, 1.0),
            -math.pi / 2,
            [(1.70710678118655, 0.292893218813452), (0.292893218813452, 1.70710678118655)],
        ),
        (
            (math.sqrt((3 * ROOT3 - 3) / 2), 1.0, math.sqrt(1 + 3 * ROOT3)),
            math.pi / 6,
            [(1.04434026359920, -0.0861952735297266), (-0.861327561706983, -0.596817428362493)],
        ),
    ],
)
def test_cusps_are_two_triple_poses(joints, phi, points):
    # Wenger and Chablat 2009, the cusps of the section rho2 = 1.
    branches = jk.forward(rpr3.analytic(*zoo.EXAMPLE), joints)
    poses = poses_of(branches)
    assert len(poses) == 2
    np.testing.assert_array_equal(np.asarray(branches.multiplicity)[:2], [3, 3])
    assert statuses(branches) == {jk.Status.SINGULAR, jk.Status.NO_REAL_SOLUTION}
    wanted = np.array([(x, y, phi) for x, y in points])
    # Three roots within the cube root of the rounding.
    assert zoo.set_distance(poses, wanted) < 3e-5


def test_two_poses_of_the_platform_of_alias():
    # The planar platform of the ALIAS manual (Merlet): exactly two poses, one of them (5, 5, 0).
    robot = rpr3.general(10, 3, 10, 4, math.sqrt(8), math.pi / 4)
    poses = poses_of(jk.forward(robot, np.sqrt([50.0, 26.0, 25.0])))
    assert len(poses) == 2
    assert zoo.nearest(poses[None], np.array([[5.0, 5.0, 0.0]]))[0] < 1e-12


@pytest.mark.parametrize(
    ("joints", "number"),
    [((3.0, 0.5, 0.5), 0), ((2.0, 1.0, 1.5), 2), ((0.8, 1.3, 0.5), 4), ((1.2, 1.0, 1.1), 6)],
)
def test_every_even_number_of_modes_occurs(joints, number):
    robot = rpr3.analytic(*zoo.EXAMPLE)
    assert int(jk.forward(robot, joints).count) == number
    assert int(jk.forward(as_general(robot), joints).count) == number
    assert zoo.exact_counts(np.array([zoo.EXAMPLE]), np.array([joints]))[0] == number


@pytest.mark.parametrize(
    "joints",
    [(1.3, 1.3, 0.9), (1.3, 0.9, 1.3), (1.3, 1.3, 1.3), (0.0, 1.2, 1.1), (1.2, 0.0, 1.1), (1.2, 1.1, 0.0)],
    ids=["rho1=rho2", "rho1=rho3", "all equal", "rho1=0", "rho2=0", "rho3=0"],
)
@pytest.mark.parametrize("geometry", [(1.0, 0.0, 1.0), (1.0, 0.5, 1.0), (-1.5, -0.7, 0.4)])
def test_special_joints(geometry, joints):
    # rho1 = rho2 has the root phi = 0, where Eq. (4) is 0 = 0; with c3 = 0, rho1 = rho3 has phi = pi, at t = infinity.
    robot = rpr3.analytic(*geometry)
    branches = jk.forward(robot, joints)
    exact = zoo.exact_counts(np.array([geometry]), np.array([joints]))[0]
    singular = np.asarray(branches.status) == jk.Status.SINGULAR
    assert int(branches.count) == exact or singular.any()
    residuals = [np.abs(jk.constraints(robot, pose, joints)).max() for pose in poses_of(branches)]
    assert max(residuals, default=0) < 1e-12


def test_pi_and_zero_are_ordinary_angles():
    robot = rpr3.analytic(*zoo.EXAMPLE)
    for phi in (math.pi, 0.0):
        pose = np.array([0.4, 0.9, phi])
        joints = jk.inverse(robot, pose).values[0]
        branches = jk.forward(robot, joints)
        assert zoo.nearest(branches.values[None], pose[None])[0] < 1e-13
        assert statuses(branches) <= {jk.Status.OK, jk.Status.NO_REAL_SOLUTION}
        general = jk.forward(as_general(robot), joints)
        assert zoo.set_distance(poses_of(general), poses_of(branches)) < 1e-12
        assert np.nanmax(branches.values[:, 2]) < math.pi


@pytest.mark.parametrize("joints", [(2.0, 2.0, 3.9), (2.0, 2.0, 3.5), (1.5, 1.5, 3.0)])
def test_isosceles_base_and_two_equal_legs(joints):
    # The cubic is S (a S^2 + b C^2): one real root, whose complex partners have the same real part.
    geometry = (1.0, 0.5, 1.0)
    branches = jk.forward(rpr3.analytic(*geometry), joints)
    exact = zoo.exact_counts(np.array([geometry]), np.array([joints]))[0]
    assert int(branches.count) == exact
    assert statuses(branches) <= {jk.Status.OK, jk.Status.NO_REAL_SOLUTION}


def test_vanishing_leading_coefficient():
    # c3 A - c2 B + 4 c2 c3 (c2 - c3) = 0 at any joints: phi = pi is a root.
    c2, c3, d3 = 1.3, 0.4, 0.9
    robot = rpr3.analytic(c2, c3, d3)
    for rho1, rho2 in ((1.7, 1.2), (2.0, 2.4), (1.5, 1.15)):
        a = rho1**2 - rho2**2
        rho3 = math.sqrt(rho1**2 - (c3 * a + 4 * c2 * c3 * (c2 - c3)) / c2)
        joints = np.array([rho1, rho2, rho3])
        branches = jk.forward(robot, joints)
        assert int(branches.count) == zoo.exact_counts(np.array([[c2, c3, d3]]), joints[None])[0]
        assert np.any(math.pi - np.abs(poses_of(branches)[:, 2]) < 1e-12)


# --- double poses and self-motions ---


def assert_double(branches, pose):
    """Asserts that the pose is there, singular and double."""
    gaps = zoo.glued_distance(np.asarray(branches.values), pose)
    close = np.flatnonzero(gaps < 1e-6)
    assert len(close) == 1
    assert int(branches.status[close[0]]) == jk.Status.SINGULAR
    assert int(branches.multiplicity[close[0]]) == 2
    assert int(np.sum(branches.multiplicity)) % 2 == 0


@pytest.mark.parametrize("which", ["f1", "f2"])
@pytest.mark.parametrize("family", ["analytic", "general"])
def test_a_double_pose_of_the_analytic_geometry(family, which):
    rng = np.random.default_rng(0)
    pose = (zoo.parallel_poses(rng, 1) if which == "f1" else zoo.concurrent_poses(rng, np.array([zoo.EXAMPLE])))[0]
    robot = rpr3.analytic(*zoo.EXAMPLE)
    assert abs(float(robot.factors(pose)[which])) < 1e-15
    joints = jk.inverse(robot, pose).values[0]
    assert_double(jk.forward(robot if family == "analytic" else as_general(robot), joints), pose)


@pytest.mark.parametrize("seed", range(5))
def test_a_double_pose_of_the_reference_geometry(seed):
    robot = rpr3.reference()
    geometry = np.array([[float(getattr(robot, name)) for name in ("c2", "c3", "d3", "l2", "l3", "beta")]])
    pose = zoo.singular_poses(np.random.default_rng(seed), geometry)[0]
    assert_double(jk.forward(robot, jk.inverse(robot, pose).values[0]), pose)


def test_cusps_of_the_analytic_geometry_by_the_general_solver():
    robot, joints = rpr3.analytic(*zoo.EXAMPLE), (ROOT3, 1.0, 1.0)
    poses = poses_of(jk.forward(as_general(robot), joints))
    assert zoo.set_distance(poses, poses_of(jk.forward(robot, joints))) < 1e-4


@pytest.mark.parametrize("length", [0.7, 1.0, 30.0])
def test_congruent_platform_and_equal_legs_move(length):
    robot = rpr3.general(4, 1, 3, 4, math.hypot(1, 3), math.atan2(3, 1))
    branches = jk.forward(robot, (length, length, length))
    assert jk.Status.SELF_MOTION in statuses(branches)
    assert jk.Status.SELF_MOTION not in statuses(jk.forward(robot, (length, length, 1.01 * length)))


# --- equations ---


def test_determinant_factorises():
    # Wenger and Chablat 2009: det dF/d(x, y, phi) = -16 c2 f1 f2.
    rng = np.random.default_rng(1)
    robots, poses = zoo.build(zoo.random_analytic(rng, 500)), jnp.asarray(zoo.random_poses(rng, 500, 3.0))

    def both(robot, pose):
        joints = jk.inverse(robot, pose).values[0]
        factors = robot.factors(pose)
        return jnp.linalg.det(jk.jacobians(robot, pose, joints).direct), -16 * robot.c2 * factors["f1"] * factors["f2"]

    determinant, product = jax.jit(jax.vmap(both))(robots, poses)
    np.testing.assert_allclose(product, determinant, atol=1e-12 * np.abs(determinant).max())


def test_factors_change_sign_over_the_seam_and_their_product_does_not():
    robot = rpr3.analytic(1.3, -0.4, 0.8)
    here, there = (robot.factors(np.array([0.4, 0.9, phi])) for phi in (1.1, 1.1 + 2 * np.pi))
    for name in ("f1", "f2"):
        assert float(here[name]) == pytest.approx(-float(there[name]), rel=1e-13)


def test_constraints_are_the_distances_of_the_drawn_points():
    rng = np.random.default_rng(2)
    for geometry in (zoo.random_analytic(rng, 1)[0], zoo.random_general(rng, 1)[0]):
        robot, pose, joints = zoo.build(geometry), zoo.random_poses(rng, 1)[0], rng.uniform(0, 3, 3)
        base, platform = robot.outline(pose)
        wanted = np.sum((platform - base) ** 2, axis=1) - joints**2
        np.testing.assert_allclose(jk.constraints(robot, pose, joints), wanted, atol=1e-13)


def test_analytic_family_is_the_mirrored_base():
    base, platform = rpr3.analytic(1.3, -0.4, 0.8).outline((0.0, 0.0, 0.0))
    np.testing.assert_allclose(platform, base * [1, -1])


def test_reference_has_the_published_sides():
    _, platform = rpr3.reference().outline((1.0, 2.0, 0.3))
    sides = [np.linalg.norm(platform[i] - platform[j]) for i, j in ((0, 1), (1, 2), (2, 0))]
    np.testing.assert_allclose(sides, [17.04, 16.54, 20.84], rtol=1e-14)


# --- constructors ---


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((0.0, 0.0, 1.0), ["c2=0.0", "neither", "zero", "rpr3.general"]),
        ((1.0, 0.0, 0.0), ["d3=0.0", "triangle"]),
        ((1.0, 1e13, 1.0), ["c3=1", "neither"]),
        ((math.nan, 0.0, 1.0), ["c2", "nan", "finite"]),
        ((1.0, math.inf, 1.0), ["c3", "inf", "finite"]),
        (("one", 0.0, 1.0), ["c2", "'one'", "number"]),
        ((1.0, None, 1.0), ["c3", "None"]),
        (([1.0, 1.0], 0.0, [1.0, 0.0]), ["d3=[1.0, 0.0]"]),
    ],
)
def test_analytic_refuses(arguments, words):
    with pytest.raises(jk.GeometryError) as error:
        rpr3.analytic(*arguments)
    assert isinstance(error.value, ValueError)
    for word in words:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((1, 0, 1, -1, 1, 0.3), ["l2", "-1", "negative", "beta"]),
        ((1, 0, 1, 1, -2, 0.3), ["l3", "-2", "negative"]),
        ((1, 0, 1, 0, 1, math.nan), ["beta", "nan", "finite"]),
        ((0, 1, 1, 0, 1, 0.3), ["c2=0", "l2=0", "legs share both joints"]),
        ((1, 0, 0, 1, 0, 0.3), ["l3=0", "legs share both joints"]),
        ((2, 2, 0, 3, 3, 0.0), ["c3=2", "legs share both joints"]),
        ((0, 0, 0, 1, 1, 0.3), ["c2=0", "coincide"]),
        ((1, 0, 1, 0, 0, 0.3), ["l2=0", "coincide"]),
        ((1, 0, "x", 1, 1, 0.3), ["d3", "'x'", "number"]),
    ],
)
def test_general_refuses(arguments, words):
    with pytest.raises(jk.GeometryError) as error:
        rpr3.general(*arguments)
    for word in words:
        assert word in str(error.value)


@given(st.floats(0.01, 100), st.floats(-100, 100), st.floats(0.01, 100), st.booleans(), st.booleans())
def test_constructors_accept_every_triangle(c2, c3, d3, left, down):
    robot = rpr3.analytic(-c2 if left else c2, c3, -d3 if down else d3)
    assert bool(robot.geometry_ok())
    assert float(robot.characteristic_length()) >= min(c2, d3) / 2


def test_aligned_joints_are_allowed_in_the_general_family():
    branches = jk.forward(rpr3.general(1.0, 2.0, 0.0, 1.0, 1.7, 0.0), (1.0, 1.2, 1.1))
    assert statuses(branches) <= {jk.Status.OK, jk.Status.NO_REAL_SOLUTION}


def test_constructors_are_traceable():
    geometry = jnp.asarray(zoo.random_analytic(np.random.default_rng(3), 5))
    batch = jax.vmap(lambda g: rpr3.analytic(*g))(geometry)
    np.testing.assert_array_equal(batch.c2, geometry[:, 0])
    assert batch.limits.low.shape == (5, 3)

    def length(c2, l2):
        return rpr3.general(c2, 0.3, 1.0, l2, 1.0, 0.4).characteristic_length()

    slope = jax.jit(jax.grad(length))(1.2, 0.8)
    step = (length(1.2 + 1e-6, 0.8) - length(1.2 - 1e-6, 0.8)) / 2e-6
    assert float(slope) == pytest.approx(float(step), rel=1e-8)
    degenerate = jax.jit(lambda c2: rpr3.analytic(c2, 0.3, 1.0).geometry_ok())
    assert [bool(degenerate(0.0)), bool(degenerate(1.0))] == [False, True]


def test_a_batch_of_robots_and_a_batch_of_joints():
    rng = np.random.default_rng(4)
    geometry, joints = zoo.random_analytic(rng, 20), rng.uniform(0.5, 3, (20, 3))
    batch = zoo.forward_batch(zoo.build(geometry), jnp.asarray(joints))
    for k in (0, 7, 19):
        one = jk.forward(zoo.build(geometry[k]), joints[k])
        np.testing.assert_allclose(batch.values[k], one.values, atol=1e-12)


def test_replacing_geometry_and_limits():
    robot = dataclasses.replace(rpr3.analytic(1, 0, 1), c3=jnp.asarray(0.5))
    assert float(robot.c3) == 0.5
    limited = rpr3.reference(limits=jk.Limits.lengths(3, 10.0, 20.0))
    np.testing.assert_array_equal(limited.limits.high, [20.0] * 3)
