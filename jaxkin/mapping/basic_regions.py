"""``jk.basic_regions``: how an aspect falls into basic regions, and which of them make uniqueness domains."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import Legs, legs_of
from jaxkin.mapping._characteristic_basic import (
    BasicComponent,
    BasicRegion,
    BasicRegions,
    CharacteristicArc,
    SectionAspect,
    Tracked,
)
from jaxkin.mapping._characteristic_lifting import Lift, Source, chart_points, lifts_of
from jaxkin.mapping._characteristic_records import sign_text
from jaxkin.mapping._characteristic_roadmap import Barriers, Plane, Roadmap, roadmap_of
from jaxkin.mapping._characteristic_serial import pieces, serial_curves
from jaxkin.mapping._characteristic_sheets import Passage, Sheets, sheets_of
from jaxkin.mapping._lifts import glued_gap, measured, modes_over, union
from jaxkin.mapping.chart import factor_names, tells_factors
from jaxkin.mapping.loci import evaluated
from jaxkin.mapping.regions import Regions, regions
from jaxkin.mapping.section import Section, bind_section, traced_factors
from jaxkin.sweep.grid import Grid

_WHO = "jk.basic_regions"
#: Share of the section's area below which a cell between curves of stretched legs counts as one of their chords only.
_SLIVER = 1e-5
#: Curves nearer to each other than this share of the section have one image, if poses say so too.
_ONE_IMAGE = 1e-3


def basic_regions(robot: Mechanism, section: Grid, *, aspects: Any = None) -> BasicRegions:
    """Finds the basic regions and basic components of the aspects over a section of the joint space.

    The section is divided into cells by its singular curves (and by the curves over which a leg is stretched or
    folded, where the mechanism has several working modes). The modes over points of all cells are followed along short
    ways within cells, round holes as well, and across every arc. A mode that ends at an arc puts it on the boundary of
    its aspect. Basic regions are then the connected sets of an aspect's modes that are joined within cells and across
    arcs which are not on its boundary, and basic components the sets of cells under them.

    Args:
        robot: The mechanism.
        section: A grid with two free joint axes; their ends are limits, their numbers only seed.
        aspects: A result of ``jk.aspects``, which tells in which aspect a pose is. Without it, modes that can be
            followed into each other over the section are in one aspect; where the section fixes a joint, also all with
            one sign of det dF/dpose, one working mode, and one sign of every factor where the mechanism tells these
            from the singularities of its pose coordinates.

    Returns:
        The basic regions with ``.components``, ``.aspects``, ``.curves``, ``.uniqueness_domains()`` and ``.evidence``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``singular_curves``; aspects that are no result of ``jk.aspects``.
        GeometryError: As for ``singular_curves``.

    Not differentiable. Completeness is not proved; ``.evidence`` says what is in doubt.

    References:
        Wenger, P. and Chablat, D., 1998, "Workspace and assembly modes in fully parallel manipulators: a descriptive
        study" (basic regions and components). The same, 2000, on uniqueness domains.
    """
    if aspects is not None and not callable(getattr(aspects, "aspect_of", None)):
        raise InputError(f"{_WHO}: aspects is a {type(aspects).__name__}: pass what jk.aspects returns, or None.")
    bound = bind_section(_WHO, robot, section)
    legs = legs_of(robot)
    divided = regions(robot, section)
    assert isinstance(divided, Regions)
    sources, arcs, doubts = _sources(bound, legs, divided)
    curves = [(evaluated(source.section, source.points)[0], source.closed) for source in sources]
    roadmap = roadmap_of(bound, curves)
    naming = _Cells(divided, serial=any(arc >= len(divided.arcs) for arc in arcs))
    sheets = sheets_of(robot, legs, roadmap, sources, naming)
    found = _Found(robot, legs, bound, sheets, sources, arcs, naming, aspects)
    evidence = {**sheets.evidence, **naming.evidence, **found.evidence()}
    if doubts is not None:
        evidence["disagreements about stretched legs"] = doubts
    return BasicRegions(
        regions=found.regions(),
        components=found.components(),
        aspects=found.aspects(),
        curves=found.curves(),
        **bound.record("sheets"),
        evidence=evidence,
        tracked=Tracked(robot, legs, sheets, found.region),
    )


def _sources(section: Section, legs: Legs | None, divided: Any) -> tuple[list[Source], list[int], int | None]:
    """Returns the curves between cells, the number of the arc of each, and doubts about stretched legs."""
    sheets, names = section.sheets(), traced_factors(section.robot)
    sources, arcs, crossings = list[Source](), list[int](), divided.curves.crossings.poses
    for number, arc in enumerate(divided.arcs):
        if arc.curve < 0 or len(arc.joints) < 2:
            continue
        label = divided.curves[arc.curve].label
        sheet = sheets[names.index(label)] if label in names else sheets[0]
        sources.append(Source(sheet, chart_points(section, arc.joints, arc.poses), False, -1, ("", ""), crossings))
        arcs.append(number)
    serial, doubts = serial_curves(section, legs)
    singular = len(sources)
    for curve in serial:
        joints, poses, _ = evaluated(curve.section, curve.points)
        _, sign, _, working, _ = measured(section.robot, legs, poses, joints)
        for points, closed in pieces(curve, np.column_stack([sign, working])):
            if _is_image_of_another(section.robot, legs, curve.section, points, sources[singular:]):
                continue
            sources.append(Source(curve.section, points, closed, curve.leg, ("", ""), crossings[:0]))
            arcs.append(len(divided.arcs) + len(sources) - 1)
    return sources, arcs, doubts if serial else None


def _is_image_of_another(
    robot: Mechanism, legs: Legs | None, section: Section, points: np.ndarray, others: list[Source]
) -> bool:
    """True where other poses with a stretched leg, those of a curve that is known, lie over the same joints.

    A mechanism with a plane of symmetry has them in pairs: such a curve divides the cells once.
    """
    if not others or legs is None:
        return False
    joints, poses, _ = evaluated(section, points)
    modes = modes_over(robot, legs, joints).without(poses, robot)
    stretched = np.any(modes.regular & np.any(modes.working == 0, axis=-1), axis=1)
    if np.mean(stretched) < 0.9:
        return False
    plane = Plane.of(section)
    known = Barriers.of(plane, [(evaluated(other.section, other.points)[0], other.closed) for other in others])
    return known.distance(plane.flat(joints[len(joints) // 2])) < _ONE_IMAGE


class _Cells:
    """Numbers the connected components of a roadmap as cells, and knows the joint region of each.

    Attributes:
        region: The joint region of each cell.
        evidence: What is in doubt.
    """

    def __init__(self, divided: Any, serial: bool):
        self.divided, self.serial = divided, serial
        self.region: list[int] = []
        self.evidence: dict[str, Any] = {}

    def __call__(self, component: np.ndarray, roadmap: Roadmap) -> np.ndarray:
        """Returns the cell of each point of the roadmap, -1 where its component is none."""
        joints = roadmap.joints
        weight = np.zeros(component.max(initial=-1) + 1)
        np.add.at(weight, component, roadmap.depth**2)
        cell = np.full(len(component), -1)
        best, apart = dict[int, int](), 0
        for number in np.argsort(-weight, kind="stable"):
            points = np.flatnonzero(component == number)
            region = int(self.divided.region_of(joints[points[np.argmax(roadmap.depth[points])]]))
            if region < 0 or (not self.serial and region in best) or (self.serial and weight[number] < _SLIVER):
                apart += int(not self.serial and region in best and weight[number] > _SLIVER)
                continue
            best[region] = number
            cell[points] = len(self.region)
            self.region.append(region)
        self.evidence = {
            "cells": len(self.region),
            "joint regions without a cell": len(self.divided) - len(set(self.region)),
            "joint regions with points that no way joins": apart,
        }
        return cell


class _Found:
    """Puts sheets together: aspects, basic regions, components.

    Attributes:
        aspect: ``(n_sheet,)`` number of the aspect of each sheet.
        region: ``(n_sheet,)`` number of the basic region of each sheet.
    """

    def __init__(
        self,
        robot: Mechanism,
        legs: Legs | None,
        section: Section,
        sheets: Sheets,
        sources: list[Source],
        arcs: list[int],
        cells: _Cells,
        aspects: Any,
    ):
        self.robot, self.legs, self.sheets, self.sources, self.arcs, self.cells = (
            robot,
            legs,
            sheets,
            sources,
            arcs,
            cells,
        )
        self.examples = [sheets.example(k) for k in range(sheets.count)]
        self.piece = union(sheets.count, np.array([p.sheets for p in sheets.passages], int))
        whole = len(section.grid.free) == len(robot.joint_axes)
        self.labels, self.aspect = self._labelled(aspects, whole)
        self.boundary = [
            {curve for curve, sheet in sheets.touches if self.aspect[sheet] == number}
            for number in range(len(self.labels))
        ]
        inner = [p.sheets for p in sheets.passages if not self._bounds(p)]
        component = union(sheets.count, np.array(inner, int))
        order = sorted(set(component.tolist()), key=lambda c: (self.aspect[np.argmax(component == c)], c))
        self.region = np.array([order.index(c) for c in component], int)
        self.images = [self._image(number) for number in range(len(order))]
        self.distinct = sorted(set(self.images))

    def _bounds(self, passage: Passage) -> bool:
        """True where the curve of a passage is on the boundary of the aspect in which the mode goes on."""
        return passage.curve in self.boundary[self.aspect[passage.sheets[0]]]

    def _labelled(self, aspects: Any, whole: bool) -> tuple[list[str], np.ndarray]:
        """Returns the names of the aspects, and the aspect of every sheet."""
        several = self.legs is not None and len(self.legs.modes) > 1
        labels, first = list[tuple[Any, str]](), dict[int, int]()
        number = np.zeros(self.sheets.count, int)
        for sheet, (point, lane) in enumerate(self.examples):
            piece = int(self.piece[sheet])
            if piece not in first:
                modes = self.sheets.modes
                sign, working = int(modes.sign[point, lane]), tuple(modes.working[point, lane].tolist())
                name = sign_text(sign, working, several)
                factors = self._factor_signs(modes.poses[point, lane])
                name = factors or name
                label: tuple[Any, str] = (
                    (piece, f"{name}, piece {piece}") if whole else ((sign, working, factors), name)
                )
                if aspects is not None:
                    known = int(aspects.aspect_of(modes.poses[point, lane], modes.joints[point]))
                    # Where the aspects do not decide, the piece stands for itself.
                    label = (("aspect", known), f"aspect {known}") if known >= 0 else (piece, f"undecided, {name}")
                if label[0] not in [key for key, _ in labels]:
                    labels.append(label)
                first[piece] = [key for key, _ in labels].index(label[0])
            number[sheet] = first[piece]
        return [name for _, name in labels], number

    def _factor_signs(self, pose: np.ndarray) -> str:
        """Names the signs of the factors of the determinant, where they are functions of the configuration.

        A mechanism that tells them from those of its pose coordinates declares such factors; others may change sign
        over a glued end of an angle.
        """
        if not tells_factors(self.robot):
            return ""
        values = self.robot.factors(jnp.asarray(pose))  # type: ignore[attr-defined]
        return ", ".join(f"{name} {'>' if values[name] > 0 else '<'} 0" for name in factor_names(self.robot))

    def _image(self, region: int) -> tuple[int, ...]:
        return tuple(sorted(set(self.sheets.cell_of[self.region == region].tolist())))

    def evidence(self) -> dict[str, Any]:
        """Returns what must hold for basic components, counted where it does not."""
        overlaps = sum(
            bool(set(a) & set(b)) and a != b
            for i, a in enumerate(self.images)
            for j, b in enumerate(self.images[:i])
            if self._aspect_of(i) == self._aspect_of(j)
        )
        mixed = sum(
            len({self._sign(int(s)) for s in np.flatnonzero(self.region == k)}) > 1 for k in range(len(self.images))
        )
        return {"components that overlap and differ": overlaps, "regions of both signs": mixed}

    def _aspect_of(self, region: int) -> int:
        return int(self.aspect[np.argmax(self.region == region)])

    def _sign(self, sheet: int) -> int:
        return int(self.sheets.modes.sign[self.examples[sheet]])

    def regions(self) -> tuple[BasicRegion, ...]:
        """Returns the basic regions."""
        neighbours: list[set[tuple[int, int]]] = [set() for _ in self.images]
        for passage in self.sheets.passages:
            a, b = (int(self.region[sheet]) for sheet in passage.sheets)
            if a != b:
                neighbours[a].add((b, self.arcs[passage.curve]))
                neighbours[b].add((a, self.arcs[passage.curve]))
        return tuple(self._region(k, tuple(sorted(neighbours[k]))) for k in range(len(self.images)))

    def _region(self, number: int, neighbours: tuple[tuple[int, int], ...]) -> BasicRegion:
        sheets, modes = self.sheets, self.sheets.modes
        own = np.isin(sheets.sheet, np.flatnonzero(self.region == number))
        point, lane = np.nonzero(own)
        best = int(np.argmax(sheets.roadmap.depth[point]))
        at = point[best], lane[best]
        aspect = self._aspect_of(number)
        return BasicRegion(
            name=f"{self.labels[aspect]}, region {number}",
            aspect=aspect,
            component=self.distinct.index(self.images[number]),
            interior=modes.poses[at],
            joints=modes.joints[at[0]],
            sign=int(modes.sign[at]),
            working_mode=tuple(modes.working[at].tolist()),
            neighbours=neighbours,
            sheets=int(np.max(np.sum(own, axis=1))),
            poses=modes.poses[point, lane],
            over=modes.joints[point],
        )

    def components(self) -> tuple[BasicComponent, ...]:
        """Returns the basic components."""
        return tuple(self._component(cells) for cells in self.distinct)

    def _component(self, cells: tuple[int, ...]) -> BasicComponent:
        places = tuple(sorted({self.cells.region[cell] for cell in cells}))
        inside = np.flatnonzero(np.isin(self.sheets.cell, cells))
        best = inside[np.argmax(self.sheets.roadmap.depth[inside])]
        return BasicComponent(
            name=" + ".join(str(self.cells.divided[k].name) for k in places),
            cells=cells,
            joint_regions=places,
            regions=tuple(k for k, image in enumerate(self.images) if image == cells),
            joints=self.sheets.modes.joints[best],
        )

    def aspects(self) -> tuple[SectionAspect, ...]:
        """Returns what the section holds of the aspects."""
        found = []
        for number, name in enumerate(self.labels):
            own = np.flatnonzero(self.aspect == number)
            at = self.examples[own[0]]
            modes = self.sheets.modes
            found.append(
                SectionAspect(
                    name=name,
                    sign=int(modes.sign[at]),
                    working_mode=tuple(modes.working[at].tolist()),
                    boundary=tuple(sorted(self.arcs[curve] for curve in self.boundary[number])),
                    pieces=len(set(self.piece[own].tolist())),
                )
            )
        return tuple(found)

    def curves(self) -> tuple[CharacteristicArc, ...]:
        """Returns the characteristic curves between basic regions."""
        lifted = dict[int, list[Lift]]()
        found = []
        for passage in self.sheets.passages:
            a, b = (int(self.region[sheet]) for sheet in passage.sheets)
            if not self._bounds(passage):
                continue
            if passage.curve not in lifted:
                lifted[passage.curve] = lifts_of(self.sources[passage.curve], self.legs)[0]
            for lift in lifted[passage.curve]:
                if self._through(lift, passage):
                    found.append(CharacteristicArc((a, b), self.arcs[passage.curve], lift.poses, lift.joints))
        return tuple(found)

    def _through(self, lift: Lift, passage: Passage) -> bool:
        here = np.max(np.abs(lift.joints - passage.joints), axis=1) < 1e-12
        return bool(np.any(glued_gap(self.robot, lift.poses[here] - passage.pose) < 1e-9))
