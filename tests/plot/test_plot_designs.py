import dataclasses

import matplotlib

matplotlib.use("Agg")
import numpy as np
import pytest
import xarray
from matplotlib.patches import Circle, Rectangle

import jaxkin as jk
from jaxkin.plot.designs import draw_place

ROBOT = jk.mechanisms.five_bar.create(1.0, (2.0, 2.0), (3.0, 3.0))
PLACE = jk.design.box(ROBOT, 3, x=(-0.5, 1.5), y=(2.0, 3.0))


@pytest.fixture(scope="module")
def design() -> jk.design.Design:
    measure = jk.design.inverse_condition_number(ROBOT, PLACE, mode=(-1, 1))
    vary = {"proximal": (1.5, 3.5), "distal": (2.5, 4.5)}
    problem = jk.design.Problem(ROBOT, vary, maximise=measure)
    return jk.design.optimise(problem, method="adam", starts=3, steps=20, neighbours=0)


def texts(ax) -> list[str]:
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_the_history_has_every_start_and_the_best_so_far(design):
    ax = jk.plot.design_history(design)
    assert texts(ax) == ["starts", "best so far", "design"]
    lines = [line.get_ydata() for line in ax.lines if len(line.get_ydata()) == 20]
    assert len(lines) == 4
    np.testing.assert_array_equal(lines[-1], np.maximum.accumulate(np.max(lines[:3], axis=0)))
    assert ax.get_title() == "verified"
    assert ax.get_ylabel() == "inverse condition number"
    assert jk.plot.design_history(dataclasses.replace(design, verified=False), ax).get_title() == "not verified"


def test_violated_steps_are_dotted_and_what_falls_to_zero_is_logarithmic(design):
    value = 10.0 ** -np.arange(8.0)[:, None] * np.ones(2)
    violation = np.where(np.arange(8)[:, None] < [3, 0], 1.0, 0.0)
    history = xarray.Dataset(
        {
            "objective": (("step", "start"), value),
            "violation": (("step", "start"), violation),
            "best": (("step",), np.r_[np.inf, value[1:, 0]]),
            "refined_start": (("iterate",), [0, 0]),
            "refined_objective": (("iterate",), [1e-8, 1e-9]),
        }
    )
    problem = dataclasses.replace(design.problem, maximise=None, minimise=design.problem.objective)
    ax = jk.plot.design_history(dataclasses.replace(design, problem=problem, history=history, smooth=1e-9))
    assert ax.get_yscale() == "log"
    assert texts(ax) == ["starts", "starts, violated", "best so far", "refinements", "design"]
    dotted = [line for line in ax.lines if line.get_label() == "starts, violated"]
    # One step on either side belongs to it, so that no line is torn.
    assert np.isfinite(np.asarray(dotted[0].get_ydata(), float)).sum() == 4


def test_before_and_after_stand_in_equal_scales_with_the_place(design):
    before, after = jk.plot.design_comparison(design)
    assert before.get_xlim() == after.get_xlim()
    assert before.get_ylim() == after.get_ylim()
    assert before.get_title().startswith("before\nproximal = 2")
    for ax in (before, after):
        (patch,) = (patch for patch in ax.patches if isinstance(patch, Rectangle))
        assert patch.get_bbox().bounds == (-0.5, 2.0, 2.0, 1.0)
    with pytest.raises(jk.InputError, match=r"jk\.design\.optimise"):
        jk.plot.design_comparison("design")  # type: ignore[arg-type]


def test_places_of_every_kind():
    ax = jk.plot.section(xarray.DataArray(np.eye(3), {"x": [0.0, 1.0, 2.0], "y": [0.0, 1.0, 2.0]}, name="value"))
    draw_place(jk.design.ball(ROBOT, {"x": 0.0, "y": 2.0}, 0.5), ax, [1.0, 1.0])
    (disc,) = (patch for patch in ax.patches if isinstance(patch, Circle))
    assert (disc.center, disc.radius) == ((1.0, 1.0), 0.5)
    draw_place(jk.design.poses(ROBOT, [[0.0, 1.0], [1.0, 2.0]]), ax)
    np.testing.assert_array_equal(ax.lines[-1].get_xydata(), [[0.0, 1.0], [1.0, 2.0]])


def test_the_map_has_starts_paths_and_the_design(design):
    field = jk.design.atlas.smoothed_objective(design.problem.objective)
    result = jk.sweep(ROBOT, field, jk.Grid(proximal=(1.5, 3.5, 5), distal=(2.5, 4.5, 5)))
    ax = jk.plot.design_map(result, design)
    assert texts(ax) == ["starts", "their paths", "design"]
    (star,) = (line for line in ax.lines if line.get_marker() == "*")
    assert star.get_xydata()[0].tolist() == [design.values["proximal"], design.values["distal"]]
    assert ax.get_xlim() == (1.5, 3.5)
    other = result.rename(proximal="base")
    with pytest.raises(jk.InputError, match="axis 'base' is no parameter of the design"):
        jk.plot.design_map(other, design)
