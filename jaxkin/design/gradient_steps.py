"""Many starts at once, by optax: Adam on the unit cube with projection, or L-BFGS behind a smooth map of the cube."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array

from jaxkin.design.functions import Functions, Judged

#: Steps of one compiled call; progress, history and checkpoints are kept between calls.
CHUNK = 20
#: Weights of violations at the first and at the last step.
_WEIGHTS = (1.0, 1e4)
#: Scaled violations below this are rounding: the design counts as feasible.
FEASIBLE = 1e-9


class Best(NamedTuple):
    """The best that each start has met.

    Attributes:
        z: ``(p,)`` where.
        value: The smoothed objective there, times the sense.
        violation: Its largest scaled violation; a smaller violation is better than any value.
    """

    z: Array
    value: Array
    violation: Array


class Walk(NamedTuple):
    """State of one start.

    Attributes:
        x: ``(p,)`` the variable of the method.
        state: optax's state.
        best: The best so far.
        step: Number of steps taken.
    """

    x: Array
    state: Any
    best: Best
    step: Array


class Trail(NamedTuple):
    """What a chunk of steps leaves behind: ``(steps, starts)`` of values and violations, and ``(steps, starts, p)``."""

    value: np.ndarray
    violation: np.ndarray
    z: np.ndarray


class Method(NamedTuple):
    """A gradient method.

    Attributes:
        optimiser: optax's.
        cube: From the method's variable to the unit cube.
        variable: From the unit cube to the method's variable.
        project: What is done to the variable after a step.
        searches: True where the update needs the function.
    """

    optimiser: Any
    cube: Callable[[Array], Array]
    variable: Callable[[Array], Array]
    project: Callable[[Array], Array]
    searches: bool


def adam(rate: float, steps: int) -> Method:
    """Returns Adam with a rate that falls along a cosine to 1 % of what it was, projected onto the cube."""
    schedule = optax.cosine_decay_schedule(rate, steps, alpha=0.01)
    return Method(optax.adam(schedule), lambda x: x, lambda z: z, lambda x: jnp.clip(x, 0.0, 1.0), False)


def lbfgs() -> Method:
    """Returns L-BFGS; the cube is the image of (1 - cos x) / 2, so that a bound can be reached."""
    return Method(
        optax.lbfgs(memory_size=8),
        lambda x: 0.5 - 0.5 * jnp.cos(x),
        # A start on a bound would stay there, as the slope vanishes.
        lambda z: jnp.arccos(1 - 2 * jnp.clip(z, 1e-3, 1 - 1e-3)),
        lambda x: x,
        True,
    )


class Steps:
    """A gradient method on a problem's functions; one compilation for a number of starts."""

    def __init__(self, functions: Functions, method: Method, steps: int):
        self._functions, self._method, self._steps = functions, method, steps
        self._first = jax.jit(jax.vmap(self._begin))
        self._chunk = jax.jit(jax.vmap(self._walk))

    def begin(self, starts: np.ndarray) -> Walk:
        """Returns the state of starts ``(starts, p)`` of the unit cube before the first step."""
        return self._first(jnp.asarray(starts))

    def chunk(self, walk: Walk) -> tuple[Walk, Trail]:
        """Takes ``CHUNK`` steps with every start."""
        walk, (value, violation, z) = self._chunk(walk)
        return walk, Trail(*(np.swapaxes(np.asarray(part), 0, 1) for part in (value, violation, z)))

    def _weight(self, step: Array) -> Array:
        first, last = _WEIGHTS
        return first * (last / first) ** jnp.minimum(step / max(self._steps, 1), 1.0)

    def _begin(self, z: Array) -> Walk:
        x = self._method.variable(z)
        nothing = Best(z, jnp.asarray(-jnp.inf), jnp.asarray(jnp.inf))
        return Walk(x, self._method.optimiser.init(x), nothing, jnp.asarray(0))

    def _walk(self, walk: Walk) -> tuple[Walk, tuple[Array, Array, Array]]:
        return jax.lax.scan(self._step, walk, None, length=CHUNK)

    def _step(self, walk: Walk, _: None) -> tuple[Walk, tuple[Array, Array, Array]]:
        method, weight = self._method, self._weight(walk.step)

        def loss(x: Array) -> tuple[Array, Judged]:
            return self._functions.loss(method.cube(x), weight)

        (value, judged), slope = jax.value_and_grad(loss, has_aux=True)(walk.x)
        z = method.cube(walk.x)
        best, violation = _better(walk.best, z, judged, self._functions)
        # A step into nowhere is not taken; from there the way back is that of the best design.
        safe = judged.fine & jnp.all(jnp.isfinite(slope))
        slope = jnp.where(safe, slope, 0.0)
        if method.searches:
            plain = lambda x: jnp.where(jnp.isfinite(v := loss(x)[0]), v, 1e30)  # noqa: E731
            update, state = method.optimiser.update(
                slope, walk.state, walk.x, value=jnp.where(safe, value, 1e30), grad=slope, value_fn=plain
            )
        else:
            update, state = method.optimiser.update(slope, walk.state, walk.x)
        moved = method.project(optax.apply_updates(walk.x, update))  # type: ignore[arg-type]
        back = method.variable(0.5 * (z + best.z))
        x = jnp.where(safe & jnp.all(jnp.isfinite(moved)), moved, back)
        return Walk(x, state, best, walk.step + 1), (judged.value, violation, z)


def _better(best: Best, z: Array, judged: Judged, functions: Functions) -> tuple[Best, Array]:
    """Returns the better of the best so far and a design, and the design's largest scaled violation."""
    violation = jnp.maximum(-judged.hard, 0.0)
    violation = jnp.where(judged.fine, jnp.where(violation <= FEASIBLE, 0.0, violation), jnp.inf)
    value = functions.problem.sign * judged.value
    wins = judged.fine & ((violation < best.violation) | ((violation == best.violation) & (value > best.value)))
    pick = partial(jnp.where, wins)
    return Best(pick(z, best.z), pick(value, best.value), pick(violation, best.violation)), violation


def chunks(steps: int) -> Iterator[int]:
    """Yields the number of steps taken after each chunk."""
    yield from range(CHUNK, steps + CHUNK, CHUNK)
