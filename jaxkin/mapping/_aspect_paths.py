"""Paths through proved cells."""

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order

from jaxkin.mapping._aspect_assembly import Charted, anchors
from jaxkin.mapping._aspect_joins import unrolled
from jaxkin.mapping._aspect_sheets import Sheet


def path_between(charted: Charted, number: int, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
    """Returns points ``(k, d)`` from start to goal through the cells of one component; None where there is no path."""
    if number < 0:
        return None
    sheet = charted.sheets[number]
    ends = anchors(sheet, charted.owners[number], np.stack([start, goal]))
    component = sheet.components.of(sheet.tree, ends)
    if component[0] < 0 or component[0] != component[1]:
        return None
    if number not in charted.graphs:
        charted.graphs[number] = _graph(sheet)
    cells = _route(charted.graphs[number], int(ends[0]), int(ends[1]))
    own = sheet.locate(np.stack([start, goal]))
    centres, widths = sheet.centres(cells), sheet.widths(cells)
    points = [start]
    if own[0] != cells[0]:
        points.append(unrolled(sheet, centres[0], start))
    for k in range(len(cells) - 1):
        pair = int(cells[k]), int(cells[k + 1])
        way = sheet.ways[pair] if pair in sheet.ways else sheet.ways.get((pair[1], pair[0]), centres[:0])[::-1]
        if len(way):
            # The way's own cell is its first: all of it moves by whole periods as one.
            points.append(unrolled(sheet, centres[k], points[-1]))
            points += list(way + unrolled(sheet, way[0], points[-1]) - way[0])
            points.append(unrolled(sheet, centres[k + 1], points[-1]))
            continue
        points += _between(sheet, points[-1], centres[k : k + 2], widths[k : k + 2])
    if own[1] != cells[-1]:
        points.append(unrolled(sheet, centres[-1], points[-1]))
    points.append(unrolled(sheet, goal, points[-1]))
    return np.array(points)


def _graph(sheet: Sheet) -> csr_array:
    """Returns the adjacency of all cells: faces, and lines through undecided cells."""
    pairs = np.concatenate([level.edges for level in sheet.tree.levels] + sheet.links, axis=1)
    size = sheet.tree.size
    ones = np.ones(pairs.shape[1], np.int8)
    return coo_array((np.tile(ones, 2), (np.concatenate(pairs), np.concatenate(pairs[::-1]))), (size, size)).tocsr()


def _route(graph: csr_array, first: int, last: int) -> np.ndarray:
    """Returns the cells of a path with fewest cells: it keeps to large ones, far from walls."""
    _, before = breadth_first_order(graph, last, directed=False)
    cells = [first]
    while cells[-1] != last:
        cells.append(int(before[cells[-1]]))
    return np.array(cells)


def _between(sheet: Sheet, point: np.ndarray, centres: np.ndarray, widths: np.ndarray) -> list[np.ndarray]:
    """Returns the points by which a path goes from a cell to the next: by the face they share, to its centre."""
    centre = unrolled(sheet, centres[0], point)
    target = unrolled(sheet, centres[1], centre)
    gap = np.abs(target - centre) - 0.5 * widths.sum(axis=0)
    axis = int(np.argmax(gap / widths.min(axis=0)))
    small = int(np.argmin(widths[:, axis]))
    if np.sum(gap > -1e-6 * widths.min(axis=0)) > 1 or abs(gap[axis]) > 1e-6 * widths[small, axis]:
        # No common face: a line through an undecided cell, from centre to centre.
        return [centre, target]
    face = (centre, target)[small].copy()
    face[axis] = centre[axis] + np.sign(target[axis] - centre[axis]) * 0.5 * widths[0, axis]
    return [face, target]
