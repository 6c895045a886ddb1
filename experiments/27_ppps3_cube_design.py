"""3-PPPS: the largest orientation cube about home, |phi|, |theta|, |sigma| <= t, in the home aspect under strokes.

All nine prismatic joints have strokes of length 1, about the joints' values at home (side 1). The platform's side and
the place of its point C1 vary. Without strokes the cube ends where R22 vanishes at a corner, cos^2 t = sin^3 t: sin t
is the inverse of the plastic number. A grid over the side and x confirms the optimum, which is
a plateau: the strokes along z bind, whatever x is within bounds.
"""

import math

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from _common import save, start
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

import jaxkin as jk

STROKE = 1.0


def robot_with_strokes() -> jk.Mechanism:
    robot = jk.mechanisms.ppps3.create()
    home = np.zeros(6)
    actuated = zip((axis.name for axis in robot.joint_axes), jk.inverse(robot, home).values[0], strict=True)
    passive = zip(("rho1x", "rho2x", "rho3x"), jk.mechanisms.ppps3.passive_joints(robot, home), strict=True)
    middle = {name: float(value) for name, value in (*actuated, *passive)}
    return robot.with_limits(**{name: (q - STROKE / 2, q + STROKE / 2) for name, q in middle.items()})


def problem() -> jk.design.Problem:
    robot = robot_with_strokes()
    cube = jk.design.box(robot, x=0.0, y=0.0, z=0.0, phi=(-0.5, 0.5), theta=(-0.5, 0.5), sigma=(-0.5, 0.5))
    return jk.design.Problem(
        robot,
        {"center.x": (-0.4, 0.4), "center.y": (-0.4, 0.4), "center.z": (-0.4, 0.4), "side": (0.6, 1.4)},
        maximise=jk.design.regular_size(robot, cube, most=2.5),
        name="3-PPPS, largest orientation cube",
    )


def grid(wanted: jk.design.Problem, design: jk.design.Design, n: int) -> tuple[np.ndarray, ...]:
    """Returns x, the side, and the cube's half width; y and z as at the optimum."""
    x, side = np.meshgrid(np.linspace(-0.4, 0.4, n), np.linspace(0.6, 1.4, n), indexing="ij")

    def one(pair: tuple[jax.Array, jax.Array]) -> jax.Array:
        values = {k: jnp.asarray(v) for k, v in design.values.items()} | {"center.x": pair[0], "side": pair[1]}
        return wanted.objective(*wanted.made(values))

    return x, side, np.asarray(jax.jit(lambda a, b: jax.lax.map(one, (a, b)))(x.ravel(), side.ravel())).reshape(n, n)


def draw_slices(robot: jk.Mechanism, center: np.ndarray, half: float, title: str, panels: list[Axes]) -> None:
    """Draws the least margin of all limits over phi and theta, at the cube's lower face, middle and upper face."""
    drawn = None
    for axes, sigma in zip(panels, (-half, 0.0, half), strict=True):
        poses = jk.Grid(
            x=center[0], y=center[1], z=center[2], phi=(-0.8, 0.8, 161), theta=(-0.8, 0.8, 161), sigma=sigma
        )
        margins = jk.sweep(robot, "limit_margins", poses, progress=False)["limit_margins"]
        least = margins.min(dim=[name for name in margins.dims if name not in ("phi", "theta")]).transpose(
            "theta", "phi"
        )
        drawn = axes.contourf(
            least.phi, least.theta, least, np.linspace(-0.6, 0.3, 10), cmap="RdBu", extend="both", vmin=-0.6, vmax=0.6
        )
        axes.contour(least.phi, least.theta, least, [0.0], colors="black", linewidths=1.2)
        axes.add_patch(Rectangle((-half, -half), 2 * half, 2 * half, fill=False, ec="#D55E00", lw=2.0))
        axes.set(xlabel="φ (rad)", ylabel="θ (rad)", aspect="equal", title=f"{title}, $σ = {sigma:.3f}$ rad")
    assert drawn is not None
    panels[-1].figure.colorbar(drawn, ax=panels, label="least margin of the strokes (length)", shrink=0.9)


def main() -> None:
    folder = start("27", __doc__)
    wanted = problem()
    place = wanted.objective.place
    assert place is not None
    free = jk.design.regular_size(wanted.robot, place, limits=False, most=2.5).measured(wanted.robot)
    print(f"without strokes: {free}; arcsin(1 / plastic number) = {math.asin(0.7548776662466927):.13f}")
    before = wanted.objective.measured(wanted.robot)
    design = jk.design.optimise(wanted, starts=8, steps=80)
    print(design)
    figure, panels = plt.subplots(2, 3, figsize=(11.0, 7.2), layout="constrained")
    draw_slices(wanted.robot, np.zeros(3), before.value, "before", list(panels[0]))
    assert design.center is not None
    draw_slices(design.robot, design.center[:3], design.objective.value, "after", list(panels[1]))
    save(figure, folder, "ppps3_cube_slices")
    x, side, half = grid(wanted, design, 33)
    best = np.unravel_index(np.argmax(half), half.shape)
    print(f"grid: half width {half[best]:.6f} at x = {x[best]:.3f}, side = {side[best]:.3f}")
    figure, panels = plt.subplots(1, 2, figsize=(11.0, 4.4), layout="constrained")
    drawn = panels[0].contourf(x, side, half, 16, cmap="viridis")
    figure.colorbar(drawn, ax=panels[0], label="half width t of the cube (rad)")
    panels[0].plot(x[best], side[best], "s", mfc="none", mec="black", ms=9, clip_on=False, label="best of the grid")
    panels[0].plot(design.values["center.x"], design.values["side"], "o", color="#D55E00", label="optimum by gradients")
    panels[0].set(xlabel="$x$ of $C_1$ (length)", ylabel="side of the platform (length)")
    panels[0].legend(loc="upper right")
    jk.plot.design_history(design, ax=panels[1])
    save(figure, folder, "ppps3_cube_design")


if __name__ == "__main__":
    main()
