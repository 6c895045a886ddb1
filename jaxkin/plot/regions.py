"""Regions of a section of the joint space: where the number of assembly modes is constant."""

from typing import TYPE_CHECKING, Any, overload

import matplotlib.patheffects as effects
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from scipy.spatial import KDTree

from jaxkin.core.errors import InputError
from jaxkin.mapping._region_cells import Cells
from jaxkin.mapping._region_records import Regions
from jaxkin.plot import loci, style

if TYPE_CHECKING:
    from jaxkin.mapping.records import Cusps, SingularCurves

#: A region whose widest place is narrower than this share of the picture has its name beside it.
_ROOM = 0.022
#: A box is drawn in so many slices.
_MOST_SLICES = 6
#: Where a name beside its region may stand, in points from the region: directions are tried in turn.
_BESIDE = 17.0
_DIRECTIONS = 16
_NODE = {"marker": "D", "markersize": 3.2, "markerfacecolor": "white", "markeredgecolor": "black"}


@overload
def regions(
    result: Regions, ax: Axes | None = None, cusps: "Cusps | None" = None, curves: "SingularCurves | None" = None
) -> Axes: ...
@overload
def regions(result: Cells) -> np.ndarray: ...
def regions(
    result: Regions | Cells,
    ax: Axes | None = None,
    cusps: "Cusps | None" = None,
    curves: "SingularCurves | None" = None,
) -> Axes | np.ndarray:
    """Draws the regions of a section with their names, in the colours that maps give to numbers of solutions.

    Singular curves are drawn as in ``jk.plot.section``, with cusps as circles and the points where images of two
    singular poses cross as small squares. A region too narrow for its name has it beside. Cells of a box are drawn in
    six slices, with their names: equal names are one cell.

    Args:
        result: What ``jk.regions`` returned, over two or three free axes.
        ax: Where to draw a section; a new figure if not given.
        cusps: What ``jk.cusps`` returned for this section.
        curves: Singular curves of this section that are drawn in place of the record's own: closed forms have names.

    Returns:
        The Axes, with a legend beside them; of a box an array of them, one a slice.

    Raises:
        InputError: It is no such record, has no region, or cusps or curves are of another section or given for a box.
    """
    style.check_kind(result, (Regions, Cells), "regions, from jk.regions")
    if not len(result):
        raise InputError("There is no region to draw: give what jk.regions returned, of a section with solutions.")
    if isinstance(result, Cells):
        if not ax is cusps is curves is None:
            raise InputError("Axes, cusps and curves are for a section, and the regions are of a box: leave them out.")
        return _slices(result)
    free, fixed = loci.section_of(result)
    for given in (record for record in (cusps, curves) if record is not None):
        loci.check(given, free, fixed)
    if ax is None:
        _, ax = plt.subplots(figsize=(6.8, 4.6), layout="constrained")
    handles = _draw(ax, result, [region.name for region in result], curves, cusps)
    _add_legends(ax, _count_handles(result), handles)
    return ax


def _draw(
    ax: Axes, result: Regions, names: list[str], curves: "SingularCurves | None", cusps: "Cusps | None"
) -> list[Line2D]:
    """Draws a section; returns the legend's handles."""
    free, fixed = loci.section_of(result)
    ends = [result.request["section"][name][:2] for name in free]
    style.dress(ax, *((name, result.units[name]) for name in free))
    ax.set(xlim=ends[0], ylim=ends[1])
    for region in result:
        _fill(ax, [loci.free_points(result, line) for line in region.outline], region.n_solutions)
    handles = loci.draw(ax, result.curves if curves is None else curves, cusps)
    handles += _nodes(ax, loci.free_points(result, result.nodes.joints))
    _names(ax, result, names)
    ax.set_title(", ".join(style.value(name, value) for name, value in fixed.items()), fontsize="medium")
    return handles


def _slices(result: Cells) -> np.ndarray:
    """Draws some of the slices of a box, spread evenly over them."""
    chosen = np.unique(np.linspace(0, len(result.slices) - 1, _MOST_SLICES + 2).round().astype(int)[1:-1])
    names = [[region.name for region in section] for section in result.slices]
    for cell in result:
        for section, region in cell.slices:
            names[section][region] = cell.name
    columns = min(3, len(chosen))
    rows = -(-len(chosen) // columns)
    size = (3.3 * columns, 3.5 * rows + 0.6)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    for ax in axes.flat[len(chosen) :]:
        ax.set_axis_off()
    for ax, number in zip(axes.flat, chosen, strict=False):
        _draw(ax, result.slices[number], names[number], None, None)
        ax.label_outer()
    handles = _count_handles(result, "cell")
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize="small")
    return axes.ravel()[: len(chosen)]


def _fill(ax: Axes, outline: list[np.ndarray], count: int) -> None:
    """Fills a region, which lies to the left of all its lines: holes run the other way round."""
    vertices = np.concatenate([np.vstack([line, line[:1]]) for line in outline])
    codes = np.concatenate([[Path.MOVETO, *[Path.LINETO] * (len(line) - 1), Path.CLOSEPOLY] for line in outline])
    colour = style.count_colour(count)
    # Edges in the same colour close the gaps that antialiasing leaves between neighbours.
    ax.add_patch(PathPatch(Path(vertices, codes), facecolor=colour, edgecolor=colour, linewidth=0.3, zorder=1))


def _count_handles(result: Any, what: str = "region") -> list[Artist]:
    """Returns the legend's entries for numbers of solutions, with how many regions have them."""
    counts = np.array([region.n_solutions for region in result])
    return [
        Patch(
            facecolor=style.count_colour(int(n)),
            edgecolor="black",
            linewidth=0.6,
            label=f"{n}  ({np.sum(counts == n)} {what}{'s' if np.sum(counts == n) > 1 else ''})",
        )
        for n in np.unique(counts)
    ]


def _add_legends(ax: Axes, areas: list[Artist], lines: list[Any], title: str = "real solutions") -> None:
    """Adds a legend of areas at the upper right, and one of lines below it, both beside the Axes."""
    look: dict[str, Any] = {"frameon": False, "fontsize": "small"}
    first = ax.legend(handles=areas, title=title, loc="upper left", bbox_to_anchor=(1.01, 1.0), **look)
    if lines:
        ax.add_artist(first)
        first.set_clip_on(False)
        ax.legend(handles=lines, loc="lower left", bbox_to_anchor=(1.01, 0.0), **look)


def _nodes(ax: Axes, points: np.ndarray) -> list[Line2D]:
    low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
    points = points[np.all((points >= low) & (points <= high), axis=1)]
    if not len(points):
        return []
    label = f"{len(points)} node{'s' if len(points) > 1 else ''} (images cross)"
    return ax.plot(*points.T, linestyle="none", label=label, zorder=4, scalex=False, scaley=False, **_NODE)


def _names(ax: Axes, result: Regions, names: list[str]) -> None:
    """Writes the name of every region into it, or beside it where it is too narrow."""
    low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
    borders = [(loci.free_points(result, line) - low) / (high - low) for region in result for line in region.outline]
    tree = KDTree(np.concatenate([_dense(line) for line in borders]))
    halo: list[Any] = [effects.withStroke(linewidth=2, foreground="white", alpha=0.75)]
    taken: list[np.ndarray] = []
    for region, name in zip(result, names, strict=True):
        place = loci.free_points(result, region.interior[None])[0]
        share = (place - low) / (high - low)
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": "small", "zorder": 6}
        if tree.query(share)[0] >= _ROOM:
            ax.text(float(place[0]), float(place[1]), name, **look).set_path_effects(halo)
            taken.append(share)
            continue
        beside = _beside(share, tree, taken)
        taken.append(share + 0.05 * beside)
        line = {"arrowstyle": "-", "linewidth": 0.6, "shrinkA": 0.0, "shrinkB": 0.0}
        look |= {"textcoords": "offset points", "xytext": _BESIDE * beside, "arrowprops": line}
        ax.annotate(name, place, **look).set_path_effects(halo)


def _beside(share: np.ndarray, tree: KDTree, taken: list[np.ndarray]) -> np.ndarray:
    """Returns the direction in which a name stands farthest from borders and other names."""
    turns = 2 * np.pi * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    ways = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    places = share + 0.05 * ways
    room = np.minimum(tree.query(places)[0], np.min(np.minimum(places, 1 - places), axis=1))
    for other in taken:
        room = np.minimum(room, np.linalg.norm(places - other, axis=1) - 0.02)
    return ways[int(np.argmax(room))]


def _dense(line: np.ndarray, step: float = 0.004) -> np.ndarray:
    """Returns points of a closed line that are no farther apart than a step."""
    closed = np.vstack([line, line[:1]])
    lengths = np.linalg.norm(np.diff(closed, axis=0), axis=1)
    counts = np.maximum(np.ceil(lengths / step).astype(int), 1)
    return np.concatenate(
        [a + (b - a) * np.arange(n)[:, None] / n for a, b, n in zip(closed[:-1], closed[1:], counts, strict=True)]
    )
