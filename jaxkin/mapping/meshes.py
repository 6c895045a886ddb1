"""What singular surfaces are made of: triangles, glued faces, crossing curves."""

import json
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from jaxkin.mapping import _isosurface
from jaxkin.mapping.named import NamedParts


@dataclass(frozen=True, eq=False)
class Surface:
    """One singular surface, as triangles between polished poses.

    Attributes:
        name: Factor of the determinant that vanishes here, or ``"det"``, or ``"det, working mode k"``.
        vertices: ``(k, n_pose)`` poses; angles run from end to end of the box and are not wrapped.
        faces: ``(m, 3)`` vertex numbers.
        residual: Largest dimensionless residual of the vertices, see ``singular_surfaces``.
        seam: ``(n, 2)`` vertex on the low face of a glued axis, and the same pose on the high face.
        boundary: ``(b, 2)`` the edges that only one triangle has, on a face of the box (glued ones included) or
            around a hole.
        unpolished: Number of vertices that did not converge; they were dropped with their triangles.
        joints: ``(k, n_joint)`` joints of the vertices, angles in [-pi, pi), in the surface's working mode, or in the
            first one where a factor vanishes in all; NaN where a leg does not reach. On the two vertices of a seam
            pair they are the same.
    """

    name: str
    vertices: np.ndarray
    faces: np.ndarray
    residual: float
    seam: np.ndarray
    boundary: np.ndarray
    unpolished: int = 0
    joints: np.ndarray | None = None

    @property
    def components(self) -> int:
        """Number of connected pieces, with glued faces glued."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        links, size = np.concatenate([_isosurface.all_edges(self.faces), self.seam]), len(self.vertices)
        if not size:
            return 0
        graph = coo_matrix((np.ones(len(links), bool), (links[:, 0], links[:, 1])), shape=(size, size))
        return int(connected_components(graph, directed=False, return_labels=False))


@dataclass(frozen=True, eq=False)
class CrossingCurve:
    """The curve in which two singular surfaces cross: both factors vanish.

    Attributes:
        names: The two factors.
        poses: ``(k, n_pose)`` polished poses, ascending in the last free axis of the box.
        segments: ``(n, 2)`` numbers of neighbouring poses.
        residual: Largest dimensionless residual of the two factors.
    """

    names: tuple[str, str]
    poses: np.ndarray
    segments: np.ndarray
    residual: float


@dataclass(frozen=True, eq=False)
class SingularSurfaces(NamedParts[Surface]):
    """All singular surfaces in a box of the workspace.

    Attributes:
        surfaces: One per factor, or per working mode; those that do not meet the box are left out, those of which no
            vertex converged are empty.
        crossings: Where two factors vanish together.
        request: What determines the numbers: mechanism, geometry, box.
        pose_names: Names of the pose axes.
        units: Unit of every pose axis.
        glued: Names of the axes whose low and high face are the same.
        joint_names: Names of the joint axes.
    """

    surfaces: tuple[Surface, ...]
    crossings: tuple[CrossingCurve, ...]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    units: dict[str, str]
    glued: tuple[str, ...]
    joint_names: tuple[str, ...] = ()

    kind: ClassVar[str] = "surfaces"

    @property
    def parts(self) -> tuple[Surface, ...]:
        """The surfaces."""
        return self.surfaces

    @property
    def residual(self) -> float:
        """Largest dimensionless residual of all vertices."""
        return max((surface.residual for surface in self.surfaces), default=0.0)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the three free axes."""
        return tuple(name for name, value in self.request["box"].items() if isinstance(value, list))

    def __str__(self) -> str:
        """A summary of a few lines."""
        glued = f", {', '.join(self.glued)} glued" if self.glued else ""
        lines = [f"{len(self)} singular surfaces over {', '.join(self.free)}{glued}, residual {self.residual:.1e}"]
        for s in self.surfaces:
            pieces = f"{s.components} piece" + ("s" if s.components != 1 else "")
            lost = f", {s.unpolished} vertices dropped" if s.unpolished else ""
            lines.append(f"  {s.name}: {pieces}, {len(s.vertices)} vertices, {len(s.faces)} triangles{lost}")
        lines += [f"  {' = '.join(c.names)} = 0: {len(c.poses)} poses" for c in self.crossings]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "joint_axes": list(self.joint_names),
            "units": self.units,
            "glued": list(self.glued),
            "surfaces": [_plain(surface) for surface in self.surfaces],
            "crossings": [_plain(crossing) for crossing in self.crossings],
        }
        return json.dumps(content, indent=2)


def _plain(record: Any) -> dict[str, Any]:
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(record).items()}
