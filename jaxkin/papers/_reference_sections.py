"""Sections of the field's reference geometry: not of this paper, but of the same authors and the same method.

References:
    Zein, M., Wenger, P. and Chablat, D., 2007, "Singular curves in the joint space and cusp points of 3-RPR parallel
    manipulators", Robotica 25(6): six cusps in the sections rho1 = 14.98 and rho1 = 17 of the geometry of Innocenti and
    Parenti-Castelli (1998).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

import jaxkin as jk
from jaxkin.mechanisms import rpr3
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._wc2009_sections import SAMPLES
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Picture, Table

#: The sections, and where their axes end: beyond the reach of legs 2 and 3, so that the curves close.
_SECTIONS, _HIGH = (14.98, 17.0), 52.0
_CUSPS = 6
_SOURCE = "Zein, Wenger, Chablat 2007"
#: Counts are compared so many samples off a curve; curves nearer than the second number, in lengths, are left out.
_ASIDE, _APART = 3, 1.5


@dataclass(frozen=True)
class ReferenceSection:
    """What one section consists of, computed and not yet drawn."""

    rho1: float
    counts: Any
    curves: jk.SingularCurves
    cusps: jk.Cusps


def compute_sections() -> list[ReferenceSection]:
    """Computes the sections; most of the time is compilation, so that another thread may compute meanwhile."""
    robot, found = rpr3.reference(), []
    for rho1 in _SECTIONS:
        grid = jk.Grid(rho1=rho1, rho2=(0.0, _HIGH, SAMPLES), rho3=(0.0, _HIGH, SAMPLES))
        cusps, curves = jk.cusps(robot, grid), jk.singular_curves(robot, grid)
        counts = jk.sweep(robot, jk.fields.forward_count, grid, progress=False)
        found.append(ReferenceSection(rho1, counts, curves, cusps))
    return found


def reference_geometry(sections: list[ReferenceSection] | None = None) -> Part:
    """Draws and checks the sections rho1 = 14.98 and rho1 = 17.

    Args:
        sections: What ``compute_sections`` returned; computed if not given.
    """
    checks: list[Check] = []
    pictures: dict[str, Picture] = {}
    rows: list[tuple[float | int, ...]] = []
    for section in compute_sections() if sections is None else sections:
        checks += _checks(section)
        ax = jk.plot.section(section.counts, curves=section.curves, cusps=section.cusps)
        caption = f"Reference geometry, section rho1 = {section.rho1:g}: assembly modes, singular curve, cusps"
        pictures[f"reference_{section.rho1:g}"] = Picture.of(ax, caption)
        for k, (joints, poses) in enumerate(zip(section.cusps.joints, section.cusps.poses, strict=True)):
            rows += [(section.rho1, k + 1, *joints[1:].tolist(), *pose.tolist()) for pose in poses]
    header = ("rho1", "cusp", "rho2", "rho3", "x", "y", "phi")
    table = Table("Cusps of the reference geometry", header, rows)
    return Part("Reference geometry", tuple(checks), pictures, {"reference_cusps": table})


def _checks(section: ReferenceSection) -> list[Check]:
    cusps, name = section.cusps, f"reference-{section.rho1:g}"
    where = f"rho1 = {section.rho1:g}"
    checks = [count_check(f"{name}-cusps", where, f"number of cusps ({_SOURCE})", _CUSPS, len(cusps))]
    worst = max(section.curves.residual, float(np.max(cusps.residual, initial=0.0)))
    what = "largest dimensionless residual of curves and cusps"
    checks.append(Check(f"{name}-residual", where, what, "0", f"{worst:.1e}", worst, 1e-12))
    triple = max((_triple_root(q, x) for q, poses in zip(cusps.joints, cusps.poses, strict=True) for x in poses))
    what = "the polynomial of the elimination by (4) and (5) has a triple root at every cusp"
    checks.append(Check(f"{name}-triple", where, what, "0", f"{triple:.1e}", triple, 1e-10))
    points, wrong = _jumps(section)
    what = f"points of the curve, of {points}, across which the count does not jump by 2"
    checks.append(count_check(f"{name}-jump", where, what, 0, wrong))
    return checks


def _triple_root(joints: np.ndarray, pose: np.ndarray) -> float:
    """Returns the largest of |P|, |P'|, |P''| at a pose's angle, over the size of P and its derivatives.

    P = (S W - V Q)^2 + (U Q - R W)^2 - rho1^2 (R V - S U)^2, whose roots are the angles of all solutions, is a
    trigonometric polynomial of degree 4 at most: twelve samples and a Fourier sum give its derivatives exactly.
    """
    robot: Any = rpr3.reference()
    geometry = tuple(float(getattr(robot, name)) for name in ("c2", "c3", "d3", "l2", "l3", "beta"))
    r, s, q, u, v, w = printed.lines(geometry, 2 * np.pi * np.arange(12) / 12, tuple(joints))
    samples = (s * w - v * q) ** 2 + (u * q - r * w) ** 2 - joints[0] ** 2 * (r * v - s * u) ** 2
    order = np.fft.fftfreq(12, 1 / 12)
    terms = np.fft.fft(samples) / 12 * np.exp(1j * order * pose[2])
    derivatives = [abs(np.sum((1j * order) ** k * terms)) / np.sum(np.abs(order**k * terms)) for k in range(3)]
    return float(max(derivatives))


def _jumps(section: ReferenceSection) -> tuple[int, int]:
    """Returns at how many points the counts beside the curve were compared, and how often they do not differ by 2."""
    counts = np.asarray(section.counts.forward_count).astype(int)
    step = _HIGH / (SAMPLES - 1)
    total = wrong = 0
    for curve in section.curves:
        points = curve.joints[:, 1:]
        travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        gaps = np.linalg.norm(points[:, None] - points, axis=2)
        # Neighbours along the curve are no other curve; over the end of a closed one they look like one.
        apart = np.abs(travelled[:, None] - travelled) > 2 * _APART
        good = np.min(np.where(apart, gaps, np.inf), axis=1) > _APART / 2
        good &= np.min(np.linalg.norm(points[:, None] - section.cusps.joints[:, 1:], axis=2), axis=1) > 2 * _APART
        good &= np.min(points, axis=1) > _APART / 2
        middle = np.flatnonzero(good)
        middle = middle[(middle > 0) & (middle < len(points) - 1)]
        tangent = points[middle + 1] - points[middle - 1]
        normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)
        normal *= _ASIDE * step / np.linalg.norm(normal, axis=1, keepdims=True)
        one, other = (np.rint((points[middle] + sign * normal) / step).astype(int) for sign in (1, -1))
        jump = np.abs(counts[tuple(one.T)] - counts[tuple(other.T)])
        total, wrong = total + len(middle), wrong + int(np.sum(jump != 2))
    return total, wrong
