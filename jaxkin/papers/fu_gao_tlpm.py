"""Fu and Gao on the TLPM: every equation, Table 1, counterparts of its figures, and its conditions, compared.

Each part of the paper is a function that returns its figures, its tables and what was checked; ``reproduce`` runs
them all. The paper's own formulas are written out in ``_fg_print``; what is wrong in them is in ``_fg_errata``. What
the paper does not have, such as L, strokes, sizes of links and all that depends on the platform's orientation, is
marked "[ours]".

References:
    Fu, J. and Gao, F., "Kinematic performances of a novel TLPM parallel robot", School of Mechanical Engineering,
    Shanghai Jiao Tong University. The text at hand names neither place nor year; its latest references are of 2015.
"""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

from jaxkin.core.provenance import run_log
from jaxkin.papers._fg_equations import HEIGHT, RADIUS, SEED, equations
from jaxkin.papers._fg_errata import ERRATA
from jaxkin.papers._fg_figures import figure_2, figure_3, figure_4, figures_5_to_7
from jaxkin.papers._fg_wrist import wrist
from jaxkin.papers.catalogue import PAPERS
from jaxkin.papers.report import Part, Report, run_parts

if TYPE_CHECKING:
    from jaxkin.mechanisms.tlpm import TLPM

__all__ = ["equations", "figure_2", "figure_3", "figure_4", "figures_5_to_7", "reproduce", "wrist"]

UNCHECKED = (
    "The figures of the print, which were not at hand: figures here are drawn after their captions and the text. Fig. "
    "1, a diagram of the robot, has its counterpart in the drawings after Fig. 2.",
    "L, the limits of the strokes and the sizes of the links: none is printed. L = h = 590 mm, +-200 mm and the links "
    "here are ours, so the shape of the workspace after Fig. 3 can be compared, and its size cannot.",
    "The rotations of the platform by all six inputs, of which the paper gives no equations; the wrist here is a "
    "reading that closes, with alpha1 = alpha2 = 90 degrees, and zero and sense of theta_i2 ours.",
    "The conclusion that the robot moves without interference in its workspace: it depends on sizes and on limits of "
    "strokes that are not printed. For those of ours it holds while the platform is not turned.",
    "Singularities of the orientation: the paper's Jacobian is that of the position alone.",
)


def reproduce(robot: "TLPM | None" = None, tell: Callable[[str], object] | None = None) -> Report:
    """Makes counterparts of all figures of the paper, and checks its equations, table and conditions.

    Args:
        robot: Another robot; the counterparts of Figs. 2 and 3 are drawn for it as well.
        tell: Called with a line as each part is done.

    Raises:
        PrecisionError: float64 is not enabled.

    Cost: under a minute, a third of it where compiled kernels are cached.
    """
    start = time.perf_counter()
    steps: list[Callable[[], Part]] = [equations, wrist, figure_2, figure_3, figure_4, figures_5_to_7]
    if robot is not None:
        steps += [lambda: figure_2(robot), lambda: figure_3(robot)]
    parts = run_parts(steps, tell)
    paper = PAPERS["fu-gao-tlpm"]
    geometry = {"paper, with L ours": {"base_radius": RADIUS, "height": HEIGHT}}
    if robot is not None:
        geometry["also"] = {
            name: float(getattr(robot, name)) for name in ("base_radius", "height", "a", "b", "r1", "r2")
        }
    return Report(
        title=paper.title,
        source=paper.source,
        parts=parts,
        errata=ERRATA,
        unchecked=UNCHECKED,
        settings={"geometry": geometry, "seed of random points": SEED},
        run_log=run_log(seconds=round(time.perf_counter() - start, 1)),
    )
