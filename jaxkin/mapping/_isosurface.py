"""Zero surfaces of values sampled at the nodes of a grid: triangles, and which edge of the grid each vertex lies on."""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

#: Marching cubes works in float32; no vertex is placed nearer to a node than this share of an edge, so that the edge
#: it lies on can be read off its coordinates.
_FLOOR = 0.02
#: A coordinate closer to an integer than this is one.
_INTEGER = 2e-4
#: Values at two glued faces that agree to this share of the largest value are the same.
_AGREE = 1e-9
#: A value smaller than this share of the largest around it is rounding.
_NOISE = 1e-12


class Mesh(NamedTuple):
    """Triangles of a zero surface, vertices still unpolished.

    Attributes:
        axis: ``(k,)`` axis of the grid edge that the vertex lies on; 3 for a vertex inside a cell.
        node: ``(k, 3)`` indices of the edge's lower end, or of the cell's lowest corner.
        place: ``(k, 3)`` index coordinates of the vertex.
        faces: ``(m, 3)`` vertex numbers.
        seams: For each axis ``(n, 2)``, vertex on the low face and its twin on the high face; empty if not glued.
    """

    axis: np.ndarray
    node: np.ndarray
    place: np.ndarray
    faces: np.ndarray
    seams: tuple[np.ndarray, ...]


def quieten(values: np.ndarray) -> None:
    """Sets to zero what is rounding, as on a face of the box that lies in the surface: it then has one sign."""
    values[np.abs(values) <= _NOISE * _largest_around(values)] = 0.0


def _largest_around(values: np.ndarray) -> np.ndarray:
    return ndimage.maximum_filter(np.abs(np.nan_to_num(values)), size=3)


def glue(values: np.ndarray, axis: int) -> bool:
    """Copies the low face of an axis to the high one, with the sign that it has there; returns whether it did.

    What is periodic up to its sign (a factor in half angles) has the same zeros on both faces, but rounding may
    tell otherwise; after the copy marching cubes finds the same curve on both.
    """
    low, high = np.take(values, 0, axis), np.take(values, -1, axis)
    scale = np.nanmax(np.abs(values), initial=0.0)
    same, opposite = (np.nanmax(np.abs(high - sign * low), initial=0.0) for sign in (1, -1))
    if min(same, opposite) > _AGREE * scale:
        return False
    # On a face that is all zero the sign says nothing; plus then finds a surface in the face once, not twice.
    sign = -1 if opposite <= _AGREE * scale < same else 1
    np.moveaxis(values, axis, 0)[-1] = sign * low
    return True


def extract(values: np.ndarray, glued: tuple[bool, ...]) -> Mesh | None:
    """Finds the zero surface of sampled values.

    Args:
        values: ``(n0, n1, n2)``; NaN where undefined: the cells around are left out. Zero counts as positive.
        glued: Axes whose low and high face are the same (``glue`` did it).

    Returns:
        The mesh, or None if no cell has both signs.

    References:
        Lewiner, T. et al., 2003, "Efficient implementation of marching cubes' cases with topological guarantees".
    """
    from skimage.measure import marching_cubes

    level = _levelled(values, glued)
    defined = np.isfinite(values)
    # In scikit-image the mask of a cell is that of its highest corner.
    mask = np.zeros(values.shape, bool)
    corners = [defined[tuple(slice(c, c - 1 or None) for c in corner)] for corner in np.ndindex(2, 2, 2)]
    mask[1:, 1:, 1:] = np.logical_and.reduce(corners)
    if not mask.any() or np.all(level > 0) or np.all(level < 0):
        return None
    try:
        place, faces, _, _ = marching_cubes(level, 0.0, mask=mask)
    except RuntimeError:  # No cell of the mask is crossed.
        return None
    return _keyed(np.asarray(place, float), np.asarray(faces, np.int64), values.shape, glued)


def _levelled(values: np.ndarray, glued: tuple[bool, ...]) -> np.ndarray:
    """Divides every value by the largest around it: signs stay, and float32 suffices for the rest."""
    filled, around = np.nan_to_num(values), _largest_around(values)
    share = np.abs(filled) / np.where(around > 0, around, 1.0)
    level = np.where(filled < 0, -1.0, 1.0) * np.maximum(share, _FLOOR)
    for axis in np.flatnonzero(glued):
        turned = np.moveaxis(level, axis, 0)
        # Zero counts as positive on the low face, and as the same zero on the high one.
        sign = np.sum(turned[0] * turned[-1] * np.isfinite(np.take(values, 0, axis)))
        turned[-1] = np.where(sign < 0, -1, 1) * turned[0]
    return level


def _keyed(place: np.ndarray, faces: np.ndarray, shape: tuple[int, ...], glued: tuple[bool, ...]) -> Mesh:
    """Names every vertex by its edge, which makes it unique and lets the faces of glued axes be matched."""
    off = np.abs(place - np.round(place)) > _INTEGER
    inside = off.sum(axis=1) > 1
    axis = np.where(inside, 3, np.argmax(off, axis=1))
    node = np.where(off, np.floor(place), np.round(place)).astype(np.int64)
    node[inside] = np.floor(place[inside])
    names = np.ravel_multi_index((axis, *node.T), (4, *shape))
    _, first, inverse = np.unique(names, return_index=True, return_inverse=True)
    axis, node, place, faces = axis[first], node[first], place[first], inverse.reshape(-1)[faces]
    seams = tuple(
        _twins(axis, node, shape, k) if joined else np.zeros((0, 2), np.int64) for k, joined in enumerate(glued)
    )
    return Mesh(axis, node, place, faces, seams)


def _twins(axis: np.ndarray, node: np.ndarray, shape: tuple[int, ...], k: int) -> np.ndarray:
    in_face = (axis != k) & (axis != 3)
    low, high = (np.flatnonzero(in_face & (node[:, k] == end)) for end in (0, shape[k] - 1))
    below = node.copy()
    below[high, k] = 0
    names = np.ravel_multi_index((axis, *below.T), (4, *shape))
    _, i, j = np.intersect1d(names[low], names[high], return_indices=True)
    return np.stack([low[i], high[j]], axis=1)


def single_edges(faces: np.ndarray) -> np.ndarray:
    """Returns the edges that only one triangle has, ``(b, 2)``: the rim of the surface."""
    edges, count = np.unique(all_edges(faces), axis=0, return_counts=True)
    return edges[count == 1]


def all_edges(faces: np.ndarray) -> np.ndarray:
    """Returns the three edges of every triangle, ``(3 m, 2)``, lower vertex number first; shared ones repeat."""
    return np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
