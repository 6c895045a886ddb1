import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_hex

import jaxkin as jk
from jaxkin.kinematics.legs import leg_discriminants, leg_joints, legs_of
from jaxkin.mechanisms import five_bar

ROBOT = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
POSES = jk.Grid(x=(-4.5, 13.5, 32), y=(-12.5, 12.5, 32))


@pytest.fixture(scope="module")
def found() -> jk.Aspects:
    return jk.aspects(ROBOT, POSES)


@pytest.fixture(scope="module")
def solid() -> jk.Aspects:
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    return jk.aspects(robot, jk.Grid(x=(-2.0, 2.0, 16), y=(-2.0, 2.0, 16), phi=(-np.pi, np.pi, 16)))


def colour_at(ax, point) -> str | None:
    """Returns the colour of the cell at a point; None where there is none."""
    for cells in ax.collections:
        if isinstance(cells, PolyCollection):
            for path in cells.get_paths():
                if path.contains_point(point):
                    return to_hex(cells.get_facecolor()[0]).upper()
    return None


def legend_texts(ax) -> list[str]:
    return [text.get_text() for legend in ax.figure.legends for text in legend.get_texts()]


def test_every_working_mode_has_a_panel_with_cold_and_warm_colours_by_sign(found):
    panels = jk.plot.aspects(found)
    legs = legs_of(ROBOT)
    assert legs is not None
    assert [ax.get_title() for ax in panels] == [
        f"working mode ({a}, {b})" for a, b in (("+", "+"), ("+", "−"), ("−", "+"), ("−", "−"))
    ]
    warm = {"#E69F00", "#D55E00", "#CC79A7", "#F0E442"}
    cold = {"#56B4E9", "#009E73", "#0072B2"}
    coloured = 0
    for ax, mode in zip(panels, legs.modes, strict=True):
        for point in np.random.default_rng(5).uniform((-4.0, -12.0), (13.0, 12.0), (25, 2)):
            colour = colour_at(ax, point)
            if colour is None or colour == "#C8C8C8":
                continue
            coloured += 1
            assert np.all(leg_discriminants(ROBOT, legs, point) > 0)
            joints = leg_joints(ROBOT, legs, np.array(mode), point)
            sign = float(jk.conditioning(ROBOT, point, joints).determinant)
            assert colour in (cold if sign > 0 else warm)
    assert coloured > 20


def test_the_legend_names_the_largest_aspects_with_sign_and_area(found):
    texts = legend_texts(jk.plot.aspects(found)[0])
    named = [text for text in texts if text[0].isdigit()]
    assert len(named) == min(found.count, 16)
    for text in named:
        number = int(text.partition(":")[0])
        aspect = found[number]
        assert ("det > 0" if aspect.sign > 0 else "det < 0") in text
        area = float(text.partition("area ")[2].partition(" ")[0].rstrip(","))
        assert area == pytest.approx(aspect.volume, abs=aspect.error + 1e-3 * aspect.volume)
    assert (f"and {found.count - 16} smaller ones" in texts) == (found.count > 16)
    assert "not proved regular" in texts


def test_curves_stand_in_the_panels_of_their_working_modes(found):
    poses = jk.Grid(x=(-4.5, 13.5, 10), y=(-12.5, 12.5, 10))
    curves = jk.singular_curves(ROBOT, poses, kind="both")
    panels = jk.plot.aspects(found, curves=curves)
    assert {"det A = 0", "det B = 0"} <= set(legend_texts(panels[0]))
    legs = legs_of(ROBOT)
    assert legs is not None
    for ax, mode in zip(panels, legs.modes, strict=True):
        solid = [line.get_xydata() for line in ax.lines if line.get_linestyle() == "-"]
        assert solid
        for points in solid:
            inner = points[len(points) // 2]
            joints = leg_joints(ROBOT, legs, np.array(mode), inner)
            assert abs(float(jk.conditioning(ROBOT, inner, joints).determinant)) < 1e-6
        assert len(solid) < sum(curve.label.startswith("det A") for curve in curves)
        assert [line for line in ax.lines if line.get_linestyle() != "-"]


def test_three_axes_are_drawn_in_slices_with_the_same_colours(solid):
    panels = jk.plot.aspects(solid, slices={"phi": [-1.0, 0.4]})
    assert [ax.get_title() for ax in panels] == [r"$\phi$ = −1", r"$\phi$ = 0.4"]
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    seen = set()
    for ax, phi in zip(panels, (-1.0, 0.4), strict=True):
        for point in np.random.default_rng(1).uniform(-2.0, 2.0, (40, 2)):
            colour = colour_at(ax, point)
            number = solid.aspect_of([*point, phi])
            if number >= 0 and colour not in (None, "#C8C8C8"):
                seen.add((number, colour))
                joints = jk.inverse(robot, [*point, phi]).values[0]
                sign = float(jk.conditioning(robot, np.array([*point, phi]), joints).determinant)
                assert np.sign(sign) == solid[number].sign
    # One colour an aspect, one aspect a colour.
    assert len({number for number, _ in seen}) == len({colour for _, colour in seen}) == len(seen) >= 2
    assert len(jk.plot.aspects(solid)) == 6


def test_slices_and_curves_that_do_not_fit_are_refused(found, solid):
    with pytest.raises(jk.InputError, match="leave slices out"):
        jk.plot.aspects(found, slices={"x": [0.0]})
    with pytest.raises(jk.InputError, match="outside the box"):
        jk.plot.aspects(solid, slices={"x": [9.0]})
    with pytest.raises(jk.InputError, match="name one of x, y, phi"):
        jk.plot.aspects(solid, slices={"rho1": [1.0]})
    with pytest.raises(jk.InputError, match=r"jk\.aspects"):
        jk.plot.aspects([])  # type: ignore[arg-type]
    _, ax = plt.subplots()
    with pytest.raises(jk.InputError, match="4 panels"):
        jk.plot.aspects(found, axes=[ax])
