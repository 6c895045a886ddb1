"""Singular curves and cusps over a section, and their names."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import matplotlib.patheffects as effects
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from scipy.spatial import KDTree

from jaxkin.core.errors import InputError
from jaxkin.plot import style

if TYPE_CHECKING:
    from jaxkin.mapping.records import Cusps, SingularCurves

#: Colour, dashes and width of one name's curves after another; dashes tell them apart where colours do not.
_LOOKS = (
    ("black", "solid", 1.7),
    ("blue", (0, (7, 1.6)), 1.5),
    ("blue", (0, (1.3, 1.1)), 1.8),
    ("blue", (0, (6, 1.6, 1.4, 1.6)), 1.5),
    ("blue", (0, (5, 1.3, 1.3, 1.3, 1.3, 1.3)), 1.5),
    ("black", (0, (7, 1.6)), 1.5),
    ("purple", (0, (7, 1.6)), 1.5),
    ("purple", "solid", 1.5),
)
_VIRTUAL = {"linestyle": (0, (3.5, 2.5)), "linewidth": 0.8}
#: White on either side of a curve, in points.
_HALO = 0.6
#: Points of a curve are this dense where it is compared with itself, and where a name is placed. This and all lengths
#: below are shares of the picture's width and height.
_FINE, _COARSE = 5e-4, 5e-3
#: A curve this near to what is drawn of it already is not drawn again, unless it is the next piece of the same pass.
_SAME, _NEXT = 1e-3, 5e-3
#: A name with a neighbour within the first goes to the legend; more room than the second makes it no better.
_TIGHT, _ROOMY = 0.03, 0.12
#: Pieces of one curve that are this far apart along it are neighbours like other curves.
_OTHER_PASS = 0.15


_Window = tuple[np.ndarray, np.ndarray]


class _Group(NamedTuple):
    """The curves of one name.

    Attributes:
        name: As in the record; "" where the curves have none.
        virtual: True for the parts whose poses are complex.
        lines: Polylines ``(k, 2)`` in shares of the picture, no part twice.
        look: Options of the line.
    """

    name: str
    virtual: bool
    lines: list[np.ndarray]
    look: dict[str, Any]


class OverSection(Protocol):
    """What every result over a section has."""

    @property
    def request(self) -> dict[str, Any]:
        """What determines the numbers."""
        ...

    @property
    def pose_names(self) -> tuple[str, ...]:
        """Names of the pose axes."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joint axes."""
        ...

    @property
    def units(self) -> dict[str, str]:
        """Unit of every axis."""
        ...


def section_of(given: OverSection) -> tuple[tuple[str, ...], dict[str, float]]:
    """Returns the names of the free axes, and the fixed ones with their values."""
    section = given.request["section"]
    free = tuple(name for name, value in section.items() if isinstance(value, list | tuple))
    return free, {name: float(value) for name, value in section.items() if name not in free}


def check(given: OverSection, free: tuple[str, ...], fixed: dict[str, float]) -> None:
    """Refuses curves or cusps of another section than the one drawn.

    Raises:
        InputError: The axes differ, or the values of the fixed ones.
    """
    own_free, own = section_of(given)
    if own_free != free or not all(np.isclose(own.get(name, value), value) for name, value in fixed.items()):
        raise InputError(
            f"The {type(given).__name__} are over {_described(own_free, own)}, but the picture is of "
            f"{_described(free, fixed)}: take both from one section."
        )


def _described(free: Sequence[str], fixed: dict[str, float]) -> str:
    return " and ".join(free) + "".join(f", {name} = {value:g}" for name, value in fixed.items())


def draw(ax: Axes, curves: "SingularCurves | None", cusps: "Cusps | None") -> list[Line2D]:
    """Draws curves and cusps on Axes whose limits are set, clear of the texts there; returns the legend's handles.

    Names of closed forms stand on their curves where there is room, all others in the legend.
    """
    window = _window(ax)
    handles: list[Line2D] = []
    marks: list[Line2D] = []
    if curves is not None:
        marks += _crosses(ax, window, free_points(curves, own_points(curves, curves.crossings)))
    if cusps is not None:
        marks += _circles(ax, window, free_points(cusps, cusps.joints))
    if curves is not None:
        groups = _groups(window, curves)
        for group in groups:
            _draw_group(ax, window, group)
        traced = curves.request.get("method") == "trace"
        named = set() if traced else _write_names(ax, window, groups, marks)
        for group in groups:
            if group.lines and (group.virtual or group.name not in named):
                handles.append(Line2D([], [], label=_label(group, traced), **group.look))
    return handles + marks


def free_points(given: OverSection, points: np.ndarray) -> np.ndarray:
    """Returns the two free coordinates of joint points (in a section of the workspace: of poses), ``(k, 2)``."""
    free, _ = section_of(given)
    names = given.pose_names if over_poses(given) else given.joint_names
    return points[:, [names.index(name) for name in free]]


def over_poses(given: OverSection) -> bool:
    """True where the section is one of the workspace."""
    return section_of(given)[0][0] in given.pose_names


def own_points(given: OverSection, part: Any) -> np.ndarray:
    """Returns the points of a curve, or of crossings, in the space of the section."""
    return part.poses if over_poses(given) else part.joints


def _window(ax: Axes) -> _Window:
    """Returns the lower left corner of the picture, and its width and height."""
    ends = np.array([ax.get_xlim(), ax.get_ylim()])
    return ends[:, 0], ends[:, 1] - ends[:, 0]


def _label(group: _Group, traced: bool) -> str:
    factor, comma, rest = group.name.partition(",")
    name = (factor if factor.startswith("det ") else style.symbol(factor)) if factor else "singular curve"
    # A traced curve is named after the factor that vanishes on it.
    name += (" = 0" if factor and traced else "") + comma + rest.replace("-", "−")
    return f"{name}, virtual (complex poses)" if group.virtual else name


# --- marks --------------------------------------------------------------------------------------------------


def _crosses(ax: Axes, window: _Window, points: np.ndarray) -> list[Line2D]:
    look = {"marker": "x", "markersize": 5, "markeredgewidth": 1.2, "color": "black"}
    return _marks(ax, window, points, ("crossing (no cusp)", "crossings (no cusps)"), look)


def _circles(ax: Axes, window: _Window, points: np.ndarray) -> list[Line2D]:
    look = {"marker": "o", "markersize": 9, "markeredgewidth": 1.3, "markerfacecolor": "none", "color": "black"}
    return _marks(ax, window, points, ("cusp", "cusps"), look)


def _marks(ax: Axes, window: _Window, points: np.ndarray, names: tuple[str, str], look: dict[str, Any]) -> list[Line2D]:
    """Draws those points that are in the picture, and counts them in their label."""
    low, size = window
    points = points[np.all((points >= low) & (points <= low + size), axis=1)]
    if len(points) == 0:
        return []
    label = f"{len(points)} {names[len(points) > 1]}"
    # A mark on the border is drawn whole.
    look = {"linestyle": "none", "zorder": 4, "clip_on": False, "scalex": False, "scaley": False, **look}
    look["path_effects"] = [effects.withStroke(linewidth=look["markeredgewidth"] + 2 * _HALO, foreground="white")]
    return ax.plot(*points.T, label=label, **look)


# --- curves -------------------------------------------------------------------------------------------------


def _groups(window: _Window, curves: "SingularCurves") -> list[_Group]:
    """Returns the curves by name: names without a number first, the virtual parts of a name after the real ones."""
    low, size = window
    names = sorted({c.label for c in curves}, key=lambda name: (name[-1:].isdigit(), name))
    groups = []
    for name, (colour, dashes, width) in zip(names, (_LOOKS * len(names))[: len(names)], strict=True):
        for virtual in (False, True):
            lines = [
                (piece - low) / size
                for c in curves
                if c.label == name and c.virtual == virtual
                for piece in unglued(curves, whole_line(curves, c))
            ]
            look = {"color": style.OKABE_ITO[colour], "linestyle": dashes, "linewidth": width}
            look |= _VIRTUAL if virtual else {}
            if lines:
                groups.append(_Group(name, virtual, _once(lines), look))
    return groups


def whole_line(given: OverSection, curve: Any) -> np.ndarray:
    """Returns the points of a curve, the first again at the end where it is closed."""
    points = own_points(given, curve)
    return np.concatenate([points, points[: int(curve.closed)]])


def unglued(given: OverSection, points: np.ndarray) -> list[np.ndarray]:
    """Returns the pieces ``(k, 2)`` of a curve in the section, cut at the ends of angles that are glued there."""
    points = free_points(given, points)
    free, _ = section_of(given)
    period = np.array([2 * np.pi if given.units[name] == "rad" else np.inf for name in free])
    steps = np.diff(points, axis=0)
    turns = np.where(np.isfinite(period), np.round(steps / np.where(np.isfinite(period), period, 1.0)), 0.0)
    pieces, rest = [], points
    for k in np.flatnonzero(turns.any(axis=1))[::-1]:
        # Both ends go on beyond the border, where the picture cuts them.
        shift = turns[k] * np.where(np.isfinite(period), period, 0.0)
        pieces.append(np.vstack([points[k] + shift, rest[k + 1 :]]))
        rest = np.vstack([rest[: k + 1], points[k + 1] - shift])
    return [rest, *pieces[::-1]]


def _draw_group(ax: Axes, window: _Window, group: _Group) -> None:
    low, size = window
    gap = np.full((1, 2), np.nan)
    points = np.concatenate([rows for line in group.lines for rows in (line * size + low, gap)] or [gap])
    # All halos are below all curves: where two are tangent, neither hides the other.
    halo = group.look["linewidth"] + 2 * _HALO
    ax.plot(*points.T, color="white", linewidth=halo, solid_capstyle="butt", zorder=2.2, scalex=False, scaley=False)
    ax.plot(*points.T, zorder=2.5, scalex=False, scaley=False, **group.look)


def _once(lines: list[np.ndarray]) -> list[np.ndarray]:
    """Cuts out of polylines what is outside the picture, or lies on an earlier part: dashes drawn twice would fill.

    A curve with two poses over each of its points is there twice, forth and back.
    """
    dense, places = _dense(lines, _FINE)
    tree = KDTree(dense)

    def again(points: np.ndarray, arc: np.ndarray, lap: float) -> np.ndarray:
        # The end of a closed curve meets its start, and is no second pass.
        near = tree.query_ball_point(points, _SAME)
        return np.array(
            [np.any((s - places[k] > _NEXT) & (s - places[k] < lap)) for s, k in zip(arc, near, strict=True)], bool
        )

    kept, start = [], 0.0
    for line in lines:
        arc = start + _arc(line)
        lap = arc[-1] - start - _NEXT if np.array_equal(line[0], line[-1]) else np.inf
        double = again(line, arc, lap)
        middle = again((line[1:] + line[:-1]) / 2, (arc[1:] + arc[:-1]) / 2, lap)
        outside = np.any((line < -0.02) | (line > 1.02), axis=1)
        drawn = ~(double[1:] & double[:-1] & middle) & ~(outside[1:] & outside[:-1])
        edges = np.flatnonzero(np.diff(np.concatenate([[False], drawn, [False]]).astype(int)))
        kept += [line[first : last + 1] for first, last in edges.reshape(-1, 2)]
        start = arc[-1] + 1.0
    return kept


def _arc(line: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def _dense(lines: list[np.ndarray], step: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns evenly spread points of polylines, and how far along the lines they are; between lines there is 1."""
    points, places, start = [np.zeros((0, 2))], [np.zeros(0)], 0.0
    for line in lines:
        arc = _arc(line)
        at = np.linspace(0.0, arc[-1], int(arc[-1] / step) + 2)
        points.append(np.stack([np.interp(at, arc, column) for column in line.T], axis=1))
        places.append(start + at)
        start += arc[-1] + 1.0
    return np.concatenate(points), np.concatenate(places)


# --- names --------------------------------------------------------------------------------------------------


def _write_names(ax: Axes, window: _Window, groups: list[_Group], marks: list[Line2D]) -> set[str]:
    """Writes names on their curves, where all else is far; returns those that found room."""
    low, size = window
    texts = [text.get_position() for text in ax.texts]
    others = [(np.array(at, float).reshape(-1, 2) - low) / size for at in (texts, *(m.get_xydata() for m in marks))]
    dense = [_dense(group.lines, _COARSE) for group in groups]
    named = set()
    # Short curves have the least choice.
    for k in sorted(range(len(groups)), key=lambda k: len(dense[k][0])):
        group = groups[k]
        if group.virtual or not group.name or not group.lines:
            continue
        place = _place(*dense[k], np.concatenate([*others, *(points for j, (points, _) in enumerate(dense) if j != k)]))
        if place is None:
            continue
        x, y = place * size + low
        text = ax.text(float(x), float(y), style.symbol(group.name), ha="center", va="center", zorder=5)
        text.set_path_effects([effects.withStroke(linewidth=3, foreground="white")])
        text.set_color(group.look["color"])
        others.append(place[None])
        named.add(group.name)
    return named


def _place(points: np.ndarray, arc: np.ndarray, others: np.ndarray) -> np.ndarray | None:
    """Returns the point of a curve with the most room about it, the middle one of several; None if all are tight."""
    room = np.minimum(np.min(np.minimum(points, 1 - points), axis=1), _ROOMY)
    if len(others):
        room = np.minimum(room, KDTree(others).query(points)[0])
    for k in range(len(points)):
        away = np.abs(arc - arc[k]) > _OTHER_PASS
        if away.any():
            room[k] = min(room[k], float(np.min(np.linalg.norm(points[away] - points[k], axis=1))))
    if np.max(room, initial=0.0) < _TIGHT:
        return None
    best = np.flatnonzero(room >= 0.98 * np.max(room))
    return points[best[len(best) // 2]]
