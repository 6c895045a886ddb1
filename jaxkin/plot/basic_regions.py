"""Basic regions of the workspace, basic components of the joint space, and a uniqueness domain."""

from collections.abc import Sequence
from typing import Any

import matplotlib.patheffects as effects
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from scipy.spatial import Delaunay, QhullError

from jaxkin.core.errors import InputError
from jaxkin.mapping._characteristic_basic import BasicRegion, BasicRegions
from jaxkin.mapping._uniqueness import UniquenessDomain
from jaxkin.plot import boxes, layers, loci, style
from jaxkin.plot.shading import shaded

#: Components in turn; lighter ones again where there are more.
_COLOURS = tuple(style.OKABE_ITO[c] for c in ("sky", "vermillion", "green", "orange", "purple", "yellow", "blue"))
_GREY = "#DDDDDD"
_PALE = 0.5
#: Triangles with a longer side than this share of the section join points across what is no part of a region.
_LONGEST = 0.11
_OPACITY = 0.9
_ROOM = 0.05
_WIDTH, _HEIGHT = 3.9, 3.9


def basic_regions(
    result: BasicRegions, domain: UniquenessDomain | None = None, aspects: Sequence[int] | None = None
) -> np.ndarray:
    """Draws basic regions in the workspace, a uniqueness domain among them, and the basic components under them.

    A row has one aspect: its basic regions with their numbers, a uniqueness domain with the other regions in grey, and
    the basic components in the joint space. A region has the colour of its component: regions of one colour share
    their joints, and a uniqueness domain has each colour once at most. Characteristic curves are black. Regions are
    drawn from the points that the record has of them; narrow strips along their borders are left out.

    Args:
        result: What ``jk.basic_regions`` returned.
        domain: The uniqueness domain of its aspect; of every other one that with the most basic regions.
        aspects: Numbers of the aspects to draw; all if not given.

    Returns:
        The Axes, ``(number of aspects, 3)``.

    Raises:
        InputError: It is no such record, there is no region, or no such aspect.
    """
    style.check_kind(result, BasicRegions, "basic regions, from jk.basic_regions")
    if not len(result):
        raise InputError("There is no basic region to draw: choose a section with solutions in jk.basic_regions.")
    present = sorted({region.aspect for region in result})
    shown = present if aspects is None else list(aspects)
    if not shown or not set(shown) <= set(present):
        raise InputError(f"The aspects are {shown}: choose of {', '.join(map(str, present))}.")
    domains = result.uniqueness_domains()
    pieces = _triangulated(result)
    panels = _new(len(shown), len(_coordinates(result)))
    for row, aspect in zip(panels, shown, strict=True):
        best = _domain_of(aspect, domain, domains)
        _workspace(row[0], result, pieces, aspect, None)
        _workspace(row[1], result, pieces, aspect, best)
        _components(row[2], result, pieces, aspect)
        name = result.aspects[aspect].name
        row[0].set_title(f"basic regions, {style.words(name)}", **_title(row[0]))
        number = sum(own.aspect == aspect for own in domains)
        row[1].set_title(f"uniqueness domain, one of {number}: {_listed(result, best)}", **_title(row[1]))
        row[2].set_title("basic components", fontsize="small")
    handles = _handles(result, shown)
    panels[0, 0].figure.legend(
        handles=handles, loc="lower center", ncols=min(6, len(handles)), frameon=False, fontsize="small"
    )
    return panels


def _title(ax: Axes) -> dict[str, Any]:
    return {"fontsize": "small", **({"y": 0.97} if isinstance(ax, Axes3D) else {})}


def _domain_of(
    aspect: int, given: UniquenessDomain | None, domains: Sequence[UniquenessDomain]
) -> UniquenessDomain | None:
    if given is not None and given.aspect == aspect:
        return given
    return max((own for own in domains if own.aspect == aspect), key=len, default=None)


def _listed(result: BasicRegions, domain: UniquenessDomain | None) -> str:
    return "none" if domain is None else ", ".join(map(str, domain.regions))


def _coordinates(result: BasicRegions) -> list[str]:
    """Returns the pose coordinates that are drawn, two or three: lengths first where there are many."""
    names = list(result.pose_names)
    if len(names) <= 3:
        return names
    return sorted(names, key=lambda name: result.units[name] == "rad")[:3]


def _colour(component: int) -> np.ndarray:
    colour = np.array(to_rgb(_COLOURS[component % len(_COLOURS)]))
    return colour + _PALE * (1 - colour) if component // len(_COLOURS) % 2 else colour


# --- triangles ----------------------------------------------------------------------------------------------


def _triangulated(result: BasicRegions) -> list[np.ndarray]:
    """Returns for every basic region the triangles ``(m, 3)`` between its points, found over the joint space.

    Points of all components of an aspect are triangulated together: a triangle that joins two components lies in
    neither.
    """
    found: list[np.ndarray] = [np.zeros((0, 3), int) for _ in result]
    for region_number, region in enumerate(result):
        others = [own for own in result if own.aspect == region.aspect and own.component != region.component]
        # Regions over one component have nearly the same points there: one of each is enough.
        others = list({own.component: own for own in others}.values())
        own = _plane(result, region)
        points = np.concatenate([own, *(_plane(result, other) for other in others)])
        try:
            triangles = Delaunay(points, qhull_options="Qbb Qc Qz QJ").simplices
        except (QhullError, ValueError):
            continue
        triangles = triangles[(triangles < len(own)).all(axis=1)]
        corners = points[triangles]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        found[region_number] = triangles[sides.max(axis=1) < _LONGEST]
    return found


def _plane(result: BasicRegions, region: BasicRegion) -> np.ndarray:
    """Returns the joints of a region's points as shares of the section, ``(k, 2)``."""
    free, _ = loci.section_of(result)
    ends = np.array([result.request["section"][name][:2] for name in free], float)
    return (loci.free_points(result, region.over) - ends[:, 0]) / (ends[:, 1] - ends[:, 0])


def _continuous(result: BasicRegions, corners: np.ndarray) -> np.ndarray:
    """Tells the triangles ``(m, 3, n_pose)`` that do not reach over glued ends, nor from one sheet to another."""
    steps = np.abs(corners - np.roll(corners, 1, axis=1)).max(axis=1)
    size = np.maximum(np.ptp(corners.reshape(-1, corners.shape[-1]), axis=0), 1e-12) if len(corners) else 1.0
    angles = np.array([result.units[name] == "rad" for name in result.pose_names])
    return np.all(np.where(angles, steps < np.pi / 2, steps < 0.5 * size), axis=1)


# --- panels -------------------------------------------------------------------------------------------------


def _workspace(
    ax: Axes, result: BasicRegions, pieces: list[np.ndarray], aspect: int, domain: UniquenessDomain | None
) -> None:
    """Draws the regions of an aspect; with a domain the others are grey and only its regions are named."""
    names = _coordinates(result)
    columns = [result.pose_names.index(name) for name in names]
    numbers = [k for k, region in enumerate(result) if region.aspect == aspect]
    bright = numbers if domain is None else list(domain.regions)
    whole = [pieces[k][_continuous(result, result[k].poses[pieces[k]])] for k in numbers]
    shapes = [result[k].poses[:, columns][own] for k, own in zip(numbers, whole, strict=True)]
    paint = [_colour(result[k].component) if k in bright else np.array(to_rgb(_GREY)) for k in numbers]
    every = np.concatenate([result[k].poses[:, columns] for k in numbers])
    units = [result.units[name] for name in names]
    box = _box(every, units)
    lines = [curve.poses[:, columns] for curve in result.curves if _drawn(curve.regions, bright)]
    if isinstance(ax, Axes3D):
        boxes.frame(ax, names, units, box)
        scale = boxes.proportions(units, box) / (box[:, 1] - box[:, 0])
        colours = [shaded(colour, shape * scale) for colour, shape in zip(paint, shapes, strict=True)]
        layers.add_layers(ax, np.concatenate(shapes), np.concatenate(colours), _OPACITY)
    else:
        style.dress(ax, (names[0], units[0]), (names[1], units[1]))
        ax.set(xlim=box[0], ylim=box[1])
        for colour, shape in zip(paint, shapes, strict=True):
            ax.add_collection(_filled(shape, colour), autolim=False)
    for line in lines:
        for piece in _pieces(line, [unit == "rad" for unit in units]):
            ax.plot(*piece.T, color="black", linewidth=1.1, zorder=4)
    for k in bright:
        _write(ax, result[k].interior[columns], str(k))


def _filled(triangles: np.ndarray, colour: np.ndarray) -> PolyCollection:
    """Returns triangles in a colour, with edges in it that close the gaps antialiasing leaves."""
    return PolyCollection(list(triangles), facecolors=[colour], edgecolors=[colour], linewidths=0.3)  # type: ignore[arg-type]


def _drawn(regions: tuple[int, int], bright: Sequence[int]) -> bool:
    return regions[0] in bright and regions[1] in bright


def _components(ax: Axes, result: BasicRegions, pieces: list[np.ndarray], aspect: int) -> None:
    """Draws the components of an aspect in the joint space."""
    free, fixed = loci.section_of(result)
    style.dress(ax, *((name, result.units[name]) for name in free))
    ends = [result.request["section"][name][:2] for name in free]
    ax.set(xlim=ends[0], ylim=ends[1])
    drawn = set()
    for region, triangles in zip(result, pieces, strict=True):
        if region.aspect != aspect or region.component in drawn:
            continue
        drawn.add(region.component)
        colour = _colour(region.component)
        points = loci.free_points(result, region.over)
        shape = _filled(points[triangles], colour)
        ax.add_collection(shape, autolim=False)
        corners = points[triangles]
        if len(corners):
            # The largest triangle is away from the border, where points are dense.
            along, across = (corners[:, k] - corners[:, 0] for k in (1, 2))
            largest = int(np.argmax(np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])))
            _write(ax, corners[largest].mean(axis=0), style.words(result.components[region.component].name))
    for curve in result.curves:
        if result[curve.regions[0]].aspect == aspect:
            for piece in loci.unglued(result, curve.joints):
                ax.plot(*piece.T, color="black", linewidth=0.9, zorder=4)
    if fixed:
        ax.set_xlabel(f"{ax.get_xlabel()}   [{', '.join(style.value(*pair) for pair in fixed.items())}]")


def _write(ax: Any, place: np.ndarray, text: str) -> None:
    label = ax.text(*place, text, ha="center", va="center", fontsize="x-small", zorder=10)
    label.set_path_effects([effects.withStroke(linewidth=2, foreground="white", alpha=0.8)])


def _box(points: np.ndarray, units: Sequence[str]) -> np.ndarray:
    low, high = points.min(axis=0), points.max(axis=0)
    room = _ROOM * np.maximum(high - low, 1e-9)
    box = np.stack([low - room, high + room], axis=1)
    for k, unit in enumerate(units):
        if unit == "rad" and high[k] - low[k] > 0.9 * 2 * np.pi:
            box[k] = -np.pi, np.pi
    return box


def _pieces(line: np.ndarray, angles: Sequence[bool]) -> list[np.ndarray]:
    """Cuts a line where an angle goes over its glued ends."""
    jumps = np.any((np.abs(np.diff(line, axis=0)) > np.pi) & np.array(angles), axis=1)
    return np.split(line, np.flatnonzero(jumps) + 1)


def _handles(result: BasicRegions, shown: Sequence[int]) -> list[Artist]:
    """Returns the legend's entries: a component each, with the number of its regions."""
    numbers = sorted({region.component for region in result if region.aspect in shown})
    return [
        Patch(
            facecolor=tuple(_colour(number)),
            label=f"{style.words(result.components[number].name)}: {len(result.components[number].regions)} regions",
        )
        for number in numbers
    ]


def _new(rows: int, dimensions: int) -> np.ndarray:
    """Returns new Axes ``(rows, 3)``, placed by hand: constrained layout does not see 3D labels."""
    below = 0.35
    size = (3 * _WIDTH, _HEIGHT * rows + below)
    figure = plt.figure(figsize=size)
    found = np.empty((rows, 3), object)
    for row in range(rows):
        bottom, high = (below + _HEIGHT * (rows - 1 - row)) / size[1], _HEIGHT / size[1]
        for column in range(3):
            if column < 2 and dimensions == 3:
                place = (column / 3, bottom + 0.08 * high, 0.31, 0.9 * high)
                found[row, column] = figure.add_axes(place, projection="3d")
            else:
                place = (column / 3 + 0.065, bottom + 0.18 * high, 0.25, 0.7 * high)
                found[row, column] = figure.add_axes(place)
    return found
