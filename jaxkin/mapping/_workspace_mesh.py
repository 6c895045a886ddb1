"""The faces of a body between three pairs of spheres, as triangles whose edges are exact and shared.

In the squared lengths s_i = |p - q_i|^2 the half over the plane is convex: a box, cut by g(s) >= 0, where the square g
of the height is a concave quadratic. A face l_i = const is therefore the image of a convex region of the plane (s_j,
s_k), and meshed by rings around a point in it. Its edges are arcs of two kinds: of the circle in which two spheres
meet, and of the circle in which its own sphere meets the plane.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import Delaunay

from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping._isosurface import single_edges
from jaxkin.mapping._workspace_records import Volume, WorkspacePatch
from jaxkin.mapping.batch import in_blocks
from jaxkin.numerics import spheres
from jaxkin.numerics.spheres import Shells

#: Ends of edges closer than this share of the largest radius are one corner: a small height is a root of rounding.
_WELD = 1e-7
FLAT = "z = -h, singular"


class _Edge(NamedTuple):
    """An arc: centre, two orthonormal directions, radius, angles of its ends, and the faces (i, e) that it bounds."""

    centre: np.ndarray
    directions: np.ndarray
    radius: float
    ends: tuple[float, float]
    faces: tuple[tuple[int, int] | None, tuple[int, int] | None]

    @property
    def length(self) -> float:
        return self.radius * (self.ends[1] - self.ends[0])

    def points(self, segments: int) -> np.ndarray:
        angle = np.linspace(*self.ends, segments + 1)[:, None]
        return self.centre + self.radius * (np.cos(angle) * self.directions[0] + np.sin(angle) * self.directions[1])


def patches(
    robot: Mechanism, volume: Volume, shells: Shells, plane: float, sign: float, n: int
) -> tuple[WorkspacePatch, ...]:
    """Returns the faces of the workspace on one side of the plane.

    Args:
        robot: The mechanism, for names and residuals.
        volume: Its volume, with the areas of the faces.
        shells: The spheres, concrete.
        plane: z of their centres.
        sign: +1 for the side above, -1 for below.
        n: Segments of the longest edge.
    """
    sampled = _sampled([*_ridges(shells), *_rims(shells)], n, float(np.max(shells.high)))
    areas, found = np.asarray(volume.areas), []
    for i, axis in enumerate(robot.joint_axes):
        for e, end in enumerate(("min", "max")):
            around = [points for edge, points in sampled if (i, e) in edge.faces]
            mesh = _face(shells, i, e, np.concatenate(around), n) if around else None
            if mesh is not None:
                vertices, faces = _placed(*mesh, plane, sign)
                residual = _residual(robot, vertices, i, e)
                name = f"{axis.name} = {axis.name}_{end}"
                found.append(_patch(name, vertices, faces, float(areas[i, e]), residual))
    rims = [points for edge, points in sampled if None in edge.faces]
    if rims:
        vertices, faces = _placed(*_flat(rims), plane, sign)
        residual = float(np.max(np.abs(vertices[:, 2] - plane))) / float(robot.characteristic_length())
        found.append(_patch(FLAT, vertices, faces, float(volume.flat), residual))
    return tuple(found)


def _patch(name: str, vertices: np.ndarray, faces: np.ndarray, area: float, residual: float) -> WorkspacePatch:
    return WorkspacePatch(name, vertices, faces, area, residual, single_edges(faces), singular=name == FLAT)


def _placed(points: np.ndarray, faces: np.ndarray, plane: float, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Moves points over the plane to their side of it; a mirror image turns its triangles round."""
    vertices = points * [1.0, 1.0, sign] + [0.0, 0.0, plane]
    return vertices, faces if sign > 0 else faces[:, ::-1]


def _ridges(shells: Shells) -> list[_Edge]:
    """Returns the arcs over the plane in which two spheres meet, as far as the third length is within its limits."""
    found = []
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        along = shells.centres[j] - shells.centres[i]
        distance = float(np.hypot(*along))
        along = along / distance
        across = np.array([-along[1], along[0]])
        for e in range(2):
            for f in range(2):
                own, other = float((shells.low, shells.high)[e][i]), float((shells.low, shells.high)[f][j])
                offset = distance / 2 + (own - other) * (own + other) / (2 * distance)
                square = (own - offset) * (own + offset)
                if square <= 0:
                    continue
                radius, centre = math.sqrt(square), shells.centres[i] + offset * along
                away = centre - shells.centres[k]
                # The squared third length is linear in the cosine of the angle from the plane.
                middle, slope = float(away @ away) + square, 2 * radius * float(across @ away)
                cosines = sorted((float(r) ** 2 - middle) / slope for r in (shells.low[k], shells.high[k]))
                start, end = (math.acos(min(max(c, -1.0), 1.0)) for c in reversed(cosines))
                if end > start:
                    directions = np.array([[*across, 0.0], [0.0, 0.0, 1.0]])
                    found.append(_Edge(np.append(centre, 0.0), directions, radius, (start, end), ((i, e), (j, f))))
    return found


def _rims(shells: Shells) -> list[_Edge]:
    """Returns the arcs of circles in the plane that bound the body there."""
    arcs = jax.tree.map(np.asarray, spheres.arcs(Shells(*map(jnp.asarray, shells)), jnp.zeros(())))
    found = []
    for i, e, m in zip(*np.nonzero(arcs.length > 0), strict=True):
        start = float(arcs.start[i, e, m])
        ends = (start, start + float(arcs.length[i, e, m]))
        centre = np.append(shells.centres[i], 0.0)
        found.append(_Edge(centre, np.eye(2, 3), float(arcs.radius[i, e]), ends, ((int(i), int(e)), None)))
    return found


def _sampled(edges: list[_Edge], n: int, size: float) -> list[tuple[_Edge, np.ndarray]]:
    """Samples every edge once; ends that are one corner get the same coordinates."""
    longest = max((edge.length for edge in edges), default=0.0)
    corners: list[np.ndarray] = []

    def corner(point: np.ndarray) -> np.ndarray:
        for other in corners:
            if np.linalg.norm(other - point) <= _WELD * size:
                return other
        corners.append(point)
        return point

    sampled = []
    for edge in edges:
        turn = (edge.ends[1] - edge.ends[0]) / (2 * math.pi)
        points = edge.points(math.ceil(max(2.0, n * edge.length / longest, n * turn)))
        first, last = corner(points[0]), corner(points[-1])
        if first is not last:
            points[0], points[-1] = first, last
            sampled.append((edge, points))
    return sampled


def _face(shells: Shells, i: int, e: int, rim: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Meshes one face from the points of its boundary: rings in the plane of the other two squared lengths."""
    rim = np.unique(rim, axis=0)
    if len(rim) < 3:
        return None
    j, k = (i + 1) % 3, (i + 2) % 3
    squares = np.sum((rim[:, None] - np.pad(shells.centres, ((0, 0), (0, 1)))) ** 2, axis=-1)[:, [j, k]]
    centre = squares.mean(axis=0)
    # As wide as long, or the order by angle would suffer in thin faces.
    spread = np.linalg.svd((squares - centre) / np.sqrt(len(rim)), full_matrices=False)
    even = (squares - centre) @ spread[2].T / np.maximum(spread[1], 1e-12 * spread[1][0])
    order = np.argsort(np.arctan2(even[:, 1], even[:, 0]))
    rim, squares = rim[order], squares[order]
    rings = max(2, n // 2)
    share = 1 - (1 - np.arange(1, rings) / rings) ** 2
    inner = np.concatenate([centre[None], (centre + share[:, None, None] * (squares - centre)).reshape(-1, 2)])
    lengths = np.empty((len(inner), 3))
    lengths[:, i] = (shells.low, shells.high)[e][i]
    lengths[:, j], lengths[:, k] = np.sqrt(inner.T)
    points = np.concatenate([_points(shells, lengths), rim])
    faces = _rings(len(rim), rings)
    outward = (points - np.append(shells.centres[i], 0.0)) * (1.0 if e else -1.0)
    a, b, c = (points[faces[:, m]] for m in range(3))
    turned = np.sum(np.sum(np.cross(b - a, c - a) * outward[faces[:, 0]], axis=1)) < 0
    return points, faces[:, ::-1] if turned else faces


def _rings(around: int, rings: int) -> np.ndarray:
    """Returns the triangles between a centre (number 0) and rings of as many points each."""
    here = np.arange(around)
    there = (here + 1) % around
    faces = [np.stack([np.zeros_like(here), 1 + here, 1 + there], axis=1)]
    for ring in range(1, rings):
        low, high = 1 + (ring - 1) * around, 1 + ring * around
        faces.append(np.stack([low + here, high + here, high + there], axis=1))
        faces.append(np.stack([low + here, high + there, low + there], axis=1))
    return np.concatenate(faces)


def _points(shells: Shells, lengths: np.ndarray) -> np.ndarray:
    """Returns the points over the plane at given distances ``(k, 3)`` from the centres."""
    a, b = shells.centres[1] - shells.centres[0], shells.centres[2] - shells.centres[0]
    first = lengths[:, :1]
    rest = (first - lengths[:, 1:]) * (first + lengths[:, 1:])
    g = (np.array([a @ a, b @ b]) + rest) / 2
    away = np.linalg.solve(np.stack([a, b]), g.T).T
    far = np.linalg.norm(away, axis=1)
    height = np.sqrt(np.maximum((lengths[:, 0] - far) * (lengths[:, 0] + far), 0.0))
    return np.column_stack([shells.centres[0] + away, height])


def _flat(rims: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Meshes the part of the plane between arcs, from their points alone.

    A chord between neighbours on a circle is an edge of the Delaunay triangulation of all points, as no point lies
    inside a small disc or outside a large one. What lies in an odd number of turns of the boundary is kept.
    """
    points, number = np.unique(np.concatenate(rims), axis=0, return_inverse=True)
    places = np.split(number.reshape(-1), np.cumsum([len(rim) for rim in rims])[:-1])
    edges = np.concatenate([np.stack([place[:-1], place[1:]], axis=1) for place in places])
    plane = points[:, :2]
    faces = Delaunay(plane - plane.mean(axis=0)).simplices
    a, b, c = (plane[faces[:, k]] for k in range(3))
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    # Seen from outside the body, that is, from below.
    faces = np.where((doubled > 0)[:, None], faces[:, ::-1], faces)[doubled != 0]
    return points, faces[_inside(plane[faces].mean(axis=1), plane[edges])]


def _inside(points: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """True where a ray from the point in the direction of x crosses an odd number of edges ``(m, 2, 2)``."""
    inside = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in edges:
        if y0 != y1:
            spans = (points[:, 1] < y0) != (points[:, 1] < y1)
            inside ^= spans & (points[:, 0] < x0 + (points[:, 1] - y0) * (x1 - x0) / (y1 - y0))
    return inside


@jax.jit
def _residuals(robot: Mechanism, poses: jax.Array, which: jax.Array, end: jax.Array) -> jax.Array:
    def one(pose: jax.Array, i: jax.Array, e: jax.Array) -> jax.Array:
        assert robot.inverse_kernel is not None
        limits = robot.limit_values()
        joints = jnp.stack(robot.inverse_kernel(tuple(pose))[0].values)
        joints = joints.at[i].set(jnp.where(e > 0, limits.high[i], limits.low[i]))
        return jnp.max(jnp.abs(robot.constraints(pose, joints)) / robot.constraint_scales(pose, joints))

    return jax.vmap(one)(poses, which, end)


def _residual(robot: Mechanism, vertices: np.ndarray, i: int, e: int) -> float:
    """Returns the largest residual of the constraints with joint i at its limit, the others as the pose gives."""
    columns = np.full(len(vertices), i), np.full(len(vertices), e)
    return float(in_blocks(lambda *some: _residuals(robot, *some), vertices, *columns, block=1 << 12).max())
