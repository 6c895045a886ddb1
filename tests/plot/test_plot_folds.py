import dataclasses

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.colors import rgb_to_hsv, to_rgb
from matplotlib.legend import Legend
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import jaxkin as jk
from jaxkin.plot import fold_surface, style

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
UNITS = {"x": "length", "y": "length", "phi": "rad", "rho1": "length", "rho2": "length", "rho3": "length"}


def made(joints_of, determinant_of, fold_of, radius: float = 0.4, shift: float = 0.0) -> jk.Fold:
    """Makes a record whose poses are (b, 0.1 a, a) over parameters a, b, the singular one at zero."""

    def poses(a, b):
        return np.stack([b, 0.1 * a + shift, a], axis=-1)

    line = np.linspace(-radius, radius, 84)
    a, b = np.meshgrid(np.linspace(-radius, radius, 21), np.linspace(-radius, radius, 21), indexing="ij")
    names = ("x", "y", "phi"), ("rho1", "rho2", "rho3")
    return jk.Fold(
        joints_of(a, b),
        poses(a, b),
        determinant_of(a, b),
        joints_of(line, fold_of(line)),
        poses(line, fold_of(line)),
        np.array([0.0, shift, 0.0]),
        *names,
        ("rho1", "rho3"),
        UNITS,
    )


def cusp(**options) -> jk.Fold:
    return made(
        lambda a, b: np.stack([2 + b, np.ones_like(a), 1 + a**3 + a * b], axis=-1),
        lambda a, b: 3 * a**2 + b,
        lambda a: -3 * a**2,
        **options,
    )


def plain() -> jk.Fold:
    """A fold without a cusp, over the line rho1 = 2."""
    return made(lambda a, b: np.stack([2 + b**2, np.ones_like(a), 1 + a], axis=-1), lambda a, b: b, lambda a: 0 * a)


class Recorded(Poly3DCollection):
    """Keeps its polygons, and the colours before drawing sorts them."""

    def __init__(self, polygons, facecolors, **options):
        self.polygons, self.colours = polygons, facecolors
        super().__init__(polygons, facecolors=facecolors, **options)


@pytest.fixture
def surface(monkeypatch):
    """Draws one fold; returns its polygons and their colours."""
    monkeypatch.setattr(fold_surface, "Poly3DCollection", Recorded)

    def draw(fold: jk.Fold) -> tuple[list[np.ndarray], np.ndarray]:
        (layer,) = (c for c in jk.plot.folds(fold)[0].collections if isinstance(c, Recorded))
        return layer.polygons, layer.colours

    return draw


def test_a_panel_for_every_pose_and_the_mechanism_below_it():
    panels = jk.plot.folds([cusp(), cusp(shift=0.5)], robot=ROBOT)
    assert panels.shape == (2, 2)
    assert [ax.name for ax in panels.flat] == ["3d", "3d", "rectilinear", "rectilinear"]
    assert panels[0, 1].get_title() == r"$x$ = 0.000, $y$ = 0.500, $\phi$ = 0.000 rad"
    assert panels[0, 0].figure.get_suptitle() == r"2 poses over $\rho_{1}$ = 2, $\rho_{2}$ = 1, $\rho_{3}$ = 1"
    assert {"$A_1$", "$B_3$"} <= {text.get_text() for text in panels[1, 0].texts}
    _, platform = ROBOT.outline(cusp(shift=0.5).pose)
    drawn = [line.get_xydata() for line in panels[1, 1].lines]
    assert any(points.shape == platform.shape and np.allclose(points, platform) for points in drawn)
    assert jk.plot.folds(cusp()).shape == (1,)


def test_axes_are_the_free_joints_and_the_coordinate_that_parts_the_sheets():
    (ax,) = jk.plot.folds(cusp())
    labels = (ax.get_xlabel(), ax.get_ylabel(), ax.get_zlabel())
    assert labels == (r"$\rho_{1}$ (length)", r"$\rho_{3}$ (length)", r"$\phi$ (rad)")
    assert ax.get_xlim()[0] < 2.0 < ax.get_xlim()[1]
    # An angle that is the same on all sheets cannot tell them apart.
    one = cusp()
    flat = dataclasses.replace(one, poses=one.poses[..., [2, 1, 0]], fold_poses=one.fold_poses[..., [2, 1, 0]])
    (ax,) = jk.plot.folds(flat)
    assert ax.get_zlabel() == "$x$ (length)"


def test_the_legend_names_sheets_fold_and_cusp():
    (ax,) = jk.plot.folds(cusp())
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["det > 0", "det < 0", "fold (det = 0)", "its projection", "cusp"]
    colours = [tuple(handle.get_facecolor()[:3]) for handle in ax.get_legend().legend_handles[:2]]
    assert colours == [to_rgb(style.OKABE_ITO["blue"]), to_rgb(style.OKABE_ITO["vermillion"])]
    (ax,) = jk.plot.folds(plain())
    assert ax.get_legend().get_texts()[-1].get_text() == "singular pose"


@pytest.mark.parametrize(
    ("record", "determinant"), [(cusp(), lambda q, phi: 3 * phi**2 + q), (plain(), lambda q, x: x)]
)
def test_sheets_are_cut_along_the_fold(surface, record, determinant):
    corners, colours = surface(record)
    hues = {sign: rgb_to_hsv(to_rgb(style.SIGN_COLOURS[sign]))[0] for sign in (1, -1)}
    hue = rgb_to_hsv(colours)[:, 0]
    signs = np.where(np.abs(hue - hues[1]) < np.abs(hue - hues[-1]), 1, -1)
    assert len(corners) == len(signs) > 1000
    assert set(signs) == {1, -1}
    for points, sign in zip(corners, signs, strict=True):
        # Linear interpolation between the samples moves the cut a little.
        assert (sign * determinant(points[:, 0] - 2, points[:, 2]) > -0.01).all()


def test_the_three_sheets_of_a_cusp_are_there_whole(surface):
    points = np.concatenate(surface(cusp())[0])
    front = points[points[:, 0] < points[:, 0].min() + 0.05 * np.ptp(points[:, 0])]
    phi = np.sort(front[:, 2])
    # Over its whole front edge the surface is the cubic of its joints, up to the heights of its turns on both sides.
    turn = np.sqrt((2 - front[0, 0]) / 3)
    assert phi[0] < -1.9 * turn
    assert phi[-1] > 1.9 * turn
    assert np.diff(phi).max() < 0.2 * turn


def test_the_cusp_stands_on_the_surface_and_on_the_floor():
    (ax,) = jk.plot.folds(cusp())
    (marks,) = (line for line in ax.lines if line.get_marker() == "o")
    x, y, z = marks.get_data_3d()
    np.testing.assert_allclose([x, y], [[2.0, 2.0], [1.0, 1.0]], atol=1e-12)
    np.testing.assert_allclose(z, [0.0, ax.get_zlim()[0]], atol=1e-12)
    floor = [line for line in ax.lines if np.ptp(np.nan_to_num(line.get_data_3d()[2], nan=ax.get_zlim()[0])) == 0]
    assert len(floor) == 1


def test_nothing_is_cut_off():
    for panels in (jk.plot.folds(cusp()), jk.plot.folds([cusp()] * 4, robot=ROBOT)):
        figure = panels.flat[0].figure
        figure.canvas.draw()
        box = figure.get_tightbbox()
        assert (box.min >= 0).all()
        assert (box.max <= figure.get_size_inches()).all()
        (legend,) = figure.findobj(Legend)
        assert not any(legend.get_window_extent().overlaps(ax.xaxis.label.get_window_extent()) for ax in panels.flat)


def test_surfaces_are_rasterised_and_lines_are_vectors(tmp_path):
    (ax,) = jk.plot.folds(cusp())
    ax.figure.savefig(tmp_path / "fold.svg")
    text = (tmp_path / "fold.svg").read_text()
    assert text.count("data:image/png") == 1
    assert text.count("<path") < 1000


def test_given_axes_are_used():
    figure = plt.figure()
    axes = [figure.add_subplot(1, 2, 1, projection="3d"), figure.add_subplot(1, 2, 2)]
    panels = jk.plot.folds([cusp()], robot=ROBOT, axes=axes)
    assert list(panels.flat) == axes
    assert axes[0].get_legend() is not None
    assert list(jk.plot.folds(cusp(), axes=axes[:1])) == axes[:1]


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(jk.InputError, match="no fold to draw"):
        jk.plot.folds([])
    with pytest.raises(jk.InputError, match="outline"):
        jk.plot.folds(cusp(), robot=object())  # type: ignore[arg-type]
    figure = plt.figure()
    solid, flat = figure.add_subplot(1, 2, 1, projection="3d"), figure.add_subplot(1, 2, 2)
    with pytest.raises(jk.InputError, match=r"2 folds need 2 .*three dimensions, but axes has 1"):
        jk.plot.folds([cusp(), cusp()], axes=[solid])
    with pytest.raises(jk.InputError, match=r"1 folds need 1 .* and 1 flat"):
        jk.plot.folds(cusp(), robot=ROBOT, axes=[solid])
    with pytest.raises(jk.InputError, match="number 1 are flat"):
        jk.plot.folds(cusp(), robot=ROBOT, axes=[flat, solid])
    assert not solid.lines


def test_other_figures_can_be_drawn_after_it():
    jk.plot.folds(cusp())
    # The functions have the names of their files, which an import puts in their place.
    assert callable(jk.plot.folds)
    assert callable(jk.plot.surfaces)
