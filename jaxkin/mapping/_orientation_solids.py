"""Closed solids of the 3-PPPS as triangles, from exact descriptions: its aspects in two charts, its joint region."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, concrete_reals
from jaxkin.kinematics.boundary import checked_single
from jaxkin.mapping._orientation_factors import checked_concrete
from jaxkin.mapping._orientation_records import CHART, Solid
from jaxkin.mechanisms import ppps3_closed_forms as closed
from jaxkin.mechanisms.ppps3 import PPPS3
from jaxkin.numerics import rotations

_RIGHT = math.pi / 2
_NAMES = ("R22", "R33", CHART)
#: Vertices closer than this are one: different patches compute those that they share a rounding apart.
_WELD = 1e-9


def aspect_solid(robot: Mechanism, label: str = "home", chart: str = "xyz", n: int = 16) -> Solid:
    """Returns an aspect of the 3-PPPS as a closed solid in a chart of the orientations, after Fig. 3.

    The faces lie on R22 = 0, on R33 = 0, and where the chart ends (theta = +-pi/2, or beta = +-pi/2), which is no
    surface of rotations. Every vertex is exact. Shape and volume belong to the chart: it is pi^3 in both, and in the
    chart Z-X-Y the aspect is a cube. What the robot has is the share of all rotations, see ``orientation_aspects``.

    In the chart X-Y-Z the solid has the height pi in sigma over the whole square of phi and theta. So its volume is
    pi^3 for every n, while its shape approaches the true one like 1/n^2. It is torn at phi = +-pi/2, theta = 0, where
    an edge stands upright; the mesh is a fan around it.

    Args:
        robot: A 3-PPPS; side and limits play no part.
        label: One of ``robot.forward_labels``, for instance ``"R22 > 0, R33 > 0"``, or ``"home"``, which is this one.
        chart: ``"xyz"`` for (phi, theta, sigma), as in the paper, or ``"zxy"`` for (alpha, beta, gamma) with
            R = Rz(alpha) Rx(beta) Ry(gamma) [ours].
        n: Steps of the mesh along pi/2 (X-Y-Z) or along pi (Z-X-Y), about.

    Raises:
        InputError: Not one 3-PPPS, or an unknown label or chart, or n is smaller than 2.

    References:
        Chablat, Baron, Jha and Rolland 2018, Fig. 3: the home aspect in the chart X-Y-Z.
    """
    ppps3 = checked_ppps3("jk.aspect_solid", robot)
    number = _number(ppps3, label)
    steps = _steps(n)
    if chart == "xyz":
        mesh, axes = _xyz_mesh(steps), ("phi", "theta", "sigma")
    elif chart == "zxy":
        mesh, axes = _cube_mesh(steps), ("alpha", "beta", "gamma")
    else:
        raise InputError(f"chart is {chart!r}: it must be 'xyz' (phi, theta, sigma) or 'zxy' (alpha, beta, gamma).")
    # The other aspects are translates, see the closed forms; phi changes both signs.
    r22, r33 = closed.SIGNS[number]
    shift = (r33 < 0, False, r22 != r33) if chart == "xyz" else (r22 < 0, False, r33 < 0)
    vertices = mesh.vertices + math.pi * np.array(shift, float)
    return Solid(
        label=ppps3.forward_labels[number],
        chart=chart,
        axes=axes,
        units=("rad", "rad", "rad"),
        vertices=vertices,
        faces=mesh.faces,
        names=_NAMES,
        patch=mesh.patch,
        residual=_residual(chart, vertices, mesh),
    )


def joint_solid(robot: Mechanism, n: int = 16) -> Solid:
    """Returns the joints (mu2z, mu3y, mu3z) with four assembly modes as a closed solid [ours].

    It is convex, bounded by two elliptic cylinders, R22 = 0 and R33 = 0; outside there is no assembly mode. All four
    aspects are mapped onto it. Its volume is 8 / sqrt3 s^3, see ``ppps3_closed_forms.joints_volume``.

    Args:
        robot: A 3-PPPS.
        n: Steps of the mesh along each angle of the parametrisation.

    Raises:
        InputError: Not one 3-PPPS, or n is smaller than 2.
    """
    ppps3 = checked_ppps3("jk.joint_solid", robot)
    cube = _cube_mesh(_steps(n))
    joints = np.asarray(closed.joints_from_zxy(ppps3, *cube.vertices.T))
    side = float(ppps3.side)
    outward = cube.faces if _signed_volume(joints, cube.faces) > 0 else cube.faces[:, ::-1]
    mesh = _welded(joints / side, outward, cube.patch)
    a, b = (np.abs(np.asarray(value)) for value in closed.feasibility(ppps3, mesh.vertices * side))
    residual = max(float(b[mesh.faces[mesh.patch == 0]].max()), float(a[mesh.faces[mesh.patch == 1]].max()))
    return Solid(
        label="four assembly modes",
        chart="joints",
        axes=("mu2z", "mu3y", "mu3z"),
        units=("length", "length", "length"),
        vertices=mesh.vertices * side,
        faces=mesh.faces,
        names=_NAMES[:2],
        patch=mesh.patch,
        residual=residual,
    )


def checked_ppps3(who: str, robot: Mechanism) -> PPPS3:
    """Returns the robot if it is one concrete 3-PPPS, whose closed forms are known here."""
    checked_single(who, robot)
    if not isinstance(robot, PPPS3):
        raise InputError(
            f"{who} got a {type(robot).__name__}: its closed forms are those of the 3-PPPS; pass "
            "jk.mechanisms.ppps3.create(), or find surfaces with jk.singular_surfaces."
        )
    return robot


def _number(robot: PPPS3, label: str) -> int:
    labels = ("home", *robot.forward_labels)
    if label not in labels:
        raise InputError(f"label is {label!r}: the aspects are {', '.join(map(repr, labels))}; give one of them.")
    return max(labels.index(label) - 1, 0)


def _steps(n: int) -> int:
    checked_concrete("A mesh", n=n)
    number = concrete_reals(n)
    if number is None or number.shape != () or not np.isfinite(number) or not 2 <= float(number) == int(number):
        raise InputError(f"n is {n!r}: a mesh needs at least 2 steps; give a whole number, 16 for instance.")
    return int(number)


class _Mesh(NamedTuple):
    vertices: np.ndarray
    faces: np.ndarray
    patch: np.ndarray


def _sheet(points: np.ndarray, patch: int, flip: bool, turned: int | None = None) -> _Mesh:
    """Returns a sheet of points ``(a, b, 3)`` as triangles; from column ``turned`` on with the other diagonal."""
    a, b = points.shape[:2]
    number = np.arange(a * b).reshape(a, b)
    p, q, r, s = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    one = (np.arange(b - 1) < (b if turned is None else turned))[:, None, None]
    corners = np.where(one, _pairs(p, q, r, s), _pairs(q, r, s, p)).reshape(-1, 3)
    return _Mesh(points.reshape(-1, 3), corners[:, ::-1] if flip else corners, np.full(len(corners), patch))


def _pairs(p: np.ndarray, q: np.ndarray, r: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Returns the two triangles of squares p q r s on either side of the diagonal p r."""
    return np.stack([np.stack([p, q, r], axis=-1), np.stack([p, r, s], axis=-1)], axis=-2)


def _joined(sheets: list[_Mesh]) -> _Mesh:
    offsets = np.cumsum([0, *(len(sheet.vertices) for sheet in sheets)])
    return _welded(
        np.concatenate([sheet.vertices for sheet in sheets]),
        np.concatenate([sheet.faces + offset for sheet, offset in zip(sheets, offsets, strict=False)]),
        np.concatenate([sheet.patch for sheet in sheets]),
    )


def _welded(vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray) -> _Mesh:
    """Makes one of vertices at one place, and drops the triangles that are no longer any."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    pairs = KDTree(vertices).query_pairs(_WELD, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(vertices),) * 2)
    group = connected_components(graph, directed=False)[1]
    first = np.unique(group, return_index=True)[1]
    faces = group[faces]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return _Mesh(vertices[first], faces[proper], patch[proper])


def _signed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)))


def _cube_mesh(n: int) -> _Mesh:
    """Returns the cube (-pi/2, pi/2)^3 of the home aspect in the chart Z-X-Y."""
    ticks = _RIGHT * np.linspace(-1.0, 1.0, n + 1)
    one, two = np.meshgrid(ticks, ticks, indexing="ij")
    sheets = []
    for axis, patch in ((0, 0), (1, 2), (2, 1)):
        for side in (1.0, -1.0):
            points = np.empty((n + 1, n + 1, 3))
            points[..., axis], points[..., (axis + 1) % 3], points[..., (axis + 2) % 3] = side * _RIGHT, one, two
            sheets.append(_sheet(points, patch, flip=side < 0))
    return _joined(sheets)


def _xyz_mesh(n: int) -> _Mesh:
    """Returns the home aspect in the chart X-Y-Z: the half phi > 0, and the same turned about the sigma axis."""
    half = _half_sheets(n)
    turned = [_Mesh(sheet.vertices * (-1.0, -1.0, 1.0), sheet.faces, sheet.patch) for sheet in half]
    return _joined(half + turned)


def _half_sheets(n: int) -> list[_Mesh]:
    """Returns the sheets of the half phi > 0: lid, floor, and the three walls.

    In the plane of phi and theta the half is a rectangle, seen as rays from the middle (pi/2, 0) of its side phi = pi/2
    to the other three sides. On each ray delta has a limit at that point, so the upright edge there is the row r = 0.
    """
    ticks = np.linspace(0.0, _RIGHT, n + 1)
    whole = np.concatenate([-ticks[:0:-1], ticks])
    # Along theta = -pi/2 away from phi = pi/2, along phi = 0, and back along theta = pi/2.
    u = np.concatenate([ticks, np.full(2 * n - 1, _RIGHT), ticks[::-1]])
    theta = np.concatenate([np.full(n, -_RIGHT), whole, np.full(n, _RIGHT)])
    r = np.linspace(0.0, 1.0, n + 1)[:, None]
    phi, theta = _RIGHT - r * u, r * theta
    delta = -np.arctan2(theta[-1], u)[None].repeat(n + 1, axis=0)
    delta[1:] = np.asarray(closed.home_interval(phi[1:], theta[1:])[1]) - _RIGHT
    lid, floor = (np.stack([phi, theta, delta + end], axis=-1) for end in (_RIGHT, -_RIGHT))
    # The levels of the walls are those of the upright edge, so that they meet it in vertices.
    level = math.pi * np.sort(0.5 + delta[0] / math.pi)
    level[[0, -1]] = 0.0, math.pi
    # At (pi/2, 0, +-pi) lid and wall meet in a knife's edge; with these diagonals no triangle of one lies in the other.
    sheets = [_sheet(lid, 0, True, 2 * n), _sheet(floor, 0, False, 2 * n)]
    for column, patch, flip, turned in (
        (floor[:, 0], 1, True, 0),
        (floor[:, -1], 1, False, None),
        (floor[-1, : n + 1], 2, True, None),
        (floor[-1, -n - 1 :], 2, True, None),
    ):
        points = np.repeat(column[:, None], len(level), axis=1)
        points[..., 2] += level
        sheets.append(_sheet(points, patch, flip, turned))
    return sheets


def _residual(chart: str, vertices: np.ndarray, mesh: _Mesh) -> float:
    """Returns the largest |R22| on the patch R22 = 0 and |R33| on R33 = 0."""
    turn = rotations.matrix_from_xyz if chart == "xyz" else rotations.matrix_from_zxy
    m = jax.jit(turn)(*jnp.asarray(vertices).T)
    values = np.abs(np.stack([m[1][1], m[2][2]]))
    return max(float(values[k][mesh.faces[mesh.patch == k]].max()) for k in (0, 1))
