"""One surface of poses over a section, with its fold and the fold's projection, in three dimensions."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from jaxkin.plot import style
from jaxkin.plot.shading import shaded

if TYPE_CHECKING:
    from jaxkin.mapping.fold import Fold

#: An angle is drawn upright if it tells the sheets apart at least by this share of what the best coordinate does.
_ANGLE_SHARE = 0.5
#: The floor is this far below the surface, as a share of its height.
_FLOOR = 0.35
#: Share of the fold's length that is drawn at a cusp. A cubic reaches the heights of its two turns again at twice their
#: distance, so a surface that is known as far as the fold shows all three sheets over less than half of it.
_CUSP_SHARE = 0.45
#: What is drawn behind the fold, as a share of what is before it, and on both sides, in widths of the fold.
_BEHIND, _AROUND = 0.6, 2.2
#: Faces a side, at least.
_FACES = 60
#: The eye stands this many degrees beside the direction in which a cusp opens, and above the horizon.
_BESIDE, _ABOVE = 30.0, 24.0
#: No horizontal axis is seen from nearer to its direction than this.
_ASKEW = 28.0


class _Cut(NamedTuple):
    """The part of the joints that is drawn: a rectangle along the direction in which the fold opens.

    Attributes:
        origin: ``(2,)`` the singular point.
        frame: ``(2, 2)`` from joints to coordinates along and across the opening.
        low: ``(2,)`` in these coordinates.
        high: ``(2,)``.
    """

    origin: np.ndarray
    frame: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def rooms(self, points: np.ndarray) -> np.ndarray:
        """Returns how far points are inside the four edges, ``(..., 4)``."""
        own = (points[..., :2] - self.origin) @ self.frame.T
        return np.concatenate([own - self.low, self.high - own], axis=-1)


def singular_joints(fold: "Fold") -> np.ndarray:
    """Returns the joint values of the singular pose: those of the nearest sample, the middle one."""
    return fold.joints[_middle(fold)]


def _middle(fold: "Fold") -> tuple[int, int]:
    distance = np.linalg.norm(fold.poses - fold.pose, axis=-1)
    row, column = np.unravel_index(int(np.argmin(distance)), distance.shape)
    return int(row), int(column)


def upright_axis(folds: list["Fold"]) -> int:
    """Returns the pose coordinate that tells the sheets apart, an angle by preference.

    Sheets part in the direction in which poses change while joints do not; at a cusp it is that of the fold. The
    change is taken as a share of the coordinate's range over the surface, the least of all folds.
    """
    shares = np.min([_parting(fold) for fold in folds], axis=0)
    angles = np.array([folds[0].units[name] == "rad" for name in folds[0].pose_names])
    preferred = angles & (shares >= _ANGLE_SHARE * shares.max())
    return int(np.argmax(np.where(preferred, shares, shares * ~preferred.any())))


def _parting(fold: "Fold") -> np.ndarray:
    row, column = (min(max(k, 1), n - 2) for k, n in zip(_middle(fold), fold.determinant.shape, strict=True))
    joints, poses = (
        np.stack([a[row + 1, column] - a[row - 1, column], a[row, column + 1] - a[row, column - 1]], axis=1)
        for a in (fold.joints, fold.poses)
    )
    kernel = np.linalg.svd(joints)[2][-1]
    share = np.abs(poses @ kernel) / np.maximum(np.ptp(fold.poses, axis=(0, 1)), 1e-300)
    return share / share.max()


def draw(fold: "Fold", ax: Axes3D, upright: int) -> list[Artist]:
    """Draws one surface with a pose coordinate upright; returns the legend's handles."""
    free = [fold.joint_names.index(name) for name in fold.free]

    def points(joints: np.ndarray, poses: np.ndarray) -> np.ndarray:
        return np.concatenate([joints[..., free], poses[..., upright, None]], axis=-1)

    surface, line = points(fold.joints, fold.poses), points(fold.fold_joints, fold.fold_poses)
    centre = points(singular_joints(fold), fold.pose)
    middle = int(np.argmin(np.linalg.norm(fold.fold_poses - fold.pose, axis=1)))
    cusp = _turns_back(fold.fold_joints, middle)
    cut = _cut(line, middle, centre) if cusp else _whole(surface, centre)
    sheets = _sheets(surface, fold.determinant, cut)
    corners = np.concatenate([polygon for sheet in sheets.values() for polygon in sheet])
    low, high = corners.min(axis=0), corners.max(axis=0)
    low[2] -= _FLOOR * (high[2] - low[2])
    azimuth = _azimuth(cut, line, high - low)
    _frame(ax, fold, upright, low, high, azimuth)
    _paint(ax, sheets, high - low, azimuth)
    line = np.where(np.min(cut.rooms(line), axis=1, keepdims=True) >= 0, line, np.nan)
    return _lines(ax, line, centre, low[2], "cusp" if cusp else "singular pose")


def _cut(line: np.ndarray, middle: int, centre: np.ndarray) -> _Cut:
    """Chooses what to draw about a cusp: so little that the three sheets over it are there whole."""
    reach = max(1, round(_CUSP_SHARE * min(middle, len(line) - 1 - middle)))
    while True:
        part = line[middle - reach : middle + reach + 1, :2] - centre[:2]
        size = np.maximum(np.ptp(part, axis=0), 1e-9 * (1 + np.abs(centre[:2])))
        part = part / size
        if reach < 6 or _opening(part, reach):
            break
        reach = int(0.8 * reach)
    turn = _turn(part[[0, -1]].mean(axis=0))
    along, across = turn @ part.T
    deep, wide = along.max(), np.abs(across).max()
    low = [-_BEHIND * deep + min(along.min(), 0.0), -_AROUND * wide]
    return _Cut(centre[:2], turn / size, np.array(low), np.array([deep, _AROUND * wide]))


def _whole(surface: np.ndarray, centre: np.ndarray) -> _Cut:
    """Returns a cut that leaves a surface whole, with the direction in which it lies about a plain fold."""
    joints = surface[..., :2] - centre[:2]
    size = np.maximum(np.ptp(joints, axis=(0, 1)), 1e-300)
    turn = _turn((joints / size).mean(axis=(0, 1)))
    own = joints / size @ turn.T
    return _Cut(centre[:2], turn / size, own.min(axis=(0, 1)) - 1e-9, own.max(axis=(0, 1)) + 1e-9)


def _turn(toward: np.ndarray) -> np.ndarray:
    """Returns the rotation ``(2, 2)`` that makes a direction the first axis."""
    x, y = toward / max(float(np.linalg.norm(toward)), 1e-300)
    return np.array([[x, y], [-y, x]])


def _opening(part: np.ndarray, middle: int) -> bool:
    """True where both branches of a cusp go on in the direction in which they open."""
    along = part @ part[[0, -1]].mean(axis=0)
    # Points next to the cusp hardly differ.
    return bool((np.diff(along[middle + 1 :]) > 0).all() and (np.diff(along[: middle - 1]) < 0).all())


def _azimuth(cut: _Cut, line: np.ndarray, size: np.ndarray) -> float:
    """Returns where to look from, in degrees: where the fold opens, a little to the side on which it gapes."""
    rooms = cut.rooms(line)
    part = line[np.min(rooms, axis=1) >= 0]
    across = (part[:, :2] - cut.origin) @ cut.frame[1]
    # Seen from where the fold opens, positive is on the right.
    upper_on_right = (across - across.mean()) @ (part[:, 2] - part[:, 2].mean()) > 0
    opening = np.linalg.inv(cut.frame)[:, 0] / size[:2]
    azimuth = math.degrees(math.atan2(opening[1], opening[0])) + (-_BESIDE if upper_on_right else _BESIDE)
    # Along an axis its ticks would be on one another.
    return azimuth - azimuth % 90 + min(max(azimuth % 90, _ASKEW), 90 - _ASKEW)


def _lines(ax: Axes3D, line: np.ndarray, centre: np.ndarray, floor: float, name: str) -> list[Artist]:
    """Draws the fold, its projection and the singular point; returns the legend's handles for all."""
    down = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, floor])
    shadow = {"color": "#555555", "linewidth": 1.2}
    ax.plot(*(line * down[0] + down[1]).T, zorder=1, **shadow)
    drop = np.stack([centre, centre * down[0] + down[1]])
    ax.plot(*drop.T, color="black", linewidth=0.8, linestyle=(0, (2, 2)), zorder=4)
    ax.plot(*line.T, color="black", linewidth=1.6, zorder=5)
    mark = {"marker": "o", "markersize": 5.5, "markerfacecolor": "white", "markeredgecolor": "black"}
    ax.plot(*drop.T, linestyle="none", zorder=6, **mark)
    return [
        *(Patch(facecolor=style.SIGN_COLOURS[sign], label=f"det {word} 0") for sign, word in ((1, ">"), (-1, "<"))),
        Line2D([], [], color="black", linewidth=1.6, label="fold (det = 0)"),
        Line2D([], [], label="its projection", **shadow),
        Line2D([], [], linestyle="none", label=name, **mark),
    ]


def _turns_back(joints: np.ndarray, middle: int) -> bool:
    """True where the fold's joint values come to the pose and go back: at a cusp."""
    step = min(middle, len(joints) - 1 - middle, max(1, len(joints) // 40))
    come, go = joints[middle - step] - joints[middle], joints[middle + step] - joints[middle]
    return step > 0 and float(come @ go) > 0


def _frame(ax: Axes3D, fold: "Fold", upright: int, low: np.ndarray, high: np.ndarray, azimuth: float) -> None:
    ax.computed_zorder = False
    ax.margins(0)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.view_init(_ABOVE, azimuth)
    ax.set_box_aspect((1.0, 1.0, 0.95), zoom=0.87)  # type: ignore[arg-type]
    ax.grid(False)
    axes: tuple[Any, ...] = (ax.xaxis, ax.yaxis, ax.zaxis)
    for name, axis in zip((*fold.free, fold.pose_names[upright]), axes, strict=True):
        axis.set_label_text(style.axis_label(name, fold.units[name]))
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.line.set_linewidth(0.6)
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        axis.set_tick_params(labelsize="small", pad=0.0)
    # It goes on the side that the view leaves free, left or right, and must fit on both.
    ax.zaxis.set_tick_params(pad=2.0)
    ax.zaxis.labelpad = 2.0
    ax.zaxis.set_rotate_label(False)
    ax.zaxis.label.set_rotation(90.0)


def _sheets(surface: np.ndarray, determinant: np.ndarray, cut: _Cut) -> dict[int, list[np.ndarray]]:
    """Returns the polygons on which det is positive and those on which it is negative, inside the cut."""
    corners, values = _faces(*_finer(surface, determinant, cut))
    inside = np.all(cut.rooms(corners).max(axis=1) > 0, axis=1)
    sheets: dict[int, list[np.ndarray]] = {1: [], -1: []}
    for sign, sheet in sheets.items():
        for k in np.flatnonzero(inside & (sign * values > 0).any(axis=1)):
            polygon = _clipped(corners[k], sign * values[k])
            for edge in range(4):
                polygon = _clipped(polygon, cut.rooms(polygon)[:, edge])
            if len(polygon) > 2:
                sheet.append(polygon)
    return sheets


def _finer(surface: np.ndarray, determinant: np.ndarray, cut: _Cut) -> tuple[np.ndarray, np.ndarray]:
    """Returns the rows and columns of samples that meet the cut, with as many again between them as it takes.

    About a cusp they are few in one direction, and long faces could not be sorted by depth.
    """
    met = np.all(cut.rooms(_faces(surface, determinant)[0]).max(axis=1) > 0, axis=1)
    met = met.reshape(np.array(determinant.shape) - 1)
    whole = np.concatenate([surface, determinant[..., None]], axis=-1)
    for axis in (0, 1):
        rows = np.flatnonzero(met.any(axis=1 - axis))
        first, last = (rows[0], rows[-1] + 1) if len(rows) else (0, whole.shape[axis] - 1)
        count = max(last - first, _FACES) + 1
        at = np.linspace(first, last, count)
        before = np.minimum(at.astype(int), whole.shape[axis] - 2)
        share = np.expand_dims(at - before, tuple(k for k in range(3) if k != axis))
        whole = (1 - share) * whole.take(before, axis) + share * whole.take(before + 1, axis)
    return whole[..., :3], whole[..., 3]


def _faces(surface: np.ndarray, determinant: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners of all quadrangles ``(n, 4, 3)``, and the determinant there ``(n, 4)``."""
    corners, values = (
        np.stack([a[:-1, :-1], a[1:, :-1], a[1:, 1:], a[:-1, 1:]], axis=2) for a in (surface, determinant)
    )
    return corners.reshape(-1, 4, 3), values.reshape(-1, 4)


def _clipped(corners: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Returns the part of a polygon on which a function, given at its corners, is not negative."""
    if (values >= 0).all():
        return corners
    kept = []
    for a, b, u, v in zip(corners, np.roll(corners, -1, axis=0), values, np.roll(values, -1), strict=True):
        if u >= 0:
            kept.append(a)
        if u * v < 0:
            kept.append(a + u / (u - v) * (b - a))
    return np.reshape(kept, (-1, 3))


def _paint(ax: Axes3D, sheets: dict[int, list[np.ndarray]], size: np.ndarray, azimuth: float) -> None:
    turn = math.radians(azimuth + 40.0)
    light = np.array([math.cos(turn), math.sin(turn), 0.9])
    polygons = sheets[1] + sheets[-1]
    paint = np.concatenate(
        [
            shaded(np.array(to_rgb(style.SIGN_COLOURS[sign])), np.array([_halves(p) for p in sheet]) / size, light)
            for sign, sheet in sheets.items()
            if sheet
        ]
    )
    # matplotlib leaves memory unset behind the corners of the shorter polygons, and projects it: all get as many.
    corners = max(map(len, polygons))
    even = np.array([np.concatenate([p, np.repeat(p[-1:], corners - len(p), axis=0)]) for p in polygons])
    layer = Poly3DCollection(even, facecolors=paint, edgecolors=paint, linewidths=0.25, zorder=2)
    # As vectors, thousands of small faces show their seams.
    layer.set_rasterized(True)
    ax.add_collection3d(layer, autolim=False)


def _halves(polygon: np.ndarray) -> np.ndarray:
    """Returns three corners that are far apart: cut polygons may have two in nearly one place."""
    count = len(polygon)
    return polygon[[0, count // 3, (2 * count) // 3]] if count != 4 else polygon[[0, 1, 2]]
