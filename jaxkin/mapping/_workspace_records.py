"""What is found out about a workspace: its volume, its boundary as patches, and what other conditions leave of it."""

import json
from dataclasses import dataclass, field
from typing import Any, ClassVar

import jax
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import identity
from jaxkin.core.tracing import is_traced
from jaxkin.mapping.named import NamedParts


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Volume:
    """The volume of one branch of a workspace; a pytree, so that it goes through ``jit``, ``vmap`` and ``grad``.

    Attributes:
        volume: In the cube of the robot's unit of length. NaN for a bad geometry inside ``jit``.
        error: Estimated error: the difference between two numbers of points, and a bound of the rounding.
        coarse: The value with half the points in every interval of heights.
        touches: True where the workspace is bounded by the singular plane too, in which both branches meet.
        areas: ``(n, 2)`` areas of the spherical patches l_i = l_i_min and l_i = l_i_max, by the same integration.
        flat: Area of the piece of the singular plane that bounds the workspace; 0 where it does not touch it.
        robot: The mechanism.
        branch: ``"upper"`` or ``"lower"``.
    """

    volume: Array
    error: Array
    coarse: Array
    touches: Array
    areas: Array
    flat: Array
    robot: Mechanism
    branch: str = field(metadata={"static": True})

    def _plain(self) -> bool:
        return not is_traced(self.volume) and np.ndim(self.volume) == 0

    def __str__(self) -> str:
        """A summary of a few lines."""
        unit = self.robot.pose_axes[0].unit
        if not self._plain():
            return f"Volume of the {self.branch} branch, {unit}^3 (batched or traced, shape {np.shape(self.volume)})"
        where = "meets the singular plane" if self.touches else "clear of the singular plane"
        return "\n".join(
            [
                f"{float(self.volume):.12g} {unit}^3, estimated error {float(self.error):.1e} {unit}^3",
                f"  {self.branch} branch of {self.robot}, strokes only; {where}",
                f"  boundary: {float(self.areas.sum()) + float(self.flat):.12g} {unit}^2",
            ]
        )

    def to_json(self) -> str:
        """Returns everything as JSON text (not inside ``jit``, and of one robot)."""
        content = {
            "request": {**identity(self.robot), "branch": self.branch, "result": "workspace_volume"},
            "unit": self.robot.pose_axes[0].unit,
            **{
                name: np.asarray(getattr(self, name)).tolist()
                for name in ("volume", "error", "coarse", "touches", "areas", "flat")
            },
        }
        return json.dumps(content, indent=2)


@dataclass(frozen=True, eq=False)
class WorkspacePatch:
    """One face of a workspace's boundary, as triangles.

    Attributes:
        name: The limit that is reached here, for instance ``"l1 = l1_min"``; ``"z = -h, singular"`` is the flat piece
            in which the two branches meet.
        vertices: ``(k, 3)`` poses on the face; those on a common edge of two patches are the same numbers in both.
        faces: ``(m, 3)`` vertex numbers, counterclockwise seen from outside the workspace.
        area: Area of the face itself, not of its triangles, by integration.
        residual: Largest dimensionless residual of the constraints at the vertices, for the joints of this face.
        boundary: ``(b, 2)`` vertex numbers: the edges that only one triangle has, shared with other patches.
        singular: True for the flat piece.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    area: float
    residual: float
    boundary: np.ndarray
    singular: bool = False

    @property
    def mesh_area(self) -> float:
        """Area of the triangles."""
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@dataclass(frozen=True, eq=False)
class WorkspaceSurfaces(NamedParts[WorkspacePatch]):
    """The boundary of one branch of a workspace.

    Attributes:
        patches: Up to six faces l_i = l_i_min and l_i = l_i_max, those first that are limits of the first joint; then
            the flat piece of the singular plane, if the workspace reaches it.
        branch: ``"upper"`` or ``"lower"``.
        volume: Volume of the workspace, by integration.
        request: What determines the numbers: mechanism, geometry, branch, points an edge.
        pose_names: Names of the pose axes.
        units: Unit of every pose axis.
    """

    patches: tuple[WorkspacePatch, ...]
    branch: str
    volume: float
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    units: dict[str, str]

    kind: ClassVar[str] = "patches"

    @property
    def parts(self) -> tuple[WorkspacePatch, ...]:
        """The patches."""
        return self.patches

    @property
    def area(self) -> float:
        """Area of the whole boundary."""
        return sum(patch.area for patch in self.patches)

    @property
    def residual(self) -> float:
        """Largest dimensionless residual of all vertices."""
        return max((patch.residual for patch in self.patches), default=0.0)

    @property
    def mesh_volume(self) -> float:
        """Volume enclosed by the triangles (divergence theorem); tends to ``volume`` with finer meshes."""
        total, origin = 0.0, self.patches[0].vertices[0] if self.patches else np.zeros(3)
        for patch in self.patches:
            a, b, c = (patch.vertices[patch.faces[:, k]] - origin for k in range(3))
            total += float(np.sum(a * np.cross(b, c))) / 6
        return total

    @property
    def open_edges(self) -> int:
        """Number of edges that do not belong to two triangles, equal vertices of patches being one; 0 is closed."""
        vertices = np.concatenate([p.vertices for p in self.patches] or [np.zeros((0, 3))])
        starts = np.cumsum([0, *(len(p.vertices) for p in self.patches)])
        edges = [p.boundary + start for p, start in zip(self.patches, starts, strict=False)]
        same = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)
        joined = np.sort(same[np.concatenate(edges or [np.zeros((0, 2), int)])], axis=1)
        return int(np.sum(np.unique(joined, axis=0, return_counts=True)[1] != 2))

    def __str__(self) -> str:
        """A summary of a few lines."""
        unit = self.units[self.pose_names[0]]
        lines = [
            f"Boundary of the {self.branch} branch: {len(self)} patches, {self.area:.9g} {unit}^2 around "
            f"{self.volume:.9g} {unit}^3, residual {self.residual:.1e}, {self.open_edges or 'no'} open edges"
        ]
        lines += [
            f"  {p.name}: {p.area:.9g} {unit}^2, {len(p.vertices)} vertices, {len(p.faces)} triangles" for p in self
        ]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "units": self.units,
            "volume": self.volume,
            "patches": [
                {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(p).items()}
                for p in self.patches
            ],
        }
        return json.dumps(content, indent=2)


@dataclass(frozen=True, eq=False)
class FreeVolume:
    """What is left of one branch of a workspace where every margin of the robot is positive [ours].

    Attributes:
        volume: Volume in which all margins are positive.
        error: Estimated error: twice ``sampling``, ``resolution``, and the volume of one sample, below which nothing is
            seen.
        sampling: Standard error of the mean over the random shifts of the lattice.
        resolution: Volume of pieces, free or not, that lie between two samples of a column, as those that are met by
            one tell of them. It is taken into account.
        workspace: Volume for the strokes alone, of which the rest is left.
        violated: Per condition that is violated somewhere, the share of the removed volume in which it is. Several may
            be violated at once, so the shares need not add up to 1.
        alone: Per condition, the share of the removed volume in which it is the only one that is violated.
        converged: True where the error is within the tolerance.
        columns: Columns through the workspace, in all shifts.
        samples: Poses whose margins were computed.
        branch: ``"upper"`` or ``"lower"``.
        unit: Unit of length.
        request: What determines the numbers: mechanism, geometry, branch, tolerance, seed.
    """

    volume: float
    error: float
    sampling: float
    resolution: float
    workspace: float
    violated: dict[str, float]
    alone: dict[str, float]
    converged: bool
    columns: int
    samples: int
    branch: str
    unit: str
    request: dict[str, Any]

    @property
    def share(self) -> float:
        """The free share of the workspace."""
        return self.volume / self.workspace if self.workspace else 0.0

    def __str__(self) -> str:
        """A summary of a few lines."""
        doubt = "" if self.converged else "; the tolerance was NOT reached"
        lines = [
            f"{self.volume:.6g} {self.unit}^3 free, estimated error {self.error:.1e} {self.unit}^3{doubt}",
            f"  {100 * self.share:.4g} % of the {self.branch} branch, whose strokes alone allow {self.workspace:.9g} "
            f"{self.unit}^3",
        ]
        lines += [
            f"  {name}: violated in {100 * value:.3g} % of what is removed, alone in {100 * self.alone[name]:.3g} %"
            for name, value in sorted(self.violated.items(), key=lambda item: -item[1])
        ]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        return json.dumps(vars(self), indent=2)
