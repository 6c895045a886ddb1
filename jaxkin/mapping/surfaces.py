"""Singular surfaces of the workspace: where the direct determinant vanishes, as polished triangles."""

import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import stack_lanes
from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Axis, Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.kinematics.solve import inverse_lanes
from jaxkin.mapping import _isosurface
from jaxkin.mapping.batch import in_blocks
from jaxkin.mapping.chart import factor_names, tells_factors
from jaxkin.mapping.meshes import CrossingCurve, SingularSurfaces, Surface
from jaxkin.numerics import bracket
from jaxkin.numerics.small_linalg import expanded_determinant, pivoted_solve
from jaxkin.sweep.grid import BoundGrid, Grid, Span

_WHO = "jk.singular_surfaces"
#: Poses that one compiled call takes; shorter calls are padded, so that nothing is compiled twice.
_BLOCK = 1 << 13
#: Nodes whose poses are listed at a time, so that they take less memory than the values.
_SLAB = 1 << 19
#: Inner nodes are moved by this irrational share of a step: no node lies in a plane of symmetry, where factors vanish.
_SHIFT = (math.sqrt(5) - 2) / 2
#: So far, in steps, nodes stay from where the angles of a pose are singular.
_EDGE = 1e-6
#: Newton steps from a mesh edge to a crossing; they start within a cell of it.
_CROSSING_STEPS = 12
#: Samples that tell whether a determinant vanishes everywhere.
_PROBES = 1 << 12


def singular_surfaces(robot: Mechanism, box: Grid) -> SingularSurfaces:
    """Finds the surfaces of the workspace on which the mechanism is singular (type 2, det dF/dpose = 0).

    A mechanism that declares factors of the determinant (a method ``factors(pose) -> dict``) has one surface per
    factor, whatever its joint limits. Any other has one per working mode, along its closed inverse kinematics; where a
    working mode does not exist, or violates the joint limits, the surface has a hole.

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

    Returns:
        The surfaces; none if there is no singular pose in the box.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: Not one concrete mechanism, or one without factors and without closed inverse kinematics; the
            box has other axes, or not three free ones.
        GeometryError: The geometry is degenerate, or every pose is singular (in a working mode).

    References:
        Wenger and Chablat 2009, Fig. 2. Gosselin, C. and Angeles, J., 1990 (type 2 singularities).
    """
    lattice = _Lattice.over(_checked_box(robot, box))
    if tells_factors(robot):
        lattice = lattice.inside_charts()
    values = _sampled(robot, lattice)
    names = _names(robot, len(values))
    _refuse_zero(robot, lattice)
    found, scouts = [], []
    for number, name in enumerate(names):
        field = values[number].reshape(lattice.shape)
        _isosurface.quieten(field)
        glued = tuple(joined and _isosurface.glue(field, k) for k, joined in enumerate(lattice.glued))
        mesh = _isosurface.extract(field, glued)
        if mesh is not None:
            found.append(_polished(robot, lattice, number, name, mesh, field))
            scouts.append(number)
    axes = robot.pose_axes
    return SingularSurfaces(
        surfaces=tuple(found),
        crossings=_crossings(robot, lattice, found, scouts) if _factored(robot) else (),
        request={
            **identity(robot),
            "box": lattice.bound.content(),
        },
        pose_names=tuple(axis.name for axis in axes),
        units={axis.name: axis.unit for axis in axes},
        glued=tuple(axes[k].name for k, joined in zip(lattice.free, lattice.glued, strict=True) if joined),
    )


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
    if robot.inverse_kernel is None and not _factored(robot):
        raise InputError(
            f"{type(robot).__name__} has neither factors nor closed inverse kinematics, and a numerical search does "
            "not keep its working modes apart: give the class a method inverse_kernel(pose), or factors(pose)."
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


def _factored(robot: Mechanism) -> bool:
    return callable(getattr(robot, "factors", None))


def _names(robot: Mechanism, count: int) -> list[str]:
    if not _factored(robot):
        return ["det"] if count == 1 else [f"det, working mode {k}" for k in range(count)]
    return list(factor_names(robot))


def _in_blocks(function: Callable[..., Array], *columns: np.ndarray) -> np.ndarray:
    """Calls a compiled function on blocks of rows; results have the rows last."""
    return in_blocks(function, *columns, block=_BLOCK, axis=-1)


def _sampled(robot: Mechanism, lattice: "_Lattice") -> np.ndarray:
    """Returns the values of every surface's function at every node, ``(n_surface, n)``."""
    size, parts = math.prod(lattice.shape), []
    for start in range(0, size, _SLAB):
        index = np.unravel_index(np.arange(start, min(start + _SLAB, size)), lattice.shape)
        parts.append(_in_blocks(partial(_values, robot), lattice.poses(np.stack(index, axis=1))))
    return np.concatenate(parts, axis=1)


def _factor_values(robot: Mechanism, pose: Array) -> Array:
    factors: dict[str, Array] = robot.factors(pose)  # type: ignore[attr-defined]
    return jnp.stack(list(factors.values()))


class _Determinant(NamedTuple):
    value: Array
    residual: Array
    volume: Array


def _determinants(robot: Mechanism, poses: Array) -> _Determinant:
    """Measures det dF/dpose in every working mode, ``(modes, n)``: as it is, over its scale, over its rows' lengths."""
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())

    def one(pose: Array, joints: Array, here: Array) -> _Determinant:
        direct = raw_jacobians(robot, pose, joints).direct * unit
        value = expanded_determinant(direct)
        scale = jnp.prod(robot.constraint_scales(pose, joints))
        lengths = jnp.prod(jnp.linalg.norm(direct, axis=1))
        volume = jnp.where(lengths > 0, value / jnp.where(lengths > 0, lengths, 1.0), 0.0)
        return _Determinant(*(jnp.where(here, x, jnp.nan) for x in (value, jnp.abs(value) / scale, jnp.abs(volume))))

    lanes = inverse_lanes(robot, tuple(poses[:, k] for k in range(poses.shape[1])))
    branches = stack_lanes(lanes)
    per_mode = jax.vmap(one, in_axes=(None, 0, 0))
    return jax.vmap(per_mode, out_axes=1)(poses, branches.values, branches.valid)


def _value_rows(robot: Mechanism, poses: Array) -> Array:
    if _factored(robot):
        return jax.vmap(lambda pose: _factor_values(robot, pose), out_axes=1)(poses)
    return _determinants(robot, poses).value


@jax.jit
def _values(robot: Mechanism, poses: Array) -> Array:
    """Returns every factor, or the determinant in every working mode, ``(n_surface, n)``."""
    return _value_rows(robot, poses)


@jax.jit
def _volumes(robot: Mechanism, poses: Array) -> Array:
    return _determinants(robot, poses).volume


def _refuse_zero(robot: Mechanism, lattice: _Lattice) -> None:
    """Raises where every pose is singular in a working mode: two equations are dependent."""
    size = math.prod(lattice.shape)
    # A step that shares no divisor with the grid, or the probes might all lie in one plane.
    step = max(1, size // _PROBES) | 1
    index = np.stack(np.unravel_index(np.arange(0, size, step), lattice.shape), axis=1)
    volumes = _in_blocks(partial(_volumes, robot), lattice.poses(index))
    largest = np.max(np.nan_to_num(volumes, nan=-1.0), axis=1)
    zero = np.flatnonzero((largest >= 0) & (largest <= TOLERANCES.geometry))
    if zero.size:
        mode = "" if len(volumes) == 1 else f", working mode {', '.join(map(str, zero))},"
        raise GeometryError(
            f"det dF/dpose of {robot}{mode} vanishes at all {len(index)} poses that were looked at: two equations "
            "depend on each other, or a pose coordinate has no effect; change the geometry or the constraints."
        )


@jax.jit
def _edge_zeros(robot: Mechanism, number: Array, start: Array, end: Array, sign: Array) -> Array:
    """Returns the poses ``(n_pose, n)`` at which the surface meets the segments from start to end.

    Args:
        robot: The mechanism.
        number: ``(n,)`` which surface.
        start: ``(n, n_pose)``.
        end: ``(n, n_pose)``.
        sign: ``(n,)`` sign of the value at the start; a value lost in rounding may show another one.
    """
    rows = jnp.arange(len(start))

    def along(t: Array) -> Array:
        return _value_rows(robot, start + t[:, None] * (end - start))[number, rows]

    def size(t: float) -> Array:
        return jnp.maximum(jnp.abs(along(jnp.full(len(start), t))), jnp.finfo(float).tiny)

    t = bracket.zero(along, sign * size(0.0), -sign * size(1.0))
    return (start + t[:, None] * (end - start)).T


@jax.jit
def _residuals(robot: Mechanism, poses: Array) -> Array:
    """Returns the dimensionless residuals ``(n_surface, n)`` that ``singular_surfaces`` defines."""
    if not _factored(robot):
        return _determinants(robot, poses).residual
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())
    is_length = jnp.array([not axis.is_angle for axis in robot.pose_axes])

    def one(pose: Array) -> Array:
        step = jnp.where(is_length, unit + jnp.abs(pose), 1.0)
        function = partial(_factor_values, robot)
        first = jax.jacfwd(function)(pose) * step
        second = jnp.diagonal(jax.jacfwd(jax.jacfwd(function))(pose), axis1=1, axis2=2) * step**2
        scale = jnp.sum(jnp.abs(first) + jnp.abs(second), axis=1)
        value = jnp.abs(function(pose))
        return jnp.where(value == 0, 0.0, value / scale)

    return jax.vmap(one, out_axes=1)(poses)


def _polished(
    robot: Mechanism, lattice: _Lattice, number: int, name: str, mesh: _isosurface.Mesh, values: np.ndarray
) -> Surface:
    """Moves every vertex onto the surface, copies glued ones, and drops those that do not converge."""
    low, high = _segments(robot, lattice, number, mesh, values)
    which = np.full(len(low.poses), number)
    vertices = _in_blocks(partial(_edge_zeros, robot), which, low.poses, high, low.sign).T
    for k, seam in zip(lattice.free, mesh.seams, strict=True):
        ends = lattice.nodes[lattice.free.index(k)][[0, -1]]
        vertices[seam[:, 1]] = vertices[seam[:, 0]]
        vertices[seam[:, 0], k], vertices[seam[:, 1], k] = ends
    residual = _in_blocks(partial(_residuals, robot), vertices)[number]
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
    )


class _Start(NamedTuple):
    poses: np.ndarray
    sign: np.ndarray


def _segments(
    robot: Mechanism, lattice: _Lattice, number: int, mesh: _isosurface.Mesh, values: np.ndarray
) -> tuple[_Start, np.ndarray]:
    """Returns for every vertex a segment over which the sign changes: its grid edge, or from inside its cell out."""
    step = np.eye(4, 3, dtype=np.int64)[mesh.axis]
    start, end = mesh.node.astype(float), (mesh.node + step).astype(float)
    sign = np.where(values[tuple(mesh.node.T)] < 0, -1.0, 1.0)
    inside = np.flatnonzero(mesh.axis == 3)
    if inside.size:
        start[inside] = mesh.place[inside]
        own = _in_blocks(partial(_values, robot), lattice.poses(start[inside]))[number]
        sign[inside] = np.where(own < 0, -1.0, 1.0)
        # Such a cell has corners of both signs; the first of the other sign will do.
        corners = mesh.node[inside][:, None] + np.array(list(np.ndindex(2, 2, 2)))
        other = (values[tuple(np.moveaxis(corners, -1, 0))] < 0) != (own < 0)[:, None]
        end[inside] = corners[np.arange(inside.size), np.argmax(other, axis=1)]
    return _Start(lattice.poses(start), sign), lattice.poses(end)


def _crossings(
    robot: Mechanism, lattice: _Lattice, surfaces: list[Surface], numbers: list[int]
) -> tuple[CrossingCurve, ...]:
    """Finds, on each surface, the curves in which a later factor vanishes as well."""
    found = []
    for i, (first, a) in enumerate(zip(surfaces, numbers, strict=True)):
        if not len(first.vertices):
            continue
        values = _in_blocks(partial(_values, robot), first.vertices)
        for second, b in zip(surfaces[i + 1 :], numbers[i + 1 :], strict=True):
            crossing = _crossing(robot, lattice, first, second.name, (a, b), values[b])
            if crossing is not None:
                found.append(crossing)
    return tuple(found)


def _crossing(
    robot: Mechanism, lattice: _Lattice, surface: Surface, name: str, pair: tuple[int, int], other: np.ndarray
) -> CrossingCurve | None:
    """Polishes the places where the other factor changes sign along an edge of the surface's triangles."""
    edges, inverse = np.unique(_isosurface.all_edges(surface.faces), axis=0, return_inverse=True)
    sides = inverse.reshape(3, -1).T
    f = other[edges]
    cut = (f[:, 0] < 0) != (f[:, 1] < 0)
    if not cut.any():
        return None
    # Two of a triangle's edges are cut, or none: their zeros are neighbours.
    pieces = sides[cut[sides].sum(axis=1) == 2]
    pieces = pieces[cut[pieces]].reshape(-1, 2)
    ends, share = surface.vertices[edges[cut]], (f[cut, 0] / (f[cut, 0] - f[cut, 1]))[:, None]
    free = np.zeros(ends.shape[::2], bool)
    for k, nodes in zip(lattice.free, lattice.nodes, strict=True):
        free[:, k] = ~np.isin(ends[:, :, k], nodes[[0, -1]]).all(axis=1)
    start = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    poses = _in_blocks(partial(_crossing_newton, robot), start, free, np.tile(pair, (len(start), 1))).T
    residual = _in_blocks(partial(_residuals, robot), poses)[list(pair)].max(axis=0)
    cell = np.array([np.diff(nodes).max() for nodes in lattice.nodes])
    good = (residual <= TOLERANCES.residual) & (np.abs(poses - start)[:, lattice.free] <= 2 * cell).all(axis=1)
    order = np.flatnonzero(good)[np.argsort(poses[good, lattice.free[-1]], kind="stable")]
    renumbered = np.full(len(edges), -1)
    renumbered[np.flatnonzero(cut)[order]] = np.arange(len(order))
    segments = renumbered[pieces]
    if not order.size:
        return None
    return CrossingCurve(
        names=(surface.name, name),
        poses=poses[order],
        segments=segments[(segments >= 0).all(axis=1)],
        residual=float(residual[order].max()),
    )


@jax.jit
def _crossing_newton(robot: Mechanism, start: Array, free: Array, pairs: Array) -> Array:
    """Returns the poses ``(n_pose, n)`` near the starts at which two factors vanish; only free coordinates change."""
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())

    def one(pose: Array, free: Array, pair: Array) -> Array:
        def step(_: int, pose: Array) -> Array:
            function = partial(_factor_values, robot)
            slopes = jax.jacfwd(function)(pose)[pair] * unit * free
            slopes, value = _unit_rows(slopes, function(pose)[pair])
            # The shortest step that makes both vanish to first order.
            return pose - unit * (slopes.T @ pivoted_solve(slopes @ slopes.T, value))

        return jax.lax.fori_loop(0, _CROSSING_STEPS, step, pose)

    return jax.vmap(one, out_axes=1)(start, free, pairs)


def _unit_rows(slopes: Array, value: Array) -> tuple[Array, Array]:
    """Divides each equation by the length of its gradient: the factors have different units."""
    length = jnp.linalg.norm(slopes, axis=1)
    return slopes / length[:, None], value / length
