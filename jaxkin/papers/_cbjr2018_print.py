"""Chablat, Baron, Jha and Rolland 2018 as it is printed: equations (1) to (29), written out as they stand.

They are apart from everything else of this package, so that they are a second opinion on it; read from the text of the
authors' copy (hal-01782286). Where something printed is wrong, a flag or a second constant has it corrected;
``_cbjr2018_errata`` lists it. Angles are (phi, theta, sigma), joints (rho1y, rho1z, rho2y, rho2z, rho3y, rho3z).
"""

import itertools
from typing import Any

import numpy as np

Numbers = Any  # numbers or arrays of one shape
Triple = tuple[Numbers, ...]  # three

ROOT3 = float(np.sqrt(3.0))
#: A1, A2, A3 of Eq. (2).
LEGS = ((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, -2.0, 0.0))
#: V1, V2, V3 of Eq. (4), as printed, and as Eqs. (8)-(11) and (16)-(24) need them.
PRINTED_PLATFORM = ((0.0, 0.0, 0.0), (-ROOT3 / 2, 0.5, 0.0), (-ROOT3 / 2, -0.5, 0.0))
PLATFORM = ((0.0, 0.0, 0.0), (-ROOT3 / 2, -0.5, 0.0), (-ROOT3 / 2, 0.5, 0.0))
#: Operations of one solution (text after (24) and after (28)): trigonometric functions, roots, products and quotients,
#: sums and differences.
INVERSE_COST = (6, 1, 14, 11)
DIRECT_COST = (3, 3, 17 + 8, 8 + 12)


def rotation(angles: Triple) -> list[list[Numbers]]:
    """Returns R of Eq. (1)."""
    phi, theta, sigma = angles
    c_p, s_p, c_t, s_t = np.cos(phi), np.sin(phi), np.cos(theta), np.sin(theta)
    c_s, s_s = np.cos(sigma), np.sin(sigma)
    return [
        [c_t * c_s, -c_t * s_s, s_t],
        [s_p * s_t * c_s + c_p * s_s, -s_p * s_t * s_s + c_p * c_s, -s_p * c_t],
        [-c_p * s_t * c_s + s_p * s_s, c_p * s_t * s_s + s_p * c_s, c_p * c_t],
    ]


def legs_ends(joints: tuple[Numbers, ...], passive: Triple) -> list[Triple]:
    """Returns C1, C2, C3 of Eq. (3)."""
    y1, z1, y2, z2, y3, z3 = joints
    x1, x2, x3 = passive
    return [(x1, y1, z1), (-y2, x2, z2), (y3, -x3, z3)]


def corners(position: Triple, angles: Triple, platform: tuple[tuple[float, ...], ...]) -> list[Triple]:
    """Returns W1, W2, W3 of Eq. (5)."""
    turn = rotation(angles)
    return [
        tuple(sum(turn[k][j] * v[j] for j in range(3)) + position[k] for k in range(3))  # type: ignore[misc]
        for v in platform
    ]


def constraints(position: Triple, angles: Triple, joints: tuple[Numbers, ...]) -> list[Numbers]:
    """Returns the left-hand sides of Eqs. (6) to (11)."""
    x, y, z = position
    phi, theta, sigma = angles
    y1, z1, y2, z2, y3, z3 = joints
    c_p, s_p, c_t, s_t = np.cos(phi), np.sin(phi), np.cos(theta), np.sin(theta)
    c_s, s_s = np.cos(sigma), np.sin(sigma)
    return [
        y1 - y,
        z1 - z,
        c_t * c_s * ROOT3 - c_t * s_s - 2 * (y2 + x),
        ROOT3 * (s_p * s_s - c_p * s_t * c_s) + c_p * s_t * s_s + s_p * c_s + 2 * (z2 - z),
        c_t * c_s * ROOT3 + c_t * s_s + 2 * (y3 - x),
        ROOT3 * (s_p * s_s - c_p * s_t * c_s) - c_p * s_t * s_s - s_p * c_s + 2 * (z3 - z),
    ]


def passive_variables(joints: tuple[Numbers, ...], passive: Triple, *, corrected: bool) -> Triple:
    """Returns mu1x, mu2x, mu3x of Eqs. (12) to (14)."""
    y1, _, y2, _, _, _ = joints
    x1, x2, x3 = passive
    if corrected:
        return x1 + y2, x2 - y1, x3 + y1
    return x1 - y2, x2 - y1, x3 + y2


def variables(joints: tuple[Numbers, ...], *, corrected: bool) -> Triple:
    """Returns mu2z, mu3y, mu3z of Eqs. (13) and (14); the other three are zero."""
    _, z1, y2, z2, y3, z3 = joints
    return z2 - z1, y3 + y2 if corrected else y3 - y2, z3 - z1


def moved(position: Triple, joints: tuple[Numbers, ...], *, corrected: bool) -> Triple:
    """Returns x', y', z' of Eq. (15)."""
    y1, z1, y2 = joints[:3]
    return position[0] + y2 if corrected else position[0] - y2, position[1] - y1, position[2] - z1


def reduced_constraints(angles: Triple, mu: Triple, x: Numbers) -> list[Numbers]:
    """Returns the left-hand sides of Eqs. (16) to (19), x meaning x'."""
    phi, theta, sigma = angles
    m2, p, m3 = mu
    c_p, s_p, c_t, s_t = np.cos(phi), np.sin(phi), np.cos(theta), np.sin(theta)
    c_s, s_s = np.cos(sigma), np.sin(sigma)
    return [
        (ROOT3 * c_s - s_s) * c_t - 2 * x,
        (-ROOT3 * c_p * s_t + s_p) * c_s + (ROOT3 * s_p + c_p * s_t) * s_s + 2 * m2,
        (ROOT3 * c_s + s_s) * c_t + 2 * p - 2 * x,
        (-ROOT3 * c_p * s_t - s_p) * c_s + (ROOT3 * s_p - c_p * s_t) * s_s + 2 * m3,
    ]


def inverse(position: Triple, angles: Triple, xp: Any = np) -> tuple[Numbers, ...]:
    """Returns the joints by Eqs. (20) to (24)."""
    x, y, z = position
    phi, theta, sigma = angles
    c_p, s_p, c_t, s_t = xp.cos(phi), xp.sin(phi), xp.cos(theta), xp.sin(theta)
    c_s, s_s = xp.cos(sigma), xp.sin(sigma)
    return (
        y,
        z,
        c_t * (c_s * ROOT3 - s_s) / 2 - x,
        (ROOT3 * (c_p * s_t * c_s - s_p * s_s) - c_p * s_t * s_s - s_p * c_s) / 2 + z,
        -c_t * (c_s * ROOT3 + s_s) / 2 + x,
        (ROOT3 * (c_p * s_t * c_s - s_p * s_s) + c_p * s_t * s_s + s_p * c_s) / 2 + z,
    )


def abscissa(mu: Triple, sign: float, xp: Any = np) -> Numbers:
    """Returns x of Eq. (25), which is x', for one sign of the root; NaN where the root is not real."""
    m2, p, m3 = mu
    below = (m2 - m3 + 1) * (m2 - m3 - 1)
    under = (m2**2 - m2 * m3 + m3**2 - 3 / 4) * (m2**2 - 2 * m2 * m3 + p**2 + m3**2 - 1)
    return (m2**2 * p - m2 * p * m3 - p / 2) / below + sign * xp.sqrt(under) / below


def first_angles(mu: Triple, x: Numbers, xp: Any = np) -> Triple:
    """Returns phi1, theta1, sigma1 of Eqs. (26) to (28) with their plus signs, mu for rho in (28), x meaning x'."""
    m2, p, m3 = mu
    square = p**2 - p * x + x**2
    theta = xp.arccos(2 * xp.sqrt(square / 3))
    sigma = xp.arccos((p - 2 * x) / (2 * xp.sqrt(square)))
    phi = xp.arccos(xp.sqrt((3 / 4 - m2**2 + m2 * m3 - m3**2) / square))
    return phi, theta, sigma


def candidates(mu: Triple) -> dict[tuple[str, str, int], np.ndarray]:
    """Returns the triples of angles of Eqs. (25) to (28), by kind of theta, kind of sigma and sign of the root in (25).

    Kinds are ``"theta1"``, ``"theta2"``, ``"sigma1"`` and ``"sigma2"``. Each array, ``(16, 4, ...)``, has rows
    (phi, theta, sigma, x') with both signs of all three angles, and phi of both kinds.
    """
    found: dict[tuple[str, str, int], np.ndarray] = {}
    for sign in (1, -1):
        x = abscissa(mu, sign)
        phi, theta, sigma = first_angles(mu, x)
        for (t_kind, t), (s_kind, s) in itertools.product(
            (("theta1", theta), ("theta2", np.pi - theta)), (("sigma1", sigma), ("sigma2", np.pi - sigma))
        ):
            found[t_kind, s_kind, sign] = np.array(
                [
                    (f, t_sign * t, s_sign * s, x)
                    for f in (phi, -phi, np.pi - phi, phi - np.pi)
                    for t_sign in (1, -1)
                    for s_sign in (1, -1)
                ]
            )
    return found


def singular(angles: Triple) -> Numbers:
    """Returns the left-hand side of Eq. (29)."""
    phi, theta, sigma = angles
    return (
        np.cos(phi) * np.cos(theta) ** 2 * (np.sin(phi) * np.sin(theta) * np.sin(sigma) - np.cos(phi) * np.cos(sigma))
    )
