"""What float32 costs: samples of a grid computed in both precisions, side by side."""

import json
from functools import partial
from typing import Any

import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep.fields import Field
from jaxkin.sweep.plan import Plan
from jaxkin.sweep.scattered import scattered_values
from jaxkin.sweep.tiler import computing_in, in_precision

#: Samples that are compared, at places that hang on nothing but the grid.
_SAMPLES = 4096


def single_error(robot: Mechanism, plan: Plan) -> dict[str, str]:
    """Returns the attribute ``float32_error``: what is lost at samples spread over the grid.

    Per variable, ``changed``: the share of samples at which a label differs, or only one of two numbers is defined;
    and of numbers ``largest_absolute``, ``median_absolute`` and, relative to the largest magnitude of an entry,
    ``largest_relative``.
    """
    places = np.random.default_rng(0).random((len(plan.grid.free), _SAMPLES))
    coordinates, free = [], iter(places)
    for k in range(len(plan.grid.axes)):
        axis = plan.grid.coordinate(k)
        index = (next(free) * len(axis)).astype(np.int64) if k in plan.grid.free else np.zeros(_SAMPLES, np.int64)
        coordinates.append(axis[index])
    both = [_values(robot, plan.field, coordinates, precision) for precision in ("float64", "float32")]
    errors: dict[str, Any] = {"samples": _SAMPLES}
    for variable, one, other in zip(plan.variables, *map(partial(_by_variable, plan), both), strict=True):
        labels = np.dtype(variable.dtype).kind != "f"
        errors[variable.name] = {"changed": _changed(one, other, labels)} | ({} if labels else _error(one, other))
    return {"float32_error": json.dumps(errors)}


def _values(robot: Mechanism, field: Field, coordinates: list[np.ndarray], precision: str) -> tuple[np.ndarray, ...]:
    with computing_in(precision):
        given = tuple(each.astype(precision) for each in coordinates)
        return field.unpack(
            tuple(np.asarray(a) for a in scattered_values(in_precision(robot, precision), given, field, _SAMPLES))
        )


def _by_variable(plan: Plan, arrays: tuple[np.ndarray, ...]) -> list[np.ndarray]:
    source = iter(arrays)
    return [np.stack([next(source) for _ in np.ndindex(*v.lead)]).astype(float) for v in plan.variables]


def _error(exact: np.ndarray, single: np.ndarray) -> dict[str, float]:
    """Compares ``(entries, samples)``."""
    defined = np.isfinite(exact) & np.isfinite(single)
    gap = np.where(defined, np.abs(np.where(defined, single, 0.0) - np.where(defined, exact, 0.0)), 0.0)
    size = np.max(np.where(defined, np.abs(exact), 0.0), axis=1, keepdims=True)
    relative = gap / np.where(size == 0, 1.0, size)
    return {
        "largest_absolute": float(gap.max()),
        "median_absolute": float(np.median(gap[defined])) if defined.any() else 0.0,
        "largest_relative": float(relative.max()),
    }


def _changed(exact: np.ndarray, single: np.ndarray, labels: bool) -> float:
    differs = exact != single if labels else np.isfinite(exact) != np.isfinite(single)
    return float(np.mean(np.any(differs, axis=0)))
