"""The float64 guard, and the one table of tolerances."""

from dataclasses import dataclass

import jax

from jaxkin.core.errors import PrecisionError


@dataclass(frozen=True)
class Tolerances:
    """Dimensionless tolerances; lengths are compared after division by a characteristic length.

    Attributes:
        residual: Largest dimensionless residual of a solution that is reported as valid.
        double_angle: Two assembly modes closer than this angle (rad) are one double pose: float64
            fixes a double root to about the square root of its rounding, so it cannot tell them apart.
        triple_angle: The same for three modes (cube root of the rounding), rad.
        double_length: Relative to rho1 and the characteristic length: half the distance under which
            the two poses of a pair (+p, -p), or two general poses, are one double pose.
        undecided: A sign whose argument is smaller than this share of the sum of the magnitudes of its
            terms is flagged as undecided (the nearly-double bit of a count).
        geometry: A determinant of a geometry smaller than this share of its terms counts as zero.
        inverse_singular: A leg shorter than this share of the characteristic length has zero length.
    """

    residual: float = 1e-12
    double_angle: float = 2e-7
    triple_angle: float = 3e-5
    double_length: float = 1e-7
    undecided: float = 1e-11
    geometry: float = 1e-12
    inverse_singular: float = 1e-12


TOLERANCES = Tolerances()


def enable_x64() -> None:
    """Switches JAX to float64 for the whole process; call it before the first computation."""
    jax.config.update("jax_enable_x64", True)


def require_x64(who: str) -> None:
    """Raises unless float64 is enabled.

    Args:
        who: The entry point that asks, as the user wrote it.

    Raises:
        PrecisionError: float64 is not enabled.
    """
    if not jax.config.read("jax_enable_x64"):
        raise PrecisionError(
            f"{who} needs float64, but JAX is running in float32, which cannot tell close assembly modes apart: "
            "add `jaxkin.enable_x64()` before the first computation."
        )
