"""Waists of a hot kernel."""

from jax import Array


def materialise(*arrays: Array) -> tuple[Array, ...]:
    """Returns the floating-point arrays unchanged, and makes XLA compute each of them once.

    XLA on a CPU writes one loop for every output and computes shared inputs again in each; only results
    of an operation that it holds for expensive, such as a division, are kept. ``optimization_barrier``
    is dropped before that happens (jaxlib 0.10). So this divides by a one that the compiler cannot see
    through: 0 * x is no constant, as x might be NaN. Use it where few arrays carry all that follows.
    """
    kept = []
    for array in arrays:
        one = array * 0 + 1
        kept.append(array / one)
    return tuple(kept)
