"""Vectors of 512 bits: one option of one compilation, for kernels whose operations are known to bear it."""

import functools
from collections.abc import Iterator

import jax
from jax.extend.core import ClosedJaxpr, Jaxpr

from jaxkin.core.provenance import processor_flags

#: Operations that the compiler writes out itself, whatever the vectors' width. With wide vectors jaxlib 0.10 calls a
#: ready-made arctangent of eight numbers that takes its argument in another place than it is put: nonsense, without
#: a warning. So what is not in this list is compiled as ever.
_PLAIN = """
    abs add add_any and argmax argmin bitcast_convert_type broadcast_in_dim ceil clamp concatenate cond
    convert_element_type copy cos cumsum custom_jvp_call custom_vjp_call div dot_general dynamic_slice
    dynamic_update_slice eq floor gather ge gt integer_pow iota is_finite jit le lt max min mul ne neg not or pad
    pjit reduce_and reduce_max reduce_min reduce_or reduce_prod reduce_sum rem reshape rev round rsqrt scan scatter
    scatter-add select_n shift_left shift_right_arithmetic shift_right_logical sign sin slice sort split sqrt square
    squeeze stack stop_gradient sub tile transpose while xor
"""

#: The compiler's option; without it jaxlib 0.10 takes vectors of 256 bits.
WIDE = {"xla_cpu_prefer_vector_width": 512}


def serve(traced: jax.stages.Traced) -> bool:
    """True where wide vectors are there, and every operation of a traced kernel bears them."""
    return jax.default_backend() == "cpu" and _machine_has_them() and _bears_them(traced.jaxpr)


@functools.lru_cache(maxsize=64)
def _bears_them(program: ClosedJaxpr) -> bool:
    # Kept, for the compiler keeps traces too: the same kernel comes with the same program.
    plain = set(_PLAIN.split())
    return all(name in plain for name in _operations(program))


@functools.cache
def _machine_has_them() -> bool:
    if "avx512f" not in processor_flags():
        return False
    try:
        jax.jit(lambda x: x + 1, compiler_options=WIDE).lower(1.0).compile()
    except Exception:  # Whatever a jaxlib says to an option that it does not know.
        return False
    return True


def _operations(program: ClosedJaxpr | Jaxpr) -> Iterator[str]:
    """Yields the names of all operations of a program, those of its loops and calls included."""
    jaxpr = program.jaxpr if isinstance(program, ClosedJaxpr) else program
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for inner in jax.tree.leaves(
            list(equation.params.values()), is_leaf=lambda part: isinstance(part, ClosedJaxpr | Jaxpr)
        ):
            if isinstance(inner, ClosedJaxpr | Jaxpr):
                yield from _operations(inner)
