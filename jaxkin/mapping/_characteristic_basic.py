"""What basic regions are made of, and how they are summed up."""

import json
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import Legs
from jaxkin.mapping._characteristic_records import plain_record
from jaxkin.mapping._characteristic_sheets import Sheets, sheet_at
from jaxkin.mapping._uniqueness import UniquenessDomain, UniquenessDomains, maximal_unions
from jaxkin.mapping.named import NamedParts


@dataclass(frozen=True, eq=False)
class SectionAspect:
    """What a section holds of an aspect.

    Attributes:
        name: Number in the aspects that were given, or sign and working mode.
        sign: Sign of det dF/dpose.
        working_mode: Signs of the entries of B; empty where working modes are no sign vectors.
        boundary: Numbers of the arcs over which it ends: one of the modes that merge there is in it.
        pieces: How many pieces it falls into over the section.
    """

    name: str
    sign: int
    working_mode: tuple[int, ...]
    boundary: tuple[int, ...]
    pieces: int


@dataclass(frozen=True, eq=False)
class BasicRegion:
    """A connected set of an aspect's poses between its characteristic curves.

    Attributes:
        name: Aspect and number.
        aspect: Number of the aspect.
        component: Number of the basic component, its image in the joint space.
        interior: ``(n_pose,)`` a pose of it, away from its border.
        joints: ``(n_joint,)`` the joints of that pose.
        sign: Sign of det dF/dpose.
        working_mode: Signs of the entries of B.
        neighbours: Pairs (basic region, arc): which lie next to it, across a characteristic curve over which arc.
        sheets: How many of its poses share their joints: 1, but where it winds round a hole of its component.
        poses: ``(k, n_pose)`` more of its poses, for drawings.
        over: ``(k, n_joint)`` their joints.
    """

    name: str
    aspect: int
    component: int
    interior: np.ndarray
    joints: np.ndarray
    sign: int
    working_mode: tuple[int, ...]
    neighbours: tuple[tuple[int, int], ...]
    sheets: int
    poses: np.ndarray
    over: np.ndarray


@dataclass(frozen=True, eq=False)
class BasicComponent:
    """The image of basic regions in the joint space: cells of the section.

    Attributes:
        name: The joint regions in which its cells lie.
        cells: Numbers of its cells, ascending.
        joint_regions: Numbers of the joint regions in which they lie.
        regions: Numbers of the basic regions over it.
        joints: ``(n_joint,)`` a point of it.
    """

    name: str
    cells: tuple[int, ...]
    joint_regions: tuple[int, ...]
    regions: tuple[int, ...]
    joints: np.ndarray


@dataclass(frozen=True, eq=False)
class CharacteristicArc:
    """A piece of a characteristic curve between two basic regions.

    Attributes:
        regions: Numbers of the basic regions on both sides.
        arc: Number of the arc over which it lies.
        poses: ``(k, n_pose)``.
        joints: ``(k, n_joint)``.
    """

    regions: tuple[int, int]
    arc: int
    poses: np.ndarray
    joints: np.ndarray


@dataclass(frozen=True, eq=False)
class Tracked:
    """What tells where a configuration is; no part of the result's content.

    Attributes:
        robot: The mechanism.
        legs: How its equations hold the joints.
        sheets: The modes over all cells.
        region_of: ``(n_sheet,)`` the basic region of each sheet.
    """

    robot: Mechanism
    legs: Legs | None
    sheets: Sheets
    region_of: np.ndarray


@dataclass(frozen=True, eq=False)
class BasicRegions(NamedParts[BasicRegion]):
    """The basic regions and basic components over a section of the joint space.

    Arcs are numbered as those of ``jk.regions``; those over stretched or folded legs follow behind.

    Attributes:
        regions: The basic regions, by aspect.
        components: Their images, each once.
        aspects: What the section holds of the aspects.
        curves: The characteristic curves between the regions.
        request: What determines the numbers: mechanism, geometry, section.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for completeness, by name.
        tracked: What ``region_of`` needs.
    """

    regions: tuple[BasicRegion, ...]
    components: tuple[BasicComponent, ...]
    aspects: tuple[SectionAspect, ...]
    curves: tuple[CharacteristicArc, ...]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)
    tracked: Tracked | None = None

    kind: ClassVar[str] = "basic regions"

    @property
    def parts(self) -> tuple[BasicRegion, ...]:
        """The basic regions."""
        return self.regions

    @property
    def modes_per_component(self) -> np.ndarray:
        """Number of assembly modes over each component, ``(n_component,)``: of its regions, each by its sheets."""
        return np.array([sum(self.regions[k].sheets for k in c.regions) for c in self.components], int)

    def region_of(self, pose: np.ndarray, joints: np.ndarray) -> int:
        """Returns the number of the basic region of a configuration over the section.

        Returns:
            -1 where the mode over the joints cannot be followed to a known point: too near a curve, or no mode at all.
        """
        assert self.tracked is not None
        t = self.tracked
        sheet = sheet_at(t.robot, t.legs, t.sheets, np.asarray(joints, float), np.asarray(pose, float))
        return int(t.region_of[sheet]) if sheet >= 0 else -1

    def uniqueness_domains(self, most: int = 4096) -> UniquenessDomains:
        """Returns all uniqueness domains: maximal connected unions of adjacent basic regions with disjoint components.

        Two of them may overlap: the same basic region may be joined with this or with that one of two regions over
        one component. A basic region with several sheets is in none.

        Args:
            most: So many connected unions are looked at; beyond, only some domains are found, and ``.complete`` is
                False.

        References:
            Wenger, P. and Chablat, D., 2000, on uniqueness domains of fully parallel manipulators with several
            assembly modes.
        """
        n = len(self.regions)
        neighbours = [{k for k, _ in region.neighbours if k != number} for number, region in enumerate(self.regions)]
        cells = [set(self.components[region.component].cells) for region in self.regions]
        aspect = [region.aspect for region in self.regions]
        clashes = [{j for j in range(n) if j != k and aspect[j] == aspect[k] and cells[j] & cells[k]} for k in range(n)]
        excluded = {k for k, region in enumerate(self.regions) if region.sheets > 1}
        unions, complete = maximal_unions(neighbours, clashes, excluded, most)
        return UniquenessDomains(tuple(self._domain(number, union) for number, union in enumerate(unions)), complete)

    def _domain(self, number: int, union: tuple[int, ...]) -> UniquenessDomain:
        aspect = self.regions[union[0]].aspect
        inside = set(union)
        return UniquenessDomain(
            name=f"{self.aspects[aspect].name}, {number}",
            aspect=aspect,
            regions=union,
            components=tuple(self.regions[k].component for k in union),
            curves=tuple(curve.poses for curve in self.curves if set(curve.regions) <= inside),
        )

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [f"{len(self)} basic regions of {len(self.aspects)} aspects over {len(self.components)} components"]
        for number, aspect in enumerate(self.aspects):
            own = [region for region in self.regions if region.aspect == number]
            pieces = "" if aspect.pieces == 1 else f", {aspect.pieces} pieces over the section"
            lines.append(f"  {aspect.name}: {len(own)} regions, boundary over {len(aspect.boundary)} arcs{pieces}")
        for component, modes in zip(self.components, self.modes_per_component, strict=True):
            lines.append(f"  component {component.name}: {modes} modes, {len(component.cells)} cells")
        return "\n".join([*lines, *(f"  {name}: {value}" for name, value in self.evidence.items())])

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "joint_axes": list(self.joint_names),
            "units": self.units,
            **{
                name: [plain_record(record) for record in getattr(self, name)]
                for name in ("regions", "components", "aspects", "curves")
            },
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)
