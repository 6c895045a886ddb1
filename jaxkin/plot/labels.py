"""Where the labels of regions stand in a picture."""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy import ndimage

#: Regions smaller than this share of the picture get no label; the legend still names them.
_SHARE = 0.004
#: Labels are placed on a picture of at most so many samples a side.
SAMPLES = 400


def label_places(
    x: np.ndarray, y: np.ndarray, values: np.ndarray, present: Iterable[int], lines: Sequence[np.ndarray] = ()
) -> list[tuple[float, float, int]]:
    """Returns the point farthest from the border, and from all lines, of every region large enough for a label.

    Args:
        x: ``(n,)`` abscissas of the samples.
        y: ``(m,)`` ordinates.
        values: ``(m, n)`` whole numbers; equal neighbours are a region.
        present: Which of them get a label.
        lines: Points that labels keep away from, ``(k, 2)`` each.
    """
    step = max(1, -(-max(values.shape) // SAMPLES))
    small, x, y = values[::step, ::step], x[::step], y[::step]
    places, free = [], np.ones(small.shape, bool)
    for line in lines:
        column, row = (np.searchsorted(axis, line[:, k]) for k, axis in enumerate((x, y)))
        inside = (column < len(x)) & (row < len(y))
        free[row[inside], column[inside]] = False
    for number in present:
        pieces, count = ndimage.label(small == number)  # type: ignore[misc]
        sizes = np.bincount(pieces.ravel(), minlength=count + 1)
        for piece in range(1, count + 1):
            if sizes[piece] < _SHARE * small.size:
                continue
            # A frame of other samples keeps labels off the edge of the picture.
            depth = np.asarray(ndimage.distance_transform_edt(np.pad((pieces == piece) & free, 1)))[1:-1, 1:-1]
            row, column = np.unravel_index(int(np.argmax(depth)), depth.shape)
            places.append((float(x[column]), float(y[row]), number))
    return places
