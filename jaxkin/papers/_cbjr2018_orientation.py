"""What the paper's home aspect is on the rotations themselves, and its joints: shares, volumes, distances [ours].

Nothing here is in Chablat, Baron, Jha and Rolland 2018, but for the aspect it is about.
"""

import math

import numpy as np

import jaxkin as jk
from jaxkin.mapping.orientation import aspect_solid, joint_solid, largest_rotation_ball, orientation_aspects
from jaxkin.mechanisms import ppps3
from jaxkin.mechanisms import ppps3_closed_forms as closed
from jaxkin.papers import _cbjr2018_print as printed
from jaxkin.papers._cbjr2018_equations import SEED
from jaxkin.papers._cbjr2018_route import feasibility
from jaxkin.papers._samples import ROUNDING, SAMPLES, at_random, off_by
from jaxkin.papers.report import Check, Part, count_check
from jaxkin.reports.document import Picture, Table

_WHERE = "section 4 [ours]"


def orientation() -> Part:
    """Checks what the aspects are without a choice of angles, and draws them and their joints."""
    robot = ppps3.create()
    shares, table = _aspects(robot)
    cube, joints = aspect_solid(robot, chart="zxy"), joint_solid(robot, n=24)
    pictures = {
        "zxy": Picture.of(
            jk.plot.solid(cube),
            "The home aspect in the angles of R = Rz(alpha) Rx(beta) Ry(gamma) [ours]: the cube with the side pi",
        ),
        "joints": Picture.of(
            jk.plot.solid(joints),
            "The joints (mu2z, mu3y, mu3z) with four assembly modes [ours]; outside there is none. All four aspects "
            "are mapped onto it one to one",
        ),
    }
    checks = (*shares, *_chart(cube.residual), *_joints(robot, joints.residual), *_ball(robot))
    return Part("Aspects without Euler angles [ours]", checks, pictures, {"aspects": table})


def _aspects(robot: ppps3.PPPS3) -> tuple[list[Check], Table]:
    """Shares of all rotations, and volumes in the paper's angles."""
    aspects = orientation_aspects(robot)
    checks = [count_check("aspects", _WHERE, "aspects of the rotations: sign classes of (R22, R33)", 4, len(aspects))]
    off = max(abs(aspect.share - 0.25) for aspect in aspects)
    what = "share of all rotations (Haar measure) of each aspect, by an integration that knows no symmetry"
    got = ", ".join(f"{aspect.share:.10f}" for aspect in aspects)
    checks.append(Check("shares", _WHERE, what, "1/4", got, off, 1e-8))
    off = max(abs(aspect.volume - math.pi**3) for aspect in aspects)
    what = "volume of each aspect in the paper's angles: pi^3, a quarter of 2 pi x pi x 2 pi"
    got = ", ".join(f"{aspect.volume:.7f}" for aspect in aspects)
    checks.append(Check("volumes", _WHERE, what, f"{math.pi**3:.7f}", got, off, 1e-6))
    rows = [
        (a.label, a.share, a.share_error, a.volume, a.volume_error, a.neighbours.get("R22"), a.neighbours.get("R33"))
        for a in aspects
    ]
    header = (
        "aspect",
        "share of rotations",
        "its error",
        "volume (rad^3)",
        "its error",
        "across R22 = 0",
        "across R33 = 0",
    )
    return checks, Table("The four aspects [ours]", header, rows)


def _chart(residual: float) -> list[Check]:
    """The chart Z-X-Y, in which the home aspect is a cube."""
    box = np.random.default_rng(SEED).uniform(-1, 1, (SAMPLES, 3)) * [math.pi, math.pi / 2, math.pi]
    alpha, beta, gamma = box.T
    turn = _turned(2, alpha) @ _turned(0, beta) @ _turned(1, gamma)
    own = np.stack([np.asarray(value) for value in closed.zxy_factors(alpha, beta, gamma)])
    off = off_by(own, np.stack([turn[:, 1, 1], turn[:, 2, 2]]))
    what = (
        f"R22 = cos(alpha) cos(beta), R33 = cos(beta) cos(gamma) of Rz(alpha) Rx(beta) Ry(gamma), {at_random('angles')}"
    )
    checks = [Check("zxy", _WHERE, what, "", "equal", off, ROUNDING)]
    inside = np.all(np.abs(box) < math.pi / 2, axis=1)
    wrong = int(np.sum(inside != ((turn[:, 1, 1] > 0) & (turn[:, 2, 2] > 0))))
    what = f"orientations, of {SAMPLES}, on which the cube |alpha|, |beta|, |gamma| < pi/2 and the home aspect disagree"
    checks.append(count_check("zxy-cube", _WHERE, what, 0, wrong))
    what = "largest |R22| or |R33| on the faces of the drawn cube"
    return [*checks, Check("zxy-residual", _WHERE, what, "0", f"{residual:.1e}", residual, ROUNDING)]


def _turned(axis: int, angle: np.ndarray) -> np.ndarray:
    """Returns rotations ``(n, 3, 3)`` about a coordinate axis, by Eq. (1)."""
    angles = [np.zeros_like(angle)] * 3
    angles[axis] = angle
    return np.moveaxis(np.array(printed.rotation(tuple(angles))), -1, 0)


def _joints(robot: ppps3.PPPS3, residual: float) -> list[Check]:
    """The joints with four solutions."""
    mu = np.random.default_rng(SEED).uniform(-1.2, 1.2, (SAMPLES, 3))
    own = np.stack([np.asarray(value) for value in closed.feasibility(robot, mu)])
    expected = np.stack(feasibility(mu))
    what = f"a = R33^2 and b = R22^2 as polynomials of mu, {at_random('joints')}"
    checks = [Check("feasibility", _WHERE, what, "", "equal", off_by(own, expected), ROUNDING)]
    volume = float(closed.joints_volume(robot))
    exact = 8 / printed.ROOT3
    what = (
        "volume of the joints (mu2z, mu3y, mu3z) with four assembly modes: 8/sqrt3, by integration over the home aspect"
    )
    checks.append(Check("joints-volume", _WHERE, what, f"{exact:.9f}", f"{volume:.12f}", abs(volume - exact), 1e-12))
    cube = np.random.default_rng(SEED).uniform(-1, 1, (200000, 3))
    share = 8 * float(np.mean(np.min(feasibility(cube), axis=0) > 0))
    what = "the same, by random points of the cube |mu| <= 1"
    checks.append(Check("joints-volume-random", _WHERE, what, f"{exact:.3f}", f"{share:.3f}", abs(share - exact), 0.03))
    what = "largest |a| or |b| on the drawn boundary"
    return [*checks, Check("joints-residual", _WHERE, what, "0", f"{residual:.1e}", residual, ROUNDING)]


def _ball(robot: ppps3.PPPS3) -> list[Check]:
    """The largest ball of rotations about home without a singularity."""
    ball = largest_rotation_ball(robot)
    off = abs(ball.radius - math.pi / 2)
    what = "angle of the singular rotation nearest to home, found by search"
    checks = [Check("ball", _WHERE, what, "pi/2", f"{ball.radius:.12f}", off, 1e-9)]
    turns = np.linspace(0, 2 * math.pi, 48, endpoint=False)
    near = np.concatenate([np.asarray(closed.nearest_singular_rotation(name, turns)) for name in ("R22", "R33")])
    half = len(turns)
    worst = float(max(np.max(np.abs(near[:half, 1, 1])), np.max(np.abs(near[half:, 2, 2]))))
    angle = np.arccos((np.trace(near, axis1=1, axis2=2) - 1) / 2)
    worst = max(worst, float(np.max(np.abs(angle - math.pi / 2))))
    what = "rotations by 90 degrees about axes in the plane of x and z (R22), or of x and y (R33), are singular"
    checks.append(Check("ball-touching", _WHERE, what, "0", f"{worst:.1e}", worst, 1e-14))
    share = (math.pi / 2 - 1) / math.pi
    what = "share of all rotations in that ball: (pi/2 - 1)/pi, of 1/4 in the aspect"
    off = abs(ball.share - share)
    return [*checks, Check("ball-share", _WHERE, what, f"{share:.6f}", f"{ball.share:.6f}", off, 1e-9)]
