"""Proof that a body of poses meets no wall: boxes are halved until interval arithmetic excludes a zero in each."""

import jax.numpy as jnp
import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.design.growing import Growth
from jaxkin.design.walls import enclosable
from jaxkin.numerics.enclosure import UnsupportedOperation, enclosure_of, taylor_remainder

#: Boxes that are looked at before a proof is given up, and at once.
_MOST_BOXES, _AT_ONCE = 400_000, 20_000


def proved_free(growth: Growth, robot: Mechanism, center: np.ndarray, size: float) -> str:
    """Returns how it was proved that the body of a size meets no wall, or "" where it was not.

    Args:
        growth: The body and its walls.
        robot: One mechanism with plain numbers.
        center: ``(n_pose,)``.
        size: In units of the place, positive.
    """
    bounds = enclosable(robot, growth.walls, center)
    if bounds is None:
        return ""
    free = [*growth.growing, *growth.spans]
    scale = np.array([growth.place.half[k] * (size if k in growth.growing else 1.0) for k in free])

    def walls(theta, x):  # type: ignore[no-untyped-def]
        robot, middle = theta
        moved = {k: x[place] * scale[place] for place, k in enumerate(free)}
        return bounds.values(robot, jnp.stack([middle[k] + moved.get(k, 0.0) for k in range(len(center))]))

    theta = (robot, np.asarray(center, float))
    m = len(growth.growing) if growth.is_ball else 0
    try:
        enclosure = enclosure_of(walls, theta, len(free))
        count = _excluded(enclosure, theta, len(free), m)
    except UnsupportedOperation:
        return ""
    return f"proved free by {count} boxes" if count else ""


def _excluded(enclosure, theta, dimension: int, ball: int) -> int:  # type: ignore[no-untyped-def]
    """Returns the number of boxes in which zeros are excluded, 0 where some box withstands."""
    low, high = -np.ones((dimension, 1)), np.ones((dimension, 1))
    count = 0
    while low.shape[1]:
        count += low.shape[1]
        if count > _MOST_BOXES:
            return 0
        left: list[np.ndarray] = []
        for start in range(0, low.shape[1], _AT_ONCE):
            part = low[:, start : start + _AT_ONCE], high[:, start : start + _AT_ONCE]
            least, most = _bounds(enclosure, theta, *part)
            clear = (least > 0) | (most < 0)
            rest = ~clear.all(axis=0)
            left.append(np.concatenate([part[0][:, rest], part[1][:, rest]]))
        both = np.concatenate(left, axis=1)
        low, high = _halved(both[:dimension], both[dimension:], ball)
    return count


def _bounds(enclosure, theta, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    """Returns bounds of every wall over boxes ``(m, B)``, by a Taylor form of second order about their centres."""
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    over = enclosure(theta, low, high)
    at = enclosure(theta, centre, centre)
    linear = sum(
        np.maximum(np.abs(at.first[0][k]), np.abs(at.first[1][k])) * half[k] for k in range(len(half))
    ) + taylor_remainder(over, half)
    slack = 1e-12 * (1 + np.abs(at.value[0]))
    least = np.fmax(over.value[0], at.value[0] - linear - slack)
    most = np.fmin(over.value[1], at.value[1] + linear + slack)
    return least, most


def _halved(low: np.ndarray, high: np.ndarray, ball: int) -> tuple[np.ndarray, np.ndarray]:
    """Halves boxes across their longest side, and drops those outside the unit ball of the first coordinates."""
    if not low.shape[1]:
        return low, high
    side = np.argmax(high - low, axis=0)
    columns = np.arange(low.shape[1])
    middle = 0.5 * (low[side, columns] + high[side, columns])
    first_high, second_low = high.copy(), low.copy()
    first_high[side, columns] = second_low[side, columns] = middle
    low, high = np.concatenate([low, second_low], axis=1), np.concatenate([first_high, high], axis=1)
    if ball:
        nearest = np.clip(0.0, low[:ball], high[:ball])
        inside = np.sum(nearest**2, axis=0) <= 1.0
        low, high = low[:, inside], high[:, inside]
    return low, high
