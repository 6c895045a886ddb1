"""Many triangles in three dimensions, transparent as a whole."""

import numpy as np
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection


def add_layers(ax: Axes3D, triangles: np.ndarray, paint: np.ndarray, opacity: float) -> None:
    """Draws triangles of all surfaces together, so that they are sorted by depth where surfaces cross.

    Transparent triangles would show their seams, so the picture has two opaque layers: the farthest surface at each
    point (painted from the nearest on), and over it, transparent as a whole, the nearest one.

    Args:
        ax: Where; its ``computed_zorder`` must be off. The layers have the orders 1 and 2.
        triangles: ``(n, 3, 3)`` corners.
        paint: ``(n, 3)`` or ``(n, 4)`` colours.
        opacity: Share of colour of the nearest surface at each point of the picture; the farthest one has the rest.
    """
    for zorder in (1, 2):
        # Edges in the colour of their triangle close the gaps that antialiasing leaves.
        layer = Poly3DCollection(triangles, facecolors=paint, edgecolors=paint, linewidths=0.25, zorder=zorder)
        # As vectors, tens of thousands of triangles fill megabytes of a PDF and show their seams.
        layer.set_rasterized(True)
        if zorder == 1:
            # There is no public order from near to far; without it the picture is merely opaque.
            layer._zsortfunc = _nearest_first  # type: ignore[attr-defined]
        else:
            layer.set_agg_filter(_Thinned(opacity))  # type: ignore[arg-type]
        ax.add_collection3d(layer, autolim=False)


def add_lines(ax: Axes3D, segments: np.ndarray, **options: object) -> None:
    """Draws segments ``(n, 2, 3)``."""
    if len(segments):
        ax.add_collection3d(Line3DCollection(segments, capstyle="round", **options), autolim=False)  # type: ignore[arg-type]


def light(ax: Axes3D) -> np.ndarray:
    """Returns the direction ``(3,)`` of a light that stands beside the eye, for faces seen from the present view."""
    turn = np.radians(ax.azim + 30.0)
    return np.array([np.cos(turn), np.sin(turn), 0.9])


def add_outlines(ax: Axes3D, segments: np.ndarray, triangles: np.ndarray) -> None:
    """Draws edges of surfaces: over the layers of triangles where nothing hides them from the present view.

    Args:
        ax: Framed Axes with layers.
        segments: ``(n, 2, 3)``.
        triangles: ``(m, 3, 3)`` all that may hide them.
    """
    front = visible(ax, segments.mean(axis=1), triangles)
    add_lines(ax, segments[~front], colors="black", linewidths=0.8, zorder=1.5)
    add_lines(ax, segments[front], colors="black", linewidths=1.0, zorder=3)


#: A point counts as hidden by what is nearer than it by this share of the picture's depth.
_NEARER = 0.01
#: Numbers of a point's tests against all triangles that are in memory at a time.
_TESTS = 1 << 21


def visible(ax: Axes3D, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Returns ``(n,)`` True for the points that no triangle hides from the present view of framed Axes."""
    matrix = ax.get_proj()
    flat = _projected(triangles.reshape(-1, 3), matrix).reshape(-1, 3, 3)
    own = _projected(points, matrix)
    a, u, v = flat[:, 0], flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    kept = np.abs(area) > 1e-14
    a, u, v, area = a[kept], u[kept], v[kept], area[kept]
    depth = _NEARER * max(float(np.ptp(flat[..., 2])), 1e-12) if len(flat) else 0.0
    seen = np.ones(len(points), bool)
    step = max(1, _TESTS // max(1, len(a)))
    for start in range(0, len(points), step):
        w = own[start : start + step, None] - a
        s = (w[..., 0] * v[:, 1] - w[..., 1] * v[:, 0]) / area
        t = (u[:, 0] * w[..., 1] - u[:, 1] * w[..., 0]) / area
        inside = (s >= 0) & (t >= 0) & (s + t <= 1)
        # Depth grows away from the eye.
        nearer = s * u[:, 2] + t * v[:, 2] - w[..., 2] < -depth
        seen[start : start + step] = ~(inside & nearer).any(axis=1)
    return seen


def _projected(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    return np.stack(proj3d.proj_transform(x, y, z, matrix), axis=1)


def _nearest_first(depths: np.ndarray, axis: int = -1) -> np.ndarray:
    return -np.mean(depths, axis=axis)


class _Thinned:
    """Makes a drawn layer transparent as a whole."""

    def __init__(self, opacity: float):
        self.opacity = opacity

    def __call__(self, image: np.ndarray, dpi: float) -> tuple[np.ndarray, int, int]:
        del dpi
        return image * np.array([1.0, 1.0, 1.0, self.opacity]), 0, 0
