"""Singularity maps: curves and cusps of a section, both families; the whole reproduction from an empty cache."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from metric import Metric, Times, duration, mistakes, seconds

ROOT = Path(__file__).resolve().parents[3]


def measure() -> list[Metric]:
    """Times a section of each family, compiled and not, and holds the cusps against what is known of them."""
    import jaxkin as jk
    from tests.oracles import rpr3_sections, rpr3_torus

    jk.enable_x64()
    data = json.loads((ROOT / "tests" / "data" / "rpr3_sections.json").read_text())
    known = next(s for s in data["sections"] if s["name"] == "reference, rho1 = 14.98")
    reference, analytic = jk.mechanisms.rpr3.reference(), jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    wide = jk.Grid(rho1=14.98, rho2=(0.0, 50.0, 400), rho3=(0.0, 50.0, 400))
    small = jk.Grid(rho1=(0.0, 4.0, 400), rho2=1.0, rho3=(0.0, 4.0, 400))
    geometry = rpr3_torus.Geometry(**known["geometry"])
    times = Times(
        {
            "analytic": lambda: (jk.singular_curves(analytic, small), jk.cusps(analytic, small)),
            "reference": lambda: (jk.singular_curves(reference, wide), jk.cusps(reference, wide)),
            "oracle": lambda: rpr3_sections.cusp_points(geometry, 1, 14.98),
        }
    )
    exact = np.array([[np.sqrt((3 * np.sqrt(3) - 3) / 2), 1.0, np.sqrt(1 + 3 * np.sqrt(3))], [np.sqrt(3), 1.0, 1.0]])
    wrong = _wrong(jk.cusps(analytic, small).joints, exact)
    wrong += _wrong(jk.cusps(reference, wide).joints, np.array([cusp["rho"] for cusp in known["cusps"]]))
    return [
        duration("sections: curves and cusps, analytic, one core", times.median("analytic"), 1.0),
        duration("sections: curves and cusps, reference, one core", times.median("reference"), 1.0),
        duration("sections: compiling, analytic", times.compiling("analytic")),
        duration("sections: compiling, reference", times.compiling("reference")),
        Metric("sections: certified exact cusps / jaxkin", times.ratio("oracle", "reference"), "x", "higher"),
        mistakes("sections: cusps missed, invented or off by more than 1e-12", wrong),
        duration("sections: reproduce wenger-chablat-2009, empty compile cache", seconds(_reproduce), 60.0),
    ]


def _wrong(found: np.ndarray, known: np.ndarray) -> int:
    """Counts cusps of either list that have none of the other within 1e-12 of their size."""
    gaps = np.max(np.abs(found[:, None] - known[None]), axis=2) / np.max(np.abs(known))
    near = gaps <= 1e-12
    return int(np.sum(~near.any(axis=0)) + np.sum(~near.any(axis=1)))


def _reproduce() -> None:
    with tempfile.TemporaryDirectory() as folder:
        inherited = {key: value for key, value in os.environ.items() if key != "JAX_ENABLE_COMPILATION_CACHE"}
        variables = {**inherited, "PYTHONPATH": str(ROOT), "JAXKIN_CACHE_DIR": f"{folder}/cache"}
        command = [
            sys.executable,
            "-m",
            "jaxkin.cli.main",
            "reproduce",
            "wenger-chablat-2009",
            "--out",
            f"{folder}/out",
        ]
        subprocess.run(command, check=True, capture_output=True, env=variables)
