"""Singular curves of plane sections of the analytic 3-RPR, in NumPy: their number depends on the numbers.

Everything runs over theta = phi/2. Seen along the direction (cos theta, sin theta), all three legs have the same
component p; across it their components are h, h + 2 c2 S and h + 2 (c3 S - d3 C). The length rho_i is the hypotenuse
of p and the i-th of these. So with one leg fixed, a singular curve is given by theta alone:

* f2 = 0 fixes the components across, see ``heights``, and p^2 = value^2 - height^2 remains: a real pose where it is not
  negative, a virtual point elsewhere.
* f1 = 0 is p = 0; the component of the fixed leg is value, the others follow.

Adding pi to theta turns all components' signs and means the same pose.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

TURN = 2 * np.pi
#: Tag of an end where p = 0; other tags are the leg of zero length.
NO_LEG = -1

#: Signs (e2, e3) of the four quadrics, which contain rho1 + e2 rho2 and rho1 + e3 rho3.
SIGNS = {"Q1": (-1, 1), "Q2": (1, 1), "Q3": (1, -1), "Q4": (-1, -1)}

Geometry = tuple[Any, Any, Any]


@dataclass(frozen=True)
class Piece:
    """A piece of a singular curve of a section, in order along the curve.

    Attributes:
        label: "S", or "Q1" to "Q4".
        virtual: True on the part of S whose pose is complex.
        closed: True where the last point is followed by the first (which is not repeated).
        joints: ``(k, 3)``.
        poses: ``(k, 3)``, the angle in [-pi, pi); NaN on a virtual piece.
    """

    label: str
    virtual: bool
    closed: bool
    joints: np.ndarray
    poses: np.ndarray


class SectionPoints(NamedTuple):
    """Points of a section.

    Attributes:
        joints: ``(n, 3)``.
        poses: ``(n, 3)``.
    """

    joints: np.ndarray
    poses: np.ndarray


class _Arc(NamedTuple):
    """An interval of an angle on which nothing changes.

    Attributes:
        kind: What is the same all over it.
        start: First angle.
        end: Last angle; greater than ``start``.
        tags: What ends it at both ends, or None for the whole circle.
    """

    kind: Any
    start: float
    end: float
    tags: tuple[int, int] | None


def heights(geometry: Geometry, s: Any, c: Any) -> tuple[Any, Any, Any]:
    """Returns the legs' components across, where f2 = 0, for the sine and cosine of theta (NumPy or JAX).

    They are f2 = 0 solved for h, plus 0, 2 c2 S and 2 (c3 S - d3 C); each factors into three sines.
    """
    c2, c3, d3 = geometry
    g, g_turned = c3 * s - d3 * c, c3 * c + d3 * s
    m, m_turned = (c2 - c3) * s + d3 * c, (c2 - c3) * c - d3 * s
    return 2 * s * g * m_turned / d3, 2 * s * g_turned * m / d3, 2 * c * g * m / d3


def crossings(geometry: Geometry, axis: int, value: float) -> SectionPoints:
    """Solves f1 = f2 = 0, that is height = value, over all theta."""
    theta = _crossing_angles(geometry, axis, value)
    h = _beside(geometry, axis, theta, value)
    joints = np.abs(h).T
    poses = _poses(np.zeros_like(theta), h[0], theta)
    order = np.argsort(poses[:, 2])
    return SectionPoints(joints[order], poses[order])


def curves(geometry: Geometry, axis: int, value: float, cusps: np.ndarray, samples: int) -> list[Piece]:
    """Returns the pieces of S, then those of the quadrics; ``cusps`` are angles phi that must be among the points."""
    return _surface(geometry, axis, value, cusps, samples) + _quadrics(geometry, axis, value, samples)


# --- S: the lines of the legs are concurrent, f2 = 0 --------------------------------------------------------


def _surface(geometry: Geometry, axis: int, value: float, cusps: np.ndarray, samples: int) -> list[Piece]:
    """Cuts the circle of phi where p or the length of a free leg is zero."""

    def squares(phi: np.ndarray, arc: _Arc | None = None) -> np.ndarray:
        return _squares(geometry, axis, value, phi, arc)

    def kind(phi: float) -> str:
        p2, *lengths = squares(np.asarray(phi))
        return "real" if p2 > 0 else "virtual" if min(lengths) >= 0 else "nothing"

    ends = {NO_LEG: _wrapped(2 * _crossing_angles(geometry, axis, value))}
    ends |= {leg: _wrapped(_zeros(lambda phi, leg=leg: squares(phi)[1 + leg], 2)) for leg in range(3) if leg != axis}
    pieces = []
    for arc in _arcs(ends, kind):
        if arc.kind == "real":
            pieces.append(_real_piece(geometry, axis, value, arc, cusps, samples))
        elif arc.kind == "virtual":
            pieces.append(_virtual_piece(lambda phi, arc=arc: squares(phi, arc), axis, value, arc, cusps, samples))
    return pieces


def _fixed_height(geometry: Geometry, axis: int, value: float, phi: np.ndarray, arc: _Arc | None) -> np.ndarray:
    """Returns the fixed leg's component across; exactly +-value at an end of the arc where p = 0."""
    fixed = heights(geometry, np.sin(phi / 2), np.cos(phi / 2))[axis]
    if arc is None or arc.tags is None:
        return fixed
    for end, tag in zip((arc.start, arc.end), arc.tags, strict=True):
        fixed = np.where((phi == end) & (tag == NO_LEG), np.copysign(value, fixed), fixed)
    return fixed


def _squares(geometry: Geometry, axis: int, value: float, phi: np.ndarray, arc: _Arc | None) -> np.ndarray:
    """Returns p^2 and the three squared lengths, ``(4, ...)``."""
    fixed = _fixed_height(geometry, axis, value, phi, arc)
    p2 = (value - fixed) * (value + fixed)
    return np.stack([p2, *(p2 + _beside(geometry, axis, phi / 2, fixed) ** 2)])


def _real_piece(geometry: Geometry, axis: int, value: float, arc: _Arc, cusps: np.ndarray, samples: int) -> Piece:
    def at(phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        fixed = _fixed_height(geometry, axis, value, phi, arc)
        p = np.sqrt(np.maximum((value - fixed) * (value + fixed), 0))
        h = _beside(geometry, axis, phi / 2, fixed)
        joints = np.hypot(p, h).T
        joints[:, axis] = value
        return joints, _poses(p, h[0], phi / 2), _poses(-p, h[0], phi / 2)

    def lengths(phi: np.ndarray) -> np.ndarray:
        joints, there, back = at(phi)
        return np.hstack([joints, there[:, :2], back[:, :2]])

    if arc.tags:
        joints, there, back = at(_refined(_nodes(_clustered(arc, samples // 2 + 1), cusps), lengths, samples))
        poses = np.concatenate([there, back[-2:0:-1]])
        return Piece("S", False, True, np.concatenate([joints, joints[-2:0:-1]]), poses)
    # Over phi twice: theta and theta + pi with the same p are the two sheets.
    phi = cusps[0] + np.linspace(0, 2 * TURN, 2 * samples + 1)
    joints, poses, _ = at(_refined(_nodes(phi, cusps), lengths, samples))
    return Piece("S", False, True, joints[:-1], poses[:-1])


def _virtual_piece(
    squares: Callable[[np.ndarray], np.ndarray], axis: int, value: float, arc: _Arc, cusps: np.ndarray, samples: int
) -> Piece:
    def at(phi: np.ndarray) -> np.ndarray:
        joints = np.sqrt(np.maximum(squares(phi)[1:], 0)).T
        joints[:, axis] = value
        return joints

    phi = _clustered(arc, samples) if arc.tags else cusps[0] + np.linspace(0, TURN, samples + 1)
    joints = at(_refined(_nodes(phi, cusps), at, samples))
    if arc.tags:
        _close_legs(joints, arc.tags)
    else:
        joints = joints[:-1]
    return Piece("S", True, arc.tags is None, joints, np.full(joints.shape, np.nan))


# --- Q1 to Q4: the legs are parallel, f1 = 0 ----------------------------------------------------------------


def _quadrics(geometry: Geometry, axis: int, value: float, samples: int) -> list[Piece]:
    """Cuts the closed curve of parallel legs where a free leg has zero length."""

    def signed(theta: np.ndarray) -> np.ndarray:
        return _beside(geometry, axis, theta, value)

    def label(theta: float) -> str:
        one, two, three = np.where(signed(np.asarray(theta)) < 0, -1, 1)
        return next(name for name, (e2, e3) in SIGNS.items() if (one * two, one * three) == (-e2, -e3))

    ends = {leg: _wrapped(_zeros(lambda theta, leg=leg: signed(theta)[leg], 1)) for leg in range(3) if leg != axis}
    tangent = _crossing_angles(geometry, axis, value)
    pieces = []
    for arc in _arcs(ends, label):
        number = max(8, round(samples * (arc.end - arc.start) / TURN)) + 1
        theta = _nodes(np.linspace(arc.start, arc.end, number), tangent)
        theta = _refined(theta, lambda theta: np.abs(signed(theta)).T, samples)
        theta = theta[:-1] if arc.tags is None else theta
        components = signed(theta)
        joints = np.abs(components).T
        if arc.tags is not None:
            _close_legs(joints, arc.tags)
        poses = _poses(np.zeros_like(theta), components[0], theta)
        pieces.append(Piece(arc.kind, False, arc.tags is None, joints, poses))
    return pieces


# --- angles -------------------------------------------------------------------------------------------------


def _across(geometry: Geometry, theta: np.ndarray) -> np.ndarray:
    """Returns by how much the legs' components across differ from that of leg 1, ``(3, ...)``."""
    c2, c3, d3 = geometry
    s, c = np.sin(theta), np.cos(theta)
    return np.stack([np.zeros_like(s), 2 * c2 * s, 2 * (c3 * s - d3 * c)])


def _beside(geometry: Geometry, axis: int, theta: np.ndarray, fixed: Any) -> np.ndarray:
    """Returns the components across of all legs, ``(3, ...)``, from the fixed one's: so the pose fits all three."""
    across = _across(geometry, theta)
    return fixed + (across - across[axis])


def _crossing_angles(geometry: Geometry, axis: int, value: float) -> np.ndarray:
    """Returns theta in [0, 2 pi), each pose with f1 = f2 = 0 once: there the fixed leg's height is +value."""
    return _zeros(lambda theta: heights(geometry, np.sin(theta), np.cos(theta))[axis] - value, 3)


def _zeros(f: Callable[[np.ndarray], np.ndarray], degree: int) -> np.ndarray:
    """Returns all zeros with a change of sign, in [0, 2 pi), of a trigonometric polynomial.

    Between two turning points f is monotone, so a change of sign is one zero, and bisection finds it to the last
    bit. The turning points are roots of a polynomial on the unit circle; the angles of all its roots cut the circle,
    as a cut too many does no harm and a root that rounding moved off the circle is not lost.
    """
    n = 2 * degree + 2
    slope = 1j * np.arange(degree + 1) * np.fft.rfft(f(TURN * np.arange(n) / n))[: degree + 1]
    cuts = np.sort(np.angle(np.roots(np.concatenate([slope[::-1], slope[1:].conj()]))) % TURN)
    positive = f(cuts) > 0
    change = positive != np.roll(positive, -1)
    low, high, positive = cuts[change], np.append(cuts[1:], cuts[0] + TURN)[change], positive[change]
    for _ in range(60):
        middle = (low + high) / 2
        same = (f(middle) > 0) == positive
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return np.sort(((low + high) / 2) % TURN)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Moves angles to [-pi, pi); one that is there already stays as it is."""
    angle = np.maximum(angle - TURN * np.floor((angle + np.pi) / TURN), -np.pi)
    return np.where(angle >= np.pi, -np.pi, angle)


def _poses(p: np.ndarray, h: np.ndarray, theta: np.ndarray) -> np.ndarray:
    s, c = np.sin(theta), np.cos(theta)
    return np.stack([p * c - h * s, p * s + h * c, _wrapped(2 * theta)], axis=1)


def _arcs(ends: dict[int, np.ndarray], kind: Callable[[float], Any]) -> list[_Arc]:
    """Cuts the circle at angles with tags, and joins neighbours of the same kind."""
    cuts = np.concatenate(list(ends.values()))
    tags = np.concatenate([np.full(len(v), tag) for tag, v in ends.items()])
    order = np.argsort(cuts)
    cuts, tags = cuts[order], tags[order]
    kinds = [kind(middle) for middle in (cuts + np.append(cuts[1:], cuts[:1] + TURN)) / 2]
    kept = [i for i in range(len(cuts)) if kinds[i] != kinds[i - 1]]
    if not kept:
        return [_Arc(kinds[0] if kinds else kind(0.0), -np.pi, np.pi, None)]
    arcs = []
    for i, j in zip(kept, kept[1:] + kept[:1], strict=True):
        arcs.append(_Arc(kinds[i], cuts[i], cuts[j] + (TURN if j <= i else 0), (int(tags[i]), int(tags[j]))))
    return arcs


# --- points on an arc ---------------------------------------------------------------------------------------


def _clustered(arc: _Arc, number: int) -> np.ndarray:
    """Returns angles that are dense at the ends, where p or a length grows like a square root."""
    middle, half = (arc.start + arc.end) / 2, (arc.end - arc.start) / 2
    angles = middle - half * np.cos(np.linspace(0, np.pi, number))
    angles[0], angles[-1] = arc.start, arc.end
    return angles


def _nodes(angles: np.ndarray, marks: np.ndarray) -> np.ndarray:
    """Adds the marks, modulo a turn, that lie between the first and the last angle, in place of angles next to them."""
    first, last = angles[0], angles[-1]
    inner = first + (marks - first) % TURN
    inner = np.unique(np.concatenate([inner, inner + TURN]))
    inner = inner[(inner > first + 1e-9) & (inner < last - 1e-9)]
    far = np.all(np.abs(angles[:, None] - inner) > 1e-9, axis=1)
    return np.sort(np.concatenate([angles[far], inner]))


def _refined(angles: np.ndarray, points: Callable[[np.ndarray], np.ndarray], samples: int) -> np.ndarray:
    """Halves intervals until the curve's middle is as near the chord as on a circle with so many points."""
    for _ in range(20):
        ends, middles = points(angles), (angles[1:] + angles[:-1]) / 2
        chord, offset = np.diff(ends, axis=0), points(middles) - ends[:-1]
        share = np.sum(offset * chord, axis=1) / np.maximum(np.sum(chord**2, axis=1), np.finfo(float).tiny)
        gap = np.linalg.norm(offset - share[:, None] * chord, axis=1)
        far = gap > 0.5 * (np.pi / samples) ** 2 * np.ptp(ends, axis=0).max()
        if not far.any():
            break
        angles = np.sort(np.concatenate([angles, middles[far]]))
    return angles


def _close_legs(joints: np.ndarray, tags: tuple[int, int]) -> None:
    """Sets the lengths that end a piece to zero exactly."""
    for row, tag in zip((0, -1), tags, strict=True):
        if tag != NO_LEG:
            joints[row, tag] = 0.0
