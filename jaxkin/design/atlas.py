"""Atlases: fields over geometries, for ``jk.sweep`` over any numbers of a mechanism.

A further one is made by ``jk.fields.from_function(..., domain="geometry")``.
"""

import functools
import json
import re

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import jsonable
from jaxkin.design.objective import Objective
from jaxkin.mapping.cusps import cusps
from jaxkin.mapping.section import checked_grid
from jaxkin.mapping.workspace import workspace_volume as volume_of
from jaxkin.sweep.designs import BLOCK, design, refused_variable, traced_kernel
from jaxkin.sweep.fields import Field, Variable
from jaxkin.sweep.grid import Grid, Span


def number_of_cusps(section: Grid) -> Field:
    """Returns the field "number of cusps of a section" over geometries, by ``jk.cusps``.

    It cannot be traced: it is computed one design at a time, at about 0.2 s each, after some 20 s of compiling for
    a class of robots. Designs that ``jk.cusps`` refuses (no pose reaches the section, say) have the value -1, and
    ``number_of_cusps_refused`` is True; ``number_of_cusps_doubtful`` is True where its searches disagree.

    Args:
        section: A grid with two free joint axes; their ends are limits, their numbers only seed.

    Raises:
        InputError: It is no grid; before a sweep: it is no section of the mechanism's joint space.
    """
    if not isinstance(section, Grid):
        raise InputError(
            f"number_of_cusps got {section!r} as its section: pass a jaxkin.Grid with two free joint axes."
        )
    fixed = ", ".join(f"{name} = {value:.12g}" for name, value in section.axes.items() if not isinstance(value, Span))
    attrs = {"section": repr(section), "of": f"section {fixed}" if fixed else "section"}

    def variables(robot: Mechanism) -> tuple[Variable, ...]:
        checked_grid("number_of_cusps", robot, section)
        name = "number_of_cusps"
        doubt = "the searches for cusps disagree"
        return (
            Variable(name, "int8", "1", "number of cusps", missing=-1, attrs=attrs, signed=False),
            Variable(f"{name}_doubtful", "bool", "1", doubt, missing=False, attrs=attrs),
            refused_variable(name),
        )

    def kernel(robot: Mechanism, numbers: dict[str, float]) -> tuple[int, bool]:
        found = cusps(design(robot, numbers), section)
        return len(found), not found.complete

    return Field(
        name="number_of_cusps",
        domain="geometry",
        variables=variables,
        kernel=kernel,
        block=lambda robot: 1,
        # The section is a part of what determines the numbers.
        version=f"1, {section!r}",
        traced=False,
    )


@functools.cache
def workspace_volume(branch: str = "upper") -> Field:
    """Returns the field "volume of what the strokes reach" over geometries, by ``jk.workspace_volume``.

    NaN where the geometry is degenerate, an interval of strokes is empty or a length is not positive.
    ``workspace_volume_error`` is the estimate of its error.

    Args:
        branch: ``"upper"`` or ``"lower"``.

    Raises:
        InputError: Before a sweep: the mechanism has no workspace of this kind, or there is no such branch.
    """

    def variables(robot: Mechanism) -> tuple[Variable, ...]:
        jax.eval_shape(lambda own: volume_of(own, branch).volume, robot)
        unit = f"{robot.pose_axes[0].unit}^3"
        return tuple(
            Variable(v.name, v.dtype, unit, f"{v.long_name} ({branch} branch)", signed=False) for v in _VOLUMES
        )

    def values(robot: Mechanism) -> tuple[jax.Array, jax.Array]:
        found = volume_of(robot, branch)
        return found.volume, found.error

    return Field(
        name="workspace_volume",
        domain="geometry",
        variables=variables,
        kernel=traced_kernel(values, _VOLUMES),
        block=lambda robot: 8,
        version=f"1, {branch}",
    )


def smoothed_objective(objective: Objective, center: ArrayLike | None = None) -> Field:
    """Returns an objective of ``jk.design``, smoothed as optimisers see it, as a field over geometries.

    NaN where the geometry is degenerate. The field's name is the objective's, with underscores.

    Args:
        objective: The objective.
        center: ``(n_pose,)`` the middle of its place, where a design moved it.

    Raises:
        InputError: It is no objective.
    """
    if not isinstance(objective, Objective):
        raise InputError(f"smoothed_objective got {objective!r}: pass an objective of jaxkin.design.")
    middle = None if center is None else jnp.asarray(center, float)
    name = re.sub(r"\W+", "_", objective.name)
    at = {} if middle is None else {"center": middle.tolist()}
    variable = Variable(name, "float64", objective.unit, objective.name, attrs={"smoothing": objective.smoothing, **at})
    return Field(
        name=name,
        domain="geometry",
        variables=lambda robot: (variable,),
        kernel=traced_kernel(lambda robot: (objective(robot, middle),), (variable,)),
        block=lambda robot: BLOCK,
        # What determines the objective is a part of what determines the numbers.
        version=f"1, {json.dumps(jsonable(objective.content | at), sort_keys=True)}",
    )


_VOLUMES = (
    Variable("workspace_volume", "float64", "1", "volume of the workspace"),
    Variable("workspace_volume_error", "float64", "1", "estimated error of the volume"),
)
