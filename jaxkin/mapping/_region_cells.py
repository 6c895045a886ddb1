"""Regions of a box of the joint space: the regions of its slices, joined, and their areas integrated."""

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from jax.typing import ArrayLike
from scipy.spatial import KDTree

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.mapping._arrangement import Unions
from jaxkin.mapping._region_counts import counted, tried
from jaxkin.mapping._region_records import Regions, letters
from jaxkin.mapping.named import NamedParts
from jaxkin.mapping.records import coordinates
from jaxkin.sweep.grid import BoundGrid, Grid, Span

#: Ways that are tried from a region to one of the next slice, and points of each at which solutions are counted.
_FOLLOWED, _BETWEEN = 8, 25
#: A slice at a length of zero has no smooth points: the first one is this share of the mechanism's size beside it.
_BESIDE = 0.004


@dataclass(frozen=True, eq=False)
class Cell:
    """A connected part of a box in which the number of solutions is constant.

    Attributes:
        name: The number of solutions and a letter, in order of size.
        n_solutions: How many assembly modes its points have.
        volume: In the product of the units of the three free joints.
        error: Estimated error of the volume: what halving the steps between slices changes, and the areas' own errors.
        interior: ``(n_joint,)`` a point well inside, on the slice in which the cell is largest.
        neighbours: Numbers of the cells beyond its boundary, as far as slices show them.
        slices: Pairs (slice, region of the slice).
    """

    name: str
    n_solutions: int
    volume: float
    error: float
    interior: np.ndarray
    neighbours: tuple[int, ...]
    slices: tuple[tuple[int, int], ...]


@dataclass(frozen=True, eq=False)
class Cells(NamedParts[Cell]):
    """The division of a box of the joint space by the number of solutions.

    Attributes:
        cells: The cells, largest first.
        axis: Name of the joint that is constant on each slice.
        values: ``(s,)`` its values, ascending.
        slices: The regions of each slice.
        request: What determines the numbers.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for it all, and what is in doubt, by name.
    """

    kind: ClassVar[str] = "cells"

    cells: tuple[Cell, ...]
    axis: str
    values: np.ndarray
    slices: tuple[Regions, ...]
    request: dict[str, Any]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any]
    _robot: Mechanism = field(repr=False)
    _labels: list[np.ndarray] = field(repr=False)

    @property
    def parts(self) -> tuple[Cell, ...]:
        """The cells."""
        return self.cells

    @property
    def complete(self) -> bool:
        """False where something disagrees: see ``evidence``. True is no proof."""
        return not any(self.evidence[name] for name in ("slices in doubt", "cells on one slice only"))

    @property
    def volume(self) -> float:
        """Volume of the box."""
        return math.fsum(cell.volume for cell in self.cells)

    def volumes_by_number(self) -> dict[int, float]:
        """Returns the volume of all cells with each number of solutions, by ascending number."""
        numbers = sorted({cell.n_solutions for cell in self.cells})
        return {n: math.fsum(c.volume for c in self.cells if c.n_solutions == n) for n in numbers}

    def region_of(self, joints: ArrayLike) -> int:
        """Returns the number of the cell that holds a joint point, ``(n_joint,)``.

        The point is followed to the slices beside it while its number of solutions stays the same. -1 outside the box,
        and where no slice decides it.

        Raises:
            InputError: Not ``n_joint`` numbers.
        """
        point = np.asarray(joints, float)
        if point.shape != (len(self.joint_names),) or not np.all(np.isfinite(point)):
            raise InputError(
                f"Cells.region_of: joints has shape {point.shape}; it must be ({len(self.joint_names)},), finite "
                f"numbers in the order {', '.join(self.joint_names)}."
            )
        k = self.joint_names.index(self.axis)
        after = int(np.searchsorted(self.values, point[k]))
        low, high, _ = self.request["box"][self.axis]
        for slab in [s for s in (after - 1, after) if 0 <= s < len(self.values) and low <= point[k] <= high]:
            there = point.copy()
            there[k] = self.values[slab]
            region = self.slices[slab].region_of(there)
            way = np.linspace(point, there, _BETWEEN)
            found = counted(self._robot, way)
            if region >= 0 and np.all(found.number == self.slices[slab][region].n_solutions):
                return int(self._labels[slab][region])
        return -1

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [f"{len(self)} cells in {len(self.slices)} slices of constant {self.axis}"]
        for k, cell in enumerate(self.cells):
            beside = ", ".join(self.cells[n].name for n in cell.neighbours) or "none"
            size = f"{cell.n_solutions} solutions, volume {cell.volume:.9g} (error {cell.error:.0e})"
            holds = coordinates(self.joint_names, cell.interior)
            lines.append(f"  [{k}] {cell.name}: {size}, beside {beside}, holds {holds}")
        lines += [f"  {name}: {value}" for name, value in self.evidence.items()]
        if not self.complete:
            lines.append("  DOUBTFUL: see what is not zero above; try more slices")
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns the cells as JSON text; their slices by value and region."""
        cells = [
            {
                "name": c.name,
                "n_solutions": c.n_solutions,
                "volume": c.volume,
                "error": c.error,
                "interior": c.interior.tolist(),
                "neighbours": list(c.neighbours),
                "slices": [list(pair) for pair in c.slices],
            }
            for c in self.cells
        ]
        content = {
            "request": self.request,
            "joint_axes": list(self.joint_names),
            "units": self.units,
            "axis": self.axis,
            "values": self.values.tolist(),
            "cells": cells,
            "complete": self.complete,
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


@dataclass(frozen=True)
class Slicing:
    """How a box is cut into slices.

    Attributes:
        bound: The box.
        axis: Position of the joint that is constant on each slice: the one with the fewest samples.
        low: Where slices begin.
        high: Where they end.
        beside: Width of the strip before the first slice, where that would be at a length of zero.
        most: Number of slices.
    """

    bound: BoundGrid
    axis: int
    low: float
    high: float
    beside: float
    most: int

    @classmethod
    def of(cls, who: str, robot: Mechanism, bound: BoundGrid) -> "Slicing":
        """Chooses the axis, and cuts its range by the joint's limits.

        Raises:
            InputError: Its range lies outside the limits.
        """
        count, minus = min((value.count, -k) for k, value in enumerate(bound.values) if isinstance(value, Span))
        axis, span, limits = robot.joint_axes[-minus], bound.values[-minus], robot.limit_values()
        assert isinstance(span, Span)
        low, high = (
            max(span.low, axis.low, float(limits.low[-minus])),
            min(span.high, axis.high, float(limits.high[-minus])),
        )
        if not low < high:
            raise InputError(
                f"{who}: {axis.name} goes from {span.low:g} to {span.high:g}, outside its limits "
                f"{float(limits.low[-minus]):g} to {float(limits.high[-minus]):g}: move the range into them, or widen "
                "robot.limits."
            )
        least = _BESIDE * float(robot.characteristic_length())
        beside = least - low if axis.low == 0.0 and not axis.is_angle and low < least else 0.0
        return cls(bound, -minus, low + beside, high, beside, max(count, 5))

    def grid(self, value: float) -> Grid:
        """Returns the section of one slice."""
        content = self.bound.content()
        content[self.bound.axes[self.axis].name] = value
        return Grid(**{name: tuple(v) if isinstance(v, list) else v for name, v in content.items()})


class Slices:
    """Slices between which areas are integrated by Simpson's rule, with smaller steps where it errs most.

    Attributes:
        places: Where slices are, ascending shares of the range.
        panels: Pairs of shares: where panels begin and end.
    """

    def __init__(self, slicing: Slicing, solve: Callable[[float], Regions]):
        self._slicing, self._solve = slicing, solve
        self._found: dict[Fraction, Regions] = {}
        half = Fraction(1, 2)
        self.panels = [(Fraction(0), half), (half, Fraction(1))] if slicing.most >= 9 else [(Fraction(0), Fraction(1))]
        for panel in self.panels:
            self._need(panel)
        while len(self._found) + 4 <= slicing.most:
            worst = max(self.panels, key=self._error)
            self.panels.remove(worst)
            middle = (worst[0] + worst[1]) / 2
            for part in ((worst[0], middle), (middle, worst[1])):
                self._need(part)
                self.panels.append(part)
        self.panels.sort()
        self.places = sorted(self._found)

    def value(self, place: Fraction) -> float:
        """Returns the joint's value at a share of the range."""
        return self._slicing.low + float(place) * (self._slicing.high - self._slicing.low)

    def __getitem__(self, place: Fraction) -> Regions:
        """Returns the regions of one slice."""
        return self._found[place]

    def _need(self, panel: tuple[Fraction, Fraction]) -> None:
        for place in inner_places(panel):
            if place not in self._found:
                self._found[place] = self._solve(self.value(place))

    def _error(self, panel: tuple[Fraction, Fraction]) -> float:
        """How much two orders differ on a panel, in the areas by number of solutions."""
        areas = [self._found[place].areas_by_number() for place in inner_places(panel)]
        numbers = sorted({n for some in areas for n in some})
        table = np.array([[some.get(n, 0.0) for n in numbers] for some in areas])
        return float(panel[1] - panel[0]) * float(np.sum(np.abs((_FINE - _COARSE) @ table)))


#: Weights of Simpson's rule with steps of a quarter and of a half of a panel.
_FINE = np.array([1.0, 4.0, 2.0, 4.0, 1.0]) / 12
_COARSE = np.array([1.0, 0.0, 4.0, 0.0, 1.0]) / 6


def inner_places(panel: tuple[Fraction, Fraction]) -> list[Fraction]:
    """Returns the five places of a panel's slices."""
    return [panel[0] + (panel[1] - panel[0]) * k / 4 for k in range(5)]


def box_cells(robot: Mechanism, slicing: Slicing, solve: Callable[[float], Regions], request: dict[str, Any]) -> Cells:
    """Divides a box: slices it, joins the slices' regions, and integrates their areas."""
    slices = Slices(slicing, solve)
    found = [slices[place] for place in slices.places]
    values = np.array([slices.value(place) for place in slices.places])
    labels, lonely = _joined(robot, slicing.axis, values, found)
    count = 1 + max(int(own.max()) for own in labels)
    volume, error = _volumes(slicing, slices, found, labels, count)
    rank = np.argsort(-volume, kind="stable")
    place = np.empty(count, int)
    place[rank] = np.arange(count)
    labels = [place[own] for own in labels]
    members: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for k, own in enumerate(labels):
        for region, label in enumerate(own):
            members[label].append((k, region))
    names = letters([found[own[0][0]][own[0][1]].n_solutions for own in members])
    cells = tuple(
        _cell(names[k], float(volume[rank[k]]), float(error[rank[k]]), members[k], found, labels) for k in range(count)
    )
    joints = robot.joint_axes
    return Cells(
        cells=cells,
        axis=joints[slicing.axis].name,
        values=values,
        slices=tuple(found),
        request=request,
        joint_names=tuple(axis.name for axis in joints),
        units={axis.name: axis.unit for axis in joints},
        evidence={
            "slices in doubt": sum(not one.complete for one in found),
            "cells on one slice only": sum(len({k for k, _ in own}) == 1 for own in members) if len(found) > 1 else 0,
            "regions of slices that go on in no neighbouring one": lonely,
        },
        _robot=robot,
        _labels=labels,
    )


def _cell(
    name: str,
    volume: float,
    error: float,
    members: list[tuple[int, int]],
    found: list[Regions],
    labels: list[np.ndarray],
) -> Cell:
    best = max(members, key=lambda pair: found[pair[0]][pair[1]].area)
    beside = {int(labels[k][other]) for k, region in members for other, _ in found[k][region].neighbours}
    largest = found[best[0]][best[1]]
    own = int(labels[best[0]][best[1]])
    return Cell(
        name=name,
        n_solutions=largest.n_solutions,
        volume=volume,
        error=error,
        interior=largest.interior,
        neighbours=tuple(sorted(beside - {own})),
        slices=tuple(members),
    )


def _joined(robot: Mechanism, axis: int, values: np.ndarray, found: list[Regions]) -> tuple[list[np.ndarray], int]:
    """Joins regions of neighbouring slices; returns their cells' numbers, and how many regions are joined to none.

    A straight way from a point of one to a point of the other joins them if its number of solutions stays the same.
    """
    first = [0, *itertools.accumulate(map(len, found))]
    unions, touched = Unions(first[-1]), np.zeros(first[-1], bool)
    probes = [tried(one._divided) for one in found]
    ways, pairs = [], []
    for k, (one, other) in enumerate(itertools.pairwise(found)):
        labels = [one._numbers[probes[k][0]], other._numbers[probes[k + 1][0]]]
        for a, b in itertools.product(range(len(one)), range(len(other))):
            if one[a].n_solutions == other[b].n_solutions:
                starts, ends = probes[k][1][labels[0] == a], probes[k + 1][1][labels[1] == b]
                for start, end in zip(*_closest(starts, ends), strict=True):
                    way = one.plane.joints(np.linspace(start, end, _BETWEEN))
                    way[:, axis] = np.linspace(values[k], values[k + 1], _BETWEEN)
                    ways.append(way)
                    pairs.append((first[k] + a, first[k + 1] + b, one[a].n_solutions))
    if ways:
        numbers = counted(robot, np.concatenate(ways)).number.reshape(len(ways), _BETWEEN)
        for (a, b, number), along in zip(pairs, numbers, strict=True):
            if np.all(along == number):
                unions.join(a, b)
                touched[[a, b]] = True
    joined = unions.labels()
    return [joined[a:b] for a, b in itertools.pairwise(first)], int(np.sum(~touched))


def _closest(starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns some of the closest pairs of points of two sets, from different places."""
    distance, nearest = KDTree(ends).query(starts)
    order = np.argsort(distance, kind="stable")
    some = order[np.unique(np.linspace(0, min(len(order), 3 * _FOLLOWED) - 1, _FOLLOWED).astype(int))]
    return starts[some], ends[np.asarray(nearest)[some]]


def _volumes(
    slicing: Slicing, slices: Slices, found: list[Regions], labels: list[np.ndarray], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Integrates the areas of every cell; the error is the difference of two orders and the areas' own."""
    area, miss = np.zeros((len(found), count)), np.zeros((len(found), count))
    for k, (one, own) in enumerate(zip(found, labels, strict=True)):
        np.add.at(area[k], own, [region.area for region in one])
        np.add.at(miss[k], own, [region.error for region in one])
    row = {place: k for k, place in enumerate(slices.places)}
    volume, error = np.zeros(count), np.zeros(count)
    for panel in slices.panels:
        rows = [row[place] for place in inner_places(panel)]
        width = float(panel[1] - panel[0]) * (slicing.high - slicing.low)
        volume += width * (_FINE @ area[rows])
        error += width * (np.abs((_FINE - _COARSE) @ area[rows]) + _FINE @ miss[rows])
    volume += slicing.beside * area[0]
    return volume, error + slicing.beside * np.abs(area[1] - area[0])
