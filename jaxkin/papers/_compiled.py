"""What the checks compute of the analytic 3-RPR, compiled whole: operation by operation they compile for seconds."""

from functools import partial

import jax
import numpy as np
from jax import Array

import jaxkin as jk
from jaxkin.mapping.batch import in_blocks
from jaxkin.mechanisms import rpr3_closed_forms
from jaxkin.mechanisms.rpr3 import AnalyticRPR3

#: Rows that one compiled call takes; others are padded, so that nothing is compiled for another number of rows.
_ROWS = 1 << 12


def counts_at(robot: AnalyticRPR3, joints: np.ndarray) -> np.ndarray:
    """Returns the number of solutions at each row of joints."""
    return in_blocks(partial(_counts, robot), joints, block=_ROWS)["count"].astype(int)


def forms_at(robot: AnalyticRPR3, joints: np.ndarray) -> dict[str, np.ndarray]:
    """Returns S and Q1 to Q4 at each row of joints."""
    return in_blocks(partial(_forms, robot), joints, block=_ROWS)


def section_cusps(robot: AnalyticRPR3, axis: int, value: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns joints ``(3, 3)`` and poses ``(3, 2, 3)`` of the cusps of a section; see ``rpr3_closed_forms``."""
    found = _section_cusps(robot, axis, value)
    return np.asarray(found.joints), np.asarray(found.poses)


def cusp_edges(robot: AnalyticRPR3) -> rpr3_closed_forms.CuspEdges:
    """Returns the cusp edges as NumPy arrays; see ``rpr3_closed_forms``."""
    return rpr3_closed_forms.CuspEdges(*map(np.asarray, _cusp_edges(robot)))  # type: ignore[arg-type]


@jax.jit
def _counts(robot: AnalyticRPR3, joints: Array) -> dict[str, Array]:
    return {"count": jax.vmap(lambda q: jk.forward(robot, q).count)(joints)}


@jax.jit
def _forms(robot: AnalyticRPR3, joints: Array) -> dict[str, Array]:
    return robot.closed_forms(joints)


_section_cusps = jax.jit(rpr3_closed_forms.section_cusps, static_argnums=1)
_cusp_edges = jax.jit(rpr3_closed_forms.cusp_edges)
