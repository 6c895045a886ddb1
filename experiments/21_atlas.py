"""A design atlas of the analytic 3-RPR: number of cusps of the section rho2 = 1 over (c3, d3), with c2 = 1.

Every design is searched for cusps on its constraints alone. Drawn over it is where the closed form says that a cusp
appears or vanishes: there a cusp edge, rho1^2 = a + 1 on the section, meets the poses at which it ceases to be real,
rho1^2 = h^2.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from _common import save, start
from matplotlib.lines import Line2D

import jaxkin as jk
from jaxkin.design import atlas
from jaxkin.mechanisms import rpr3_closed_forms

#: No cusp of these designs lies beyond.
HIGH = 8.0


def family(c3: np.ndarray, d3: np.ndarray) -> jk.mechanisms.rpr3.AnalyticRPR3:
    robot = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    return dataclasses.replace(robot, c2=jnp.ones(c3.shape), c3=jnp.asarray(c3), d3=jnp.asarray(d3))


def main() -> None:
    folder = start("21", __doc__)
    robot = jk.mechanisms.rpr3.analytic(c2=1.0, c3=0.0, d3=1.0)
    section = jk.Grid(rho1=(0.0, HIGH, 400), rho2=1.0, rho3=(0.0, HIGH, 400))
    designs = jk.Grid(c2=1.0, c3=(-1.5, 2.5, 41), d3=(0.1, 2.1, 21))
    result = jk.sweep(robot, atlas.number_of_cusps(section), designs)

    c3, d3 = np.meshgrid(result.c3, result.d3, indexing="ij")
    cusps = np.asarray(rpr3_closed_forms.section_cusps(family(c3, d3), 1, 1.0).joints)
    assert np.nanmax(cusps) < HIGH
    expected = np.isfinite(cusps[..., 0]).sum(axis=-1)
    values, samples = np.unique(result.number_of_cusps, return_counts=True)
    print("designs by number of cusps:", dict(zip(values.tolist(), samples.tolist(), strict=True)))
    print("designs whose number is not that of the closed form:", int(np.sum(result.number_of_cusps != expected)))
    print("designs whose searches disagree:", int(result.number_of_cusps_doubtful.sum()))
    print("designs refused:", result.attrs["refused_designs"])

    ax = jk.plot.section(result)
    fine = np.meshgrid(np.linspace(-1.5, 2.5, 401), np.linspace(0.1, 2.1, 401), indexing="ij")
    edges = rpr3_closed_forms.cusp_edges(family(*fine))
    # The product, as the order of the three edges changes from design to design.
    real = np.asarray(jnp.prod(edges.a + 1.0 - edges.h**2, axis=-1))
    ax.contour(*fine, real, levels=[0.0], colors="black", linewidths=1.6)
    regions = ax.get_legend()
    assert regions is not None
    line = Line2D([], [], color="black", linewidth=1.6, label="closed form")
    ax.legend(
        handles=[*regions.get_patches(), line],
        title=regions.get_title().get_text(),
        loc="center left",
        bbox_to_anchor=(1.01, 0.5),
        frameon=False,
    )
    save(ax.get_figure(root=True), folder, "rpr3_cusp_atlas")


if __name__ == "__main__":
    main()
