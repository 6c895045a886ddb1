"""The largest box or ball about a pose that meets no wall: rays find where it touches, Newton says.

A body grows from its middle until it touches a wall g = 0. At the point of first contact its size is stationary along
the wall, within the body's surface. For a ball of growing coordinates d (in units of its radii) Lagrange's conditions
are d - lambda dg/dd = 0 and g = 0. A box has the size t with the point t sin(a) on its surface: dg/da = 0 and g = 0,
which covers faces, edges and corners alike, as there cos(a) = 0. Coordinates that do not grow, but run over an
interval, are middle + half sin(s), with dg/ds = 0.
"""

import itertools
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from scipy.special import ndtri

from jaxkin.core.mechanism import Mechanism
from jaxkin.design.places import Place
from jaxkin.design.walls import Walls
from jaxkin.numerics import newton
from jaxkin.numerics.implicit import attach_derivatives

#: Newton's steps from every start, and the residual of what has arrived.
_STEPS, _ARRIVED = 16, 1e-10
#: Halvings between two samples of a ray.
_HALVINGS = 34


class Rays(NamedTuple):
    """How densely contacts are sought.

    Attributes:
        rays: Their number.
        along: Samples along each.
        polished: How many of the shortest rays to a wall are polished.
        walls: For how many of the nearest walls; to those farther away the shortest ray stands.
    """

    rays: int = 256
    along: int = 48
    polished: int = 16
    walls: int = 6


class Contact(NamedTuple):
    """Where each wall is touched first.

    Attributes:
        size: ``(m,)`` sizes, in units of the place; ``most`` where a wall is not met, negative where the middle
            violates it.
        unknowns: ``(m, ...)`` the unknowns of the conditions.
        arrived: ``(m,)`` True where Newton's method has arrived; else the shortest ray stands.
    """

    size: Array
    unknowns: Array
    arrived: Array


class Growth:
    """The conditions of one kind of body against one set of walls.

    Args:
        place: The body at size one: a box, or a ball with a box of spans beside it.
        walls: What it must not meet.
        grows: Names of those axes of a box that grow; a ball's axes always do, what is beside it never does.
        most: Largest size that is looked at, in units of the place.
        known: ``(j, ...)`` unknowns of contacts that rays may miss, from which Newton's method starts as well.
    """

    def __init__(
        self, place: Place, walls: Walls, grows: tuple[str, ...], most: float, known: np.ndarray | None = None
    ):
        self.place, self.walls, self.most, self.known = place, walls, most, known
        self.is_ball = bool(place.round)
        self.growing = place.round if self.is_ball else tuple(place.axes.index(name) for name in grows)
        self.spans = tuple(k for k in place.flat if k not in self.growing)

    def point(self, center: Array, unknowns: Array) -> Array:
        """Returns the pose of the unknowns: of a ball its coordinates, of a box size and angles; then the spans'."""
        m = len(self.growing)
        pose = center
        if self.is_ball:
            moves, spans = unknowns[:m], unknowns[m:]
        else:
            moves, spans = unknowns[0] * jnp.sin(unknowns[1 : m + 1]), unknowns[m + 1 :]
        for place, k in enumerate(self.growing):
            pose = pose.at[k].add(self.place.half[k] * moves[place])
        for place, k in enumerate(self.spans):
            pose = pose.at[k].add(self.place.half[k] * jnp.sin(spans[place]))
        return pose

    def size(self, unknowns: Array) -> Array:
        """Returns the size at which the body reaches the point."""
        if not self.is_ball:
            return unknowns[0]
        d = unknowns[: len(self.growing)]
        return jnp.sqrt(jnp.sum(d * d))

    def wall(self, which: Array, robot: Mechanism, center: Array, unknowns: Array) -> Array:
        """Returns one wall at a point."""
        return self.walls.values(robot, self.point(center, unknowns))[which]

    def conditions(self, unknowns: Array, theta: tuple[Mechanism, Array, Array]) -> Array:
        """Returns the conditions of contact, square in the unknowns (and a ball's multiplier, the last of them)."""
        robot, center, which = theta
        m = len(self.growing)
        point = unknowns[:-1] if self.is_ball else unknowns
        value, slope = jax.value_and_grad(partial(self.wall, which, robot, center))(point)
        if self.is_ball:
            return jnp.concatenate([point[:m] - unknowns[-1] * slope[:m], slope[m:], value[None]])
        return jnp.append(slope[1:], value)

    def along(self, ray: Array, t: Array) -> Array:
        """Returns the unknowns at a size along a ray ``(m + spans,)``."""
        m = len(self.growing)
        return jnp.concatenate([t * ray[:m], ray[m:]]) if self.is_ball else jnp.concatenate([t[None], ray])

    def rays(self, number: int) -> np.ndarray:
        """Returns rays to points spread over the body's surface (and over the spans)."""
        m = len(self.growing)
        cube = newton.lattice(number, m + len(self.spans))
        spans = np.arcsin(2 * cube[:, m:] - 1)
        if self.is_ball:
            return np.concatenate([_on_sphere(cube[:, :m]), spans], axis=1)
        surface = 2 * cube[:, :m] - 1
        # The first coordinates say which face, the others where on it; corners are where it often touches.
        face = np.arange(number) % (2 * m)
        surface[np.arange(number), face // 2] = np.where(face % 2, 1.0, -1.0)
        corners = np.array(list(itertools.product([-1.0, 1.0], repeat=m)))
        surface[: min(len(corners), number)] = corners[:number]
        return np.concatenate([np.arcsin(surface), spans], axis=1)


def _spans(dimension: int, number: int) -> np.ndarray:
    """Returns angles ``(k, dimension)`` whose sines fill the interval of every span, its ends included."""
    if not dimension:
        return np.zeros((1, 0))
    ends = np.array(list(itertools.product([-np.pi / 2, np.pi / 2], repeat=dimension)))
    return np.concatenate([np.arcsin(2 * newton.lattice(number, dimension) - 1), ends])


def _on_sphere(cube: np.ndarray) -> np.ndarray:
    """Returns unit vectors of a lattice in the cube."""
    m = cube.shape[1]
    if m == 1:
        return np.where(np.arange(len(cube)) % 2, 1.0, -1.0)[:, None]
    turn = 2 * np.pi * cube[:, 0]
    if m == 2:
        return np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if m > 3:
        normal = np.asarray(ndtri(cube))
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)
    high = 2 * cube[:, 1] - 1
    wide = np.sqrt(1 - high**2)
    return np.stack([wide * np.cos(turn), wide * np.sin(turn), high], axis=1)


def contacts(growth: Growth, rays: Rays, robot: Mechanism, center: Array) -> Array:
    """Returns the size at which the body touches each wall, ``(m,)``; traceable and differentiable.

    Where the middle itself violates a limit or a reach (or where a singularity passes through it, for some value of the
    spans) the size is negative: the wall's value over its slope, the way back to first order.
    """
    return _sizes(growth, rays, robot, center, _search(growth, rays, *jax.lax.stop_gradient((robot, center))))


def contacts_and_nearest(growth: Growth, rays: Rays, robot: Mechanism, center: Array) -> tuple[Array, Array]:
    """Returns ``contacts``, and the unknowns of the nearest contact, without a ball's multiplier."""
    found = _search(growth, rays, robot, center)
    unknowns = found.unknowns[jnp.argmin(found.size)]
    return _sizes(growth, rays, robot, center, found), unknowns[:-1] if growth.is_ball else unknowns


def _sizes(growth: Growth, rays: Rays, robot: Mechanism, center: Array, found: Contact) -> Array:
    """Returns the sizes of contacts that were found, with their derivatives."""
    still, middle = jax.lax.stop_gradient((robot, center))
    inside = _at_middle(growth, rays, robot, center)

    def one(which: Array, unknowns: Array, arrived: Array, size: Array) -> Array:
        kept = attach_derivatives(growth.conditions, unknowns, (robot, center, which), arrived, jnp.asarray(True))
        exact = growth.size(kept[:-1] if growth.is_ball else kept)
        # A ray's end moves with the wall: the size's slope along it, which at a contact is that of the size itself.
        point = unknowns[:-1] if growth.is_ball else unknowns
        value = growth.wall(which, robot, center, point)
        slope = jax.lax.stop_gradient(_slope_along(growth, which, still, middle, point))
        moved = size - (value - jax.lax.stop_gradient(value)) / jnp.where(slope == 0, 1.0, slope)
        met = size < growth.most
        return jnp.where(met, jnp.where(arrived, exact, moved), growth.most)

    sizes = jax.vmap(one)(jnp.arange(len(growth.walls.names)), found.unknowns, found.arrived, found.size)
    return jnp.where(inside > 0, sizes, inside)


def _slope_along(growth: Growth, which: Array, robot: Mechanism, center: Array, point: Array) -> Array:
    """Returns the wall's rate of change as the body grows through a point."""

    def grown(t: Array) -> Array:
        m = len(growth.growing)
        scaled = jnp.concatenate([t * point[:m], point[m:]]) if growth.is_ball else point.at[0].multiply(t)
        return growth.wall(which, robot, center, scaled)

    size = growth.size(point)
    return jax.grad(grown)(1.0) / jnp.where(size == 0, 1.0, size)


def _search(growth: Growth, rays: Rays, robot: Mechanism, center: Array) -> Contact:
    directions = jnp.asarray(growth.rays(rays.rays))
    sizes = growth.most * jnp.linspace(0.0, 1.0, rays.along + 1) ** 1.5

    def ray(direction: Array) -> Array:
        return jax.vmap(lambda t: growth.walls.values(robot, growth.point(center, growth.along(direction, t))))(sizes)

    values = jax.vmap(ray)(directions)
    change = values[:, :-1] * values[:, 1:] <= 0
    first, met = jnp.argmax(change, axis=1), jnp.any(change, axis=1)
    below, above = (jnp.take_along_axis(values, (first + k)[:, None], axis=1)[:, 0] for k in (0, 1))
    low, high = sizes[first], sizes[first + 1]
    share = jnp.abs(below) / jnp.where(change.any(axis=1), jnp.abs(below) + jnp.abs(above) + 1e-300, 1.0)
    rough = jnp.where(met, low + share * (high - low), jnp.inf)

    def crossing(which: Array, k: Array) -> Array:
        ends = low[k, which], high[k, which], below[k, which]
        return jnp.where(met[k, which], _crossing(growth, which, robot, center, directions[k], *ends), growth.most)

    numbers = jnp.arange(values.shape[2])
    shortest = jnp.argmin(rough, axis=0)
    ends = jax.vmap(crossing)(numbers, shortest)
    rays_there = jax.vmap(
        lambda which, k, t: _with_multiplier(growth, which, robot, center, growth.along(directions[k], t))
    )(numbers, shortest, ends)

    def wall(which: Array) -> tuple[Array, Array, Array]:
        best = jnp.argsort(rough[:, which])[: rays.polished]
        lengths = jax.vmap(partial(crossing, which))(best)
        starts = jax.vmap(lambda k, t: growth.along(directions[k], t))(best, lengths)
        if growth.known is not None:
            starts = jnp.concatenate([starts, jnp.asarray(growth.known)])
        unknowns, size, arrived = jax.vmap(partial(_polished, growth, which, robot, center))(starts)
        limit = jnp.minimum(jnp.min(lengths), ends[which])
        good = arrived & (size <= limit * (1 + 1e-8)) & (limit < growth.most) & (size > 0)
        at, any_good = jnp.argmin(jnp.where(good, size, jnp.inf)), jnp.any(good)
        return (
            jnp.where(any_good, size[at], ends[which]),
            jnp.where(any_good, unknowns[at], rays_there[which]),
            any_good,
        )

    nearest = jnp.argsort(ends)[: rays.walls]
    size, unknowns, arrived = jax.lax.map(wall, nearest)
    return Contact(
        ends.at[nearest].set(size),
        rays_there.at[nearest].set(unknowns),
        jnp.zeros(len(numbers), bool).at[nearest].set(arrived),
    )


def _crossing(
    growth: Growth, which: Array, robot: Mechanism, center: Array, ray: Array, low: Array, high: Array, at_low: Array
) -> Array:
    """Returns where a wall vanishes along a ray between two sizes, by halving."""

    def halve(_: Array, ends: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = ends
        middle = 0.5 * (low + high)
        same = growth.wall(which, robot, center, growth.along(ray, middle)) * at_low > 0
        return jnp.where(same, middle, low), jnp.where(same, high, middle)

    low, high = jax.lax.fori_loop(0, _HALVINGS, halve, (low, high))
    return 0.5 * (low + high)


def _with_multiplier(growth: Growth, which: Array, robot: Mechanism, center: Array, point: Array) -> Array:
    """Returns the unknowns of the conditions: of a ball with the multiplier that fits best."""
    if not growth.is_ball:
        return point
    m = len(growth.growing)
    slope = jax.grad(partial(growth.wall, which, robot, center))(point)[:m]
    square = jnp.sum(slope * slope)
    return jnp.append(point, jnp.sum(point[:m] * slope) / jnp.where(square == 0, 1.0, square))


def _polished(
    growth: Growth, which: Array, robot: Mechanism, center: Array, point: Array
) -> tuple[Array, Array, Array]:
    """Returns unknowns, size, and whether Newton's method has arrived."""
    start, size = _with_multiplier(growth, which, robot, center, point), growth.size(point)
    scale = jnp.where(size > 0, size, 1.0)

    def function(u: Array) -> Array:
        return growth.conditions(u, (robot, center, which))

    unknowns = newton.polish(function, start, steps=_STEPS, trust=0.25 * scale)  # type: ignore[arg-type]
    arrived = jnp.max(jnp.abs(function(unknowns))) <= _ARRIVED
    point = unknowns[:-1] if growth.is_ball else unknowns
    return unknowns, growth.size(point), arrived & jnp.all(jnp.isfinite(unknowns))


def _at_middle(growth: Growth, rays: Rays, robot: Mechanism, center: Array) -> Array:
    """Returns each wall at the middle over its slope, the least over the spans: a distance to first order."""
    spans = _spans(len(growth.spans), rays.rays // 4)
    m = len(growth.growing)

    def values(span: Array) -> tuple[Array, Array]:
        def moved(d: Array) -> Array:
            pose = growth.point(center, jnp.concatenate([jnp.zeros(m if growth.is_ball else m + 1), span]))
            for place, k in enumerate(growth.growing):
                pose = pose.at[k].add(growth.place.half[k] * d[place])
            return growth.walls.values(robot, pose)

        slope = jax.jacfwd(moved)(jnp.zeros(m))
        return moved(jnp.zeros(m)), jnp.sqrt(jnp.sum(slope * slope, axis=1) + 1e-300)

    value, slope = jax.vmap(values)(jnp.asarray(spans))
    # Of a singularity either side will do, but one: that on which the middle of the spans lies.
    singular = jnp.asarray(growth.walls.singular)
    side = jnp.where(singular, jnp.sign(jax.lax.stop_gradient(jnp.sum(value, axis=0))), 1.0)
    return jnp.min(side * value / slope, axis=0)
