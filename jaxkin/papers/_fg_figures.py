"""Counterparts of the figures of Fu and Gao, and the numbers of the workspace.

The print's own figures were not at hand, only their captions and the text: these are drawn after them. L, stroke
limits, link sizes and the platform's orientation are not printed; what is drawn with them is ours.
"""

import math

import jax
import numpy as np
from jax import Array

import jaxkin as jk
from jaxkin.mapping.workspace import free_volume, workspace_surfaces, workspace_volume
from jaxkin.mechanisms import _tlpm_wrist, tlpm
from jaxkin.papers import _fg_print as printed
from jaxkin.papers._fg_equations import HEIGHT, RADIUS, SEED
from jaxkin.papers._samples import ROUNDING
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Picture, Table

#: Where p stands in the counterpart of Fig. 4, on the singular plane.
_LEVEL = (120.0, 80.0, -HEIGHT)
#: Length of the shortest limb in the other counterpart of Fig. 4, mm.
_SHORT = 100.0
#: Points by which a workspace's volume is estimated independently.
_POINTS = 400000
#: Yaw of the platform, degrees, at which links are close to each other.
_YAW = 60.0


def figure_2(robot: tlpm.TLPM | None = None) -> Part:
    """Draws the two configurations of one set of strokes, after Fig. 2: those of Table 1.

    Args:
        robot: Another robot, drawn in the middle of its strokes; L = h = 590 mm and Table 1 by default.
    """
    own = robot is None
    machine = tlpm.create(RADIUS, HEIGHT) if robot is None else robot
    middle = (machine.limits.low + machine.limits.high) / 2
    strokes = jk.inverse(machine, np.array(printed.P1)).values[0] if own else middle
    modes = jk.forward(machine, strokes)
    where, key = ("Fig. 2", "figure_2") if own else (_words("Fig. 2", machine), _name("figure_2", machine))
    checks = [count_check(key, where, "configurations at one set of strokes", 2, int(modes.count))]
    both = np.asarray(modes.values)
    height = float(machine.height)
    mirrored = np.array([both[0, 0], both[0, 1], -2 * height - both[0, 2]])
    off = float(np.max(np.abs(both[1] - mirrored)))
    what = "the second is the first, mirrored in the base plane; mm"
    checks.append(Check(f"{key}-mirror", where, what, "not said", "equal", off, 1e-9))
    place = "of Table 1" if own else "in the middle of the strokes"
    caption = f"After {where}: the two configurations {place}; the limbs' links are ours"
    return Part(f"After {where}", tuple(checks), {key: Picture.of(jk.plot.mechanism(machine, strokes), caption)})


def figure_3(robot: tlpm.TLPM | None = None) -> Part:
    """Draws the workspace of the strokes, after Fig. 3, and checks its volume.

    Args:
        robot: Another robot; L = h = 590 mm and strokes of +-200 mm by default [ours].
    """
    own = robot is None
    machine = tlpm.create(RADIUS, HEIGHT) if robot is None else robot
    where, key = ("Fig. 3", "figure_3") if own else (_words("Fig. 3", machine), _name("figure_3", machine))
    surfaces = workspace_surfaces(machine)
    upper, lower = workspace_volume(machine), workspace_volume(machine, "lower")
    volume, where_ours = float(upper.volume), f"{where} [ours]"
    checks = [
        _integrated(machine, volume, key, where_ours) if own else _sampled(machine, volume, key, where_ours),
        Check(
            f"{key}-branches",
            where_ours,
            "the lower branch, z < -h, has the same volume: relative difference",
            "not said",
            f"{float(lower.volume):.3f} mm^3",
            abs(float(lower.volume) - volume) / volume,
            ROUNDING,
        ),
        Check(
            f"{key}-residual",
            where,
            "largest dimensionless residual of the boundary's vertices",
            "0",
            f"{surfaces.residual:.1e}",
            surfaces.residual,
            ROUNDING,
        ),
        count_check(f"{key}-open", where, "edges of the drawn boundary without a neighbour", 0, surfaces.open_edges),
        _reached(machine, surfaces, key, where),
    ]
    faces = [(patch.name, patch.area) for patch in surfaces]
    table = Table(
        f"Faces of the workspace (mm^2), {volume:.3f} mm^3 in one branch [ours: L, strokes]", ("face", "area"), faces
    )
    caption = f"After {where}: the workspace of the strokes, z > -h; L and the limits of the strokes are ours"
    pictures = {key: Picture.of(jk.plot.workspace(surfaces), caption)}
    return Part(f"After {where}", tuple(checks), pictures, {key.replace("figure_3", "workspace"): table})


def _integrated(robot: tlpm.TLPM, volume: float, key: str, where: str) -> Check:
    """Compares a volume with the integral over the strokes, for eta = 0, 120, -120 degrees, clear of the plane z = -h.

    With s_i = (l_i0 + l_i)^2 the determinant (12) gives dV = ds1 ds2 ds3 / (12 sqrt3 L^2 (z + h)).
    """
    nodes, weights = np.polynomial.legendre.leggauss(24)
    low, high = (np.asarray(robot.initial_lengths + end) ** 2 for end in (robot.limits.low, robot.limits.high))
    squares = (low + high)[:, None] / 2 + (high - low)[:, None] / 2 * nodes
    s1, s2, s3 = np.meshgrid(*squares, indexing="ij")
    radius = float(robot.base_radius)
    x, y = (s2 + s3 - 2 * s1) / (6 * radius), (s3 - s2) / (2 * printed.ROOT3 * radius)
    above = np.sqrt(s1 - (x - radius) ** 2 - y**2)
    weight = np.einsum("i,j,k->ijk", weights, weights, weights) * np.prod((high - low) / 2)
    expected = float(np.sum(weight / above)) / (12 * printed.ROOT3 * radius**2)
    words = "+-200 mm" if np.ptp(np.abs(np.asarray([robot.limits.low, robot.limits.high]))) == 0 else "of the robot"
    what = f"volume of one branch for L = h = {radius:g} mm and strokes {words}, mm^3; the difference is relative"
    note = "against the integral over the strokes by (12)"
    off = abs(volume - expected) / expected
    return Check(f"{key}-volume", where, what, f"{expected:.3f}", f"{volume:.3f}", off, 1e-11, note)


def _sampled(robot: tlpm.TLPM, volume: float, key: str, where: str) -> Check:
    """Compares a volume with random points of a box about the workspace."""
    surfaces = workspace_surfaces(robot)
    vertices = np.concatenate([patch.vertices for patch in surfaces])
    low, high = vertices.min(axis=0) - 1.0, vertices.max(axis=0) + 1.0
    high[2] += 0.05 * (high[2] - low[2])
    points = np.random.default_rng(SEED).uniform(low, high, (_POINTS, 3))
    inside = np.asarray(_within(robot, points)) & (points[:, 2] > -float(robot.height))
    box, share = float(np.prod(high - low)), float(np.mean(inside))
    expected = box * share
    error = box * math.sqrt(share * (1 - share) / _POINTS)
    what = "volume of one branch, mm^3, against random points; the difference is in standard errors"
    off = abs(volume - expected) / error
    return Check(f"{key}-volume", where, what, f"{expected:.4g}", f"{volume:.6g}", off, 4.0)


def _reached(robot: tlpm.TLPM, surfaces: object, key: str, where: str) -> Check:
    """Strokes at the faces that are named for a limit."""
    low, high = np.asarray(robot.limits.low), np.asarray(robot.limits.high)
    worst = 0.0
    for patch in surfaces:  # type: ignore[attr-defined]
        if patch.singular:
            continue
        limb = int(patch.name[1]) - 1
        limit = (low if patch.name.endswith("min") else high)[limb]
        strokes = np.asarray(_strokes(robot, patch.vertices))[:, limb]
        worst = max(worst, float(np.max(np.abs(strokes - limit))))
    what = "strokes on each face against the limit that it is named for, mm"
    return Check(f"{key}-faces", where, what, "the limits", "equal", worst, 1e-9)


def figure_4() -> Part:
    """Draws the two direct singular configurations, after Fig. 4: p in the base plane, and p towards q_1."""
    robot = tlpm.create(RADIUS, HEIGHT, stroke=np.array([-800.0, 800.0]))
    where = "Fig. 4"
    level = np.array(_LEVEL)
    direct = np.asarray(jk.jacobians(robot, level, jk.inverse(robot, level).values[0]).direct)
    rank = int(np.linalg.matrix_rank(direct, tol=1e-9 * float(np.abs(direct).max())))
    checks = [count_check("figure_4-rank", where, "rank of dF/dp in the plane z = -h", 2, rank)]
    _, _, axes = np.linalg.svd(direct)
    off = float(np.max(np.abs(np.abs(axes[2]) - [0.0, 0.0, 1.0])))
    what = "direction that the strokes do not control there: z"
    checks.append(Check("figure_4-motion", where, what, "not said", "(0, 0, 1)", off, ROUNDING))
    corner = printed.base_points(RADIUS, HEIGHT)[0]
    length = float(printed.lengths(RADIUS, HEIGHT, corner)[0])
    what = "length of limb 1 at p = q_1, mm: a serial singularity, of a limb without length"
    checks.append(Check("figure_4-corner", where, what, "p = q_i", f"{length:g}", length, 1e-9))
    pictures = {
        "figure_4": Picture.of(
            jk.plot.pose(robot, level),
            "After Fig. 4: p in the base plane z = -h, where the strokes do not control its motion along z (arrows)",
        ),
        "figure_4_corner": Picture.of(
            jk.plot.pose(robot, corner - np.array([_SHORT, 0.0, 0.0])),
            f"After Fig. 4: p in that plane and {_SHORT:g} mm from q_1; at q_1 itself limb 1 has no length and no "
            "direction",
        ),
    }
    return Part("After Fig. 4", tuple(checks), pictures)


def figures_5_to_7() -> Part:
    """Draws the angles of a wrist and the links of all, after Figs. 5, 6 and 7 [ours: links and orientation]."""
    robot = tlpm.create(RADIUS, HEIGHT)
    turned = tlpm.create(RADIUS, HEIGHT, orientation=_yaw(_YAW))
    home, p1 = np.zeros(3), np.array(printed.P1)
    pictures = {
        "figure_5": Picture.of(
            jk.plot.wrist_angles(robot, p1),
            "After Fig. 5: the angles theta_11 and theta_12 of limb 1 at P1 and what their lower limits forbid [ours: "
            "links]",
        ),
        "figure_6": Picture.of(
            jk.plot.interference(turned, home),
            f"After Fig. 6: links at home, the platform turned by {_YAW:g} degrees about z: under the limit, not "
            "proven free [ours]",
        ),
        "figure_7": Picture.of(
            jk.plot.clearance_limit(robot), "After Fig. 7: why sqrt2 a is the least distance that excludes contact"
        ),
    }
    free, table = _yaws()
    return Part("After Figs. 5-7", (*_distances(robot), *free, _free(robot)), pictures, {"yaw": table})


def _yaw(degrees: float) -> np.ndarray:
    """Returns the quaternion of a turn about z."""
    half = math.radians(degrees) / 2
    return np.array([math.cos(half), 0.0, 0.0, math.sin(half)])


def _distances(robot: tlpm.TLPM) -> list[Check]:
    """Distances of links at home and at P1 against points along both axes."""
    checks = []
    for name, point in (("home", (0.0, 0.0, 0.0)), ("P1", printed.P1)):
        clear = _tlpm_wrist.link_clearances(robot, np.array(point))
        ends: dict[str, np.ndarray] = dict(
            zip(_tlpm_wrist.LINK_NAMES, np.asarray(_tlpm_wrist.links(robot, np.array(point))), strict=True)
        )
        share = np.linspace(0.0, 1.0, 301)[:, None]
        gaps, found = [], []
        for pair, value in clear.items():
            one, other = (ends[link][0] + share * (ends[link][1] - ends[link][0]) for link in pair.split("-"))
            gaps.append(float(np.min(np.linalg.norm(one[:, None] - other, axis=-1))))
            found.append(float(value) + math.sqrt(2.0) * float(robot.a))
        off = float(np.max(np.abs(np.array(gaps) - found)))
        kinds = (min(found[:3]), min(found[3:6]), min(found[6:]))
        got = ", ".join(f"{value:.4f}" for value in kinds)
        what = (
            f"distances of all twelve pairs of links at {name} against points along both axes, mm; least D22, D33, D23"
        )
        checks.append(Check(f"distances-{name}", "Fig. 6 [ours]", what, "", got, off, 0.05))
    return checks


def _free(robot: tlpm.TLPM) -> Check:
    """The conclusion, for sizes of ours: no interference in the workspace."""
    found = free_volume(robot, tolerance=1e-2)
    what = "share of the workspace after Fig. 3 that is proven free of interference, platform not turned, links of ours"
    off = abs(1.0 - found.share)
    return Check("free", "section 6 [ours]", what, "free to move", f"{100 * found.share:.4f} %", off, 1e-3)


def _yaws() -> tuple[list[Check], Table]:
    """How far the platform may be turned about z at home."""
    degrees = np.arange(-90.0, 90.5, 0.5)
    robots = jax.vmap(lambda q: tlpm.create(RADIUS, HEIGHT).replace(orientation=q))(
        np.array([_yaw(value) for value in degrees])
    )
    least = np.asarray(_least_clearance(robots))
    free = degrees[least >= 0]
    alone = bool(np.all(np.diff(free) == 0.5))
    what = "yaw angles at home that are proven free, a = 25 mm, are one interval about 0"
    got = f"{free[0]:g} to {free[-1]:g} degrees" if len(free) else "none"
    inside = len(free) > 0 and free[0] < 0 < free[-1] and alone
    checks = [Check("yaw", "Fig. 6 [ours]", what, "", got, 0.0 if inside else 1.0, 0.0, "in steps of half a degree")]
    rows = [(float(value), float(c)) for value, c in zip(degrees[::20], least[::20], strict=True)]
    title = "Least clearance D - sqrt2 a of the links at home over the platform's yaw (mm, e = +1) [ours]"
    return checks, Table(title, ("yaw (degrees)", "clearance"), rows)


def _name(stem: str, robot: tlpm.TLPM) -> str:
    return f"{stem}_L_{float(robot.base_radius):g}_h_{float(robot.height):g}".replace(".", "_")


def _words(figure: str, robot: tlpm.TLPM) -> str:
    return f"{figure} for L = {float(robot.base_radius):g}, h = {float(robot.height):g} mm"


@jax.jit
def _strokes(robot: tlpm.TLPM, points: Array) -> Array:
    return jax.vmap(lambda p: jk.inverse(robot.replace(limits=jk.Limits.none(3)), p).values[0])(points)  # type: ignore[arg-type]


@jax.jit
def _within(robot: tlpm.TLPM, points: Array) -> Array:
    return jax.vmap(lambda p: jk.inverse(robot, p).valid[0])(points)


@jax.jit
def _least_clearance(robots: tlpm.TLPM) -> Array:
    def least(robot: tlpm.TLPM) -> Array:
        zero = jax.numpy.zeros(())
        return jax.numpy.min(jax.numpy.stack(list(_tlpm_wrist.clearances(robot, (zero, zero, zero)).values())))

    return jax.vmap(least)(robots)
