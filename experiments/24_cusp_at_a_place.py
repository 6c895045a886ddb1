"""The analytic 3-RPR with a cusp of its section rho2 = 1 at a wanted place, designed by the equations alone.

The place is that of a cusp of one member of the family, (c3, d3) = (1.2, 1), with c2 = 1. The search starts elsewhere
and knows nothing of closed forms. Known answer: distance zero; by the closed forms every member found has a cusp there.
"""

import matplotlib.pyplot as plt
import numpy as np
from _common import save, start
from matplotlib.axes import Axes

import jaxkin as jk
from jaxkin.design import atlas
from jaxkin.mechanisms import rpr3_closed_forms

WANTED = (1.2, 1.0)
BOUNDS = {"c3": (-0.5, 2.0), "d3": (0.3, 1.8)}
HIGH = 4.0


def member(c3: float, d3: float) -> jk.mechanisms.rpr3.AnalyticRPR3:
    return jk.mechanisms.rpr3.analytic(c2=1.0, c3=c3, d3=d3)


def closed_cusps(robot: jk.mechanisms.rpr3.AnalyticRPR3) -> np.ndarray:
    """Returns (rho1, rho3) of the section's cusps by the closed forms."""
    joints = np.asarray(rpr3_closed_forms.section_cusps(robot, 1, 1.0).joints)
    return joints[np.isfinite(joints[:, 0])][:, [0, 2]]


def away(robot: jk.mechanisms.rpr3.AnalyticRPR3, place: np.ndarray) -> float:
    """Returns how far the nearest cusp of the closed forms is from a place."""
    return float(np.min(np.linalg.norm(closed_cusps(robot) - place, axis=1)))


def found_members(problem: jk.design.Problem, design: jk.design.Design) -> list[tuple[float, float]]:
    """Returns the design, and every other member at which a refinement ended with its cusp at the place."""
    history, ends = design.history, [(design.values["c3"], design.values["d3"])]
    starts = np.asarray(history.refined_start)
    for k in np.unique(starts):
        last = int(np.flatnonzero(starts == k)[-1])
        end = (float(history.refined_c3[last]), float(history.refined_d3[last]))
        if float(history.refined_objective[last]) < 1e-10:
            ends.append(end)
    distinct: list[tuple[float, float]] = []
    for end in ends:
        if all(np.hypot(end[0] - other[0], end[1] - other[1]) > 1e-4 for other in distinct):
            distinct.append(end)
    return distinct


def draw_section(robot: jk.mechanisms.rpr3.AnalyticRPR3, place: np.ndarray, ax: Axes, word: str) -> None:
    grid = jk.Grid(rho1=(0.0, HIGH, 401), rho2=1.0, rho3=(0.0, HIGH, 401))
    counts = jk.sweep(robot, "forward_count", grid)
    curves = jk.singular_curves(robot, grid)
    jk.plot.section(counts, ax=ax, curves=curves, cusps=jk.cusps(robot, grid))
    ax.plot(*place, "x", color="#0072B2", markersize=13, markeredgewidth=2.4, zorder=9)
    look = {"textcoords": "offset points", "xytext": (9, -14), "color": "#0072B2", "zorder": 9}
    ax.annotate("wanted", (float(place[0]), float(place[1])), **look)
    ax.set_title(f"{word}: $c_3$ = {float(robot.c3):.4g}, $d_3$ = {float(robot.d3):.4g}", fontsize="medium")


def main() -> None:
    folder = start("24", __doc__)
    place = closed_cusps(member(*WANTED))[0]
    begin = member(0.2, 0.6)
    section = jk.Grid(rho1=(0.0, HIGH, 60), rho2=1.0, rho3=(0.0, HIGH, 60))
    distance = jk.design.cusp_distance(begin, section, {"rho1": place[0], "rho3": place[1]})
    problem = jk.design.Problem(begin, BOUNDS, minimise=distance, name="a cusp at a place")
    design = jk.design.optimise(problem, starts=8, steps=60, refine=2, neighbours=20)
    print(design, design.counts["seconds"])
    print(f"wanted: a cusp at (rho1, rho3) = ({place[0]:.15g}, {place[1]:.15g})")
    print(f"distance {design.objective.value:.1e}, known 0; at the start {away(begin, place):.4g}")
    members = found_members(problem, design)
    for c3, d3 in members:
        print(f"member c3 = {c3:.12g}, d3 = {d3:.12g}: cusp of the closed forms {away(member(c3, d3), place):.1e} away")
    difference = np.array(members[0]) - WANTED
    print(f"difference to the member that the place was taken from: ({difference[0]:.1e}, {difference[1]:.1e})")
    assert away(member(*members[0]), place) < 1e-8

    figure, panels = plt.subplots(1, 2, figsize=(12.5, 4.4), layout="constrained")
    draw_section(begin, place, panels[0], "before")
    draw_section(member(design.values["c3"], design.values["d3"]), place, panels[1], "after")
    save(figure, folder, "cusp_before_after")

    figure, (left, right) = plt.subplots(1, 2, figsize=(12.0, 4.4), layout="constrained")
    sizes = {name: (*ends, n) for (name, ends), n in zip(BOUNDS.items(), (51, 31), strict=True)}
    result = jk.sweep(begin, atlas.smoothed_objective(distance), jk.Grid(c2=1.0, **sizes))
    # Members without a cusp in the section have its diagonal for a distance.
    jk.plot.design_map(result.where(result < 1.4 * HIGH), design, ax=left)
    for c3, d3 in members[1:]:
        left.plot(c3, d3, "*", color="#D55E00", markeredgecolor="black", markersize=13, zorder=6)
    jk.plot.design_history(design, right)
    save(figure, folder, "cusp_design")


if __name__ == "__main__":
    main()
