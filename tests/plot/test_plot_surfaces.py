import math

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

import jaxkin as jk
from jaxkin.plot import style

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)


def box(n: int, **changes) -> jk.Grid:
    return jk.Grid(**{"x": (-3.0, 3.0, n), "y": (-3.0, 3.0, n), "phi": (-math.pi, math.pi, n), **changes})


@pytest.fixture(scope="module")
def example() -> jk.SingularSurfaces:
    return jk.singular_surfaces(ROBOT, box(12))


def collections(ax, kind) -> list:
    return [c for c in ax.collections if isinstance(c, kind)]


def test_legend_names_the_factors_their_crossing_and_the_gluing(example):
    ax = jk.plot.surfaces(example)
    assert ax.name == "3d"
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels[:3] == ["$f_{1}$ = 0", "$f_{2}$ = 0", "$f_{1}$ = $f_{2}$ = 0"]
    assert labels[3] == r"glued: $\phi$ = −π and $\phi$ = π are the same"
    first = ax.get_legend().legend_handles[0]
    assert matplotlib.colors.to_hex(first.get_facecolor()).upper() == style.OKABE_ITO["vermillion"]


def test_axes_are_labelled_scaled_and_ticked_in_pi(example):
    ax = jk.plot.surfaces(example)
    ax.figure.canvas.draw()
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel()) == ("$x$ (length)", "$y$ (length)", r"$\phi$ (rad)")
    assert {"−π", "−π/2", "0", "π/2", "π"} <= {tick.get_text() for tick in ax.get_zticklabels()}
    assert ax.get_zlim() == (-math.pi, math.pi)
    wide = jk.singular_surfaces(ROBOT, box(12, x=(-6.0, 6.0, 12)))
    aspect = jk.plot.surfaces(wide)._box_aspect
    assert aspect[0] / aspect[1] == pytest.approx(2.0)


def test_the_seam_is_drawn_on_both_faces(example):
    ax = jk.plot.surfaces(example)
    heights = set()
    for lines in collections(ax, Line3DCollection):
        ends = np.array(lines._segments3d)
        if lines.get_linewidth()[0] > 1:
            assert len(set(ends[:, :, 2].ravel())) == 1
            heights.add(ends[0, 0, 2])
    assert heights == {-math.pi, math.pi}


def test_triangles_are_rasterised_inside_a_vector_figure(example, tmp_path):
    ax = jk.plot.surfaces(example)
    far, near = collections(ax, Poly3DCollection)
    assert far.get_rasterized()
    assert near.get_rasterized()
    ax.figure.savefig(tmp_path / "surfaces.svg")
    text = (tmp_path / "surfaces.svg").read_text()
    assert "data:image/png" in text
    # One layer is painted far to near, the other near to far.
    assert not np.array_equal(far.get_facecolor(), near.get_facecolor())
    np.testing.assert_array_equal(np.sort(far.get_facecolor(), axis=0), np.sort(near.get_facecolor(), axis=0))


def test_a_determinant_without_gluing_and_given_axes():
    found = jk.singular_surfaces(jk.mechanisms.rpr3.reference(), box(10, x=(-30.0, 30.0, 10), phi=(0.0, 1.0, 6)))
    _, given = plt.subplots(subplot_kw={"projection": "3d"})
    assert jk.plot.surfaces(found, ax=given) is given
    assert [text.get_text() for text in given.get_legend().get_texts()] == ["det = 0"]


def test_flat_axes_and_an_empty_box_are_refused(example):
    _, flat = plt.subplots()
    with pytest.raises(jk.InputError, match="projection"):
        jk.plot.surfaces(example, ax=flat)
    empty = jk.singular_surfaces(ROBOT, jk.Grid(x=(2.0, 3.0, 4), y=(2.0, 3.0, 4), phi=(0.2, 0.4, 4)))
    with pytest.raises(jk.InputError, match="no singular surface"):
        jk.plot.surfaces(empty)
