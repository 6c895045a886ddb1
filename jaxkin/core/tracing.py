"""Telling values from tracers."""

from typing import Any

from jax.core import Tracer


def is_traced(value: Any) -> bool:
    """True for what stands for a value inside ``jit``, ``vmap`` or ``grad``, and has none to look at."""
    return isinstance(value, Tracer)
