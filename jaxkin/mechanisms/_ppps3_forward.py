"""Kernels of the 3-PPPS: all assembly modes by two square roots and one division, as rotation matrices.

Notation: R12 = m p / s, R31 = -(m2 + m3) / (sqrt3 s), R32 = m (m3 - m2) / s are known from the joints (side s, m = +-1;
p = mu3y, m2 = mu2z, m3 = mu3z). With c = 1 - R32^2, a = c - R31^2 and b = c - R12^2, the unit rows and columns of a
rotation say R33^2 = a and R22^2 = b: a pair of signs (R22, R33) chooses one assembly mode, and orthogonality gives the
other entries,

    R11 = (R22 R33 - R12 R31 R32) / c      R13 = -(R12 R32 R33 + R22 R31) / c
    R21 = -(R12 R33 + R22 R31 R32) / c     R23 = (R12 R31 - R22 R33 R32) / c

A pose needs a >= 0 *and* b >= 0: two tests. Where c = 0 the platform is vertical and turns freely about the fixed z
axis.

References:
    Chablat, Baron, Jha and Rolland 2018, Eq. (25), whose square root is that of a b: where both are negative it is
    real, and there is no pose.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jax import Array

from jaxkin.core.branches import Lane
from jaxkin.core.errors import Status
from jaxkin.core.mechanism import Count
from jaxkin.core.precision import TOLERANCES
from jaxkin.numerics.fusion import materialise
from jaxkin.numerics.rotations import xyz_from_matrix
from jaxkin.numerics.small_linalg import Matrix3, two_sum

#: Signs of (R22, R33) lane by lane.
SIGNS = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))
#: R33^2 = a below which the poses +-R33 are closer than the tolerance, and one double pose.
_BLUR = (TOLERANCES.double_angle / 2) ** 2
#: Change of a and b by the rounding of the joints themselves: sums of three terms that are at most one.
_ROUNDING = 4 * float(jnp.finfo(jnp.float64).eps)
_SQRT3 = math.sqrt(3.0)


class Known(NamedTuple):
    """What the joints say before a sign is chosen.

    Attributes:
        r12: Entry of the rotation.
        r31: Entry of the rotation.
        r32: Entry of the rotation.
        c: 1 - R32^2.
        a: R33^2, zero within its blur; negative where no pose is.
        b: R22^2, likewise.
        self_motion: The platform is vertical and turns freely.
        close: a, b or c is so near zero that rounding of the joints could change the number of poses.
    """

    r12: Array
    r31: Array
    r32: Array
    c: Array
    a: Array
    b: Array
    self_motion: Array
    close: Array


def known(side: Array, mirror: float, joints: tuple[Array, ...]) -> Known:
    """Returns the entries of the rotation that the joints determine, and the two feasibility tests."""
    _, z1, y2, z2, y3, z3 = joints
    # Near a self-motion everything hangs on small differences of the joints as they are stored: no digit is lost here.
    apart, rest = two_sum(z3, -z2)
    (m2, less2), (m3, less3) = two_sum(z2, -z1), two_sum(z3, -z1)
    both, less = two_sum(m2, m3)
    r12 = mirror * (y3 + y2) / side
    r31 = -(both + (less + less2 + less3)) / (_SQRT3 * side)
    r32 = mirror * apart / side
    gap = (side - jnp.abs(apart)) - jnp.where(apart < 0, -rest, rest)
    c = gap * (side + jnp.abs(apart)) / (side * side)
    blur = _BLUR * jnp.abs(c)
    doubt = 10 * jnp.maximum(blur, _ROUNDING)
    a, b = c - r31 * r31, c - r12 * r12
    self_motion = (jnp.abs(c) <= _BLUR) & (jnp.abs(a) <= 2 * _BLUR) & (jnp.abs(b) <= 2 * _BLUR)
    near_a, near_b = jnp.abs(a), jnp.abs(b)
    close = ((near_a > blur) & (near_a <= doubt)) | ((near_b > blur) & (near_b <= doubt))
    close = close | (jnp.abs(c) <= 10 * _BLUR)
    return Known(
        r12,
        r31,
        r32,
        c,
        jnp.where(near_a <= blur, 0.0, a),
        jnp.where(near_b <= blur, 0.0, b),
        self_motion,
        close & (a > -doubt) & (b > -doubt),
    )


def count(side: Array, mirror: float, joints: tuple[Array, ...]) -> Count:
    """Counts the assembly modes: 4, or 2, or 1 where a, or b, or both vanish; 0 in a self-motion, which is flagged."""
    k = known(side, mirror, joints)
    on_a, on_b = k.a == 0, k.b == 0
    number = jnp.where(on_a & on_b, 1, jnp.where(on_a | on_b, 2, 4))
    real = (k.a >= 0) & (k.b >= 0) & ~k.self_motion
    singular = real & (on_a | on_b)
    return Count(jnp.where(real, number, 0).astype(jnp.int8), k.close | k.self_motion | singular)


class Mode(NamedTuple):
    """One assembly mode.

    Attributes:
        x: Abscissa of the platform's point; y and z are joints.
        matrix: Its rotation.
        status: ``Status`` codes.
        multiplicity: How many solutions coincide, 0 where there is none.
        residual: How far the matrix is from a rotation.
    """

    x: Array
    matrix: Matrix3
    status: Array
    multiplicity: Array
    residual: Array


def modes(side: Array, mirror: float, joints: tuple[Array, ...]) -> tuple[Mode, ...]:
    """Returns the four assembly modes in the order of ``SIGNS``; NaN where there is none.

    Of modes that coincide the first has a multiplicity and the others are empty.
    """
    k = known(side, mirror, joints)
    real = (k.a >= 0) & (k.b >= 0) & ~k.self_motion
    # NaN in the roots is all that the entries know of `real`: each of them would otherwise compute it again.
    root_a, root_b, inverse, r12, r31, r32 = materialise(
        *(jnp.where(real, jnp.sqrt(jnp.where(real, square, 1.0)), jnp.nan) for square in (k.a, k.b)),
        1 / jnp.where(k.c > 0, k.c, 1.0),
        k.r12,
        k.r31,
        k.r32,
    )
    empty = jnp.where(
        k.self_motion,
        jnp.int8(Status.SELF_MOTION),
        jnp.where(k.close, jnp.int8(Status.UNDECIDED), jnp.int8(Status.NO_REAL_SOLUTION)),
    )
    plain = jnp.where(k.close, jnp.int8(Status.UNDECIDED), jnp.int8(Status.OK))
    times = jnp.where(root_a == 0, jnp.int8(2), jnp.int8(1)) * jnp.where(root_b == 0, jnp.int8(2), jnp.int8(1))
    found = []
    for sign22, sign33 in SIGNS:
        r22, r33 = _signed(sign22, root_b), _signed(sign33, root_a)
        product = r22 * r33
        here = product >= 0 if sign22 == sign33 else product <= 0
        none = product * 0
        r11 = (product - r12 * r31 * r32) * inverse
        r13 = -(r12 * r32 * r33 + r22 * r31) * inverse
        r21 = -(r12 * r33 + r22 * r31 * r32) * inverse
        r23 = (r12 * r31 - product * r32) * inverse
        row = jnp.abs(r11 * r11 + r12 * r12 + r13 * r13 - 1)
        column = jnp.abs(r13 * r13 + r23 * r23 + r33 * r33 - 1)
        found.append(
            Mode(
                x=side * (_SQRT3 * r11 + mirror * r12) / 2 - joints[2],
                matrix=((r11, none + r12, r13), (r21, none + r22, r23), (none + r31, none + r32, none + r33)),
                status=jnp.where(here, jnp.where(times > 1, jnp.int8(Status.SINGULAR), plain), empty),
                multiplicity=jnp.where(here, times, jnp.int8(0)),
                residual=jnp.maximum(row, column),
            )
        )
    return tuple(found)


def _signed(sign: float, root: Array) -> Array:
    """Returns the root with its sign; NaN for the negative of zero, which is the other sign's mode."""
    return root if sign > 0 else jnp.where(root > 0, -root, jnp.nan)


def lanes(side: Array, mirror: float, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
    """Returns the assembly modes as poses (x, y, z, phi, theta, sigma)."""
    found = []
    for mode in modes(side, mirror, joints):
        none = mode.x * 0
        values = (mode.x, joints[0] + none, joints[1] + none, *xyz_from_matrix(mode.matrix))
        found.append(
            Lane(
                values=values,
                status=mode.status,
                multiplicity=mode.multiplicity,
                residual=mode.residual,
            )
        )
    return tuple(found)
