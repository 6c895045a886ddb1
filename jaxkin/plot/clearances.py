"""Links of the TLPM's wrists that come close to each other.

The paper names the condition; sizes and places of the links are our completion [ours].
"""

import math
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from jax.typing import ArrayLike
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize, to_hex
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Rectangle
from mpl_toolkits.mplot3d import Axes3D

from jaxkin.core.bodies import Body
from jaxkin.mechanisms import _tlpm_wrist
from jaxkin.numerics import segments
from jaxkin.plot import spatial, style
from jaxkin.plot.poses import new_or_given
from jaxkin.plot.wrists import checked, letter, near_wrist, reach_note

if TYPE_CHECKING:
    from jaxkin.mechanisms.tlpm import TLPM

#: A link with a distance below the limit.
_TOO_CLOSE = style.OKABE_ITO["vermillion"]
#: Pairs of links that get a line with their distance, at most.
_MOST_PAIRS = 4
#: Elevation and azimuth of the view, degrees.
_VIEW = (24.0, -52.0)
#: Fu and Gao print sqrt(a); see ``jaxkin.mechanisms._tlpm_wrist``.
_LIMIT = r"$\sqrt{2}\,a$"


def interference(robot: "TLPM", pose: ArrayLike, ax: Axes | None = None) -> Axes3D:
    """Draws the links of a TLPM's wrists, coloured by their clearance from the links of other limbs (after Fig. 6).

    A link has the colour of its smallest clearance D - sqrt(2) a, D being the distance of two links' axes. Below the
    limit it is vermillion, which says "not proven free", not "interfering". Lines join the closest points of up to four
    pairs below the limit, or of the closest pair, and bear the distance. The links' sizes and places are our completion
    of the paper, and their roll about their axes is the drawing's. The title says where the pose is outside the
    strokes.

    Args:
        robot: A TLPM.
        pose: ``(3,)``, mm.
        ax: Axes with ``projection="3d"``; a new figure if not given.

    Returns:
        The Axes, with a colour bar and a legend.

    Raises:
        InputError: The robot is no TLPM, the pose has another shape or is not finite, or the Axes are flat.
    """
    p = checked(robot, pose)
    own, ax = ax is None, new_or_given(ax)
    clear = {str(name): float(value) for name, value in _tlpm_wrist.link_clearances(robot, p).items()}
    ends: dict[str, np.ndarray] = dict(
        zip(_tlpm_wrist.LINK_NAMES, np.asarray(_tlpm_wrist.links(robot, p)), strict=True)
    )
    least = {link: min(c for pair, c in clear.items() if link in pair.split("-")) for link in ends}
    colours = plt.get_cmap("viridis").with_extremes(under=_TOO_CLOSE)
    norm = Normalize(0.0, max(1e-9 * float(robot.r1), *least.values()))
    bodies = near_wrist(robot, p)
    points = np.concatenate([*ends.values(), *(body.points for body in bodies)])
    box = spatial.limits([Body("", points, "axis")])
    spatial.frame(ax, box, robot.pose_axes, _VIEW[1], _VIEW[0])
    spatial.draw(ax, bodies, letters=False)
    for name, link in ends.items():
        spatial.bar(ax, link, float(robot.a), to_hex(colours(norm(least[name]))), alpha=0.85)
        letter(ax, 0.65 * link[0] + 0.35 * link[1], p, style.symbol(name))
    limit = math.sqrt(2.0) * float(robot.a)
    for pair in _shown_pairs(clear):
        first, second = (ends[name] for name in pair.split("-"))
        _distance_line(ax, first, second, clear[pair] + limit, below=clear[pair] < 0)
    title = reach_note(robot, p) + _title(clear, limit)
    _finish(ax, title, own, ScalarMappable(norm, colours), any(c < 0 for c in clear.values()), points)
    return ax


def _title(clear: dict[str, float], limit: float) -> str:
    closest = min(clear, key=lambda pair: clear[pair])
    first, second = map(style.symbol, closest.split("-"))
    verdict = "not proven free" if clear[closest] < 0 else "free"
    return (
        f"closest links: {first} and {second}, $D$ = {_mm(clear[closest] + limit)}\n"
        f"limit {_LIMIT} = {_mm(limit)}: {verdict}  [ours]"
    )


def _shown_pairs(clear: dict[str, float]) -> list[str]:
    """Returns the pairs of links that get a line: the closest ones below the limit, at least the closest of all."""
    order = sorted(clear, key=lambda pair: clear[pair])
    below = sum(value < 0 for value in clear.values())
    return order[: min(max(below, 1), _MOST_PAIRS)]


def _distance_line(ax: Axes3D, first: np.ndarray, second: np.ndarray, distance: float, *, below: bool) -> None:
    u, v = first[1] - first[0], second[1] - second[0]
    shares = segments.closest(*(tuple(vector) for vector in (first[0], u, second[0], v)))  # type: ignore[arg-type]
    points = np.array([first[0] + float(shares[0]) * u, second[0] + float(shares[1]) * v])
    ink = _TOO_CLOSE if below else "black"
    ax.plot(*points.T, color=ink, linewidth=1.4, marker="o", markersize=3.0, zorder=spatial.ON_TOP)
    x, y, z = points.mean(axis=0)
    look: dict[str, Any] = {"fontsize": "x-small", "ha": "left", "va": "bottom", "zorder": spatial.ON_TOP + 2}
    text = ax.text(x, y, z, f"{distance:.1f}", **look)
    text.set_bbox({"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 0.6})


def _mm(length: float) -> str:
    return f"{length:.1f} mm".replace("-", "−")


def _finish(ax: Axes3D, title: str, own: bool, colours: ScalarMappable, below: bool, points: np.ndarray) -> None:
    """Adds title, legend and colour bar."""
    entries: list[Artist] = [Patch(facecolor=_TOO_CLOSE, label=f"$D$ < {_LIMIT}: not proven free")] if below else []
    look: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 3.0, "linewidth": 1.4}
    entries.append(Line2D([], [], label="closest points, $D$ in mm", **look))
    spatial.legend(ax, entries, columns=2, own=own)
    figure: Any = ax.figure
    if own:
        spatial.fit([ax], [title], legend=0.78, points=points, room=spatial.Room(above=0.42))
        height = figure.get_figheight()
        place = figure.add_axes((0.14, 0.66 / height, 0.72, 0.09 / height))
        bar = figure.colorbar(colours, cax=place, orientation="horizontal", extend="min" if below else "neither")
    else:
        ax.set_title(title, fontsize="small")
        bar = figure.colorbar(colours, ax=ax, shrink=0.6, pad=0.14, extend="min" if below else "neither")
    bar.ax.tick_params(labelsize="x-small")
    bar.set_label(f"smallest clearance of a link, $D$ − {_LIMIT} (mm)", fontsize="x-small", labelpad=1.0)


def clearance_limit(robot: "TLPM", ax: Axes | None = None) -> Axes:
    """Draws why links of square section are free of contact at a distance of sqrt(2) a (after Fig. 7).

    A square of side a lies in the circle of radius a / sqrt(2) about its middle, however it is turned. Two links whose
    axes are farther apart than two such radii cannot touch; nearer ones may or may not.

    Args:
        robot: A TLPM, for its side a.
        ax: Where to draw; a new figure if not given.

    Returns:
        The Axes.

    Raises:
        InputError: The robot is no TLPM.
    """
    checked(robot, (0.0, 0.0, 0.0))
    a = float(robot.a)
    radius = a / math.sqrt(2.0)
    if ax is None:
        _, ax = plt.subplots(figsize=(3.5, 2.3), layout="constrained")
    ink = style.OKABE_ITO["blue"]
    _squares(ax, a, ink)
    low = -1.35 * radius
    arrow = {"arrowstyle": "<->", "linewidth": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
    ax.annotate("", (0.0, low), (2 * radius, low), arrowprops=arrow)
    for x in (0.0, 2 * radius):
        ax.plot([x, x], [0.0, 1.08 * low], color="black", linewidth=0.5)
    ax.text(radius, 1.06 * low, f"$D$ = {_LIMIT} = {_mm(2 * radius)}", ha="center", va="top", fontsize="small")
    # The half diagonal, the circle's radius.
    ax.plot([0.0, 0.0], [0.0, radius], color=style.OKABE_ITO["vermillion"], linewidth=1.4)
    half = ax.annotate(
        r"$a/\sqrt{2}$", (0.0, radius / 2), xytext=(3, -2), textcoords="offset points", fontsize="small", va="center"
    )
    half.set_bbox({"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 0.5})
    side = (2.5 * radius, -radius / 2)
    ax.annotate("$a$", side, xytext=(-9, 3), textcoords="offset points", fontsize="small", color=ink)
    text = "two circles touch: no roll lets the links meet\n(at some rolls they may come as near as $a$)"
    ax.text(radius, 1.12 * radius, text, ha="center", va="bottom", fontsize="x-small")
    ax.set(xlim=(-1.2 * radius, 3.2 * radius), ylim=(1.75 * low, 1.75 * radius))
    ax.set_aspect("equal")
    ax.set_axis_off()
    return ax


def _squares(ax: Axes, a: float, ink: str) -> None:
    """Draws two sections at the limit, each in two rolls, within the circles that hold all rolls."""
    radius, light = a / math.sqrt(2.0), "#56B4E955"
    for x, turn in ((0.0, 45.0), (2 * radius, 45.0), (0.0, 10.0), (2 * radius, 75.0)):
        whole = turn == 45.0
        ax.add_patch(
            Rectangle(
                (x - a / 2, -a / 2),
                a,
                a,
                angle=turn,
                rotation_point="center",
                facecolor=light if whole else "none",
                edgecolor=ink,
                linewidth=1.4 if whole else 0.7,
                linestyle="-" if whole else (0, (3, 2)),
            )
        )
    for x in (0.0, 2 * radius):
        ax.add_patch(Circle((x, 0.0), radius, facecolor="none", edgecolor="black", linewidth=0.9))
        ax.plot(x, 0.0, "o", color="black", markersize=3.0)
