"""Random members of the analytic 3-RPR family, and what every point of its singular curves must satisfy."""

from collections.abc import Callable
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from jaxkin.mechanisms.rpr3 import AnalyticRPR3

_signs, _sizes = st.sampled_from([-1.0, 1.0]), st.floats(0.3, 2)
#: (c2, c3, d3).
geometries = st.builds(lambda s, a, c, z, d: (s * a, c, z * d), _signs, _sizes, st.floats(-2, 2), _signs, _sizes)
lengths = st.tuples(*[st.floats(0.1, 4)] * 3)
#: The fixed leg and its length.
sections = st.tuples(st.integers(0, 2), st.floats(0.1, 3))
few = settings(max_examples=25)


def sides(geometry: tuple[float, ...]) -> float:
    """Returns the product of the sides of the base triangle, the natural unit of the cubic (7)."""
    c2, c, d = geometry
    return abs(c2) * np.hypot(c, d) * np.hypot(c2 - c, d)


@cache
def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    return jax.jit(function)


def padded(function: Callable[..., Any], robot: AnalyticRPR3, points: np.ndarray) -> Any:
    """Calls an elementwise function without compiling it for every number of points."""
    values = _compiled(function)(
        robot, jnp.asarray(np.resize(points, (8192, 3)) if len(points) else np.ones((8192, 3)))
    )
    return jax.tree.map(lambda v: np.asarray(v)[: len(points)], values)


def squared_lengths(geometry: tuple[float, ...], poses: np.ndarray) -> np.ndarray:
    """Returns the right-hand sides of Wenger and Chablat 2009, Eqs. (1)-(3), under conditions (6)."""
    (c2, c, d), (x, y, phi) = geometry, np.moveaxis(poses, -1, 0)
    cos, sin = np.cos(phi), np.sin(phi)
    legs = (x, y), (x + c2 * cos - c2, y + c2 * sin), (x + c * cos + d * sin - c, y + c * sin - d * cos - d)
    return np.stack([u * u + v * v for u, v in legs], axis=-1)


def assert_on_constraints(geometry: tuple[float, ...], poses: np.ndarray, joints: np.ndarray) -> None:
    """Checks the residuals, relative to the squared lengths of leg and robot."""
    gaps = np.abs(squared_lengths(geometry, poses) - joints**2) / (joints**2 + np.dot(geometry, geometry))
    assert np.max(gaps, initial=0) < 1e-13


def factors(robot: AnalyticRPR3, geometry: tuple[float, ...], poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the magnitudes of f1 and f2, dimensionless."""
    values = padded(_factors, robot, poses)
    length = np.sum(np.abs(geometry))
    size = np.hypot(poses[:, 0], poses[:, 1]) + length
    return np.abs(values["f1"]) / size, np.abs(values["f2"]) / (abs(geometry[2]) * size + length**2)


def _factors(robot: AnalyticRPR3, poses: jax.Array) -> dict[str, jax.Array]:
    return jax.vmap(robot.factors)(poses)
