"""Pictures of maps with more samples than a page shows, and of cells: axes to their ends, labels where regions are."""

from collections import Counter

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray

import jaxkin as jk

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)


@pytest.mark.parametrize("count", [9, 3999, 4000, 4321, 31623])
def test_axes_end_where_the_map_ends(count):
    """A map of 31623 samples once ended at 3.9997, without the tick at 4."""
    axis = np.linspace(0.0, 4.0, count)
    values = np.zeros((count, 7), np.int8)
    values[-1] = 2
    data = xarray.DataArray(values, {"rho1": axis, "rho3": np.linspace(0.0, 1.0, 7)}, name="forward_count")
    ax = jk.plot.section(data)
    assert ax.get_xlim() == (0.0, 4.0)
    assert (np.asarray(ax.images[0].get_array())[:, -1] == 1).all()
    plt.close("all")


@pytest.mark.parametrize("count", [100, 5000])
def test_a_whole_turn_ends_one_step_past_its_last_sample(count):
    axis = np.linspace(-np.pi, np.pi, count, endpoint=False)
    data = xarray.DataArray(np.zeros((count, 7)), {"phi": axis, "x": np.linspace(0.0, 1.0, 7)}, name="value")
    ax = jk.plot.section(data)
    np.testing.assert_allclose(ax.get_xlim(), (-np.pi, np.pi), rtol=1e-12)
    plt.close("all")


@pytest.mark.parametrize("samples", [129, 301])
def test_every_region_of_cells_is_named_inside_it(samples):
    grid = jk.Grid(rho1=(0.0, 4.0, samples), rho2=1.0, rho3=(0.0, 4.0, samples))
    cells = jk.sweep(ROBOT, "forward_count", grid, adaptive=True)
    ax = jk.plot.cells(cells)
    dense = cells.to_dense()["forward_count"]
    found = [(text.get_text(), dense.sel(rho1=x, rho3=y, method="nearest").item()) for text in ax.texts
             for x, y in [text.get_position()]]  # fmt: skip
    assert all(text == str(number) for text, number in found)
    numbers = Counter(number for _, number in found)
    # Regions there are; at the border two may touch in a sample, and the smallest is left to the legend.
    assert set(numbers) == {0, 2, 4, 6}
    assert numbers <= Counter({0: 3, 2: 2, 4: 2, 6: 1})
    assert len(found) >= 6
    plt.close("all")
