"""Compiles a field's kernel as a sweep does."""

from collections.abc import Callable
from typing import Any

import jax

from jaxkin.sweep import vectors


def compiled(kernel: Callable[..., Any], robot: Any, given: tuple[jax.Array, ...]) -> Callable[..., Any]:
    """Returns the compiled kernel, with wide vectors where a sweep of it would have them."""
    plain = jax.jit(kernel)
    return jax.jit(kernel, compiler_options=vectors.WIDE) if vectors.serve(plain.trace(robot, given)) else plain
