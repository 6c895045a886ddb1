"""The numbers of a mechanism by name: what a design may vary, and a sweep over geometries run over.

A scalar field bears its own name (``c3``); an entry of a vector is ``proximal[0]``, and ``proximal`` all its entries,
set alike; limits are named as their margins are, ``rho1_low`` and ``rho1_high``.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Limits, Mechanism
from jaxkin.core.words import meant


class LeafPlace(NamedTuple):
    """Where a number stands.

    Attributes:
        field: The field of the mechanism.
        end: ``low`` or ``high`` of limits, else empty.
        entry: Place in a vector; None for a scalar, and for a whole vector.
    """

    field: str
    end: str
    entry: int | None


def leaf_places(robot: Mechanism) -> dict[str, LeafPlace]:
    """Returns the names of a mechanism's numbers and where each stands; whole vectors after their entries."""
    places: dict[str, LeafPlace] = {}
    limited = robot.limit_fields()
    for field in fields(robot):  # type: ignore[arg-type]
        if field.metadata.get("static", False):
            continue
        value = getattr(robot, field.name)
        if isinstance(value, Limits):
            for k, name in enumerate(limited.get(field.name, ())):
                places[f"{name}_low"] = LeafPlace(field.name, "low", k)
                places[f"{name}_high"] = LeafPlace(field.name, "high", k)
        elif jnp.ndim(value) == 0:
            places[field.name] = LeafPlace(field.name, "", None)
        else:
            for k in range(jnp.shape(value)[-1]):
                places[f"{field.name}[{k}]"] = LeafPlace(field.name, "", k)
            places[field.name] = LeafPlace(field.name, "", None)
    return places


def checked_leaf(robot: Mechanism, name: str) -> LeafPlace:
    """Returns where a number stands.

    Raises:
        InputError: The mechanism has none of that name.
    """
    places = leaf_places(robot)
    if name in places:
        return places[name]
    known = ", ".join(places)
    raise InputError(
        f"{robot.id or type(robot).__name__} has no number {name!r}: choose among {known}{meant(name, places)}"
    )


def with_leaves(robot: Mechanism, values: Mapping[str, ArrayLike]) -> Mechanism:
    """Returns a copy with other numbers, by name; traceable, and like ``replace`` it checks no geometry.

    Raises:
        InputError: The mechanism has no number of a name.
    """
    changed: dict[str, Any] = {}
    for name, value in values.items():
        place = checked_leaf(robot, name)
        whole = changed.get(place.field, getattr(robot, place.field))
        vector = getattr(whole, place.end) if place.end else whole
        vector = _put(vector, place.entry, jnp.asarray(value, dtype=float))
        if place.end:
            vector = Limits(**{"low": whole.low, "high": whole.high, place.end: vector})
        changed[place.field] = vector
    return robot.replace(**changed)


def leaf_value(robot: Mechanism, name: str) -> Array:
    """Returns a number by its name; of a whole vector its first entry.

    Raises:
        InputError: The mechanism has none of that name.
    """
    place = checked_leaf(robot, name)
    whole = getattr(robot, place.field)
    vector = getattr(whole, place.end) if place.end else whole
    if place.entry is not None:
        return vector[..., place.entry]
    return vector if jnp.ndim(vector) == 0 else vector[..., 0]


def leaf_unit(robot: Mechanism, name: str) -> str:
    """Returns the unit of a number: that of the mechanism's lengths, unless it says otherwise.

    Raises:
        InputError: The mechanism has no number of that name.
    """
    place = checked_leaf(robot, name)
    if place.end:
        return robot.margin_unit(name)
    lengths = [axis.unit for axis in (*robot.pose_axes, *robot.joint_axes) if not axis.is_angle]
    return robot.leaf_units.get(place.field, lengths[0] if lengths else "1")


def _put(vector: Array, entry: int | None, value: Array) -> Array:
    if entry is None:
        return jnp.broadcast_to(value, np.shape(vector))
    return jnp.asarray(vector, float).at[..., entry].set(value)
