"""What the division of a section is made of: regions, the arcs between them, the points where arcs cross."""

import json
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.mapping._region_division import Divided
from jaxkin.mapping._region_edges import at, roughly
from jaxkin.mapping._region_paths import Plane, tilted
from jaxkin.mapping.named import NamedParts
from jaxkin.mapping.records import SingularCurves, coordinates

#: Entries of the evidence that are zero where all agrees.
DOUBTS = (
    "crossings of images that were not found",
    "contradictory orders of arcs",
    "arcs too short to be placed",
    "points whose number of solutions is not their region's",
    "regions without a sure number of solutions",
    "arcs across which the number changes by another one than two a curve",
)
#: A point this near to an arc (in widths of the section) is on it.
_ON = 1e-10


@dataclass(frozen=True, eq=False)
class Region:
    """A connected part of a section in which the number of solutions is constant.

    Attributes:
        name: The number of solutions and a letter, in order of size: ``"6a"``.
        n_solutions: How many assembly modes its points have; the forward kinematics counted them at several points.
        area: In the product of the units of both free joints.
        error: Estimated error of the area: two orders of Gauss's rule along the boundary, and a bound of the rounding.
        interior: ``(n_joint,)`` a point well inside.
        neighbours: Pairs (number of a region beyond an arc, number of the curve whose image the arc is).
        outline: Closed broken lines ``(k, n_joint)`` along the boundary, the first point not repeated: the longest way
            round first, then other outer lines (where a glued joint cuts the region in the picture) and holes. The
            region lies to the left.
    """

    name: str
    n_solutions: int
    area: float
    error: float
    interior: np.ndarray
    neighbours: tuple[tuple[int, int], ...]
    outline: list[np.ndarray]


@dataclass(frozen=True, eq=False)
class Arc:
    """A piece of a boundary between regions, or of the border of the section.

    Attributes:
        joints: ``(k, n_joint)`` points, in order.
        poses: ``(k, n_pose)`` a singular pose over each; not a number on the border.
        curve: Number of the curve of which this is the image; -1 for the border.
        sides: Numbers of the regions to the left and to the right; -1 is outside.
        curves: All curves of which it is the image, one entry each time it is traced (over S of the analytic 3-RPR
            lie two singular poses).
    """

    joints: np.ndarray
    poses: np.ndarray
    curve: int
    sides: tuple[int, int]
    curves: tuple[int, ...]

    def __len__(self) -> int:
        """Number of points."""
        return len(self.joints)

    @property
    def multiplicity(self) -> int:
        """How many singular poses lie over each of its points; 0 for the border."""
        return len(self.curves)


@dataclass(frozen=True, eq=False)
class Nodes:
    """Joint points over which two singular poses lie: images of curves cross there.

    Attributes:
        joints: ``(n, n_joint)``.
        poses: ``(n, 2, n_pose)``.
    """

    joints: np.ndarray
    poses: np.ndarray

    def __len__(self) -> int:
        """Number of nodes."""
        return len(self.joints)


@dataclass(frozen=True, eq=False)
class Regions(NamedParts[Region]):
    """The division of a section of the joint space by the number of solutions.

    Attributes:
        regions: The regions, largest first.
        arcs: What lies between them, and the border.
        nodes: Where images of different poses cross.
        curves: The singular curves.
        request: What determines the numbers: mechanism, geometry, section.
        joint_names: Names of the joint axes.
        pose_names: Names of the pose axes.
        units: Unit of every axis.
        limits_not_applied: Names of the limits, besides those of the joints, that the numbers do not heed.
        evidence: What speaks for it all, and what is in doubt, by name.
    """

    kind: ClassVar[str] = "regions"

    regions: tuple[Region, ...]
    arcs: tuple[Arc, ...]
    nodes: Nodes
    curves: SingularCurves
    request: dict[str, Any]
    joint_names: tuple[str, ...]
    pose_names: tuple[str, ...]
    units: dict[str, str]
    limits_not_applied: tuple[str, ...]
    evidence: dict[str, Any]
    _divided: Divided = field(repr=False)
    _numbers: np.ndarray = field(repr=False)

    @property
    def parts(self) -> tuple[Region, ...]:
        """The regions."""
        return self.regions

    @property
    def plane(self) -> Plane:
        """The plane of the free joints, scaled to a square."""
        return self._divided.plane

    @property
    def complete(self) -> bool:
        """False where something disagrees: see ``evidence``. True is no proof."""
        return self.curves.complete and not any(self.evidence.get(name) for name in DOUBTS)

    @property
    def area(self) -> float:
        """Area of the section."""
        return float(sum(region.area for region in self.regions))

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free joint axes."""
        return self.curves.free

    def areas_by_number(self) -> dict[int, float]:
        """Returns the area of all regions with each number of solutions, by ascending number."""
        numbers = sorted({region.n_solutions for region in self.regions})
        return {n: float(sum(r.area for r in self.regions if r.n_solutions == n)) for n in numbers}

    def region_of(self, joints: ArrayLike) -> Any:
        """Returns the number of the region that holds a joint point.

        Args:
            joints: ``(n_joint,)``, or ``(k, n_joint)`` for many points; glued joints in any turn.

        Returns:
            An int (for many points an array): -1 outside the section, and within 1e-10 of its width of an arc.

        Raises:
            InputError: Not ``n_joint`` numbers, or a fixed joint has another value than in the section.
        """
        points = np.asarray(joints, float)
        if points.ndim not in (1, 2) or points.shape[-1] != len(self.joint_names) or not np.all(np.isfinite(points)):
            raise InputError(
                f"Regions.region_of: joints has shape {points.shape}; it must be ({len(self.joint_names)},) or "
                f"(k, {len(self.joint_names)}), finite numbers in the order {', '.join(self.joint_names)}."
            )
        self._check_fixed(np.atleast_2d(points))
        found = self._located(np.atleast_2d(points))
        return int(found[0]) if points.ndim == 1 else found

    def _check_fixed(self, points: np.ndarray) -> None:
        for k, name in enumerate(self.joint_names):
            value = self.request["section"][name]
            if not isinstance(value, list) and np.any(np.abs(points[:, k] - value) > 1e-9 * (1 + abs(value))):
                raise InputError(
                    f"Regions.region_of: {name} is {points[:, k].tolist()}, and {value:g} all over the section: give "
                    "points of the section, or make the regions of another one."
                )

    def _located(self, points: np.ndarray) -> np.ndarray:
        """Returns the regions of points: how many arcs of the slab lie below them."""
        divided = self._divided
        plane, bounds = divided.plane, divided.shape.bounds
        here = plane.place(points[:, list(plane.section.grid.free)])
        here = np.where(plane.glued, here - np.floor(here), here)
        inside = np.all((here >= 0) & (here <= 1), axis=1)
        x = tilted(here)
        slab = np.clip(np.searchsorted(bounds, x, side="right") - 1, 0, len(bounds) - 2)
        found = np.full(len(points), -1)
        lines = [divided.order[k] for k in slab]
        which = np.concatenate([np.array(line, int) for line in lines])
        owner = np.repeat(np.arange(len(points)), [len(line) for line in lines])
        heights, miss = roughly(divided.edges, which, x[owner])
        close = np.flatnonzero(np.abs(here[owner, 1] - heights) <= miss)
        heights[close] = at(plane, divided.edges, which[close], x[owner[close]]).plane[:, 1]
        for k, line in enumerate(lines):
            gaps = here[k, 1] - heights[owner == k]
            below = int(np.sum(gaps > 0))
            if inside[k] and np.min(np.abs(gaps)) > _ON and 0 < below < len(line):
                found[k] = self._numbers[divided.division.above[line[below - 1]]]
        return found

    def __str__(self) -> str:
        """A summary of a few lines."""
        free = ", ".join(self.free)
        lines = [
            f"{len(self)} regions over {free}, {len(self.nodes)} nodes, "
            f"{sum(arc.curve >= 0 for arc in self.arcs)} arcs of {len(self.curves)} singular curves"
        ]
        for k, region in enumerate(self.regions):
            beside = ", ".join(sorted({self.regions[n].name for n, _ in region.neighbours}))
            point = coordinates(self.free, region.interior[[self.joint_names.index(name) for name in self.free]])
            lines.append(
                f"  [{k}] {region.name}: {region.n_solutions} solutions, area {region.area:.12g} "
                f"(error {region.error:.0e}), beside {beside or 'none'}, holds {point}"
            )
        lines += [f"  {name}: {value}" for name, value in self.evidence.items()]
        if self.limits_not_applied:
            lines.append(f"  limits that are not applied: {', '.join(self.limits_not_applied)}")
        if not self.complete:
            lines.append("  DOUBTFUL: see what is not zero above; try more samples, or a section a little apart")
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text; poses of the border are null."""
        regions = [
            {
                "name": r.name,
                "n_solutions": r.n_solutions,
                "area": r.area,
                "error": r.error,
                "interior": r.interior.tolist(),
                "neighbours": [list(pair) for pair in r.neighbours],
                "outline": [line.tolist() for line in r.outline],
            }
            for r in self.regions
        ]
        arcs = [
            {
                "curve": a.curve,
                "curves": list(a.curves),
                "sides": list(a.sides),
                "joints": a.joints.tolist(),
                "poses": a.poses.tolist() if a.curves else None,
            }
            for a in self.arcs
        ]
        content = {
            "request": self.request,
            "joint_axes": list(self.joint_names),
            "pose_axes": list(self.pose_names),
            "units": self.units,
            "regions": regions,
            "arcs": arcs,
            "nodes": {"joints": self.nodes.joints.tolist(), "poses": self.nodes.poses.tolist()},
            "limits_not_applied": list(self.limits_not_applied),
            "complete": self.complete,
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


def letters(numbers: list[int]) -> list[str]:
    """Names parts by their number of solutions and a letter, in order: 6a, 4a, 4b."""
    seen: dict[int, int] = {}
    names = []
    for number in numbers:
        names.append(f"{number}{_letter(seen.get(number, 0))}")
        seen[number] = seen.get(number, 0) + 1
    return names


def _letter(k: int) -> str:
    """Returns a, b, ... z, aa, ab, ..."""
    return (_letter(k // 26 - 1) if k >= 26 else "") + chr(ord("a") + k % 26)
