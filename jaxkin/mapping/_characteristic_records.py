"""What characteristic curves and surfaces are made of, and how they are summed up."""

import json
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from jaxkin.mapping import _isosurface
from jaxkin.mapping.meshes import SingularSurfaces
from jaxkin.mapping.named import NamedParts
from jaxkin.mapping.records import Curve, SingularCurves


@dataclass(frozen=True, eq=False)
class CharacteristicCurve:
    """Regular poses that share their joints with a singular curve: one assembly mode along it.

    Attributes:
        name: Aspect's sign, source and number, for instance ``"det > 0, over f1, 2"``.
        joints: ``(k, n_joint)`` joint values, those of the source.
        poses: ``(k, n_pose)``, angles in [-pi, pi).
        sign: Sign of det dF/dpose, the same all along.
        working_mode: Signs of the entries of B; empty where working modes are no sign vectors.
        kind: ``"singular"`` (det A = 0 at the source) or ``"serial"`` (a leg stretched or folded there).
        source: Number of the source in ``.singular`` or in ``.serial`` of the whole result.
        closed: True where the last point is followed by the first (which is not repeated).
        residual: Largest dimensionless residual of the constraints at the poses.
        ends: What it ends on: ``"cusp"`` (the mode merges with the source), ``"crossing"`` (the same, where the
            singular set crosses itself), ``"singular curve"`` (it folds with another mode), what the source ends on,
            or ``"unknown"``; two empty texts where closed.
    """

    name: str
    joints: np.ndarray
    poses: np.ndarray
    sign: int
    working_mode: tuple[int, ...]
    kind: str
    source: int
    closed: bool
    residual: float
    ends: tuple[str, str]

    def __len__(self) -> int:
        """Number of points."""
        return len(self.poses)


@dataclass(frozen=True, eq=False)
class CharacteristicCurves(NamedParts[CharacteristicCurve]):
    """The characteristic curves over a section of the joint space.

    Attributes:
        curves: The curves, by source, longest first.
        singular: The singular curves over which they lie.
        serial: Curves of poses with a stretched or folded leg, where working modes meet.
        request: What determines the numbers: mechanism, geometry, section, boundary.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for completeness, by name.
    """

    curves: tuple[CharacteristicCurve, ...]
    singular: SingularCurves
    serial: tuple[Curve, ...]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)

    kind: ClassVar[str] = "characteristic curves"

    @property
    def parts(self) -> tuple[CharacteristicCurve, ...]:
        """The curves."""
        return self.curves

    @property
    def residual(self) -> float:
        """Largest dimensionless residual of all points."""
        return max((curve.residual for curve in self.curves), default=0.0)

    @property
    def complete(self) -> bool:
        """False where a curve ends on nothing known or the searches disagree: see ``evidence``. True is no proof."""
        doubtful = ("ends on nothing that is known", "disagreements about stretched legs")
        return self.singular.complete and not any(self.evidence.get(name) for name in doubtful)

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [
            f"{len(self)} characteristic curves over {len(self.singular)} singular and {len(self.serial)} serial "
            f"curves, {sum(map(len, self.curves))} points, residual {self.residual:.1e}"
        ]
        lines += [
            f"  {curve.name}: {len(curve)} points, "
            + ("closed" if curve.closed else f"from {curve.ends[0]} to {curve.ends[1]}")
            for curve in self.curves
        ]
        lines += [f"  {name}: {value}" for name, value in self.evidence.items()]
        return "\n".join(lines if self.complete else [*lines, "  DOUBTFUL: see the evidence"])

    def to_json(self) -> str:
        """Returns everything but the sources as JSON text."""
        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "joint_axes": list(self.joint_names),
            "units": self.units,
            "curves": [plain_record(curve) for curve in self.curves],
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


@dataclass(frozen=True, eq=False)
class CharacteristicSurface:
    """Regular poses that share their joints with a singular surface, as triangles: one aspect's, of one source.

    Attributes:
        name: Aspect's sign and source, for instance ``"det > 0, over f1"``.
        vertices: ``(k, n_pose)`` poses; a triangle that lies over a glued end stands at both, its angles run on there.
        faces: ``(m, 3)`` vertex numbers.
        joints: ``(k, n_joint)``.
        sign: Sign of det dF/dpose.
        working_mode: Signs of the entries of B; empty where working modes are no sign vectors.
        source: Number of the singular surface.
        residual: Largest dimensionless residual of the constraints at the vertices.
        boundary: ``(b, 2)`` the edges that only one triangle has: cusps, other folds, the box.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    joints: np.ndarray
    sign: int
    working_mode: tuple[int, ...]
    source: int
    residual: float
    boundary: np.ndarray

    @property
    def components(self) -> int:
        """Number of connected pieces; those over a glued end count as apart."""
        from jaxkin.mapping._lifts import union

        labels = union(len(self.vertices), _isosurface.all_edges(self.faces))
        return int(labels.max() + 1) if len(labels) else 0


@dataclass(frozen=True, eq=False)
class CharacteristicSurfaces(NamedParts[CharacteristicSurface]):
    """The characteristic surfaces in a box of the workspace.

    Attributes:
        surfaces: One per source, sign of the determinant and working mode, where there is any.
        singular: The singular surfaces with which they share their joints.
        request: What determines the numbers: mechanism, geometry, box.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: How many triangles were lifted and dropped, by name.
    """

    surfaces: tuple[CharacteristicSurface, ...]
    singular: SingularSurfaces
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)

    kind: ClassVar[str] = "characteristic surfaces"

    @property
    def parts(self) -> tuple[CharacteristicSurface, ...]:
        """The surfaces."""
        return self.surfaces

    @property
    def residual(self) -> float:
        """Largest dimensionless residual of all vertices."""
        return max((surface.residual for surface in self.surfaces), default=0.0)

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [f"{len(self)} characteristic surfaces, residual {self.residual:.1e}"]
        lines += [f"  {s.name}: {len(s.vertices)} vertices, {len(s.faces)} triangles" for s in self.surfaces]
        return "\n".join([*lines, *(f"  {name}: {value}" for name, value in self.evidence.items())])

    def to_json(self) -> str:
        """Returns everything but the sources as JSON text."""
        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "joint_axes": list(self.joint_names),
            "units": self.units,
            "surfaces": [plain_record(surface) for surface in self.surfaces],
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


def plain_record(record: Any) -> dict[str, Any]:
    """Returns a record's fields with arrays as lists, for JSON."""
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(record).items()}


def sign_text(sign: int, working_mode: tuple[int, ...], several: bool) -> str:
    """Names an aspect by its sign of the determinant and, where there are several, by its working mode."""
    text = f"det {'>' if sign > 0 else '<'} 0"
    return f"{text}, mode {''.join('+' if s > 0 else '-' for s in working_mode)}" if several and working_mode else text
