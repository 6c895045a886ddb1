"""``jk.characteristic_curves`` and ``jk.characteristic_surfaces``: regular poses over singular joint values.

An aspect is a connected set of poses that are not singular; over the same joints it may hold several of them. Its
characteristic surfaces are its poses that share their joints, in the same working mode, with a pose on its boundary:
crossing one, the number of its modes over the joints changes although the robot is not singular itself.
"""

from typing import Any

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.kinematics.legs import Legs, legs_of
from jaxkin.mapping._characteristic_lifting import Lift, Source, chart_points, lifts_of
from jaxkin.mapping._characteristic_meshes import lifted_meshes
from jaxkin.mapping._characteristic_records import (
    CharacteristicCurve,
    CharacteristicCurves,
    CharacteristicSurfaces,
    sign_text,
)
from jaxkin.mapping._characteristic_serial import SerialCurve, serial_curves
from jaxkin.mapping.loci import evaluated, singular_curves
from jaxkin.mapping.records import Curve, SingularCurves
from jaxkin.mapping.section import Section, bind_section, traced_factors
from jaxkin.mapping.surfaces import singular_surfaces
from jaxkin.sweep.grid import Grid

#: What may bound an aspect.
_BOUNDARIES = ("singular", "serial", "limits")


def characteristic_curves(
    robot: Mechanism, section: Grid, *, boundary: tuple[str, ...] = ("singular", "serial")
) -> CharacteristicCurves:
    """Finds the characteristic curves over a section of the joint space: regular poses over its singular curves.

    Over every point of every singular curve the other assembly modes are solved for, and linked along the curve by
    following each from point to point. A curve ends where its mode becomes singular itself: at a cusp, where it merges
    with the source, or in a fold with another mode. There points are added to the source until they are 1e-5 apart.

    Args:
        robot: The mechanism.
        section: A grid with two free joint axes; their ends are limits, their numbers only seed.
        boundary: What of an aspect's boundary is looked at: ``"singular"`` (det dF/dpose = 0), ``"serial"`` (a leg
            stretched or folded, det dF/djoints = 0, where the mechanism has several working modes), ``"limits"``.
            The last adds nothing: a limit concerns the joints only, so that every pose over a limit's joint values
            lies on the boundary itself. Limits of anything else (``robot.margins``) are not looked at.

    Returns:
        The curves: ``.poses (k, n_pose)``, ``.joints``, ``.sign``, ``.working_mode``, ``.source``, ``.closed``,
        ``.residual`` each, and ``.evidence``. Only those in the working mode of an aspect that the source bounds, and
        of a stretched leg only those with its sign of det dF/dpose; the others are counted.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``singular_curves``; an unknown boundary.
        GeometryError: As for ``singular_curves``.

    Not differentiable. In which of several aspects with one sign and working mode a pose is, ``jk.aspects`` tells.

    References:
        Wenger, P. and Chablat, D., 1998, "Workspace and assembly modes in fully parallel manipulators: a descriptive
        study" (characteristic surfaces). The same, 2000, on uniqueness domains.
    """
    who = "jk.characteristic_curves"
    if isinstance(boundary, str) or not set(boundary) <= set(_BOUNDARIES):
        raise InputError(f"{who}: boundary is {boundary!r}: it must be a tuple of some of {', '.join(_BOUNDARIES)}.")
    bound = bind_section(who, robot, section)
    legs = legs_of(robot)
    singular = singular_curves(robot, section)
    serial, doubts = serial_curves(bound, legs) if "serial" in boundary else ([], 0)
    found, others, left = list[CharacteristicCurve](), 0, 0
    for kind, sources in (
        ("singular", singular_sources(bound, singular) if "singular" in boundary else []),
        ("serial", [_serial_source(curve) for curve in serial]),
    ):
        for number, source in enumerate(sources):
            lifts, out = lifts_of(source, legs)
            names = _source_names(robot, singular, serial, kind)
            found += _curves(lifts, kind, number, names[number], legs)
            others, left = others + out, left + sum(end == "unknown" for lift in lifts for end in lift.ends)
    evidence = {
        "ends on nothing that is known": left,
        "poses over the curves in an aspect that these do not bound": others,
        **({"disagreements about stretched legs": doubts} if serial else {}),
        **({"limits": "every pose over a joint limit is on the boundary itself"} if "limits" in boundary else {}),
    }
    record = bound.record("lift")
    record["request"]["boundary"] = list(boundary)
    return CharacteristicCurves(tuple(found), singular, tuple(map(_plain, serial)), **record, evidence=evidence)


def singular_sources(section: Section, curves: SingularCurves) -> list[Source]:
    """Returns the singular curves as curves to lift, bound to the sheet on which each was traced."""
    sheets, names = section.sheets(), traced_factors(section.robot)
    sources = []
    for curve in curves:
        sheet = sheets[names.index(curve.label)] if curve.label in names else sheets[0]
        points = chart_points(section, curve.joints, curve.poses)
        sources.append(Source(sheet, points, curve.closed, -1, curve.ends, curves.crossings.poses))
    return sources


def _serial_source(curve: SerialCurve) -> Source:
    nowhere = np.zeros((0, curve.section.chart.n_pose))
    return Source(curve.section, curve.points, curve.closed, curve.leg, curve.ends, nowhere)


def _plain(curve: SerialCurve) -> Curve:
    joints, poses, residual = evaluated(curve.section, curve.points)
    label = _leg_name(curve.section.robot, curve.leg)
    return Curve(joints, poses, curve.closed, float(np.max(residual)), label=label, ends=curve.ends)


def _leg_name(robot: Mechanism, leg: int) -> str:
    return "det B" if leg < 0 else f"leg of {robot.joint_axes[leg].name}"


def _source_names(robot: Mechanism, singular: SingularCurves, serial: list[SerialCurve], kind: str) -> list[str]:
    if kind == "serial":
        return [_leg_name(robot, curve.leg) for curve in serial]
    return [curve.label or f"curve {k}" for k, curve in enumerate(singular)]


def _curves(lifts: list[Lift], kind: str, source: int, over: str, legs: Legs | None) -> list[CharacteristicCurve]:
    several = legs is not None and len(legs.modes) > 1
    curves = []
    for number, lift in enumerate(sorted(lifts, key=lambda lift: -len(lift.poses))):
        curves.append(
            CharacteristicCurve(
                name=f"{sign_text(lift.sign, lift.working, several)}, over {over} [{source}], {number}",
                joints=lift.joints,
                poses=lift.poses,
                sign=lift.sign,
                working_mode=lift.working,
                kind=kind,
                source=source,
                closed=lift.closed,
                residual=lift.residual,
                ends=lift.ends,
            )
        )
    return curves


def characteristic_surfaces(robot: Mechanism, box: Grid) -> CharacteristicSurfaces:
    """Finds the characteristic surfaces in a box of the workspace: regular poses over the joints of singular ones.

    The vertices of ``singular_surfaces`` are mapped to their joints, in every working mode; the other assembly modes
    over them are solved for and followed along the edges of the triangles. A triangle is lifted where its three edges
    agree. Dropped are those on which a mode becomes singular (along cusps and folds); the evidence counts them. The
    poses over stretched or folded legs are not among the sources: ``characteristic_curves`` has them, of sections.

    Args:
        robot: The mechanism.
        box: Grid over the pose axes, three of them free, as for ``singular_surfaces``. Poses whose singular partner
            lies outside the box are missed: it should hold the whole aspect.

    Returns:
        The surfaces, one for each source, sign of the determinant and working mode: ``.vertices``, ``.faces``,
        ``.joints``, ``.residual`` each. Empty where every other mode is singular too (the 3-PPPS and the TLPM have one
        pose an aspect). Of a robot with more than three pose axes only poses in the box's fixed coordinates count.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: As for ``singular_surfaces``.
        GeometryError: As for ``singular_surfaces``.

    References:
        Wenger, P. and Chablat, D., 1998, "Workspace and assembly modes in fully parallel manipulators: a descriptive
        study".
    """
    checked_single("jk.characteristic_surfaces", robot)
    singular = singular_surfaces(robot, box)
    surfaces, evidence = lifted_meshes(robot, legs_of(robot), singular)
    request: dict[str, Any] = {**identity(robot), "method": "lift", "box": singular.request["box"]}
    return CharacteristicSurfaces(
        surfaces=surfaces,
        singular=singular,
        request=request,
        pose_names=singular.pose_names,
        joint_names=tuple(axis.name for axis in robot.joint_axes),
        units={axis.name: axis.unit for axis in (*robot.pose_axes, *robot.joint_axes)},
        evidence=evidence,
    )
