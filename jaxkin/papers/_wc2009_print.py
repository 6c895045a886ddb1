"""Wenger and Chablat 2009 as it is printed: its equations in NumPy, and what is wrong in them.

The equations are written out as they stand, apart from everything else of this package, so that they are a second
opinion on it. They are read from the text of the authors' copy (hal-00412923); where only a digit or an exponent is
off, the slip may be that text's and not the print's, and the errata say so.
"""

from typing import Any

import numpy as np

from jaxkin.papers.report import Erratum

Numbers = Any  # numbers or arrays of one shape

#: Geometry of the example, (c2, c3, d3).
EXAMPLE = (1.0, 0.0, 1.0)
#: The cusps (rho1, rho3) of the example at rho2 = 1.
CUSPS = (("1.73205080", "1"), ("1.04789131", "2.48920718"))


def squared_lengths(geometry: tuple[Numbers, ...], pose: tuple[Numbers, ...]) -> tuple[Numbers, Numbers, Numbers]:
    """Returns the right-hand sides of Eqs. (1) to (3), for (c2, c3, d3, l2, l3, beta) and (x, y, phi)."""
    c2, c3, d3, l2, l3, beta = geometry
    x, y, phi = pose
    return (
        x**2 + y**2,
        (x + l2 * np.cos(phi) - c2) ** 2 + (y + l2 * np.sin(phi)) ** 2,
        (x + l3 * np.cos(phi + beta) - c3) ** 2 + (y + l3 * np.sin(phi + beta) - d3) ** 2,
    )


def lines(geometry: tuple[Numbers, ...], phi: Numbers, rho: tuple[Numbers, ...]) -> tuple[Numbers, ...]:
    """Returns R, S, Q, U, V, W of Eqs. (4) and (5), which the paper leaves to its references; derived anew."""
    c2, c3, d3, l2, l3, beta = geometry
    r1, r2, r3 = (value**2 for value in rho)
    turned = phi + beta
    return (
        2 * (l2 * np.cos(phi) - c2),
        2 * l2 * np.sin(phi),
        l2**2 + c2**2 - 2 * c2 * l2 * np.cos(phi) + r1 - r2,
        2 * (l3 * np.cos(turned) - c3),
        2 * (l3 * np.sin(turned) - d3),
        l3**2 + c3**2 + d3**2 - 2 * c3 * l3 * np.cos(turned) - 2 * d3 * l3 * np.sin(turned) + r1 - r3,
    )


def mirrored(geometry: tuple[Numbers, ...]) -> tuple[Numbers, ...]:
    """Returns (c2, c3, d3, l2, l3, beta) of a member of the family, Eq. (6)."""
    c2, c3, d3 = geometry
    return c2, c3, d3, c2, np.hypot(c3, d3), np.arctan2(-d3, c3)


def cubic(geometry: tuple[Numbers, ...], rho: tuple[Numbers, ...]) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Returns the coefficients of Eq. (7), from t^3 to 1."""
    c2, c3, d3 = geometry
    r1, r2, r3 = (value**2 for value in rho)
    return (
        c3 * (r1 - r2 + 4 * c2**2 - 4 * c3 * c2) + c2 * (r3 - r1),
        d3 * (8 * c3 * c2 - 4 * c2**2 + r2 - r1),
        c3 * (r1 - r2) + r3 * c2 - 4 * d3**2 * c2 - r1 * c2,
        d3 * (r2 - r1),
    )


def value_at(coefficients: tuple[Numbers, ...], t: Numbers) -> tuple[Numbers, Numbers]:
    """Returns a polynomial's value, and the sum of its terms' magnitudes."""
    powers = [c * t ** (len(coefficients) - 1 - k) for k, c in enumerate(coefficients)]
    return sum(powers), sum(map(np.abs, powers))


def factors(geometry: tuple[Numbers, ...], pose: tuple[Numbers, ...]) -> tuple[Numbers, Numbers]:
    """Returns f1 and f2, in t = tan(phi/2)."""
    c2, c3, d3 = geometry
    x, y, phi = pose
    t = np.tan(phi / 2)
    f2 = (
        (-2 * c3 * d3 + x * d3) * t**3
        + (-2 * c3**2 + 2 * c2 * c3 + 2 * d3**2 - y * d3) * t**2
        + (2 * c3 * d3 - 2 * c2 * d3 + x * d3) * t
        - d3 * y
    )
    return x + t * y, f2


def quartic(rho: tuple[Numbers, ...], *, corrected: bool) -> Numbers:
    """Returns S of the example, as the text has it (with the plus before rho3^8 that it lacks), or corrected."""
    rho1, rho2, rho3 = rho
    if corrected:
        twice = rest = 44 + 16 * rho1**2 + 8 * rho1**4
        pure = 4 * rho1**8
    else:
        twice = 16 * rho1**2 + 44 + 8 * rho1**2 * (rho1**2 + 2)
        rest = 16 * rho1**6 + 44 + 8 * rho1**4
        pure = rho1**8
    return (
        rho2**8
        - 4 * (rho1**2 + 3) * rho2**6
        + (2 * rho3**4 + (20 - 4 * rho1**2) * rho3**2 + twice) * rho2**4
        + ((20 - 4 * rho1**2) * rho3**4 + (8 * rho1**4 - 80 * rho1**2 - 88) * rho3**2) * rho2**2
        + (-8 * rho1**6 + 24 * rho1**4 - 32) * rho2**2
        + rho3**8
        - 4 * (rho1**2 + 3) * rho3**6
        + rest * rho3**4
        + (24 * rho1**4 - 8 * rho1**6 - 32) * rho3**2
        - 64
        + pure
        - 16 * rho1**6
        + 64 * rho1**2
    )


def conics(rho: tuple[Numbers, ...]) -> dict[str, Numbers]:
    """Returns Q1 to Q4 of the example."""
    rho1, rho2, rho3 = rho
    squares = rho2**2 / 2 - 2 + rho1**2 + rho3**2 / 2
    return {
        "Q1": squares - rho1 * rho2 + rho1 * rho3,
        "Q2": squares + rho1 * rho2 + rho1 * rho3,
        "Q3": squares + rho1 * rho2 - rho1 * rho3,
        "Q4": squares - rho1 * rho2 - rho1 * rho3,
    }


def cusp_cubic(c: Numbers, d: Numbers, rho1: Numbers) -> tuple[Numbers, Numbers, Numbers, Numbers]:
    """Returns the coefficients of Eq. (8) (c2 = 1), from R3^3 to 1: every number as printed, the exponents restored.

    The text has every power of d3 as d^3, and c3 itself as c^3.
    """
    r1 = rho1**2
    return (
        -(d**2),
        3 * d**2 * c**2 + 3 * d**4 + 3 * d**2 * r1 - 6 * d**2 * c,
        (
            12 * d**2 * r1 * c - 15 * d**2 * c**3 - 6 * d**2 * r1 * c**2 + 69 / 4 * d**2 * c**4 - 27 / 2 * c**5
            + 27 / 4 * c**6 + 57 / 4 * d**4 * c**2 - 3 / 2 * d**4 * c + 27 / 4 * d**4 - 6 * d**4 * r1
            + 3 / 2 * d**2 * c**2 + 27 / 4 * c**4 + 15 / 4 * d**6 - 3 * d**2 * r1**2
        ),
        (
            -27 * c**6 * r1 / 4 + 3 * c**2 * d**6 - 57 * d**4 * r1 * c**2 / 4 - 6 * c * d**6 + 3 * d**4 * r1**2
            - 6 * d**2 * c**5 + c**6 * d**2 - 69 * d**2 * r1 * c**4 / 4 - 3 * d**2 * r1 * c**2 / 2 - 8 * d**2 * c**3
            + 12 * d**2 * c**4 - 6 * d**2 * r1**2 * c + 3 * d**2 * r1**2 * c**2 + 15 * d**2 * r1 * c**3
            - 27 * c**4 * r1 / 4 + d**2 * r1**3 + 27 * c**5 * r1 / 2 + 3 * d**4 * c**4 - 27 * d**4 * r1 / 4
            - 12 * d**4 * c**3 + 3 * d**4 * r1 * c / 2 + 12 * d**4 * c**2 + d**8 - 15 * d**6 * r1 / 4
        ),
    )  # fmt: skip


_MAYBE_EXTRACTION = "A slip of the print, or of the text made from it."

ERRATA = (
    Erratum(
        "text after (5)",
        "where RV - SU = 0 the inverse kinematics fails",
        "the forward kinematics: (4) and (5) no longer give x and y",
        "definition; RV - SU = 0 on the whole family",
        ("eq6",),
    ),
    Erratum(
        "text before (7)",
        "SW - VQ = 0 and RW - UQ = 0 are equivalent",
        "SW - VQ = -4 P/(1+t^2)^2 and RW - UQ = 4 t P/(1+t^2)^2 with P the cubic (7): the second vanishes at t = 0 too",
        "both sides at random points",
        ("eq7-elimination",),
    ),
    Erratum(
        "text after (7)",
        "either of (4), (5) gives the angle z",
        "(4) is 0 = 0 at t = 0, and (5) at c3 t = d3; the other one must be used there",
        "coefficients at t = 0",
        ("eq4-empty",),
    ),
    Erratum(
        "text after (7)",
        "6, 4 or 2 solutions; 2 where (7) has one real root",
        "0 as well, and often; one real root carries 0 or 2 solutions, three carry 0, 2, 4 or 6",
        "counts against roots of the printed (7) with real x and y",
        ("counts", "combinations", "zero-share"),
    ),
    Erratum(
        "text before f1",
        "the factors follow from the conditions (1) to (3)",
        "from the conditions (6)",
        "(1) to (3) are the constraints",
        ("det",),
    ),
    Erratum(
        "text after Fig. 2",
        "the upper and lower sides of the joint space are glued",
        "those of the workspace: phi = -pi and phi = pi",
        "each surface is one piece once they are glued",
        ("figure_2-pieces-f1", "figure_2-pieces-f2"),
    ),
    Erratum(
        "S, coefficient of rho2^4",
        "16 rho1^2 + 44 + 8 rho1^2 (rho1^2 + 2)",
        "44 + 16 rho1^2 + 8 rho1^4: the term 16 rho1^2 stands twice",
        "discriminant of (7); S is symmetric in rho2 and rho3, the printed one is not",
        ("S-discriminant", "S-printed"),
    ),
    Erratum(
        "S, coefficient of rho3^4",
        "16 rho1^6 + 44 + 8 rho1^4",
        "16 rho1^2 + 44 + 8 rho1^4",
        f"discriminant of (7). {_MAYBE_EXTRACTION}",
        ("S-discriminant", "S-printed"),
    ),
    Erratum(
        "S, pure term",
        "rho1^8",
        "4 rho1^8",
        f"discriminant of (7). {_MAYBE_EXTRACTION}",
        ("S-discriminant", "S-printed"),
    ),
    Erratum(
        "S, line break",
        "no sign before rho3^8",
        "+ rho3^8",
        f"discriminant of (7). {_MAYBE_EXTRACTION}",
        ("S-discriminant",),
    ),
    Erratum(
        "text before Q1",
        "the factor K beside Q1 Q2 Q3 Q4 never vanishes",
        "it contains (rho1^2 - rho2^2)^2, or (rho1^2 - rho3^2)^2 where (5) is used; these factors are spurious",
        "at rho1 = rho2 and t = 0 both (7) and (4) vanish, Q1 to Q4 do not",
        ("K",),
    ),
    Erratum(
        "text before Fig. 3",
        "regions of 2, 4 or 6 assembly modes",
        "0, 2, 4 or 6; regions without any are white here",
        "share of the section",
        ("figure_3-zero",),
    ),
    Erratum(
        "surface S and Fig. 3",
        "nothing tells real from virtual parts of S",
        "where the double root's pose is complex no pose is singular and the count does not change; real parts end "
        "on a Q",
        "counts on both sides",
        ("figure_3-jump-S", "figure_3-jump-virtual", "figure_3-crossings"),
    ),
    Erratum(
        "section on cusps",
        "cases (i), (ii), (iii) and (v)",
        "(iv): there are four",
        "the list in the introduction",
    ),
    Erratum(
        "Eq. (8)",
        "every power of d3 as d^3, c3 as c^3",
        "the exponents of squared lengths to the power 4 (with c2 = 1), as written in this package",
        "all printed numbers agree with the product over the three cusp edges. An error of the text made from the "
        "print",
        ("eq8-restored", "eq8-roots"),
    ),
    Erratum(
        "text after (8)",
        "the left-hand side goes to plus infinity as R3 goes to 0",
        "as R3 goes to minus infinity; at 0 it is finite, and may be negative",
        "its value at R3 = 0",
        ("eq8-zero",),
    ),
    Erratum(
        "text after (8)",
        "a positive root proves that there are cusps",
        "only where rho2^2 is positive and the pose real as well. The conclusion holds: every member has three cusp "
        "edges, real from some rho1 on; but a section has 0, 1, 2 or 3 cusps",
        "triple roots of (7) of random members; sections of each kind",
        ("eq8-physical", "always-cusps", "family-0", "family-1", "family-2", "family-3"),
    ),
    Erratum(
        "cusps at rho2 = 1",
        "1.04789131, 2.48920718",
        "correct, and cut off rather than rounded: 1.04789132, 2.48920719",
        "exact coordinates",
        ("cusp-0-truncated", "cusp-1-truncated", "cusp-0-exact", "cusp-1-exact"),
    ),
)
