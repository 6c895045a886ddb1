"""Sections of the joint space: how a traced map of singular curves is held against closed forms and counts."""

from typing import Any

import numpy as np

import jaxkin as jk
from jaxkin.mechanisms import rpr3_closed_forms
from jaxkin.mechanisms.rpr3 import AnalyticRPR3
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._compiled import counts_at, forms_at, section_cusps
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Picture

#: Samples a side of the counts that colour a section: as many as a printed figure can show.
SAMPLES = 800
#: Shares of the characteristic length: jumps of the count are looked for so far on both sides of a curve, and so far
#: from other curves; chords may be so far off their curve, as their length is chosen for drawing.
_ASIDE, _APART, _CHORD = 1e-4, 5e-3, 5e-3

_JUMPS = {"S": 4, "Q": 2, "virtual": 0}


def section_part(
    robot: AnalyticRPR3, rho2: float, high: tuple[float, float], name: str, where: str, caption: str
) -> Part:
    """Draws the section rho2 = const of a member of the family, and checks it.

    Args:
        robot: The member.
        rho2: Length of leg 2.
        high: Where the axes of rho1 and rho3 end; they begin at 0.
        name: Name of the figure's files; the checks' keys begin with it as well.
        where: What the report calls it.
        caption: What the figure shows.
    """
    grid = jk.Grid(rho1=(0.0, high[0], SAMPLES), rho2=rho2, rho3=(0.0, high[1], SAMPLES))
    counts = jk.sweep(robot, jk.fields.forward_count, grid, progress=False)
    closed = jk.singular_curves(robot, grid, method="closed form")
    traced, cusps = jk.singular_curves(robot, grid), jk.cusps(robot, grid)
    checks = [
        *_curve_checks(robot, closed, traced, name, where),
        *_cusp_checks(robot, grid, cusps, name, where),
        *_crossing_checks(robot, rho2, high, traced, name, where),
        *_jumps(robot, closed, name, where),
        _zero_share(counts, name, where),
    ]
    ax = jk.plot.section(counts, curves=closed, cusps=cusps)
    return Part(where, tuple(checks), pictures={name: Picture.of(ax, caption)})


def _curve_checks(
    robot: AnalyticRPR3, closed: jk.SingularCurves, traced: jk.SingularCurves, name: str, where: str
) -> list[Check]:
    worst = max(closed.residual, traced.residual)
    what = "largest dimensionless residual of constraints and determinant, closed and traced curves"
    checks = [Check(f"{name}-residual", where, what, "0", f"{worst:.1e}", worst, 1e-12)]

    joints = {label: np.concatenate([c.joints for c in traced if c.label == label]) for label in ("f1", "f2")}
    spread = np.random.default_rng(0).uniform(0, joints["f1"].max(axis=0), (500, 3))
    for label, surface in (("f2", "S"), ("f1", "Q1 to Q4")):
        here, anywhere = (_smallest_form(robot, points, surface) for points in (joints[label], spread))
        off = float(np.max(here) / np.median(anywhere))
        what = f"traced curves with {label} = 0 lie on {surface}: its value there over its median in the section"
        checks.append(Check(f"{name}-{surface[0]}", where, what, "0", f"{off:.1e}", off, 1e-9))

    length = float(robot.characteristic_length())
    lines = [_embedded(np.concatenate([c.poses, c.poses[:1]]) if c.closed else c.poses, length) for c in traced]
    points = np.concatenate([_embedded(curve.poses, length) for curve in closed if not curve.virtual])
    away = float(np.max(_distances(points, lines)))
    what = "poses of the closed forms to the nearest traced chord, over the characteristic length"
    note = "chords cut corners: their length is chosen for drawing"
    checks.append(Check(f"{name}-near", where, what, "0", f"{away:.1e}", away, _CHORD, note))
    return checks


def _smallest_form(robot: AnalyticRPR3, joints: np.ndarray, surface: str) -> np.ndarray:
    forms = forms_at(robot, joints)
    return np.min([np.abs(value) for name, value in forms.items() if name[0] == surface[0]], axis=0)


def _embedded(poses: np.ndarray, length: float) -> np.ndarray:
    """Returns poses as points x, y, cos phi, sin phi, lengths divided by the characteristic one."""
    return np.column_stack([poses[:, :2] / length, np.cos(poses[:, 2]), np.sin(poses[:, 2])])


def _closed_up(curve: jk.Curve) -> np.ndarray:
    return np.concatenate([curve.joints, curve.joints[:1]]) if curve.closed else curve.joints


def _distances(points: np.ndarray, lines: list[np.ndarray]) -> np.ndarray:
    """Returns the distance of each point from the nearest chord of polylines."""
    starts, ends = np.concatenate([line[:-1] for line in lines]), np.concatenate([line[1:] for line in lines])
    along = ends - starts
    square = np.maximum(np.sum(along**2, axis=1), 1e-300)
    nearest = np.full(len(points), np.inf)
    for k in range(0, len(points), 512):  # In slabs: points times chords fit no cache.
        gap = points[k : k + 512, None] - starts
        share = np.clip(np.sum(gap * along, axis=2) / square, 0, 1)
        nearest[k : k + 512] = np.min(np.linalg.norm(gap - share[..., None] * along, axis=2), axis=1)
    return nearest


def _cusp_checks(robot: AnalyticRPR3, grid: jk.Grid, cusps: jk.Cusps, name: str, where: str) -> list[Check]:
    exact = closed_form_cusps(robot, float(grid.axes["rho2"]))  # type: ignore[arg-type]
    what = "number of cusps, found twice over, against the closed forms"
    checks = [count_check(f"{name}-cusps", where, what, len(exact), len(cusps))]
    off = float(np.max(np.abs(cusps.joints - exact), initial=0.0)) if len(exact) == len(cusps) else np.inf
    what = "their lengths against the closed forms"
    checks.append(Check(f"{name}-cusp-lengths", where, what, "cusp edges", "equal", off, 1e-12))
    flat = int(np.sum(cusps.third < 1e-6))
    what = "cusps at which more than three assembly modes meet in a pose (third coefficient zero)"
    checks.append(count_check(f"{name}-third", where, what, 0, flat))
    return checks


def closed_form_cusps(robot: AnalyticRPR3, rho2: float) -> np.ndarray:
    """Returns the cusps ``(n, 3)`` of a section rho2 = const from the cusp edges, by ascending rho1."""
    joints = section_cusps(robot, 1, rho2)[0]
    joints = joints[np.isfinite(joints[:, 0])]
    return joints[np.lexsort((joints[:, 2], joints[:, 0]))]


def _crossing_checks(
    robot: AnalyticRPR3, rho2: float, high: tuple[float, float], traced: jk.SingularCurves, name: str, where: str
) -> list[Check]:
    """Where the real part of S ends: f1 = f2 = 0."""
    exact = np.asarray(rpr3_closed_forms.section_crossings(robot, 1, rho2).joints)
    exact = exact[np.all(exact[:, [0, 2]] <= high, axis=1)]
    found = traced.crossings.joints
    order = [points[np.lexsort((points[:, 2], points[:, 0]))] for points in (exact, found)]
    off = float(np.max(np.abs(order[0] - order[1]), initial=0.0)) if len(exact) == len(found) else np.inf
    what = f"the {len(exact)} points in which the real part of S ends, traced against closed forms"
    places = "; ".join(f"({q[0]:.12g}, {q[2]:.12g})" for q in order[1])
    return [Check(f"{name}-crossings", where, what, "not given", places or "none", off, 1e-10)]


def _jumps(robot: AnalyticRPR3, closed: jk.SingularCurves, name: str, where: str) -> list[Check]:
    """The number of solutions on both sides of every curve, at all its points that are apart from other curves."""
    free = [closed.joint_names.index(axis) for axis in closed.free]
    length = float(robot.characteristic_length())
    points: dict[str, list[np.ndarray]] = {kind: [np.zeros((0, 2, 3))] for kind in _JUMPS}
    for number, curve in enumerate(closed):
        others = [_closed_up(c)[:, free] for k, c in enumerate(closed) if k != number]
        ends = np.concatenate([closed.crossings.joints, closed_form_cusps(robot, float(curve.joints[0, 1]))])[:, free]
        kind = "virtual" if curve.virtual else curve.label[0]
        points[kind].append(_beside(curve.joints, free, others, ends, length))
    checks = []
    for kind, jump in _JUMPS.items():
        both = np.concatenate(points[kind])
        sides = counts_at(robot, both.reshape(-1, 3)).reshape(-1, 2)
        wrong = int(np.sum(np.abs(sides[:, 0] - sides[:, 1]) != jump))
        curves = {"S": "the real part of S", "Q": "Q1 to Q4", "virtual": "the virtual part of S"}[kind]
        what = f"points of {curves}, of {len(both)}, across which the count does not jump by {jump}"
        checks.append(count_check(f"{name}-jump-{kind}", where, what, 0, wrong))
    return checks


def _beside(
    joints: np.ndarray, free: list[int], others: list[np.ndarray], ends: np.ndarray, scale: float
) -> np.ndarray:
    """Returns the two points ``(k, 2, 3)`` on either side of a curve, where it runs apart from others and its ends."""
    plane = joints[:, free]
    tangent = plane[2:] - plane[:-2]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
    length = np.linalg.norm(normal, axis=1)
    middle = plane[1:-1]
    good = (length > 0) & np.all(middle > 10 * _ASIDE * scale, axis=1)
    if len(ends):
        good &= np.min(np.linalg.norm(middle[:, None] - ends, axis=2), axis=1) > 10 * _APART * scale
    if others:
        good &= _distances(middle, others) > _APART * scale
    step = _ASIDE * scale * normal[good] / length[good][:, None]
    both = np.repeat(joints[1:-1][good][:, None], 2, axis=1)
    both[:, 0][:, free] += step
    both[:, 1][:, free] -= step
    return both


def _zero_share(counts: Any, name: str, where: str) -> Check:
    shares = {n: float((counts.forward_count == n).mean()) for n in (0, 2, 4, 6)}
    text = ", ".join(f"{n}: {share:.1%}" for n, share in shares.items())
    rest = abs(1.0 - sum(shares.values()))
    what = "shares of 0, 2, 4, 6 solutions in the section; the difference is the share of other counts"
    return Check(f"{name}-zero", where, what, "2, 4 or 6", text, rest, 1e-3, "other counts: samples on a curve")


def printed_cusps(cusps: jk.Cusps) -> list[Check]:
    """Compares the cusps of the example at rho2 = 1 with the printed digits and with the exact numbers."""
    root = 3 * np.sqrt(3.0)
    exact = ((np.sqrt(3.0), 1.0), (np.sqrt((root - 3) / 2), np.sqrt(1 + root)))
    words = ("(sqrt 3, 1)", "(sqrt((3 sqrt 3 - 3)/2), sqrt(1 + 3 sqrt 3))")
    checks = []
    for k, (texts, numbers, word) in enumerate(zip(printed.CUSPS, exact, words, strict=True)):
        here = min(cusps.joints[:, [0, 2]].tolist(), key=lambda q, at=numbers: np.hypot(q[0] - at[0], q[1] - at[1]))
        got = f"({here[0]:.15g}, {here[1]:.15g})"
        off = max(abs(h - e) for h, e in zip(here, numbers, strict=True))
        checks.append(Check(f"cusp-{k}-exact", "text after (8)", f"cusp {word}, (rho1, rho3)", word, got, off, 1e-12))
        # A rounding must not fall below a whole number, which is printed as one.
        cut = [np.floor(h * 1e8 + 1e-4) / 1e8 for h in here]
        off = max(abs(c - float(text)) for c, text in zip(cut, texts, strict=True))
        what = "the same, cut off after 8 decimals"
        checks.append(Check(f"cusp-{k}-truncated", "text after (8)", what, f"({', '.join(texts)})", got, off, 1e-12))
    return checks


def ring_check(robot: AnalyticRPR3, cusps: jk.Cusps, name: str, where: str) -> Check:
    """Compares the counts around every cusp: three modes meet in each of its two poses, so 6 inside and 2 outside."""
    turn = np.linspace(0, 2 * np.pi, 2048, endpoint=False)
    wrong = 0
    for joints in cusps.joints:
        ring = np.tile(joints, (len(turn), 1))
        ring[:, [0, 2]] += 0.02 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        wrong += np.unique(counts_at(robot, ring)).tolist() != [2, 6]
    what = "cusps around which the counts are not 2 and 6, on a circle of radius 0.02"
    return count_check(f"{name}-ring", where, what, 0, wrong)


def reach(geometry: tuple[float, float, float], rho2: float) -> tuple[float, float]:
    """Returns lengths that rho1 and rho3 of a section rho2 = const nowhere reach, by the triangle inequality."""
    c2, c3, d3 = geometry
    return 1.05 * (rho2 + 2 * abs(c2)), 1.05 * (rho2 + 2 * float(np.hypot(c3 - c2, d3)))
