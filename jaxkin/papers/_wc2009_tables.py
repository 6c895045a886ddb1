"""Tables of cusps: the edges of the example, the cusps of its section, and sections with 0 to 3 cusps."""

import numpy as np

import jaxkin as jk
from jaxkin.mechanisms import rpr3
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._compiled import cusp_edges, section_cusps
from jaxkin.papers._wc2009_sections import closed_form_cusps, printed_cusps, reach
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Cell, Table

_SIX = 3 * np.sqrt(3.0)
#: The cusp edges of the example, exactly: phi in degrees, rho1^2 - rho2^2, rho1^2 - rho3^2.
_EDGES = ((-90.0, 2.0, 2.0), (30.0, (_SIX - 5) / 2, -(_SIX + 5) / 2), (150.0, -(_SIX + 5) / 2, (_SIX - 5) / 2))
#: Members (c2, c3, d3), and a length rho2, whose sections have 0, 1, 2 and 3 cusps.
_FAMILIES = (((1.0, 2.0, -1.25), 1.0), ((1.5, -0.7, 0.4), 1.0), (printed.EXAMPLE, 1.0), (printed.EXAMPLE, 2.5))


def cusp_tables() -> Part:
    """Tabulates the cusp edges and cusps of the example, and sections with 0, 1, 2 and 3 cusps."""
    robot = rpr3.analytic(*printed.EXAMPLE)
    cusps = jk.cusps(robot, jk.Grid(rho1=(0.0, 4.0, 400), rho2=1.0, rho3=(0.0, 4.0, 400)))
    edge_checks, edges = _edges(robot)
    family_checks, families = _families()
    return Part(
        "Cusps",
        (*edge_checks, *printed_cusps(cusps), *_poses(robot, cusps), *family_checks),
        tables={"cusps": _cusp_table(cusps), "cusp_edges": edges, "families": families},
    )


def _edges(robot: rpr3.AnalyticRPR3) -> tuple[list[Check], Table]:
    phi, a, b, h = cusp_edges(robot)
    found = np.stack([np.degrees(phi), a, b], axis=1)
    off = float(np.max(np.abs(found - np.array(_EDGES))))
    what = "cusp edges of the example: angles 120 deg apart, A and B against exact numbers"
    check = Check("edges", "section on cusps", what, "not given", "-90, 30, 150 deg", off, 1e-12)
    # An edge begins where rho2 = 0 or where its pose becomes real, whichever is later.
    shortest = np.sqrt(np.maximum(0.0, h * h - a))
    columns = (np.degrees(phi), np.tan(phi / 2), a, b, np.abs(h), shortest)
    header = ("phi (deg)", "t", "A = rho1^2 - rho2^2", "B = rho1^2 - rho3^2", "rho1 greater than", "rho2 greater than")
    rows = [[float(cell) for cell in row] for row in zip(*columns, strict=True)]
    return [check], Table("Cusp edges of the example, in the whole joint space", header, rows)


def _cusp_table(cusps: jk.Cusps) -> Table:
    header = ("cusp", *cusps.joint_names, *cusps.pose_names, "error", "residual", "third coefficient")
    rows = []
    for k, (joints, poses) in enumerate(zip(cusps.joints, cusps.poses, strict=True)):
        measures = (float(cusps.error[k]), float(cusps.residual[k]), float(cusps.third[k]))
        rows += [(k + 1, *joints.tolist(), *pose.tolist(), *measures) for pose in poses]
    title = "Cusps of the example at rho2 = 1, each with its two triple poses"
    return Table(title, header, rows)


def _poses(robot: rpr3.AnalyticRPR3, cusps: jk.Cusps) -> list[Check]:
    joints, poses = section_cusps(robot, 1, 1.0)
    order = [k for k in np.lexsort((joints[:, 2], joints[:, 0])) if np.isfinite(joints[k, 0])]
    off = 0.0
    for k, found in zip(order, cusps.poses, strict=True):
        pairs = (poses[k], poses[k][::-1]) if len(found) == 2 else ()
        off = max(off, min((float(np.max(np.abs(pair - found))) for pair in pairs), default=np.inf))
    what = "the two triple poses over each cusp at rho2 = 1, against closed forms"
    return [Check("cusp-poses", "Fig. 3", what, "not given", "two each", off, 1e-11)]


def _families() -> tuple[list[Check], Table]:
    checks: list[Check] = []
    rows: list[tuple[Cell, ...]] = []
    for expected, (geometry, rho2) in enumerate(_FAMILIES):
        robot, high = rpr3.analytic(*geometry), reach(geometry, rho2)
        found = jk.cusps(robot, jk.Grid(rho1=(0.0, high[0], 400), rho2=rho2, rho3=(0.0, high[1], 400)))
        exact = closed_form_cusps(robot, rho2)
        section = f"c2={geometry[0]:g}, c3={geometry[1]:g}, d3={geometry[2]:g}, rho2={rho2:g}"
        what = f"cusps of the section {section}"
        checks.append(count_check(f"family-{expected}", "section on cusps", what, expected, len(found)))
        off = float(np.max(np.abs(found.joints - exact), initial=0.0)) if len(found) == len(exact) else np.inf
        if expected:
            what = f"their lengths, {section}, against the closed forms"
            checks.append(Check(f"family-{expected}-lengths", "section on cusps", what, "always", "equal", off, 1e-11))
        rows += [(*geometry, rho2, expected, *q[[0, 2]].tolist()) for q in found.joints]
        if not expected:
            rows.append((*geometry, rho2, expected, None, None))
    return checks, Table(
        "Sections rho2 = const with 0, 1, 2 and 3 cusps, one row a cusp",
        ("c2", "c3", "d3", "rho2", "cusps", "rho1", "rho3"),
        rows,
    )
