import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray
from matplotlib.legend import Legend

import jaxkin as jk

SECTION = {"rho1": [0.0, 4.0, 40], "rho2": 1.0, "rho3": [0.0, 4.0, 40]}
POSES, JOINTS = ("x", "y", "phi"), ("rho1", "rho2", "rho3")
UNITS = {"x": "length", "y": "length", "phi": "rad", "rho1": "length", "rho2": "length", "rho3": "length"}
TURN = np.linspace(0, 2 * np.pi, 200, endpoint=False)
NONE = np.zeros((0, 3))


def joints(rho1, rho3) -> np.ndarray:
    return np.stack(np.broadcast_arrays(rho1, 1.0, rho3), axis=-1).astype(float)


def curve(points: np.ndarray, label: str = "", virtual: bool = False, closed: bool = False) -> jk.Curve:
    return jk.Curve(points, np.full(points.shape, np.nan if virtual else 0.0), closed, 0.0, label, virtual)


def curves(*found: jk.Curve, method: str = "closed form", crossings: np.ndarray = NONE) -> jk.SingularCurves:
    crossed = jk.Crossings(crossings, np.zeros_like(crossings), np.zeros(len(crossings)))
    return jk.SingularCurves(found, crossed, {"method": method, "section": SECTION}, POSES, JOINTS, UNITS)


def cusps(points: np.ndarray, section: dict = SECTION) -> jk.Cusps:
    zeros = np.zeros(len(points))
    poses = tuple(np.zeros((2, 3)) for _ in points)
    return jk.Cusps(points, poses, zeros, zeros, zeros + 1, (), {"section": section}, POSES, JOINTS, UNITS)


# S twice along a half circle, forth and back, as a curve with two poses over each point is.
HALF = np.concatenate([TURN[:100], TURN[99:0:-1]]) / 2
S = curve(joints(2 + 1.2 * np.cos(HALF), 2 + 1.2 * np.sin(HALF)), "S", closed=True)
APART = curve(joints(np.linspace(0.1, 0.8, 50), 2.0), "S", virtual=True)
Q1 = curve(joints(np.linspace(0.0, 4.0, 200), np.linspace(0.2, 1.8, 200)), "Q1")
SHORT = curve(joints(np.linspace(0.0, 0.05, 20), 0.02), "Q2")
CLOSED = curves(S, APART, Q1, SHORT, crossings=joints([0.8], [2.0]))


@pytest.fixture
def counts() -> xarray.Dataset:
    axis = np.linspace(0.0, 4.0, 60)
    values = np.where(axis[:, None] + axis < 4, 2, 0).astype(np.int8)
    coordinates = {name: (name, axis, {"units": "length"}) for name in ("rho1", "rho3")} | {"rho2": 1.0}
    data = xarray.DataArray(values, coordinates, ("rho1", "rho3"))
    return xarray.Dataset({"forward_count": data}, attrs={"field": "forward_count"})


def legend_texts(ax) -> list[str]:
    return [text.get_text() for legend in ax.findobj(Legend) for text in legend.get_texts()]


def drawn(ax, style: str | None = None, marker: str = "None") -> list:
    """Returns lines as they are seen, without their white halos."""
    lines = [line for line in ax.lines if line.get_color() != "white" and line.get_marker() == marker]
    return [line for line in lines if style is None or line.get_linestyle() == style]


def test_names_stand_on_their_curves_and_the_rest_in_the_legend():
    ax = jk.plot.section(None, curves=CLOSED, cusps=cusps(joints([3.2, 0.8, 9.0], [2.0, 2.0, 1.0])))
    places = {text.get_text(): np.array(text.get_position()) for text in ax.texts}
    assert set(places) == {"$S$", "$Q_{1}$"}
    for name, found in (("$S$", S), ("$Q_{1}$", Q1)):
        assert np.min(np.linalg.norm(found.joints[:, [0, 2]] - places[name], axis=1)) < 0.02
    assert np.linalg.norm(places["$S$"] - places["$Q_{1}$"]) > 0.4
    # The short curve has no room for its name; the cusp outside the picture is not counted.
    assert legend_texts(ax) == ["$S$, virtual (complex poses)", "$Q_{2}$", "1 crossing (no cusp)", "2 cusps"]


def test_virtual_parts_are_thin_and_dashed_and_names_differ_without_colour():
    ax = jk.plot.section(None, curves=CLOSED)
    (real,) = drawn(ax, "-")
    virtual, first, second = sorted(drawn(ax, "--"), key=lambda line: line.get_linewidth())
    assert virtual.get_linewidth() < 0.6 * real.get_linewidth()
    np.testing.assert_allclose(virtual.get_xydata()[:-1], APART.joints[:, [0, 2]], atol=1e-12)
    assert virtual.get_color() == real.get_color()
    assert first._dash_pattern != second._dash_pattern


def test_a_curve_with_two_poses_over_each_point_is_drawn_once():
    ax = jk.plot.section(None, curves=curves(S))
    (line,) = drawn(ax, "-")
    points = line.get_xydata()
    assert np.isfinite(points).all(axis=1).sum() <= len(S) / 2 + 6
    assert np.nanmax(points, axis=0) == pytest.approx(S.joints[:, [0, 2]].max(axis=0), abs=1e-3)
    # A circle is no second pass of itself, and neither is a curve that crosses itself.
    circle = curve(joints(2 + np.cos(TURN), 2 + np.sin(TURN)), "S", closed=True)
    eight = curve(joints(2 + np.sin(TURN), 2 + np.sin(2 * TURN)), "S", closed=True)
    for whole in (circle, eight):
        (line,) = drawn(jk.plot.section(None, curves=curves(whole)), "-")
        kept = line.get_xydata()
        gaps = np.linalg.norm(np.diff(kept[np.isfinite(kept).all(axis=1)], axis=0), axis=1)
        assert gaps.max() < 1.01 * np.linalg.norm(np.diff(whole.joints, axis=0), axis=1).max()
        assert len(gaps) >= len(whole) - 1


def test_traced_curves_are_named_in_the_legend():
    found = curves(curve(Q1.joints, "f1"), curve(S.joints, "f2", closed=True), method="trace")
    ax = jk.plot.section(None, curves=found)
    assert legend_texts(ax) == ["$f_{1}$ = 0", "$f_{2}$ = 0"]
    assert not ax.texts
    assert len({line.get_color() for line in drawn(ax)}) == 2
    assert {line.get_linestyle() for line in drawn(ax)} == {"-", "--"}
    assert legend_texts(jk.plot.section(None, curves=curves(curve(Q1.joints), method="trace"))) == ["singular curve"]


def test_cusps_are_open_circles():
    ax = jk.plot.section(None, cusps=cusps(joints([1.0], [2.0])))
    (circles,) = drawn(ax, marker="o")
    assert circles.get_markerfacecolor() == "none"
    np.testing.assert_array_equal(circles.get_xydata(), [[1.0, 2.0]])
    assert legend_texts(ax) == ["1 cusp"]


def test_without_a_map_the_section_makes_the_axes():
    ax = jk.plot.section(None, curves=CLOSED)
    assert ax.get_xlim() == ax.get_ylim() == (0.0, 4.0)
    assert (ax.get_xlabel(), ax.get_ylabel()) == (r"$\rho_{1}$ (length)", r"$\rho_{3}$ (length)")
    assert ax.get_title() == r"$\rho_{2}$ = 1"
    assert ax.get_aspect() == 1.0


def test_over_a_map_the_legend_of_numbers_stays(counts):
    _, given = plt.subplots()
    ax = jk.plot.section(counts, ax=given, curves=CLOSED, cusps=cusps(joints([3.2], [2.0])))
    assert ax is given
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["0", "2"]
    assert {"0", "2", "1 cusp", "$S$, virtual (complex poses)"} <= set(legend_texts(ax))
    assert {"0", "2", "$S$"} <= {text.get_text() for text in ax.texts}
    assert ax.get_xlim() == (0.0, 4.0)


def test_nothing_is_cut_off_and_no_texts_overlap(counts):
    ax = jk.plot.section(counts, curves=CLOSED, cusps=cusps(joints([3.2], [2.0])))
    ax.figure.canvas.draw()
    for legend in ax.findobj(Legend):
        box = legend.get_window_extent()
        assert box.x1 <= ax.figure.bbox.x1
        assert box.y0 >= 0
    boxes = [text.get_window_extent() for text in ax.texts]
    boxes += [legend.get_window_extent() for legend in ax.findobj(Legend)]
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])


def test_numbers_of_regions_keep_off_virtual_curves(counts):
    through = joints(*np.full((2, 200), np.linspace(0.0, 4.0, 200)))
    ax = jk.plot.section(counts, curves=curves(curve(through, "S", virtual=True)))
    for text in ax.texts:
        x, y = text.get_position()
        assert abs(x - y) > 0.3


def test_a_map_with_a_colour_bar_has_the_legend_below(counts):
    field = counts.forward_count.astype(float)
    ax = jk.plot.section(field, curves=CLOSED)
    ax.figure.canvas.draw()
    assert ax.get_legend().get_window_extent().y1 < ax.get_window_extent().y0
    assert ax.get_legend().get_window_extent().y0 >= 0


def test_nothing_to_draw_and_another_section_are_refused(counts):
    for nothing in ({}, {"curves": curves()}, {"cusps": cusps(NONE)}):
        with pytest.raises(jk.InputError, match="nothing to draw"):
            jk.plot.section(None, **nothing)
    other = cusps(joints([1.0], [1.0]), section={"rho1": 1.0, "rho2": [0.0, 4.0, 9], "rho3": [0.0, 4.0, 9]})
    with pytest.raises(jk.InputError, match=r"Cusps are over rho2 and rho3, rho1 = 1.*rho1 and rho3, rho2 = 1"):
        jk.plot.section(counts, cusps=other)
    with pytest.raises(jk.InputError, match="SingularCurves are over rho1 and rho3, rho2 = 1"):
        jk.plot.section(counts.assign_coords(rho2=2.0), curves=CLOSED)
    with pytest.raises(jk.InputError, match="Cusps are over rho2 and rho3"):
        jk.plot.section(None, curves=CLOSED, cusps=other)
    with pytest.raises(jk.InputError, match="one free axis"):
        jk.plot.section(counts.isel(rho1=3), curves=CLOSED)
