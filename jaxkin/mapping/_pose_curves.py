"""The singular curves of a section of the workspace: traced over all working modes at once, then told apart."""

from dataclasses import replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.kinematics.legs import Legs
from jaxkin.mapping import search
from jaxkin.mapping._pose_chart import PARALLEL, PoseChart
from jaxkin.mapping.assembly import Arc, End, strands_of
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.chart import SectionData
from jaxkin.mapping.loci import dots, end_name, evaluated, factor_label, gathered, refined, stands_still, summed
from jaxkin.mapping.meetings import meetings
from jaxkin.mapping.pose_sections import PoseSection
from jaxkin.mapping.records import Crossings, Curve, SingularCurves
from jaxkin.mapping.section import traced_factors
from jaxkin.mapping.tracing import trace_section
from jaxkin.numerics import newton
from jaxkin.numerics.gluing import short_way

#: A polished change of working mode lies nearer to its segment than this, in lengths of the segment.
_NEAR = 3.0


def pose_curves(bound: PoseSection, kind: str) -> SingularCurves:
    """Traces the curves of a section of the workspace: kind is "parallel", "serial" or "both"."""
    curves: list[Curve] = []
    evidence, nodes, alone = [], [], list[Curve]()
    if kind != "serial":
        sheets = bound.sheets()
        traced = [trace_section(sheet) for sheet in sheets]
        met = meetings(bound, traced)
        names = traced_factors(bound.robot) or ("",)
        for name, sheet, part, shared in zip(names, sheets, traced, met.shared, strict=True):
            own = [arc for arc, twice in zip(part.arcs, shared, strict=True) if not twice]
            curves += _curves(sheet, own, name)
        alone += dots(bound, gathered(bound, [part.isolated for part in traced]), "det A")
        nodes += [part.crossings for part in traced] + [met.points]
        evidence += [part.evidence for part in traced]
    if kind != "parallel":
        for sheet in bound.serial_sheets():
            part = trace_section(sheet)
            label = "det B" if sheet.leg < 0 else f"det B, leg {sheet.leg + 1}"
            curves += _curves(sheet, part.arcs, label)
            alone += dots(sheet, part.isolated, label)
            nodes.append(part.crossings)
            evidence.append(part.evidence)
    record = bound.record("trace")
    return SingularCurves(
        curves=(*sorted(curves, key=lambda curve: -len(curve)), *alone),
        crossings=Crossings(*evaluated(bound, gathered(bound, nodes))) if nodes else _no_crossings(bound),
        **{**record, "request": {**record["request"], "kind": kind}},
        evidence=summed(evidence) if evidence else {},
    )


def _no_crossings(bound: PoseSection) -> Crossings:
    return Crossings(*evaluated(bound, np.zeros((0, bound.chart.dimension))))


def _curves(section: PoseSection, arcs: list[Arc], name: str) -> list[Curve]:
    """Returns the curves of one sheet, cut where a leg is singular, by working mode."""
    found = []
    for strand in strands_of(arcs, section.period):
        strand = replace(strand, points=refined(section, strand))
        found += [_curve(section, piece, name) for piece in _pieces(section, strand)]
    return found


def _curve(section: PoseSection, strand: Arc, name: str) -> Curve:
    joints, poses, residual = evaluated(section, strand.points)
    for k, end in ((0, strand.start), (-1, strand.end)):
        if end.kind == "border":
            section.put_on_border(end.number, joints[k], poses[k])
    label = name or factor_label(section, poses) or "det A"
    still = section.pose_chart.vanishing == PARALLEL and stands_still(section, joints)
    return Curve(
        joints=joints,
        poses=poses,
        closed=strand.closed,
        residual=float(np.max(residual)),
        label=label + _mode(section, strand) + (", self-motion" if still else ""),
        ends=(_end(section, strand.start), _end(section, strand.end)),
    )


def _end(section: PoseSection, end: End) -> str:
    return f"det B, leg {end.number + 1}" if end.kind == "leg" else end_name(section, end)


def _mode(section: PoseSection, strand: Arc) -> str:
    """Writes the working mode along a piece, where there are several: signs, and 0 for the leg that is singular."""
    if section.legs is None or len(section.legs.modes) == 1:
        return ""
    points = strand.points[1:-1] if len(strand.points) > 2 else search.midpoints(section, strand.points[None, :2])
    entries = _entries(section, points)
    signs = np.sign(np.sum(entries, axis=0)).astype(int)
    text = ["0" if k == section.leg else {1: "+", -1: "-", 0: "0"}[int(sign)] for k, sign in enumerate(signs)]
    return f", working mode {''.join(text)}"


def _entries(section: PoseSection, points: np.ndarray) -> np.ndarray:
    """Returns each leg's entry of B, dimensionless, ``(k, n_joint)``."""
    assert section.legs is not None
    return over_points(_leg_entries, section.chart, section.data, points, *_rows(section.legs, len(points)))


def _rows(legs: Legs, count: int) -> tuple[np.ndarray]:
    return (np.tile(legs.rows, (count, 1)),)


def _leg_entries(chart: PoseChart, data: SectionData, u: Array, rows: Array) -> Array:
    joints = chart.joints(data, u)
    inverse = jax.jacfwd(data.robot.constraints, argnums=1)(chart.pose(data, u), joints)
    unit = scale_vector(data.robot.joint_axes, data.robot.characteristic_length())
    return (inverse * unit / data.row_scale[:, None])[rows, jnp.arange(len(unit))]


class _Cut(NamedTuple):
    """A change of working mode on a strand: behind which point, how far, which leg, and where."""

    segment: int
    share: float
    leg: int
    point: np.ndarray


def _pieces(section: PoseSection, strand: Arc) -> list[Arc]:
    """Cuts a strand where a leg's entry of B changes its sign."""
    cuts = _cuts(section, strand)
    if not cuts:
        return [strand]
    points = strand.points
    ends = [End("leg", cut.leg) for cut in cuts]
    if strand.closed:
        # Begin at the first cut; what comes round behind the last point lies whole turns away.
        first = cuts[0]
        turned = np.vstack([points[first.segment + 1 :], points[: first.segment + 1]])
        places = [cut.segment - first.segment - 1 for cut in cuts[1:]]
        return _cut_up(section, turned, [first, *cuts[1:], first], [-1, *places, len(turned) - 1], [*ends, ends[0]])
    inner = _cut_up(section, points, cuts, [cut.segment for cut in cuts], ends)
    head = np.vstack([points[: cuts[0].segment + 1], cuts[0].point])
    tail = np.vstack([cuts[-1].point, points[cuts[-1].segment + 1 :]])
    return [
        Arc(_running(section, head), strand.start, ends[0]),
        *inner,
        Arc(_running(section, tail), ends[-1], strand.end),
    ]


def _cut_up(
    section: PoseSection, points: np.ndarray, cuts: list[_Cut], places: list[int], ends: list[End]
) -> list[Arc]:
    """Returns the pieces from cut to cut; places say behind which point each lies."""
    pieces = []
    for k in range(len(cuts) - 1):
        parts = [cuts[k].point, *points[places[k] + 1 : places[k + 1] + 1], cuts[k + 1].point]
        pieces.append(Arc(_running(section, np.array(parts)), ends[k], ends[k + 1]))
    return pieces


def _running(section: PoseSection, points: np.ndarray) -> np.ndarray:
    """Returns points one after the other with the short way between neighbours, each place once."""
    steps = short_way(np.diff(points, axis=0), section.period)
    keep = np.max(np.abs(steps), axis=1) > 1e-9
    moved = np.vstack([points[:1], points[:1] + np.cumsum(steps, axis=0)])
    # The ends stay; of two inner points that are one, the first goes.
    keep[-1:] = True
    return moved[np.append(True, keep)]


def _cuts(section: PoseSection, strand: Arc) -> list[_Cut]:
    """Returns where the working mode changes along a strand, in order."""
    if section.legs is None or len(section.legs.modes) == 1:
        return []
    points, entries = strand.points, _entries(section, strand.points)
    if strand.closed:
        last = points[-1] + short_way(points[:1] - points[-1], section.period)
        points, entries = np.vstack([points, last]), np.vstack([entries, entries[:1]])
    twofold = [k for k, signs in enumerate(section.legs.signs) if len(signs) > 1 and k != section.leg]
    found = [
        (int(s), k, float(entries[s, k] / (entries[s, k] - entries[s + 1, k])))
        for k in twofold
        for s in np.flatnonzero((entries[:-1, k] < 0) != (entries[1:, k] < 0))
    ]
    if not found:
        return []
    segments = np.array([s for s, _, _ in found])
    share = np.array([share for _, _, share in found])[:, None]
    guesses = points[segments] + share * (points[segments + 1] - points[segments])
    legs = np.array([k for _, k, _ in found])
    (rows,) = _rows(section.legs, len(found))
    picks = np.eye(len(section.legs.rows))[legs]
    u, residual = over_points(_mode_change, section.chart, section.data, guesses, rows, picks)
    size = np.max(np.abs(points[segments + 1] - points[segments]), axis=1)
    good = (residual <= TOLERANCES.residual) & (np.max(np.abs(u - guesses), axis=1) <= _NEAR * size + 1e-9)
    cuts = []
    for k in np.flatnonzero(good):
        a, chord = points[segments[k]], points[segments[k] + 1] - points[segments[k]]
        along = float(np.dot(u[k] - a, chord) / max(float(np.dot(chord, chord)), 1e-300))
        cuts.append(_Cut(int(segments[k]), along, int(legs[k]), u[k]))
    return sorted(cuts, key=lambda cut: (cut.segment, cut.share))


def _mode_change(chart: PoseChart, data: SectionData, u: Array, rows: Array, pick: Array) -> tuple[Array, Array]:
    """Moves a guess to where a leg's entry of B vanishes on the curve; returns it and the residual."""

    def system(u: Array) -> Array:
        return jnp.append(chart.singular(data, u), jnp.dot(pick, _leg_entries(chart, data, u, rows)))

    u = newton.polish(system, u, steps=8, trust=0.05)
    return u, jnp.max(jnp.abs(system(u)))
