"""What ``jk.mode_change`` returns."""

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxkin.mapping.cusp_curves import CuspCurves
from jaxkin.mapping.records import coordinates


@dataclass(frozen=True, eq=False)
class ModeChange:
    """A way from one assembly mode to another without a singularity, or why there is none.

    Attributes:
        found: True where a path was found and verified.
        reason: What was found, or why not, a sentence.
        certain: False where nothing was found and that is no proof: the search was of one box, at one resolution.
        start: ``(n_pose,)`` the first assembly mode.
        goal: ``(n_pose,)`` the second one.
        aspects: What tells the aspects of start and goal apart, as text: working mode and signs. Equal texts do not say
            that the aspects are one.
        clearance: Smallest clearance along the path (singular value of dq/dx scaled by the characteristic length);
            NaN where nothing was found.
        poses: ``(k, n_pose)`` the path, from ``start`` to ``goal``, glued angles running on continuously.
        joints: ``(k, n_joint)`` the loop that it draws in joint space; glued joints run on continuously.
        clearances: ``(k,)``.
        length: Length of the path, in characteristic lengths and radians.
        verified: True where ``jk.track`` along the loop leads from ``start`` to ``goal``, over the poses of the path.
        encircled: Names of the cusp curves (or cusps, of two joints) that the loop is linked with; empty also where
            none was looked for: ``linking`` is None then.
        linking: Linking number with every cusp curve by name, None where it is not decided; None where not looked for.
        cusp_curves: The cusp curves around the loop, for drawings (no part of the JSON); None where not looked for.
        searched: The box of poses that was searched and at what resolution, by axis.
        evidence: What speaks for the result, by name.
        request: What determines the numbers.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
    """

    found: bool
    reason: str
    certain: bool
    start: np.ndarray
    goal: np.ndarray
    aspects: tuple[str, str]
    clearance: float
    poses: np.ndarray
    joints: np.ndarray
    clearances: np.ndarray
    length: float
    verified: bool
    encircled: tuple[str, ...]
    linking: dict[str, int | None] | None
    searched: dict[str, Any]
    evidence: dict[str, Any]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str] = field(default_factory=dict)
    cusp_curves: CuspCurves | None = None

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [
            f"mode change: {self.reason}",
            f"  from {coordinates(self.pose_names, self.start)}",
            f"  to   {coordinates(self.pose_names, self.goal)}",
        ]
        if self.found:
            lines.append(
                f"  {len(self.poses)} poses, length {self.length:.4g}, smallest clearance {self.clearance:.6g}, "
                + ("verified by tracking" if self.verified else "NOT VERIFIED")
            )
            lines.append(f"  {self._linked()}")
        elif not self.certain:
            lines.append("  no proof that there is none: a finer or larger grid may find one")
        if self.searched:
            lines.append("  searched: " + ", ".join(f"{name} {_range(value)}" for name, value in self.searched.items()))
        return "\n".join([*lines, *(f"  {name}: {value}" for name, value in self.evidence.items())])

    def _linked(self) -> str:
        if self.linking is None:
            return "cusp curves: not looked for (encircle=True)"
        open_ = [name for name, number in self.linking.items() if number is None]
        linked = ", ".join(f"{name} ({self.linking[name]:+d})" for name in self.encircled) or "none"
        return f"encircles: {linked}" + (f"; not decided: {', '.join(open_)}" if open_ else "")

    def to_json(self) -> str:
        """Returns everything as JSON text; an infinite or unknown clearance is null."""

        def finite(values: np.ndarray) -> list[float | None]:
            return [value if np.isfinite(value) else None for value in np.atleast_1d(values).tolist()]

        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "joint_axes": list(self.joint_names),
            "units": self.units,
            "found": self.found,
            "reason": self.reason,
            "certain": self.certain,
            "start": self.start.tolist(),
            "goal": self.goal.tolist(),
            "aspects": list(self.aspects),
            "clearance": finite(np.asarray(self.clearance))[0],
            "poses": self.poses.tolist(),
            "joints": self.joints.tolist(),
            "clearances": finite(self.clearances),
            "length": self.length,
            "verified": self.verified,
            "encircled": list(self.encircled),
            "linking": self.linking,
            "searched": self.searched,
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


def _range(value: Any) -> str:
    return f"{value[0]:.4g} .. {value[1]:.4g} in {value[2]}" if isinstance(value, list) else f"= {value:.6g}"
