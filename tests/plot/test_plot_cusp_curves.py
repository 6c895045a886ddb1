import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.patches import StepPatch

import jaxkin as jk

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
BOX = jk.Grid(rho1=(0.1, 4.0, 6), rho2=(0.2, 4.0, 6), rho3=(0.1, 4.0, 6))


@pytest.fixture(scope="module")
def found() -> jk.CuspCurves:
    return jk.cusp_curves(ROBOT, BOX)


def test_the_step_function_is_the_number_of_cusps_of_each_section(found):
    panels = jk.plot.cusp_curves(found, axis="rho2")
    assert [ax.name for ax in panels] == ["3d", "rectilinear", "rectilinear", "rectilinear"]
    (steps,) = (patch for patch in panels[3].patches if isinstance(patch, StepPatch))
    levels, edges, _ = steps.get_data()
    assert (edges[0], edges[-1]) == (0.2, 4.0)
    assert len(levels) > 1
    for value in (0.7, 2.6, 3.5):
        section = jk.Grid(rho1=(0.1, 4.0, 12), rho2=value, rho3=(0.1, 4.0, 12))
        assert levels[np.searchsorted(edges, value) - 1] == len(jk.cusps(ROBOT, section))


def test_transitions_are_marked_by_kind_with_their_values(found):
    panels = jk.plot.cusp_curves(found, axis="rho2")
    transitions = found.transitions("rho2")
    texts = [text.get_text() for text in panels[3].get_legend().get_texts()]
    assert texts == [f"end of a curve ({len(transitions.values)})"]
    shown = [text.get_text() for text in panels[3].texts]
    assert shown == [f"{value:.3f}" for value in transitions.values]
    # Both projections have the joint across, and show the transitions on their curves.
    for ax, other in zip(panels[1:3], (0, 2), strict=True):
        (marks,) = (line for line in ax.lines if line.get_linestyle() == "None")
        np.testing.assert_allclose(marks.get_xydata(), transitions.joints[:, [1, other]])


def test_curves_are_drawn_in_space_and_named(found):
    (ax,) = jk.plot.cusp_curves(found)
    lines = [np.array(line.get_data_3d()).T for line in ax.lines]
    assert len(lines) == len(found)
    for line, curve in zip(lines, found, strict=True):
        np.testing.assert_array_equal(line[: len(curve.joints)], curve.joints)
        assert len(line) == len(curve.joints) + curve.closed
    assert [text.get_text() for text in ax.get_legend().get_texts()] == [curve.name for curve in found]
    assert (ax.get_xlabel(), ax.get_zlabel()) == (r"$\rho_{1}$ (length)", r"$\rho_{3}$ (length)")


def test_values_that_are_close_have_their_texts_apart():
    from jaxkin.plot.cusp_curves import _apart

    values = np.array([1.0, 1.001, 1.002, 5.0, 9.99, 10.0])
    places = _apart(values, (0.0, 10.0))
    assert np.all(np.diff(places) > 0.4)
    assert places[3] == 5.0


def test_what_can_not_be_drawn_is_refused(found):
    with pytest.raises(jk.InputError, match="rho1, rho2, rho3"):
        jk.plot.cusp_curves(found, axis="x")
    _, flat = plt.subplots()
    with pytest.raises(jk.InputError, match="projection"):
        jk.plot.cusp_curves(found, axes=[flat])
    _, given = plt.subplots(subplot_kw={"projection": "3d"})
    assert jk.plot.cusp_curves(found, axes=[given])[0] is given
