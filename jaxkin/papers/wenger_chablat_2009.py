"""Wenger and Chablat 2009, whole: every equation, figure and number of the paper, made anew and compared.

Each part of the paper is a function that returns its figures, its tables and what was checked; ``reproduce`` runs
them all. The paper's own formulas are written out in ``_wc2009_print``, with the list of what is wrong in them.

References:
    Wenger, P. and Chablat, D., "Kinematic analysis of a class of analytic planar 3-RPR parallel manipulators",
    Computational Kinematics, 2009, hal-00412923.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from jaxkin.core.provenance import run_log
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._reference_sections import compute_sections, reference_geometry
from jaxkin.papers._samples import SEED
from jaxkin.papers._wc2009_aspects import aspects_and_changes
from jaxkin.papers._wc2009_equation_8 import cusp_equation
from jaxkin.papers._wc2009_equations import equations
from jaxkin.papers._wc2009_figures import figure_2, figure_3, figure_3_of, fold_over_cusp
from jaxkin.papers._wc2009_tables import cusp_tables
from jaxkin.papers.catalogue import PAPERS
from jaxkin.papers.report import Part, Report, run_parts

if TYPE_CHECKING:
    from jaxkin.mechanisms.rpr3 import AnalyticRPR3

__all__ = [
    "aspects_and_changes",
    "compute_sections",
    "cusp_equation",
    "cusp_tables",
    "equations",
    "figure_2",
    "figure_3",
    "figure_3_of",
    "fold_over_cusp",
    "reference_geometry",
    "reproduce",
]

UNCHECKED = (
    "Fig. 1, a drawing of the mechanism without numbers.",
    "The statements on the four analytic classes found before, which the paper takes from its references.",
)


def reproduce(robot: "AnalyticRPR3 | None" = None, tell: Callable[[str], object] | None = None) -> Report:
    """Makes all figures and tables of the paper, and checks what it prints.

    The reference geometry's sections are computed in a second thread, as most of the time is compilation.

    Args:
        robot: Another member of the family; the counterpart of Fig. 3 is drawn for it as well.
        tell: Called with a line as each part is done.

    Raises:
        PrecisionError: float64 is not enabled.

    Cost: under a minute on two cores, a quarter of it where compiled kernels are cached.
    """
    start = time.perf_counter()
    steps: list[Callable[[], Part]] = [
        equations,
        figure_2,
        figure_3,
        fold_over_cusp,
        cusp_tables,
        aspects_and_changes,
    ]
    if robot is not None:
        steps.append(lambda: figure_3_of(robot))
    with ThreadPoolExecutor(1) as second:
        sections = second.submit(compute_sections)
        steps.append(lambda: reference_geometry(sections.result()))
        parts = run_parts(steps, tell)
    paper = PAPERS["wenger-chablat-2009"]
    geometry = {"example": dict(zip(("c2", "c3", "d3"), printed.EXAMPLE, strict=True))}
    if robot is not None:
        geometry["also"] = {name: float(getattr(robot, name)) for name in ("c2", "c3", "d3")}
    return Report(
        title=paper.title,
        source=paper.source,
        parts=parts,
        errata=printed.ERRATA,
        unchecked=UNCHECKED,
        settings={"geometry": geometry, "seed of random points": SEED},
        run_log=run_log(seconds=round(time.perf_counter() - start, 1)),
    )
