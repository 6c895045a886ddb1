"""Factors and joint margins of a robot as functions of the rotation alone, which no Euler angles enter."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, concrete_reals
from jaxkin.core.tracing import is_traced
from jaxkin.numerics import haar, rotations

#: Names of the pose axes that are angles of R = Rx(phi) Ry(theta) Rz(sigma).
ANGLES = ("phi", "theta", "sigma")


def checked_concrete(who: str, **arguments: Any) -> None:
    """Raises if an argument is traced, for what no kernel can do."""
    for name, value in arguments.items():
        if any(map(is_traced, jax.tree_util.tree_leaves(value))):
            raise InputError(f"{who} cannot be traced, as {name} is: call it outside jax.jit, jax.vmap and jax.grad.")


def checked_tolerance(who: str, tolerance: Any, example: float, below: float = np.inf) -> float:
    """Returns a positive number below a bound, or says what the tolerance is instead."""
    checked_concrete(who, tolerance=tolerance)
    number = concrete_reals(tolerance)
    if number is None or number.shape != () or not 0 < float(number) < below:
        rule = "a positive number" if below == np.inf else f"a number between 0 and {below:g}"
        raise InputError(f"{who}: tolerance is {tolerance!r}: it must be {rule}; give {example:g}, for instance.")
    return float(number)


def checked_whole(who: str, name: str, value: Any, least: int, example: int) -> int:
    """Returns a whole number that is not below the least one, or says what it is instead."""
    checked_concrete(who, **{name: value})
    number = concrete_reals(value)
    if number is None or number.shape != () or not np.isfinite(number) or not least <= float(number) == int(number):
        raise InputError(
            f"{who}: {name} is {value!r}: it must be a whole number, at least {least}; give {example}, for instance."
        )
    return int(number)


def affine_factors(who: str, robot: Mechanism) -> tuple[tuple[str, ...], haar.Affine]:
    """Returns the names of the robot's factors, and the factors as affine functions of R.

    Raises:
        InputError: The robot has no factors or no orientation, or its factors are not affine in R or depend on
            position.
    """
    axes = tuple(axis.name for axis in robot.pose_axes)
    factors = getattr(robot, "factors", None)
    if not callable(factors) or axes[-3:] != ANGLES:
        raise InputError(
            f"{who} got a {type(robot).__name__}: it needs a mechanism whose last pose axes are {', '.join(ANGLES)} "
            "and which has a method factors(pose), as jk.mechanisms.ppps3.create()."
        )
    places = np.zeros(len(axes) - 3), np.linspace(0.7, 1.9, len(axes) - 3)
    names, here = _affine(who, "factors", factors, places[0])
    _, there = _affine(who, "factors", factors, places[1])
    if not all(np.allclose(one, two, rtol=1e-9, atol=1e-9) for one, two in zip(here, there, strict=True)):
        raise InputError(f"{who}: the factors of {type(robot).__name__} depend on the position, and not on R alone.")
    return names, here


def affine_margins(who: str, robot: Mechanism, position: np.ndarray) -> tuple[tuple[str, ...], haar.Affine]:
    """Returns the names of the finite joint margins at a position, and these margins as affine functions of R.

    Raises:
        InputError: The robot has no closed inverse kinematics, or several working modes, or its margins are not affine.
    """
    kernel = robot.inverse_kernel
    lanes = () if kernel is None else kernel(tuple(jnp.zeros(len(robot.pose_axes))))
    if kernel is None or len(lanes) != 1:
        raise InputError(
            f"{who} needs closed inverse kinematics with one working mode: {type(robot).__name__} has not."
        )

    def margins(pose: Array) -> dict[str, Array]:
        joints = jnp.stack(kernel(tuple(pose))[0].values)
        return robot.margins(pose, joints)

    at_home = margins(jnp.append(jnp.asarray(position), jnp.zeros(3)))
    kept = [name for name, value in at_home.items() if np.isfinite(float(value))]
    if not kept:
        return (), haar.Affine(np.zeros(0), np.zeros((0, 3, 3)))
    return _affine(who, "margins", lambda pose: {name: margins(pose)[name] for name in kept}, position)


def _affine(
    who: str, what: str, function: Callable[..., Any], position: np.ndarray
) -> tuple[tuple[str, ...], haar.Affine]:
    place = jnp.asarray(position, float)
    names: list[str] = []

    @jax.jit
    @jax.vmap
    def values(matrix: Array) -> Array:
        angles = jnp.stack(rotations.xyz_from_matrix(rotations.from_array(matrix)))
        named = function(jnp.concatenate([place, angles]))
        names[:] = named
        return jnp.stack(list(named.values()))

    try:
        found = haar.affine(lambda r: np.asarray(values(jnp.asarray(r))).T)
    except InputError as error:
        raise InputError(f"{who} integrates {what} that are affine in the entries of R. {error}") from error
    return tuple(names), found
