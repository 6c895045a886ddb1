"""Aspects of mechanisms whose equations hold several joints: sampled at nodes, linked by continuation."""

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_vector
from jaxkin.mapping._aspect_box import WHO, check_arguments
from jaxkin.mapping._aspect_links import SMALL, Linked, linked, route_between
from jaxkin.mapping._aspect_nodes import Lattice, Problem, Rule, follow
from jaxkin.mapping._aspect_records import Aspect, Aspects
from jaxkin.numerics.gluing import short_way
from jaxkin.sweep.grid import Grid, Span

#: Most nodes of a lattice, fewest along an axis, and free axes.
_MOST, _FEWEST, _AXES = 2**16, 16, 3


@dataclass(frozen=True, eq=False)
class NodeChart:
    """The nodes with the aspects they belong to, in place of the cells of other mechanisms.

    Attributes:
        found: Solutions at the nodes, and their links.
        aspect: ``(n,)`` aspect of each solution, -1 where there is none.
        sheet: ``(n,)`` place of its working mode in ``modes``, -1 where no aspect has it.
        modes: ``(number,)`` of each sheet that holds an aspect.
    """

    found: Linked
    aspect: np.ndarray
    sheet: np.ndarray
    modes: tuple[tuple[int, ...], ...]

    def cut(self, places: dict[int, float], keep: list[int]) -> tuple[np.ndarray, ...]:
        """Returns low and high corners, aspects and sheets of the nodes' cells that a plane cuts."""
        lattice, nodes = self.found.solutions.lattice, self.found.solutions.nodes
        middle = lattice.points(nodes)
        use = self.sheet >= 0
        for axis, value in places.items():
            at = 0.5 * (lattice.low + lattice.high)
            at[axis] = value
            node = lattice.nearest(at[None])
            use &= (node[0] >= 0) & (lattice.index(nodes)[:, axis] == lattice.index(np.maximum(node, 0))[0, axis])
        low, high = middle[use] - 0.5 * lattice.width, middle[use] + 0.5 * lattice.width
        return low[:, keep], high[:, keep], self.aspect[use], self.sheet[use]

    def anchor(self, pose: np.ndarray, joints: np.ndarray) -> int:
        """Returns a solution at a node near a configuration to which a straight line leads; -1 for none."""
        solutions = self.found.solutions
        lattice, problem = solutions.lattice, solutions.problem
        point = pose[list(lattice.free)]
        home = lattice.nearest(point[None])
        if home[0] < 0:
            return -1
        around = np.array(list(itertools.product((0, 1, -1), repeat=len(point))))
        nodes = lattice.shifted(np.repeat(home, len(around)), around)
        nodes = nodes[nodes >= 0]
        period = np.where(lattice.glued, lattice.high - lattice.low, np.inf)
        moves = np.zeros((len(nodes), len(pose)))
        moves[:, list(lattice.free)] = short_way(lattice.points(nodes) - point, period)
        there = follow(problem, np.tile(pose, (len(nodes), 1)), np.tile(joints, (len(nodes), 1)), moves)
        numbers = np.where(there.aspect, solutions.match(nodes, there.joints), -1)
        back = follow(problem, pose + moves, solutions.joints[numbers], -moves)
        gap = np.max(np.abs(short_way(back.joints - joints, problem.period)) / problem.unit, axis=1)
        good = np.flatnonzero((numbers >= 0) & back.aspect & (gap < 1e-6))
        nearest = good[np.argsort(np.linalg.norm(moves[good], axis=1), kind="stable")]
        return int(numbers[nearest[0]]) if len(nearest) else -1

    def only_joints(self, pose: np.ndarray) -> np.ndarray | None:
        """Returns the joints of a pose where there is one sheet; None where none is reached from a node."""
        solutions = self.found.solutions
        lattice = solutions.lattice
        point = pose[list(lattice.free)]
        home = lattice.nearest(point[None])
        own = np.flatnonzero((solutions.nodes == home[0]) & (self.aspect >= 0))
        if len(own) == 0:
            return None
        ends = np.tile(pose, (len(own), 1))
        found = follow(solutions.problem, solutions.poses[own], solutions.joints[own], ends - solutions.poses[own])
        good = np.flatnonzero(found.sheet)
        return solutions.problem.wrapped(found.joints[good[0]]) if len(good) else None


@dataclass(frozen=True, eq=False)
class CoupledAspects(Aspects):
    """Aspects of a mechanism whose working modes are numbered sheets; everything is sampled, nothing proved.

    Attributes are those of ``Aspects``; of each aspect ``working_mode`` is ``(number,)``, ``cells`` its nodes, and
    ``proved`` zero.
    """

    _charted: NodeChart = field(repr=False)  # type: ignore[assignment]  # pyright: ignore[reportIncompatibleVariableOverride]

    def aspect_of(self, pose: ArrayLike, joints: ArrayLike | None = None) -> int:
        """Returns the number of the aspect that holds a configuration; -1 outside all, or where none is reached.

        Args:
            pose: ``(n_pose,)``; fixed axes at their values.
            joints: ``(n_joint,)``; not needed where there is only one sheet.

        Raises:
            InputError: Not so many numbers, fixed axes elsewhere, joints that do not belong to the pose, or none
                although there are several sheets.
        """
        number = self._anchored(pose, joints)[1]
        return int(self._charted.aspect[number]) if number >= 0 else -1

    def path(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        start_joints: ArrayLike | None = None,
        goal_joints: ArrayLike | None = None,
    ) -> np.ndarray | None:
        """Returns poses from one to another without a singularity between them, or None where there is no such path.

        From node to node by lines that continuation followed both ways; between its steps nothing is proved.

        Args:
            start: ``(n_pose,)``.
            goal: ``(n_pose,)``; a glued angle ends a whole number of turns from it.
            start_joints: Joints of the start, where there are several sheets.
            goal_joints: Joints of the goal.

        Returns:
            ``(k, n_pose)``, or None where the two are not in one aspect.

        Raises:
            InputError: As for ``aspect_of``.
        """
        (first, a), (last, b) = self._anchored(start, start_joints), self._anchored(goal, goal_joints)
        chart, solutions = self._charted, self._charted.found.solutions
        if a < 0 or b < 0 or chart.aspect[a] < 0 or chart.aspect[a] != chart.aspect[b]:
            return None
        lattice, free = solutions.lattice, list(solutions.lattice.free)
        route = route_between(chart.found.graph(), a, b)
        points = [first[free][None], lattice.points(solutions.nodes[route[:1]])]
        for k, number in enumerate(route[1:]):
            points += [chart.found.between(int(route[k]), int(number)), lattice.points(solutions.nodes[[number]])]
        poses = lattice.poses(np.concatenate([*points, last[free][None]]))
        period = np.where(lattice.glued, lattice.high - lattice.low, np.inf)
        steps = short_way(np.diff(poses[:, free], axis=0), period)
        poses[1:, free] = poses[0, free] + np.cumsum(steps, axis=0)
        return poses

    def _anchored(self, pose: ArrayLike, joints: ArrayLike | None) -> tuple[np.ndarray, int]:
        """Returns a pose, and the number of a solution near it in the same aspect; -1 where there is none."""
        chart, solutions = self._charted, self._charted.found.solutions
        problem, lattice = solutions.problem, solutions.lattice
        given = np.asarray(checked_vector("Aspects", "the pose", pose, problem.robot.pose_axes))
        for k, name in enumerate(self.pose_names):
            if name not in self.free and abs(given[k] - lattice.fixed[k]) > 1e-9 * (1 + abs(given[k])):
                raise InputError(
                    f"Aspects: {name} is {given[k]:g}, but these aspects are of poses with {name} = "
                    f"{lattice.fixed[k]:g}: ask for such a pose, or make aspects with {name} free."
                )
        if joints is None:
            if len(chart.modes) > 1:
                raise InputError(
                    f"Aspects: the pose alone leaves {len(chart.modes)} sheets open: give its joints as well."
                )
            own = chart.only_joints(given)
            return given, -1 if own is None else chart.anchor(given, own)
        own = problem.wrapped(np.asarray(checked_vector("Aspects", "the joints", joints, problem.robot.joint_axes)))
        scale = np.asarray(problem.robot.constraint_scales(jnp.asarray(given), jnp.asarray(own)))
        residual = float(
            np.max(np.abs(np.asarray(problem.robot.constraints(jnp.asarray(given), jnp.asarray(own))) / scale))
        )
        if residual > 1e-6:
            raise InputError(
                f"Aspects: the joints do not belong to the pose, the constraints miss by {residual:.2g} of their "
                "scales: take them from jk.inverse."
            )
        return given, chart.anchor(given, own)


def coupled_aspects(robot: Mechanism, grid: Grid | None, limits: bool | str, clearance: float) -> CoupledAspects:
    """Finds aspects of a mechanism with coupled equations, as ``jk.aspects`` describes; arguments and errors are its.

    At the centres of the cells of a uniform grid, 65536 at most, all inverse solutions are sought: by search at some
    nodes, by Newton continuation from there to all others, checked by search at random ones. Solutions of
    neighbouring nodes are linked where continuation leads from either to the other and det A, det B, limits and
    clearance hold at its steps. Aspects are the components; sheets, the working modes, those where only det B counts.
    """
    check_arguments(robot, limits, clearance)
    problem = Problem(robot, Rule(limits, clearance > 0), float(clearance))
    lattice, open_ends, wanted = _lattice(robot, grid)
    half = replace(lattice, shape=tuple(max(2, count // 2) for count in lattice.shape))
    coarse = linked(problem, half)
    found = linked(problem, lattice, coarse)
    chart, order = _charted(found)
    axes = robot.pose_axes
    content: dict[str, Any] = {axis.name: float(lattice.fixed[k]) for k, axis in enumerate(axes)}
    for k, *span in zip(lattice.free, lattice.low.tolist(), lattice.high.tolist(), wanted, strict=True):
        content[axes[k].name] = span
    records = _aspects(chart, order, open_ends)
    return CoupledAspects(
        aspects=records,
        doubts=_doubts(chart, records, coarse, wanted),
        evidence=_evidence(chart, coarse),
        request={
            **identity(robot),
            "method": "aspects",
            "grid": content,
            "limits": limits,
            "clearance": float(clearance),
        },
        pose_names=tuple(axis.name for axis in axes),
        joint_names=tuple(axis.name for axis in robot.joint_axes),
        units={axis.name: axis.unit for axis in (*axes, *robot.joint_axes)},
        free=tuple(axes[k].name for k in lattice.free),
        _charted=chart,
    )


def _lattice(robot: Mechanism, grid: Grid | None) -> tuple[Lattice, np.ndarray, tuple[int, ...]]:
    """Returns the nodes, which ends of the box are open ``(d, 2)``, and how many cells the grid asked for."""
    axes = robot.pose_axes
    if grid is None:
        open_axes = [axis.name for axis in axes if not (math.isfinite(axis.low) and math.isfinite(axis.high))]
        if open_axes or len(axes) > _AXES:
            raise InputError(
                f"{WHO}: nothing bounds the pose axis {(open_axes or [axes[-1].name])[0]!r} of {robot}, whose "
                "equations hold several joints, so that no box follows from reach and limits: pass a grid with its "
                "range or its value."
            )
        count = round(0.25 * _MOST ** (1 / len(axes))) * 2
        grid = Grid(**{axis.name: (axis.low, axis.high, count) for axis in axes})
    if not isinstance(grid, Grid):
        raise InputError(f"{WHO} got {grid!r} as its grid: pass a jaxkin.Grid over the pose axes, or None.")
    bound = grid.bind(axes, "pose")
    if len(bound.free) > _AXES:
        raise InputError(f"{WHO}: the grid has {len(bound.free)} free axes: fix all but three of them.")
    low, high, counts, glued, ends = [], [], [], [], []
    for axis, span in [(axes[k], bound.values[k]) for k in bound.free]:
        assert isinstance(span, Span)
        _check_span(axis.name, span, axis.period)
        low.append(span.low if axis.period is not None else max(span.low, axis.low))
        high.append(span.high if axis.period is not None else min(span.high, axis.high))
        counts.append(span.count)
        glued.append(axis.period is not None and abs(span.high - span.low - axis.period) <= 1e-9 * axis.period)
        ends.append([not glued[-1] and low[-1] > axis.low, not glued[-1] and high[-1] < axis.high])
    share = min(1.0, (_MOST / math.prod(counts)) ** (1 / len(counts)))
    shape = tuple(max(_FEWEST, int(count * share)) for count in counts)
    fixed = np.array([0.0 if isinstance(value, Span) else value for value in bound.values])
    lattice = Lattice(tuple(bound.free), fixed, np.array(low), np.array(high), shape, np.array(glued))
    return lattice, np.array(ends), tuple(counts)


def _check_span(name: str, span: Span, period: float | None) -> None:
    if period is not None and span.high - span.low > period * (1 + 1e-12):
        raise InputError(
            f"{WHO}: {name} goes from {span.low:g} to {span.high:g}, more than its period {period:g}: give one period "
            "at most."
        )
    if span.count < _FEWEST:
        raise InputError(
            f"{WHO}: the grid has {span.count} cells along {name}, too few to say anything: give at least {_FEWEST}."
        )


def _charted(found: Linked) -> tuple[NodeChart, np.ndarray]:
    """Returns the aspects in order: by sheet, positive determinants first, largest first; and their first solutions."""
    solutions, use = found.solutions, found.aspect >= 0
    _, first, size = np.unique(found.aspect[use], return_index=True, return_counts=True)
    first = np.flatnonzero(use)[first]
    held = np.unique(found.sheet[first])
    # Sheets in the order of their first nodes, and of joints where two have the same.
    ranked = np.lexsort((*solutions.joints.T[::-1], solutions.nodes))
    places = {int(sheet): k for k, sheet in reversed(list(enumerate(found.sheet[ranked])))}
    held = np.array(sorted(held.tolist(), key=places.__getitem__), int)
    sheet = np.full(len(solutions), -1)
    for k, label in enumerate(held):
        sheet[found.sheet == label] = k
    order = np.lexsort((-size, -np.sign(found.numbers.determinant[first]), sheet[first]))
    number = np.append(np.argsort(order), -1)
    modes = tuple((k + 1,) for k in range(len(held)))
    return NodeChart(found, number[found.aspect], sheet, modes), first[order]


def _aspects(chart: NodeChart, first: np.ndarray, open_ends: np.ndarray) -> tuple[Aspect, ...]:
    solutions, numbers = chart.found.solutions, chart.found.numbers
    lattice = solutions.lattice
    signs = np.sign(numbers.determinant[first]).astype(int)
    heads = [(int(chart.sheet[k]), int(sign)) for k, sign in zip(first, signs, strict=True)]
    result: list[Aspect] = []
    for k, (sheet, sign) in enumerate(heads):
        own = np.flatnonzero(chart.aspect == k)
        rows = lattice.index(solutions.nodes[own])
        name = f"det {'>' if sign > 0 else '<'} 0"
        if len(chart.modes) > 1:
            name = f"sheet {sheet + 1} {name}"
        if heads.count((sheet, sign)) > 1:
            name += f" #{heads[:k].count((sheet, sign)) + 1}"
        deepest = own[np.argmax(np.where(np.isfinite(numbers.clearance[own]), numbers.clearance[own], -1))]
        ends = np.stack([rows == 0, rows == np.array(lattice.shape) - 1], axis=-1)
        result.append(
            Aspect(
                name=name,
                sign=sign,
                working_mode=chart.modes[sheet],
                volume=float(len(own) * np.prod(lattice.width)),
                error=_volume_error(lattice, rows),
                proved=0.0,
                pose=solutions.poses[deepest],
                joints=solutions.joints[deepest],
                clearance=float(numbers.clearance[deepest]),
                touches_edge=bool(np.any(ends & open_ends)),
                cells=len(own),
            )
        )
    return tuple(result)


def _volume_error(lattice: Lattice, rows: np.ndarray) -> float:
    """Returns the spread of the volumes by every second node along each axis, all 2^d choices of these."""
    d = rows.shape[1]
    counts = np.bincount((rows % 2) @ 2 ** np.arange(d), minlength=2**d)
    share = np.array([np.prod([(n + 1 - p) // 2 / n for n, p in zip(lattice.shape, parity, strict=True)])
                      for parity in (np.arange(2**d)[:, None] >> np.arange(d)) % 2])  # fmt: skip
    spread = float(np.sqrt(np.mean((counts / share - len(rows)) ** 2)))
    return max(spread, 1.0) * float(np.prod(lattice.width))


def _doubts(chart: NodeChart, records: tuple[Aspect, ...], coarse: Linked, wanted: tuple[int, ...]) -> tuple[str, ...]:
    """Returns what could change the count, in sentences."""
    found = chart.found
    lattice, robot = found.solutions.lattice, found.solutions.problem.robot
    size = " x ".join(f"{value:.2g}" for value in lattice.width)
    names = [robot.pose_axes[k].name for k in lattice.free]

    def place(pose: np.ndarray) -> str:
        return ", ".join(f"{name} = {pose[k]:.6g}" for name, k in zip(names, lattice.free, strict=True))

    doubts = [f"everything is sampled at nodes {size} apart: smaller pieces and narrower necks may have been missed"]
    if lattice.shape != wanted:
        doubts.append(
            f"the grid asks for {' x '.join(map(str, wanted))} nodes, of which {' x '.join(map(str, lattice.shape))} "
            "were made, the most for coupled equations: choose a smaller box for more"
        )
    for k, aspect in enumerate(records):
        if aspect.cells < SMALL:
            doubts.append(
                f"aspect [{k}] has {aspect.cells} nodes only, near {place(aspect.pose)}: it may be part of another"
            )
    pairs = found.links.mutual("signs")
    ends = chart.aspect[pairs]
    for a, b in np.unique(np.sort(ends[:, (ends[0] != ends[1]) & np.all(ends >= 0, axis=0)], axis=0), axis=1).T:
        where = pairs[0][np.flatnonzero(np.all(np.sort(ends, axis=0) == [[a], [b]], axis=0))[0]]
        doubts.append(
            f"aspects [{a}] and [{b}] may be one: a line between their nodes near "
            f"{place(found.solutions.poses[where])} meets no other sign, but comes near a singularity"
        )
    if found.missed:
        doubts.append(
            f"a search at {found.checked} nodes found {found.missed} solutions that continuation had not reached: "
            "other small sheets may have been missed"
        )
    if found.solutions.table.shape[1] > robot.max_branches:
        doubts.append(
            f"some poses have more than {robot.max_branches} solutions, the max_branches that a search keeps: raise it"
        )
    counts = [len(np.unique(part.aspect[part.aspect >= 0])) for part in (coarse, found)]
    if counts[0] != counts[1]:
        doubts.append(f"the count is {counts[0]} with half as many nodes along each axis: use a finer grid")
    return tuple(doubts)


def _evidence(chart: NodeChart, coarse: Linked) -> dict[str, Any]:
    found = chart.found
    counts = [len(np.unique(part.aspect[part.aspect >= 0])) for part in (coarse, found)]
    links = found.links.mutual("aspect")
    degree = np.bincount(links[0], minlength=len(chart.aspect))
    full = 2 * len(found.solutions.lattice.shape)
    return {
        "method": "sampled at nodes, linked by continuation both ways; nothing is proved",
        "nodes": list(found.solutions.lattice.shape),
        "sheets": len(chart.modes),
        "solutions": len(found.solutions),
        "solutions beside a wall": int(np.sum((chart.aspect >= 0) & (degree < full))),
        "check nodes": found.checked,
        "solutions missed by continuation": found.missed,
        "count on the last levels": counts,
        "stable": counts[0] == counts[1],
        "width of the finest cells": found.solutions.lattice.width.tolist(),
    }
