"""The oracles of aspects, regions, cusp curves and mode changes against known answers and each other."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import numpy as np
import pytest
from flint import fmpq

from . import aspects_scan, five_bar_exact, rpr3_cusp_curves, rpr3_regions
from .aspects_scan import scan
from .five_bar_exact import EXAMPLES, MODES, FiveBar, pieces, sharp_areas
from .mode_loops import check_path, lengths_along, linking_number, winding_number
from .rpr3_cusp_curves import CuspCurve, transitions
from .rpr3_cusp_edges import analytic_edges
from .rpr3_exact import count_general
from .rpr3_sections import cusp_points
from .rpr3_torus import REFERENCE, Degenerate, analytic, random_section

CLASSIC = EXAMPLES[0]
TRANSITIONS = json.loads(rpr3_cusp_curves.DATA.read_text())["reference"]
REGIONS = json.loads(rpr3_regions.DATA.read_text())
FIVE_BARS = json.loads(five_bar_exact.DATA.read_text())
ASPECTS = json.loads(aspects_scan.DATA.read_text())


# --- five-bar ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", EXAMPLES)
def test_five_bar_forward_and_inverse_agree(robot):
    rng = np.random.default_rng(1)
    seen = 0
    for x, y in rng.uniform((-7, -9), (12, 9), (120, 2)):
        for mode in MODES:
            angles = robot.inverse(x, y, mode)
            if angles is None:
                continue
            seen += 1
            found = robot.forward(*angles)
            assert min(math.dist((x, y), p) for p in found) < 1e-9
            direct, *inner = robot.determinants(x, y, *angles)
            assert tuple(np.sign(inner)) == mode
            assert direct == pytest.approx(float(robot.direct(x, y, mode)), rel=1e-9, abs=1e-9)
            tips = robot.tips(*angles)
            numeric = [np.hypot(*(np.array([x, y]) - tip)) for tip in tips]
            assert numeric == pytest.approx(robot.rods, rel=1e-12)
    assert seen > 25


def test_five_bar_determinants_are_derivatives():
    x, y = 5.0, 6.0
    theta = CLASSIC.inverse(x, y, (1, -1))

    def residual(x, y, angles):
        rods = np.array([x, y]) - CLASSIC.tips(*angles)
        return np.sum(rods**2, axis=1) - np.array(CLASSIC.rods) ** 2

    h = 1e-6
    inner = [
        (residual(x, y, np.add(theta, h * e)) - residual(x, y, np.subtract(theta, h * e))) / (2 * h) for e in np.eye(2)
    ]
    outer = [
        (residual(x + h * e, y + h * f, theta) - residual(x - h * e, y - h * f, theta)) / (2 * h) for e, f in np.eye(2)
    ]
    direct, *serial = CLASSIC.determinants(x, y, *theta)
    assert np.linalg.det(np.transpose(outer)) == pytest.approx(direct, rel=1e-7)
    assert np.diag(inner) == pytest.approx(serial, rel=1e-7)
    assert np.abs(inner - np.diag(np.diag(inner))).max() < 1e-7


def test_five_bar_parallel_curve_is_singular():
    theta = np.linspace(-3, 3, 41)
    seen = 0
    for first, second in CLASSIC.parallel_curve(theta):
        for pair in zip(first, second, strict=True):
            if not math.isnan(pair[1]):
                tips = CLASSIC.tips(*pair)
                point = tips.mean(axis=0)  # equal rods: P halves C1 C2
                assert abs(CLASSIC.determinants(*point, *pair)[0]) < 1e-10
                assert np.hypot(*(point - tips[0])) == pytest.approx(5.0, rel=1e-12)
                seen += 1
    assert seen > 10
    for x, y in CLASSIC.coincidences():
        assert math.hypot(x, y) == pytest.approx(8) == math.hypot(x - 9, y)


def test_workspace_area_is_the_lattice_count():
    rng = np.random.default_rng(5)
    for robot in EXAMPLES:
        points = rng.uniform((-17, -17), (25, 17), (200_000, 2))
        far = [np.hypot(points[:, 0] - robot.pivot(k), points[:, 1]) for k in (0, 1)]
        inside = np.all(
            [(low < d) & (d < high) for d, (low, high) in zip(far, map(robot.annulus, (0, 1)), strict=True)], axis=0
        )
        area = 42 * 34 * inside.mean()
        assert robot.workspace_area() == pytest.approx(area, abs=4 * 42 * 34 * math.sqrt(inside.mean() / len(points)))


def test_classic_five_bar_has_ten_aspects():
    found = pieces(CLASSIC, 500)
    assert [sum(p.mode == mode for p in found) for mode in MODES] == [2, 3, 3, 2]
    assert min(p.share for p in found) < 0.005
    areas = sharp_areas(CLASSIC, 300)
    assert {key: len(own) for key, own in areas.items()} == {
        key: 2 if key in (((1, -1), -1), ((-1, 1), 1)) else 1 for key in areas
    }
    # Turned by pi the robot is itself with legs exchanged: in (+, +) each sign has half of the sheet.
    assert areas[(1, 1), 1] == pytest.approx([CLASSIC.workspace_area() / 2], rel=3e-5)
    assert sum(map(sum, areas.values())) == pytest.approx(4 * CLASSIC.workspace_area(), rel=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize("known", FIVE_BARS)
def test_five_bar_data(known):
    robot = FiveBar(known["base"], tuple(known["cranks"]), tuple(known["rods"]))
    areas = sharp_areas(robot, 500)
    stored: dict = {}
    for aspect in known["aspects"]:
        stored.setdefault((tuple(aspect["mode"]), aspect["sign"]), []).append(aspect["area"])
    assert {k: len(v) for k, v in areas.items() if v} == {k: len(v) for k, v in stored.items()}
    for key, own in stored.items():
        assert areas[key] == pytest.approx(own, rel=2e-3, abs=5e-5 * known["sheet"])
    # Labelling finds the same, but for slivers that its samples do not resolve.
    found = pieces(robot, 700)
    for p in found:
        assert min(abs(p.area - area) for area in stored[p.mode, p.sign]) < 5e-3 * known["sheet"]
    resolved = [area for own in stored.values() for area in own if area > 2e-3 * known["sheet"]]
    assert len(found) >= len(resolved)


# --- aspects -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["analytic", "reference"])
def test_rpr3_without_limits_has_two_aspects(name):
    robot, half = {"analytic": (aspects_scan.EXAMPLE, 3), "reference": (aspects_scan.REFERENCE, 40)}[name]
    for size in (50, 80):
        found = scan(robot, ((-half, half), (-half, half)), (size, size, size))
        assert sorted(p.sign for p in found) == [-1, 1]
    assert sum(p.volume for p in found) == pytest.approx((2 * half) ** 2 * 2 * math.pi, rel=1e-12)


@pytest.mark.parametrize("known", ASPECTS[2:5])
def test_limited_rpr3_has_more_aspects(known):
    found = aspects_scan.limited(known["robot"], tuple(known["legs"]), 90)
    assert sorted(p.sign for p in found) == sorted(a["sign"] for a in known["aspects"])
    for sign in (1, -1):
        volumes = [p.volume for p in found if p.sign == sign]
        assert volumes == pytest.approx([a["volume"] for a in known["aspects"] if a["sign"] == sign], rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "legs"), aspects_scan.LIMITED)
def test_limited_counts_stand_under_small_changes(name, legs):
    counts = {
        len(aspects_scan.limited(name, (legs[0] * f, legs[1] * f), size))
        for size, f in ((80, 1), (110, 0.98), (110, 1.02))
    }
    assert counts == {len(next(a for a in ASPECTS if (a["robot"], tuple(a["legs"])) == (name, legs))["aspects"])}


# --- cusp curves ---------------------------------------------------------------------------------------------


def test_analytic_edges_of_the_example():
    # Wenger and Chablat 2009, the cusps of Fig. 3 (truncated there).
    edges = analytic_edges(1.0, 0.0, 1.0)
    assert [edge.phi for edge in edges] == pytest.approx([-math.pi / 2, math.pi / 6, 5 * math.pi / 6], abs=1e-14)
    joints = sorted(joints for edge in edges for joints, _ in edge.cusps(2, 1.0))
    q = math.sqrt(27)
    expected = [(math.sqrt((q - 3) / 2), 1, math.sqrt(1 + q))] * 2 + [(math.sqrt(3), 1, 1)] * 2
    assert np.array(joints) == pytest.approx(np.array(expected), rel=1e-14)
    least = [edge.least(2) for edge in edges]
    assert least == pytest.approx(
        [0, math.sqrt((21 - 12 * math.sqrt(3)) / 8), math.sqrt((21 + 12 * math.sqrt(3)) / 8)], abs=1e-7
    )


@pytest.mark.parametrize("seed", range(6))
def test_analytic_edges_are_the_certified_cusps(seed):
    c2, c3, d3, value = np.random.default_rng(seed).uniform((0.6, -1, 0.4, 0.3), (2, 2, 2, 3)).round(3).tolist()
    for axis in (1, 2, 3):
        certified = sorted(cusp.floats()[0] for cusp in cusp_points(analytic(c2, c3, d3), axis, value))
        own = sorted(joints for edge in analytic_edges(c2, c3, d3) for joints, _ in edge.cusps(axis, value))
        assert np.array(own).reshape(-1, 3) == pytest.approx(np.array(certified).reshape(-1, 3), rel=1e-10, abs=1e-10)


@pytest.mark.parametrize("seed", [0, 3, 4, 7])
def test_cusp_count_of_random_sections(seed):
    geometry, axis, value = random_section(seed)
    assert CuspCurve(geometry, axis).count(fmpq(*value.as_integer_ratio()) ** 2) == len(
        cusp_points(geometry, axis, value)
    )


def test_analytic_robot_is_refused():
    with pytest.raises(Degenerate, match="rpr3_cusp_edges"):
        CuspCurve(analytic(1.0, 0.0, 1.0), 1).count(fmpq(1))


def test_transitions_of_the_reference_robot():
    table = TRANSITIONS["rho1"]
    found = transitions(REFERENCE, 1)
    assert [(t.below, t.above, t.kind) for t in found] == [(t["below"], t["above"], t["kind"]) for t in table]
    assert [t.value for t in found] == pytest.approx([t["value"] for t in table], rel=1e-14)
    # Two of the bands: 8 cusps over 8.6e-9 of a length, 10 over 0.0125.
    assert min(b.value - a.value for a, b in pairwise(found)) == pytest.approx(8.592e-9, rel=1e-3)
    assert max(t.above for t in found) == 10


def test_tables_of_the_legs_share_their_swallowtails():
    # At a swallowtail the cusp curve's image has a cusp: every leg is critical there.
    tables = [
        np.array(sorted(t["joints"] for t in TRANSITIONS[f"rho{axis}"] if t["kind"] == "swallowtail"))
        for axis in (1, 2, 3)
    ]
    assert len(tables[0]) == 12
    for other in tables[1:]:
        assert other == pytest.approx(tables[0], rel=1e-12, abs=1e-12)
    for table in TRANSITIONS.values():
        assert [t["above"] for t in table[:-1]] == [t["below"] for t in table[1:]]
        assert all(abs(t["above"] - t["below"]) == 2 for t in table)


@pytest.mark.parametrize("axis", [1, *(pytest.param(k, marks=pytest.mark.slow) for k in (2, 3))])
def test_counts_between_transitions_are_certified_by_the_other_elimination(axis):
    table = TRANSITIONS[f"rho{axis}"]
    for low, high in pairwise(table):
        assert len(cusp_points(REFERENCE, axis, (low["value"] + high["value"]) / 2)) == low["above"]
    assert len(cusp_points(REFERENCE, axis, 200.0)) == table[-1]["above"]
    assert len(cusp_points(REFERENCE, axis, table[0]["value"] / 2)) == 0 == table[0]["below"]


# --- regions -------------------------------------------------------------------------------------------------


def test_regions_of_the_analytic_example():
    found = rpr3_regions.analytic_example(150)
    known = REGIONS["analytic 1 0 1, rho2 = 1, [0, 4]^2"]
    assert [(r.count, r.area) for r in found] == [
        (r["count"], pytest.approx(r["area"], abs=1e-7)) for r in known["regions"]
    ]
    assert sum(r.area for r in found) == pytest.approx(16, abs=1e-12)
    section = rpr3_regions.ANALYTIC_EXAMPLE
    assert all(section.exact_count(*r.point) == r.count for r in found)


def test_cubic_count_is_the_exact_one():
    section = rpr3_regions.ANALYTIC_EXAMPLE
    points = np.random.default_rng(2).uniform(0, 4, (300, 2))
    counts = [section.count(*point) for point in points]
    assert counts == [section.exact_count(*point) for point in points]
    assert set(counts) == {0, 2, 4, 6}


def modes_of_reference(rho2, rho3):
    platform, base = REFERENCE.platform(), REFERENCE.base()
    return count_general(platform[1], platform[2], base[1][0], *base[2], 14.98, rho2, rho3).count


def test_areas_of_the_reference_against_exact_counts():
    rng = np.random.default_rng(3)
    section = REGIONS["reference, rho1 = 14.98, [0, 40]^2"]
    # One point in each of 16 x 16 squares: far less scatter than 256 free points.
    corners = np.stack(np.meshgrid(np.arange(16), np.arange(16)), axis=-1).reshape(-1, 2)
    points = 2.5 * (corners + rng.uniform(size=corners.shape))
    counts = np.array([modes_of_reference(*point) for point in points])
    for n, area in section["area_by_count"].items():
        assert 6.25 * np.sum(counts == int(n)) == pytest.approx(area, abs=60)
    assert all(modes_of_reference(*region["point"]) == region["count"] for region in section["regions"])


@pytest.mark.slow
def test_regions_of_the_reference_section():
    found = rpr3_regions.reference_section(14.98, 150)
    known = REGIONS["reference, rho1 = 14.98, [0, 40]^2"]["regions"]
    assert [(r.count, r.area) for r in found] == [(r["count"], pytest.approx(r["area"], abs=1e-6)) for r in known]


# --- paths and loops -----------------------------------------------------------------------------------------


def circle(centre, first, second, n):
    angle = 2 * np.pi * np.arange(n) / n
    return np.array(centre) + np.cos(angle)[:, None] * np.array(first) + np.sin(angle)[:, None] * np.array(second)


def test_linking_numbers():
    a = circle((0, 0, 0), (1, 0, 0), (0, 1, 0), 40)
    b = circle((1, 0, 0), (1, 0, 0), (0, 0, 1), 37)
    assert abs(linking_number(a, b)) == pytest.approx(1, abs=1e-12)
    assert linking_number(a, b[::-1]) == pytest.approx(-linking_number(a, b), abs=1e-12)
    assert linking_number(b, a) == pytest.approx(linking_number(a, b), abs=1e-12)
    assert linking_number(a, b + np.array([3, 0, 0])) == pytest.approx(0, abs=1e-12)
    # A coil on a torus around the circle: winds four times through it.
    t = 2 * np.pi * np.arange(300) / 300
    coil = np.stack(
        [(1 + 0.3 * np.cos(4 * t)) * np.cos(t), (1 + 0.3 * np.cos(4 * t)) * np.sin(t), 0.3 * np.sin(4 * t)], 1
    )
    assert abs(linking_number(a, coil)) == pytest.approx(4, abs=1e-12)


def analytic_mode_change(points):
    """A loop of poses of one aspect of the example: signs of p and q are kept in the cover of the half-angle."""
    start, goal = points
    s = np.linspace(0, 1, 200)[:, None]

    def cover(pose):
        x, y, phi = pose
        c, n = math.cos(phi / 2), math.sin(phi / 2)
        return np.array([x * c + y * n, y * c - x * n - (2 * n * n * c - 2 * n * c * c), phi])

    p, q = cover(start), cover(goal)
    phi = (p[2] + s * (q[2] - p[2]))[:, 0]
    along, across = (np.sign(p[k]) * np.exp(np.log(abs(p[k])) + s[:, 0] * np.log(abs(q[k] / p[k]))) for k in (0, 1))
    c, n = np.cos(phi / 2), np.sin(phi / 2)
    h = across + 2 * n * n * c - 2 * n * c * c
    return np.stack([along * c - h * n, along * n + h * c, phi], axis=1)


def test_mode_change_of_the_example_turns_about_a_cusp():
    robot = aspects_scan.EXAMPLE
    # Two of the six modes at (1.2, 1, 1.5), in one aspect.
    modes = (1.18288829952, 0.201928875734, -0.872603641002), (1.16183638452, 0.300226940189, 2.81856912054)
    poses = analytic_mode_change(modes)
    assert poses[-1] == pytest.approx(modes[1], abs=1e-9)
    report = check_path(robot, poses, 1.0)
    assert report.gap < 1e-9
    assert report.moved > 1
    assert report.constant_sign
    assert report.least_determinant > 0.5
    assert report.clearance > 0.1
    # Its joint values, a closed curve, turn about cusp edges: the edges are lines in squared lengths, points in (A, B).
    squares = lengths_along(robot, poses, 3) ** 2
    plane = squares[:, :1] - squares[:, 1:]
    turns = [winding_number(plane, edge.differences[1:]) for edge in analytic_edges(1.0, 0.0, 1.0)]
    assert np.abs(turns) == pytest.approx([0, 1, 0], abs=1e-9)
    # The mode of the same angle lies in the other aspect.
    other = -0.605722625229, 1.03590544997, -0.872603641002
    straight = check_path(robot, np.array([modes[0], other]), 1.0)
    assert straight.gap < 1e-9
    assert not straight.constant_sign


def test_check_path_measures_the_jacobian():
    robot = aspects_scan.REFERENCE
    pose = np.array([3.0, 4.0, 0.7])
    report = check_path(robot, np.array([pose, pose]), 10.0, 2)
    h = 1e-6
    slopes = [
        (np.array(robot.lengths(*(pose + h * e))) - np.array(robot.lengths(*(pose - h * e)))) / (2 * h)
        for e in np.eye(3)
    ]
    scaled = np.transpose(slopes) / (1, 1, 10)
    assert report.clearance == pytest.approx(np.linalg.svd(scaled, compute_uv=False)[-1], rel=1e-6)
    legs = np.array(robot.lengths(*pose))
    assert report.least_determinant == pytest.approx(abs(np.linalg.det(np.transpose(slopes))) * legs.prod(), rel=1e-6)
    assert report.gap == report.moved == 0
    assert lengths_along(robot, np.array([pose, pose])) == pytest.approx(np.array([legs, legs]))
