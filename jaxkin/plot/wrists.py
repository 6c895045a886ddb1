"""The wrist of one limb of the TLPM with its angles.

The reading of the angles, and sizes and places of the links, are our completion of the paper [ours].
"""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jax.typing import ArrayLike
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from jaxkin.core.bodies import Body
from jaxkin.core.errors import InputError
from jaxkin.kinematics.solve import inverse
from jaxkin.mechanisms import _tlpm_wrist
from jaxkin.numerics import rotations
from jaxkin.plot import spatial, style
from jaxkin.plot.poses import new_or_given

if TYPE_CHECKING:
    from jaxkin.mechanisms.tlpm import TLPM

#: A rod is drawn so far beyond its end, as a share of ``b``.
_ROD = 0.5
_ANGLES = (style.OKABE_ITO["blue"], style.OKABE_ITO["purple"])
_FORBIDDEN = style.OKABE_ITO["vermillion"]
#: Radii of the arcs of theta_i1 and theta_i2, as shares of ``r2``.
_RADII = (0.8, 0.6)


def wrist_angles(robot: "TLPM", pose: ArrayLike, limb: int = 1, ax: Axes | None = None) -> Axes3D:
    """Draws the wrist of one limb with its angles theta_i1 and theta_i2 and what their limits forbid (after Fig. 5).

    theta_i1 is measured from the limb's axis to the R2 axis, theta_i2 about the R2 axis from the platform's centre to
    the R1 axis (for the elbow -1 both with the other sign): a reading of the paper that is ours. The title says where
    the pose is outside the strokes.

    Args:
        robot: A TLPM.
        pose: ``(3,)``, mm.
        limb: Number of the limb, 1, 2 or 3.
        ax: Axes with ``projection="3d"``; a new figure if not given.

    Returns:
        The Axes, with a legend.

    Raises:
        InputError: The robot is no TLPM, the pose has another shape or is not finite, there is no such limb, or the
            Axes are flat.
    """
    p = checked(robot, pose)
    if limb not in (1, 2, 3):
        raise InputError(f"The limb is {limb!r}: it must be 1, 2 or 3.")
    own, ax = ax is None, new_or_given(ax)
    axes = _directions(robot, p, limb)
    points = _draw_links(robot, p, limb, axes, ax)
    found = _tlpm_wrist.wrist_angles(robot, p)
    angles = [float(values[limb - 1]) for values in found[:2]]
    _draw_angles(robot, p, limb, axes, angles, ax)
    names = [rf"$\theta_{{{limb}{k}}}$" for k in (1, 2)]
    entries: list[Artist] = [
        Patch(facecolor=_ANGLES[0], alpha=0.4, label=f"{names[0]}: limb to R2 axis"),
        Patch(facecolor=_ANGLES[1], alpha=0.4, label=f"{names[1]}: about R2, centre to R1"),
        Patch(facecolor=_FORBIDDEN, alpha=0.6, label="forbidden by the lower limit"),
        Patch(facecolor=spatial.COLOURS["platform"], alpha=0.55, label="platform"),
    ]
    spatial.legend(ax, entries, columns=2, own=own)
    texts = (f"{name} = {math.degrees(angle):.1f}°" for name, angle in zip(names, angles, strict=True))
    title = reach_note(robot, p) + f"limb {limb} [ours]:  {',  '.join(texts)}".replace("-", "−")
    if own:
        spatial.fit([ax], [title], points=points, legend=0.5, room=spatial.Room(above=0.45))
    else:
        ax.set_title(title, fontsize="small")
    return ax


def checked(robot: Any, pose: Any) -> np.ndarray:
    """Returns the pose ``(3,)`` of a TLPM as an array.

    Raises:
        InputError: It is another robot, or the pose is not three finite numbers.
    """
    if getattr(robot, "id", "") != "tlpm":
        raise InputError(f"{type(robot).__name__} has no wrists to draw: give a TLPM, from jk.mechanisms.tlpm.create.")
    p = np.asarray(pose, float)
    if p.shape != (3,) or not np.isfinite(p).all():
        raise InputError(f"The pose is {p.tolist()}: it must be three finite numbers (x, y, z), mm.")
    return p


def reach_note(robot: "TLPM", p: np.ndarray) -> str:
    """Returns a line for the title of a pose that the strokes do not reach, and nothing for others."""
    return "" if bool(inverse(robot, p).valid.any()) else "pose outside the strokes\n"


def near_wrist(robot: "TLPM", p: np.ndarray) -> list[Body]:
    """Returns the parts about the wrists: platform, axes, and the ends of the rods."""
    kept = []
    for body in robot.bodies(p):
        if body.kind == "platform" or body.kind == "axis":
            kept.append(body)
        elif body.name.endswith("rod"):
            end = body.points[1]
            kept.append(body._replace(points=np.stack([end + _ROD * (end - p), end])))
    return kept


def letter(ax: Axes3D, place: np.ndarray, centre: np.ndarray, text: str, gap: float = 0.0, ink: str = "black") -> None:
    """Writes text at a point, or so far away from a centre."""
    away = place - centre
    place = place + gap * away / max(float(np.linalg.norm(away)), 1e-12)
    x, y, z = place
    drawn = ax.text(x, y, z, text, ha="center", va="center", fontsize="x-small", color=ink, zorder=spatial.ON_TOP + 1)
    drawn.set_bbox({"facecolor": "white", "alpha": 0.6, "edgecolor": "none", "pad": 0.4})


class _Axes(NamedTuple):
    """Unit vectors along the limb, the R1 and the R2 axis, and across the last one to the platform's centre."""

    z1: np.ndarray
    z2: np.ndarray
    z3: np.ndarray
    inward: np.ndarray


def _directions(robot: "TLPM", p: np.ndarray, limb: int) -> _Axes:
    ends = np.asarray(_tlpm_wrist.links(robot, p))
    z1, z2 = (v / np.linalg.norm(v) for v in (ends[limb - 1] - p))
    z3 = ends[limb + 2, 1] - p
    w, x, y, z = np.asarray(robot.orientation, float)
    turn = np.array(rotations.matrix_from_quaternion((w, x, y, z)))  # type: ignore[arg-type]
    eta, beta = float(robot.platform_angles[limb - 1]), float(robot.beta2)
    outward = turn @ [math.cos(beta) * math.cos(eta), math.cos(beta) * math.sin(eta), -math.sin(beta)]
    return _Axes(z1, z2, z3 / np.linalg.norm(z3), -outward)


def _draw_links(robot: "TLPM", p: np.ndarray, limb: int, axes: _Axes, ax: Axes3D) -> np.ndarray:
    """Frames the picture, and draws links, axes and platform; returns the points to be seen."""
    r1, r2 = float(robot.r1), float(robot.r2)
    bodies = [b for b in near_wrist(robot, p) if b.limb in (None, limb)]
    links = [b for b in robot.bodies(p) if b.width > 0 and b.limb == limb]
    tips = p + np.stack([1.45 * r2 * axes.z1, 1.15 * r1 * axes.z2, 1.5 * r2 * axes.z3])
    points = np.concatenate([tips, *(b.points for b in (*bodies, *links))])
    box = spatial.limits([Body("", points, "axis")])
    size = float(np.ptp(box, axis=1).max())
    elevation, azimuth = _view_on(axes.z2, axes.z3)
    spatial.frame(ax, box, robot.pose_axes, azimuth, elevation)
    spatial.draw(ax, bodies, letters=False)
    for link in links:
        spatial.bar(ax, link.points, link.width, spatial.COLOURS["link"], alpha=0.75)
        letter(ax, link.points.mean(axis=0), p, style.symbol(link.name))
    for tip, name in zip(tips, ("limb", "R1", "R2"), strict=True):
        ax.plot(*np.stack([p, tip]).T, color="black", linewidth=0.9, linestyle=(0, (5, 2)), zorder=spatial.ON_TOP - 1)
        letter(ax, tip, p, name, 0.05 * size)
    letter(ax, p, p + axes.z2, "$p$", 0.06 * size)
    return points


def _draw_angles(robot: "TLPM", p: np.ndarray, limb: int, axes: _Axes, angles: list[float], ax: Axes3D) -> None:
    """Draws both angles, and what their lower limits forbid."""
    elbow, low = robot.elbows[limb - 1], np.asarray(robot.wrist_limits.low, float)
    # In the plane of the limb and the R2 axis the angle from one to the other has no sign: it is e theta_i1.
    across = _perpendicular(axes.z1, axes.z3, axes.z2), np.cross(axes.z3, axes.inward)
    starts, centres = (axes.z1, axes.inward), (p, p + float(robot.r2) * axes.z3)
    for k, sign in enumerate((1, elbow)):
        radius = _RADII[k] * float(robot.r2)
        turn = elbow * sign * angles[k]
        _sector(ax, centres[k], (starts[k], across[k]), turn, radius, _ANGLES[k], 0.28)
        if np.isfinite(low[k]):
            _sector(ax, centres[k], (starts[k], across[k]), sign * low[k], 1.12 * radius, _FORBIDDEN, 0.6)
        # In the middle of the second arc its letter would be on that of the R2 axis.
        at = turn * (0.5, 0.85)[k]
        middle = math.cos(at) * starts[k] + math.sin(at) * across[k]
        letter(ax, centres[k] + 1.25 * radius * middle, p, rf"$\theta_{{{limb}{k + 1}}}$", ink=_ANGLES[k])


def _perpendicular(start: np.ndarray, toward: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    """Returns the unit vector across ``start`` in the plane of both."""
    side = toward - (toward @ start) * start
    length = float(np.linalg.norm(side))
    return side / length if length > 1e-9 else fallback


def _sector(
    ax: Axes3D,
    centre: np.ndarray,
    plane: tuple[np.ndarray, np.ndarray],
    angle: float,
    radius: float,
    colour: str,
    alpha: float,
) -> None:
    """Draws the sector from the first vector of a plane by an angle towards the second one."""
    turn = np.linspace(0.0, angle, 40)[:, None]
    arc = centre + radius * (np.cos(turn) * plane[0] + np.sin(turn) * plane[1])
    face = Poly3DCollection([np.vstack([centre, arc])], facecolors=[colour], edgecolors="none", alpha=alpha)
    ax.add_collection3d(face, autolim=False)
    ax.plot(*arc.T, color=colour, linewidth=1.4, zorder=spatial.ON_TOP - 1)


def _view_on(z2: np.ndarray, z3: np.ndarray) -> tuple[float, float]:
    """Returns elevation and azimuth, degrees, from which the planes of both angles are seen broadly."""
    elevation, azimuth = np.meshgrid(np.arange(8.0, 33.0, 4.0), np.arange(-175.0, 180.0, 5.0), indexing="ij")
    up, turn = np.radians(elevation), np.radians(azimuth)
    eye = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1)
    # z2 is across both z1 and z3: the plane of theta_i1 is seen along it, from the side on which no link hides it,
    # and that of theta_i2 along z3, from outside.
    # Beside the plane of the R1 and the R2 axis, they are not on one another.
    score = np.minimum(np.minimum(-eye @ z2, eye @ z3), np.abs(eye @ np.cross(z2, z3)))
    best = np.unravel_index(int(np.argmax(score)), score.shape)
    return float(elevation[best]), float(azimuth[best])
