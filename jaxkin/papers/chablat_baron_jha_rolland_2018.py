"""Chablat, Baron, Jha and Rolland 2018: every equation, counterparts of its figures, and its numbers, compared.

Each part of the paper is a function that returns its figures, its tables and what was checked; ``reproduce`` runs
them all. The paper's own formulas are written out in ``_cbjr2018_print``; what is wrong in them is in
``_cbjr2018_errata``. What the paper does not have is marked "[ours]".

References:
    Chablat, D., Baron, L., Jha, R. and Rolland, L., "The 3-PPPS parallel robot with U-shape base, a 6-DOF parallel
    robot with simple kinematics", Advances in Robot Kinematics, 2018, hal-01782286.
"""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from jaxkin.core.provenance import run_log
from jaxkin.papers._cbjr2018_costs import costs
from jaxkin.papers._cbjr2018_equations import SEED, equations
from jaxkin.papers._cbjr2018_errata import ERRATA
from jaxkin.papers._cbjr2018_figures import figure_1, figure_2, figure_3
from jaxkin.papers._cbjr2018_orientation import orientation
from jaxkin.papers._cbjr2018_route import direct_kinematics
from jaxkin.papers.catalogue import PAPERS
from jaxkin.papers.report import Part, Report, run_parts

if TYPE_CHECKING:
    from jaxkin.mechanisms.ppps3 import PPPS3

__all__ = [
    "costs",
    "direct_kinematics",
    "equations",
    "figure_1",
    "figure_2",
    "figure_3",
    "orientation",
    "reproduce",
]

UNCHECKED = (
    "The figures of the print, which were not at hand: figures here are drawn after their captions and the text.",
    "The cylindrical algebraic decomposition and its two cells. Here the aspect has one cell, sigma being eliminated "
    "last; another order has others.",
    "Costs of the code that Maple generated: the formulas are counted here as they are printed.",
    "The statement that the limits of the aspect come from the passive prismatic joints. Its limits here are the "
    "singularities; limits of joints are not printed, and passive joints are in no singular condition.",
    "The statements on other robots (MEPaM, Tripteron, Stanford Arm), which the paper takes from its references.",
)


def reproduce(robot: "PPPS3 | None" = None, tell: Callable[[str], object] | None = None) -> Report:
    """Makes counterparts of all figures of the paper, and checks its equations and numbers.

    Args:
        robot: Another size of the robot; the counterpart of Fig. 1 is drawn for it as well.
        tell: Called with a line as each part is done.

    Raises:
        PrecisionError: float64 is not enabled.

    Cost: under a minute, a third of it where compiled kernels are cached.
    """
    start = time.perf_counter()
    steps: list[Callable[[], Part]] = [equations, direct_kinematics, costs, figure_1, figure_2, figure_3, orientation]
    if robot is not None:
        steps.append(lambda: figure_1(robot))
    parts = run_parts(steps, tell)
    paper = PAPERS["chablat-baron-jha-rolland-2018"]
    geometry = {"paper": {"side": 1.0, "base_radius": 2.0}}
    if robot is not None:
        geometry["also"] = {name: float(getattr(robot, name)) for name in ("side", "base_radius")}
    return Report(
        title=paper.title,
        source=paper.source,
        parts=parts,
        errata=ERRATA,
        unchecked=UNCHECKED,
        settings={"geometry": geometry, "seed of random points": SEED},
        run_log=run_log(seconds=round(time.perf_counter() - start, 1)),
    )
