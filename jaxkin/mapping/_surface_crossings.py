"""Where two singular surfaces cross: curves on which two factors vanish."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism, scale_vector
from jaxkin.core.precision import TOLERANCES
from jaxkin.mapping import _isosurface
from jaxkin.mapping._surface_functions import Functions, residuals, rows_in_blocks, smooth_values, values
from jaxkin.mapping.meshes import CrossingCurve, Surface
from jaxkin.numerics.small_linalg import pivoted_solve

#: Newton steps from a mesh edge to a crossing; they start within a cell of it.
_STEPS = 12

#: Positions of the free axes in a pose, and the nodes along each.
Axes = tuple[tuple[int, ...], tuple[np.ndarray, ...]]


def crossings(
    robot: Mechanism, functions: Functions, axes: Axes, surfaces: list[Surface], numbers: list[int]
) -> tuple[CrossingCurve, ...]:
    """Finds, on each surface, the curves in which a later factor vanishes as well."""
    found = []
    for i, (first, a) in enumerate(zip(surfaces, numbers, strict=True)):
        if not len(first.vertices):
            continue
        here = rows_in_blocks(partial(values, robot, functions), first.vertices)
        for second, b in zip(surfaces[i + 1 :], numbers[i + 1 :], strict=True):
            crossing = _crossing(robot, functions, axes, first, second.name, (a, b), here[b])
            if crossing is not None:
                found.append(crossing)
    return tuple(found)


def _crossing(
    robot: Mechanism,
    functions: Functions,
    axes: Axes,
    surface: Surface,
    name: str,
    pair: tuple[int, int],
    other: np.ndarray,
) -> CrossingCurve | None:
    """Polishes the places where the other factor changes sign along an edge of the surface's triangles."""
    places, nodes_of = axes
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
    for k, nodes in zip(places, nodes_of, strict=True):
        free[:, k] = ~np.isin(ends[:, :, k], nodes[[0, -1]]).all(axis=1)
    start = ends[:, 0] + share * (ends[:, 1] - ends[:, 0])
    poses = rows_in_blocks(partial(_newton, robot, functions), start, free, np.tile(pair, (len(start), 1))).T
    residual = rows_in_blocks(partial(residuals, robot, functions), poses)[list(pair)].max(axis=0)
    cell = np.array([np.diff(nodes).max() for nodes in nodes_of])
    good = (residual <= TOLERANCES.residual) & (np.abs(poses - start)[:, places] <= 2 * cell).all(axis=1)
    order = np.flatnonzero(good)[np.argsort(poses[good, places[-1]], kind="stable")]
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


@partial(jax.jit, static_argnames="functions")
def _newton(robot: Mechanism, functions: Functions, start: Array, free: Array, pairs: Array) -> Array:
    """Returns the poses ``(n_pose, n)`` near the starts at which two factors vanish; only free coordinates change."""
    unit = scale_vector(robot.pose_axes, robot.characteristic_length())

    def one(pose: Array, free: Array, pair: Array) -> Array:
        def step(_: int, pose: Array) -> Array:
            function = partial(smooth_values, robot, functions)
            slopes = jax.jacfwd(function)(pose)[pair] * unit * free
            slopes, value = _unit_rows(slopes, function(pose)[pair])
            # The shortest step that makes both vanish to first order.
            return pose - unit * (slopes.T @ pivoted_solve(slopes @ slopes.T, value))

        return jax.lax.fori_loop(0, _STEPS, step, pose)

    return jax.vmap(one, out_axes=1)(start, free, pairs)


def _unit_rows(slopes: Array, value: Array) -> tuple[Array, Array]:
    """Divides each equation by the length of its gradient: the factors have different units."""
    length = jnp.linalg.norm(slopes, axis=1)
    return slopes / length[:, None], value / length
