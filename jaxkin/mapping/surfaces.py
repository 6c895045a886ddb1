"""Singular surfaces of the workspace: where the direct determinant vanishes, as polished triangles."""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Axis, Mechanism
from jaxkin.core.precision import TOLERANCES
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.kinematics.legs import Legs, legs_of
from jaxkin.mapping import _isosurface
from jaxkin.mapping._surface_crossings import crossings
from jaxkin.mapping._surface_functions import (
    FACTORS,
    LANES,
    LEGS,
    SERIAL,
    Functions,
    edge_zeros,
    joints_of,
    residuals,
    rows_in_blocks,
    values,
    volumes,
)
from jaxkin.mapping.chart import tells_factors
from jaxkin.mapping.meshes import CrossingCurve, SingularSurfaces, Surface
from jaxkin.sweep.grid import BoundGrid, Grid, Span

_WHO = "jk.singular_surfaces"
#: Nodes whose poses are listed at a time, so that they take less memory than the values.
_SLAB = 1 << 19
#: Inner nodes are moved by this irrational share of a step: no node lies in a plane of symmetry, where factors vanish.
_SHIFT = (math.sqrt(5) - 2) / 2
#: So far, in steps, nodes stay from where the angles of a pose are singular.
_EDGE = 1e-6
#: Samples that tell whether a determinant vanishes everywhere.
_PROBES = 1 << 12


def singular_surfaces(robot: Mechanism, box: Grid, *, kind: str = "parallel") -> SingularSurfaces:
    """Finds the surfaces of the workspace on which the mechanism is singular.

    Parallel singularities (type 2, det dF/dpose = 0): a mechanism that declares factors of the determinant (a method
    ``factors(pose) -> dict``) has one surface per factor, whatever its joint limits. Any other has one per working
    mode, along its closed inverse kinematics or, without one, along its legs where every equation holds one joint;
    where a working mode does not exist, or violates the joint limits, the surface has a hole.

    Serial singularities (type 1, det dF/djoints = 0), kind "serial": one surface for every leg that can be stretched
    or folded, whatever the joint limits, with a hole where another leg does not reach.

    Marching cubes finds the triangles, and every vertex is then moved along the grid edge on which the sign changes,
    until it satisfies the equation to the last digits. The box only seeds: pieces smaller than its cells may be
    missed, and a factor that vanishes without a change of sign (a double surface) is not seen.

    Dimensionless residuals, at most 1e-12 at every vertex: of a determinant, with every equation divided by
    ``robot.constraint_scales`` and every length by the characteristic length L; of a factor f, |f| over the sum of
    |s df/dx| and |s^2 d^2f/dx^2| over the pose axes x, where s = L + |x| for lengths and 1 rad for angles.

    Args:
        robot: The mechanism.
        box: Grid over the pose axes, three of them free, for instance
            ``jk.Grid(x=(-3, 3, 60), y=(-3, 3, 60), phi=(-math.pi, math.pi, 72))``. Both ends are sampled. An angle
            that spans its whole period is glued: each surface names the vertices that are the same on both faces.
        kind: ``"parallel"``, ``"serial"`` or ``"both"``.

    Returns:
        The surfaces, with the joints of their vertices; none if there is no singular pose in the box.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Not one concrete mechanism, or one without factors, without closed inverse kinematics and with
            equations that hold several joints; the box has other axes, or not three free ones; an unknown kind.
        GeometryError: The geometry is degenerate, or every pose is singular (in a working mode).

    References:
        Wenger and Chablat 2009, Fig. 2. Gosselin, C. and Angeles, J., 1990 (type 2 singularities).
    """
    if kind not in ("parallel", "serial", "both"):
        raise InputError(f"{_WHO}: kind is {kind!r}: choose 'parallel', 'serial' or 'both'.")
    lattice = _Lattice.over(_checked_box(robot, box))
    if tells_factors(robot):
        lattice = lattice.inside_charts()
    legs = legs_of(robot)
    found, crossed = list[Surface](), tuple[CrossingCurve, ...]()
    if kind != "serial":
        functions = Functions(_source(robot, legs), legs)
        _refuse_zero(robot, functions, lattice)
        surfaces, scouts = _surfaces(robot, functions, lattice)
        found += surfaces
        if functions.source == FACTORS:
            crossed = crossings(robot, functions, (lattice.free, lattice.nodes), surfaces, scouts)
    if kind != "parallel":
        functions = Functions(SERIAL, _with_legs(robot, legs))
        found += _surfaces(robot, functions, lattice)[0] if functions.folding else []
    axes = robot.pose_axes
    request = {**identity(robot), "box": lattice.bound.content()}
    return SingularSurfaces(
        surfaces=tuple(found),
        crossings=crossed,
        request=request if kind == "parallel" else {**request, "kind": kind},
        pose_names=tuple(axis.name for axis in axes),
        units={axis.name: axis.unit for axis in axes},
        glued=tuple(axes[k].name for k, joined in zip(lattice.free, lattice.glued, strict=True) if joined),
        joint_names=tuple(axis.name for axis in robot.joint_axes),
    )


def _source(robot: Mechanism, legs: Legs | None) -> str:
    """Says along what det dF/dpose is a function of the pose."""
    if callable(getattr(robot, "factors", None)):
        return FACTORS
    if robot.inverse_kernel is not None:
        return LANES
    _with_legs(robot, legs)
    return LEGS


def _with_legs(robot: Mechanism, legs: Legs | None) -> Legs:
    if legs is None:
        raise InputError(
            f"{_WHO}: {type(robot).__name__} has neither factors nor closed inverse kinematics, and its equations hold "
            "several joints each, so that its working modes are no sign vectors: give the class a method "
            "inverse_kernel(pose), or factors(pose), or use jk.singular_curves over two pose axes."
        )
    return legs


def _surfaces(robot: Mechanism, functions: Functions, lattice: "_Lattice") -> tuple[list[Surface], list[int]]:
    """Returns the surfaces in the box, and which function vanishes on each."""
    sampled = _sampled(robot, functions, lattice)
    found, numbers = [], []
    for number, name in enumerate(functions.names(robot, len(sampled))):
        field = sampled[number].reshape(lattice.shape)
        _isosurface.quieten(field)
        glued = tuple(joined and _isosurface.glue(field, k) for k, joined in enumerate(lattice.glued))
        mesh = _isosurface.extract(field, glued)
        if mesh is not None:
            found.append(_polished(robot, functions, lattice, number, name, mesh, field))
            numbers.append(number)
    return found, numbers


def _checked_box(robot: Mechanism, box: Grid) -> BoundGrid:
    checked_single(_WHO, robot)
    if not isinstance(box, Grid):
        raise InputError(f"{_WHO} got a {type(box).__name__} as its box: pass a jk.Grid over the pose axes.")
    bound = box.bind(robot.pose_axes, "pose")
    if len(bound.free) != 3:
        names = ", ".join(bound.axes[k].name for k in bound.free)
        raise InputError(
            f"The box has {len(bound.free)} free axes ({names}): a surface needs exactly three free axes; give the "
            "others as numbers, or draw a map with jk.sweep(robot, 'direct_determinant', grid)."
        )
    if not bool(robot.geometry_ok()):
        raise GeometryError(f"The geometry of {robot} is degenerate: build it with its constructor, which says why.")
    return bound


class _Lattice(NamedTuple):
    """Nodes of the three free axes, and the values of the others."""

    bound: BoundGrid
    nodes: tuple[np.ndarray, ...]
    glued: tuple[bool, ...]

    @classmethod
    def over(cls, bound: BoundGrid) -> "_Lattice":
        nodes, glued = zip(*(_nodes(bound.axes[k], bound.values[k]) for k in bound.free), strict=True)
        return cls(bound, nodes, glued)

    def inside_charts(self) -> "_Lattice":
        """Returns the lattice with its ends moved off those of the axes, where the angles of a pose are singular.

        On a face on which a factor vanishes everywhere, rounding would decide its signs.
        """
        nodes = []
        for k, samples in zip(self.free, self.nodes, strict=True):
            axis, inner = self.bound.axes[k], samples.copy()
            if axis.is_angle and axis.period is None:
                inner[0] += _EDGE * (samples[1] - samples[0]) * (samples[0] <= axis.low)
                inner[-1] -= _EDGE * (samples[-1] - samples[-2]) * (samples[-1] >= axis.high)
            nodes.append(inner)
        return self._replace(nodes=tuple(nodes))

    @property
    def free(self) -> tuple[int, ...]:
        return self.bound.free

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(map(len, self.nodes))

    def poses(self, index: np.ndarray) -> np.ndarray:
        """Returns the poses at index coordinates ``(k, 3)``, whole or not."""
        poses = np.tile(np.array([0.0 if isinstance(v, Span) else v for v in self.bound.values]), (len(index), 1))
        for place, (k, nodes) in enumerate(zip(self.free, self.nodes, strict=True)):
            poses[:, k] = np.interp(index[:, place], np.arange(len(nodes)), nodes)
        return poses


def _nodes(axis: Axis, span: Span | float) -> tuple[np.ndarray, bool]:
    assert isinstance(span, Span)
    whole = axis.period is not None and math.isclose(span.high - span.low, axis.period, rel_tol=1e-12)
    # A glued axis of n samples has n cells, as in any grid; here its last node is the first one again.
    nodes = np.linspace(span.low, span.high, span.count + whole)
    nodes[1:-1] += _SHIFT * (nodes[1] - nodes[0])
    return nodes, whole


def _sampled(robot: Mechanism, functions: Functions, lattice: "_Lattice") -> np.ndarray:
    """Returns the values of every surface's function at every node, ``(n_surface, n)``."""
    size, parts = math.prod(lattice.shape), []
    for start in range(0, size, _SLAB):
        index = np.unravel_index(np.arange(start, min(start + _SLAB, size)), lattice.shape)
        parts.append(rows_in_blocks(partial(values, robot, functions), lattice.poses(np.stack(index, axis=1))))
    return np.concatenate(parts, axis=1)


def _refuse_zero(robot: Mechanism, functions: Functions, lattice: _Lattice) -> None:
    """Raises where every pose is singular in a working mode: two equations are dependent."""
    if functions.source == FACTORS:
        # Their product is det dF/dpose, along any inverse kinematics that there is.
        along = LANES if robot.inverse_kernel is not None or functions.legs is None else LEGS
        functions = functions._replace(source=along)
    size = math.prod(lattice.shape)
    # A step that shares no divisor with the grid, or the probes might all lie in one plane.
    step = max(1, size // _PROBES) | 1
    index = np.stack(np.unravel_index(np.arange(0, size, step), lattice.shape), axis=1)
    found = rows_in_blocks(partial(volumes, robot, functions), lattice.poses(index))
    largest = np.max(np.nan_to_num(found, nan=-1.0), axis=1)
    zero = np.flatnonzero((largest >= 0) & (largest <= TOLERANCES.geometry))
    if zero.size:
        mode = "" if len(found) == 1 else f", working mode {', '.join(map(str, zero))},"
        raise GeometryError(
            f"det dF/dpose of {robot}{mode} vanishes at all {len(index)} poses that were looked at: two equations "
            "depend on each other, or a pose coordinate has no effect; change the geometry or the constraints."
        )


def _polished(
    robot: Mechanism,
    functions: Functions,
    lattice: _Lattice,
    number: int,
    name: str,
    mesh: _isosurface.Mesh,
    field: np.ndarray,
) -> Surface:
    """Moves every vertex onto the surface, copies glued ones, and drops those that do not converge."""
    low, high = _segments(robot, functions, lattice, number, mesh, field)
    which = np.full(len(low.poses), number)
    vertices = rows_in_blocks(partial(edge_zeros, robot, functions), which, low.poses, high, low.sign).T
    for k, seam in zip(lattice.free, mesh.seams, strict=True):
        ends = lattice.nodes[lattice.free.index(k)][[0, -1]]
        vertices[seam[:, 1]] = vertices[seam[:, 0]]
        vertices[seam[:, 0], k], vertices[seam[:, 1], k] = ends
    residual = rows_in_blocks(partial(residuals, robot, functions), vertices)[number]
    good = residual <= TOLERANCES.residual
    faces = mesh.faces[good[mesh.faces].all(axis=1)]
    kept = np.unique(faces)
    renumbered = np.full(len(vertices), -1)
    renumbered[kept] = np.arange(len(kept))
    seam = renumbered[np.concatenate(mesh.seams)]
    return Surface(
        name=name,
        vertices=vertices[kept],
        faces=renumbered[faces],
        residual=float(residual[kept].max(initial=0.0)),
        seam=seam[(seam >= 0).all(axis=1)],
        boundary=_isosurface.single_edges(renumbered[faces]),
        unpolished=int(np.sum(~good)),
        joints=rows_in_blocks(partial(joints_of, robot, functions), which[kept], vertices[kept]).T,
    )


class _Start(NamedTuple):
    poses: np.ndarray
    sign: np.ndarray


def _segments(
    robot: Mechanism,
    functions: Functions,
    lattice: _Lattice,
    number: int,
    mesh: _isosurface.Mesh,
    field: np.ndarray,
) -> tuple[_Start, np.ndarray]:
    """Returns for every vertex a segment over which the sign changes: its grid edge, or from inside its cell out."""
    step = np.eye(4, 3, dtype=np.int64)[mesh.axis]
    start, end = mesh.node.astype(float), (mesh.node + step).astype(float)
    sign = np.where(field[tuple(mesh.node.T)] < 0, -1.0, 1.0)
    inside = np.flatnonzero(mesh.axis == 3)
    if inside.size:
        start[inside] = mesh.place[inside]
        own = rows_in_blocks(partial(values, robot, functions), lattice.poses(start[inside]))[number]
        sign[inside] = np.where(own < 0, -1.0, 1.0)
        # Such a cell has corners of both signs; the first of the other sign will do.
        corners = mesh.node[inside][:, None] + np.array(list(np.ndindex(2, 2, 2)))
        other = (field[tuple(np.moveaxis(corners, -1, 0))] < 0) != (own < 0)[:, None]
        end[inside] = corners[np.arange(inside.size), np.argmax(other, axis=1)]
    return _Start(lattice.poses(start), sign), lattice.poses(end)
