"""Spatial mechanisms in three dimensions: base, joints, links and platform."""

import itertools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D, proj3d
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from jaxkin.core.bodies import Body
from jaxkin.core.mechanism import Axis
from jaxkin.plot import style
from jaxkin.plot.shading import shaded

#: Actuated joints are blue, passive ones white and the platform is green in Chablat et al. 2018, Fig. 1.
COLOURS = {
    "base": "#8C8C8C",
    "platform": style.OKABE_ITO["green"],
    "actuated": style.OKABE_ITO["blue"],
    "passive": "#FFFFFF",
    "link": "#555555",
    "axis": "#777777",
}
#: Widths of lines in points.
_WIDTHS = {"base": 2.2, "actuated": 3.0, "passive": 2.0, "link": 1.6, "axis": 0.8}
#: A line is cut into so many pieces, each of which is in front or behind by itself.
_PIECES = 8
#: Letters stand off their points by this share of the picture.
_LETTER = 0.055
#: Drawn over every line and plate, however near that is.
ON_TOP = 1000
#: Elevation of the view, and how far it is turned from the middle of a wide gap between the limbs, degrees.
_ABOVE, _BESIDE = 26.0, 38.0


def draw(
    ax: Axes3D, bodies: Sequence[Body], edge: str | None = None, *, letters: bool = True, size: float = 1.0
) -> None:
    """Draws the parts of a mechanism.

    Args:
        ax: Where.
        bodies: The parts.
        edge: Colour of the platform's outline.
        letters: Whether joints have their names beside them.
        size: Length of the picture's longest side, for the letters' distance.
    """
    for body in bodies:
        if body.kind == "joint":
            continue
        if body.closed:
            _plate(ax, body, edge)
        elif body.width > 0:
            bar(ax, body.points, body.width, COLOURS[body.kind])
        else:
            _line(ax, body)
    joints = [body for body in bodies if body.kind == "joint"]
    if not joints:
        return
    points = np.array([body.points[0] for body in joints])
    look = {"markersize": 4.0, "markerfacecolor": "white", "markeredgecolor": "black", "markeredgewidth": 0.8}
    ax.plot(*points.T, linestyle="none", marker="o", zorder=ON_TOP, **look)
    if letters:
        # Outward on the level, and to the right of the picture: limbs go upward from their joints.
        turn = math.radians(ax.azim)
        right = np.array([-math.sin(turn), math.cos(turn), 0.0])
        away = (points - points.mean(axis=0)) * [1.0, 1.0, 0.0]
        away /= np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-3 * size)
        away = away + 0.7 * right
        away *= _LETTER * size / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
        for body, place in zip(joints, points + away, strict=True):
            x, y, z = place
            ax.text(x, y, z, style.symbol(body.name), ha="center", va="center", fontsize="x-small", zorder=ON_TOP + 1)


def _plate(ax: Axes3D, body: Body, edge: str | None) -> None:
    platform = body.kind == "platform"
    colour = COLOURS[body.kind]
    plate = Poly3DCollection(
        [body.points],
        facecolors=[(*to_rgb(colour), 0.55 if platform else 0.22)],
        edgecolors=[edge or colour if platform else colour],
        linewidths=1.8 if platform else 0.8,
    )
    ax.add_collection3d(plate, autolim=False)


def _line(ax: Axes3D, body: Body) -> None:
    width = _WIDTHS[body.kind]
    look: dict[str, Any] = {"colors": COLOURS[body.kind], "linewidths": width}
    if body.kind == "axis":
        look["linestyles"] = [(0, (2, 2))]
    if body.kind == "passive":
        look["path_effects"] = [Stroke(linewidth=width + 1.4, foreground="#444444"), Normal()]
    if body.kind == "base":
        # Below everything, as joints slide along it.
        ax.plot(*body.points.T, color=COLOURS["base"], linewidth=width, zorder=1, solid_joinstyle="miter")
        return
    for start, end in itertools.pairwise(body.points):
        # Dashes would start anew in every piece.
        pieces = 1 if body.kind == "axis" else _PIECES
        ends = np.linspace(0.0, 1.0, pieces + 1)
        for low, high in itertools.pairwise(ends):
            # Pieces overlap a little, or their seams are seen.
            share = np.array([low, min(high + 0.1 / pieces, 1.0)])[:, None]
            piece = start + share * (end - start)
            ax.add_collection3d(Line3DCollection([piece], capstyle="butt", **look), autolim=False)


def bar(ax: Axes3D, ends: np.ndarray, width: float, colour: str, alpha: float = 1.0) -> None:
    """Draws a bar of square cross-section between two points ``(2, 3)``; its roll angle is the drawing's choice."""
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if length == 0:
        return
    along = along / length
    across = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    across /= np.linalg.norm(across)
    up = np.cross(along, across)
    half = width / 2
    ring = half * np.array([across + up, up - across, -across - up, across - up])
    low, high = ends[0] + ring, ends[1] + ring
    sides = [np.array([low[k], low[k - 1], high[k - 1], high[k]]) for k in range(4)]
    faces = np.array([*sides, low, high])
    paint = np.c_[shaded(np.array(to_rgb(colour)), faces[:, :3]), np.full(6, alpha)]
    ax.add_collection3d(
        Poly3DCollection(faces, facecolors=paint, edgecolors=(0.0, 0.0, 0.0, 0.6 * alpha), linewidths=0.3),
        autolim=False,
    )


def arrow(ax: Axes3D, start: np.ndarray, along: np.ndarray, colour: str) -> None:
    """Draws an arrow over everything else."""
    ax.quiver(*start, *along, color=colour, linewidth=1.8, arrow_length_ratio=0.25, zorder=ON_TOP)


def limits(bodies: Sequence[Body], margin: float = 0.04) -> np.ndarray:
    """Returns low and high ends ``(3, 2)`` of a box about all parts, none of its sides very short."""
    points = np.concatenate([body.points for body in bodies])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, size = (low + high) / 2, float((high - low).max()) or 1.0
    half = np.maximum((high - low) / 2, 0.12 * size) + margin * size
    return np.stack([middle - half, middle + half], axis=1)


def view(bodies: Sequence[Body]) -> float:
    """Returns the azimuth, degrees, from which no limb hides the platform: through the widest gap between the limbs."""
    feet = {body.limb: body.points[0] for body in reversed(bodies) if body.kind == "joint" and body.limb is not None}
    if len(feet) < 2:
        return -60.0
    points = np.array([feet[limb] for limb in sorted(feet)])
    centre = points.mean(axis=0)
    around = np.sort(np.degrees(np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0])))
    gaps = np.diff(np.append(around, around[0] + 360.0))
    middles = (around + gaps / 2 + 180.0) % 360.0 - 180.0
    # Of gaps as wide as each other the one that is seen with x to the right.
    best = int(np.argmax(gaps - 1e-3 * np.abs(middles + 60.0)))
    return float(middles[best] + (_BESIDE if gaps[best] > 150.0 else 6.0))


def frame(ax: Axes3D, box: np.ndarray, axes: Sequence[Axis], azimuth: float, elevation: float = _ABOVE) -> None:
    """Gives Axes one scale in all directions, labels with units, and a view."""
    ax.set(xlim=box[0], ylim=box[1], zlim=box[2])
    ax.set_box_aspect(box[:, 1] - box[:, 0])  # type: ignore[arg-type]
    ax.view_init(elevation, azimuth)
    ax.set_proj_type("persp", focal_length=2.0)
    ax.grid(False)
    sides = box[:, 1] - box[:, 0]
    each: tuple[Any, ...] = (ax.xaxis, ax.yaxis, ax.zaxis)
    for axis, coordinate, side in zip(each, axes, sides, strict=False):
        axis.set_label_text(style.axis_label(coordinate.name, coordinate.unit), fontsize="small")
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_linewidth(0.6)
        if coordinate.is_angle and side >= math.pi:
            style.ticks_in_pi(axis)
        else:
            axis.set_major_locator(MaxNLocator(max(2, round(4 * side / sides.max())), steps=[1, 2, 5, 10]))
        axis.set_tick_params(labelsize="x-small", pad=-1.0)
        axis.labelpad = 0.0
    part_tick_labels(ax)
    upright_labels(ax, 6.9)
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.label.set_rotation(90.0)


def part_tick_labels(ax: Axes3D) -> None:
    """Moves the tick labels of the two level axes away from the corner in which they meet, from the present view."""
    cos, sin = math.cos(math.radians(ax.azim)), math.sin(math.radians(ax.azim))
    for axis, toward_right in ((ax.xaxis, math.copysign(sin, sin * cos)), (ax.yaxis, -math.copysign(cos, sin * cos))):
        for label in axis.get_ticklabels():
            label.set_horizontalalignment("left" if toward_right > 0 else "right")


#: Matplotlib adds these to the pads of tick labels and of the name of an axis in three dimensions, and moves them away
#: from the middle by this share of the box for each 1/48 of the Axes' points.
_TICKS_AT, _NAME_AT, _MOVED = 8.0, 21.0, 0.08
#: Width of a digit, as a share of the size of its font.
_DIGIT = 0.64
#: Between an axis line, its tick labels and its name, points.
_GAP = 6.0


def upright_labels(ax: Axes3D, size: float) -> None:
    """Moves the tick labels of the upright axis off its line, and its name off them, from the present view.

    Args:
        ax: Framed Axes with ticks.
        size: Of the font of the tick labels, points.
    """
    right = math.sin(math.radians(ax.azim)) * math.cos(math.radians(ax.azim)) < 0
    for label in ax.zaxis.get_ticklabels():
        label.set_horizontalalignment("left" if right else "right")
    low, high = ax.get_zlim()
    ticks = [tick for tick in ax.zaxis.get_majorticklocs() if low <= tick <= high]
    longest = max(map(len, ax.zaxis.get_major_formatter().format_ticks(ticks)), default=1)
    points = _points_per_pad(ax, right=right)
    ax.zaxis.set_tick_params(pad=_GAP / points - _TICKS_AT)
    ax.zaxis.labelpad = (2 * _GAP + _DIGIT * size * longest + 4.0) / points - _NAME_AT


def _points_per_pad(ax: Axes3D, *, right: bool) -> float:
    """Returns how far, in points across the picture, the labels of the upright axis move for each unit of their pad."""
    turn = math.radians(ax.azim)
    # The upright axis stands at the outermost corner of the box.
    outward = np.sign([-math.sin(turn), math.cos(turn), 0.0]) * (1 if right else -1)
    box = np.array([ax.get_xlim(), ax.get_ylim(), ax.get_zlim()])
    middle, sides = box.mean(axis=1), box[:, 1] - box[:, 0]
    # Axes of three dimensions become square, and move labels by the sum of their sides.
    size = 72 * min(ax.bbox.size) / ax.figure.dpi  # type: ignore[union-attr]
    moved = _MOVED * 48 / (2 * size)
    corner = middle + outward * sides / 2
    ends = np.stack([corner, corner + moved * outward * sides])
    across = _flat(ax, ends)[:, 0]
    return max(abs(float(across[1] - across[0])) * size, 0.2)


_LEGEND_NAMES = {"actuated": "actuated joint", "passive": "passive joint", "base": "base"}


def handles(bodies: Sequence[Body]) -> list[Artist]:
    """Returns the legend's entries for the kinds of parts there are."""
    kinds = {body.kind for body in bodies}
    found: list[Artist] = []
    for kind, label in _LEGEND_NAMES.items():
        if kind in kinds:
            look: dict[str, Any] = {"color": COLOURS[kind], "linewidth": _WIDTHS[kind]}
            if kind == "passive":
                look["path_effects"] = [Stroke(linewidth=_WIDTHS[kind] + 1.4, foreground="#444444"), Normal()]
            found.append(Line2D([], [], label=label, **look))
    if any(body.width > 0 for body in bodies):
        look = {"facecolor": COLOURS["link"], "edgecolor": "black", "linewidth": 0.3}
        found.append(Patch(label="links of the wrists [ours]", **look))
    return found


def sign_handles(signs: Sequence[int]) -> list[Artist]:
    """Returns the legend's entries for platforms by the sign of the determinant."""
    face = (*to_rgb(COLOURS["platform"]), 0.55)
    word = {1: "> 0", -1: "< 0", 0: "= 0"}
    return [
        Patch(facecolor=face, edgecolor=style.SIGN_COLOURS[s], linewidth=1.8, label=f"platform, det {word[s]}")
        for s in (1, -1, 0)
        if s in signs
    ]


class Room(NamedTuple):
    """Inches around the drawn box, for ticks and labels, and for the title."""

    left: float = 0.64
    right: float = 0.7
    below: float = 0.5
    above: float = 0.3


_ROOM = Room()


def panels(count: int) -> list[Axes3D]:
    """Returns Axes of a new figure; ``fit`` gives them their places."""
    import matplotlib.pyplot as plt

    figure = plt.figure()
    axes = (figure.add_axes((0.0, 0.0, 1.0, 1.0), projection="3d", label=str(k)) for k in range(count))
    return [cast(Axes3D, ax) for ax in axes]


def fit(
    axes: Sequence[Axes3D],
    titles: Sequence[str],
    *,
    columns: int = 2,
    width: float = 3.5,
    tallest: float = 3.4,
    top: float = 0.0,
    legend: float = 0.4,
    room: Room = _ROOM,
    points: np.ndarray | None = None,
) -> None:
    """Sizes a figure for its framed Axes, and writes titles above them.

    Constrained layout does not see how far labels in three dimensions reach.

    Args:
        axes: All Axes of the figure, framed alike.
        titles: One each.
        columns: Panels side by side.
        width: Of a panel, inches.
        tallest: The largest height of the drawn box, inches.
        top: Height for a title over all, inches.
        legend: Height for a legend below all, inches.
        room: Around each box.
        points: ``(k, 3)`` what is drawn; the whole box if not given.
    """
    columns = min(columns, len(axes))
    rows = math.ceil(len(axes) / columns)
    low, high = _seen(axes[0], points)
    # Axes of three dimensions are square, and the box fills a part of them.
    side = float(min((width - room.left - room.right) / (high - low)[0], tallest / (high - low)[1]))
    above = room.above + 0.14 * max(title.count("\n") for title in titles)
    height = side * float((high - low)[1]) + room.below + above
    whole = np.array([width * columns, height * rows + top + legend])
    figure = axes[0].figure
    figure.set_size_inches(*whole)  # type: ignore[union-attr]
    for k, (ax, title) in enumerate(zip(axes, titles, strict=True)):
        row, column = divmod(k, columns)
        corner = np.array([width * column, whole[1] - top - height * (row + 1)])
        span = np.array([width - room.left - room.right, height - above - room.below])
        start = corner + [room.left, room.below] + span / 2 - side * (low + high) / 2
        # Square Axes reach over their neighbours.
        ax.patch.set_visible(False)
        ax.set_position((*(start / whole), *(side / whole)))
        # set_title lowers what it is given; what it is given also stops it from looking for a place of its own.
        ax.set_title(title, fontsize="small", y=1.0, pad=0.0).set_y(float(high[1]) + 0.1 / side)


def _seen(ax: Axes3D, points: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Returns the lower left and the upper right end of the picture with its axes, as shares of the Axes."""
    ends = (ax.get_zlim(), ax.get_xlim(), ax.get_ylim())
    corners = np.roll(np.array(list(itertools.product(*ends))), -1, axis=1)
    flat = _flat(ax, corners)
    if points is not None:
        # The upright axis is at the left or at the right; the other two upper corners may be empty.
        order = np.argsort(flat[4:, 0]) + 4
        flat = np.concatenate([flat[:4], flat[order[[0, -1]]], _flat(ax, points)])
    return flat.min(axis=0), flat.max(axis=0)


def _flat(ax: Axes3D, points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    x, y, _ = proj3d.proj_transform(x, y, z, ax.get_proj())
    return ax.transLimits.transform(np.stack([x, y], axis=1))


def legend(ax: Axes3D, entries: list[Artist], columns: int, *, own: bool) -> None:
    """Adds a legend: at the bottom of a figure of our own, or below given Axes."""
    look: dict[str, Any] = {"handles": entries, "frameon": False, "fontsize": "x-small", "columnspacing": 1.4}
    if own:
        figure: Any = ax.figure
        look |= {"loc": "lower center", "bbox_to_anchor": (0.5, 0.0), "bbox_transform": figure.transFigure}
    else:
        look |= {"loc": "upper center", "bbox_to_anchor": (0.5, -0.06)}
    ax.legend(ncols=columns, **look)
