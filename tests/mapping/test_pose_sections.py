"""Singular curves over two pose coordinates: every working mode, both kinds, against closed forms."""

import json
import math

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.kinematics.legs import leg_discriminants, leg_joints, legs_of
from jaxkin.mechanisms import five_bar, ppps3, rpr3, tlpm

FIVE_BAR = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
PLANE = jk.Grid(x=(-14.0, 24.0, 200), y=(-14.0, 14.0, 200))
ANALYTIC = rpr3.analytic(1.0, 0.0, 1.0)
GLUED = jk.Grid(x=(-3.0, 3.0, 200), y=0.3, phi=(-math.pi, math.pi, 200))


@pytest.fixture(scope="module")
def five():
    return jk.singular_curves(FIVE_BAR, PLANE, kind="both")


@pytest.fixture(scope="module")
def analytic():
    return jk.singular_curves(ANALYTIC, GLUED, kind="both")


def elbows(joints):
    a, b = joints.T
    return np.stack([8 * np.cos(a), 8 * np.sin(a)], 1), np.stack([9 + 8 * np.cos(b), 8 * np.sin(b)], 1)


def entries(robot, curve):
    """The signs of the diagonal of B at the curve's points."""
    inverse = jax.vmap(lambda x, q: jk.jacobians(robot, x, q).inverse)(
        jnp.asarray(curve.poses), jnp.asarray(curve.joints)
    )
    return np.asarray(jnp.diagonal(inverse, axis1=1, axis2=2))


def _mode(curve):
    return curve.label.split("working mode ")[1][:2]


def parallel(curves):
    return [curve for curve in curves if curve.label.startswith("det A")]


def test_the_five_bars_rods_are_aligned_in_every_mode(five):
    assert five.complete
    assert five.residual < 1e-13
    modes = set()
    for curve in parallel(five):
        first, second = elbows(curve.joints)
        apart = np.hypot(*(second - first).T)
        closing = np.stack([np.hypot(*(curve.poses - end).T) for end in (first, second)])
        assert np.max(np.abs(closing - 5)) < 1e-12
        if curve.label.endswith("self-motion"):
            assert np.max(apart) < 1e-12
            assert np.max(np.ptp(curve.joints, axis=0)) < 1e-9
        else:
            assert np.max(np.abs(apart - 10)) < 1e-12
            assert np.max(np.abs(curve.poses - (first + second) / 2)) < 1e-11
        modes.add(_mode(curve))
    assert modes == {"++", "+-", "-+", "--"}


def test_the_labels_are_the_signs_of_b(five):
    for curve in five:
        signs = _mode(curve)
        b = entries(FIVE_BAR, curve)
        inner = slice(1, -1) if curve.ends != ("", "") else slice(None)
        for k, sign in enumerate(signs):
            if sign == "0":
                assert np.max(np.abs(b[:, k])) < 1e-7
            else:
                assert np.all(b[inner, k] * (1 if sign == "+" else -1) > 0)


def test_a_curve_that_ends_on_a_stretched_leg_goes_on_in_the_other_mode(five):
    """Every such end is the end of just one other piece, whose mode has that leg's other sign."""
    ends = [
        (_mode(curve), "self" in curve.label, curve.ends[side], curve.poses[-side], curve.joints[-side])
        for curve in parallel(five)
        for side in (0, 1)
        if curve.ends[side]
    ]
    assert len(ends) == 24
    for mode, motion, name, pose, joints in ends:
        leg = int(name[-1]) - 1
        assert name.startswith("det B, leg")
        # At its end the leg is stretched or folded: 13 or 3 from its pivot.
        assert min(abs(np.hypot(*(pose - [9 * leg, 0])) - r) for r in (3, 13)) < 1e-12
        partners = [
            other
            for other in ends
            if np.max(np.abs(other[3] - pose)) < 1e-11
            and np.max(np.abs((other[4] - joints + np.pi) % (2 * np.pi) - np.pi)) < 1e-7
            and other[0] != mode
        ]
        assert len(partners) == 1
        assert partners[0][1] == motion
        assert [a != b for a, b in zip(partners[0][0], mode, strict=True)] == [k == leg for k in range(2)]


def test_nothing_is_missed_in_any_working_mode(five):
    """Every change of sign of det A along lines y = constant lies on a curve of its mode."""
    legs = legs_of(FIVE_BAR)
    x = np.linspace(-4.0, 13.0, 4001)

    @jax.jit
    def values(signs, y):
        def one(x):
            pose = jnp.stack([x, y])
            q = leg_joints(FIVE_BAR, legs, signs, pose)
            direct = jax.jacfwd(FIVE_BAR.constraints)(pose, q)
            here = jnp.all(leg_discriminants(FIVE_BAR, legs, pose) > 0)
            return jnp.where(here, jnp.linalg.det(direct), jnp.nan)

        return jax.vmap(one)(jnp.asarray(x))

    checked = 0
    for signs in legs.modes:
        name = "".join("+" if s > 0 else "-" for s in signs)
        own = [curve for curve in parallel(five) if f"working mode {name}" in curve.label]
        points = np.concatenate([np.linspace(a, b, 9) for c in own for a, b in zip(c.poses, c.poses[1:], strict=False)])
        for y in np.linspace(-12.3, 12.1, 30):
            f = np.asarray(values(jnp.asarray(signs, float), y))
            with np.errstate(invalid="ignore"):
                at = np.flatnonzero((f[:-1] < 0) != (f[1:] < 0))
            at = at[np.isfinite(f[at]) & np.isfinite(f[at + 1])]
            for place in at:
                assert np.min(np.hypot(points[:, 0] - x[place], points[:, 1] - y)) < 0.05
                checked += 1
    assert checked > 60


def test_legs_are_singular_on_circles_about_their_pivots(five):
    serial = [curve for curve in five if curve.label.startswith("det B")]
    lengths = np.zeros((2, 2))
    for curve in serial:
        leg = int(curve.label[len("det B, leg ")]) - 1
        radius = np.hypot(*(curve.poses - [9 * leg, 0]).T)
        which = int(radius[0] > 8)
        assert np.max(np.abs(radius - (3, 13)[which])) < 1e-12
        other = np.hypot(*(curve.poses - [9 * (1 - leg), 0]).T)
        assert np.all((other > 3 - 1e-12) & (other < 13 + 1e-12))
        around = np.vstack([curve.poses, curve.poses[:1]]) if curve.closed else curve.poses
        lengths[leg, which] += np.sum(np.hypot(*np.diff(around, axis=0).T))
        assert curve.closed or all(end == f"det B, leg {2 - leg}" for end in curve.ends)
    # The small circles are reached all round; of the large ones what lies within 13 of the other pivot: twice, for
    # both modes of the other leg.
    reached = 2 * math.acos(4.5 / 13)
    np.testing.assert_allclose(lengths / 2, [[6 * math.pi, 13 * reached]] * 2, rtol=2e-3)


def test_factors_are_named_and_glued_angles_closed(analytic):
    curves = [curve for curve in analytic if not curve.label.startswith("det B")]
    assert {curve.label for curve in curves} == {"f1", "f2"}
    for curve in curves:
        values = jax.vmap(ANALYTIC.factors)(jnp.asarray(curve.poses))[curve.label]
        assert np.max(np.abs(np.asarray(values))) < 1e-13
        assert np.all(curve.poses[:, 1] == 0.3)
        assert np.all((curve.poses[:, 2] >= -np.pi) & (curve.poses[:, 2] < np.pi))
        assert all(end in ("x = -3", "x = 3") for end in curve.ends)
        assert abs(curve.poses[0, 0]) == abs(curve.poses[-1, 0]) == 3.0
        # The legs' lengths at every pose.
        joints = zoo.inverse_batch(zoo.build(np.tile(zoo.EXAMPLE, (len(curve), 1))), jnp.asarray(curve.poses)).values[
            :, 0
        ]
        np.testing.assert_allclose(curve.joints, joints, rtol=1e-14, atol=1e-15)
    both = jax.vmap(ANALYTIC.factors)(jnp.asarray(analytic.crossings.poses))
    assert len(analytic.crossings) > 0
    assert max(float(np.max(np.abs(np.asarray(f)))) for f in both.values()) < 1e-13


def test_legs_of_zero_length_are_single_points(analytic):
    dots = [curve for curve in analytic if curve.label.startswith("det B")]
    # B2 = (x, y) + c2 (cos phi, sin phi) is at its anchor (1, 0) where sin phi = -0.3.
    assert [curve.label for curve in dots] == ["det B, leg 2"] * 2
    assert all(curve.ends == ("isolated point",) * 2 for curve in dots)
    found = sorted((curve.poses[0] for curve in dots), key=lambda pose: pose[0])
    phi = math.asin(-0.3)
    near = [1 - math.cos(phi), 0.3, phi]
    far = [1 + math.cos(phi), 0.3, -math.pi - phi]
    np.testing.assert_allclose(found, [near, far], atol=1e-9)


def test_joint_limits_cut_the_curves():
    robot = ANALYTIC.with_limits(rho1=(0.5, 2.0))
    curves = jk.singular_curves(robot, GLUED)
    assert {end for curve in curves for end in curve.ends} == {"rho1 = 0.5", "rho1 = 2"}
    for curve in curves:
        assert np.all((curve.joints[:, 0] >= 0.5) & (curve.joints[:, 0] <= 2.0))
        for place in (0, -1):
            assert curve.joints[place, 0] in (0.5, 2.0)
            assert np.hypot(curve.poses[place, 0], 0.3) == pytest.approx(curve.joints[place, 0], abs=1e-14)


@jk.mechanism
class Coupled(jk.Mechanism):
    """Two sliders of which the second drive moves both: no leg by leg working modes."""

    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.Axis("u", "length"), jk.Axis("v", "length"))
    rod: jax.Array

    def constraints(self, pose, joints):
        (x, y), (u, v) = pose, joints
        return jnp.stack([(x - u - 0.5 * v) ** 2 + y**2 - self.rod**2, (x - v) ** 2 + y**2 - 2 * self.rod**2])


@pytest.mark.slow
def test_coupled_joints_are_traced_over_all_modes_at_once():
    """With carriages at u + v/2 and v: det A = 4 y (difference of the carriages); det B = 0 at y = +-1."""
    robot = Coupled(rod=jnp.asarray(1.0))
    curves = jk.singular_curves(robot, jk.Grid(x=(-3.0, 3.0, 200), y=(-2.0, 2.0, 200)), kind="both")
    assert curves.complete
    assert {curve.label for curve in curves} == {"det A", "det B"}
    for curve in curves:
        assert np.max(np.abs(np.abs(curve.poses[:, 1]) - (curve.label == "det B"))) < 1e-12
        assert sorted(curve.ends) == ["x = -3", "x = 3"]
        assert curve.residual < 1e-13
    assert sum(curve.label == "det A" for curve in curves) == 4
    assert sum(curve.label == "det B" for curve in curves) == 4


@pytest.mark.slow
def test_the_factors_of_the_3_ppps_are_traced_one_by_one():
    robot = ppps3.create()
    grid = jk.Grid(x=0.1, y=0.2, z=0.3, phi=(-math.pi, math.pi, 200), theta=(-1.5, 1.5, 100), sigma=0.3)
    curves = jk.singular_curves(robot, grid)
    assert sorted(curve.label for curve in curves) == ["R22", "R22", "R33", "R33"]
    for curve in curves:
        rotation = np.array([jk.mechanisms.ppps3.position_and_rotation(pose)[1] for pose in curve.poses[::7]])
        k = int(curve.label[1]) - 1
        assert np.max(np.abs(rotation[:, k, k])) < 1e-14
    assert len(curves.crossings) == 2


SPAN = (-1.0, 1.0, 9)
TLPM = tlpm.create(stroke=(-700, 400))
BAD = {
    "both spaces": (ANALYTIC, {"x": SPAN, "y": 0.0, "rho1": 1.0}, {}, ["pose axes (x, y)", "joint axes (rho1)"]),
    "one free axis": (ANALYTIC, {"x": SPAN, "y": 0.0, "phi": 0.0}, {}, ["1 free pose axis (x)", "exactly two"]),
    "a missing axis": (ANALYTIC, {"x": SPAN, "y": SPAN}, {}, ["lacks the pose axis 'phi'"]),
    "a kind": (ANALYTIC, {"x": SPAN, "y": SPAN, "phi": 0.0}, {"kind": "type 2"}, ["kind is 'type 2'", "both"]),
    "a method": (ANALYTIC, {"x": SPAN, "y": SPAN, "phi": 0.0}, {"method": "closed form"}, ["over joints only"]),
    "serial over joints": (
        ANALYTIC,
        {"rho1": SPAN, "rho2": 1.0, "rho3": SPAN},
        {"kind": "both"},
        ["needs a grid over"],
    ),
    "over a turn": (ANALYTIC, {"x": SPAN, "y": 0.0, "phi": (0.0, 9.0, 9)}, {}, ["phi goes from 0 to 9", "period"]),
    "out of reach": (FIVE_BAR, {"x": (50.0, 60.0, 9), "y": SPAN}, {}, ["reaches no pose", "x = 50 .. 60"]),
    "all singular": (TLPM, {"x": SPAN, "y": SPAN, "z": -590.0}, {}, ["det A vanishes at every pose"]),
}


@pytest.mark.parametrize(("robot", "axes", "options", "words"), BAD.values(), ids=list(BAD))
def test_bad_sections_are_refused_with_the_remedy(robot, axes, options, words):
    with pytest.raises(jk.InputError) as caught:
        jk.singular_curves(robot, jk.Grid(**axes), **options)
    for word in words:
        assert word in str(caught.value)


def test_summary_and_json(five):
    text = str(five)
    assert "singular curves over x, y" in text
    assert "det A, working mode +-: " in text
    content = json.loads(five.to_json())
    assert content["request"]["kind"] == "both"
    assert content["request"]["section"]["x"] == [-14.0, 24.0, 200]
    assert len(content["curves"]) == len(five)
