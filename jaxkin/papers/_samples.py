"""Random points at which printed equations are compared, and how differences are measured."""

from typing import Any

import numpy as np

SEED = 2009
SAMPLES = 500
#: Allowed differences are of a few roundings, of the largest magnitude met.
ROUNDING = 1e-12


def off_by(one: Any, other: Any) -> float:
    """Returns the largest difference, relative to the largest magnitude of the other."""
    return float(np.max(np.abs(np.asarray(one) - np.asarray(other))) / np.max(np.abs(np.asarray(other))))


def random_geometries(rng: np.random.Generator, size: int = SAMPLES) -> tuple[np.ndarray, ...]:
    """Returns c2, c3, d3 of members of the family, of either sign and of order one."""
    signs = rng.choice([-1.0, 1.0], (2, size))
    return signs[0] * rng.uniform(0.5, 2, size), rng.uniform(-2, 2, size), signs[1] * rng.uniform(0.3, 2, size)


def random_poses(rng: np.random.Generator, size: int = SAMPLES) -> tuple[np.ndarray, ...]:
    """Returns x, y, phi."""
    # Away from phi = pi, where t = tan(phi/2) has no value.
    return rng.uniform(-3, 3, size), rng.uniform(-3, 3, size), rng.uniform(-3, 3, size)


def at_random(where: str) -> str:
    """Returns the words for where something was compared."""
    return f"at {SAMPLES} random {where}"
