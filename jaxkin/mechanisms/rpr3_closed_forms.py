"""Closed forms of the analytic 3-RPR family: singular surfaces in the joint space, cusps, and plane sections.

Notation, beside that of the paper: r_i = rho_i^2, A = r1 - r2, B = r1 - r3, S = sin(phi/2), C = cos(phi/2),
p = x C + y S and h = y C - x S. All functions hold for every member of the family (c2 and d3 not zero); where the paper
sets c2 = 1, c3 = 0, d3 = 1 this is called its example.

The characteristic cubic (7), divided by (1 + t^2)^(3/2), is the trigonometric polynomial

    Re(conj(k) z^3 + conj(w) z),  z = exp(i phi/2),

with k constant, its modulus the product of the three sides of the base triangle, and w linear in A and B. So S, its
discriminant, is a cylinder over a deltoid (three-cusped hypocycloid) in the plane of w, and its cusps lie where the
third harmonic vanishes: at three angles 120 deg apart, whatever the lengths.

References:
    Wenger, P. and Chablat, D., "Kinematic analysis of a class of analytic planar 3-RPR parallel manipulators",
    Computational Kinematics, 2009, hal-00412923. Each function says what the print has wrong.
"""

from operator import index
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.precision import require_x64
from jaxkin.core.tracing import is_traced
from jaxkin.mechanisms import _rpr3_sections
from jaxkin.mechanisms._rpr3_sections import SIGNS, Piece, SectionPoints, heights

if TYPE_CHECKING:
    from jaxkin.mechanisms.rpr3 import AnalyticRPR3

__all__ = [
    "CuspEdges",
    "Piece",
    "SectionCusps",
    "SectionPoints",
    "conics",
    "cusp_cubic",
    "cusp_edges",
    "quartic",
    "section_crossings",
    "section_curves",
    "section_cusps",
]


class CuspEdges(NamedTuple):
    """The three cusp edges rho2^2 = rho1^2 - a, rho3^2 = rho1^2 - b, by ascending phi.

    An edge is physical where rho1 > |h|; rho2 and rho3 are then real.

    Attributes:
        phi: ``(3,)`` angle of the platform, in [-pi, pi), rad.
        a: ``(3,)`` rho1^2 - rho2^2, a length squared.
        b: ``(3,)`` rho1^2 - rho3^2, a length squared.
        h: ``(3,)`` y cos(phi/2) - x sin(phi/2), a length.
    """

    phi: Array
    a: Array
    b: Array
    h: Array


class SectionCusps(NamedTuple):
    """The cusps of a plane section, one row for each cusp edge; NaN where it does not meet the section.

    Attributes:
        joints: ``(3, 3)``.
        poses: ``(3, 2, 3)``: a cusp in the joint space is two poses, +p and -p.
    """

    joints: Array
    poses: Array


def quartic(robot: "AnalyticRPR3", joints: ArrayLike) -> Array:
    """Returns the singular surface S, of degree 4 in the squared lengths: zero where (7) has a double root.

    It is -1/4 of the discriminant of the cubic (7) as a binary form, so nothing special happens where the cubic's
    leading coefficient vanishes (in the example at every rho1 = rho3). S < 0: three real t; S > 0: one. Where the pose
    of the double root is complex, h^2 > rho1^2, S = 0 is virtual: no pose is singular there.

    Args:
        robot: A member of the family.
        joints: ``(..., 3)`` leg lengths.

    Returns:
        ``(...)``, a length to the power 12. In the example the coefficient of rho2^8 is 1.

    References:
        Wenger and Chablat 2009, surface S of the example. The print has three terms wrong: in the
        coefficient of rho2^4, 16 rho1^2 + 44 + 8 rho1^2 (rho1^2 + 2) counts 16 rho1^2 twice (drop the first);
        in that of rho3^4, 16 rho1^6 is 16 rho1^2; the pure term rho1^8 is 4 rho1^8. Printed minus true is
        -rho1^2 (3 rho1^6 - 16 rho1^4 rho3^4 - 16 rho2^4 + 16 rho3^4). A plus before rho3^8 is missing.
    """
    c2, c3, d3 = _geometry(robot, "quartic")
    rho1, rho2, rho3 = _lengths(joints, "quartic")
    a, b = (rho1 - rho2) * (rho1 + rho2), (rho1 - rho3) * (rho1 + rho3)
    k_re, k_im = _third_harmonic(c2, c3, d3)
    w_re = -c2 * d3 * (c2 - 2 * c3) - d3 * a
    w_im = c2 * (3 * c3 * (c2 - c3) - d3 * d3) + c3 * a - c2 * b
    kk, ww = k_re * k_re + k_im * k_im, w_re * w_re + w_im * w_im
    turned = k_re * w_re * (w_re**2 - 3 * w_im**2) + k_im * w_im * (3 * w_re**2 - w_im**2)
    return ww * ww - 8 * turned + 18 * kk * ww - 27 * kk * kk


def conics(robot: "AnalyticRPR3", joints: ArrayLike) -> dict[str, Array]:
    """Returns the quadrics ``Q1`` to ``Q4``, zero where the three legs of a pose are parallel (f1 = 0).

    With signed lengths s1 = rho1, s2 = -e2 rho2, s3 = -e3 rho3, twice the quadric is
    d3^2 (s1 - s2)^2 + (c2 (s1 - s3) - c3 (s1 - s2))^2 - 4 c2^2 d3^2, with the signs (e2, e3): Q1 (-, +), Q2 (+, +),
    Q3 (+, -), Q4 (-, -).

    Args:
        robot: A member of the family.
        joints: ``(..., 3)`` leg lengths.

    Returns:
        Four arrays ``(...)``, lengths to the power 4. In the example they equal the printed quadrics.

    References:
        Wenger and Chablat 2009, Q1 to Q4 of the example, which are correct as printed. The text calls the
        remaining factor K of the elimination one that never vanishes; it contains (rho1^2 - rho2^2)^2 or
        (rho1^2 - rho3^2)^2, spurious factors of the equation (4) or (5) that is used.
    """
    c2, c3, d3 = _geometry(robot, "conics")
    rho1, rho2, rho3 = _lengths(joints, "conics")
    values = {}
    for name, (e2, e3) in SIGNS.items():
        first, second = rho1 + e2 * rho2, rho1 + e3 * rho3
        values[name] = (d3 * first) ** 2 / 2 + (c2 * second - c3 * first) ** 2 / 2 - 2 * (c2 * d3) ** 2
    return values


def cusp_edges(robot: "AnalyticRPR3") -> CuspEdges:
    """Returns the curves of the joint space on which the cubic (7) has a triple root.

    At a triple root the third harmonic of the cubic vanishes: tan(3 phi/2) = d3 (c2 - 2 c3) / (d3^2 + c3 c2 - c3^2).
    Every member of the family has these three edges; a section has 0, 1, 2 or 3 cusps, see ``section_cusps``.

    References:
        Not in Wenger and Chablat 2009, who give the projection (8) of the edges only; see ``cusp_cubic``.
    """
    c2, c3, d3 = (jnp.asarray(leaf)[..., None] for leaf in _geometry(robot, "cusp_edges"))
    k_re, k_im = _third_harmonic(c2, c3, d3)
    flip = jnp.where(k_im > 0, -1.0, 1.0)
    third = (2 / 3) * jnp.arctan2(flip * k_re, -flip * k_im)
    # In [-pi/3, pi/3), so that all three angles come in order and in [-pi, pi).
    third = jnp.where(third + 2 * np.pi / 3 >= np.pi, third - 2 * np.pi / 3, third)
    phi = jnp.maximum(third + jnp.array([-2, 0, 2]) * np.pi / 3, -np.pi)
    s, c = jnp.sin(phi / 2), jnp.cos(phi / 2)
    h1, h2, h3 = heights((c2, c3, d3), s, c)
    return CuspEdges(phi, -2 * c2 * s * (h1 + h2), -2 * (c3 * s - d3 * c) * (h1 + h3), h1)


def cusp_cubic(robot: "AnalyticRPR3", rho1: ArrayLike) -> Array:
    """Returns the cubic (8) in R3 = rho3^2, the projection of the cusp edges onto (rho1, rho3).

    It equals -d3^2 times the product of R3 - rho1^2 + B_k over the three edges. Eliminating rho2 forgets whether rho2
    and the pose are real, so its positive roots must be filtered: one is a cusp only if rho2^2 = rho1^2 - A_k is
    positive and h_k^2 < rho1^2; the product tells neither. ``cusp_edges`` and ``section_cusps`` do.

    Args:
        robot: A member of the family.
        rho1: ``(...)`` length of the first leg.

    Returns:
        ``(..., 4)`` coefficients of R3^3, R3^2, R3 and 1; the polynomial is a length to the power 8.

    References:
        Wenger and Chablat 2009, Eq. (8), with c2 = 1; made homogeneous here. In the paper's text the exponents are
        lost: every power of d3 reads d^3, and c3 reads c^3; with the powers restored all coefficients agree.
        The text after it takes the left-hand side to plus infinity as R3 goes to 0; it does so as R3 goes
        to minus infinity and is finite at 0. The existence of cusps follows from ``cusp_edges`` without this.
    """
    c2, c, d = _geometry(robot, "cusp_cubic")
    r1 = jnp.asarray(rho1, dtype=float) ** 2
    dd = d * d
    m = c * c - 2 * c * c2 + dd  # The B_k add up to -3 m, and multiply to -m^3.
    # -4/3 of d3^2 times the sum of the products of two B_k:
    e = (
        9 * c**4 * (c - c2) ** 2
        + c * dd * (23 * c**3 - 20 * c**2 * c2 + 2 * c * c2**2)
        + dd**2 * (19 * c**2 - 2 * c * c2 + 9 * c2**2)
        + 5 * dd**3
    )
    return jnp.stack(
        jnp.broadcast_arrays(
            -dd,
            3 * dd * (r1 + m),
            0.75 * e - 3 * dd * r1 * (r1 + 2 * m),
            dd * (r1 * r1 * (r1 + 3 * m) + m**3) - 0.75 * e * r1,
        ),
        axis=-1,
    )


def section_cusps(robot: "AnalyticRPR3", axis: int, value: ArrayLike) -> SectionCusps:
    """Returns the cusps of the section where one leg has a fixed length: one for each physical cusp edge, so 0 to 3.

    Differentiable in the geometry and in ``value`` where a cusp exists.

    Args:
        robot: A member of the family.
        axis: The fixed leg: 0, 1 or 2.
        value: Its length, positive.

    Raises:
        InputError: ``axis`` is none of 0, 1, 2, or ``value`` is not positive and finite.

    References:
        Wenger and Chablat 2009 give the two cusps of the example at rho2 = 1, truncated to 8 decimals, not rounded.
    """
    c2, c3, d3 = (jnp.asarray(leaf)[..., None] for leaf in _geometry(robot, "section_cusps"))
    axis, value = _section(axis, value, "section_cusps")
    length = jnp.asarray(value, dtype=float)[..., None]
    phi = cusp_edges(robot).phi
    s, c = jnp.sin(phi / 2), jnp.cos(phi / 2)
    # The components across of all legs from that of the fixed one, so that the pose fits all three.
    across = jnp.stack([jnp.zeros_like(phi), 2 * c2 * s, 2 * (c3 * s - d3 * c)], axis=-1)
    fixed = heights((c2, c3, d3), s, c)[axis]
    h = fixed[..., None] + (across - across[..., axis : axis + 1])
    square = (length - fixed) * (length + fixed)
    physical = square > 0
    p2 = jnp.where(physical, square, 1.0)[..., None]
    legs = jnp.sqrt(p2 + h * h).at[..., axis].set(length)
    p, h1 = jnp.sqrt(p2) * jnp.array([1.0, -1.0]), h[..., :1]
    s, c, phi = s[..., None], c[..., None], phi[..., None]
    poses = jnp.stack(jnp.broadcast_arrays(p * c - h1 * s, p * s + h1 * c, phi), axis=-1)
    return SectionCusps(
        jnp.where(physical[..., None], legs, jnp.nan), jnp.where(physical[..., None, None], poses, jnp.nan)
    )


def section_crossings(robot: "AnalyticRPR3", axis: int, value: float) -> SectionPoints:
    """Returns the poses of a section with f1 = f2 = 0, where both singular curves cross in the workspace.

    In the joint space the real part of S ends here, tangent to one of the quadrics. They are no cusps.

    Args:
        robot: One concrete member of the family.
        axis: The fixed leg: 0, 1 or 2.
        value: Its length, positive.

    Returns:
        NumPy arrays ``(n, 3)`` of joints and poses, n at most 6, by ascending phi.

    Raises:
        InputError: ``axis`` is none of 0, 1, 2, ``value`` is not positive and finite, or the robot is batched or
            traced.

    References:
        Not in Wenger and Chablat 2009, where nothing tells the real part of S from the virtual one.
    """
    geometry = _concrete(robot, "section_crossings")
    axis, length = _section(axis, value, "section_crossings")
    return _rpr3_sections.crossings(geometry, axis, _number(length, "section_crossings"))


def section_curves(robot: "AnalyticRPR3", axis: int, value: float, samples: int = 720) -> list[Piece]:
    """Returns all singular curves of a section in closed form, as labelled pieces.

    The pieces "S" with real poses are closed: a piece runs over the poses +p and back over -p, through the crossings
    at its ends, or, if there are none, over phi twice; each of its points in the joint space is met twice. The virtual
    pieces of "S" carry no pose. The pieces "Q1" to "Q4" make up one closed curve of poses, with parallel legs, cut
    where a leg has zero length. Lengths at which two pieces of a kind just touch are decided by rounding.

    Args:
        robot: One concrete member of the family.
        axis: The fixed leg: 0, 1 or 2.
        value: Its length, positive.
        samples: Points that a closed piece has at least, about. More are inserted where the curve bends, until every
            chord is as close to it as those of a circle with so many points. Cusps and ends are always included.

    Raises:
        InputError: ``axis`` is none of 0, 1, 2, ``value`` is not positive and finite, ``samples`` is smaller than
            16, or the robot is batched or traced.

    References:
        Wenger and Chablat 2009, Fig. 3, is the example at rho2 = 1; see ``quartic`` for what is wrong in its equation.
    """
    geometry = _concrete(robot, "section_curves")
    axis, fixed = _section(axis, value, "section_curves")
    length = _number(fixed, "section_curves")
    if not isinstance(samples, int | np.integer) or samples < 16:
        raise InputError(f"section_curves: samples is {samples!r}; it must be a whole number of at least 16.")
    return _rpr3_sections.curves(geometry, axis, length, np.array(_compiled_cusp_edges(robot).phi), int(samples))


_compiled_cusp_edges = jax.jit(cusp_edges)


def _third_harmonic(c2: Array, c3: Array, d3: Array) -> tuple[Array, Array]:
    """Returns the constant k, the coefficients of cos(3 phi/2) and sin(3 phi/2) in the cubic (7)."""
    return c2 * d3 * (c2 - 2 * c3), -c2 * (c3 * (c2 - c3) + d3 * d3)


def _geometry(robot: "AnalyticRPR3", who: str) -> tuple[Array, Array, Array]:
    require_x64(who)
    if getattr(robot, "id", None) != "rpr3-analytic":
        raise InputError(
            f"{who} got {type(robot).__name__} as its robot: the closed forms hold for the analytic family alone; "
            "build one with rpr3.analytic."
        )
    return robot.c2, robot.c3, robot.d3


def _concrete(robot: "AnalyticRPR3", who: str) -> tuple[float, float, float]:
    geometry = _geometry(robot, who)
    if any(is_traced(leaf) or jnp.ndim(leaf) > 0 for leaf in geometry):
        raise InputError(
            f"{who} got a batched or traced robot: the number of its results depends on the numbers; call it outside "
            "jit, vmap and grad, once for each robot."
        )
    c2, c3, d3 = map(float, geometry)
    return c2, c3, d3


def _lengths(joints: ArrayLike, who: str) -> tuple[Array, Array, Array]:
    joints = jnp.asarray(joints, dtype=float)
    if joints.shape[-1:] != (3,):
        raise InputError(f"{who}: joints has shape {joints.shape}; its last axis must hold rho1, rho2, rho3.")
    return joints[..., 0], joints[..., 1], joints[..., 2]


def _section(axis: int, value: ArrayLike, who: str) -> tuple[int, ArrayLike]:
    """Checks which leg is fixed, and at what length."""
    try:
        number = index(axis)
    except TypeError:
        number = -1
    if number not in (0, 1, 2):
        raise InputError(f"{who}: axis is {axis!r}; it must be 0, 1 or 2, for rho1, rho2 or rho3.")
    if not is_traced(value):
        try:
            good = bool(np.all(np.isfinite(value)) and np.all(np.asarray(value) > 0))
        except (TypeError, ValueError):
            good = False
        if not good:
            raise InputError(f"{who}: value is {value!r}; a fixed leg must have a positive, finite length.")
    return number, value


def _number(value: ArrayLike, who: str) -> float:
    """Returns the length of a leg as the one concrete number that it must be."""
    if is_traced(value) or np.ndim(value) > 0:
        raise InputError(f"{who}: value is {value!r}; it must be one concrete number: call it once for each section.")
    return float(value)  # type: ignore[arg-type]
