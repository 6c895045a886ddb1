"""Counterparts of the figures of Chablat, Baron, Jha and Rolland 2018, and the statements of its section 4.

The print's own figures were not at hand, only their captions and the text: these are drawn after them.
"""

import math
from typing import cast

import numpy as np
from matplotlib.axes import Axes

import jaxkin as jk
from jaxkin.mapping.orientation import Solid, aspect_solid
from jaxkin.mechanisms import ppps3
from jaxkin.mechanisms import ppps3_closed_forms as closed
from jaxkin.papers import _cbjr2018_print as printed
from jaxkin.papers._cbjr2018_equations import SEED
from jaxkin.papers._samples import ROUNDING
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.plot import style
from jaxkin.reports.document import Picture

_RIGHT = math.pi / 2
#: Steps of the drawn surfaces along a turn.
_STEPS = 48
#: At theta = +-pi/2 itself, where cos(theta) is a rounding, the sign of R33 means nothing.
_INSIDE = 1e-9
#: Random orientations at which statements on the home aspect are tested.
_SAMPLES = 20000


def figure_1(robot: ppps3.PPPS3 | None = None) -> Part:
    """Draws the robot at home, and in its four assembly modes there, after Fig. 1.

    Args:
        robot: Another size of the robot; the paper's by default.
    """
    own = robot is None
    robot = ppps3.create() if robot is None else robot
    side, home = float(robot.side), np.zeros(6)
    joints = np.asarray(jk.inverse(robot, home).values[0])
    long = side * printed.ROOT3 / 2
    off = float(np.max(np.abs(joints - [0.0, 0.0, long, 0.0, -long, 0.0])))
    key, where = ("figure_1", "Fig. 1") if own else (f"figure_1_side_{side:g}", f"Fig. 1 for side = {side:g}")
    what = "joints at home: (0, 0, sqrt3/2, 0, -sqrt3/2, 0) sides"
    checks = [Check(f"{key}-joints", where, what, "phi = theta = sigma = 0", "equal", off, ROUNDING * side)]
    passive = np.asarray(ppps3.passive_joints(robot, home))
    off = float(np.max(np.abs(passive - [0.0, -side / 2 * robot.mirror, -side / 2 * robot.mirror])))
    what = "passive joints at home: (0, -1/2, -1/2) sides, the opposite where mirrored"
    checks.append(Check(f"{key}-passive", where, what, "not given", "equal", off, ROUNDING * side))
    modes = jk.forward(robot, joints)
    checks.append(count_check(f"{key}-modes", where, "assembly modes at the joints of home", 4, int(modes.count)))
    aside = np.array([*(side * np.array([0.3, -0.1, 0.9])), 0.4, 0.3, -0.35])
    away = jk.inverse(robot, aside).values[0]
    name = key.replace(".", "_")
    pictures = {
        name: Picture.of(
            jk.plot.pose(robot, np.array([0.0, 0.0, side, 0.0, 0.0, 0.0])),
            f"After {where}: the robot with its platform turned as at home, z = {side:g} so that all joints are seen; "
            "actuated joints blue, passive ones white, the platform green",
        ),
        f"{name}_modes": Picture.of(
            jk.plot.mechanism(robot, away), f"Four assembly modes, one of each aspect, of the robot of {where} [ours]"
        ),
    }
    return Part(f"After {where}", tuple(checks), pictures)


def figure_2() -> Part:
    """Draws the singular surfaces in the space of the angles, after Fig. 2, and checks them."""
    robot = ppps3.create()
    box = jk.Grid(
        x=0.0,
        y=0.0,
        z=0.0,
        phi=(-math.pi, math.pi, _STEPS),
        theta=(-_RIGHT + _INSIDE, _RIGHT - _INSIDE, _STEPS // 2 + 1),
        sigma=(-math.pi, math.pi, _STEPS),
    )
    surfaces = jk.singular_surfaces(robot, box)
    where, worst = "Fig. 2", 0.0
    for surface in surfaces:
        worst = max(worst, float(np.max(np.abs(printed.singular(tuple(surface.vertices[:, 3:].T))))))
    what = "(29) at all vertices of the drawn surfaces"
    checks = [Check("figure_2-29", where, what, "0", f"{worst:.1e}", worst, ROUNDING)]
    what = "largest dimensionless residual of all vertices and of the crossing curve"
    worst = max(surfaces.residual, *(crossing.residual for crossing in surfaces.crossings))
    checks.append(Check("figure_2-residual", where, what, "0", f"{worst:.1e}", worst, ROUNDING))
    lost = sum(surface.unpolished for surface in surfaces)
    checks.append(count_check("figure_2-lost", where, "vertices that did not converge", 0, lost))
    flat = {surface.name: surface for surface in surfaces}["R33"].vertices[:, 3]
    off = float(np.max(np.abs(np.abs(flat) - _RIGHT)))
    what = "R33 = 0 is the planes phi = +-pi/2 for |theta| < pi/2, the paper's first surface: distance of its vertices"
    checks.append(Check("figure_2-plane", where, what, "cos(phi) = 0", f"{off:.1e}", off, ROUNDING))
    checks += _regions()
    caption = (
        "After Fig. 2: the singular surfaces in the angles. cos(phi) = 0, blue as in the paper, is R33 = 0, and the "
        "last term of (29), red, is R22 = 0. The paper's green surface, cos(theta) = 0, is the front and the back of "
        "the box; R33 vanishes there as well, and on the rotations it is no surface but two circles"
    )
    ax = jk.plot.surfaces(surfaces)
    ax.set_yticks((-_RIGHT, 0.0, _RIGHT), ("−π/2", "0", "π/2"))
    return Part("After Fig. 2", tuple(checks), {"figure_2": Picture.of(ax, caption)})


def _regions() -> list[Check]:
    """Pieces of the box of angles between the surfaces, as they are, and with opposite faces glued."""
    checks = []
    for span, words, expected in ((1, "|theta| < pi/2", (9, 4)), (2, "|theta| < pi", (27, 8))):
        loose, glued = _pieces(span)
        what = f"pieces between the surfaces (29) of the box |phi|, |sigma| < pi, {words}"
        checks.append(count_check(f"figure_2-pieces-{span}", "Fig. 2 [ours]", what, expected[0], loose))
        note = "the four aspects" if span == 1 else "each rotation has two triples of angles here: four aspects, twice"
        what = f"the same once the ends of full turns are glued, {words}"
        checks.append(count_check(f"figure_2-glued-{span}", "Fig. 2 [ours]", what, expected[1], glued, note))
    return checks


def _pieces(span: int, count: int = 48) -> tuple[int, int]:
    """Returns the number of pieces of the box with |theta| < span pi/2, and of those that remain when it is glued."""
    from scipy.ndimage import label
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    # Middles of cells lie on no plane of symmetry, where factors vanish.
    nodes = [k * _RIGHT * ((2 * np.arange(count) + 1) / count - 1) for k in (2, span, 2)]
    angles = np.meshgrid(*nodes, indexing="ij")
    turn = printed.rotation(tuple(angles))
    kind = 4 * (turn[1][1] > 0) + 2 * (np.cos(angles[0]) > 0) + (np.cos(angles[1]) > 0)
    loose, glued = 0, 0
    for number in np.unique(kind):
        pieces, found = cast("tuple[np.ndarray, int]", label(kind == number))
        ends = [(pieces[0], pieces[-1]), (pieces[..., 0], pieces[..., -1])]
        if span == 2:
            ends.append((pieces[:, 0], pieces[:, -1]))
        pairs = np.concatenate(
            [np.stack([one[one * other > 0], other[one * other > 0]]) for one, other in ends], axis=1
        )
        graph = coo_matrix((np.ones(pairs.shape[1]), pairs - 1), shape=(found, found))
        loose, glued = loose + found, glued + connected_components(graph, directed=False)[0]
    return loose, glued


def figure_3() -> Part:
    """Draws the home aspect in the angles of the paper, after Fig. 3, and checks what section 4 says of it."""
    robot = ppps3.create()
    solid = aspect_solid(robot)
    where = "Fig. 3"
    what = "largest |R22| or |R33| on the faces where it must vanish"
    checks = [Check("figure_3-residual", where, what, "0", f"{solid.residual:.1e}", solid.residual, ROUNDING)]
    checks += [*_ranges(solid), *_rectangles(), *_saddles()]
    caption = "After Fig. 3: the aspect of the home pose in the angles (phi, theta, sigma)"
    slices, words = home_slices()
    pictures = {"figure_3": Picture.of(jk.plot.solid(solid), caption), "figure_3_slices": Picture.of(slices, words)}
    return Part("After Fig. 3, section 4", tuple(checks), pictures)


def _ranges(solid: Solid) -> list[Check]:
    """The first two bullets: ranges of the angles."""
    box = np.random.default_rng(SEED).uniform(-1, 1, (_SAMPLES, 3)) * [math.pi, _RIGHT, math.pi]
    turn = printed.rotation(tuple(box.T))
    home = (turn[1][1] > 0) & (turn[2][2] > 0)
    where = "section 4"
    ends = np.max(np.abs(solid.vertices), axis=0)
    off = float(np.max(np.abs(ends[:2] - _RIGHT)))
    what = "largest |phi| and |theta| of the home aspect"
    checks = [Check("ranges", f"{where}, bullet 1", what, "pi/2", "pi/2", off, ROUNDING)]
    what = "random orientations of the home aspect with |phi| or |theta| above pi/2"
    outside = int(np.sum(home & np.any(np.abs(box[:, :2]) > _RIGHT, axis=1)))
    checks.append(count_check("ranges-random", f"{where}, bullet 1", what, 0, outside))
    off = abs(float(ends[2]) - math.pi)
    what = "largest |sigma| of the home aspect, reached at phi = +-pi/2 only: the range of bullet 2 is sigma's"
    checks.append(Check("range-sigma", f"{where}, bullet 2", what, "phi from -pi to pi", "pi", off, ROUNDING))
    phi = np.linspace(-1.5, 1.5, 31)
    theta = np.linspace(-_RIGHT, _RIGHT, 201)
    low, high = (np.asarray(end) for end in closed.home_interval(phi[:, None], theta))
    off = float(np.max(np.abs(np.maximum(-low, high).max(axis=1) - _RIGHT - np.abs(phi))))
    what = "largest |sigma| at a given phi = pi/2 + |phi|"
    checks.append(Check("range-sigma-phi", f"{where}, bullet 2 [ours]", what, "not said", "equal", off, ROUNDING))
    level = np.abs(box[:, 0]) < _RIGHT
    low, high = (np.asarray(end) for end in closed.home_interval(np.where(level, box[:, 0], 0.0), box[:, 1]))
    wrong = int(np.sum((level & (box[:, 2] > low) & (box[:, 2] < high)) != home))
    what = f"random orientations, of {_SAMPLES} in the whole box, on which the interval of sigma and the signs disagree"
    return [
        *checks,
        count_check("interval", f"{where} [ours]", what, 0, wrong, "one cell, sigma being last; printed: two"),
    ]


def _rectangles() -> list[Check]:
    """Bullets 2 and 3: the slices at phi = +-pi/2 and at phi = 0."""
    rng, checks = np.random.default_rng(SEED), []
    theta, sigma = rng.uniform(-_RIGHT, _RIGHT, _SAMPLES), rng.uniform(-math.pi, math.pi, _SAMPLES)
    where = "section 4, bullets 2, 3"
    for side, words in ((1, "pi/2"), (-1, "-pi/2")):
        inside = printed.rotation((np.full(_SAMPLES, side * _RIGHT), theta, sigma))[1][1] > 1e-9
        wrong = int(np.sum(inside & (np.sign(theta * sigma) != -side)))
        signs = "opposite signs" if side > 0 else "the same sign"
        what = f"orientations of the home aspect in the limit phi = {words} where sigma and theta do not have {signs}"
        checks.append(count_check(f"rectangles{side:+d}", where, what, 0, wrong))
        if side < 0:
            kept = int(np.sum(inside & (sigma < 0) & (theta > 0)))
            what = "orientations there with sigma < 0 and theta > 0, which the text has at phi = -pi/2"
            note = "it is the second rectangle of phi = +pi/2"
            checks.append(count_check("rectangle-printed", "section 4, bullet 3", what, 0, kept, note))
    found = {side: closed.home_slice(side * _RIGHT) for side in (1, -1)}
    off = max(
        abs(float(np.max(np.abs(piece.high - piece.low - math.pi)))) + abs(float(np.ptp(piece.theta)) - _RIGHT)
        for pieces in found.values()
        for piece in pieces
    )
    what = "sides of the rectangles: pi/2 in theta, pi in sigma"
    checks.append(Check("rectangle-sides", where, what, "rectangles", "2 at either end", off, ROUNDING))
    square = closed.home_slice(0.0)[0]
    off = float(np.max(np.abs(np.stack([square.low + _RIGHT, square.high - _RIGHT]))))
    off = max(off, abs(float(np.max(np.abs(square.theta))) - _RIGHT))
    what = "the slice phi = 0 is the square |theta|, |sigma| <= pi/2"
    return [*checks, Check("square", "section 4, bullet 3", what, "a square", "equal", off, ROUNDING)]


def _saddles() -> list[Check]:
    """Saddle points of R22 = 0: the two of the paper and six more."""
    step, worst = 1e-3, 0.0
    for saddle in closed.saddles():
        others = [k for k in range(3) if k != saddle.axis]
        for first, second in ((step, step), (step, -step), (-step, step), (-step, -step)):
            angles = np.array(saddle.angles)
            angles[others] += first, second
            angles[saddle.axis] += saddle.product * first * second
            # To second order the surface is there: what is left is of fourth order.
            worst = max(worst, abs(float(printed.rotation(tuple(angles))[1][1])))
    what = f"R22 on the local form of each saddle, at deviations of {step:g} rad, over their fourth power"
    over = worst / step**4
    count = sum(saddle.printed for saddle in closed.saddles())
    what_count = "saddle points with sigma = theta = 0"
    return [
        count_check("saddles", "section 4", what_count, 2, count, "at phi = +-pi/2; six more are ours"),
        Check("saddles-form", "section 4", what, "saddle points", f"{over:.2g}", over, 1.0, "phi = pi/2 - theta sigma"),
    ]


def home_slices() -> tuple[Axes, str]:
    """Draws slices of the home aspect at five phi, from phi = -pi/2 to pi/2 [ours, after the text of section 4]."""
    import matplotlib.pyplot as plt

    axes = plt.subplots(1, 5, figsize=(7.2, 2.9), sharey=True, layout="constrained")[1]
    for ax, degrees in zip(axes, (-90, -60, 0, 60, 90), strict=True):
        for piece in closed.home_slice(math.radians(degrees) if abs(degrees) < 90 else math.copysign(_RIGHT, degrees)):
            ax.fill_between(piece.theta, piece.low, piece.high, color=style.OKABE_ITO["sky"], alpha=0.6, linewidth=0)
            ring = np.concatenate([piece.theta, piece.theta[::-1], piece.theta[:1]])
            ends = np.concatenate([piece.high, piece.low[::-1], piece.high[:1]])
            ax.plot(ring, ends, color="black", linewidth=0.8)
        style.dress(ax, ("theta", "rad"), ("sigma", "rad"))
        ax.set(ylim=(-3.4, 3.4), xlim=(-1.75, 1.75), aspect="equal")
        ax.set_title(rf"$\phi$ = {degrees}°".replace("-", "−"), fontsize="small")
    for ax in axes[1:]:
        ax.set_ylabel("")
    return axes, (
        "Slices of the home aspect, after the text of section 4: a square at phi = 0, two rectangles at phi = +-90 "
        "degrees, where sigma and theta have opposite signs at +90 and the same sign at -90 degrees"
    )
