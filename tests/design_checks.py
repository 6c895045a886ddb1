"""An objective as a function of one vector: the finite numbers of a mechanism by name, and the middle of the place."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxkin.core.leaves import leaf_places, leaf_unit, leaf_value, with_leaves


def finite_leaves(robot):
    """Names of all numbers that are finite, entries of vectors one by one."""
    return [
        name
        for name, place in leaf_places(robot).items()
        if (place.entry is not None or jnp.ndim(getattr(robot, place.field)) == 0)
        and np.isfinite(leaf_value(robot, name))
    ]


@dataclass(frozen=True, eq=False)
class Vectorised:
    """An objective of (numbers of the mechanism, middle of the place)."""

    objective: object
    robot: object
    names: tuple[str, ...]
    center: np.ndarray | None

    @property
    def start(self):
        values = [float(leaf_value(self.robot, name)) for name in self.names]
        return np.array([*values, *([] if self.center is None else self.center)])

    @property
    def labels(self):
        return [*self.names, *(f"center {axis.name}" for axis in self.robot.pose_axes if self.center is not None)]

    def parts(self, theta):
        n = len(self.names)
        robot = with_leaves(self.robot, {name: theta[k] for k, name in enumerate(self.names)})
        return self.objective.parts(robot, None if self.center is None else theta[n:])

    def __call__(self, theta):
        return self.objective.together(self.parts(theta))


def vectorised(objective, robot, moves=True):
    """The objective of all finite numbers and, where its place has a middle that moves it, of the middle."""
    center = objective.place.center if moves and objective.place is not None else None
    if center is not None and objective.place.kind == "reach":
        center = None
    return Vectorised(objective, robot, tuple(finite_leaves(robot)), center)


def sizes_of(function):
    """What each number is compared with: itself; where that is small, half a radian or a tenth of the mechanism."""
    units = [leaf_unit(function.robot, name) for name in function.names]
    units += [axis.unit for axis in function.robot.pose_axes] if function.center is not None else []
    length = 0.1 * float(function.robot.characteristic_length())
    return np.maximum(np.abs(function.start), [0.5 if unit in ("rad", "1") else length for unit in units])


def around(function, number, share, seed=0):
    """Random vectors about the start, whose numbers are moved by up to a share of their sizes."""
    rng = np.random.default_rng(seed)
    start = function.start
    return start + share * sizes_of(function) * rng.uniform(-1.0, 1.0, (number, len(start)))


def kernel(function):
    """Values, gradients and the active part of any number of vectors, compiled once, in blocks of 16."""

    def one(theta):
        def value(theta):
            parts = function.parts(theta)
            active = jnp.argmin(parts) if function.objective.worst == "least" else jnp.argmax(parts)
            return function.objective.together(parts), active

        (value, active), gradient = jax.value_and_grad(value, has_aux=True)(theta)
        return value, gradient, active

    block = jax.jit(jax.vmap(one))

    def values(points):
        points = np.asarray(points)
        # Every block is full: a remainder would be compiled by itself.
        padded = np.concatenate([points, np.repeat(points[-1:], -len(points) % 16, axis=0)])
        found = [block(jnp.asarray(padded[k : k + 16])) for k in range(0, len(padded), 16)]
        return tuple(np.concatenate(part)[: len(points)] for part in zip(*found, strict=True))

    return values


def assert_gradients(function, values, designs, step=1e-4, relative=1e-6, floor=1e-9):
    """Asserts every entry of gradients to a share of itself, against central differences of fourth order.

    But for the floor: what is exactly zero has no relative accuracy, as the rounding of a difference is that of the
    value over the step. Entries (per size of their number) below it are not told from zero, nor those below a share of
    the largest entry, as values themselves are right to a few roundings only.

    Args:
        function: The objective as a function of one vector.
        values: Its ``kernel``.
        designs: ``(d, n)``.
        step: Step of the differences as a share of the numbers' sizes.
        relative: The share.
        floor: That share.
    """
    designs = np.asarray(designs, float)
    (d, n), sizes = designs.shape, sizes_of(function)
    shifts = step * np.array([-2.0, -1.0, 1.0, 2.0])[:, None, None] * np.diag(sizes)
    points = designs[:, None, None, :] + shifts
    value, gradient, active = values(np.concatenate([designs, points.reshape(-1, n)]))
    assert np.all(np.isfinite(value))
    assert np.all(np.isfinite(gradient))
    if function.objective.width == 0:
        kinks = np.argwhere(np.any(active[d:].reshape(d, -1) != active[:d, None], axis=1))
        assert not len(kinks), f"equal worst parts at designs {kinks.ravel().tolist()}: choose others"
    found = gradient[:d] * sizes
    expected = np.einsum("dsn,s->dn", value[d:].reshape(d, 4, n), [1.0, -8.0, 8.0, -1.0]) / (12 * step)
    largest = np.max(np.abs(expected), axis=1, keepdims=True)
    assert np.all(largest > 0)
    rounding = 8 * np.finfo(float).eps * np.abs(value[:d, None]) / step
    excess = np.abs(found - expected) - relative * np.abs(expected) - floor * largest - rounding
    at = np.unravel_index(np.argmax(excess), excess.shape)
    told = f"design {at[0]}, {function.labels[at[1]]}: {found[at]!r}, by differences {expected[at]!r}"
    assert np.all(excess <= 0), f"{told}, of largest {largest[at[0], 0]!r}"
