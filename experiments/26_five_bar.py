"""A five-bar whose worst conditioning over a prescribed rectangle is the best there is.

The rectangle, 2 wide and 1 high, lies 2 above the line of the motors, which need to be 1 apart. Base, cranks, rods and
the rectangle's place along the base line vary; both legs are alike. Known answers: by symmetry the rectangle lies over
the middle of the base, and a grid over cranks and rods has no better design. That the motors come as close as they may
is the known advantage of coaxial five-bars.
"""

import matplotlib.pyplot as plt
import numpy as np
import xarray
from _common import save, start
from matplotlib.axes import Axes

import jaxkin as jk
from jaxkin.design import atlas
from jaxkin.plot.designs import draw_place

#: Signs of both legs.
MODE = (-1, 1)
#: The plane in the pictures.
XS, YS = (-3.0, 4.0), (-0.7, 4.3)
#: Cranks and rods of the map around the optimum: shares of theirs, and samples along each.
AROUND = (0.7, 1.4, 71)


def conditioning_map(robot: jk.Mechanism) -> xarray.DataArray:
    """Returns the inverse condition number over the plane in the working mode, NaN out of reach."""
    x, y = np.linspace(*XS, 176), np.linspace(*YS, 126)
    plane = jk.design.box(robot, {"x": len(x), "y": len(y)}, x=(x[0], x[-1]), y=(y[0], y[-1]))
    measure = jk.design.inverse_condition_number(robot, plane, mode=MODE)
    assert measure.reach is not None
    # The measure is negative beyond a singularity.
    values = np.abs(np.asarray(measure.parts(robot, None)))
    values[~(np.asarray(measure.reach(robot, None)) > 0)] = np.nan
    named = {name: (name, samples, {"units": "length"}) for name, samples in (("x", x), ("y", y))}
    return xarray.DataArray(
        values.reshape(len(x), len(y)), named, ("x", "y"), "conditioning", {"long_name": "inverse condition number"}
    )


def draw_map(robot: jk.Mechanism, design: jk.design.Design, center: object, ax: Axes) -> None:
    jk.plot.section(conditioning_map(robot), ax=ax)
    ax.images[-1].set_clim(0.0, 1.0)
    ax.plot([0.0, float(robot.geometry()["base"])], [0.0, 0.0], "s", color="black", markersize=5)
    place = design.problem.objective.place
    assert place is not None
    draw_place(place, ax, center)  # type: ignore[arg-type]
    ax.patches[-1].set(facecolor="none", edgecolor="white", alpha=1.0, linewidth=2.0, zorder=3)


def verify(design: jk.design.Design) -> xarray.Dataset:
    """Sweeps over cranks and rods, all else as in the design, and compares."""
    measure = design.problem.objective
    low, high, n = AROUND
    grid = {name: (low * design.values[name], high * design.values[name], n) for name in ("proximal", "distal")}
    field = atlas.smoothed_objective(measure, design.center)
    result = jk.sweep(design.robot, field, jk.Grid(**grid))
    values = np.asarray(result[field.name])
    place = np.unravel_index(np.nanargmax(values), values.shape)
    best, optimum = float(values[place]), design.objective.value
    where = ", ".join(f"{name} = {float(result[name][k]):.4g}" for name, k in zip(grid, place, strict=True))
    print(f"grid: best {best:.10g} at {where}")

    print(f"optimum {optimum:.10g}, better than the grid by {optimum - best:.2e}")
    assert 0 <= optimum - best + 1e-9 < 5e-3
    return result


def main() -> None:
    folder = start("26", __doc__)
    robot = jk.mechanisms.five_bar.create(2.0, (2.0, 2.0), (3.0, 3.0))
    place = jk.design.box(robot, x=(0.4, 2.4), y=(2.0, 3.0))
    measure = jk.design.inverse_condition_number(robot, place, mode=MODE)
    vary = {"base": (1.0, 3.0), "proximal": (1.0, 4.0), "distal": (1.5, 5.0), "center.x": (-0.5, 2.5)}
    problem = jk.design.Problem(robot, vary, maximise=measure, name="five-bar over a rectangle")
    design = jk.design.optimise(problem, starts=8, steps=60, refine=1, neighbours=100)
    print(design, design.counts["seconds"])
    print(f"before: {measure.measured(robot)}")
    off = design.values["center.x"] - design.values["base"] / 2
    print(f"the rectangle is off the middle of the base by {off:.1e}, known 0")
    result = verify(design)

    figure, panels = plt.subplots(2, 2, figsize=(9.6, 6.3), layout="constrained")
    jk.plot.design_comparison(design, axes=panels[0])
    for panel in panels[0]:
        panel.set(xlim=XS, ylim=YS)
    draw_map(robot, design, place.center, panels[1, 0])
    draw_map(design.robot, design, design.center, panels[1, 1])
    panels[1, 0].set_title(f"worst in the rectangle: {measure.measured(robot).value:.3f}", fontsize="medium")
    panels[1, 1].set_title(f"worst in the rectangle: {design.objective.value:.3f}", fontsize="medium")
    save(figure, folder, "five_bar_design")

    figure, (left, right) = plt.subplots(1, 2, figsize=(12.0, 4.6), layout="constrained")
    # Below zero designs meet a singularity in the rectangle, or do not reach it.
    jk.plot.design_map(result.where(result > 0), design, ax=left)
    jk.plot.design_history(design, right)
    save(figure, folder, "five_bar_optimum")


if __name__ == "__main__":
    main()
