"""``jk.aspects``: the largest sets of poses that hold no singularity."""

from typing import Any

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.kinematics.legs import legs_of
from jaxkin.mapping._aspect_assembly import Charted, Piece, pieces, volumes
from jaxkin.mapping._aspect_box import WHO, Task, prepared
from jaxkin.mapping._aspect_coupled import coupled_aspects
from jaxkin.mapping._aspect_doubts import refine
from jaxkin.mapping._aspect_records import Aspect, Aspects, Slice
from jaxkin.mapping._aspect_sheets import Sheet, new_sheet
from jaxkin.sweep.grid import Grid

__all__ = ["Aspect", "Aspects", "Slice", "aspects"]


def aspects(
    robot: Mechanism, grid: Grid | None = None, *, limits: bool | str = True, clearance: float = 0.0
) -> Aspects:
    """Finds the aspects: connected components of the poses, with their joints, at which nothing is singular.

    An aspect is a component of {(x, q): F = 0, det A != 0, det B != 0, limits}, A = dF/dpose, B = dF/djoints, glued
    axes glued. Each working mode is a sheet of its own over the free pose axes. A sheet is cut into cells, and only
    cells are halved of which it is not proved that all walls (the factors of det A, reach of the legs, joint limits)
    keep their signs over them; face-adjacent proved cells of equal signs are connected. What is proved is so by second-
    order Taylor bounds, up to rounding; walls with kinks (interference and other margins, clearance) are only sampled,
    which ``evidence`` says.

    Args:
        robot: The mechanism. Where every equation holds one joint (``jaxkin.kinematics.legs``) working modes are
            signs, one a leg. Elsewhere a working mode is a numbered sheet of the inverse kinematics, found by
            continuation between the nodes of a uniform grid; nothing is proved then, and volumes are counts of nodes.
        grid: A grid over the pose axes: its numbers are the finest cells along each axis, which are made only where
            they are needed; a number fixes an axis. None takes the box that reach and limits leave.
        limits: True for all margins of the mechanism (joint limits, interference, passive joints), ``"joints"`` for
            the joints' own limits alone, False for none.
        clearance: Poses count only where the clearance (smallest singular value of -B^-1 A, scaled by the
            characteristic length) exceeds this.

    Returns:
        The aspects: ``.count``, and of each ``.volume``, ``.error``, ``.sign``, ``.working_mode``, ``.pose``; further
        ``.aspect_of(pose)``, ``.path(start, goal)``, ``.doubts`` and ``.evidence``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: An axis without bounds and no grid, a grid too coarse, or more than three free axes.
        GeometryError: The geometry is degenerate.

    The singularities are those of the chain that the constraints describe: the wrists of the TLPM, for instance, turn
    the platform by equations of their own, and are not in them. Volumes are in pose coordinates (of Euler angles too).
    Chart ends (theta = +-pi/2 of Euler angles) need no glue: gimbal locks have codimension two in the configuration
    space, and do not separate.

    References:
        Wenger, P. and Chablat, D., 1998, "Workspace and assembly modes in fully-parallel manipulators: a descriptive
        study" (generalised aspects).
    """
    checked_single(WHO, robot)
    if legs_of(robot) is None:
        return coupled_aspects(robot, grid, limits, clearance)
    task = prepared(robot, grid, limits, clearance)
    sheets = [new_sheet(task.walls, data, task.box, task.flips) for data in task.sheets]
    found: list[Piece] = []
    owners, errors = [], []
    for number, sheet in enumerate(sheets):
        owned = refine(sheet)
        owners.append(owned)
        proved, shared, cells, _, error = volumes(sheet, owned)
        errors.append(error)
        found += pieces(number, sheet, owned, task.open_ends, (proved, shared, cells))
    _refuse_coarse(task, sheets)
    found.sort(key=lambda piece: (piece.sheet, -piece.sign, -piece.volume))
    numbers = tuple(np.full(sheet.components.count, -1) for sheet in sheets)
    for k, piece in enumerate(found):
        numbers[piece.sheet][piece.component] = k
    fixed = np.array([value if isinstance(value, float) else 0.0 for value in task.grid.values()])
    charted = Charted(robot, task.walls.legs, task.modes, task.walls.free, fixed, tuple(sheets), tuple(owners), numbers)
    axes = robot.pose_axes
    return Aspects(
        aspects=_aspects(task, found, errors),
        doubts=_doubts(task, charted),
        evidence=_evidence(task, sheets),
        request={
            **identity(robot),
            "method": "aspects",
            "grid": task.grid,
            "limits": limits,
            "clearance": float(clearance),
        },
        pose_names=tuple(axis.name for axis in axes),
        joint_names=tuple(axis.name for axis in robot.joint_axes),
        units={axis.name: axis.unit for axis in (*axes, *robot.joint_axes)},
        free=tuple(axes[k].name for k in task.walls.free),
        _charted=charted,
    )


def _doubts(task: Task, charted: Charted) -> tuple[str, ...]:
    """Returns what could change the count, in sentences."""
    names = [charted.robot.pose_axes[k].name for k in charted.free]
    sentences = []
    for number, sheet in enumerate(charted.sheets):
        mode = "" if len(task.modes) == 1 else f" of the sheet {task.modes[number]}"
        for doubt in sheet.doubts:
            place = ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, doubt.point, strict=True))
            size = " x ".join(f"{value:.2g}" for value in doubt.width)
            if doubt.cells:
                both = sheet.components.of(sheet.tree, np.array(doubt.cells))
                a, b = sorted(charted.aspect_of_component(number, both).tolist())
                if a != b:
                    sentences.append(f"aspects [{a}] and [{b}] may be one, by a neck narrower than {size} near {place}")
            else:
                sentences.append(f"a piece{mode} smaller than {size} may have been missed near {place}")
        if len(sheet.counts) > 1 and sheet.counts[-1] != sheet.counts[-2]:
            sentences.append(f"the count{mode} changed with the last level: use a finer grid")
    return tuple(sentences)


def _refuse_coarse(task: Task, sheets: list[Sheet]) -> None:
    if all(sheet.components.count == 0 for sheet in sheets) and any(sheet.undecided[-1] for sheet in sheets):
        counts = ", ".join(f"{name}: {value[2]}" for name, value in task.grid.items() if isinstance(value, list))
        raise InputError(
            f"{WHO}: no cell of the grid ({counts}) is proved regular: it is too coarse to say anything; give more "
            "cells along each axis, or a smaller box."
        )


def _aspects(task: Task, found: list[Piece], errors: list[float]) -> tuple[Aspect, ...]:
    # Errors are where cells are shared; where none is, each piece has its part by volume.
    shared = [sum(piece.shared for piece in found if piece.sheet == k) for k in range(len(errors))]
    whole = [sum(piece.volume for piece in found if piece.sheet == k) for k in range(len(errors))]
    result: list[Aspect] = []
    for k, piece in enumerate(found):
        mode = task.modes[piece.sheet]
        same = [j for j, p in enumerate(found) if (p.sheet, p.sign) == (piece.sheet, piece.sign)]
        name = f"det {'>' if piece.sign > 0 else '<'} 0"
        if len(task.modes) > 1:
            name = f"({', '.join('+' if s > 0 else '-' for s in mode)}) {name}"
        if len(same) > 1:
            name += f" #{same.index(k) + 1}"
        of, all_of = (piece.shared, shared) if shared[piece.sheet] > 0 else (piece.volume, whole)
        part = of / all_of[piece.sheet] if all_of[piece.sheet] > 0 else 0.0
        result.append(
            Aspect(
                name=name,
                sign=piece.sign,
                working_mode=mode,
                volume=piece.volume,
                error=errors[piece.sheet] * part,
                proved=piece.proved,
                pose=piece.pose,
                joints=piece.joints,
                clearance=piece.clearance,
                touches_edge=piece.touches_edge,
                cells=piece.cells,
            )
        )
    return tuple(result)


def _evidence(task: Task, sheets: list[Sheet]) -> dict[str, Any]:
    levels = max(len(sheet.tested) for sheet in sheets)

    def total(name: str) -> list[int]:
        return [
            sum((getattr(sheet, name)[k] if k < len(getattr(sheet, name)) else 0) for sheet in sheets)
            for k in range(levels)
        ]

    counts = [
        sum(sheet.counts[min(k, len(sheet.counts) - 1)] for sheet in sheets)
        for k in range(max(len(s.counts) for s in sheets))
    ]
    evidence: dict[str, Any] = {
        "walls": list(task.walls.names),
        "regularity of cells": "sampled" if task.walls.n_sampled else "proved by Taylor bounds, up to rounding",
        "cells tested, by level": total("tested"),
        "cells undecided, by level": total("undecided"),
        "count on the last levels": counts,
        "stable": len(set(counts[-2:])) == 1,
        "components joined by sampled lines": sum(sheet.joined for sheet in sheets),
        "components joined along inner walls": sum(sheet.walked for sheet in sheets),
        "critical points of a wall between components": {
            name: sum(sheet.saddles[name] for sheet in sheets) for name in ("connect", "separate", "crossing")
        },
        "width of the finest cells": task.box.width(task.box.levels).tolist(),
    }
    if task.unused:
        evidence["walls do not depend on"] = list(task.unused)
    return evidence
