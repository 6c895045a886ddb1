"""The chapters of an analysis: each asks one question of ``mapping`` and draws the answer."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from jaxkin.core.errors import JaxkinError
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import LegKind, legs_of
from jaxkin.kinematics.singularity import conditioning
from jaxkin.kinematics.solve import forward
from jaxkin.mapping._region_records import Regions
from jaxkin.mapping.aspects import aspects
from jaxkin.mapping.basic_regions import basic_regions
from jaxkin.mapping.characteristic import characteristic_curves
from jaxkin.mapping.cusp_curves import cusp_curves
from jaxkin.mapping.cusps import cusps
from jaxkin.mapping.mode_change import mode_change
from jaxkin.mapping.regions import regions
from jaxkin.plot.aspects import aspects as draw_aspects
from jaxkin.plot.basic_regions import basic_regions as draw_basic_regions
from jaxkin.plot.characteristic import characteristic as draw_characteristic
from jaxkin.plot.cusp_curves import cusp_curves as draw_cusp_curves
from jaxkin.plot.mode_change import mode_change as draw_mode_change
from jaxkin.plot.regions import regions as draw_regions
from jaxkin.reports.document import Cell, Chapter, Picture, Table
from jaxkin.sweep.grid import Grid


@dataclass(frozen=True)
class Places:
    """Where to look.

    Attributes:
        poses: Grid over the pose axes, for the aspects; None derives it from the joint limits.
        section: Grid with two free joint axes.
        box: Grid with three free joint axes, or None where there are only two.
        joints: Joint values whose assembly modes are listed and joined.
    """

    poses: Grid | None
    section: Grid
    box: Grid | None
    joints: Sequence[float]


def _lines(result: Any) -> str:
    """Returns a result's own summary as a block."""
    return f"```text\n{result}\n```"


_KINDS = {
    LegKind.LINEAR: "linearly",
    LegKind.QUADRATIC: "as a quadratic polynomial",
    LegKind.TRIGONOMETRIC: "by sine and cosine",
}


def mechanism_chapter(robot: Mechanism) -> Chapter:
    """Says what the mechanism is, and how its equations hold the joints."""
    axes = [
        (kind, axis.name, axis.unit, axis.low, axis.high, "glued" if axis.period else "")
        for kind, group in (("pose", robot.pose_axes), ("joint", robot.joint_axes))
        for axis in group
    ]
    table = Table("Axes", ("space", "axis", "unit", "low", "high", ""), axes)
    legs = legs_of(robot)
    if legs is None:
        modes = (
            "An equation holds several joints: working modes are sheets of the inverse kinematics, not sign vectors."
        )
    else:
        held = ", ".join(f"{axis.name} {_KINDS[kind]}" for axis, kind in zip(robot.joint_axes, legs.kinds, strict=True))
        count = len(legs.modes)
        modes = (
            f"Every equation holds one joint: {held}. {count} working mode{'s' if count > 1 else ''} within the limits."
        )
    return Chapter("The mechanism", (f"`{robot}`", modes), tables={"axes": table})


def modes_chapter(robot: Mechanism, places: Places) -> Chapter:
    """Lists the assembly modes at the joint values."""
    modes = forward(robot, np.asarray(places.joints, float))
    rows: list[list[Any]] = []
    for lane, (pose, valid) in enumerate(zip(np.asarray(modes.values), np.asarray(modes.valid), strict=True)):
        if valid:
            measures = conditioning(robot, pose, np.asarray(places.joints, float))
            rows.append([lane, *map(float, pose), float(measures.determinant), float(measures.smallest_singular_value)])
    names = [axis.name for axis in robot.pose_axes]
    header = ("mode", *names, "det dF/dpose", "clearance")
    at = ", ".join(f"{axis.name} = {value:g}" for axis, value in zip(robot.joint_axes, places.joints, strict=True))
    text = f"{len(rows)} assembly modes at {at}. The clearance is the smallest singular value of dq/dx, dimensionless."
    return Chapter("Assembly modes", (text,), tables={"modes": Table("Assembly modes", header, rows)})


def aspects_chapter(robot: Mechanism, places: Places) -> Chapter:
    """Returns the singularity-free domains of the workspace."""
    found = aspects(robot, places.poses)
    header = ("aspect", "sign", "working mode", "volume", "error", "clearance", *found.pose_names)
    rows: list[list[Cell]] = [
        [
            aspect.name,
            int(aspect.sign),
            aspect.mode,
            float(aspect.volume),
            float(aspect.error),
            float(aspect.clearance),
            *map(float, aspect.pose),
        ]
        for aspect in found
    ]
    picture = Picture.of(draw_aspects(found), "Aspects: singularity-free domains of the workspace.")
    table = Table("Aspects, each with its deepest pose", header, rows)
    return Chapter("Aspects", (_lines(found),), {"aspects": picture}, {"aspects": table}, {"aspects": found.to_json()})


def section_chapter(robot: Mechanism, places: Places) -> Chapter:
    """Returns singular curves, cusps and regions of the section."""
    found, tips = regions(robot, places.section), cusps(robot, places.section)
    assert isinstance(found, Regions)  # A section, and no box.
    header = ("region", "solutions", "area", "error", *found.joint_names)
    rows: list[list[Cell]] = [
        [region.name, int(region.n_solutions), float(region.area), float(region.error), *map(float, region.interior)]
        for region in found
    ]
    picture = Picture.of(draw_regions(found), "Regions of the section by number of assembly modes.")
    return Chapter(
        "Section of the joint space",
        (_lines(found.curves), _lines(tips), _lines(found)),
        {"regions": picture},
        {"regions": Table("Regions, each with a point inside", header, rows)},
        {"singular_curves": found.curves.to_json(), "cusps": tips.to_json(), "regions": found.to_json()},
    )


def basic_chapter(robot: Mechanism, places: Places) -> Chapter:
    """Returns characteristic curves, basic regions and uniqueness domains over the section."""
    curves, found = characteristic_curves(robot, places.section), basic_regions(robot, places.section)
    domains = found.uniqueness_domains()
    pictures = {
        "characteristic": Picture.of(draw_characteristic(curves), "Singular and characteristic curves."),
        "basic_regions": Picture.of(draw_basic_regions(found), "Basic regions and basic components."),
    }
    text = (_lines(curves), _lines(found), _lines(domains))
    data = {"characteristic": curves.to_json(), "basic_regions": found.to_json()}
    return Chapter("Basic regions and uniqueness domains", text, pictures, data=data)


def cusp_chapter(robot: Mechanism, box: Grid) -> Chapter:
    """Returns the cusp curves of the box, and where the number of cusps of its sections changes."""
    found = cusp_curves(robot, box)
    rows: list[list[Cell]] = []
    for axis in found.free:
        events = found.transitions(axis)
        for value, (below, above), kind, error in zip(
            events.values, events.counts, events.kinds, events.error, strict=True
        ):
            rows.append([axis, float(value), float(error), int(below), int(above), kind])
    table = Table(
        "Where the number of cusps of a section changes",
        ("fixed joint", "value", "error", "cusps below", "cusps above", "what happens"),
        rows,
    )
    picture = Picture.of(
        draw_cusp_curves(found, axis=found.free[0]), "Cusp curves, and the number of cusps against a fixed joint."
    )
    return Chapter(
        "Cusp curves",
        (_lines(found),),
        {"cusp_curves": picture},
        {"transitions": table},
        {"cusp_curves": found.to_json()},
    )


def changes_chapter(robot: Mechanism, places: Places) -> Chapter:
    """Returns which assembly modes are joined by paths that meet no singularity, and one such path."""
    pairs = _same_sign(robot, places)
    pairs = _same_sign(robot, places)
    if not pairs:
        none = "No two assembly modes have the same sign of det dF/dpose: none can be joined without a singularity."
        return Chapter("Changes of assembly mode", (none,))
    rows: list[list[Cell]] = []
    pictures: dict[str, Picture] = {}
    data: dict[str, str] = {}
    for first, second, start, goal in pairs:
        try:
            found = mode_change(robot, np.asarray(places.joints, float), start, goal)
        except JaxkinError as error:
            rows.append([f"{first} to {second}", "not answered", None, None, str(error)])
            continue
        encircled = ", ".join(map(str, found.encircled)) or "none"
        clearance = float(found.clearance) if found.found else None
        rows.append([f"{first} to {second}", "yes" if found.found else "no", clearance, encircled, str(found.reason)])
        if found.found and not pictures:
            caption = f"From mode {first} to mode {second} without meeting a singularity."
            pictures["mode_change"] = Picture.of(draw_mode_change(found, robot), caption)
            data["mode_change"] = found.to_json()
    header = ("modes", "path", "clearance", "encircled cusp curves", "remark")
    table = Table("Pairs of modes with the same sign of det dF/dpose", header, rows)
    return Chapter("Changes of assembly mode", (), pictures, {"mode_changes": table}, data)


def _same_sign(robot: Mechanism, places: Places) -> list[tuple[int, int, np.ndarray, np.ndarray]]:
    """Returns the pairs of assembly modes with one sign of det A, which alone can be joined: numbers and poses."""
    joints = np.asarray(places.joints, float)
    modes = forward(robot, joints)
    lanes = np.flatnonzero(np.asarray(modes.valid))
    poses = np.asarray(modes.values)
    signs = {lane: np.sign(float(conditioning(robot, poses[lane], joints).determinant)) for lane in lanes}
    return [(int(a), int(b), poses[a], poses[b]) for a, b in combinations(lanes, 2) if signs[a] == signs[b]]
