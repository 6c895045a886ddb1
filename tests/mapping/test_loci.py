"""Singular curves of sections against exact components, closed forms, independent residuals and counts of modes."""

import json

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from oracles import rpr3_sections as oracle
from oracles import rpr3_torus as torus
from section_checks import (
    SECTIONS,
    image,
    polyline_distance,
    relabelled,
    residuals,
    section,
    sheet,
    steps,
    stored,
)

import jaxkin as jk
from jaxkin.mechanisms import rpr3
from jaxkin.mechanisms import rpr3_closed_forms as forms
from jaxkin.numerics.continuation import LONGEST_STEP

EXAMPLE = zoo.build(np.array(zoo.EXAMPLE))
#: Members of the analytic family and sections of them, every fixed leg.
ANALYTIC = [
    (zoo.EXAMPLE, 1, 1.0),
    ((1.5, -0.7, 0.4), 0, 1.2),
    ((-0.8, 1.3, 1.1), 2, 0.6),
    ((1.0, 2.0, -1.25), 1, 1.0),
]
#: Free joints that the pose does not give. The tips of the cranks never meet: the base is longer than both.
FIVE_BAR = zoo.FiveBar(*jnp.array([2.5, 1.0, 1.3]))
TURN = (-np.pi, np.pi, 400)


def lost(curves):
    return [curve.ends for curve in curves if "lost" in curve.ends]


def assert_complete(curves):
    """Checks that nothing speaks against completeness."""
    assert not lost(curves)
    assert curves.evidence["of these on no traced curve"] == 0
    assert curves.evidence["contradictory pieces"] == 0
    assert curves.evidence["points found by independent searches"] > 100


@pytest.fixture(scope="module", params=SECTIONS, ids=lambda entry: entry["name"])
def entry(request):
    """A section of the data file, with its curves."""
    robot, grid = stored(request.param)
    return request.param, robot, jk.singular_curves(robot, grid)


@pytest.fixture(scope="module", params=ANALYTIC, ids=str)
def member(request):
    """A section of the analytic family: robot, axis, value, both kinds of curves."""
    geometry, axis, value = request.param
    robot, grid = rpr3.analytic(*geometry), section(axis, value, high=12.0)
    closed = jk.singular_curves(robot, grid, method="closed form")
    return robot, axis, value, jk.singular_curves(robot, grid), closed


# --- against the data file ---------------------------------------------------------------------------------


def test_as_many_closed_curves_as_exact_components(entry):
    stored_entry, _, curves = entry
    assert len(curves) == stored_entry["components"]
    assert all(curve.closed and curve.ends == ("", "") for curve in curves)
    assert len(curves.crossings) == 0
    assert_complete(curves)


def test_poses_close_and_are_singular(entry):
    _, robot, curves = entry
    for curve in curves:
        closing, singular = residuals(robot, curve.poses, curve.joints)
        assert max(closing, singular) < 1e-12
        assert curve.residual < 1e-12
        assert np.all((curve.poses[:, 2] >= -np.pi) & (curve.poses[:, 2] < np.pi))


def test_neighbours_are_a_step_apart_also_from_last_to_first_and_over_the_glued_angle(entry):
    stored_entry, robot, curves = entry
    for curve in curves:
        assert steps(curve, float(robot.characteristic_length())).max() < 1.3 * LONGEST_STEP
        assert np.all(curve.joints[:, stored_entry["fixed_axis"] - 1] == stored_entry["fixed_value"])


def test_longest_first(entry):
    _, robot, curves = entry
    lengths = [steps(curve, float(robot.characteristic_length())).sum() for curve in curves]
    assert lengths == sorted(lengths, reverse=True)


def test_no_singular_pose_of_the_section_is_missing(entry):
    stored_entry, robot, curves = entry
    geometry = torus.Geometry(**stored_entry["geometry"])
    phis = np.linspace(-3.0, 3.0, 25)
    points = torus.singular_points(geometry, stored_entry["fixed_axis"], stored_entry["fixed_value"], phis)
    assert len(points) > 0
    length = float(robot.characteristic_length())
    poses = points[:, [1, 2, 0]] / [length, length, 1]
    gap = np.full(len(poses), np.inf)
    for curve in curves:
        line = curve.poses / [length, length, 1]
        line = np.concatenate([line, line[:1]])
        line[:, 2] = np.unwrap(line[:, 2])
        for turn in range(-2, 3):
            gap = np.minimum(gap, polyline_distance(poses + turn * np.array([0, 0, 2 * np.pi]), line))
    assert gap.max() < 0.2 * LONGEST_STEP  # The sagitta of a step; most are far below.
    assert np.median(gap) < 1e-3


# --- the analytic family: two routes that share nothing -------------------------------------------------------


def test_known_crossings():
    curves = jk.singular_curves(EXAMPLE, section(1, 1.0))
    expected = [[0.866524711911001, 1, 0.148133801733571], [0.195472401235419, 1, 1.79885811212486]]
    found = curves.crossings.joints[np.argsort(-curves.crossings.joints[:, 0])]
    np.testing.assert_allclose(found, expected, rtol=1e-13)
    assert max(residuals(EXAMPLE, curves.crossings.poses, curves.crossings.joints)) < 1e-12
    assert sorted(curve.label for curve in curves) == ["f1", "f2"]
    assert_complete(curves)


def test_crossings_of_both_routes_are_the_exact_ones(member):
    robot, axis, value, traced, closed = member
    exact = forms.section_crossings(robot, axis, value)
    for curves in (traced, closed):
        assert len(curves.crossings) == len(exact.joints)
        if len(exact.joints):
            gaps = zoo.glued_distance(curves.crossings.poses[:, None], exact.poses[None])
            assert gaps.min(axis=0).max() < 1e-11
            assert gaps.min(axis=1).max() < 1e-11


@jax.jit
def s_and_derivatives(robot, joints):
    def s(q):
        return forms.quartic(robot, q)

    return tuple(jax.vmap(f)(joints) for f in (s, jax.grad(s), jax.hessian(s)))


def test_every_traced_point_satisfies_s_or_one_of_the_conics(member):
    robot, _, _, traced, _ = member
    assert_complete(traced)
    labels = set()
    for curve in traced:
        labels.add(curve.label)
        joints = jnp.asarray(curve.joints)
        conics = np.stack([np.abs(v) for v in forms.conics(robot, joints).values()])
        size = 1 + np.abs(curve.joints).max() + float(robot.characteristic_length())
        if curve.label == "f1":
            assert np.max(conics.min(axis=0)) < 1e-10 * size**4
        else:
            # S is flat along its double roots: judge it by its change over the size of the joints.
            assert len(joints) <= 2048
            value, slope, bend = s_and_derivatives(robot, np.resize(joints, (2048, 3)))
            change = np.abs(slope).sum(1) * size + np.abs(bend).sum((1, 2)) * size**2
            assert np.max(np.abs(value) / change) < 1e-10
    assert labels == {"f1", "f2"}


@pytest.mark.parametrize(("label", "letter"), [("f1", "Q"), ("f2", "S")])
def test_both_routes_draw_the_same_poses(member, label, letter):
    robot, _, _, traced, closed = member
    length = float(robot.characteristic_length())
    one = np.concatenate([curve.poses for curve in traced if curve.label == label])
    other = np.concatenate([c.poses for c in closed if c.label[0] == letter and not c.virtual])
    gaps = zoo.glued_distance(one[:, None], other[None], length)
    assert gaps.min(axis=0).max() < LONGEST_STEP
    assert gaps.min(axis=1).max() < LONGEST_STEP
    assert max(curve.residual for curve in [*traced, *closed]) < 1e-12


def test_both_routes_draw_the_same_lines(member):
    _, axis, _, traced, closed = member
    free = [k for k in range(3) if k != axis]
    gap = np.inf
    for label, letter in (("f1", "Q"), ("f2", "S")):
        points = np.concatenate([c.joints[:, free] for c in closed if c.label[0] == letter and not c.virtual])
        gap = np.min([polyline_distance(points, image(c, free)) for c in traced if c.label == label], axis=0)
        assert gap.max() < 1e-3 * 12  # Of the section's width: chords near a leg of zero length.


def test_closed_forms_carry_virtual_parts_and_the_traced_route_does_not(member):
    _, _, _, traced, closed = member
    assert not any(curve.virtual for curve in traced)
    for curve in closed:
        assert np.all(np.isnan(curve.poses)) == curve.virtual
        assert curve.label in ("S", "Q1", "Q2", "Q3", "Q4")


# --- the borders of the box and the limits of the robot -------------------------------------------------------

BOXES = {
    "wide": {"rho1": (0.5, 2.0, 300), "rho2": 1.0, "rho3": (0.5, 2.4, 300)},
    "flat": {"rho1": (0.2, 2.2, 300), "rho2": 1.0, "rho3": (1.02, 1.2, 300)},
    "small": {"rho1": (1.0, 1.1, 300), "rho2": 1.0, "rho3": (2.3, 2.5, 300)},
}


def assert_clipped(curves, low, high, free=(0, 2)):
    """Checks that all points are inside and the ends exactly on the border that they name."""
    ends = 0
    for curve in curves:
        values = curve.joints[:, list(free)]
        assert np.all((values >= low) & (values <= high))
        for name, point in zip(curve.ends, (curve.joints[0], curve.joints[-1]), strict=True):
            if "=" in name:
                axis, bound = name.split(" = ")
                place = {f"rho{k + 1}": k for k in range(3)}[axis]
                assert abs(point[place] - float(bound)) < 1e-5  # The name has six digits.
                sides = np.array([low[list(free).index(place)], high[list(free).index(place)]])
                assert np.min(np.abs(point[place] - sides)) < 1e-8
                ends += 1
    return ends


@pytest.mark.parametrize("method", ["trace", "closed form"])
@pytest.mark.parametrize("box", list(BOXES))
def test_curves_end_on_the_borders_of_the_box(box, method):
    curves = jk.singular_curves(EXAMPLE, jk.Grid(**BOXES[box]), method=method)
    low, high = (np.array([BOXES[box][name][k] for name in ("rho1", "rho3")]) for k in (0, 1))
    assert assert_clipped(curves, low, high) >= 4
    if method == "trace":
        assert_complete(curves)


@pytest.mark.parametrize("box", list(BOXES))
def test_the_part_inside_is_all_of_it(box):
    whole, part = (jk.singular_curves(EXAMPLE, g) for g in (section(1, 1.0), jk.Grid(**BOXES[box])))
    low, high = (np.array([BOXES[box][name][k] for name in ("rho1", "rho3")]) for k in (0, 1))
    for label in ("f1", "f2"):
        points = np.concatenate([c.joints[:, [0, 2]] for c in whole if c.label == label])
        points = points[np.all((points > low + 1e-3) & (points < high - 1e-3), axis=1)]
        lines = [image(c, [0, 2]) for c in part if c.label == label]
        if len(points):
            assert np.min([polyline_distance(points, line) for line in lines], axis=0).max() < 3e-3
        else:
            assert not lines


def test_limits_of_the_robot_cut_like_the_box():
    limits = jk.Limits(jnp.array([0.5, 0.0, 0.5]), jnp.array([2.0, 9.0, 2.4]))
    limited = rpr3.analytic(*zoo.EXAMPLE, limits=limits)
    curves, wide = jk.singular_curves(limited, section(1, 1.0)), jk.singular_curves(EXAMPLE, jk.Grid(**BOXES["wide"]))
    assert assert_clipped(curves, np.array([0.5, 0.5]), np.array([2.0, 2.4])) > 0
    assert [curve.ends for curve in curves] == [curve.ends for curve in wide]
    assert_complete(curves)


def test_a_box_beside_all_curves_is_empty():
    grid = jk.Grid(rho1=(1.9, 2.0, 300), rho2=1.0, rho3=(2.0, 2.1, 300))
    curves = jk.singular_curves(EXAMPLE, grid)
    assert len(curves) == 0
    assert curves.residual == 0
    assert "0 singular curves" in str(curves)


@pytest.fixture(scope="module")
def disc():
    """det = x^2 + y^2 - 1, cusps at (1, 0) and (-1, 0)."""
    return sheet({(2, 1): 1.0, (0, 3): 1 / 3, (0, 1): -1.0})


skipped = pytest.mark.xfail(reason="an excursion over the border within one step is not seen", strict=True)


@pytest.mark.parametrize("depth", [1e-2, 1e-4, pytest.param(1e-6, marks=skipped)])
def test_a_border_that_cuts_a_small_cap_off(disc, depth):
    most = jk.singular_curves(disc, jk.Grid(q1=(-1.5, 1 - depth, 99), q2=(-4.0, 4.0, 99)))
    assert [curve.ends for curve in most] == [(f"q1 = {1 - depth:g}",) * 2]
    assert_complete(most)
    assert np.all(most[0].joints[:, 0] <= 1 - depth)


@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6])
def test_a_border_that_leaves_a_small_cap_or_nothing_over(disc, depth):
    cap = jk.singular_curves(disc, jk.Grid(q1=(1 - depth, 1.5, 99), q2=(-4.0, 4.0, 99)))
    assert len(cap) == 1
    assert np.ptp(cap[0].poses[:, 1]) == pytest.approx(2 * np.sqrt(2 * depth - depth**2), rel=1e-6)
    whole = jk.singular_curves(disc, jk.Grid(q1=(-1.5, 1 + depth, 99), q2=(-4.0, 4.0, 99)))
    assert [curve.closed for curve in whole] == [True]
    np.testing.assert_allclose(np.hypot(*whole[0].poses.T), 1, atol=1e-14)


#: Parts that searches from too few places have missed: geometry, fixed leg, low and high ends of the free ones, curves.
HIDDEN = {
    "a whole loop": ((0.972, 0.378, 0.0, 1.964, 1.279, 2.879), 1, 2.109, (0, 0), (30, 30), 2),
    "f1, far out": ((-1.573129735630427, 0.674912, 1.029930), 2, 0.600888, (1.0997, 4.5472), (1.62436, 4.68505), 3),
    "f1, wide box": ((-1.030089, 0.740814, -0.565789), 2, 1.148447, (1.68406, 3.85069), (2.54691, 4.18793), 3),
    "f1, small box": ((0.442368, -0.739246, 1.523284), 1, 0.377715, (0.519869, 3.737914), (0.621987, 3.836162), 3),
    "a neck": ((1.246, 1.995, 0.0, 1.23, 0.792, -0.368), 2, 0.57, (2.100363, 0.34033), (2.225883, 0.463492), 4),
}


@pytest.mark.parametrize("case", list(HIDDEN))
def test_parts_that_few_starts_lead_to(case):
    geometry, axis, value, low, high, number = HIDDEN[case]
    free = [k for k in range(3) if k != axis]
    ranges = {f"rho{k + 1}": (float(a), float(b), 500) for k, a, b in zip(free, low, high, strict=True)}
    curves = jk.singular_curves(zoo.build(np.array(geometry)), jk.Grid(**ranges, **{f"rho{axis + 1}": value}))
    assert len(curves) == number


# --- what must not matter ---------------------------------------------------------------------------------------


def assert_same_lines(one, other, free, scale=1.0, tolerance=4e-3):
    assert sorted(curve.closed for curve in one) == sorted(curve.closed for curve in other)
    for first, second in ((one, other), (other, one)):
        lines = [image(curve, free) for curve in second]
        for curve in first:
            gaps = np.min([polyline_distance(curve.joints[:, free], line) for line in lines], axis=0)
            assert gaps.max() < tolerance * scale


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
def test_the_unit_of_length_does_not_matter(scale):
    here = jk.singular_curves(EXAMPLE, section(1, 1.0))
    scaled = jk.singular_curves(rpr3.analytic(scale, 0.0, scale), section(1, scale, high=6.0 * scale))
    assert_complete(scaled)
    assert [curve.label for curve in scaled] == [curve.label for curve in here]
    gaps = np.abs(here.crossings.joints[:, None] - scaled.crossings.joints[None] / scale).max(axis=2)
    assert gaps.min(axis=1).max() < 1e-13
    for one, other in zip(here, scaled, strict=True):
        assert polyline_distance(one.joints[:, [0, 2]], image(other, [0, 2]) / scale).max() < 4e-3


@pytest.mark.parametrize("index", [2, 3, 15])
def test_the_numbers_of_the_legs_do_not_matter(index):
    entry = SECTIONS[index]
    robot, grid = stored(entry)
    other, swapped = relabelled(entry)
    one, two = jk.singular_curves(robot, grid), jk.singular_curves(other, swapped)
    assert len(one) == len(two) == entry["components"]
    order = [0, 2, 1]
    lines = [np.concatenate([c.joints, c.joints[:1]])[:, order] for c in two]
    for curve in one:
        gaps = np.min([polyline_distance(curve.joints, line) for line in lines], axis=0)
        assert gaps.max() < 5e-3


def test_the_grid_only_seeds():
    # Every n from the smallest to the largest number of starts.
    first = jk.singular_curves(EXAMPLE, section(1, 1.0, n=2))
    for n in (400, 1500, 9000):
        again = jk.singular_curves(EXAMPLE, section(1, 1.0, n=n))
        assert_complete(again)
        assert [curve.label for curve in again] == [curve.label for curve in first]
        assert_same_lines(first, again, [0, 2])
    twice = jk.singular_curves(EXAMPLE, section(1, 1.0, n=400))
    once = jk.singular_curves(EXAMPLE, section(1, 1.0, n=400))
    np.testing.assert_array_equal(once[0].joints, twice[0].joints)


def test_both_ways_of_declaring_the_example_agree():
    general = rpr3.general(1.0, 0.0, 1.0, 1.0, 1.0, -np.pi / 2)
    one, two = (jk.singular_curves(robot, section(1, 1.0)) for robot in (EXAMPLE, general))
    assert_complete(two)
    assert [len(one), len(one.crossings)] == [len(two), len(two.crossings)]
    assert [curve.label for curve in two] == ["", ""]
    assert_same_lines(one, two, [0, 2])


# --- free joints that are unknowns ------------------------------------------------------------------------------


def tips(joints):
    first, second = np.moveaxis(joints, -1, 0)
    return np.stack([2.5 + np.cos(second) - np.cos(first), np.sin(second) - np.sin(first)], axis=-1)


@pytest.fixture(scope="module")
def five_bar():
    return jk.singular_curves(FIVE_BAR, jk.Grid(theta1=TURN, theta2=TURN))


def test_a_five_bar_is_singular_where_its_couplers_are_aligned(five_bar):
    # Here they are stretched: the tips of the cranks are two couplers apart, and cannot meet.
    assert len(five_bar) == 1
    assert_complete(five_bar)
    (curve,) = five_bar
    np.testing.assert_allclose(np.linalg.norm(tips(curve.joints), axis=1), 2.6, rtol=1e-12)
    middle = 0.5 * tips(curve.joints) + np.stack([np.cos(curve.joints[:, 0]), np.sin(curve.joints[:, 0])], axis=1)
    np.testing.assert_allclose(curve.poses, middle, atol=1e-6)
    assert len(five_bar.crossings) == 0


def test_the_five_bars_curve_is_all_of_it(five_bar):
    (curve,) = five_bar
    theta = np.linspace(-np.pi, np.pi, 1201)
    value = np.linalg.norm(tips(np.stack(np.meshgrid(theta, theta, indexing="ij"), axis=-1)), axis=-1) - 2.6
    i, j = np.nonzero(value[1:] * value[:-1] < 0)
    share = value[i, j] / (value[i, j] - value[i + 1, j])
    points = np.stack([theta[i] + share * (theta[1] - theta[0]), theta[j]], axis=1)
    line = image(curve, [0, 1])
    line = np.unwrap(line, axis=0)
    turns = 2 * np.pi * np.array([(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    assert np.min([polyline_distance(points + turn, line) for turn in turns], axis=0).max() < 5e-3


def test_a_five_bars_box_clips_its_curve(five_bar):
    grid = jk.Grid(theta1=(0.2, 2.5, 300), theta2=(-1.0, 2.0, 300))
    curves = jk.singular_curves(FIVE_BAR, grid)
    assert_complete(curves)
    assert len(curves) >= 1
    for curve in curves:
        assert np.all((curve.joints >= [0.2, -1.0]) & (curve.joints <= [2.5, 2.0]))
        np.testing.assert_allclose(np.linalg.norm(tips(curve.joints), axis=1), 2.6, rtol=1e-12)
    whole = five_bar[0].joints
    inside = whole[np.all((whole > [0.21, -0.99]) & (whole < [2.49, 1.99]), axis=1)]
    assert len(inside)
    assert np.min([polyline_distance(inside, image(c, [0, 1])) for c in curves], axis=0).max() < 5e-3


# --- curves by their equation: the determinant is given ---------------------------------------------------------


def test_no_curve_where_the_determinant_has_no_zero():
    curves = jk.singular_curves(sheet({(0, 1): 1.0, (0, 3): 1 / 3}), jk.Grid(q1=(-1.0, 1.0, 99), q2=(-1.0, 1.0, 99)))
    assert len(curves) == len(curves.crossings) == 0
    assert curves.evidence["points found by independent searches"] == 0


def test_a_lemniscate_is_one_curve_that_goes_straight_through_its_crossing():
    # det = y^2 - x^2 + x^4
    robot = sheet({(0, 3): 1 / 3, (2, 1): -1.0, (4, 1): 1.0})
    curves = jk.singular_curves(robot, jk.Grid(q1=(-1.5, 1.5, 99), q2=(-3.0, 3.2, 99)))
    assert_complete(curves)
    assert [curve.closed for curve in curves] == [True]
    np.testing.assert_allclose(curves.crossings.poses, [[0, 0]], atol=1e-12)
    x, y = curves[0].poses.T
    np.testing.assert_allclose(y**2, x**2 - x**4, atol=1e-14)
    chords = np.diff(curves[0].poses, axis=0)
    units = chords / np.linalg.norm(chords, axis=1)[:, None]
    assert np.min(np.sum(units[1:] * units[:-1], axis=1)) > 0.9


# --- the number of modes ----------------------------------------------------------------------------------------


@jax.jit
def counts(robot, joints):
    return jax.vmap(lambda q: jk.forward(robot, q).count)(joints)


def crossed(line, starts, ends):
    """Tells which segments meet the broken line."""
    u, w, a, b = line[:-1], line[1:], starts[:, None], ends[:, None]

    def cross(m, n):
        return m[..., 0] * n[..., 1] - m[..., 1] * n[..., 0]

    apart = (cross(b - a, u - a) > 0) != (cross(b - a, w - a) > 0)
    return np.any(apart & ((cross(w - u, a - u) > 0) != (cross(w - u, b - u) > 0)), axis=1)


@pytest.mark.parametrize(
    ("robot", "axis", "value", "low", "high"),
    [
        (EXAMPLE, 1, 1.0, 0.013, 3.5),
        (rpr3.analytic(1.5, -0.7, 0.4), 0, 1.2, 0.013, 3.5),
        (rpr3.reference(), 0, 14.98, 0.13, 45.0),
        (rpr3.reference(), 2, 9.0, 0.13, 45.0),
    ],
    ids=["example", "another member", "reference, rho1", "reference, rho3"],
)
def test_the_number_of_modes_changes_across_the_curves_alone(robot, axis, value, low, high):
    free = [k for k in range(3) if k != axis]
    points = np.stack(np.meshgrid(*[np.linspace(low, high, 60)] * 2), axis=-1)
    joints = np.insert(points.reshape(-1, 2), axis, value, axis=1)
    number = np.array(counts(robot, jnp.asarray(joints))).reshape(points.shape[:2])
    curves = jk.singular_curves(robot, section(axis, value, high=1.2 * high))
    lines = [image(curve, free) for curve in curves]
    changes = 0
    for one, two in [(np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])]:
        change = (number[one] != number[two]).ravel()
        starts, ends = (points[part].reshape(-1, 2)[change] for part in (one, two))
        met = np.any([crossed(line, starts, ends) for line in lines], axis=0)
        near = np.min([polyline_distance(0.5 * (starts + ends), line) for line in lines], axis=0)
        # A grid point may lie in the sliver between a chord and its arc.
        assert np.all(met | (near < 0.55 * (high - low) / 59))
        assert met.mean() > 0.97
        changes += change.sum()
    assert changes > 40


# --- the record ---------------------------------------------------------------------------------------------------


def test_the_record_says_what_it_holds(member):
    _, axis, value, traced, closed = member
    for curves, method in ((traced, "trace"), (closed, "closed form")):
        content = json.loads(curves.to_json())
        assert content["request"]["method"] == method
        assert content["request"]["section"][f"rho{axis + 1}"] == value
        assert [len(c["joints"]) for c in content["curves"]] == [len(c) for c in curves]
        assert [c["poses"] is None for c in content["curves"]] == [c.virtual for c in curves]
        table = curves.to_dataset()
        assert table.sizes["point"] == sum(map(len, curves))
        np.testing.assert_array_equal(table["rho1"], np.concatenate([c.joints[:, 0] for c in curves]))
        assert len(curves.free) == 2
        assert next(iter(curves)) is curves[0]
        assert str(curves).startswith(f"{len(curves)} singular curves over ")


# --- many samples ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("block", range(5))
def test_components_of_random_robots(block):
    for seed in range(5000 + 40 * block, 5040 + 40 * block):
        geometry, axis, value = torus.random_section(seed)
        try:
            exact = oracle.components(geometry, axis, value).count
        except torus.Degenerate:
            continue
        robot = rpr3.general(geometry.c2, geometry.c3, geometry.d3, geometry.l2, geometry.l3, geometry.beta)
        curves = jk.singular_curves(robot, section(axis - 1, value, high=30.0))
        assert (len(curves), all(c.closed for c in curves)) == (exact, True), seed
        assert_complete(curves)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_crossings_and_poses_of_random_members(seed):
    rng = np.random.default_rng(seed)
    for k in range(50):
        geometry, axis, value = zoo.random_analytic(rng, 1)[0], k % 3, rng.uniform(0.1, 3)
        robot, grid = rpr3.analytic(*geometry), section(axis, value, high=20.0)
        traced, closed = (jk.singular_curves(robot, grid, method=m) for m in ("trace", "closed form"))
        assert_complete(traced)
        exact = forms.section_crossings(robot, axis, value)
        assert len(traced.crossings) == len(exact.joints) == len(closed.crossings)
        length = float(robot.characteristic_length())
        for label, letter in (("f1", "Q"), ("f2", "S")):
            one = np.concatenate([c.poses for c in traced if c.label == label])
            other = np.concatenate([c.poses for c in closed if c.label[0] == letter and not c.virtual])
            gaps = zoo.glued_distance(one[:, None], other[None], length)
            assert max(gaps.min(axis=0).max(), gaps.min(axis=1).max()) < LONGEST_STEP
