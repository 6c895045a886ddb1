"""Computes tiles: one compiled call a block, each output copied once to where it stays."""

import contextlib
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.mechanism import Mechanism
from jaxkin.sweep import vectors
from jaxkin.sweep.designs import design_values
from jaxkin.sweep.fields import Field
from jaxkin.sweep.plan import Box, Plan, boxes, extent


def _block_values(
    robot: Mechanism,
    coordinates: tuple[Array, ...],
    field: Field,
    free: tuple[int, ...],
    shape: tuple[int, ...],
) -> tuple[Array, ...]:
    """Evaluates a field on one block; coordinates are vectors on free axes and scalars on fixed ones."""
    values = field.values(robot, _spread(coordinates, free))
    return tuple(jnp.broadcast_to(value, value.shape[: max(0, value.ndim - len(shape))] + shape) for value in values)


def _spread(coordinates: tuple[Any, ...], free: tuple[int, ...]) -> tuple[Any, ...]:
    """Returns coordinates of which those of free axes vary along an axis of their own."""
    spread = list(coordinates)
    for place, k in enumerate(free):
        spread[k] = coordinates[k].reshape(tuple(-1 if i == place else 1 for i in range(len(free))))
    return tuple(spread)


def _untraced_block(
    robot: Mechanism, coordinates: tuple[np.ndarray, ...], field: Field, free: tuple[int, ...], shape: tuple[int, ...]
) -> tuple[np.ndarray, ...]:
    """Does the same one sample after another."""
    return design_values(field, robot, _spread(coordinates, free), shape)


_STATIC = ("field", "free", "shape")
_compiled_block = jax.jit(_block_values, static_argnames=_STATIC)
_compiled_wide = jax.jit(_block_values, static_argnames=_STATIC, compiler_options=vectors.WIDE)


class Tiler:
    """Computes tiles of one plan; safe to share among threads."""

    def __init__(self, robot: Mechanism, plan: Plan):
        self._plan = plan
        # On the device once, and not again with every call.
        with computing_in(plan.precision):
            self._robot = jax.device_put(in_precision(robot, plan.precision))
        self._axes = [plan.grid.coordinate(k).astype(plan.precision) for k in range(len(plan.grid.axes))]
        static = {"field": plan.field, "free": plan.grid.free, "shape": plan.block}
        if not plan.field.traced:
            self._run = partial(_untraced_block, **static)
            return
        first = self._coordinates(next(boxes(plan.grid.shape, plan.block, (0,) * len(plan.block))))
        with computing_in(plan.precision):
            wide = vectors.serve(_compiled_block.trace(self._robot, first, **static))
        self._run = partial(_compiled_wide if wide else _compiled_block, **static)

    def compute(self, box: Box, into: dict[str, np.ndarray]) -> None:
        """Fills the arrays of one tile, block by block."""
        plan = self._plan
        corner = tuple(side.start for side in box)
        with computing_in(plan.precision):
            for block in boxes(extent(box), plan.block, corner):
                arrays = plan.field.unpack(
                    tuple(np.asarray(a) for a in self._run(self._robot, self._coordinates(block)))
                )
                here = tuple(slice(side.start - c, side.stop - c) for side, c in zip(block, corner, strict=True))
                crop = tuple(slice(0, side.stop - side.start) for side in block)
                source = iter(arrays)
                for variable in plan.variables:
                    for lead in np.ndindex(*variable.lead):
                        into[variable.name][(*lead, *here)] = next(source)[crop]

    def _coordinates(self, block: Box) -> tuple[np.ndarray, ...]:
        """Returns the block's coordinates; at the upper edges the last one repeats, so that shapes stay."""
        coordinates: list[np.ndarray] = []
        sides = iter(zip(block, self._plan.block, strict=True))
        for k, samples in enumerate(self._axes):
            if k in self._plan.grid.free:
                side, length = next(sides)
                piece = samples[side]
                # np.pad takes longer than a small block.
                whole = len(piece) == length
                coordinates.append(piece if whole else np.pad(piece, (0, length - len(piece)), mode="edge"))
            else:
                coordinates.append(samples[0])
        return tuple(coordinates)


def computing_in(precision: str) -> contextlib.AbstractContextManager:
    """Makes this thread compute in a precision: every constant of a kernel has it then."""
    return jax.enable_x64(False) if precision == "float32" else contextlib.nullcontext()


def in_precision(robot: Mechanism, precision: str) -> Mechanism:
    """Returns the robot with its geometry in a precision."""
    if precision == "float64":
        return robot
    return jax.tree.map(lambda leaf: np.asarray(leaf, precision), robot)
