"""The worst value of a function of the pose over a prescribed workspace: over samples, and where Newton says."""

from collections.abc import Callable
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.design.objective import LEAST, Measured, Objective
from jaxkin.design.places import Place

#: (mechanism, poses as columns ``(k,)``, pose in the middle) -> ``(k, m)`` values, m of them at every pose.
Pointwise: TypeAlias = Callable[[Mechanism, tuple[Array, ...], Array], Array]

#: The search for the worst pose starts from so many of the worst samples, of a grid so much denser.
_STARTS, _DENSER = 12, 2
#: Parameters closer than this are one pose.
_SAME = 1e-6


def worst_case(
    name: str,
    unit: str,
    at: Pointwise,
    place: Place,
    width: float,
    *,
    names: tuple[str, ...],
    worst: str = LEAST,
    content: dict[str, Any] | None = None,
    inside: Callable[[Mechanism, tuple[Array, ...]], Array] | None = None,
    further: np.ndarray | None = None,
) -> Objective:
    """Makes the objective of the worst value over a place: its parts are the values at the samples.

    Args:
        name: What it is.
        unit: Its unit.
        at: The function of the pose.
        place: Where.
        width: Width of the smoothing.
        names: Names of the m values.
        worst: ``"least"`` or ``"most"``.
        content: What else determines it.
        inside: How far inside the legs' reach poses are, ``(k,)``, where they can miss it.
        further: ``(j, d)`` parameters of further samples.
    """
    samples = place.samples() if further is None else np.concatenate([place.samples(), further])

    def parts(robot: Mechanism, center: Array | None) -> Array:
        return _at_samples(at, place, samples, robot, center)[1].reshape(-1)

    count = (len(samples) if place.listed is None else len(place.listed)) * len(names)
    sides = ("below", "not below") if worst == LEAST else ("above", "not above")
    smoothing = (
        f"log-sum-exp of width {width:g} over {count} values at samples of the place, at most "
        f"{width * np.log(count):.3g} {sides[0]} the worst of them, which is {sides[1]} the worst of the place"
    )

    def reach(robot: Mechanism, center: Array | None) -> Array:
        assert inside is not None
        poses = place.sampled(robot, center, samples)
        return inside(robot, tuple(poses[:, k] for k in range(poses.shape[1])))

    def sharper(u: np.ndarray) -> Objective:
        more = u if further is None else np.concatenate([further, u])
        return worst_case(
            name, unit, at, place, width, names=names, worst=worst, content=content, inside=inside, further=more
        )

    search = _Search(at, place, names, worst)
    return Objective(
        name=name,
        unit=unit,
        parts=parts,
        worst=worst,
        width=width,
        smoothing=smoothing,
        measure=search.measured,
        place=place,
        names=names,
        reach=None if inside is None else reach,
        sharper=None if place.listed is not None else sharper,
        content={"objective": name, "place": place.content(), "width": width, **(content or {})},
    )


def _at_samples(
    at: Pointwise, place: Place, u: np.ndarray, robot: Mechanism, center: Array | None
) -> tuple[Array, Array]:
    """Returns poses ``(k, n_pose)`` and values ``(k, m)`` at samples."""
    poses = place.sampled(robot, center, u)
    return poses, at(robot, tuple(poses[:, k] for k in range(poses.shape[1])), place.middle(robot, center))


class _Search:
    """The search for the worst pose of one function over one place; compiled once for all designs."""

    def __init__(self, at: Pointwise, place: Place, names: tuple[str, ...], worst: str):
        self._place, self._names = place, names
        self._sign = sign = 1.0 if worst == LEAST else -1.0
        self._u, self._samples = place.samples(_DENSER), place.samples()

        def single(robot: Mechanism, center: Array | None, u: Array, part: Array) -> Array:
            pose = place.pose(robot, u, center)
            columns = tuple(pose[k][None] for k in range(len(pose)))
            return sign * at(robot, columns, place.middle(robot, center))[0, part]

        self._values = jax.jit(lambda robot, center: _at_samples(at, place, self._u, robot, center))
        self._slope = jax.jit(jax.value_and_grad(single, argnums=2))

    def measured(self, robot: Mechanism, center: Array | None) -> Measured:
        """Finds the worst pose: on a denser grid, then by a bounded quasi-Newton method from the worst samples."""
        poses, values = (np.asarray(part) for part in self._values(robot, center))
        values = self._sign * values
        # A pose at which nothing can be said is the worst there is.
        if np.isnan(values).any():
            sample, part = (int(k) for k in np.argwhere(np.isnan(values))[0])
            return Measured(np.nan, np.nan, poses[sample], self._names[part], "undefined there")
        best = [divmod(int(k), len(self._names)) for k in np.argsort(values, axis=None)[:_STARTS]]
        sample, part = best[0]
        value, pose, error = float(values[sample, part]), poses[sample], 0.0
        told, ends = f"the worst of {len(values)} poses", []
        if self._place.listed is None and np.isfinite(value):
            told = f"polished from the worst {len(best)} of {len(values)} samples"
            for sample, one in best:
                low, u, rest = self._descended(robot, center, self._u[sample], one)
                ends.append(u)
                if low < value:
                    value, error, part = low, rest, one
                    pose = np.asarray(self._place.pose(robot, jnp.asarray(u), center))
        error, further = max(error, 1e-14 * abs(value)), self._between(ends)
        return Measured(self._sign * value, error, pose, self._names[part], told, further)

    def _between(self, ends: list[np.ndarray]) -> np.ndarray | None:
        """Returns those ends of searches that are no samples of the place, ``(j, d)``, each once."""
        kept: list[np.ndarray] = []
        for u in ends:
            if all(np.max(np.abs(u - other)) > _SAME for other in (*self._samples, *kept)):
                kept.append(u)
        return np.array(kept) if kept else None

    def _descended(
        self, robot: Mechanism, center: Array | None, start: np.ndarray, part: int
    ) -> tuple[float, np.ndarray, float]:
        """Returns value, parameters and an estimate of the value's error at a local worst pose near a start."""

        def both(u: np.ndarray) -> tuple[float, np.ndarray]:
            value, gradient = self._slope(robot, center, jnp.asarray(u), jnp.asarray(part))
            return float(value), np.nan_to_num(np.asarray(gradient))

        options = {"ftol": 1e-16, "gtol": 1e-11, "maxiter": 200}
        bounds = [(-1.0, 1.0)] * len(start)
        found = scipy.optimize.minimize(both, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        value, gradient = both(found.x)
        if not np.isfinite(value):
            return np.inf, start, np.inf
        inward = np.clip(found.x - gradient, -1.0, 1.0) - found.x
        # The rest of the way, were the curvature that of the scale of the values.
        return value, found.x, float(np.sum(inward**2) / (abs(value) + 1e-300))
