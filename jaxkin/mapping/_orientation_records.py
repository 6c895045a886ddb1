"""What maps of the orientation space are made of: aspects, closed solids, balls of rotations, reachable shares."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.mapping import _isosurface

#: Name of the faces of a solid on which no factor vanishes: where the chart ends.
CHART = "chart"


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed solid: an aspect in a chart of the orientations, or the joints with assembly modes.

    Attributes:
        label: What it is, for instance ``"R22 > 0, R33 > 0"``.
        chart: ``"xyz"``, ``"zxy"`` or ``"joints"``. Shape and volume belong to it, and not to the robot.
        axes: Names of the three coordinates.
        units: Their units.
        vertices: ``(k, 3)``; angles are not wrapped, so that a solid is in one piece.
        faces: ``(m, 3)`` vertex numbers, counterclockwise seen from outside. Every edge has two triangles.
        names: Names of the patches: what vanishes there, ``"chart"`` where it is only the chart that ends.
        patch: ``(m,)`` number of each triangle's patch among the names.
        residual: Largest absolute value, over the vertices, of the factors (divided by the side for joints) that must
            vanish there.
    """

    label: str
    chart: str
    axes: tuple[str, str, str]
    units: tuple[str, str, str]
    vertices: np.ndarray
    faces: np.ndarray
    names: tuple[str, ...]
    patch: np.ndarray
    residual: float

    @property
    def volume(self) -> float:
        """Volume that the triangles enclose, in the units of the axes."""
        centred = self.vertices - self.vertices.mean(axis=0)
        a, b, c = np.moveaxis(centred[self.faces], 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)

    @property
    def edges(self) -> np.ndarray:
        """``(e, 2)`` vertex numbers of the triangles' sides between two different patches: the outlines to draw."""
        sides = _isosurface.all_edges(self.faces)
        patch = np.tile(self.patch, 3)
        order = np.lexsort((sides[:, 1], sides[:, 0]))
        sides, patch = sides[order].reshape(-1, 2, 2), patch[order].reshape(-1, 2)
        return sides[patch[:, 0] != patch[:, 1], 0]

    def on(self, name: str) -> np.ndarray:
        """Returns the faces of one patch, ``(k, 3)``."""
        return self.faces[self.patch == self.names.index(name)]

    def __str__(self) -> str:
        """A summary of one line."""
        return (
            f"{self.label} in the chart {self.chart}: {len(self.vertices)} vertices, {len(self.faces)} triangles on "
            f"{', '.join(self.names)}, volume {self.volume:.9g}, residual {self.residual:.1e}"
        )

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        return json.dumps(_plain(self) | {"volume": self.volume}, indent=2)


@dataclass(frozen=True, eq=False)
class OrientationAspect:
    """One aspect of the orientation space: the rotations at which the factors have these signs.

    Attributes:
        label: For instance ``"R22 > 0, R33 > 0"``.
        signs: Sign of every factor, 1 or -1.
        rotation: ``(3, 3)`` a rotation deep inside: where the product of the factors is largest in size.
        share: Share of all rotations (Haar measure), which belongs to no chart.
        share_error: Estimate of its error.
        volume: Volume in the X-Y-Z Euler chart, rad^3; it belongs to the chart.
        volume_error: Estimate of its error.
        neighbours: Label of the aspect across each factor's surface, by the name of the factor.
    """

    label: str
    signs: tuple[int, ...]
    rotation: np.ndarray
    share: float
    share_error: float
    volume: float
    volume_error: float
    neighbours: dict[str, str]


class UnknownAspect(InputError, KeyError):
    """No aspect has this label; a KeyError as for every mapping."""

    def __str__(self) -> str:
        """The sentence itself, which a KeyError would put in quotation marks."""
        return str(self.args[0])


@dataclass(frozen=True, eq=False)
class OrientationAspects(Sequence[OrientationAspect]):
    """All aspects of the orientation space.

    Attributes:
        aspects: In the order of the signs, positive first: the first is the home aspect.
        factors: Names of the factors.
        request: What determines the numbers: mechanism, geometry, tolerance.
    """

    aspects: tuple[OrientationAspect, ...]
    factors: tuple[str, ...]
    request: dict[str, Any]

    @overload
    def __getitem__(self, index: int | str) -> OrientationAspect: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[OrientationAspect, ...]: ...
    def __getitem__(self, index: int | str | slice) -> OrientationAspect | tuple[OrientationAspect, ...]:
        """Returns one aspect, by number or label (``"home"`` is the first), or a tuple of them.

        Raises:
            UnknownAspect: There is no such label; it is an InputError and a KeyError.
        """
        if isinstance(index, str):
            for aspect in self.aspects[:1] if index == "home" else self.aspects:
                if index in ("home", aspect.label):
                    return aspect
            known = ", ".join(repr(a.label) for a in self.aspects)
            raise UnknownAspect(f"There is no aspect {index!r}: they are {known}, or 'home'; give one of these.")
        return self.aspects[index]

    def __len__(self) -> int:
        """Number of aspects."""
        return len(self.aspects)

    def __iter__(self) -> Iterator[OrientationAspect]:
        """Runs over the aspects."""
        return iter(self.aspects)

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [f"{len(self)} aspects by the signs of {', '.join(self.factors)}"]
        for a in self.aspects:
            lines.append(
                f"  {a.label}: share of rotations {a.share:.10f} +- {a.share_error:.0e}, volume in the X-Y-Z chart "
                f"{a.volume:.9f} +- {a.volume_error:.0e}; "
                + ", ".join(f"across {name} = 0: {label}" for name, label in a.neighbours.items())
            )
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        return json.dumps(
            {"request": self.request, "factors": list(self.factors), "aspects": [_plain(a) for a in self.aspects]},
            indent=2,
        )


@dataclass(frozen=True, eq=False)
class RotationBall:
    """The largest ball of rotations about a centre that holds no singularity; it belongs to no chart.

    Attributes:
        center: ``(3, 3)`` the rotation in the middle.
        radius: Angle of the nearest singular rotation, rad; pi (all of SO(3)) if there is none.
        factor: The factor that vanishes there.
        radii: Angle to the nearest rotation at which each factor vanishes, by name; ``inf`` where none was found.
        touching: ``(k, 3, 3)`` nearest singular rotations, one for each start that ended at the radius; where they
            form a curve these are points of it.
        touching_factor: ``(k,)`` number of the factor that vanishes at each, among the names of ``radii``.
        residual: Largest absolute value of that factor at the touching rotations.
        share: Share of all rotations in the ball, (radius - sin radius) / pi.
        starts: Starts made for each factor.
        converged: Starts that ended at a stationary angle, by the name of the factor.
    """

    center: np.ndarray
    radius: float
    factor: str
    radii: dict[str, float]
    touching: np.ndarray
    touching_factor: np.ndarray
    residual: float
    share: float
    starts: int
    converged: dict[str, int]

    def __str__(self) -> str:
        """A summary of one line."""
        radii = ", ".join(f"{name} = 0 at {np.degrees(angle):.9g} degrees" for name, angle in self.radii.items())
        return f"largest ball of rotations: {np.degrees(self.radius):.9g} degrees ({radii}), share {self.share:.9f}"

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        return json.dumps(_plain(self), indent=2)


@dataclass(frozen=True, eq=False)
class ReachableShare:
    """How much of an aspect is reachable at a position under the joint limits.

    Attributes:
        position: ``(3,)``.
        label: The aspect.
        share: Share of all rotations (Haar measure) that lie in the aspect and within all limits.
        share_error: Estimate of its error.
        aspect_share: Share of the whole aspect, without limits.
        volume: Volume in the X-Y-Z Euler chart, rad^3; it belongs to the chart.
        volume_error: Estimate of its error.
        binding: Share of all rotations that each limit forbids by itself within the aspect, by the name of its margin,
            the most binding first; limits that forbid nothing are left out.
    """

    position: np.ndarray
    label: str
    share: float
    share_error: float
    aspect_share: float
    volume: float
    volume_error: float
    binding: dict[str, float]

    def __str__(self) -> str:
        """A summary of a few lines."""
        place = ", ".join(f"{value:.6g}" for value in self.position)
        lines = [
            f"at ({place}), aspect {self.label}: {self.share:.9g} +- {self.share_error:.0e} of all rotations, "
            f"{self.share / self.aspect_share:.4%} of the aspect; {self.volume:.9g} +- {self.volume_error:.0e} rad^3 "
            "of the X-Y-Z chart"
        ]
        lines += [f"  {name} alone forbids {value:.6g} of all rotations" for name, value in self.binding.items()]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        return json.dumps(_plain(self), indent=2)


def _plain(record: Any) -> dict[str, Any]:
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(record).items()}
