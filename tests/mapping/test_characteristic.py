"""Characteristic curves and surfaces: poses that share their joints with singular ones; none is missing or jumps."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanism_zoo import glued_distance

import jaxkin as jk
from jaxkin.mapping.characteristic import characteristic_curves, characteristic_surfaces

SECTION = jk.Grid(rho1=(0.0, 4.0, 400), rho2=1.0, rho3=(0.0, 4.0, 400))


@pytest.fixture(scope="module")
def robot():
    return jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)


@pytest.fixture(scope="module")
def found(robot):
    return characteristic_curves(robot, SECTION)


@pytest.fixture(scope="module")
def reference():
    """The section of Zein, Wenger and Chablat 2007 with six cusps."""
    robot = jk.mechanisms.rpr3.reference()
    section = jk.Grid(rho1=14.98, rho2=(0.0, 40.0, 400), rho3=(0.0, 40.0, 400))
    return robot, characteristic_curves(robot, section), section


@pytest.fixture(scope="module")
def analytic(robot, found):
    return robot, found, SECTION


#: Both planar robots, the general one among the slow tests.
EACH = pytest.mark.parametrize("which", ["analytic", pytest.param("reference", marks=pytest.mark.slow)])


@pytest.fixture(scope="module")
def five_bar():
    robot = jk.mechanisms.five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
    turn = (-math.pi, math.pi, 200)
    return robot, characteristic_curves(robot, jk.Grid(theta1=turn, theta2=turn))


def padded(points):
    """Rows up to the next multiple of 4096, so that few shapes are compiled."""
    return np.concatenate([points, np.repeat(points[-1:], -len(points) % 4096, axis=0)])


@jax.jit
def _determinants(robot, poses, joints):
    return jax.vmap(lambda x, q: jnp.linalg.det(jax.jacfwd(robot.constraints)(x, q)))(poses, joints)


def determinants(robot, poses, joints):
    return np.asarray(_determinants(robot, padded(poses), padded(joints)))[: len(poses)]


_forward = jax.jit(jax.vmap(jk.forward, in_axes=(None, 0)))
_inverse = jax.jit(jax.vmap(jk.inverse, in_axes=(None, 0)))


def over(robot, joints):
    """All poses over joints, NaN where there is none, and their multiplicities."""
    branches = _forward(robot, padded(joints))
    poses = np.where(np.asarray(branches.valid)[..., None], branches.values, np.nan)
    return poses[: len(joints)], np.asarray(branches.multiplicity)[: len(joints)]


def together(curves):
    """Poses and joints of all curves, and the number of the curve of each."""
    owner = np.concatenate([np.full(len(curve), k) for k, curve in enumerate(curves)])
    return np.concatenate([c.poses for c in curves]), np.concatenate([c.joints for c in curves]), owner


def length(robot):
    return float(robot.characteristic_length())


@EACH
def test_every_pose_closes_over_the_joints_and_is_regular(which, request):
    machine, curves, _ = request.getfixturevalue(which)
    assert len(curves) > 0
    assert curves.complete
    assert curves.residual < 1e-12
    poses, joints, owner = together(curves)
    legs = np.asarray(_inverse(machine, padded(poses)).values)[: len(poses), 0]
    assert np.max(np.abs(legs - joints)) < 1e-11 * length(machine)
    signs = np.array([curve.sign for curve in curves])[owner]
    assert np.all(np.sign(determinants(machine, poses, joints)) == signs)


def test_every_point_shares_its_joints_with_a_zero_of_the_sources_factor(robot, found):
    poses, joints, owner = together(found)
    number = np.array([{"f1": 0, "f2": 1}[found.singular[curve.source].label] for curve in found])[owner]
    factors = jax.vmap(lambda x: jnp.stack(list(robot.factors(x).values())))
    values = np.asarray(jax.vmap(factors)(over(robot, joints)[0]))[np.arange(len(joints)), :, number]
    own = np.abs(np.asarray(factors(poses)))
    # Rounding fixes a double root to its square root; next to a cusp, where it is nearly triple, to its cube root.
    tolerance = np.where(np.min(own, axis=1) > 1e-2, 2e-7, 3e-5)
    assert np.all(np.nanmin(np.abs(values), axis=1) < tolerance)
    assert np.min(own) > 1e-7


@EACH
def test_no_other_mode_over_a_singular_curve_is_missing(which, request):
    """Single solutions over the singular curves, away from cusps and crossings, all lie on characteristic curves."""
    machine, curves, _ = request.getfixturevalue(which)
    count = 0
    for number, source in enumerate(curves.singular):
        known, under, _ = together([curve for curve in curves if curve.source == number])
        poses, multiplicity = over(machine, source.joints)
        away = glued_distance(poses, source.poses[:, None], length(machine)) > 1e-2
        point, lane = np.nonzero(away & (multiplicity == 1))
        regular, joints = poses[point, lane], source.joints[point]
        size = np.abs(determinants(machine, regular, joints))
        for pose, q in zip(regular[size > 1e-2], joints[size > 1e-2], strict=True):
            here = np.max(np.abs(under - q), axis=1) < 1e-11 * length(machine)
            assert np.min(glued_distance(known[here], pose, length(machine))) < 1e-9
            count += 1
    assert count > 500


@EACH
def test_curves_never_jump(which, request):
    """Between neighbouring points a pose moves by something between what its velocities at both say."""
    machine, curves, _ = request.getfixturevalue(which)

    poses, joints, owner = together(curves)
    slope = np.asarray(_rates(machine, padded(poses), padded(joints)))[: len(poses)]
    step = np.diff(joints, axis=0)
    predicted = 0.5 * np.einsum("kij,kj->ki", slope[1:] + slope[:-1], step)
    moved = np.diff(poses, axis=0)
    moved[:, 2] -= 2 * np.pi * np.round((moved[:, 2] - predicted[:, 2]) / (2 * np.pi))
    scale = np.array([length(machine)] * 2 + [1.0])
    gap, far = np.max(np.abs(moved - predicted) / scale, axis=1), np.max(np.abs(moved) / scale, axis=1)
    size = np.abs(determinants(machine, poses, joints))
    inner = (np.diff(owner) == 0) & (np.minimum(size[1:], size[:-1]) > 0.02 * np.median(size))
    assert inner.sum() > 500
    assert np.max(far[inner]) < 0.12
    change = np.max(np.abs(np.einsum("kij,kj->ki", np.diff(slope, axis=0), step)) / scale, axis=1)
    assert np.all((gap <= 0.5 * change + 1e-3)[inner])


@jax.jit
def _rates(robot, poses, joints):
    def one(pose, q):
        direct = jax.jacfwd(robot.constraints)(pose, q)
        return -jnp.linalg.solve(direct, jax.jacfwd(robot.constraints, argnums=1)(pose, q))

    return jax.vmap(one)(poses, joints)


@EACH
def test_curves_end_at_the_cusps_twice_each(which, request):
    """At a cusp the third mode arrives along both branches of the singular curve: 4 and 6 triple poses."""
    machine, curves, section = request.getfixturevalue(which)
    triples = {"analytic": 4, "reference": 6}[which]
    cusps = np.concatenate(jk.cusps(machine, section).poses)
    assert len(cusps) == triples
    ends = np.array([c.poses[k] for c in curves for k in (0, -1) if c.ends[k] == "cusp"])
    gaps = glued_distance(cusps, ends[:, None], length(machine))
    assert np.max(np.min(gaps, axis=1)) < 0.05
    assert np.bincount(np.argmin(gaps, axis=1), minlength=triples).tolist() == [2] * triples


def test_limits_add_nothing(robot, found):
    with_limits = characteristic_curves(robot, SECTION, boundary=("singular", "serial", "limits"))
    assert len(with_limits) == len(found)
    assert "on the boundary" in with_limits.evidence["limits"]


def test_a_tlpm_has_none():
    """Its two assembly modes lie on both sides of the base plane: one an aspect."""
    robot = jk.mechanisms.tlpm.create()
    grid = jk.Grid(l1=(-700.0, 300.0, 200), l2=-100.0, l3=(-700.0, 300.0, 200))
    assert len(characteristic_curves(robot, grid)) == 0


@pytest.mark.slow
def test_a_five_bar_has_none_and_its_stretched_legs_are_circles(five_bar):
    """The other mode over a pose with a stretched leg exists, and has the other sign: it is in another aspect."""
    _, found = five_bar
    assert len(found) == 0
    assert found.evidence["poses over the curves in an aspect that these do not bound"] > 500
    assert found.evidence["disagreements about stretched legs"] == 0
    assert len(found.serial) > 0
    for curve in found.serial:
        pivot = {"leg of theta1": 0.0, "leg of theta2": 9.0}[curve.label]
        reach = np.hypot(curve.poses[:, 0] - pivot, curve.poses[:, 1])
        assert np.min(np.abs(np.subtract.outer([13.0, 3.0], reach)), axis=0) == pytest.approx(0.0, abs=1e-11)
        assert curve.residual < 1e-12


@pytest.mark.parametrize("boundary", ["singular", ("singular", "walls")])
def test_an_unknown_boundary_is_refused(robot, boundary):
    with pytest.raises(jk.InputError, match=r"jk\.characteristic_curves: boundary is"):
        characteristic_curves(robot, SECTION, boundary=boundary)


def test_results_print_and_serialise(found):
    assert "16 characteristic curves" in str(found)
    assert found["det > 0, over f1 [0], 1"].sign == 1
    assert '"evidence"' in found.to_json()


@pytest.fixture(scope="module")
def surfaces(robot):
    box = jk.Grid(x=(-3.0, 3.0, 20), y=(-3.0, 3.0, 20), phi=(-math.pi, math.pi, 20))
    return characteristic_surfaces(robot, box)


def test_every_vertex_of_a_surface_shares_its_joints_with_a_singular_pose(robot, surfaces):
    assert len(surfaces) == 4
    assert surfaces.residual < 1e-12
    assert surfaces.evidence["triangles lifted"] > 1000
    for surface in surfaces:
        legs = np.linalg.norm(surface.vertices[:, :2], axis=1)
        assert np.max(np.abs(legs - surface.joints[:, 0])) < 1e-12
        assert np.all(np.sign(determinants(robot, surface.vertices, surface.joints)) == surface.sign)
        # The closed forms of the joint space (Wenger and Chablat 2009) vanish over every singular pose.
        forms = jax.vmap(robot.closed_forms)(surface.joints)
        size = 1 + np.max(surface.joints, axis=1) ** 8
        smallest = np.min(np.abs(np.stack([forms[name] for name in forms])), axis=0)
        assert np.max(smallest / size) < 1e-9


def test_surfaces_are_connected_triangles_without_folds(surfaces):
    for surface in surfaces:
        assert np.array_equal(np.unique(surface.faces), np.arange(len(surface.vertices)))
        corners = surface.vertices[surface.faces]
        assert np.max(np.ptp(corners[..., 2], axis=1)) < np.pi
        edges = np.sort(
            np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]]), 1
        )
        assert np.max(np.unique(edges, axis=0, return_counts=True)[1]) <= 2


def test_both_aspects_have_the_same_surfaces(surfaces):
    """The analytic family's poses come in pairs (p, -p) over one joint value, of opposite signs of the determinant."""
    sizes = {(s.source, s.sign): len(s.faces) for s in surfaces}
    for source in (0, 1):
        assert sizes[source, 1] == pytest.approx(sizes[source, -1], rel=0.02)


def test_a_tlpm_has_no_surfaces():
    robot = jk.mechanisms.tlpm.create()
    box = jk.Grid(x=(-300.0, 300.0, 8), y=(-300.0, 300.0, 8), z=(-700.0, -400.0, 9))
    found = characteristic_surfaces(robot, box)
    assert len(found.singular) == 1
    assert len(found) == 0


@pytest.mark.slow
def test_a_3_ppps_has_no_surfaces():
    """Every pair of signs of (R22, R33) has one pose: over a singular pose all others are singular too."""
    robot = jk.mechanisms.ppps3.create()
    turn = (-math.pi, math.pi, 10)
    box = jk.Grid(x=0.0, y=0.0, z=0.0, phi=turn, theta=(-math.pi / 2, math.pi / 2, 10), sigma=turn)
    found = characteristic_surfaces(robot, box)
    assert len(found.singular) == 2
    assert len(found) == 0
    assert found.evidence["triangles lifted"] == 0
