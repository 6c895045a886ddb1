"""Makes the data file of sections: counts by two exact decompositions and two scans that all agree."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from flint import ctx

from .rpr3_section_scan import scan
from .rpr3_sections import components, cusp_points, general_cusps
from .rpr3_torus import PREC, REFERENCE, Geometry, Scan, Section, random_section


def near_event(seed: int, low: float, high: float, offset: float) -> tuple[Geometry, int, float]:
    """Returns the section of a random robot at `offset` (relative) from where its counts change in (low, high)."""
    geometry, axis, _ = random_section(seed)
    before = _counts(geometry, axis, low)
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if _counts(geometry, axis, middle) == before else (low, middle)
    return geometry, axis, round(high * (1 + offset), 7)


def _counts(geometry: Geometry, axis: int, value: float) -> tuple[int, int]:
    return len(cusp_points(geometry, axis, value)), components(geometry, axis, value).count


def describe(geometry: Geometry, fixed_axis: int, fixed_value: float) -> dict[str, Any]:
    """Returns one entry of the data file; the counts are those of two exact decompositions and of two scans.

    Raises:
        RuntimeError: If these disagree.
    """
    cusps = cusp_points(geometry, fixed_axis, fixed_value)
    if max((cusp.radius() for cusp in cusps), default=0.0) > 1e-100:
        raise RuntimeError("the balls of the cusps are too large")
    parts = components(geometry, fixed_axis, fixed_value)
    if components(geometry, fixed_axis, fixed_value, over_alpha=True).count != parts.count:
        raise RuntimeError("the decompositions over phi and over alpha disagree")
    expected, sizes, size = Scan(parts.count, len(cusps)), [], 250
    while len(sizes) < 2:
        seen = scan(geometry, fixed_axis, fixed_value, size) == expected
        sizes = [*sizes, size] if seen else []
        if size > 5000:
            raise RuntimeError(f"no two scans in a row agree with {expected}")
        size = size * 8 // 5
    with ctx.workprec(PREC):
        spread = general_cusps(Section(geometry, fixed_axis, fixed_value))[1]
    changes, step = [], 1e-3
    here = Scan(parts.count, len(cusps))[::-1]
    for sign in (-1, 1):
        for k in range(1, 21):
            near, far = (fixed_value * (1 + sign * step * j) for j in (k - 1, k))
            if (there := _counts(geometry, fixed_axis, far)) != here:
                while abs(far - near) > 1e-9 * far:
                    middle = (near + far) / 2
                    same = _counts(geometry, fixed_axis, middle) == here
                    near, far = (middle, far) if same else (near, middle)
                there = _counts(geometry, fixed_axis, far)
                changes.append({"value": far, "cusps": there[0], "components": there[1]})
                break
    names = ("c2", "c3", "d3", "l2", "l3", "beta")
    return {
        "geometry": {name: getattr(geometry, name) for name in names},
        "fixed_axis": fixed_axis,
        "fixed_value": fixed_value,
        "components": parts.count,
        "turning_points_in_phi": parts.turning,
        "cusps": [dict(zip(("rho", "pose"), cusp.floats(), strict=True)) for cusp in cusps],
        "scans": sizes,
        "least_imaginary_phi_of_complex_cusps": spread,
        "changes_within_two_percent": changes,
    }


ABOUT = (
    "Sections of the joint space of planar 3-RPR robots with one leg fixed (fixed_axis 1, 2 or 3 at fixed_value), "
    "written by `python -m tests.oracles.rpr3_section_data`. Base (0, 0), (c2, 0), (c3, d3); platform (0, 0), (l2, 0), "
    "l3 (cos beta, sin beta). cusps: all of them, from a resultant with rational coefficients and certified balls "
    "(radius below 1e-100), rounded to float64; rho = three leg lengths, pose = x, y of the first platform joint and "
    "phi in (-pi, pi]. components: closed curves of singular poses on the torus of poses with that leg length "
    "(direction of the fixed leg, phi), by exact decompositions over phi and over the leg's direction. scans: sizes "
    "of two grids of the torus that show the same numbers of cusps and components. changes_within_two_percent: the "
    "nearest fixed values below and above at which these numbers change (sampled by 0.1 percent and bisected), with "
    "the numbers beyond; pairs of events within 0.1 percent that cancel are not seen."
)


def main(path: str) -> None:
    """Writes the data file."""
    cases = {
        "reference, rho1 = 14.98": (REFERENCE, 1, 14.98),
        "reference, rho1 = 17": (REFERENCE, 1, 17.0),
        **{f"seed {seed}, {what}": random_section(seed) for seed, what in SEEDS.items()},
        **{f"seed {seed}, {what}": near_event(seed, *rest) for seed, what, *rest in EVENTS},
    }
    entries = []
    for name, case in cases.items():
        entries.append({"name": name, **describe(*case)})
        print(name, len(entries[-1]["cusps"]), entries[-1]["components"], entries[-1]["changes_within_two_percent"])
    Path(path).write_text(json.dumps({"about": ABOUT, "sections": entries}, indent=1) + "\n")


SEEDS = {
    0: "ordinary",
    3: "ordinary",
    5: "flat base",
    7: "ordinary",
    10: "flat platform",
    1: "flat base, few cusps, three components",
    199: "few cusps, three components",
    378: "flat platform, no cusp",
    1122: "flat platform, no cusp",
    14: "flat platform, many cusps",
    569: "flat base, many cusps",
    959: "many cusps",
    120: "many cusps",
    847: "many cusps, three components, narrow necks",
}
# Seed, name, an interval of the fixed value with one change of the counts, and the section's relative offset from it.
EVENTS = [
    (120, "ten cusps, just past beaks", 1.75, 1.79, 1e-4),
    (120, "ten cusps, just past a swallowtail", 1.86, 1.91, 1e-4),
    (14, "flat platform, just short of beaks", 2.1, 2.19, -1e-4),
    (41, "flat base, just past beaks and a swallowtail that are 1e-9 apart or less", 2.1, 2.15, 1e-4),
]

if __name__ == "__main__":
    main(sys.argv[1])
