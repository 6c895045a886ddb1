import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import jaxkin as jk

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
SECTION = jk.Grid(rho1=(0.0, 4.0, 30), rho2=1.0, rho3=(0.0, 4.0, 30))
SIGNS = {1: "#0072B2", -1: "#D55E00"}


@pytest.fixture(scope="module")
def curves() -> jk.CharacteristicCurves:
    return jk.characteristic_curves(ROBOT, SECTION)


@pytest.fixture(scope="module")
def regions() -> jk.BasicRegions:
    return jk.basic_regions(ROBOT, SECTION)


def legend_texts(ax) -> list[str]:
    return [text.get_text() for legend in ax.figure.legends for text in legend.get_texts()]


def test_curves_in_space_and_in_two_projections_by_sign(curves):
    panels = jk.plot.characteristic(curves)
    assert [ax.name for ax in panels] == ["3d", "rectilinear", "rectilinear"]
    labels = [(ax.get_xlabel(), ax.get_ylabel()) for ax in panels[1:]]
    assert labels == [("$x$ (length)", "$y$ (length)"), ("$x$ (length)", r"$\phi$ (rad)")]
    assert legend_texts(panels[0]) == [
        "singular, $f_{1}$ = 0",
        "singular, $f_{2}$ = 0",
        "characteristic, det > 0",
        "characteristic, det < 0",
    ]
    for sign, colour in SIGNS.items():
        drawn = np.concatenate([line.get_xydata() for line in panels[1].lines if line.get_color() == colour])
        own = np.concatenate([curve.poses[:, :2] for curve in curves if curve.sign == sign])
        assert {tuple(p) for p in drawn} == {tuple(p) for p in own}


def test_no_line_runs_across_glued_ends(curves):
    for line in jk.plot.characteristic(curves)[2].lines:
        assert np.abs(np.diff(line.get_ydata())).max(initial=0.0) < np.pi


def test_surfaces_have_a_panel_for_each_sign():
    box = jk.Grid(x=(-2.0, 2.0, 8), y=(-2.0, 2.0, 8), phi=(-np.pi, np.pi, 8))
    found = jk.characteristic_surfaces(ROBOT, box)
    panels = jk.plot.characteristic(found)
    assert [ax.get_title() for ax in panels] == ["det > 0", "det < 0"]
    for ax in panels:
        assert len([c for c in ax.collections if isinstance(c, Poly3DCollection)]) == 2
        assert ax.get_zlim() == (-np.pi, np.pi)
    assert legend_texts(panels[0])[0] == "singular"


def test_basic_regions_have_the_colour_of_their_component(regions):
    panels = jk.plot.basic_regions(regions)
    assert panels.shape == (2, 3)
    texts = legend_texts(panels[0, 0])
    assert sorted(texts) == sorted(f"{c.name}: {len(c.regions)} regions" for c in regions.components)
    for aspect, row in enumerate(panels):
        shown = {text.get_text() for text in row[0].texts}
        assert shown == {str(k) for k, region in enumerate(regions) if region.aspect == aspect}
        names = {text.get_text() for text in row[2].texts}
        assert names == {c.name for c in regions.components}


def test_a_joint_point_has_the_colour_of_its_component(regions):
    ax = jk.plot.basic_regions(regions, aspects=[0])[0, 2]
    found = jk.regions(ROBOT, SECTION)
    colours = {}
    for component in regions.components:
        inner = found[component.joint_regions[0]].interior[[0, 2]]
        inside = [c for c in ax.collections if any(path.contains_point(inner) for path in c.get_paths())]
        assert len(inside) == 1
        assert isinstance(inside[0], PolyCollection)
        colours[component.name] = to_hex(inside[0].get_facecolor()[0])
    assert len(set(colours.values())) == len(regions.components) == 5


def test_a_uniqueness_domain_is_highlighted(regions):
    domains = regions.uniqueness_domains()
    last = [domain for domain in domains if domain.aspect == 1][-1]
    panels = jk.plot.basic_regions(regions, domain=last)
    assert {text.get_text() for text in panels[1, 1].texts} == {str(k) for k in last.regions}
    assert ", ".join(map(str, last.regions)) in panels[1, 1].get_title()
    # In the other aspect it is the largest one.
    most = max(len(domain) for domain in domains if domain.aspect == 0)
    assert len(panels[0, 1].texts) == most


def test_what_can_not_be_drawn_is_refused(curves, regions):
    with pytest.raises(jk.InputError, match="characteristic_curves"):
        jk.plot.characteristic(regions)
    with pytest.raises(jk.InputError, match=r"jk\.basic_regions"):
        jk.plot.basic_regions(curves)
    with pytest.raises(jk.InputError, match="choose of 0, 1"):
        jk.plot.basic_regions(regions, aspects=[7])
    _, flat = plt.subplots()
    with pytest.raises(jk.InputError, match="projection"):
        jk.plot.characteristic(curves, axes=[flat])
