"""Eq. (8) of Wenger and Chablat 2009, what the text concludes from it, and whether every member has cusps."""

import jax
import numpy as np

from jaxkin.mechanisms import rpr3, rpr3_closed_forms
from jaxkin.papers import _wc2009_print as printed
from jaxkin.papers._compiled import cusp_edges, section_cusps
from jaxkin.papers._samples import ROUNDING, SAMPLES, SEED, at_random, off_by, random_geometries
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Table


def cusp_equation() -> Part:
    """Checks Eq. (8) and the text after it, with a table of roots."""
    rng = np.random.default_rng(SEED)
    roots, table = _cusp_equation_roots()
    return Part("Eq. (8)", (*_cusp_equation(rng), *roots, _always_cusps(rng)), tables={"equation_8": table})


def _cusp_equation(rng: np.random.Generator) -> list[Check]:
    _, c, d = random_geometries(rng)
    rho1 = rng.uniform(0.1, 3, SAMPLES)
    robots = rpr3.analytic(np.ones(SAMPLES), c, d)
    found = np.asarray(_cusp_cubic(robots, rho1)).T
    expected = np.stack(printed.cusp_cubic(c, d, rho1))
    off = max(off_by(one, other) for one, other in zip(found, expected, strict=True))
    what = f"this package's cubic in R3, {at_random('members with c2 = 1 and lengths')}, coefficient by coefficient"
    note = "exponents restored, all printed numbers kept"
    checks = [Check("eq8-restored", "Eq. (8)", what, "as printed", "equal", off, ROUNDING, note)]

    k3, k2, k1, _ = expected
    peak = (-k2 - np.sqrt(k2**2 - 3 * k3 * k1)) / (3 * k3)  # The larger root of the derivative, as k3 < 0.
    height, size = printed.value_at(tuple(expected), peak)
    wrong = int(np.sum(~((peak > 0) & (height > -ROUNDING * size))))
    what = f"members and lengths, of {SAMPLES}, where the derivative's larger root or the value there is negative"
    checks.append(count_check("eq8-positive", "text after (8)", what, 0, wrong, f"smallest root {np.min(peak):.2g}"))

    value = float(printed.cusp_cubic(0.0, 1.0, 1.0)[3])
    what = "(8) at R3 = 0, rho1 = 1, example; the difference is that from -11/2"
    checks.append(Check("eq8-zero", "text after (8)", what, "plus infinity", f"{value:.12g}", abs(value + 5.5), 1e-12))
    return checks


def _cusp_equation_roots() -> tuple[list[Check], Table]:
    """Roots of (8) over lengths rho1 of the example, against the cusps of the sections rho1 = const."""
    robot, rows, off, virtual = rpr3.analytic(*printed.EXAMPLE), [], 0.0, 0
    edges = cusp_edges(robot)
    for rho1 in (0.3, 0.34, 0.5, 1.0, 1.5, 2.5):
        joints = section_cusps(robot, 0, rho1)[0]
        roots = np.sort(np.roots([float(k) for k in printed.cusp_cubic(0.0, 1.0, rho1)]).real)
        order = np.argsort(rho1**2 - edges.b)
        expected = (rho1**2 - edges.b)[order]
        off = max(off, float(np.max(np.abs(roots - expected))))
        for root, k in zip(roots, order, strict=True):
            physical = bool(np.isfinite(joints[k, 0]))
            virtual += bool(root > 0 and not physical)
            rows.append(
                (
                    rho1,
                    float(root),
                    float(np.degrees(edges.phi[k])),
                    float(joints[k, 1]) if physical else None,
                    float(joints[k, 2]) if physical else None,
                    "cusp" if physical else "negative" if root <= 0 else "no cusp: rho2 or the pose is not real",
                )
            )
    table = Table(
        "Roots of Eq. (8), example",
        ("rho1", "root R3 = rho3^2", "phi of its edge (deg)", "rho2", "rho3", "what it is"),
        rows,
    )
    what = "roots of (8) at six lengths rho1 against the three cusp edges, example"
    note = f"{virtual} of the positive roots are no cusps"
    return [
        Check("eq8-roots", "Eq. (8)", what, "roots", "equal", off, 1e-11, note),
        Check(
            "eq8-physical",
            "text after (8)",
            "positive roots that are no cusps, example at six lengths rho1; at least one is needed",
            "none",
            str(virtual),
            0.0 if virtual else 1.0,
            0.0,
        ),
    ], table


def _always_cusps(rng: np.random.Generator) -> Check:
    """Every member has cusps: on all three edges, once rho1 is long enough, (7) has a triple root with real lengths."""
    c2, c3, d3 = geometry = random_geometries(rng)
    edges, worst = cusp_edges(rpr3.analytic(c2, c3, d3)), 0.0
    sides = np.abs(c2) + np.abs(c3) + np.abs(d3)
    for phi, a, b, h in zip(*(column.T for column in edges), strict=True):
        r1 = 1 + np.max([h * h, a, b, 0 * a], axis=0)
        k3, k2, k1, k0 = printed.cubic(geometry, (np.sqrt(r1), np.sqrt(r1 - a), np.sqrt(r1 - b)))
        t = np.tan(phi / 2)
        for polynomial in ((k3, k2, k1, k0), (3 * k3, 2 * k2, k1), (6 * k3, 2 * k2)):
            # Over the terms of the coefficients, which cancel where the base triangle is small.
            size = sides * (3 * r1 - a - b + 4 * sides**2) * (1 + np.abs(t)) ** (len(polynomial) - 1)
            worst = max(worst, float(np.max(np.abs(printed.value_at(polynomial, t)[0]) / size)))
    what = f"(7) and two derivatives on all three cusp edges, {at_random('members')} and real lengths, over their terms"
    return Check("always-cusps", "section on cusps", what, "always cusps", f"{worst:.1e}", worst, ROUNDING)


_cusp_cubic = jax.jit(rpr3_closed_forms.cusp_cubic)
