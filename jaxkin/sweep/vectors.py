"""Vectors of 512 bits: one option of one compilation, for kernels whose operations are known to bear it."""

import functools
import re
import weakref

import jax
from jax.extend.core import ClosedJaxpr

from jaxkin.core.provenance import processor_flags

#: Operations that the compiler writes out itself, whatever the vectors' width. With wide vectors jaxlib 0.10 calls a
#: ready-made arctangent of eight numbers that takes its argument in another place than it is put: nonsense, without
#: a warning. So a kernel with anything that is not in this list is compiled as ever.
_PLAIN = """
    abs add and bitcast_convert broadcast_in_dim case ceil clamp compare concatenate constant convert cosine divide
    dot_general dynamic_slice dynamic_update_slice floor gather if iota is_finite maximum minimum multiply negate not or
    pad reduce reduce_window remainder reshape return reverse round_nearest_even rsqrt scatter select shift_left
    shift_right_arithmetic shift_right_logical sign sine slice sort sqrt square subtract transpose while xor
"""
#: An operation of a lowered program; that of the module's own attributes is none.
_OPERATION = re.compile(r"\b(?:stablehlo|chlo|mhlo)\.(?!num_partitions|num_replicas)(\w+)")
#: The compiler's option; without it jaxlib takes vectors of 256 bits.
WIDE = {"xla_cpu_prefer_vector_width": 512}


def serve(traced: jax.stages.Traced) -> bool:
    """True where wide vectors are there, and every operation of a traced kernel bears them."""
    if jax.default_backend() != "cpu" or not _machine_has_them():
        return False
    program = traced.jaxpr
    if program not in _known:
        _known[program] = _operations(traced) <= set(_PLAIN.split())
    return _known[program]


#: Answers given; JAX keeps its traces, so that the same kernel comes with the same program.
_known: weakref.WeakKeyDictionary[ClosedJaxpr, bool] = weakref.WeakKeyDictionary()


@functools.cache
def _machine_has_them() -> bool:
    if "avx512f" not in processor_flags():
        return False
    try:
        jax.jit(lambda x: x + 1, compiler_options=WIDE).lower(1.0).compile()
    except Exception:  # Whatever a jaxlib says to an option that it does not know.
        return False
    return True


def _operations(traced: jax.stages.Traced) -> set[str]:
    """Returns the names of all operations, those of loops and calls included; names in a trace change with JAX."""
    return set(_OPERATION.findall(traced.lower().as_text()))
