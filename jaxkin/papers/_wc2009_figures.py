"""Figures 2 and 3 of Wenger and Chablat 2009, and the fold over one of the cusps."""

import math

import numpy as np

import jaxkin as jk
from jaxkin.mechanisms import rpr3
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._compiled import forms_at
from jaxkin.papers._wc2009_sections import SAMPLES, reach, ring_check, section_part
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Picture


def figure_2() -> Part:
    """Draws the singular surfaces in the workspace of the example, and checks them."""
    robot = rpr3.analytic(*printed.EXAMPLE)
    box = jk.Grid(x=(-3.0, 3.0, 60), y=(-3.0, 3.0, 60), phi=(-math.pi, math.pi, 72))
    surfaces = jk.singular_surfaces(robot, box)
    worst = max(surfaces.residual, *(crossing.residual for crossing in surfaces.crossings))
    what = "largest dimensionless residual of all vertices and of the crossing curve"
    checks = [Check("figure_2-residual", "Fig. 2", what, "0", f"{worst:.1e}", worst, 1e-12)]
    for surface in surfaces:
        what = f"pieces of {surface.name} = 0 once phi = -pi and phi = pi are glued"
        checks.append(count_check(f"figure_2-pieces-{surface.name}", "Fig. 2", what, 1, surface.components))
        lost = f"vertices of {surface.name} = 0 that did not converge"
        checks.append(count_check(f"figure_2-lost-{surface.name}", "Fig. 2", lost, 0, surface.unpolished))
    checks += _ruling(surfaces)
    ax = jk.plot.surfaces(surfaces)
    caption = "Fig. 2: singular surfaces of the example in the workspace, f1 in red as in the paper"
    return Part("Fig. 2", tuple(checks), {"figure_2": Picture.of(ax, caption)})


def _ruling(surfaces: jk.SingularSurfaces) -> list[Check]:
    """Both factors are linear in x and y: at every angle a line; that of f2 is perpendicular to that of f1."""
    bent, skew = 0.0, 0.0
    lines: dict[str, dict[float, np.ndarray]] = {}
    for surface in surfaces:
        angles, place = np.unique(surface.vertices[:, 2], return_inverse=True)
        lines[surface.name] = {}
        for k in np.flatnonzero(np.bincount(place) >= 10):
            points = surface.vertices[place == k, :2]
            _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
            bent = max(bent, float(np.max(np.abs((points - points.mean(axis=0)) @ axes[1]))))
            lines[surface.name][float(angles[k])] = axes[0]
    shared = lines["f1"].keys() & lines["f2"].keys()
    for angle in shared:
        skew = max(skew, float(abs(lines["f1"][angle] @ lines["f2"][angle])))
    what = "vertices of one angle lie on a straight line: largest distance"
    checks = [Check("figure_2-ruled", "Fig. 2", what, "linear in x, y", f"{bent:.1e}", bent, 1e-12)]
    what = f"lines of f1 and f2 are perpendicular, at {len(shared)} angles: largest cosine"
    skew = skew if shared else math.inf
    checks.append(Check("figure_2-perpendicular", "Fig. 2", what, "not said", f"{skew:.1e}", skew, 1e-12))
    return checks


def figure_3() -> Part:
    """Draws the section rho2 = 1 of the example with its singular curves and cusps, and checks it."""
    caption = (
        "Fig. 3: section rho2 = 1 of the example, number of assembly modes, singular curves and cusps; the virtual "
        "part of S, whose poses are complex, is thin"
    )
    return section_part(rpr3.analytic(*printed.EXAMPLE), 1.0, (4.0, 4.0), "figure_3", "Fig. 3", caption)


def figure_3_of(robot: rpr3.AnalyticRPR3) -> Part:
    """Draws what Fig. 3 is for the example for another member of the family, and checks it."""
    geometry = tuple(float(value) for value in (robot.c2, robot.c3, robot.d3))
    texts = [f"{name}_{value:g}" for name, value in zip(("c2", "c3", "d3"), geometry, strict=True)]
    words = ", ".join(text.replace("_", " = ") for text in texts)
    name, where = "_".join(["figure_3", *texts]), f"Fig. 3 for {words}"
    return section_part(robot, 1.0, reach(geometry, 1.0), name, where, f"{where}: section rho2 = 1")  # type: ignore[arg-type]


def fold_over_cusp() -> Part:
    """Draws the two triple poses over the cusp (sqrt 3, 1) and the fold around each, and checks them."""
    robot = rpr3.analytic(*printed.EXAMPLE)
    grid = jk.Grid(rho1=(0.0, 4.0, SAMPLES), rho2=1.0, rho3=(0.0, 4.0, SAMPLES))
    cusps = jk.cusps(robot, grid)
    over = int(np.argmax(cusps.joints[:, 0]))
    folds = [jk.fold(robot, grid, pose) for pose in cusps.poses[over]]
    checks = [
        count_check("fold-poses", "Fig. 3, cusp (sqrt 3, 1)", "triple poses over the cusp", 2, len(folds)),
        ring_check(robot, cusps, "fold", "Fig. 3, cusps"),
    ]
    along = np.concatenate([fold.fold_joints for fold in folds])
    spread = np.random.default_rng(0).uniform(0, along.max(axis=0), (500, 3))
    here, anywhere = (np.abs(forms_at(robot, points)["S"]) for points in (along, spread))
    off = float(np.max(here) / np.median(anywhere))
    what = "the fold lies on S: its value there over its median nearby"
    checks.append(Check("fold-S", "Fig. 3, cusp (sqrt 3, 1)", what, "0", f"{off:.1e}", off, 1e-9))
    flat = sum(not (fold.determinant.min() < 0 < fold.determinant.max()) for fold in folds)
    what = "patches on which the determinant keeps its sign"
    checks.append(count_check("fold-sheets", "Fig. 3, cusp (sqrt 3, 1)", what, 0, flat))
    axes = jk.plot.folds(folds, robot=robot)
    caption = "The two triple poses over the cusp (sqrt 3, 1), and the surface of poses folded over the section"
    return Part("Fold over a cusp", tuple(checks), {"fold": Picture.of(axes, caption)})
