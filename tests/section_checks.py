"""Sections of the joint space of 3-RPR robots, and a mechanism with a determinant of choice, shared by tests."""

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

import jaxkin as jk
from jaxkin.mechanisms import rpr3

#: Certified cusps and exact numbers of components, see ``oracles/rpr3_sections.py``.
SECTIONS = json.loads((Path(__file__).parent / "data" / "rpr3_sections.json").read_text())["sections"]


def section(axis: int, value: float, high: float = 6.0, low: float = 0.0, n: int = 400) -> jk.Grid:
    """Returns the section of a 3-RPR with one leg (0, 1 or 2) fixed."""
    return jk.Grid(**{f"rho{k + 1}": value if k == axis else (low, high, n) for k in range(3)})


def stored(entry: dict[str, Any]) -> tuple[rpr3.GeneralRPR3, jk.Grid]:
    """Returns robot and section of an entry of ``SECTIONS``; the section holds every joint value that is reached."""
    size = sum(abs(entry["geometry"][name]) for name in ("c2", "c3", "d3", "l2", "l3"))
    grid = section(entry["fixed_axis"] - 1, entry["fixed_value"], 2 * (size + entry["fixed_value"]))
    return rpr3.general(**entry["geometry"]), grid


def relabelled(entry: dict[str, Any]) -> tuple[rpr3.GeneralRPR3, jk.Grid]:
    """Returns a stored robot and section with legs 2 and 3 exchanged.

    The frames turn so that their x axes pass the joints that are now called the second.
    """
    g, grid = entry["geometry"], stored(entry)[1]
    alpha = np.arctan2(g["d3"], g["c3"])
    robot = rpr3.general(
        np.hypot(g["c3"], g["d3"]), g["c2"] * np.cos(alpha), -g["c2"] * np.sin(alpha), g["l3"], g["l2"], -g["beta"]
    )
    swap = {"rho1": "rho1", "rho2": "rho3", "rho3": "rho2"}
    axes = {swap[name]: (v.low, v.high, v.count) if hasattr(v, "low") else v for name, v in grid.axes.items()}
    return robot, jk.Grid(**axes)


def rows(entry: dict[str, Any], name: str) -> np.ndarray:
    """Returns the cusps' joints ("rho") or poses ("pose") of an entry."""
    return np.array([cusp[name] for cusp in entry["cusps"]]).reshape(-1, 3)


@jax.jit
def _closing(robot: Any, poses: Array, joints: Array) -> tuple[Array, Array]:
    def one(pose: Array, q: Array) -> tuple[Array, Array]:
        length, terms = robot.characteristic_length(), robot.constraint_scales(pose, q)
        units = jnp.stack([jnp.ones(()) if axis.is_angle else length for axis in robot.pose_axes])
        return jnp.max(jnp.abs(jk.constraints(robot, pose, q)) / terms), jk.jacobians(robot, pose, q).direct * units

    closing, direct = jax.vmap(one)(poses, joints)
    sizes = jnp.linalg.norm(direct, axis=2)
    # Against the rows' lengths; those of a leg that almost vanishes count as a hundredth of the usual one.
    bound = jnp.prod(jnp.maximum(sizes, 1e-2 * jnp.median(sizes, axis=0)), axis=1)
    return jnp.max(closing), jnp.max(jnp.abs(jnp.linalg.det(direct)) / bound)


def residuals(robot: jk.Mechanism, poses: np.ndarray, joints: np.ndarray) -> tuple[float, float]:
    """Returns the largest dimensionless residual of the constraints, and of the determinant, over many points."""
    room = max(2048, 1 << (len(poses) - 1).bit_length())
    padded = (jnp.asarray(np.resize(a, (room, a.shape[1]))) for a in (poses, joints))
    closing, singular = _closing(robot, *padded)
    return float(closing), float(singular)


def steps(curve: jk.Curve, length: float) -> np.ndarray:
    """Returns the distances between neighbours in pose space, angles the short way; from last to first if closed."""
    following = np.roll(curve.poses, -1, axis=0) - curve.poses
    following[:, 2] = (following[:, 2] + np.pi) % (2 * np.pi) - np.pi
    sizes = np.linalg.norm(following / [length, length, 1.0], axis=1)
    return sizes if curve.closed else sizes[:-1]


def polyline_distance(points: np.ndarray, line: np.ndarray) -> np.ndarray:
    """Returns the distance of points ``(n, d)`` from a broken line ``(k, d)``."""
    start, chord = line[:-1], np.diff(line, axis=0)
    size = np.maximum(np.sum(chord**2, axis=1), 1e-300)
    best = np.full(len(points), np.inf)
    for some in np.array_split(np.arange(len(points)), 1 + len(points) // 256):
        share = np.clip(np.sum((points[some, None] - start) * chord, axis=2) / size, 0, 1)
        foot = start + share[..., None] * chord
        best[some] = np.min(np.linalg.norm(points[some, None] - foot, axis=2), axis=1)
    return best


def image(curve: jk.Curve, free: list[int]) -> np.ndarray:
    """Returns the curve in the plane of the free joints, closed curves with their first point repeated."""
    points = curve.joints[:, free]
    return np.concatenate([points, points[:1]]) if curve.closed else points


@jk.mechanism
class Sheet(jk.Mechanism):
    """q1 = x, q2 = a polynomial of x and y: its determinant is the polynomial's derivative by y."""

    pose_axes = (jk.Axis("x", "length", -2.0, 2.0), jk.Axis("y", "length", -2.0, 2.0))
    joint_axes = (jk.Axis("q1", "length", -9.0, 9.0), jk.Axis("q2", "length", -9.0, 9.0))

    coefficients: Array

    def constraints(self, pose: Array, joints: Array) -> Array:
        x, y = (jnp.stack([jnp.ones(()), v, v**2, v**3, v**4]) for v in pose)
        return jnp.stack([joints[0] - pose[0], joints[1] - x @ self.coefficients @ y])


def sheet(terms: dict[tuple[int, int], float]) -> Sheet:
    """Returns the mechanism whose q2 is the sum of terms[i, j] x^i y^j, and x (no row of A ever vanishes)."""
    coefficients = np.zeros((5, 5))
    for (i, j), value in terms.items():
        coefficients[i, j] = value
    coefficients[1, 0] += 1
    return Sheet(jnp.asarray(coefficients))
