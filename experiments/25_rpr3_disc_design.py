"""General 3-RPR: the largest disc with +-30 degrees of rotation that is free of singularities, under leg limits.

The platform's sides and angle and the place of the disc vary; the legs are 5 to 30 long on the base of the reference
geometry. The result is proved by interval arithmetic. Grids over two parameters each confirm it.
"""

import math

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from _common import save, start
from matplotlib.axes import Axes
from matplotlib.patches import Circle

import jaxkin as jk

TURN = math.pi / 6
VARY = {
    "center.x": (-10.0, 25.0),
    "center.y": (-20.0, 25.0),
    "l2": (10.0, 24.0),
    "l3": (10.0, 24.0),
    "beta": (0.6, 2.6),
}


def problem() -> jk.design.Problem:
    robot = jk.mechanisms.rpr3.reference(jk.Limits.lengths(3, 5.0, 30.0))
    disc = jk.design.ball(robot, {"x": 10.0, "y": 14.0}, 1.0, phi=(-TURN, TURN))
    return jk.design.Problem(
        robot, VARY, maximise=jk.design.regular_size(robot, disc, most=25.0), name="3-RPR, largest disc"
    )


def grid(wanted: jk.design.Problem, design: jk.design.Design, names: tuple[str, str], n: int) -> tuple[np.ndarray, ...]:
    """Returns two parameters and the disc's radius, all others as at the optimum."""
    ends = [wanted.parameters[name] for name in names]
    first, second = np.meshgrid(*(np.linspace(one.low, one.high, n) for one in ends), indexing="ij")

    def one(pair: tuple[jax.Array, jax.Array]) -> jax.Array:
        values = {**{k: jnp.asarray(v) for k, v in design.values.items()}, **dict(zip(names, pair, strict=True))}
        return wanted.objective(*wanted.made(values))

    radius = jax.jit(lambda a, b: jax.lax.map(one, (a, b)))(first.ravel(), second.ravel())
    return first, second, np.asarray(radius).reshape(n, n)


def draw_place(robot: jk.Mechanism, center: np.ndarray, radius: float, axes: Axes) -> None:
    """Draws what bounds the disc at three angles: singularities (full) and leg limits (dashed)."""
    for turn, colour in ((-TURN, "#0072B2"), (0.0, "#000000"), (TURN, "#D55E00")):
        poses = jk.Grid(x=(-25.0, 40.0, 261), y=(-35.0, 40.0, 301), phi=turn)
        singular = jk.sweep(robot, "direct_determinant", poses, progress=False)
        margins = jk.sweep(robot, "limit_margins", poses, progress=False)["limit_margins"]
        x, y = singular.x.values, singular.y.values
        axes.contour(x, y, singular.direct_determinant.transpose("y", "x"), [0.0], colors=colour, linewidths=1.2)
        least = margins.min(dim=[name for name in margins.dims if name not in ("x", "y")]).transpose("y", "x")
        axes.contour(x, y, least, [0.0], colors=colour, linestyles="--", linewidths=0.9)
        axes.plot([], [], color=colour, label=f"φ = {math.degrees(turn):+.0f}°" if turn else "φ = 0°")
    if radius > 0:
        axes.add_patch(Circle(tuple(center[:2]), radius, color="#009E73", alpha=0.35))
    axes.plot(*center[:2], "+", color="black")
    axes.set(xlabel="x (length)", ylabel="y (length)", aspect="equal")


def main() -> None:
    folder = start("25", __doc__)
    wanted = problem()
    design = jk.design.optimise(wanted, starts=16, steps=60)
    print(design)
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 5.6), layout="constrained")
    place = wanted.objective.place
    assert place is not None
    assert design.center is not None
    before = wanted.objective.measured(wanted.robot)
    for axes, title, robot, center, size in (
        (panels[0], "before", wanted.robot, place.center, before.value),
        (panels[1], "after", design.robot, design.center, design.objective.value),
    ):
        draw_place(robot, np.asarray(center), size, axes)
        axes.set_title(f"{title}: " + (f"radius {size:.3f}" if size > 0 else "no regular disc about the cross"))
    figure.legend(
        *panels[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncol=3,
        frameon=False,
        title="det A = 0 (full), leg limits (dashed), disc (green)",
    )
    save(figure, folder, "rpr3_disc")
    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.4), layout="constrained")
    for axes, names in zip(panels, (("center.x", "center.y"), ("l3", "beta")), strict=True):
        first, second, radius = grid(wanted, design, names, 31)
        print(f"grid over {names}: largest radius {radius.max():.6f}, optimum {design.objective.value:.6f}")
        drawn = axes.contourf(first, second, np.where(radius > 0, radius, np.nan), 14, cmap="viridis")
        figure.colorbar(drawn, ax=axes, label="radius of the disc (length)")
        axes.plot(design.values[names[0]], design.values[names[1]], "o", color="#D55E00", label="optimum")
        units = [f" ({wanted.unit_of(name)})" for name in names]
        axes.set(xlabel=names[0] + units[0], ylabel=names[1] + units[1], facecolor="0.85")
        axes.legend(loc="lower right")
    save(figure, folder, "rpr3_disc_grids")
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    jk.plot.design_history(design, ax=axes)
    save(figure, folder, "rpr3_disc_history")


if __name__ == "__main__":
    main()
