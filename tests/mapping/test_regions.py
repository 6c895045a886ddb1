"""Regions of sections with a constant number of assembly modes: areas, counts, neighbours, outlines."""

import itertools
import json

import mechanism_zoo as zoo
import numpy as np
import pytest
import section_checks as checks
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import integrate

import jaxkin as jk
from jaxkin.kinematics.batch import solve_table
from jaxkin.mapping.batch import in_blocks
from jaxkin.mapping.regions import regions
from jaxkin.mechanisms import rpr3, rpr3_closed_forms

EXAMPLE = rpr3.analytic(*zoo.EXAMPLE)
SECTION = checks.section(1, 1.0, high=4.0)
NODES = np.array([0.0, 2.0, 4.0])


def counts(robot, joints):
    """Numbers of assembly modes, without the code under test."""
    return in_blocks(lambda rows: solve_table(robot, rows, forward=True)[0].valid, joints).sum(axis=1)


def random_points(found, count, seed=0):
    """Joint points spread over a section."""
    columns = []
    for value in found.request["section"].values():
        low, high = value[:2] if isinstance(value, list) else (value, value)
        columns.append(np.random.default_rng(seed + len(columns)).uniform(low, high, count))
    return np.stack(columns, axis=1)


def check(robot, found, size):
    """What holds for every division of a section of a given area."""
    assert found.complete, str(found)
    assert abs(found.area / size - 1) < 1e-12
    assert min(region.area for region in found) > 0
    assert max(region.error for region in found) < 1e-6 * size
    points = random_points(found, 1024)
    of = found.region_of(points)
    assert np.mean(of < 0) < 0.01
    numbers = np.array([region.n_solutions for region in found])
    assert np.array_equal(numbers[of[of >= 0]], counts(robot, points)[of >= 0])
    for k, region in enumerate(found):
        assert found.region_of(region.interior) == k
        for other, curve in region.neighbours:
            assert (k, curve) in found[other].neighbours
            assert region.n_solutions != found[other].n_solutions


@pytest.fixture(scope="module")
def example_regions():
    return regions(EXAMPLE, SECTION)


def test_the_regions_of_wenger_and_chablat(example_regions):
    """Fig. 3 of the paper: 2, 4 and 6 solutions; and 0, which it does not mention."""
    check(EXAMPLE, example_regions, 16.0)
    assert [r.name for r in example_regions] == ["0a", "2a", "0b", "6a", "2b", "0c", "4a", "4b"]
    assert len(example_regions.nodes) == 2
    assert sorted(example_regions.areas_by_number()) == [0, 2, 4, 6]


def column_ends(rho1):
    """Returns where a column of the example's section meets S and Q1 to Q4, and its own ends, ascending."""

    def joints(rho3):
        return np.column_stack([np.full(len(rho3), rho1), np.ones(len(rho3)), rho3])

    nodes = np.linspace(0.1, 3.9, 9)
    squares = np.polyfit(nodes**2 - 8, np.asarray(rpr3_closed_forms.quartic(EXAMPLE, joints(nodes))), 4)
    ends = [0.0, 4.0, *(np.sqrt(r.real + 8) for r in np.roots(squares) if abs(r.imag) < 1e-9 and -8 < r.real < 8)]
    for values in rpr3_closed_forms.conics(EXAMPLE, joints(NODES)).values():
        roots = np.roots(np.polyfit(NODES, np.asarray(values), 2))
        ends += [r.real for r in roots if abs(r.imag) < 1e-12 and 0 < r.real < 4]
    return np.sort(ends)


def test_areas_against_columns_of_the_closed_forms(example_regions):
    """Another route: exact columns by the roots of the paper's polynomials, integrated between the vertices."""
    ends = {float(q[0]) for arc in example_regions.arcs for q in arc.joints[[0, -1]]}
    ends |= {float(pick(arc.joints[:, 0])) for arc in example_regions.arcs for pick in (np.min, np.max)}
    for name in ("Q1", "Q2", "Q3", "Q4"):
        # Columns that touch an ellipse: the discriminant of its equation for rho3 is quadratic in rho1.
        rho1, three = np.meshgrid(NODES, NODES, indexing="ij")
        values = np.asarray(rpr3_closed_forms.conics(EXAMPLE, np.stack([rho1, np.ones((3, 3)), three], axis=-1))[name])
        a, b, c = np.polyfit(NODES, values.T, 2)
        ends |= {r.real for r in np.roots(np.polyfit(NODES, b * b - 4 * a * c, 2)) if 0 < r.real < 4}
    bounds = np.array(sorted(ends))
    bounds = bounds[np.append(True, np.diff(bounds) > 1e-7)]
    # Columns start and end like roots at the vertices: x = m + h sin(t) makes them smooth.
    nodes, weights = np.polynomial.legendre.leggauss(24)
    points, pieces = [], []
    for low, high in itertools.pairwise(bounds):
        for t, weight in zip(0.5 * np.pi * nodes, weights, strict=True):
            rho1 = 0.5 * (low + high) + 0.5 * (high - low) * np.sin(t)
            column = column_ends(rho1)
            points += [(rho1, 1.0, middle) for middle in 0.5 * (column[1:] + column[:-1])]
            pieces += (0.25 * np.pi * (high - low) * weight * np.cos(t) * np.diff(column)).tolist()
    number = counts(EXAMPLE, np.array(points))
    total = {n: float(np.sum(np.array(pieces)[number == n])) for n in (0, 2, 4, 6)}
    assert example_regions.areas_by_number() == pytest.approx(total, abs=1e-7)


def test_across_s_the_number_changes_by_four_and_across_q_by_two(example_regions):
    found = example_regions
    seen = set()
    for arc in found.arcs:
        if arc.curve >= 0:
            change = abs(found[arc.sides[0]].n_solutions - found[arc.sides[1]].n_solutions)
            label = found.curves[arc.curve].label
            assert change == 2 * arc.multiplicity == (4 if label == "f2" else 2)
            seen.add(label)
    assert seen == {"f1", "f2"}
    assert {arc.multiplicity for arc in found.arcs} == {0, 1, 2}


def test_arcs_lie_between_their_sides_and_carry_singular_poses(example_regions):
    found = example_regions
    for arc in found.arcs:
        a, b = arc.joints[len(arc) // 2 - 1], arc.joints[len(arc) // 2]
        normal = np.array([-(b - a)[2], 0.0, (b - a)[0]]) / np.linalg.norm(b - a)
        middle = 0.5 * (a + b)
        assert found.region_of(middle + 1e-3 * normal) == arc.sides[0]
        assert found.region_of(middle - 1e-3 * normal) == arc.sides[1]
        if arc.curve >= 0:
            assert max(checks.residuals(EXAMPLE, arc.poses, arc.joints)) < 1e-11
    assert max(checks.residuals(EXAMPLE, found.nodes.poses[:, 0], found.nodes.joints)) < 1e-11
    assert max(checks.residuals(EXAMPLE, found.nodes.poses[:, 1], found.nodes.joints)) < 1e-11
    assert np.min(np.max(np.abs(np.diff(found.nodes.poses, axis=1)), axis=(1, 2))) > 1e-3


def shoelace(line):
    x, y = line[:, 0], line[:, 2]
    return 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))


def test_outlines_enclose_their_regions(example_regions):
    for region in example_regions:
        sizes = [shoelace(line) for line in region.outline]
        assert sizes[0] == max(sizes) > 0
        assert all(size < 0 for size in sizes[1:])
        assert sum(sizes) == pytest.approx(region.area, rel=2e-3, abs=2e-4)


def test_the_same_section_by_other_names(example_regions):
    """In the example legs 2 and 3 can be exchanged: the base triangle is isosceles, and the platform its image."""
    mirrored = regions(EXAMPLE, checks.section(2, 1.0, high=4.0))
    assert [r.n_solutions for r in mirrored] == [r.n_solutions for r in example_regions]
    for one, other in zip(mirrored, example_regions, strict=True):
        assert abs(one.area - other.area) <= one.error + other.error <= 5e-11


@pytest.mark.parametrize("rho1", [14.98, 17.0])
def test_sections_of_the_reference_robot_with_six_cusps(rho1):
    robot = rpr3.reference()
    found = regions(robot, checks.section(0, rho1, high=60.0))
    check(robot, found, 3600.0)
    assert len(found) == 11
    assert len(found.nodes) == 6


lengths = st.floats(0.3, 3.0)


@settings(max_examples=6)
@given(c2=st.floats(0.4, 2.0), c3=st.floats(-2.0, 2.0), d3=st.floats(0.3, 2.0), axis=st.integers(0, 2), fixed=lengths,
       low=st.sampled_from([0.0, 0.4]), high=st.floats(2.5, 7.0))  # fmt: skip
@example(c2=1.0, c3=0.0, d3=1.0, axis=0, fixed=1.2, low=0.0, high=4.0)
@example(
    c2=1.7588083192241233,
    c3=1.9999999999999998,
    d3=1.8700676571074528,
    axis=0,
    fixed=1.084966270206638,
    low=0.0,
    high=5.0,
)
def test_random_sections_of_analytic_robots(c2, c3, d3, axis, fixed, low, high):
    robot = rpr3.analytic(c2, c3, d3)
    grid = checks.section(axis, fixed, low=low, high=high)
    found = regions(robot, grid)
    check(robot, found, (high - low) ** 2)


def test_a_section_without_singular_poses_is_one_region():
    grid = jk.Grid(rho1=(3.0, 3.05, 50), rho2=3.0, rho3=(3.0, 3.04, 50))
    found = regions(EXAMPLE, grid)
    (region,) = found
    assert region.n_solutions == 6
    assert region.area == pytest.approx(0.002, rel=1e-12)
    assert region.neighbours == ()
    assert found.complete
    assert {arc.sides for arc in found.arcs} == {(0, -1), (-1, 0)}
    assert sorted(map(tuple, region.outline[0][:, [0, 2]].tolist())) == [(3, 3), (3, 3.04), (3.05, 3), (3.05, 3.04)]


def test_joint_limits_cut_the_section_like_its_ends():
    limited = EXAMPLE.with_limits(rho1=(0.5, 2.0), rho3=(0.7, 3.0))
    by_limits = regions(limited, SECTION)
    by_ends = regions(EXAMPLE, jk.Grid(rho1=(0.5, 2.0, 400), rho2=1.0, rho3=(0.7, 3.0, 400)))
    assert by_limits.area == pytest.approx(3.45, rel=1e-12)
    assert by_limits.areas_by_number() == pytest.approx(by_ends.areas_by_number(), abs=1e-10)
    assert by_limits.region_of([0.4, 1.0, 1.0]) == -1


def test_the_region_inside_a_cusp_has_the_area_of_the_closed_form():
    """q2 = y^3 + x y + x has three solutions where 4 x^3 + 27 (q2 - x)^2 < 0."""
    robot = checks.sheet({(0, 3): 1.0, (1, 1): 1.0})
    found = regions(robot, jk.Grid(q1=(-1.0, 1.0, 200), q2=(-3.0, 3.0, 200)))
    assert {r.n_solutions for r in found} == {1, 3}
    assert found.areas_by_number()[3] == pytest.approx(8 / (5 * 27**0.5), abs=1e-11)


@pytest.fixture(scope="module")
def torus():
    robot = jk.mechanisms.five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
    whole = (-np.pi, np.pi, 200)
    return robot, regions(robot, jk.Grid(theta1=whole, theta2=whole))


def test_the_torus_of_the_five_bar(torus):
    """Both rods together reach from crank to crank, |C1 - C2| < 10: an arc of theta2 for every theta1."""
    _, found = torus

    def arc(theta1):
        reach = np.hypot(9 - 8 * np.cos(theta1), 8 * np.sin(theta1))
        return 2 * np.arccos(np.clip((reach**2 + 64 - 100) / (16 * reach), -1, 1))

    bends = [s * np.arccos((145 - r * r) / 144) for r in (2.0, 18.0) for s in (1, -1) if abs(145 - r * r) <= 144]
    area = integrate.quad(arc, -np.pi, np.pi, points=bends, limit=400, epsabs=1e-10)[0]
    assert [r.n_solutions for r in found] == [0, 2]
    assert found[1].area == pytest.approx(area, abs=1e-8)
    assert found.area == pytest.approx(4 * np.pi**2, rel=1e-13)
    assert found.complete
    point = found[1].interior
    assert found.region_of(point + 2 * np.pi) == found.region_of(point) == 1
    points = random_points(found, 64)
    apart = np.hypot(9 + 8 * np.cos(points[:, 1]) - 8 * np.cos(points[:, 0]), 8 * (np.sin(points) @ [-1, 1]))
    assert np.array_equal(found.region_of(points), (apart < 10).astype(int))


def test_where_a_torus_is_cut_open_does_not_matter(torus):
    robot, found = torus
    turned = regions(robot, jk.Grid(theta1=(0.3, 0.3 + 2 * np.pi, 200), theta2=(1.1, 1.1 + 2 * np.pi, 200)))
    assert [r.n_solutions for r in turned] == [0, 2]
    assert [r.area for r in turned] == pytest.approx([r.area for r in found], abs=1e-10)


def test_what_a_point_of_no_region_is_told(example_regions):
    found = example_regions
    arc = next(arc for arc in found.arcs if arc.curve >= 0)
    assert found.region_of(arc.joints[len(arc) // 2]) == -1
    assert found.region_of([4.5, 1.0, 1.0]) == -1
    assert found.region_of([[4.5, 1.0, 1.0], found[0].interior]).tolist() == [-1, 0]
    with pytest.raises(jk.InputError, match=r"region_of: joints has shape \(2,\).*\(3,\)"):
        found.region_of([1.0, 1.0])
    with pytest.raises(jk.InputError, match=r"region_of: rho2 is .*1 all over the section"):
        found.region_of([1.0, 1.1, 1.0])


def test_what_is_refused():
    with pytest.raises(jk.InputError, match=r"jk\.regions.*exactly two"):
        regions(EXAMPLE, jk.Grid(rho1=(0.0, 1.0, 9), rho2=1.0, rho3=1.0))
    with pytest.raises(jk.InputError, match=r"jk\.regions got .*Mechanism"):
        regions(None, SECTION)  # type: ignore[arg-type]
    curves = jk.singular_curves(EXAMPLE, checks.section(1, 1.0, high=3.0))
    with pytest.raises(jk.InputError, match=r"jk\.regions got curves of another robot or section"):
        regions(EXAMPLE, SECTION, curves=curves)


def test_known_curves_are_used(example_regions):
    again = regions(EXAMPLE, SECTION, curves=example_regions.curves)
    assert [r.area for r in again] == [r.area for r in example_regions]


def test_a_summary_and_json(example_regions):
    text = str(example_regions)
    assert text.startswith("8 regions over rho1, rho3, 2 nodes, 16 arcs of 2 singular curves")
    assert "6a: 6 solutions, area 0.6388314149" in text
    content = json.loads(example_regions.to_json())
    assert [r["n_solutions"] for r in content["regions"]] == [r.n_solutions for r in example_regions]
    assert content["complete"]
    assert example_regions["6a"].n_solutions == 6
    assert example_regions.limits_not_applied == ()


@pytest.mark.slow
def test_areas_of_the_reference_robot_against_a_map_of_pixels():
    robot = rpr3.reference()
    found = regions(robot, checks.section(0, 14.98, high=60.0))
    middles = (np.arange(500) + 0.5) * 60 / 500
    grid = jk.Grid(rho1=14.98, rho2=(middles[0], middles[-1], 500), rho3=(middles[0], middles[-1], 500))
    number = np.asarray(jk.sweep(robot, "forward_count", grid).forward_count)
    for n, area in found.areas_by_number().items():
        # Pixels on the boundary, about 2000, count wholly or not at all.
        assert abs(np.mean(number == n) * 3600 - area) < 4 * np.sqrt(2000 / 12) * (60 / 500) ** 2


@pytest.mark.slow
def test_a_section_of_the_3_ppps():
    """4 solutions where R22^2 and R33^2 are positive: d^2 + s^2 / 3 < 1 and d^2 < 1 - p^2, with p = 0.3."""
    robot = jk.mechanisms.ppps3.create()
    axes = {"rho1y": 0.0, "rho1z": 0.0, "rho2y": 0.5, "rho3y": -0.2}
    found = regions(robot, jk.Grid(**axes, rho2z=(-1.2, 1.2, 200), rho3z=(-1.2, 1.2, 200)))
    d = 0.91**0.5
    assert found.areas_by_number() == pytest.approx({0: 5.76 - 3**0.5 * (0.3 * d + np.arcsin(d)),
                                                     4: 3**0.5 * (0.3 * d + np.arcsin(d))}, abs=1e-11)  # fmt: skip
    assert found.complete
    assert "rho1x_low" in found.limits_not_applied


@pytest.mark.slow
def test_a_section_of_the_tlpm():
    robot = jk.mechanisms.tlpm.create(stroke=(-700, 400))
    found = regions(robot, jk.Grid(l1=(-700.0, 300.0, 200), l2=-100.0, l3=(-700.0, 300.0, 200)))
    check(robot, found, 1e6)
    assert [r.n_solutions for r in found] == [2, 0]


@pytest.mark.slow
def test_cells_of_a_box_of_the_example():
    box = jk.Grid(rho1=(0.0, 4.0, 400), rho2=(0.5, 2.5, 13), rho3=(0.0, 4.0, 400))
    found = regions(EXAMPLE, box)
    assert found.axis == "rho2"
    assert len(found.slices) == 13
    assert found.volume == pytest.approx(32.0, rel=1e-12)
    assert found.complete, str(found)
    # As many as there are connected parts among 160^3 samples, besides specks: two without solutions.
    assert sorted(cell.name for cell in found) == ["0a", "0b", "2a", "4a", "6a"]
    n = 120
    axes = {name: (low + (high - low) / (2 * n), high - (high - low) / (2 * n), n)
            for name, low, high in (("rho1", 0.0, 4.0), ("rho2", 0.5, 2.5), ("rho3", 0.0, 4.0))}  # fmt: skip
    number = np.asarray(jk.sweep(EXAMPLE, "forward_count", jk.Grid(**axes)).forward_count)
    for count, volume in found.volumes_by_number().items():
        error = sum(cell.error for cell in found if cell.n_solutions == count)
        assert abs(np.mean(number == count) * 32 - volume) < error + 0.01
        assert error < 0.1
    rng = np.random.default_rng(3)
    points = rng.uniform([0, 0.5, 0], [4, 2.5, 4], (40, 3))
    of = [found.region_of(point) for point in points]
    modes = counts(EXAMPLE, points)
    assert sum(k < 0 for k in of) <= 3
    assert all(found[k].n_solutions == m for k, m in zip(of, modes, strict=True) if k >= 0)
    assert json.loads(found.to_json())["axis"] == "rho2"
    assert str(found).startswith("5 cells in 13 slices of constant rho2")
