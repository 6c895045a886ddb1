"""``jk.node_curves``: curves of the joint space over which two poses are singular at once."""

import itertools
import json
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping import _cusp_curve_equations as equations
from jaxkin.mapping import _cusp_curve_nodes as nodes
from jaxkin.mapping import search
from jaxkin.mapping._cusp_curve_continuation import LEFT, STUCK, Chain, chains_of, directions_at, trace
from jaxkin.mapping._cusp_curve_cuts import cuts_of
from jaxkin.mapping._cusp_curve_equations import Sheet, sheets_of
from jaxkin.mapping._cusp_curve_nodes import PairData
from jaxkin.mapping._cusp_curve_seeds import FOUND, trace_sheet
from jaxkin.mapping.assembly import CLOSED, Arc, End, distance_to_arcs
from jaxkin.mapping.batch import over_points
from jaxkin.mapping.cusp_curves import bind_box, longest_step
from jaxkin.mapping.loci import evaluated, summed
from jaxkin.mapping.named import NamedParts
from jaxkin.mapping.records import DISAGREEMENTS
from jaxkin.mapping.section import Section
from jaxkin.numerics.gluing import short_way
from jaxkin.numerics.newton import lattice
from jaxkin.sweep.grid import Grid

#: Poses closer than this (dimensionless) are not told from one; pairs are set off from swallowtails at these distances.
_LEAST, _OFF = 0.02, (0.08, 0.04)
#: Starts of a search, seeds of a round, and how far the first seeds are apart.
_STARTS, _SEEDS, _APART = 1024, 64, 0.3
#: Smallest singular value, of the largest, below which the equations are dependent: nodes fill more than curves there.
_DEPENDENT = 1e-8
#: How far rounding may move a pair near a swallowtail, where the equations are nearly dependent.
_NOISE = 1e-8
_COVERED = 1e-3
_SWALLOWTAIL = "swallowtail"


@dataclass(frozen=True, eq=False)
class NodeCurve:
    """A curve of nodes in the joint space, in order along the curve.

    Attributes:
        name: Its name, by which ``NodeCurves`` gives it.
        joints: ``(k, n_joint)`` joint values.
        poses: ``(k, 2, n_pose)`` the two singular poses over each, angles in [-pi, pi).
        closed: True where the last point is followed by the first (which is not repeated).
        residual: Largest dimensionless residual of the constraints and the singularity of both poses.
        ends: What it ends on: a border (``"rho1 = 200"``), ``"swallowtail"`` (the two poses become one),
            ``"poses meet (f1 = f2 = 0)"`` (they do so where two factors vanish; the last point is the last at which
            they are told apart), or ``"lost"`` where the tracer was; two empty texts where closed.
        labels: The factors of the singularity that vanish at the first and the second pose; "" without factors.
    """

    name: str
    joints: np.ndarray
    poses: np.ndarray
    closed: bool
    residual: float
    ends: tuple[str, str]
    labels: tuple[str, str]

    def __len__(self) -> int:
        """Number of points."""
        return len(self.joints)


@dataclass(frozen=True, eq=False)
class NodeCurves(NamedParts[NodeCurve]):
    """All node curves of a box of the joint space.

    Attributes:
        curves: The curves, longest first.
        excess: Where nodes fill more than curves, in words: these are not traced.
        request: What determines the numbers: mechanism, geometry, box, method.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for completeness, by name.
    """

    kind: ClassVar[str] = "node curves"

    curves: tuple[NodeCurve, ...]
    excess: tuple[str, ...]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)

    @property
    def parts(self) -> tuple[NodeCurve, ...]:
        """The curves."""
        return self.curves

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free joint axes."""
        return tuple(name for name, value in self.request["section"].items() if isinstance(value, list))

    @property
    def residual(self) -> float:
        """Largest dimensionless residual of all points."""
        return max((curve.residual for curve in self.curves), default=0.0)

    @property
    def complete(self) -> bool:
        """False where the searches disagree, a tracer was lost, or a swallowtail has not one node curve: no proof."""
        ends, tails = self.evidence.get(_BALANCE, (0, 0))
        return ends == tails and not self.excess and not any(self.evidence.get(name) for name in DISAGREEMENTS)

    def __str__(self) -> str:
        """A summary of a few lines."""
        closed = sum(curve.closed for curve in self.curves)
        lines = [
            f"{len(self)} node curves over {', '.join(self.free)} ({closed} closed), "
            f"{sum(map(len, self.curves))} points, residual {self.residual:.1e}"
        ]
        for curve in self.curves:
            ends = "closed" if curve.closed else f"from {curve.ends[0]} to {curve.ends[1]}"
            label = f" ({' and '.join(curve.labels)})" if any(curve.labels) else ""
            lines.append(f"  {curve.name}{label}: {len(curve)} points, {ends}")
        lines += [f"  not traced: {text}" for text in self.excess]
        lines += [f"  {name}: {value}" for name, value in self.evidence.items()]
        return "\n".join(lines if self.complete or self.excess else [*lines, _DOUBT])

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        curves = [
            {
                "name": c.name,
                "labels": list(c.labels),
                "closed": c.closed,
                "ends": list(c.ends),
                "residual": c.residual,
                "joints": c.joints.tolist(),
                "poses": c.poses.tolist(),
            }
            for c in self.curves
        ]
        content = {
            "request": self.request,
            "joint_axes": list(self.joint_names),
            "pose_axes": list(self.pose_names),
            "units": self.units,
            "node_curves": curves,
            "excess": list(self.excess),
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


_BALANCE = "ends of node curves on swallowtails, swallowtails of the cusp curves"
_DOUBT = "  DOUBTFUL: the searches disagree; try more samples or a smaller box"


def node_curves(robot: Mechanism, box: Grid) -> NodeCurves:
    """Traces all curves of nodes in a box of the joint space: joint values with two singular poses.

    At a node the images of two pieces of the singular surface cross. Both poses are unknowns; pairs are sought from
    spread starts and set off from every swallowtail of the cusp curves, where one node curve begins, and traced by
    pseudo-arclength continuation in the space of pairs.

    Args:
        robot: The mechanism.
        box: A grid with three free joint axes; their ends are limits, their numbers only seed. Joint limits of the
            robot cut the ranges.

    Returns:
        The curves, longest first, each with ``.joints (k, n_joint)``, ``.poses (k, 2, n_pose)``, ``.closed``,
        ``.ends``; and ``.excess``, ``.evidence``. A pair stands once, in either order.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``cusp_curves``.
        GeometryError: As for ``cusp_curves``.

    Not differentiable. Where a symmetry gives every singular pose a partner (the analytic 3-RPR) the nodes fill a
    surface: that is said in ``.excess``, and of such pairs only those that form curves by themselves are traced.
    """
    bound = bind_box("jk.node_curves", robot, box)
    longest = longest_step(bound)
    sheets = sheets_of(bound)
    tails = [_swallowtails(sheet, longest) for sheet in sheets]
    curves: list[NodeCurve] = []
    excess: list[str] = []
    evidence = []
    for k, j in itertools.combinations_with_replacement(range(len(sheets)), 2):
        pair = _Pair(sheets[k], sheets[j], tails[k] if k == j else None)
        found, words, facts = pair.curves(longest)
        curves += found
        excess += words
        evidence.append(facts)
    curves.sort(key=lambda curve: -_length(bound, curve.joints))
    return NodeCurves(
        curves=tuple(replace(curve, name=f"node curve {k + 1}") for k, curve in enumerate(curves)),
        excess=tuple(excess),
        **bound.record("trace"),
        evidence=summed(evidence),
    )


def _length(section: Section, joints: np.ndarray) -> float:
    width = np.asarray(section.data.high) - np.asarray(section.data.low)
    steps = np.diff(joints[:, list(section.grid.free)], axis=0) / width
    return float(np.sum(np.sqrt(np.sum(steps**2, axis=1))))


def _swallowtails(sheet: Sheet, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns points and unit tangents of the swallowtails on a sheet's cusp curves, ``(n, m)`` each."""
    cuts = cuts_of(sheet, trace_sheet(sheet, longest).chains)
    m = sheet.chart.dimension
    points = [cut.points[np.all(cut.critical, axis=1)] for cut in cuts]
    tangents = [cut.tangents[np.all(cut.critical, axis=1)] for cut in cuts]
    return np.concatenate([*points, np.zeros((0, m))]), np.concatenate([*tangents, np.zeros((0, m))])


class _Pair:
    """Two sheets, or one twice, and the search for nodes on them."""

    def __init__(self, one: Sheet, two: Sheet, tails: tuple[np.ndarray, np.ndarray] | None) -> None:
        self.one, self.two, self.section, self.chart = one, two, one.section, one.chart
        m = self.chart.dimension
        self.tails = tails or (np.zeros((0, m)), np.zeros((0, m)))
        self.same = tails is not None
        self.period = np.concatenate([self.section.period, self.section.period])
        self.data: Any = PairData(
            one.data,
            two.data,
            jnp.asarray(1.0 if self.same else 0.0),
            jnp.asarray(self.section.period),
            jnp.asarray(_LEAST),
        )

    def curves(self, longest: float) -> tuple[list[NodeCurve], list[str], dict[str, Any]]:
        """Returns the node curves, what fills more than curves, and the evidence."""
        spread, dependent = self._from_starts()
        words = []
        if dependent:
            names = f"{self.one.name} and {self.two.name}" if self.one.name else "det A = 0"
            words = [
                f"{names}: {dependent} of {dependent + len(spread)} pairs found lie in a set of more than one "
                "dimension (a symmetry gives singular poses partners over the same joints)"
            ]
        born = np.zeros((0, 2 * self.chart.dimension)) if dependent else self._from_swallowtails()
        everything = np.concatenate([born, spread])
        chains, contradictions, missed = self._traced(everything, longest)
        kept = self._once(chains)
        found = [self._curve(chain) for chain in kept]
        ends = sum(end == _SWALLOWTAIL for curve in found for end in curve.ends)
        evidence = {
            "points found by independent searches": len(everything),
            "of these on no traced curve": missed,
            "contradictory pieces": contradictions,
            _BALANCE: [ends, 0 if dependent else len(self.tails[0])],
        }
        return found, words, evidence

    def _from_starts(self) -> tuple[np.ndarray, int]:
        """Returns nodes from spread pairs of poses, and how many pairs lie where nodes fill more than curves."""
        m = self.chart.dimension
        low, high = np.min(self.section.samples, axis=0), np.max(self.section.samples, axis=0)
        unit = 2 * lattice(_STARTS, 2 * m) - 1
        middle, reach = np.tile(0.5 * (low + high), 2), np.tile(0.5 * (high - low), 2)
        # Half of them are denser towards the mechanism itself, where most happens.
        steep = np.where(np.isfinite(self.period), 1e-3, np.arcsinh(np.maximum(reach, 1e-3)))
        warped = np.where((np.arange(_STARTS) % 2 == 0)[:, None], unit, np.sinh(steep * unit) / np.sinh(steep))
        w, residual, margin, sigma = over_points(nodes.seek, self.chart, self.data, middle + reach * warped)
        good = (residual <= FOUND) & (margin >= 0)
        w, sigma = self._glued(w[good]), sigma[good]
        flat = [
            over_points(equations.gradient_share, self.chart, sheet.data, part)
            for sheet, part in ((self.one, w[:, :m]), (self.two, w[:, m:]))
        ]
        good = np.minimum(*flat) > 1e-5
        w, dependent = w[good], sigma[good] < _DEPENDENT
        return w[~dependent], int(np.sum(dependent))

    def _glued(self, w: np.ndarray) -> np.ndarray:
        m = self.chart.dimension
        return np.concatenate([search.glued(self.section, w[:, :m]), search.glued(self.section, w[:, m:])], axis=1)

    def _from_swallowtails(self) -> np.ndarray:
        """Returns pairs of poses set off from every swallowtail."""
        points, tangents = self.tails
        parts = [np.zeros((0, 2 * self.chart.dimension))]
        if len(points):
            for size in _OFF:
                columns = points, tangents, np.full(len(points), size)
                w, residual = over_points(nodes.from_swallowtail, self.chart, self.data, *columns)
                margin = np.min(over_points(nodes.inside, self.chart, self.data, w), axis=1)
                parts.append(self._glued(w[(residual <= FOUND) & (margin >= 0)]))
        return np.concatenate(parts)

    def _traced(self, found: np.ndarray, longest: float) -> tuple[list[Chain], int, int]:
        """Traces from some seeds, and from what lies on no curve, until nothing is left."""
        if len(found) == 0:
            return [], 0, 0
        clear = over_points(nodes.apart, self.chart, self.data, found) > 1.3 * _LEAST
        seeds = found[clear][self._distinct(found[clear], _APART)][:_SEEDS]
        chains: list[Chain] = []
        contradictions, missed = 0, found
        for attempt in range(6):
            pieces = trace(nodes.RULES, self.chart, self.data, seeds, self.period, longest=longest, noise=_NOISE)
            chains, contradictions = chains_of(pieces, self.period)
            covered = self._covered(found, chains)
            if self.same:
                covered |= self._covered(self._glued(nodes.swapped(found)), chains)
            missed = found[~covered]
            if contradictions and attempt < 2:
                longest = 0.4 * longest
                stuck = [seed for (seed, _), piece in pieces.items() if piece.state == STUCK and len(piece.points) == 1]
                seeds = np.delete(seeds, stuck, axis=0)  # The tracer cannot leave them: too near a swallowtail.
            elif len(missed) == 0:
                break
            seeds = np.concatenate([missed[self._distinct(missed, 1e-3)][: _SEEDS // 2], seeds])
        return chains, contradictions, len(missed)

    def _distinct(self, w: np.ndarray, distance: float) -> np.ndarray:
        """Returns the indices of the first of each cluster of pairs, in either order."""
        kept: list[int] = []
        for k in range(len(w)):
            both = np.concatenate([w[kept], nodes.swapped(w[kept])]) if self.same else w[kept]
            gap = np.max(np.abs(short_way(both - w[k], self.period)), axis=1, initial=0.0)
            if not np.any(gap < distance):
                kept.append(k)
        return np.array(kept, int)

    def _arcs(self, chains: list[Chain]) -> tuple[list[Arc], list[np.ndarray]]:
        end = End("border")
        arcs = [Arc(c.points, CLOSED if c.closed else end, CLOSED if c.closed else end) for c in chains]
        if not arcs:
            return [], []
        tangents = directions_at(nodes.node, self.chart, self.data, np.concatenate([a.points for a in arcs]))
        return arcs, np.split(tangents, np.cumsum([len(a.points) for a in arcs])[:-1])

    def _covered(self, points: np.ndarray, chains: list[Chain]) -> np.ndarray:
        gap, size = distance_to_arcs(points, *self._arcs(chains), self.period)
        return gap <= _COVERED * size + 1e-7

    def _once(self, chains: list[Chain]) -> list[Chain]:
        """Returns every curve once, of two that are each other with the poses exchanged the first."""
        if not self.same:
            return chains
        kept: list[Chain] = []
        for chain in chains:
            middle = self._glued(nodes.swapped(chain.points[[len(chain.points) // 2]]))
            if self._covered(middle, kept)[0]:
                continue
            kept.append(self._half(chain, middle))
        return kept

    def _half(self, chain: Chain, middle: np.ndarray) -> Chain:
        """Returns half of a closed curve that comes back to itself with the poses exchanged."""
        if not chain.closed or not self._covered(middle, [chain])[0]:
            return chain
        start = self._glued(nodes.swapped(chain.points[:1]))
        gap = np.sum(short_way(chain.points - start, self.period) ** 2, axis=1)
        return Chain(chain.points[: max(2, int(np.argmin(gap)))], True, chain.ends)

    def _curve(self, chain: Chain) -> NodeCurve:
        """Finishes a curve: its ends on borders and swallowtails, joints and poses."""
        points, ends = chain.points, ["", ""]
        bounds: dict[int, int] = {}
        if not chain.closed:
            for at in (0, -1):
                points, ends[at], edge = self._finished(points, at, chain.ends[at])
                if edge is not None:
                    bounds[at] = edge
        m = self.chart.dimension
        joints, first, residual = evaluated(self.one.section, points[:, :m])
        _, second, other = evaluated(self.two.section, points[:, m:])
        for at, edge in bounds.items():
            joint, bound = self.section.border(edge)
            joints[at, joint] = bound
        return NodeCurve(
            name="",
            joints=joints,
            poses=np.stack([first, second], axis=1),
            closed=chain.closed,
            residual=float(max(np.max(residual), np.max(other))),
            ends=(ends[0], ends[1]),
            labels=(self.one.name, self.two.name),
        )

    def _finished(self, points: np.ndarray, at: int, state: int) -> tuple[np.ndarray, str, int | None]:
        """Returns the points with one end solved for, what it is, and the number of the border."""
        if state != LEFT:
            return points, "lost", None
        outside, before = points[at], points[1 if at == 0 else -2]
        rest = points[1:] if at == 0 else points[:-1]
        margins = over_points(nodes.inside, self.chart, self.data, np.stack([before, outside]))
        crossed = np.flatnonzero(margins[1] < 0)
        joined = partial(_with_end, rest, at)
        for edge in crossed[crossed < margins.shape[1] - 1]:
            shares = np.append(np.linspace(0.1, 0.9, 5), margins[0, edge] / (margins[0, edge] - margins[1, edge]))
            guess = before + shares[:, None] * (outside - before)
            w, residual, margin = over_points(nodes.on_border, self.chart, self.data, guess, np.full(len(guess), edge))
            gap = np.max(np.abs(w - before), axis=1)
            good = (residual <= FOUND) & (margin >= -search.EDGE_SLACK)
            good &= gap < 1.2 * np.max(np.abs(outside - before)) + 1e-9
            if good.any():
                best = np.flatnonzero(good)[np.argmin(gap[good])]
                return joined(w[best]), self.section.border_name(int(edge)), int(edge)
        if margins.shape[1] - 1 in crossed and len(self.tails[0]):
            m = self.chart.dimension
            middle = outside[:m] + 0.5 * short_way(outside[m:] - outside[:m], self.section.period)
            gaps = short_way(self.tails[0] - middle, self.section.period)
            best = int(np.argmin(np.max(np.abs(gaps), axis=1)))
            if np.max(np.abs(gaps[best])) < 2 * _LEAST:
                tail = middle + gaps[best]
                shift = rest[at][m:] - rest[at][:m]
                turn = shift - short_way(shift, self.section.period)
                return joined(np.concatenate([tail, tail + turn])), _SWALLOWTAIL, None
        if margins.shape[1] - 1 in crossed and not self.same:
            return rest, f"poses meet ({self.one.name} = {self.two.name} = 0)", None
        return rest, "lost", None


def _with_end(points: np.ndarray, at: int, end: np.ndarray) -> np.ndarray:
    return np.vstack([end[None], points]) if at == 0 else np.vstack([points, end[None]])
