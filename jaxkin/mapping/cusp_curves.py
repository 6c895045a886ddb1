"""``jk.cusp_curves``: the cusps of all sections at once, as curves in the joint space."""

import json
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping import search
from jaxkin.mapping._cusp_curve_cuts import Cut, cuts_of
from jaxkin.mapping._cusp_curve_equations import Sheet, sheets_of
from jaxkin.mapping._cusp_curve_pieces import Drawn, all_transitions
from jaxkin.mapping._cusp_curve_seeds import trace_sheet
from jaxkin.mapping._transitions import Pieces, Transitions
from jaxkin.mapping.loci import evaluated, summed
from jaxkin.mapping.named import NamedParts
from jaxkin.mapping.records import DISAGREEMENTS
from jaxkin.mapping.section import Section, bind_section
from jaxkin.sweep.grid import Grid

#: Longest step near the mechanism, dimensionless, and of the widest side of the box.
_LONGEST, _SHARE = 0.05, 0.02


@dataclass(frozen=True, eq=False)
class CuspCurve:
    """A curve of cusps in the joint space, in order along the curve.

    Attributes:
        name: Its name, by which ``CuspCurves`` gives it.
        joints: ``(k, n_joint)`` joint values.
        poses: ``(k, n_pose)`` the triple pose over each, angles in [-pi, pi).
        closed: True where the last point is followed by the first (which is not repeated).
        residual: Largest dimensionless residual of the constraints and the singularity along the curve.
        ends: What it ends on: a border (``"rho1 = 200"``), ``"reality lost (f1 = 0)"`` (two triple poses meet, and
            beyond they are complex), ``"leg of zero length (rho2 = 0)"``, ``"crossing (...)"``, or ``"lost"`` where
            the tracer was; two empty texts where closed.
        label: The factor of the singularity that vanishes on it; "" where the mechanism declares none.
        critical: ``(k, n_joint)`` True where a free joint has a critical point on the curve.
    """

    name: str
    joints: np.ndarray
    poses: np.ndarray
    closed: bool
    residual: float
    ends: tuple[str, str]
    label: str
    critical: np.ndarray

    def __len__(self) -> int:
        """Number of points."""
        return len(self.joints)


@dataclass(frozen=True, eq=False)
class CuspCurves(NamedParts[CuspCurve]):
    """All cusp curves of a box of the joint space.

    Attributes:
        curves: The curves, longest first.
        request: What determines the numbers: mechanism, geometry, box, method.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for completeness, by name.
    """

    kind: ClassVar[str] = "cusp curves"

    curves: tuple[CuspCurve, ...]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)
    _pieces: dict[str, Pieces] = field(default_factory=dict, repr=False)
    _transitions: dict[str, Transitions] = field(default_factory=dict, repr=False)

    @property
    def parts(self) -> tuple[CuspCurve, ...]:
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
        """False where the searches disagree or a tracer was lost: see ``evidence``. True is no proof."""
        doubts = any(t.doubts for t in self._transitions.values())
        return not doubts and not any(self.evidence.get(name) for name in _DISAGREEMENTS)

    def transitions(self, axis: str | int) -> Transitions:
        """Returns every value of a joint at which the number of cusps of the section through it changes.

        Args:
            axis: Name or number of a free joint.

        Raises:
            InputError: No such free joint.
        """
        return self._transitions[self._name("transitions", axis)]

    def count(self, axis: str | int, value: float) -> int:  # type: ignore[override]
        """Returns the number of cusps (distinct joint points) of the section on which a joint has a value.

        Exact between transitions, as far as the curves are complete. At a transition itself its own point is not
        counted, as it is no ordinary cusp.

        Args:
            axis: Name or number of a free joint.
            value: Between the ends of the box.

        Raises:
            InputError: No such free joint; a value outside the box.
        """
        return self._counted("count", axis, value)[0]

    def pose_count(self, axis: str | int, value: float) -> int:
        """Returns the number of cusp poses of a section; several may share one joint point. See ``count``."""
        return self._counted("pose_count", axis, value)[1]

    def _counted(self, who: str, axis: str | int, value: float) -> tuple[int, int]:
        name = self._name(who, axis)
        low, high = self._transitions[name].range
        if not low <= value <= high:
            raise InputError(
                f"CuspCurves.{who}: {name} = {value!r} is outside the box, {low:g} to {high:g}: give a value between, "
                "or trace the cusp curves of a larger box."
            )
        return self._pieces[name].count(float(value))

    def _name(self, who: str, axis: str | int) -> str:
        known = not isinstance(axis, bool) and isinstance(axis, int) and 0 <= axis < len(self.joint_names)
        name = self.joint_names[axis] if known else axis  # type: ignore[index]
        if name not in self._transitions:
            raise InputError(
                f"CuspCurves.{who}: {axis!r} is no free joint of this box: choose one of {', '.join(self.free)}."
            )
        return str(name)

    def __str__(self) -> str:
        """A summary of a few lines."""
        closed = sum(curve.closed for curve in self.curves)
        lines = [
            f"{len(self)} cusp curves over {', '.join(self.free)} ({closed} closed), "
            f"{sum(map(len, self.curves))} points, residual {self.residual:.1e}"
        ]
        for curve in self.curves:
            ends = "closed" if curve.closed else f"from {curve.ends[0]} to {curve.ends[1]}"
            label = f" ({curve.label})" if curve.label else ""
            lines.append(f"  {curve.name}{label}: {len(curve)} points, {ends}")
        numbers = ", ".join(f"{name} {len(t)}" for name, t in self._transitions.items())
        lines.append(f"  transitions of the number of cusps along each joint: {numbers}")
        lines += [f"  {name}: {value}" for name, value in self.evidence.items()]
        return "\n".join(lines if self.complete else [*lines, _DOUBT])

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        curves = [
            {
                "name": c.name,
                "label": c.label,
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
            "cusp_curves": curves,
            "transitions": [t.content() for t in self._transitions.values()],
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


_ON_NONE = "critical points found by a search of their own, on no curve"
_DISAGREEMENTS = (*DISAGREEMENTS, _ON_NONE)
_DOUBT = "  DOUBTFUL: the searches disagree; try more samples or a smaller box"


def cusp_curves(robot: Mechanism, box: Grid) -> CuspCurves:
    """Traces all curves of cusps in a box of the joint space, and finds where the number of cusps in a section changes.

    A cusp is a singular pose at which det A does not change along the kernel of A; in three free joints such poses form
    curves, smooth in pose space, that are traced there by pseudo-arclength continuation. Seeds are cusps from spread
    starts, the cusps on the borders of the box, and the critical points of every free joint, of which every component
    has some. The number of cusps of the sections q_i = const changes where q_i is critical along a cusp curve
    (swallowtail, lips, beaks), and where a curve ends.

    Args:
        robot: The mechanism.
        box: A grid with three free joint axes; their ends are limits, their numbers only seed. Joint limits of the
            robot cut the ranges.

    Returns:
        The curves, longest first, each with ``.joints``, ``.poses``, ``.closed``, ``.ends``; and
        ``.transitions(axis)``, ``.count(axis, value)``, ``.evidence``. Empty where the box has no cusps.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Not exactly three free axes (with two the cusps are points: ``jk.cusps``), an unknown axis, a joint
            fixed outside its limits or at a length of zero, a box that no pose reaches.
        GeometryError: The geometry is degenerate, or det dF/dpose vanishes identically.

    Not differentiable. Completeness is not proved: the searches must agree, and ``.evidence`` holds the numbers.

    References:
        Zein, M., Wenger, P. and Chablat, D., 2007, "Singular curves in the joint space and cusp points of 3-RPR
        parallel manipulators", Robotica 25(6): cusps as triple roots of sections. That their number changes at
        swallowtails, lips and beaks is Arnold's list of transitions of caustics.
    """
    bound = bind_box("jk.cusp_curves", robot, box)
    longest = longest_step(bound)
    drawn: list[Drawn] = []
    residuals: list[float] = []
    evidence = []
    for sheet in sheets_of(bound):
        traced = trace_sheet(sheet, longest)
        cuts = cuts_of(sheet, traced.chains)
        for cut in cuts:
            curve, residual = _drawn(sheet, cut)
            drawn.append(curve)
            residuals.append(residual)
        found = {"critical points found by a search of their own": len(traced.critical)}
        evidence.append({**traced.evidence, **found, _ON_NONE: _unmet(sheet, cuts, traced.critical)})
    order = sorted(range(len(drawn)), key=lambda k: -_length(bound, drawn[k]))
    drawn, residuals = [drawn[k] for k in order], [residuals[k] for k in order]
    tables = all_transitions(drawn) or _none(bound)
    return CuspCurves(
        curves=tuple(_record(bound, k, curve, r) for k, (curve, r) in enumerate(zip(drawn, residuals, strict=True))),
        **bound.record("trace"),
        evidence=summed(evidence),
        _pieces={name: table[0] for name, table in tables.items()},
        _transitions={name: table[1] for name, table in tables.items()},
    )


def longest_step(section: Section) -> float:
    """Returns the longest step of the tracer near the mechanism, dimensionless."""
    width = (np.asarray(section.data.high) - np.asarray(section.data.low)) / np.asarray(section.data.free_unit)
    return float(np.clip(_SHARE * np.max(width), 1e-3, _LONGEST))


def bind_box(who: str, robot: Mechanism, box: Grid) -> Section:
    """Fits a box to a mechanism that has three joints to free.

    Raises:
        InputError: The mechanism has fewer than three joints; and as for ``bind_section``.
    """
    joints = getattr(robot, "joint_axes", ())
    if isinstance(robot, Mechanism) and len(joints) < 3:
        raise InputError(
            f"{who}: {type(robot).__name__} has {len(joints)} joint axes: its cusps and nodes are points, not curves; "
            "use jk.cusps and jk.singular_curves on a section."
        )
    return bind_section(who, robot, box, free=3)


def _drawn(sheet: Sheet, cut: Cut) -> tuple[Drawn, float]:
    """Evaluates a curve; at borders the joint is at its bound, not an ulp beside it."""
    section = sheet.section
    joints, poses, residual = evaluated(section, cut.points)
    for k, text in ((0, cut.ends[0]), (-1, cut.ends[1])):
        for axis, joint in enumerate(section.grid.free):
            for bound in (float(section.data.low[axis]), float(section.data.high[axis])):
                name = f"{section.robot.joint_axes[joint].name} = {bound:g}"
                if text == name and abs(joints[k, joint] - bound) < 1e-8 * (1 + abs(bound)):
                    joints[k, joint] = bound
    return Drawn(sheet, cut, joints, poses), float(np.max(residual))


def _unmet(sheet: Sheet, cuts: list[Cut], critical: np.ndarray) -> int:
    """Returns how many critical points of a search of their own are none on the curves."""
    marks = [cut.points[np.any(cut.critical, axis=1)] for cut in cuts]
    own = np.concatenate([*marks, np.zeros((0, sheet.chart.dimension))])
    apart = ~search.near(sheet.section, critical, own) if len(critical) else np.zeros(0, bool)
    return int(np.sum(apart))


def _length(section: Section, curve: Drawn) -> float:
    """Length of a curve's image, each joint in widths of the box."""
    width = np.asarray(section.data.high) - np.asarray(section.data.low)
    steps = np.diff(curve.joints[:, list(section.grid.free)], axis=0) / width
    return float(np.sum(np.sqrt(np.sum(steps**2, axis=1))))


def _record(section: Section, number: int, curve: Drawn, residual: float) -> CuspCurve:
    critical = np.zeros(curve.joints.shape, bool)
    critical[:, list(section.grid.free)] = curve.cut.critical
    return CuspCurve(
        name=f"cusp curve {number + 1}",
        joints=curve.joints,
        poses=curve.poses,
        closed=curve.cut.closed,
        residual=residual,
        ends=curve.cut.ends,
        label=curve.sheet.name,
        critical=critical,
    )


def _none(section: Section) -> dict[str, tuple[Pieces, Transitions]]:
    """Returns empty tables for a box without cusps."""
    tables = {}
    names = tuple(axis.name for axis in section.robot.joint_axes)
    for axis, joint in enumerate(section.grid.free):
        ends = float(section.data.low[axis]), float(section.data.high[axis])
        nothing = np.zeros((0, 2), int)
        pieces = Pieces(np.zeros(0), np.zeros(0), nothing, np.zeros(0, int))
        where = np.zeros((0, len(names)))
        tables[names[joint]] = (
            pieces,
            Transitions(names[joint], ends, np.zeros(0), nothing, nothing, (), where, (), np.zeros(0), names),
        )
    return tables
