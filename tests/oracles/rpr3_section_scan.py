"""Cusps and components of a section by scanning its torus: signs on the nodes of a grid. See ``rpr3_torus``."""

from __future__ import annotations

import numpy as np

from .rpr3_torus import Geometry, Scan, Section


def scan(geometry: Geometry, fixed_axis: int, fixed_value: float, size: int) -> Scan:
    """Counts closed curves and cusps on a grid of size x size cells.

    Each grid edge over which D changes its sign carries one point of the curve; the points of a cell are joined
    in pairs, by the sign of D in its centre where there are four. True once the cells resolve the curve.
    """
    section = Section(geometry, fixed_axis, fixed_value)

    def values(alpha: np.ndarray, phi: np.ndarray) -> np.ndarray:
        return section.functions(np.cos(alpha), np.sin(alpha), np.cos(phi), np.sin(phi))[0]

    h = 2 * np.pi / size
    # An irrational offset: symmetric robots would put zeros on the nodes.
    axis = 0.0123456789 + h * np.arange(size)
    alpha, phi = np.meshgrid(axis, axis, indexing="ij")
    positive = values(alpha, phi) > 0
    index, cokernel, bend, count = [], [], [], 0
    for direction in (0, 1):
        crossed = positive != np.roll(positive, -1, direction)
        a, p, first = alpha[crossed], phi[crossed], positive[crossed]
        low, high = np.zeros(len(a)), np.full(len(a), h)
        for _ in range(52):
            middle = (low + high) / 2
            same = (values(a + middle * (direction == 0), p + middle * (direction == 1)) > 0) == first
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        a, p = a + low * (direction == 0), p + low * (direction == 1)
        w, b = section.fold(np.cos(a), np.sin(a), np.cos(p), np.sin(p))
        cokernel.append(w)
        bend.append(b)
        index.append(np.full(positive.shape, -1))
        index[-1][crossed] = count + np.arange(len(a))
        count += len(a)
    w, side = np.concatenate(cokernel, axis=1), np.concatenate(bend)
    # Edges of the cell (i, j): low phi, high alpha, high phi, low alpha; the corners between them in that order.
    edges = np.stack([index[0], np.roll(index[1], -1, 0), np.roll(index[0], -1, 1), index[1]], -1)
    crossings = np.sum(edges >= 0, -1)
    links = [np.sort(edges[crossings == 2], axis=-1)[:, 2:]]
    four = crossings == 4
    centre = values(alpha[four] + h / 2, phi[four] + h / 2) > 0
    corner = positive[four] == centre  # the corner (i, j) is joined to its opposite: cut off the other two
    e = edges[four]
    pairs = np.where(corner[:, None, None], e[:, [[0, 1], [2, 3]]], e[:, [[3, 0], [1, 2]]])
    links = np.concatenate([*links, pairs.reshape(-1, 2)])
    parent = list(range(count))
    components = count
    for p, q in links.tolist():
        p, q = _find(parent, p), _find(parent, q)
        if p != q:
            parent[p] = q
            components -= 1
    p, q = links.T
    return Scan(components, int(np.sum(side[p] * side[q] * np.sum(w[:, p] * w[:, q], axis=0) < 0)))


def _find(parent: list[int], i: int) -> int:
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i
