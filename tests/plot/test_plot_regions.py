import matplotlib

matplotlib.use("Agg")
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.legend import Legend
from matplotlib.patches import PathPatch

import jaxkin as jk
from jaxkin.plot import style

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
SECTION = jk.Grid(rho1=(0.0, 4.0, 30), rho2=1.0, rho3=(0.0, 4.0, 30))


@pytest.fixture(scope="module")
def found() -> jk.Regions:
    return jk.regions(ROBOT, SECTION)


def patches(ax) -> list[PathPatch]:
    return [patch for patch in ax.patches if isinstance(patch, PathPatch)]


def legend_texts(ax) -> list[str]:
    return [text.get_text() for legend in ax.findobj(Legend) for text in legend.get_texts()]


def test_every_point_has_the_colour_of_its_number_of_solutions(found):
    ax = jk.plot.regions(found)
    points = np.random.default_rng(3).uniform(0.0, 4.0, (300, 2))
    joints = np.c_[points[:, 0], np.ones(300), points[:, 1]]
    for point, q in zip(points, joints, strict=True):
        region = found.region_of(q)
        if region < 0:
            continue
        inside = [patch for patch in patches(ax) if patch.get_path().contains_point(point)]
        number = int(jk.forward(ROBOT, q).count)
        assert {to_hex(p.get_facecolor()).upper() for p in inside} == {style.count_colour(number).upper()}


def test_names_stand_in_their_regions_or_beside_them(found):
    ax = jk.plot.regions(found)
    places = {text.get_text(): text for text in ax.texts}
    assert {region.name for region in found} <= set(places)
    for region in found:
        anchor = getattr(places[region.name], "xy", places[region.name].get_position())
        np.testing.assert_allclose(anchor, region.interior[[0, 2]])


def test_legends_count_regions_cusps_and_nodes(found):
    texts = legend_texts(jk.plot.regions(found, cusps=jk.cusps(ROBOT, SECTION)))
    for number in (0, 2, 4, 6):
        several = sum(region.n_solutions == number for region in found)
        assert f"{number}  ({several} region{'s' if several > 1 else ''})" in texts
    assert "2 cusps" in texts
    assert f"{len(found.nodes)} nodes (images cross)" in texts


def test_closed_forms_are_drawn_with_their_names(found):
    named = jk.singular_curves(ROBOT, SECTION, method="closed form")
    ax = jk.plot.regions(found, curves=named)
    assert {"$S$", "$Q_{4}$"} <= {text.get_text() for text in ax.texts}
    assert ax.get_title() == r"$\rho_{2}$ = 1"
    assert ax.get_xlabel() == r"$\rho_{1}$ (length)"


def test_other_sections_and_other_things_are_refused(found):
    other = jk.Grid(rho1=(0.0, 4.0, 12), rho2=2.0, rho3=(0.0, 4.0, 12))
    with pytest.raises(jk.InputError, match="rho2 = 2"):
        jk.plot.regions(found, cusps=jk.cusps(ROBOT, other))
    with pytest.raises(jk.InputError, match=r"jk\.regions"):
        jk.plot.regions("regions")  # type: ignore[arg-type]


def test_curves_of_glued_angles_do_not_run_across_the_picture():
    angle = np.linspace(0.0, 4 * np.pi, 80)
    joints = np.stack([(angle + np.pi) % (2 * np.pi) - np.pi, 0.2 * angle], axis=1)
    curve = jk.Curve(joints, np.zeros((80, 2)), False, 0.0, "det")
    crossings = jk.Crossings(*np.zeros((3, 0, 2)))
    turn = [-np.pi, np.pi, 16]
    request = {"section": {"theta1": turn, "theta2": turn}, "method": "trace"}
    names = (("x", "y"), ("theta1", "theta2"), {"x": "length", "y": "length", "theta1": "rad", "theta2": "rad"})
    ax = jk.plot.section(None, curves=jk.SingularCurves((curve,), crossings, request, *names))
    assert len(ax.lines) >= 2
    for line in ax.lines:
        steps = np.abs(np.diff(line.get_xydata(), axis=0))
        assert np.nanmax(steps) < np.pi / 2
        # Pieces reach the border on both sides.
        assert np.nanmax(line.get_xdata()) > np.pi
        assert np.nanmin(line.get_xdata()) < -np.pi


def test_cells_of_a_box_are_drawn_in_slices_with_the_names_of_the_cells():
    box = jk.Grid(rho1=(0.5, 2.0, 8), rho2=(0.8, 1.2, 3), rho3=(0.5, 2.0, 8))
    found = jk.regions(ROBOT, box)
    assert hasattr(found, "slices")
    panels = jk.plot.regions(found)
    assert 1 <= len(panels) <= 6
    names = {cell.name for cell in found}
    for ax in panels:
        (value,) = (v for v in found.values if ax.get_title() == style.value(found.axis, v))
        assert {text.get_text() for text in ax.texts} <= names
        for cell in found:
            for number, region in cell.slices:
                if found.values[number] == value:
                    assert cell.name in [text.get_text() for text in ax.texts]
                    inner = found.slices[number][region].interior[[0, 2]]
                    (inside,) = (p for p in patches(ax) if p.get_path().contains_point(inner))
                    assert to_hex(inside.get_facecolor()).upper() == style.count_colour(cell.n_solutions).upper()
    with pytest.raises(jk.InputError, match="are of a box"):
        jk.plot.regions(found, ax=panels[0])  # type: ignore[call-overload]
