import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.plot import style

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
COUNTS = jk.Grid(rho1=(0.01, 4.0, 80), rho2=1.0, rho3=(0.01, 4.0, 90))


def test_count_map_has_a_colour_a_label_and_a_legend_entry_for_every_number():
    data = jk.sweep(ROBOT, "forward_count", COUNTS)
    ax = jk.plot.section(data)
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"0", "2", "4", "6"}
    assert {"0", "2", "6"} <= {text.get_text() for text in ax.texts}
    assert ax.get_aspect() == 1.0
    assert ax.get_xlabel() == r"$\rho_{1}$ (length)"
    assert ax.get_title() == r"$\rho_{2}$ = 1"
    assert ax.get_xlim() == (0.01, 4.0)
    # Every label stands on a sample of its own number.
    for text in ax.texts:
        x, y = text.get_position()
        assert int(data.forward_count.sel(rho1=x, rho3=y, method="nearest")) == int(text.get_text())


def test_zero_is_white_and_colours_are_distinct():
    assert style.count_colour(0) == "#FFFFFF"
    assert len(set(style.COUNT_COLOURS.values())) == len(style.COUNT_COLOURS)
    assert style.count_colour(3) == style.OTHER_COUNT


def test_signed_fields_diverge_about_zero():
    data = jk.sweep(ROBOT, "direct_determinant", jk.Grid(x=(-2.0, 2.0, 30), y=(-2.0, 2.0, 30), phi=0.5))
    ax = jk.plot.section(data)
    low, high = ax.images[0].get_clim()
    assert low == -high
    assert ax.collections  # the zero line


def test_angles_have_ticks_in_pi():
    grid = jk.Grid(x=(-2.0, 2.0, 30), y=0.3, phi=(-np.pi, np.pi, 32))
    ax = jk.plot.section(jk.sweep(ROBOT, "smallest_singular_value", grid))
    ax.figure.canvas.draw()
    assert {"−π", "−π/2", "0", "π/2", "π"} <= {tick.get_text() for tick in ax.get_yticklabels()}
    assert style._in_pi(1.5 * np.pi) == "3π/2"
    assert style._in_pi(-2 * np.pi) == "−2π"


@pytest.mark.parametrize(
    ("low", "high"), [(-1.57, 1.57), (-1.0, 1.0), (0.1, 0.3), (0.0, 3.2), (-20.0, 20.0), (2.0, 1.0)]
)
def test_angles_have_at_least_three_ticks_with_their_values(low, high):
    _, ax = plt.subplots()
    ax.set_xlim(low, high)
    style.ticks_in_pi(ax.xaxis)
    places = [x for x in ax.get_xticks() if min(low, high) <= x <= max(low, high)]
    assert 3 <= len(places) <= 9
    for x, text in zip(places, ax.xaxis.get_major_formatter().format_ticks(places), strict=True):
        text = text.replace("−", "-")
        if "π" in text:
            count, _, half = text.partition("π")
            value = float(count + "1" if count in ("", "-") else count) * np.pi / (2 if half else 1)
        else:
            value = float(text)
        assert value == pytest.approx(x, abs=1e-9)


def test_one_axis_is_a_line_and_given_axes_are_used():
    _, ax = plt.subplots()
    data = jk.sweep(ROBOT, "forward_count", jk.Grid(rho1=(0.01, 4.0, 80), rho2=1.0, rho3=1.0))
    assert jk.plot.section(data, ax=ax) is ax
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), data.forward_count)


def test_wrong_arguments_are_refused_with_what_is_needed():
    data = jk.sweep(ROBOT, "forward_count", COUNTS)
    for draw in (jk.plot.section, jk.plot.surfaces, jk.plot.solid, jk.plot.workspace):
        with pytest.raises(jk.InputError, match=r"type AnalyticRPR3.*from jk\."):
            draw(ROBOT)
    with pytest.raises(jk.InputError, match=r"type AnalyticRPR3.*jk\.singular_curves"):
        jk.plot.section(data, curves=ROBOT)
    with pytest.raises(jk.InputError, match=r"'nope'.*one of forward_count, forward_count_nearly_double"):
        jk.plot.section(data, variable="nope")
    with pytest.raises(jk.InputError, match="'nope'"):
        jk.plot.section(data.forward_count, variable="nope")
    with pytest.raises(jk.InputError, match="one sample"):
        jk.plot.section(data.isel(rho1=0, rho3=0))
    with pytest.raises(jk.InputError, match=r"not said.*one of forward_count"):
        jk.plot.section(data.assign_attrs(field=None))


def test_three_free_axes_are_refused_with_the_remedy():
    grid = jk.Grid(rho1=(0.1, 4.0, 3), rho2=(0.1, 4.0, 3), rho3=(0.1, 4.0, 3))
    with pytest.raises(jk.InputError, match=r"rho1, rho2, rho3.*\.isel"):
        jk.plot.section(jk.sweep(ROBOT, "forward_count", grid))


def test_mechanism_in_every_mode():
    robot = jk.mechanisms.rpr3.reference()
    panels = jk.plot.mechanism(robot, [14.98, 15.38, 12.0])
    assert len(panels) == 6
    assert [panel.get_title().split("det ")[1] for panel in panels] == [
        "< 0",
        "> 0",
        "> 0",
        "< 0",
        "< 0",
        "> 0",
    ]
    _, ax = plt.subplots()
    assert jk.plot.mechanism(robot, [14.98, 15.38, 12.0], ax=ax) is ax
    assert [text.get_text() for text in ax.texts] == ["1", "2", "3", "4", "5", "6"]


def test_drawn_legs_have_their_lengths():
    robot = jk.mechanisms.rpr3.reference()
    joints = np.array([14.98, 15.38, 12.0])
    for pose in jk.forward(robot, joints).values:
        base, platform = robot.outline(pose)
        np.testing.assert_allclose(np.linalg.norm(platform - base, axis=1), joints, rtol=1e-12)


def test_a_singular_pose_is_drawn_and_no_pose_is_refused():
    panels = jk.plot.mechanism(ROBOT, [3**0.5, 1.0, 1.0])
    assert len(panels) == 2
    with pytest.raises(jk.InputError, match="no real solution"):
        jk.plot.mechanism(ROBOT, [0.25, 1.0, 3.0])
    with pytest.raises(jk.InputError, match="outline"):
        jk.plot.mechanism(object(), [1.0, 1.0, 1.0])
