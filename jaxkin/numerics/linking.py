"""How closed polygons are linked in space, and wind around points in the plane: integers, from angles that add up.

A curve that ends on the border of a convex box has a linking number with a loop inside that box too: closed outside the
box in whatever way, it is linked with the loop in the same way, as what is outside of a ball in space is simply
connected. The number is that of the signed crossings of the curve with any surface inside the box that spans the loop.
"""

import itertools

import numpy as np

from jaxkin.numerics.segments import distance

#: A sum of angles that is farther from a whole number of turns is not decided (a polygon runs through the other).
_WHOLE = 1e-6
#: A crossing nearer than this to an edge of the spanning surface, over its size, is not decided.
_EDGE = 1e-9
_ROWS = 256


def linking_number(first: np.ndarray, second: np.ndarray) -> int | None:
    """Returns the linking number of two closed polygons in space, by Gauss's integral.

    The integral over a pair of edges is the solid angle of a spherical quadrilateral, in closed form: the sum is a
    whole number up to rounding.

    Args:
        first: ``(k, 3)`` vertices; the first is not repeated at the end.
        second: ``(m, 3)``.

    Returns:
        The number, positive where ``second`` crosses a surface that spans ``first`` along its normal (by the right
        hand); None where the polygons touch, to rounding.

    References:
        Gauss, C. F., 1833; Arai, Z., 2013, "A rigorous numerical algorithm for computing the linking number of links",
        Nonlinear Theory and Its Applications 4(1), Theorem 1.
    """
    first, second = np.asarray(first, float), np.asarray(second, float)
    after = np.roll(second, -1, axis=0)
    total = 0.0
    for start in range(0, len(first), _ROWS):
        rows = np.arange(start, min(start + _ROWS, len(first)))
        p, q = first[rows, None], first[(rows + 1) % len(first), None]
        a, b, c, d = second[None] - p, second[None] - q, after[None] - q, after[None] - p
        total += float(np.sum(_solid_angle(a, b, c) + _solid_angle(c, d, a)))
    turns = total / (4 * np.pi)
    whole = round(turns) if np.isfinite(turns) else 0
    return int(whole) if abs(turns - whole) <= _WHOLE else None


def _solid_angle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Returns the signed solid angle of three directions (Van Oosterom and Strackee 1983)."""
    volume = np.sum(a * np.cross(b, c), axis=-1)
    sizes = [np.sqrt(np.sum(v * v, axis=-1)) for v in (a, b, c)]
    ab, bc, ca = (np.sum(u * v, axis=-1) for u, v in ((a, b), (b, c), (c, a)))
    return 2 * np.arctan2(volume, sizes[0] * sizes[1] * sizes[2] + ab * sizes[2] + bc * sizes[0] + ca * sizes[1])


def spanning_crossings(loop: np.ndarray, curve: np.ndarray) -> int | None:
    """Returns how often, with sign, a curve crosses surfaces that span a closed polygon.

    For a curve whose ends lie on the border of a convex box that holds the loop this is its linking number relative to
    the box: that of the curve closed outside the box. The surfaces are cones over the loop with their tips in its
    convex hull; cones with different tips must agree.

    Args:
        loop: ``(k, 3)`` vertices; the first is not repeated at the end.
        curve: ``(m, 3)`` an open polygon.

    Returns:
        The number, with the sign of ``linking_number``; None where the curve meets the edge of a cone's triangle, to
        rounding, or two cones disagree (the ends of the curve do not lie on the border then).
    """
    loop, curve = np.asarray(loop, float), np.asarray(curve, float)
    centre = np.mean(loop, axis=0)
    # Tips off the axes of symmetry, where edges of the cone might run through the curve.
    some = [loop[int(share * len(loop))] for share in (0.0, 0.11, 0.29, 0.53, 0.71)]
    tips = [centre, *(0.53 * centre + 0.29 * a + 0.18 * b for a, b in itertools.pairwise(some))]
    counts = {_cone_crossings(loop, curve, tip) for tip in tips} - {None}
    return counts.pop() if len(counts) == 1 else None


def _cone_crossings(loop: np.ndarray, curve: np.ndarray, tip: np.ndarray) -> int | None:
    u, v = loop - tip, np.roll(loop, -1, axis=0) - tip
    normal = np.cross(u, v)
    points = curve - tip
    above = points @ normal.T >= 0
    total = 0
    for start, end, before, after in zip(points[:-1], points[1:], above[:-1], above[1:], strict=True):
        # The segment meets the plane of triangle k, at a u + b v; a vertex in the plane counts as above it.
        meets = np.flatnonzero(before != after)
        if len(meets) == 0:
            continue
        slope, side = normal[meets] @ (end - start), np.cross(start, end - start)
        a, b = -(v[meets] @ side) / slope, (u[meets] @ side) / slope
        near = np.minimum.reduce([a, b, 1 - a - b])
        if not np.all(np.abs(near) > _EDGE):
            return None
        total += int(np.sum(np.sign(slope[near > 0])))
    return total


def winding_number(loop: np.ndarray, point: np.ndarray) -> int | None:
    """Returns how often a closed polygon in the plane runs around a point, counter-clockwise; None where through it.

    Args:
        loop: ``(k, 2)`` vertices; the first is not repeated at the end.
        point: ``(2,)``.
    """
    a = np.asarray(loop, float) - np.asarray(point, float)
    b = np.roll(a, -1, axis=0)
    angles = np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.sum(a * b, axis=1))
    turns = float(np.sum(angles)) / (2 * np.pi)
    through = np.any(np.abs(np.abs(angles) - np.pi) < 1e-12) or np.any(np.sum(a * a, axis=1) == 0)
    return None if through or abs(turns - round(turns)) > _WHOLE else round(turns)


def polygon_distances(curve: np.ndarray, loop: np.ndarray) -> np.ndarray:
    """Returns the distance of every segment of an open polygon ``(m, 3)`` from another one ``(k, 3)``, ``(m - 1,)``."""
    p, u = curve[:-1, None], np.diff(curve, axis=0)[:, None]
    q, v = loop[None, :-1], np.diff(loop, axis=0)[None]
    parts = [tuple(np.moveaxis(part, -1, 0)) for part in (p, u, q, v)]
    return np.min(np.asarray(distance(*parts)), axis=1)  # type: ignore[arg-type]


def sagittas(polygon: np.ndarray) -> np.ndarray:
    """Returns for every segment of an open polygon how far its vertices turn away from straight, ``(m - 1,)``.

    The distance of a vertex from the line through its neighbours: four times that of a smooth curve from its chord.
    """
    if len(polygon) < 3:
        return np.zeros(max(len(polygon) - 1, 0))
    chord, side = polygon[2:] - polygon[:-2], polygon[1:-1] - polygon[:-2]
    length = np.sqrt(np.sum(chord * chord, axis=1))
    along = np.sum(side * chord, axis=1) / np.where(length > 0, length, 1.0) ** 2
    away = side - np.clip(along, 0.0, 1.0)[:, None] * chord
    height = np.sqrt(np.sum(away * away, axis=1))
    return np.maximum(np.append(height, height[-1]), np.insert(height, 0, height[0]))
