"""How a section's unknowns and equations are chosen, and that they say the same as the mechanism."""

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from section_checks import section, sheet

import jaxkin as jk
from jaxkin.core.mechanism import scale_vector
from jaxkin.mapping.chart import LINEAR, SQUARE, UNKNOWN, chart_of
from jaxkin.mapping.section import bind_section
from jaxkin.mechanisms import rpr3

EXAMPLE = zoo.build(np.array(zoo.EXAMPLE))
REFERENCE = rpr3.reference()
SLIDERS = zoo.TwoSliders(jnp.asarray(1.0), jnp.asarray(1.5))
FIVE_BAR = zoo.FiveBar(jnp.asarray(2.5), jnp.asarray(1.0), jnp.asarray(1.3))


@jk.mechanism
class Mixed(jk.Mechanism):
    """Joints of every kind: a length, a slide, a crank, and one that stands in two equations."""

    pose_axes = tuple(jk.Axis(name, "length") for name in "xyzw")
    joint_axes = (jk.Axis("leg", "length", 0.0), jk.Axis("slide", "length"), jk.angle("crank"), jk.Axis("twice", "mm"))
    size: jax.Array

    def constraints(self, pose, joints):
        x, y, z, w = pose
        leg, slide, crank, twice = joints
        return jnp.stack(
            [
                x**2 + y**2 - leg**2 + twice * z,
                y * z + 3 * slide - self.size,
                z - self.size * jnp.sin(crank) + w,
                w + twice,
            ]
        )


@pytest.mark.parametrize("robot", [EXAMPLE, REFERENCE], ids=["analytic", "general"])
@pytest.mark.parametrize("free", [(0, 1), (0, 2), (1, 2), (2, 0)])
def test_legs_of_a_3rpr_are_given_by_the_pose_as_squares(robot, free):
    chart, picks = chart_of(robot, free)
    assert chart.kinds == (SQUARE, SQUARE)
    assert (chart.dimension, chart.n_rows, chart.unknown) == (3, 1, ())
    np.testing.assert_array_equal(picks["free_joint"], np.eye(3)[list(free)])
    np.testing.assert_array_equal(picks["free_row"], np.eye(3)[list(free)])
    np.testing.assert_array_equal(picks["kept_row"], np.eye(3)[[3 - sum(free)]])


@pytest.mark.parametrize("robot", [SLIDERS, FIVE_BAR], ids=["sliders", "five-bar"])
def test_carriages_and_cranks_are_unknowns(robot):
    chart, picks = chart_of(robot, (0, 1))
    assert chart.kinds == (UNKNOWN, UNKNOWN)
    assert (chart.dimension, chart.n_rows) == (4, 2)
    assert not picks["free_row"].any()
    np.testing.assert_array_equal(picks["kept_row"], np.eye(2))


@pytest.mark.parametrize(
    ("free", "kinds"),
    [
        ((0, 1), (SQUARE, LINEAR)),
        ((1, 0), (LINEAR, SQUARE)),
        ((1, 2), (LINEAR, UNKNOWN)),
        ((2, 1), (UNKNOWN, LINEAR)),
        ((1, 3), (LINEAR, UNKNOWN)),
        ((0, 3), (UNKNOWN, UNKNOWN)),  # Both free ones stand in the leg's equation.
    ],
)
def test_each_kind_is_recognised(free, kinds):
    chart, picks = chart_of(Mixed(jnp.asarray(2.0)), free)
    assert chart.kinds == kinds
    assert chart.dimension == 4 + kinds.count(UNKNOWN)
    assert len(picks["kept_row"]) == chart.n_rows == chart.dimension - 2


def test_equal_structures_share_one_object():
    assert chart_of(EXAMPLE, (0, 2))[0] is chart_of(REFERENCE, (1, 0))[0]


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e3, 1e6])
def test_recognition_does_not_depend_on_the_unit_of_length(scale):
    assert chart_of(rpr3.analytic(scale, 0.3 * scale, -scale), (0, 1))[0].kinds == (SQUARE, SQUARE)
    assert chart_of(Mixed(jnp.asarray(scale)), (0, 1))[0].kinds == (SQUARE, LINEAR)


@pytest.fixture(scope="module", params=[0, 1, 2])
def bound(request):
    """A section of the reference robot with each leg fixed in turn."""
    return bind_section("a test", REFERENCE, section(request.param, 14.98, high=40.0, low=3.0))


def some_poses(n):
    return zoo.random_poses(np.random.default_rng(5), n, 20.0)


def test_joints_are_those_of_the_inverse_kinematics(bound):
    data, fixed = bound.data, 3 - sum(bound.grid.free)
    poses = some_poses(200)
    joints = np.asarray(jax.vmap(lambda u: bound.chart.joints(data, u))(poses / np.asarray(data.pose_unit)))
    assert np.all(joints[:, fixed] == 14.98)
    inverse = jax.vmap(lambda pose: jk.inverse(REFERENCE, pose).values[0])(jnp.asarray(poses))
    free = list(bound.grid.free)
    np.testing.assert_allclose(joints[:, free], np.asarray(inverse)[:, free], rtol=1e-13)


def test_samples_lie_on_the_section_and_inside_the_box(bound):
    data = bound.data
    joints = np.asarray(jax.vmap(lambda u: bound.chart.joints(data, u))(bound.samples))
    fixed = 3 - sum(bound.grid.free)
    poses = bound.samples * np.asarray(data.pose_unit)
    inverse = np.asarray(jax.vmap(lambda pose: jk.inverse(REFERENCE, pose).values[0])(jnp.asarray(poses)))
    np.testing.assert_allclose(inverse[:, fixed], 14.98, rtol=1e-7)
    assert np.all((joints >= 3 - 1e-6) & (joints <= 40 + 1e-6))
    assert len(bound.samples) > 1500


def test_margins_say_inside_and_vanish_on_the_borders(bound):
    data, free = bound.data, list(bound.grid.free)
    poses = some_poses(4000)
    points = poses / np.asarray(data.pose_unit)
    margins = np.asarray(jax.vmap(lambda u: bound.chart.margins(data, u))(points))
    joints = np.asarray(jax.vmap(lambda u: bound.chart.joints(data, u))(points))[:, free]
    inside = np.stack([joints[:, 0] >= 3, joints[:, 0] <= 40, joints[:, 1] >= 3, joints[:, 1] <= 40], axis=1)
    np.testing.assert_array_equal(margins >= 0, inside)
    assert inside.any(axis=0).all()
    assert not inside[:, [0, 2]].all()


def test_a_lower_end_at_zero_is_no_border_for_a_length():
    bound = bind_section("a test", EXAMPLE, section(1, 1.0, high=4.0))
    at_base = np.array([0.0, 0.0, 0.0])  # rho1 = 0 here
    margins = np.asarray(bound.chart.margins(bound.data, at_base))
    np.testing.assert_array_equal(margins[[0, 2]], 1.0)


def test_the_determinant_is_that_of_the_direct_jacobian(bound):
    data, robot = bound.data, bound.robot
    poses = jnp.asarray(some_poses(100))
    units = np.asarray(scale_vector(robot.pose_axes, robot.characteristic_length()))
    ours = jax.vmap(lambda u: bound.chart.determinant(data, u))(poses / units)
    direct = jax.vmap(lambda pose: jk.jacobians(robot, pose, jnp.ones(3)).direct)(poses)
    theirs = np.linalg.det(np.asarray(direct) * units / np.asarray(data.matrix_scale)[:, None])
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-13)


def test_kernel_and_fold_rate_at_singular_poses(bound):
    from jaxkin.mapping import search

    u = search.seeds_on_curves(bound, 0)[:200]
    matrices = np.asarray(jax.vmap(lambda u: bound.chart.matrix(bound.data, u))(u))
    kernels = np.asarray(jax.vmap(lambda u: bound.chart.kernel(bound.data, u))(u))
    sizes = np.linalg.norm(kernels, axis=1)
    assert sizes.min() > 1e-6
    assert np.max(np.abs(np.einsum("kij,kj->ki", matrices, kernels)) / sizes[:, None]) < 1e-9
    rates = np.asarray(jax.vmap(lambda u: bound.chart.fold_rate(bound.data, u))(u))
    h = 1e-5

    def det(shift):
        return np.linalg.det(
            np.asarray(jax.vmap(lambda u: bound.chart.matrix(bound.data, u))(u + shift * kernels / sizes[:, None]))
        )

    np.testing.assert_allclose(rates / sizes, (det(h) - det(-h)) / (2 * h), atol=1e-7)


def test_the_matrix_has_rows_of_order_one_in_every_unit():
    for scale in (1e-3, 1.0, 1e6):
        robot = rpr3.analytic(scale, 0.0, scale)
        bound = bind_section("a test", robot, section(1, scale, high=4 * scale))
        rows = np.asarray(jax.vmap(lambda u, b=bound: b.chart.matrix(b.data, u))(bound.samples[:300]))
        typical = np.median(np.linalg.norm(rows, axis=2), axis=0)
        np.testing.assert_allclose(typical, 1, rtol=0.5)


def test_linear_joints_are_given_as_they_are():
    robot = sheet({(0, 3): 1 / 3, (0, 1): -1.0})
    bound = bind_section("a test", robot, jk.Grid(q1=(-1.5, 1.0, 50), q2=(-3.0, 2.0, 50)))
    assert bound.chart.kinds == (LINEAR, LINEAR)
    assert bound.chart.n_rows == 0
    x, y = 0.7, -1.1
    unit = np.asarray(bound.data.pose_unit)
    joints = bound.chart.joints(bound.data, jnp.array([x, y]) / unit)
    np.testing.assert_allclose(joints, [x, y**3 / 3 - y + x], rtol=1e-14)
    margins = np.asarray(bound.chart.margins(bound.data, jnp.array([x, y]) / unit))
    expected = [x + 1.5, 1.0 - x, joints[1] + 3, 2 - joints[1]]
    np.testing.assert_allclose(margins, np.array(expected) / np.repeat(bound.data.free_unit, 2), rtol=1e-12)


@jk.mechanism
class Parabola(jk.Mechanism):
    """x = u^2: no length, for the pose may make the square negative; y^2 + 1 = v^2 is one where v is not negative."""

    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.Axis("u", "length", 0.0), jk.Axis("v", "length"))
    limits: jk.Limits

    def constraints(self, pose, joints):
        (x, y), (u, v) = pose, joints
        return jnp.stack([x - u**2, y**2 + 1 - v**2])


@pytest.mark.parametrize(("low", "kinds"), [(0.0, (UNKNOWN, SQUARE)), (-2.0, (UNKNOWN, UNKNOWN))])
def test_a_square_tells_a_joint_only_where_neither_is_negative(low, kinds):
    robot = Parabola(limits=jk.Limits.lengths(2, low=low, high=5.0))
    assert chart_of(robot, (0, 1))[0].kinds == kinds
