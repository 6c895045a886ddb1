"""Isotropy of the TLPM at home: which base radius L makes its three limbs orthogonal, at height h = 590 mm.

Known answer: L / h = sqrt 2, where both measures of conditioning are 1. The one of Frobenius norms is smooth there,
the smallest over the largest singular value has a corner: its optimum is known to fewer digits.
"""

import math

import matplotlib.pyplot as plt
import numpy as np
from _common import save, start

import jaxkin as jk
from jaxkin.design import atlas

HEIGHT = 590.0
#: Name of a norm -> whether its measure is smooth at isotropy.
NORMS = {"frobenius": "solid", "spectral": (0, (5, 2))}


def build(base_radius: float) -> jk.mechanisms.tlpm.TLPM:
    """Makes the robot, whose initial lengths follow from its radius and height."""
    return jk.mechanisms.tlpm.create(base_radius, HEIGHT)


def main() -> None:
    folder = start("22", __doc__)
    robot = build(590.0)
    home = jk.design.poses(robot, np.zeros(3))
    measures = {norm: jk.design.inverse_condition_number(robot, home, norm=norm) for norm in NORMS}
    designs = {}
    for norm, measure in measures.items():
        problem = jk.design.Problem(robot, {"base_radius": (300.0, 1500.0)}, maximise=measure, build=build)
        designs[norm] = design = jk.design.optimise(problem, starts=6, steps=80)
        ratio = design.values["base_radius"] / HEIGHT
        print(f"{norm}:\n{design}")
        print(f"L / h = {ratio:.15g}, known sqrt 2 = {math.sqrt(2):.15g}, difference {ratio - math.sqrt(2):.1e}\n")

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.9), layout="constrained")
    grid = jk.Grid(base_radius=(300.0, 1500.0, 801))
    for norm, dashes in NORMS.items():
        # At one pose the strokes' zeros do not matter, so that the initial lengths may stay.
        result = jk.sweep(robot, atlas.smoothed_objective(measures[norm]), grid)
        values = next(iter(result.data_vars.values()))
        name = f"{norm.capitalize()} norm"
        left.plot(result.base_radius / HEIGHT, values, color="black", linestyle=dashes, label=name)
    left.axvline(math.sqrt(2), color="black", linewidth=0.6, linestyle=(0, (1, 2)))
    left.annotate(r"$\sqrt{2}$", (math.sqrt(2), 0.5), xytext=(4, 0), textcoords="offset points")
    best = designs["frobenius"]
    ratio = best.values["base_radius"] / HEIGHT
    left.plot(ratio, best.objective.value, "*", color="#F0E442", markersize=13, markeredgecolor="black")
    left.set(xlabel="$L/h$", ylabel="inverse condition number at home", ylim=(0.3, 1.04))
    left.legend(frameon=False, loc="lower right")
    jk.plot.design_history(best, right)
    save(figure, folder, "tlpm_isotropy")
    assert np.isclose(ratio, math.sqrt(2), rtol=0, atol=1e-8)


if __name__ == "__main__":
    main()
