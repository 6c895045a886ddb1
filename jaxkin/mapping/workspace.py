"""Workspaces of robots whose joint limits are distances to points of a plane: volume, boundary, free volume.

A mechanism declares this by a method ``reach_spheres() -> (Shells, z of the plane)``; the TLPM has it.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import identity
from jaxkin.core.tracing import is_traced
from jaxkin.core.words import meant
from jaxkin.kinematics.boundary import checked_mechanism, checked_single
from jaxkin.mapping import _workspace_columns, _workspace_mesh
from jaxkin.mapping._orientation_factors import checked_tolerance, checked_whole
from jaxkin.mapping._workspace_records import FreeVolume, Volume, WorkspaceSurfaces
from jaxkin.numerics import spheres
from jaxkin.numerics.spheres import Shells

#: The side of the singular plane on which each branch lies.
BRANCHES = {"upper": 1.0, "lower": -1.0}
#: How often a mesh is made finer until its patches meet everywhere.
_REFINEMENTS = 3


def workspace_volume(robot: Mechanism, branch: str = "upper") -> Volume:
    """Returns the volume of what the strokes of one branch reach, with an estimate of its error.

    For the TLPM: all p with l_i_min <= |p - q_i| - L_i0 <= l_i_max on one side of the singular plane z = -h. The volume
    is integrated over horizontal slices, whose areas are exact (see ``jaxkin.numerics.spheres``). Traceable: through
    ``jit``, ``vmap`` over designs, and ``grad`` with respect to geometry and limits. Joint limits are all that counts
    here; wrist angles and interference of links are the business of ``free_volume``.

    Args:
        robot: A TLPM, or any mechanism with a method ``reach_spheres()``.
        branch: ``"upper"`` (z > -h) or ``"lower"``: mirror images in the base plane, so that the volumes are equal.

    Returns:
        Volume, error, areas of the faces. Inside ``jit`` a bad geometry, an empty interval of strokes or a length that
        is not positive gives the volume NaN.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: No mechanism of this kind, a batch of robots outside ``vmap``, or no such branch.
        GeometryError: The geometry is degenerate, an interval of strokes is empty, or a length is not positive.

    References:
        Fu and Gao: the workspace of their Fig. 3 is bounded by the strokes, as here; they print no volume.
    """
    _checked_branch("jk.workspace_volume", branch)
    _checked_robot("jk.workspace_volume", robot)
    return _volume(robot, branch)


def workspace_surfaces(robot: Mechanism, branch: str = "upper", n: int = 24) -> WorkspaceSurfaces:
    """Returns the boundary of what the strokes of one branch reach, as closed triangle meshes, one per face.

    The faces are parts of the spheres l_i = l_i_min and l_i = l_i_max; where the workspace reaches the singular plane
    z = -h, in which both branches meet, the part of it that they share is a face too. Edges are sampled once, and both
    patches use the same points.

    Args:
        robot: A TLPM, or any mechanism with a method ``reach_spheres()``.
        branch: ``"upper"`` (z > -h) or ``"lower"``.
        n: Segments of the longest edge, at least 2; the others have fewer, by their length. Made more where faces are
            so thin that their meshes would not meet.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``workspace_volume``; traced, or ``n`` is less than 2.
        GeometryError: As for ``workspace_volume``; or the strokes reach nothing.

    References:
        Fu and Gao, Fig. 3 (workspace of the strokes).
    """
    who = "jk.workspace_surfaces"
    sign = _checked_branch(who, branch)
    shells, plane = _checked_concrete(who, robot)
    if not isinstance(n, int) or n < 2:
        raise InputError(f"{who}: n is {n!r}: give the number of segments of the longest edge, at least 2.")
    volume = _volume(robot, branch)
    if not float(volume.volume) > 0:
        raise GeometryError(f"The strokes of {robot} reach nothing: lengthen them, or change the initial lengths.")
    result = None
    for doubling in range(_REFINEMENTS):
        patches = _workspace_mesh.patches(robot, volume, shells, plane, sign, n << doubling)
        result = WorkspaceSurfaces(
            patches=patches,
            branch=branch,
            volume=float(volume.volume),
            request={**identity(robot), "branch": branch, "n": n, "result": "workspace_surfaces"},
            pose_names=tuple(axis.name for axis in robot.pose_axes),
            units={axis.name: axis.unit for axis in robot.pose_axes},
        )
        if result.open_edges == 0:
            break
    assert result is not None
    return result


def free_volume(
    robot: Mechanism, branch: str = "upper", tolerance: float = 1e-3, *, seed: int = 0, most_columns: int = 1 << 17
) -> FreeVolume:
    """Returns the volume in which every margin of the robot is positive, in one branch of its workspace [ours].

    For the TLPM: what wrist limits and link distances leave of the workspace of the strokes, at the robot's own
    orientation and elbows. The margins are ``robot.margins(pose, joints)``. The paper prints conditions of this kind,
    and no volume; link sizes and the orientation are our completion. The test of link distances is sufficient only, so
    that this is the volume *proven* free.

    Vertical columns stand on randomly shifted lattices; in each column the strokes' interval is known exactly, samples
    find the intervals in which the smallest margin is positive, and their ends are polished. The free share of the
    columns' length times the exact ``workspace_volume`` is the result; the scatter between shifts is its sampling
    error. Lattice and samples get denser until the error is within the tolerance.

    Args:
        robot: A TLPM, or any mechanism with a method ``reach_spheres()`` and closed inverse kinematics.
        branch: ``"upper"`` (z > -h) or ``"lower"``.
        tolerance: Requested error, relative to the free volume.
        seed: Of the shifts.
        most_columns: Where refinement ends at the latest, counted with those that miss the workspace.

    Returns:
        The volume, with ``converged`` False where the tolerance was not reached; what the conditions remove, by name.
        Where the strokes reach nothing, volume, error and share are 0. Where every lattice misses a workspace that is
        too thin, the volume is 0 with the whole workspace as its error, and not converged.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``workspace_volume``; traced, a tolerance or number of columns that is not positive, or a
            seed that is no whole number.
        GeometryError: As for ``workspace_volume``.
    """
    who = "jk.free_volume"
    sign = _checked_branch(who, branch)
    shells, plane = _checked_concrete(who, robot)
    tolerance = checked_tolerance(who, tolerance, 1e-3, below=1.0)
    seed = checked_whole(who, "seed", seed, 0, 0)
    most_columns = checked_whole(who, "most_columns", most_columns, 1, 1 << 17)
    if robot.inverse_kernel is None:
        raise InputError(f"{who}: {type(robot).__name__} has no closed inverse kinematics: give it an inverse_kernel.")
    request = {
        **identity(robot),
        "branch": branch,
        "tolerance": tolerance,
        "seed": seed,
        "most_columns": most_columns,
        "result": "free_volume",
    }
    workspace, unit = float(_volume(robot, branch).volume), robot.pose_axes[0].unit
    if workspace == 0:
        return _workspace_columns.nothing(branch, unit, request)
    found = _workspace_columns.measured(robot, shells, plane, sign, tolerance, seed, most_columns)
    return found.record(workspace, tolerance, branch, unit, request)


@partial(jax.jit, static_argnames="branch")
def _volume(robot: Mechanism, branch: str) -> Volume:
    shells, _ = robot.reach_spheres()  # type: ignore[attr-defined]
    good = robot.geometry_ok() & jnp.all((shells.low > 0) & (shells.low < shells.high) & jnp.isfinite(shells.high))
    # Radii that are fit for the arithmetic, so that the derivatives of what is not used are finite.
    fit = Shells(
        jnp.where(good, shells.centres, jnp.array([[1.0, 0.0], [-0.5, 0.75], [-0.5, -0.75]])),
        jnp.where(good, shells.low, 1.0),
        jnp.where(good, shells.high, 2.0),
    )
    body = spheres.body(fit)

    def told(value: Array) -> Array:
        return jnp.where(good, value, jnp.nan)

    return Volume(
        volume=told(body.volume),
        error=told(jnp.abs(body.volume - body.coarse) + body.rounding),
        coarse=told(body.coarse),
        touches=good & body.touches,
        areas=told(body.areas),
        flat=told(body.flat),
        robot=robot,
        branch=branch,
    )


def _checked_branch(who: str, branch: str) -> float:
    if isinstance(branch, str) and branch in BRANCHES:
        return BRANCHES[branch]
    hint = meant(branch, BRANCHES)
    raise InputError(f"{who}: there is no branch {branch!r}: it is 'upper' (z > -h) or 'lower' (z < -h){hint}")


def _checked_concrete(who: str, robot: Mechanism) -> tuple[Shells, float]:
    """Returns the spheres and the plane of one concrete robot as NumPy arrays."""
    checked_single(who, robot)
    _checked_robot(who, robot)
    shells, plane = robot.reach_spheres()  # type: ignore[attr-defined]
    return jax.tree.map(np.asarray, shells), float(plane)


def _checked_robot(who: str, robot: Mechanism) -> None:
    checked_mechanism(who, robot)
    if not callable(getattr(robot, "reach_spheres", None)):
        raise InputError(
            f"{who}: a {type(robot).__name__} has no workspace of this kind, which is bounded by spheres about three "
            "points of a plane: the TLPM has (jk.mechanisms.tlpm.create()), and any mechanism with a method "
            "reach_spheres(). For another one map its margins with jk.sweep(robot, 'limit_margins', grid)."
        )
    if any(map(is_traced, jax.tree_util.tree_leaves(robot))):
        return
    if np.ndim(robot.characteristic_length()) != 0:
        raise InputError(f"{who} got a batch of robots: use jax.vmap({who}) over the robot.")
    if not bool(robot.geometry_ok()):
        raise GeometryError(f"The geometry of {robot} is degenerate: build it with its constructor, which says why.")
    shells, _ = robot.reach_spheres()  # type: ignore[attr-defined]
    _check_lengths(who, robot, np.asarray(shells.low), np.asarray(shells.high))


def _check_lengths(who: str, robot: Mechanism, low: np.ndarray, high: np.ndarray) -> None:
    for k, axis in enumerate(robot.joint_axes):
        where = f"{who}: limb {k + 1} is from {low[k]:g} to {high[k]:g} {axis.unit} long"
        if not np.isfinite(low[k]) or not np.isfinite(high[k]):
            raise GeometryError(f"{where}: give finite limits of {axis.name}.")
        if not low[k] < high[k]:
            raise GeometryError(f"{where}: that interval is empty; give limits of {axis.name} with low < high.")
        if not low[k] > 0:
            raise GeometryError(f"{where}: a length must stay positive; raise the lower limit of {axis.name}.")
