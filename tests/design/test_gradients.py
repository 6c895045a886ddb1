"""Derivatives of every objective by every finite number of a mechanism and by the middle of the place, by differences.

Designs are random and without symmetry: equal worst poses are a kink, at which there is no derivative. Those at which
an objective is nearly singular stand beside them, each with a step that is small against its distance.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize
from design_checks import around, assert_gradients, kernel, sizes_of, vectorised

import jaxkin as jk
from jaxkin.design.walls import walls_of
from jaxkin.mechanisms import rpr3_closed_forms as closed_forms

DESIGNS = 3


@functools.cache
def rpr3():
    limits = jk.Limits(jnp.array([0.35, 0.4, 0.45]), jnp.array([3.1, 3.3, 2.9]))
    return jk.mechanisms.rpr3.general(2.1, 0.8, 1.7, 0.9, 0.75, 1.1, limits)


@functools.cache
def analytic():
    return jk.mechanisms.rpr3.analytic(1.05, 0.2, 0.9).with_limits(rho1=(0.3, 2.1), rho2=(0.35, 2.2), rho3=(0.2, 2.0))


@functools.cache
def five_bar():
    robot = jk.mechanisms.five_bar.create(2.1, (1.9, 2.05), (2.3, 2.2))
    return robot.with_limits(theta1=(-0.9, 2.9), theta2=(-1.1, 2.8))


@functools.cache
def tlpm():
    return jk.mechanisms.tlpm.create(
        600.0, 580.0, ((-190.0, -210.0, -200.0), (205.0, 195.0, 210.0)), orientation=(0.98, 0.05, -0.08, 0.1)
    )


@functools.cache
def ppps3():
    names = [axis.name for axis in jk.mechanisms.ppps3.create().joint_axes]
    robot = jk.mechanisms.ppps3.create(1.1)
    return robot.with_limits(**{name: (-1.9 - 0.1 * k, 1.8 + 0.07 * k) for k, name in enumerate(names)})


def box(n=4):
    return jk.design.box(rpr3(), n, x=(0.62, 0.97), y=(0.21, 0.52), phi=(0.11, 0.34))


def disc(n=4):
    return jk.design.ball(rpr3(), {"x": 0.83, "y": 0.42}, 0.21, n, phi=(-0.13, 0.22))


def five_bar_box(n=5):
    return jk.design.box(five_bar(), n, x=(0.63, 1.24), y=(2.07, 2.63))


def tlpm_ball(n=4):
    return jk.design.ball(tlpm(), {"x": 21.0, "y": -13.0, "z": 17.0}, 90.0, n)


def turns(n=3):
    return jk.design.box(
        ppps3(), n, x=0.04, y=-0.03, z=0.05, phi=(-0.32, 0.27), theta=(-0.21, 0.31), sigma=(-0.25, 0.33)
    )


def analytic_box():
    return jk.design.box(analytic(), x=(0.2, 0.7), y=(0.3, 0.9), phi=(0.1, 0.6))


def listed():
    return jk.design.poses(rpr3(), [[0.62, 0.21, 0.13], [0.97, 0.48, -0.12], [0.71, 0.55, 0.31]])


def home():
    return jk.design.poses(tlpm(), [0.0, 0.0, 0.0])


def first_cusp(robot):
    joints = np.asarray(closed_forms.section_cusps(robot, 1, 1.0).joints)
    rho1, _, rho3 = joints[np.isfinite(joints).all(axis=1)][0]
    return {"rho1": rho1, "rho3": rho3}


MODE = (1, -1)

#: What is asked of each: objective, mechanism, whether its place moves.
GENERIC = {
    "singular value, box": lambda: (jk.design.smallest_singular_value(rpr3(), box()), rpr3()),
    "singular value, five-bar, smoothed": lambda: (
        jk.design.smallest_singular_value(five_bar(), five_bar_box(), mode=MODE, width=0.02),
        five_bar(),
    ),
    "singular value, reach": lambda: (
        jk.design.smallest_singular_value(tlpm(), jk.design.reach(tlpm(), 3)),
        tlpm(),
    ),
    "singular value, poses, length given": lambda: (
        jk.design.smallest_singular_value(rpr3(), listed(), length=1.3),
        rpr3(),
    ),
    "conditioning, spectral": lambda: (jk.design.inverse_condition_number(rpr3(), disc()), rpr3()),
    "conditioning, spectral, six axes": lambda: (jk.design.inverse_condition_number(ppps3(), turns()), ppps3()),
    "conditioning, Frobenius": lambda: (
        jk.design.inverse_condition_number(tlpm(), tlpm_ball(), norm="frobenius", width=0.01),
        tlpm(),
    ),
    "conditioning at home, spectral": lambda: (jk.design.inverse_condition_number(tlpm(), home()), tlpm()),
    "conditioning at home, Frobenius": lambda: (
        jk.design.inverse_condition_number(tlpm(), home(), norm="frobenius"),
        tlpm(),
    ),
    "mean conditioning, spectral": lambda: (jk.design.global_conditioning(rpr3(), disc()), rpr3()),
    "mean conditioning, Frobenius": lambda: (
        jk.design.global_conditioning(five_bar(), five_bar_box(), mode=MODE, norm="frobenius"),
        five_bar(),
    ),
    "mean conditioning, Frobenius, disc": lambda: (
        jk.design.global_conditioning(rpr3(), disc(), norm="frobenius"),
        rpr3(),
    ),
    "mean conditioning, reach": lambda: (jk.design.global_conditioning(tlpm(), jk.design.reach(tlpm(), 3)), tlpm()),
    "limit margin": lambda: (jk.design.limit_margin(rpr3(), box()), rpr3()),
    "limit margin of angles, smoothed": lambda: (
        jk.design.limit_margin(five_bar(), five_bar_box(), mode=MODE, width=0.05),
        five_bar(),
    ),
    "clearance": lambda: (jk.design.clearance(tlpm(), tlpm_ball()), tlpm()),
    "needed stroke": lambda: (jk.design.needed_stroke(rpr3(), disc()), rpr3()),
    "needed stroke, unsmoothed": lambda: (jk.design.needed_stroke(tlpm(), tlpm_ball(), width=0.0), tlpm()),
    "regular box": lambda: (jk.design.regular_size(rpr3(), box()), rpr3()),
    "regular box, smoothed": lambda: (jk.design.regular_size(analytic(), analytic_box(), width=0.05), analytic()),
    "regular cube, three of six axes": lambda: (jk.design.regular_size(ppps3(), turns()), ppps3()),
    "regular disc with a span": lambda: (
        # Where the middle itself is regular at all angles: elsewhere the size is a way back, with kinks.
        jk.design.regular_size(rpr3(), jk.design.ball(rpr3(), {"x": 0.83, "y": 0.42}, 0.21, 4, phi=(1.35, 1.65))),
        rpr3(),
    ),
    "regular ball": lambda: (jk.design.regular_size(tlpm(), tlpm_ball(), limits=["l1_low", "l2_high"]), tlpm()),
    "singularity distance": lambda: (jk.design.singularity_distance(rpr3(), [0.7, 0.3, 0.2]), rpr3()),
    "singularity distance, factors": lambda: (
        jk.design.singularity_distance(analytic(), [0.4, 0.5, 0.3]),
        analytic(),
    ),
    "regular workspaces": lambda: (
        jk.design.regular_workspaces(five_bar(), five_bar_box(), 0.4, limits=False, width=0.2),
        five_bar(),
    ),
    "cusp distance": lambda: (
        jk.design.cusp_distance(
            analytic(), jk.Grid(rho1=(0.0, 4.0, 40), rho2=1.0, rho3=(0.0, 4.0, 40)), first_cusp(analytic())
        ),
        analytic(),
    ),
    "cusp coordinate": lambda: (
        jk.design.cusp_coordinate(
            analytic(), jk.Grid(rho1=(0.0, 4.0, 40), rho2=1.0, rho3=(0.0, 4.0, 40)), "rho3", first_cusp(analytic())
        ),
        analytic(),
    ),
    "volume": lambda: (jk.design.workspace_volume(tlpm()), tlpm()),
    "area of 3-RPR": lambda: (jk.design.workspace_volume(rpr3(), phi=0.3), rpr3()),
    "area of five-bar": lambda: (jk.design.workspace_volume(five_bar()), five_bar()),
}


#: Those whose kernels compile quickly, and of each kind of objective that has one.
QUICK = {
    "singular value, poses, length given",
    "conditioning, spectral",
    "conditioning at home, spectral",
    "conditioning at home, Frobenius",
    "limit margin",
    "needed stroke",
    "needed stroke, unsmoothed",
    "singularity distance, factors",
    "area of five-bar",
}


def marked(names):
    return [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in names]


@functools.cache
def compiled(name):
    function = vectorised(*GENERIC[name]())
    return function, kernel(function)


@pytest.mark.parametrize("name", marked(GENERIC))
def test_gradients_at_random_designs(name):
    function, values = compiled(name)
    assert_gradients(function, values, around(function, DESIGNS, 0.04))


# Where det A = 0 ends at the end of a leg's reach there is no contact, and the shortest ray stands: such a part jumps
# from ray to ray, and shows in the number of regular workspaces, whose smoothing mixes all parts.
@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in GENERIC if name != "regular workspaces"])
def test_gradients_at_many_random_designs(name):
    function, values = compiled(name)
    # Farther off, strokes reach where the TLPM has no assembly mode, and the value is no number.
    share = 0.03 if "reach" in name else 0.06
    assert_gradients(function, values, around(function, 12, share, seed=1), step=2e-5, floor=1e-8)


def singular_angle(robot, x, y):
    """An angle of the platform at which the pose is singular."""

    def determinant(phi):
        return float(jnp.linalg.det(jax.jacfwd(robot.constraints)(jnp.array([x, y, phi]), jnp.ones(3))))

    angles = np.linspace(-math.pi, math.pi, 80)
    signs = np.sign([determinant(phi) for phi in angles])
    k = int(np.flatnonzero(signs[:-1] != signs[1:])[0])
    return scipy.optimize.brentq(determinant, angles[k], angles[k + 1], xtol=1e-15)


def put(function, **values):
    """The start with other numbers."""
    theta = function.start
    for name, value in values.items():
        theta[function.labels.index(name)] = value
    return theta


def beside_a_singular_pose(function):
    """The middle (or the first pose of a list) is 1e-3 rad from a singular pose, on either side."""
    listed = function.objective.place.listed
    first = function.objective.place.center if listed is None else listed[0]
    angle = singular_angle(function.robot, first[0], first[1])
    middle = function.objective.place.center[2]
    return [put(function, **{"center phi": middle + angle + off - first[2]}) for off in (1e-3, -1e-3)]


def nearly_isotropic(function):
    """L / h of the TLPM is sqrt 2: all singular values at home are alike, but for 1e-3 that all numbers are off."""
    isotropic = put(function, base_radius=580.0 * math.sqrt(2), height=580.0)
    return isotropic + 1e-3 * sizes_of(function) * np.random.default_rng(4).uniform(-1.0, 1.0, (2, len(isotropic)))


def nearly_tangent(function):
    """The outer circle of the second leg is within that of the first, and 1e-3 from touching it, or crosses it so."""
    gaps = (1e-3, -1e-3)
    sizes = {"base": 2.1, "proximal[0]": 1.9, "distal[0]": 2.3, "proximal[1]": 1.2}
    return [put(function, **sizes, **{"distal[1]": 4.2 - 2.1 - 1.2 - gap}) for gap in gaps]


def beside_a_cusp(function):
    """The cusp is 1e-3 from the target, less than the width of the smoothing."""
    return [put(function, c2=1.05 + off, c3=0.2, d3=0.9) for off in (1e-3, -1e-3)]


NEARLY_SINGULAR = {
    "singular value, poses, length given": beside_a_singular_pose,
    "mean conditioning, Frobenius, disc": beside_a_singular_pose,
    "regular box": beside_a_singular_pose,
    "singularity distance": beside_a_singular_pose,
    "conditioning at home, spectral": nearly_isotropic,
    "conditioning at home, Frobenius": nearly_isotropic,
    "area of five-bar": nearly_tangent,
    "cusp distance": beside_a_cusp,
}


@pytest.mark.parametrize("name", marked(NEARLY_SINGULAR))
def test_gradients_near_singular_designs(name):
    function, values = compiled(name)
    designs = np.array(NEARLY_SINGULAR[name](function))
    # Without symmetry, but not so much that the distance is another.
    designs += 1e-5 * sizes_of(function) * np.random.default_rng(2).uniform(-1.0, 1.0, designs.shape)
    assert_gradients(function, values, designs, step=5e-6, floor=1e-8)


@pytest.mark.parametrize("make", [jk.design.smallest_singular_value, jk.design.limit_margin])
def test_gradients_out_of_reach_show_the_way_back(make):
    objective = make(five_bar(), jk.design.poses(five_bar(), [[0.83, 4.4], [0.7, 2.2]]), mode=MODE)
    function = vectorised(objective, five_bar())
    values = kernel(function)
    designs = around(function, DESIGNS, 0.01)
    assert np.all(values(designs)[0] < 0)
    assert_gradients(function, values, designs)


@pytest.mark.parametrize("y", [0.0, 1.0])
def test_slopes_of_reach_have_slopes_at_its_end_and_beyond(y):
    """Contacts with the end of a leg's reach, by Lagrange's conditions, lie within rounding on either side of it."""
    robot = jk.mechanisms.five_bar.create(2.0, (2.0, 2.0), (1.0, 2.0))
    place = jk.design.box(robot, x=(0.5, 1.5), y=(1.5, 2.5))
    walls = walls_of("a test", robot, place.center, MODE, False)
    which = walls.names.index("reach of leg 1")
    slope = jax.grad(lambda pose: walls.values(robot, pose)[which])
    assert np.all(np.isfinite(jax.jacfwd(slope)(jnp.array([3.0, y]))))
