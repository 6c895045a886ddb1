"""Necks along an inner wall: strips between it and a singular wall, too narrow for cells, walked on the wall itself.

Where a leg is stretched det A is linear in the root of the leg's discriminant: it keeps a sign along the wall while
the strip in which it does so is as narrow as the square of its value there. The strip is found from the wall's side.
"""

from collections.abc import Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from jaxkin.mapping._aspect_joins import Owners, codes_at, lines_hold, shared_codes, unrolled
from jaxkin.mapping._aspect_sheets import BLOCK, Sheet
from jaxkin.mapping._aspect_walls import OUTSIDE, WallData, Walls
from jaxkin.mapping.batch import in_blocks

#: More undecided cells than these are not searched.
_CELLS = 40_000
#: Depths behind a wall, in halvings of a cell, at which the code is taken; the deepest are those next to the wall.
_DEPTHS = 30
#: Halvings of a step along a wall, and ways tried for each cluster of cells.
_HALVINGS, _WAYS = 10, 8


@partial(jax.jit, static_argnames="walls")
def _walked(walls: Walls, data: WallData, points: Array, width: Array, which: Array) -> tuple[Array, Array]:
    """Returns points ``(k, d)`` led onto a smooth wall by Newton's method, and the way in from there over a width."""

    def one(point: Array, size: Array, number: Array) -> tuple[Array, Array]:
        def wall(v: Array) -> tuple[Array, Array]:
            value = walls.smooth(data, point + v * size)[number]
            return value, value

        def step(_: int, carry: tuple[Array, Array]) -> tuple[Array, Array]:
            # Forwards: other walls are undefined behind this one.
            slope, value = jax.jacfwd(wall, has_aux=True)(carry[0])
            return carry[0] - value * slope / jnp.sum(slope * slope), slope

        v, slope = jax.lax.fori_loop(0, 7, step, (jnp.zeros_like(point), jnp.zeros_like(point)))
        return point + v * size, size * slope / jnp.max(jnp.abs(slope))

    return jax.vmap(one)(points, width, which)


def _strip(sheet: Sheet, points: np.ndarray, width: np.ndarray, wall: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns points on a wall, the middles of the strips behind them, and the strips' codes, OUTSIDE where none is."""
    which = np.full(len(points), wall)
    foot, way = in_blocks(partial(_walked, sheet.walls, sheet.data), points, width, which, block=BLOCK)
    depth = 0.5 ** np.arange(_DEPTHS, 0, -1)
    inside = foot[:, None] + way[:, None] * depth[:, None]
    codes = codes_at(sheet, inside.reshape(-1, points.shape[1])).reshape(len(points), -1)
    held = np.cumprod(codes == codes[:, :1], axis=1).sum(axis=1)
    middle = foot + way * 0.5 * depth[held - 1][:, None]
    near = np.all(np.abs(foot - points) <= width, axis=1)
    return foot, middle, np.where(near, codes[:, 0], OUTSIDE)


def join_along_walls(sheet: Sheet, owners: Owners) -> int:
    """Joins components that a strip along an inner wall connects; returns how many became parts of others."""
    before = sheet.components.count
    if len(owners.cells) > _CELLS or not shared_codes(sheet):
        return 0
    centres, widths = sheet.centres(owners.cells), sheet.widths(owners.cells)
    for wall in range(sheet.walls.n_singular, sheet.walls.n_smooth):
        foot, middle, codes = _strip(sheet, centres, widths, wall)
        one, other, flip = owners.beside
        use = (codes[one] != OUTSIDE) & (codes[other] != OUTSIDE) & (codes[one] == codes[other] ^ flip)
        pairs = np.stack([one[use], other[use]])
        ends = np.where(codes >= 0, owners.anchor[np.arange(len(codes)), np.maximum(codes, 0)], -1)
        for rows in _clusters(sheet, pairs, ends):
            some = rows[ends[rows] >= 0]
            start = unrolled(sheet, sheet.centres(ends[some]), middle[some])
            good = some[lines_hold(sheet, start, middle[some], codes[some])]
            _join_cluster(sheet, pairs[:, np.isin(pairs[0], rows)], good, ends, (wall, foot, middle, codes, widths))
    return before - sheet.components.count


def _clusters(sheet: Sheet, pairs: np.ndarray, ends: np.ndarray) -> Iterator[np.ndarray]:
    """Yields the rows of clusters at which several components end."""
    label = connected_components(_graph(pairs, len(ends)), directed=False)[1]
    rows = np.flatnonzero(ends >= 0)
    both = np.unique(np.stack([label[rows], sheet.components.of(sheet.tree, ends[rows])]), axis=1)
    found, count = np.unique(both[0], return_counts=True)
    for number in found[count > 1]:
        yield np.flatnonzero(label == number)


def _graph(pairs: np.ndarray, size: int) -> csr_array:
    ones = np.ones(2 * pairs.shape[1], np.int8)
    return coo_array((ones, (pairs.ravel(), pairs[::-1].ravel())), (size, size)).tocsr()


def _join_cluster(
    sheet: Sheet, pairs: np.ndarray, good: np.ndarray, ends: np.ndarray, strip: tuple[int, *tuple[np.ndarray, ...]]
) -> None:
    """Walks from components to others by fewest cells; what does not hold is left out in the next attempt."""
    for _ in range(_WAYS):
        component = sheet.components.of(sheet.tree, ends[good])
        if len(np.unique(component)) < 2:
            return
        # Most often a small component lies beside a large one.
        first = np.argmin(np.bincount(component) + len(good) * (np.bincount(component) == 0))
        size = len(ends)
        source = good[component == first]
        starts = np.stack([np.full(len(source), size), source])
        order, before = breadth_first_order(_graph(np.concatenate([pairs, starts], axis=1), size + 1), size)
        goals = order[np.isin(order, good[component != first])]
        if len(goals) == 0:
            good = good[component != first]
            continue
        way = [int(goals[0])]
        while before[way[-1]] != size:
            way.append(int(before[way[-1]]))
        rows = np.array(way[::-1])
        points, holds = _walk(sheet, rows, strip)
        if holds.all():
            a, b = int(ends[rows[0]]), int(ends[rows[-1]])
            sheet.components.unite(*(sheet.components.of(sheet.tree, np.array([c])) for c in (a, b)))
            sheet.links.append(np.array([[a], [b]]))
            sheet.ways[a, b] = points
            continue
        broken = {frozenset(pair) for pair in zip(rows[:-1][~holds].tolist(), rows[1:][~holds].tolist(), strict=True)}
        pairs = pairs[:, [frozenset(pair) not in broken for pair in pairs.T.tolist()]]


def _walk(sheet: Sheet, rows: np.ndarray, strip: tuple[int, *tuple[np.ndarray, ...]]) -> tuple[np.ndarray, np.ndarray]:
    """Returns points along a strip whose straight lines keep the code, and on which steps between rows they do."""
    wall, foot, middle, codes, widths = strip
    feet, middles = [foot[rows[0]]], [middle[rows[0]]]
    for row in rows[1:]:
        moved = unrolled(sheet, foot[row], feet[-1])
        feet.append(moved)
        middles.append(middle[row] + moved - foot[row])
    at, feet, middles = np.arange(len(rows), dtype=float), np.array(feet), np.array(middles)
    width, code = np.max(widths[rows], axis=0), codes[rows[0]]
    holds = np.ones(max(len(rows) - 1, 0), bool)
    for turn in range(_HALVINGS + 1):
        lines = lines_hold(sheet, middles[:-1], middles[1:], np.full(len(at) - 1, code))
        torn = np.flatnonzero(~lines)
        if len(torn) == 0 or turn == _HALVINGS:
            holds[at[torn].astype(int)] = False
            break
        half = 0.5 * (feet[torn] + feet[torn + 1])
        new, inside, found = _strip(sheet, half, np.broadcast_to(width, half.shape), wall)
        if np.any(found != code):
            holds[at[torn[found != code]].astype(int)] = False
            break
        at = np.insert(at, torn + 1, 0.5 * (at[torn] + at[torn + 1]))
        feet, middles = np.insert(feet, torn + 1, new, axis=0), np.insert(middles, torn + 1, inside, axis=0)
    return middles, holds
