"""Cusp curves: the edges of the analytic family in closed form, borders, and what must not matter."""

import json

import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from section_checks import residuals

import jaxkin as jk
from jaxkin.core.errors import InputError
from jaxkin.mapping.cusp_curves import cusp_curves
from jaxkin.mechanisms import five_bar, rpr3

EXAMPLE = zoo.build(np.array(zoo.EXAMPLE))
ROOT = 3 * np.sqrt(3)
#: (rho1^2 - rho2^2, rho1^2 - rho3^2) on the three cusp edges of the example: triple roots of Eq. (7) of Wenger and
#: Chablat 2009, which are at phi = -90, 30 and 150 degrees.
EDGES = {
    -np.pi / 2: (2.0, 2.0),
    np.pi / 6: ((ROOT - 5) / 2, -(ROOT + 5) / 2),
    5 * np.pi / 6: (-(ROOT + 5) / 2, (ROOT - 5) / 2),
}


def box(high=4.0, low=0.0, n=400):
    return jk.Grid(rho1=(low, high, n), rho2=(low, high, n), rho3=(low, high, n))


@pytest.fixture(scope="module")
def example():
    return cusp_curves(EXAMPLE, box())


def edge_of(geometry):
    """Angles, both differences of squares and h of the cusp edges, from the triple roots of the cubic.

    tan(3 phi / 2) = d (c2 - 2 c) / (d^2 + c c2 - c^2), then A = -4 c2 S h - 4 c2^2 S^2 and B = -4 g h - 4 g^2 with
    g = c S - d C, of Eqs. (4) and (5), and h from dA = dB = 0 along the kernel: A and B have one double root each.
    """
    c2, c, d = geometry
    first = 2 / 3 * np.arctan2(d * (c2 - 2 * c), d * d + c * c2 - c * c)
    edges = []
    for k in range(3):
        phi = first + 2 * np.pi / 3 * k
        s, co = np.sin(phi / 2), np.cos(phi / 2)
        g, slope = c * s - d * co, 0.5 * (c * co + d * s)
        # det [[A_phi, A_h], [B_phi, B_h]] = 0 is linear in h.
        # A_phi = -2 c2 C h - 4 c2^2 S C, A_h = -4 c2 S, B_phi = -4 g' h - 8 g g', B_h = -4 g.
        h = -(16 * c2**2 * s * co * g - 32 * c2 * s * g * slope) / (8 * c2 * co * g - 16 * c2 * s * slope)
        a, b = -4 * c2 * s * h - 4 * c2**2 * s * s, -4 * g * h - 4 * g * g
        turns = np.floor((phi + np.pi) / (2 * np.pi))
        # The half-angle's direction is reversed by a whole turn.
        edges.append((phi - 2 * np.pi * turns, a, b, h * (-1) ** turns))
    return edges


def assert_on_edges(curves, geometry):
    """Checks that every curve lies on one edge, to rounding, with the pose of the edge."""
    edges, used = edge_of(geometry), []
    for curve in curves:
        squares = curve.joints**2
        a, b = squares[:, 0] - squares[:, 1], squares[:, 0] - squares[:, 2]
        size = 1 + squares.max()
        gaps = [max(np.abs(a - e[1]).max(), np.abs(b - e[2]).max()) / size for e in edges]
        best = int(np.argmin(gaps))
        assert gaps[best] < 1e-12
        phi, h = edges[best][0], edges[best][3]
        x, y, angle = curve.poses.T
        turn = (angle - phi + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(turn).max() < 1e-7
        line = y * np.cos(phi / 2) - x * np.sin(phi / 2)
        assert np.abs(line - h).max() < 1e-9 * (1 + np.abs(curve.poses).max())
        used.append(best)
    return used


# --- the analytic family ---------------------------------------------------------------------------------------


def test_the_edges_of_the_example_are_those_of_the_paper():
    edges = sorted(edge_of(zoo.EXAMPLE))
    np.testing.assert_allclose([e[0] for e in edges], sorted(EDGES), atol=1e-14)
    np.testing.assert_allclose([e[1:3] for e in edges], [EDGES[k] for k in sorted(EDGES)], atol=1e-13)


def test_three_edges_each_with_two_poses(example):
    assert len(example) == 6
    used = assert_on_edges(example, zoo.EXAMPLE)
    assert sorted(used) == [0, 0, 1, 1, 2, 2]
    assert {curve.label for curve in example} == {"f2"}
    assert not any(curve.closed for curve in example)
    assert example.complete
    assert example.residual < 1e-13


def test_the_ends_of_the_edges(example):
    texts = sorted(tuple(sorted(curve.ends)) for curve in example)
    assert texts == sorted(
        2 * [("leg of zero length (rho2 = 0)", "rho1 = 4")]
        + 2 * [("reality lost (f1 = 0)", "rho2 = 4")]
        + 2 * [("reality lost (f1 = 0)", "rho3 = 4")]
    )
    # There r1 = h^2: the pair of poses +-p has become one.
    edges = edge_of(zoo.EXAMPLE)
    for curve in example:
        k = next(i for i, text in enumerate(curve.ends) if not text.startswith("rho"))
        end = curve.joints[-k]
        gaps = [abs(end[0] ** 2 - e[3] ** 2) + abs(end[0] ** 2 - end[1] ** 2 - e[1]) for e in edges]
        assert min(gaps) < 1e-10


def test_number_of_cusps_along_rho2_of_the_example(example):
    moves = example.transitions("rho2")
    # Two edges begin where r1 = h^2, and rho1 = 4 and rho3 = 4 end two of them.
    known = [np.sqrt((21 - 12 * np.sqrt(3)) / 8), np.sqrt((21 + 12 * np.sqrt(3)) / 8), np.sqrt(16 - ROOT), np.sqrt(14)]
    np.testing.assert_allclose(moves.values, known, atol=1e-12)
    assert moves.counts.tolist() == [[1, 2], [2, 3], [3, 2], [2, 1]]
    assert moves.kinds == ("end",) * 4
    assert np.all(np.abs(moves.values - known) < 10 * moves.error)
    assert moves.doubts == ()
    for value in (0.1, 1.0, 2.5, 3.5, 3.9):
        exact = sum(r > 0 for r in _radii(value))
        assert example.count("rho2", value) == exact
        assert example.pose_count(1, value) == 2 * exact


def _radii(value):
    """How far rho2 = value is inside each edge's range and the box of the example, as squares."""
    for _, a, b, h in edge_of(zoo.EXAMPLE):
        r1 = value**2 + a
        yield min(r1 - h * h, r1 - b, 16 - r1, 16 - (r1 - b))


@pytest.mark.parametrize(("geometry", "number"), [((1.0, 2.0, -1.25), 0), ((1.5, -0.7, 0.4), 1), (zoo.EXAMPLE, 2)])
def test_sections_of_members_with_no_one_two_cusps(geometry, number):
    curves = cusp_curves(rpr3.analytic(*geometry), box(high=6.0))
    assert_on_edges(curves, geometry)
    assert curves.complete
    assert curves.count("rho2", 1.0) == number


def test_simultaneous_ends_share_their_bands(example):
    moves = example.transitions("rho1")
    # The example is symmetric in rho2 and rho3: two edges begin at one rho1 and end at one rho1.
    np.testing.assert_allclose(moves.values**2, [1 / 8, 1 / 8, 2, 16 - (5 + ROOT) / 2, 16 - (5 + ROOT) / 2], atol=1e-10)
    assert moves.counts.tolist() == [[0, 2], [0, 2], [2, 3], [3, 1], [3, 1]]


@pytest.mark.parametrize("seed", range(3))
def test_random_members(seed):
    geometry = zoo.random_analytic(np.random.default_rng(seed), 1)[0]
    curves = cusp_curves(rpr3.analytic(*geometry), box(high=8.0))
    used = assert_on_edges(curves, geometry)
    assert curves.complete
    for phi, a, b, h in edge_of(geometry):
        # On an edge rho1^2 runs from max(h^2, A, B) as far as the box.
        low, high = max(h * h, a, b, 0.0), min(64.0, 64 + a, 64 + b)
        expected = 2 if low < high else 0
        assert sum(edge_of(geometry)[k][0] == phi for k in used) == expected


def test_a_general_robot_that_mirrors_the_base_needs_no_factors():
    c2, c, d = 1.0, 0.3, 0.8
    robot = rpr3.general(c2, c, d, c2, np.hypot(c, d), -np.arctan2(d, c))
    curves = cusp_curves(robot, box(high=3.0, low=0.2))
    assert len(curves) > 0
    assert_on_edges(curves, (c2, c, d))


# --- the record, borders, limits, units -----------------------------------------------------------------------


def test_points_close_and_are_singular(example):
    for curve in example:
        inner = slice(2, -2)
        assert max(residuals(EXAMPLE, curve.poses[inner], curve.joints[inner])) < 1e-12


def test_a_box_cuts_the_curves_on_its_borders():
    curves = cusp_curves(EXAMPLE, jk.Grid(rho1=(1.5, 3.0, 99), rho2=(0.5, 2.0, 99), rho3=(0.3, 2.5, 99)))
    assert len(curves) > 0
    assert_on_edges(curves, zoo.EXAMPLE)
    for curve in curves:
        for k, text in enumerate(curve.ends):
            name, bound = text.split(" = ")
            assert curve.joints[-k, int(name[-1]) - 1] == float(bound)
        assert np.all(curve.joints >= [1.5, 0.5, 0.3])
        assert np.all(curve.joints <= [3.0, 2.0, 2.5])


def test_limits_of_the_robot_cut_the_curves():
    robot = rpr3.analytic(*zoo.EXAMPLE, limits=jk.Limits(jnp.zeros(3), jnp.array([1.6, 2.0, 9.0])))
    curves = cusp_curves(robot, box())
    assert max(curve.joints[:, 0].max() for curve in curves) == 1.6
    assert curves.transitions("rho1").range == (0.0, 1.6)


def test_the_unit_of_length_does_not_matter(example):
    scaled = cusp_curves(rpr3.analytic(1e3, 0.0, 1e3), box(high=4e3))
    assert sorted(c.ends for c in scaled) == sorted(tuple(e.replace("= 4", "= 4000") for e in c.ends) for c in example)
    np.testing.assert_allclose(scaled.transitions(1).values / 1e3, example.transitions(1).values, rtol=1e-11)


def test_an_empty_box():
    curves = cusp_curves(EXAMPLE, jk.Grid(rho1=(1.0, 1.1, 99), rho2=(1.0, 1.1, 99), rho3=(1.0, 1.1, 99)))
    assert len(curves) == 0
    assert len(curves.transitions("rho1")) == 0
    assert curves.count("rho3", 1.05) == 0
    assert "0 cusp curves" in str(curves)


def test_the_record_says_what_it_holds(example):
    content = json.loads(example.to_json())
    assert content["request"]["mechanism"] == "rpr3-analytic"
    assert len(content["cusp_curves"]) == 6
    assert [t["axis"] for t in content["transitions"]] == ["rho1", "rho2", "rho3"]
    assert len(content["transitions"][1]["transitions"]) == 4
    assert "6 cusp curves over rho1, rho2, rho3" in str(example)
    assert example["cusp curve 1"] is example[0]
    assert "1 to 2, end" in str(example.transitions("rho2"))


def test_what_is_no_box():
    with pytest.raises(InputError, match=r"jk\.cusp_curves: FiveBar has 2 joint axes.*jk\.cusps"):
        cusp_curves(five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0)), jk.Grid(theta1=(-3, 3, 9), theta2=(-3, 3, 9)))
    with pytest.raises(InputError, match=r"jk\.cusp_curves: the box has 2 free joint axes.*exactly three"):
        cusp_curves(EXAMPLE, jk.Grid(rho1=(0.0, 4.0, 9), rho2=1.0, rho3=(0.0, 4.0, 9)))
    with pytest.raises(InputError, match="got 3 as its box"):
        cusp_curves(EXAMPLE, 3)  # type: ignore[arg-type]


def test_what_is_no_joint(example):
    for axis in ("x", 3, -1, True):
        with pytest.raises(InputError, match=r"CuspCurves\.transitions: .* is no free joint.*rho1, rho2, rho3"):
            example.transitions(axis)
    with pytest.raises(InputError, match=r"CuspCurves\.count: rho2 = 5 is outside the box, 0 to 4"):
        example.count("rho2", 5)
