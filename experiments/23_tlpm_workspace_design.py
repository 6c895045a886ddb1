"""TLPM with thick links: the largest workspace under a floor of conditioning, where link interference binds too.

Base radius L and height h (at most 900 mm) vary, strokes are +-150 mm, links 40 mm thick. Over all that the strokes
reach, the inverse condition number has to be at least 0.4 and every pair of links apart. A grid over (L, h) confirms
the optimum.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from _common import save, start
from matplotlib.axes import Axes

import jaxkin as jk

FLOOR, THICK, STROKE = 0.4, 40.0, (-150.0, 150.0)
RADII, HEIGHTS = (350.0, 1000.0), (350.0, 900.0)


def build(base_radius: float | jax.Array, height: float | jax.Array) -> jk.Mechanism:
    """Makes the robot; the initial lengths follow from both sizes."""
    return jk.mechanisms.tlpm.create(base_radius, height, stroke=STROKE, a=THICK)


def problem() -> jk.design.Problem:
    robot = build(700.0, 700.0)
    everywhere = jk.design.reach(robot, 5, 0)
    conditioning = jk.design.inverse_condition_number(robot, everywhere)
    clearance = jk.design.clearance(robot, everywhere)
    return jk.design.Problem(
        robot,
        {"base_radius": RADII, "height": HEIGHTS},
        maximise=jk.design.workspace_volume(robot),
        subject_to=[conditioning.at_least(FLOOR), clearance.at_least(0.0)],
        build=build,
        name="TLPM, largest workspace with thick links",
    )


def grid(wanted: jk.design.Problem, n: int) -> tuple[np.ndarray, ...]:
    """Returns base radii, heights, volumes in litres, conditioning and clearance (worst samples)."""
    radii, heights = np.meshgrid(np.linspace(*RADII, n), np.linspace(*HEIGHTS, n), indexing="ij")
    objectives = (wanted.objective, *(one.objective for one in wanted.subject_to))

    def one(radius: jax.Array, height: jax.Array) -> jax.Array:
        robot = build(radius, height)
        return jnp.stack([jnp.min(objective.parts(robot, None)) for objective in objectives])

    values = np.asarray(
        jax.jit(lambda r, h: jax.lax.map(lambda p: one(*p), (r, h), batch_size=64))(*map(np.ravel, (radii, heights)))
    )
    # Where strokes reach beyond the assembly mode nothing is defined: there a requirement is missed.
    values[:, 1:] = np.nan_to_num(values[:, 1:], nan=-1.0)
    return radii, heights, *(values[:, k].reshape(n, n) for k in range(3))


def draw_map(wanted: jk.design.Problem, design: jk.design.Design, axes: Axes) -> None:
    radii, heights, volume, conditioning, clearance = grid(wanted, 81)
    allowed = (conditioning >= FLOOR) & (clearance >= 0)
    levels = np.arange(26.0, 48.1, 2.0)
    drawn = axes.contourf(radii, heights, volume / 1e6, levels, cmap="viridis", extend="both")
    axes.figure.colorbar(drawn, ax=axes, label="workspace volume (litres)")
    missed = np.minimum(conditioning / FLOOR - 1, clearance / THICK)
    axes.contourf(radii, heights, missed, [-1e9, 0.0], colors="0.9", alpha=0.7)
    axes.plot([], [], "s", color="0.85", ms=9, label="a requirement is missed")
    for values, level, style, label in (
        (conditioning, FLOOR, "-", f"inverse condition number = {FLOOR}"),
        (clearance, 0.0, "--", "link clearance = 0"),
    ):
        axes.contour(radii, heights, values, [level], colors="black", linestyles=style, linewidths=1.5)
        axes.plot([], [], color="black", linestyle=style, label=label)
    best = np.unravel_index(np.argmax(np.where(allowed, volume, -np.inf)), volume.shape)
    print(f"grid: {volume[best] / 1e6:.4f} litres at L = {radii[best]:.2f}, h = {heights[best]:.2f}")
    axes.plot(radii[best], heights[best], "s", mfc="none", mec="black", ms=9, label="best of the grid", clip_on=False)
    axes.plot(
        *design.values.values(), "o", color="#D55E00", ms=8, label="optimum by gradients", clip_on=False, zorder=5
    )
    axes.plot(700, 700, "^", color="#0072B2", ms=8, label="before")
    axes.set(xlabel="base radius L (mm)", ylabel="height h (mm)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncol=2, fontsize=8, frameon=False)


def main() -> None:
    folder = start("23", __doc__)
    wanted = problem()
    design = jk.design.optimise(wanted, starts=16, steps=100)
    print(design)
    figure, axes = plt.subplots(figsize=(6.2, 5.6), layout="constrained")
    draw_map(wanted, design, axes)
    save(figure, folder, "tlpm_design_map")
    figure, panel = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    jk.plot.design_history(design, ax=panel)
    save(figure, folder, "tlpm_design_history")
    figure = plt.figure(figsize=(9.0, 4.6))
    for k, (title, robot) in enumerate((("before", wanted.robot), ("after", design.robot))):
        part = figure.add_subplot(1, 2, k + 1, projection="3d")
        jk.plot.workspace(jk.workspace_surfaces(robot), ax=part)
        part.set_title(f"{title}: {float(jk.workspace_volume(robot).volume) / 1e6:.1f} litres")
    save(figure, folder, "tlpm_design_workspaces")


if __name__ == "__main__":
    main()
