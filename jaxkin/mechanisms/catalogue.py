"""The mechanisms that the command line knows; imports JAX only when one is made."""

import importlib
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from jaxkin.core.errors import InputError
from jaxkin.core.words import meant

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism


Axes = dict[str, tuple[float, float, int] | float]


@dataclass(frozen=True)
class Study:
    """Where to look at a mechanism when nobody says where; for the default geometry and no other.

    Attributes:
        poses: Grid over the pose axes that holds all of the workspace that matters.
        section: Grid with two free joint axes.
        box: Grid with three free joint axes, or empty where there are only two.
        joints: Joint values with many assembly modes.
    """

    poses: Axes
    section: Axes
    box: Axes
    joints: tuple[float, ...]


@dataclass(frozen=True)
class Entry:
    """How to make one mechanism.

    Attributes:
        title: One line for a person.
        module: Module with the constructor.
        constructor: Its name.
        geometry: Default geometry, the source's example: numbers, and tuples of them.
        source: Where it comes from.
        study: Where to look at it.
        options: Further arguments of the constructor, and how each is written: a number, or several as ``a:b:c``.
    """

    title: str
    module: str
    constructor: str
    geometry: dict[str, Any]
    source: str
    study: Study
    options: dict[str, str] = field(default_factory=dict)


_TURN = (-math.pi, math.pi)
_SIDES = (17.04, 16.54, 20.84)
_BETA = math.acos((_SIDES[0] ** 2 + _SIDES[2] ** 2 - _SIDES[1] ** 2) / (2 * _SIDES[0] * _SIDES[2]))

CATALOGUE: dict[str, Entry] = {
    "rpr3-analytic": Entry(
        title="planar 3-RPR, analytic family (platform = mirrored base)",
        module="jaxkin.mechanisms.rpr3",
        constructor="analytic",
        geometry={"c2": 1.0, "c3": 0.0, "d3": 1.0},
        source="Wenger and Chablat 2009",
        study=Study(
            poses={"x": (-3.0, 3.0, 256), "y": (-3.0, 3.0, 256), "phi": (*_TURN, 256)},
            section={"rho1": (0.0, 4.0, 400), "rho2": 1.0, "rho3": (0.0, 4.0, 400)},
            box={"rho1": (0.0, 4.0, 100), "rho2": (0.0, 4.0, 100), "rho3": (0.0, 4.0, 100)},
            joints=(1.2, 1.0, 1.5),
        ),
    ),
    "rpr3": Entry(
        title="planar 3-RPR, any geometry; by default the field's reference geometry",
        module="jaxkin.mechanisms.rpr3",
        constructor="general",
        geometry={"c2": 15.91, "c3": 0.0, "d3": 10.0, "l2": _SIDES[0], "l3": _SIDES[2], "beta": _BETA},
        source="Innocenti and Parenti-Castelli 1998",
        study=Study(
            poses={"x": (-40.0, 40.0, 256), "y": (-40.0, 40.0, 256), "phi": (*_TURN, 256)},
            section={"rho1": 14.98, "rho2": (0.0, 36.0, 400), "rho3": (0.0, 36.0, 400)},
            box={"rho1": (0.01, 40.0, 100), "rho2": (0.0, 60.0, 100), "rho3": (0.0, 60.0, 100)},
            joints=(14.98, 15.38, 12.0),
        ),
    ),
    "ppps3": Entry(
        title="3-PPPS with U-shaped base, six degrees of freedom",
        module="jaxkin.mechanisms.ppps3",
        constructor="create",
        geometry={"side": 1.0, "base_radius": 2.0},
        source="Chablat, Baron, Jha and Rolland 2018",
        study=Study(
            poses={
                "x": 0.0,
                "y": 0.0,
                "z": 0.0,
                "phi": (*_TURN, 128),
                "theta": (-math.pi / 2, math.pi / 2, 64),
                "sigma": (*_TURN, 128),
            },
            section={
                "rho1y": 0.0,
                "rho1z": 0.0,
                "rho2y": 0.67,
                "rho2z": (-1.2, 1.2, 200),
                "rho3y": -0.95,
                "rho3z": (-1.2, 1.2, 200),
            },
            box={},
            joints=(0.0, 0.0, 0.67, 0.06, -0.95, 0.21),
        ),
        options={"mirrored": "0 or 1"},
    ),
    "tlpm": Entry(
        title="TLPM, three translations by three limb lengths (mm)",
        module="jaxkin.mechanisms.tlpm",
        constructor="create",
        geometry={"base_radius": 590.0, "height": 590.0, "a": 25.0, "b": 150.0, "r1": 150.0, "r2": 110.0},
        source="Fu and Gao",
        study=Study(
            poses={"x": (-500.0, 500.0, 128), "y": (-500.0, 500.0, 128), "z": (-1500.0, 400.0, 256)},
            section={"l1": (-200.0, 200.0, 200), "l2": 0.0, "l3": (-200.0, 200.0, 200)},
            box={"l1": (-200.0, 200.0, 50), "l2": (-200.0, 200.0, 50), "l3": (-200.0, 200.0, 50)},
            joints=(0.0, 0.0, 0.0),
        ),
        options={
            "stroke": "low:high",
            "initial_lengths": "one or L10:L20:L30",
            "limb_angles": "eta1:eta2:eta3",
            "beta2": "angle",
            "orientation": "w:x:y:z",
            "elbows": "e1:e2:e3, each 1 or -1",
        },
    ),
    "five-bar": Entry(
        title="five-bar RR-RRR, a point in the plane by two cranks",
        module="jaxkin.mechanisms.five_bar",
        constructor="create",
        geometry={"base": 9.0, "proximal": (8.0, 8.0), "distal": (5.0, 5.0)},
        source="Chablat and Wenger 1998 (dimensions as quoted in later papers)",
        study=Study(
            poses={"x": (-14.0, 23.0, 512), "y": (-14.0, 14.0, 512)},
            section={"theta1": (*_TURN, 400), "theta2": (*_TURN, 400)},
            box={},
            joints=(1.0, 2.0),
        ),
    ),
}


def create(name: str, **changes: float | tuple[float, ...]) -> "Mechanism":
    """Makes a mechanism of the catalogue, with some of its geometry and options changed.

    Raises:
        InputError: The mechanism or a name of its geometry is unknown.
        GeometryError: The geometry is degenerate.
    """
    if name not in CATALOGUE:
        raise InputError(
            f"There is no mechanism {name!r}: choose one of {', '.join(CATALOGUE)}{meant(name, CATALOGUE)}"
        )
    entry = CATALOGUE[name]
    for key in changes:
        if key not in (*entry.geometry, *entry.options):
            names = ", ".join((*entry.geometry, *entry.options))
            raise InputError(f"Mechanism {name!r} has no geometry {key!r}: choose among {names}.")
        default, given = entry.geometry.get(key), changes[key]
        if default is not None and isinstance(given, tuple) and not isinstance(default, tuple):
            raise InputError(f"The geometry {key!r} of {name!r} is one number; got {given}.")
    constructor = getattr(importlib.import_module(entry.module), entry.constructor)
    return constructor(**{**entry.geometry, **changes})
