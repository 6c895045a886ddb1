"""A five-bar whose worst conditioning over a prescribed rectangle is the best there is.

The rectangle, 3 wide and 1 high, lies 1 above the line of the motors, which need to be 1 apart. Base, cranks, rods and
the rectangle's place along the base line vary; both legs are alike, elbows outwards. Known answers: by symmetry the
rectangle lies over the middle of the base; a grid over cranks and rods has no better design. That the motors come
as close as they may is the known advantage of the coaxial five-bar.
"""

import dataclasses

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from _common import save, start

import jaxkin as jk
from jaxkin.design import atlas

MODE = (1, -1)
#: Cranks, rods: bounds of the problem and of its map.
BOUNDS = {"proximal": (0.8, 4.0), "distal": (1.2, 4.0)}


def conditioning_map(robot: jk.mechanisms.five_bar.FiveBar, grid: jk.Grid) -> np.ndarray:
    """Returns the inverse condition number over the plane in the working mode; NaN out of reach."""
    (nx, ny) = (grid.axes[name].n for name in ("x", "y"))
    x, y = np.linspace(*XS, nx), np.linspace(*YS, ny)
    return x, y


def main() -> None:
    pass
