import itertools

import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from store_checks import files

import jaxkin as jk
from jaxkin.sweep import tiler

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
FIVE_BAR = jk.mechanisms.five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
GRID = jk.Grid(c2=(-1.0, 1.0, 5), d3=(0.5, 1.5, 4))


def area_of(robot):
    return robot.c2 * robot.d3 / 2


def picky_area_of(robot):
    """The same in Python, for triangles that do not lean."""
    if float(robot.c3) > 0.5:
        raise jk.InputError(f"c3 is {float(robot.c3):g}: it leans too far.")
    return float(robot.c2) * float(robot.d3) / 2


def geometry_field(function, name="area", **options):
    return jk.fields.from_function(function, name=name, domain="geometry", **options)


AREA = geometry_field(area_of, unit="length^2")
PICKY = geometry_field(picky_area_of, unit="length^2", traced=False)


def expected(result):
    areas = result.c2.values[:, None] * result.d3.values[None] / 2
    return np.where(result.c2.values[:, None] == 0, np.nan, areas)


@pytest.mark.parametrize("field", [AREA, PICKY])
def test_numbers_of_the_geometry_are_axes_like_any_other(field):
    result = jk.sweep(ROBOT, field, GRID)
    assert result.area.dims == ("c2", "d3")
    assert result.area.attrs["units"] == "length^2"
    assert result.c2.attrs["units"] == "length"
    assert result.attrs["complete"] == 1
    np.testing.assert_allclose(result.area, expected(result), rtol=1e-15)


def test_what_the_grid_does_not_name_stays_and_is_a_part_of_the_request():
    slope = geometry_field(lambda robot: robot.c3 / robot.d3, name="slope")
    wide = jk.mechanisms.rpr3.analytic(1.0, 3.0, 1.0)
    grid = jk.Grid(c2=1.0, d3=(1.0, 2.0, 2))
    one, other = (jk.sweep(robot, slope, grid) for robot in (ROBOT, wide))
    assert one.slope.values.tolist() == [0.0, 0.0]
    assert other.slope.values.tolist() == [3.0, 1.5]
    assert float(one.c2) == 1.0
    assert one.c2.ndim == 0
    assert one.attrs["request_hash"] != other.attrs["request_hash"]


def test_entries_of_vectors_whole_vectors_and_limits_are_axes_in_stores_too(tmp_path):
    reach = geometry_field(lambda robot: robot.proximal[0] + robot.distal[1] + robot.limits.high[0], name="reach")
    grid = jk.Grid(**{"theta1_high": (0.5, 1.5, 2), "distal": (1.0, 2.0, 2), "proximal[0]": (1.0, 2.0, 3)})
    assert eval(repr(grid), {"Grid": jk.Grid}).axes == grid.axes
    held = jk.sweep(FIVE_BAR, reach, grid)
    stored = jk.sweep(FIVE_BAR, reach, grid, store=tmp_path / "reach.zarr")
    xarray.testing.assert_equal(held, stored.load())
    assert held.reach.dims == ("proximal[0]", "distal", "theta1_high")
    assert held.theta1_high.attrs["units"] == "rad"
    axes = (held[name].values for name in held.reach.dims)
    sums = np.reshape([sum(entries) for entries in itertools.product(*axes)], held.reach.shape)
    np.testing.assert_allclose(held.reach, sums)
    assert jk.verify_store(tmp_path / "reach.zarr").ok


def test_one_design_at_a_time_says_so_and_tells_refusals():
    result = jk.sweep(ROBOT, PICKY, jk.Grid(c2=(0.0, 1.0, 2), c3=(0.0, 1.0, 3)))
    assert result.attrs["untraced"] == "computed one design at a time"
    assert result.area_refused.values.tolist() == [[True] * 3, [False, False, True]]
    assert np.array_equal(np.isnan(result.area), result.area_refused)
    assert result.attrs["refused_designs"] == 4
    assert result.attrs["first_refusal"] == "c2 = 0, c3 = 0: The geometry is degenerate or not finite."
    result = jk.sweep(ROBOT, PICKY, jk.Grid(c3=(0.0, 1.0, 3)))
    assert result.attrs["first_refusal"] == "c3 = 1: c3 is 1: it leans too far."
    result = jk.sweep(ROBOT, PICKY, jk.Grid(c3=(0.0, 0.5, 3)))
    assert result.attrs["refused_designs"] == 0
    assert "first_refusal" not in result.attrs
    assert "untraced" not in jk.sweep(ROBOT, AREA, GRID).attrs
    assert "one design at a time" in str(jk.forecast(ROBOT, PICKY, GRID))
    assert "one design at a time" not in str(jk.forecast(ROBOT, AREA, GRID))


def test_other_exceptions_end_the_sweep():
    def broken(robot):
        raise ZeroDivisionError("a bug")

    with pytest.raises(ZeroDivisionError, match="a bug"):
        jk.sweep(ROBOT, geometry_field(broken, traced=False), GRID)


def test_a_store_goes_on_to_the_same_bytes(tmp_path, monkeypatch):
    whole, cut = tmp_path / "whole.zarr", tmp_path / "cut.zarr"
    jk.sweep(ROBOT, PICKY, GRID, store=whole)
    compute, left = tiler.Tiler.compute, iter(range(7))

    def stop_after_some(self, box, into):
        if next(left, None) is None:
            raise KeyboardInterrupt
        compute(self, box, into)

    monkeypatch.setattr(tiler.Tiler, "compute", stop_after_some)
    with pytest.raises(jk.SweepInterrupted) as caught:
        jk.sweep(ROBOT, PICKY, GRID, store=cut, workers=1)
    assert caught.value.samples_done == 7
    monkeypatch.undo()
    result = jk.sweep(ROBOT, PICKY, GRID, store=cut)
    assert result.attrs["refused_designs"] == 4
    assert files(cut) == files(whole)
    assert jk.open_store(cut).attrs["first_refusal"].startswith("c2 = 0, d3 = 0.5")
    with pytest.raises(jk.StoreError, match=r"field\.version"):
        jk.sweep(ROBOT, geometry_field(area_of, traced=False), GRID, store=cut)


def test_a_second_sweep_traces_nothing():
    traces = []

    def counted(robot):
        traces.append(robot)
        return robot.c3

    field = geometry_field(counted, name="counted")
    jk.sweep(ROBOT, field, jk.Grid(c3=(0.0, 1.0, 5)))
    many = len(traces)
    jk.sweep(jk.mechanisms.rpr3.analytic(2.0, 0.0, 1.0), field, jk.Grid(c3=(2.0, 3.0, 5)))
    assert len(traces) == many


@pytest.mark.parametrize("traced", [True, False])
def test_adaptive_sweeps_over_geometries(traced):
    big = geometry_field(lambda robot: (area_of(robot) > 0.3).astype(jnp.int8), "big", dtype="int8", traced=traced)
    grid = jk.Grid(c2=(0.25, 1.0, 33), d3=(0.5, 1.5, 33))
    cells = jk.sweep(ROBOT, big, grid, adaptive=jk.Adaptive(stride=8, probes=0))
    assert cells.attrs["evaluations"] < 33 * 33
    assert cells.attrs.get("untraced") == (None if traced else "computed one design at a time")
    np.testing.assert_array_equal(cells.to_dense().big, jk.sweep(ROBOT, big, grid).big)


def test_a_map_names_numbers_of_the_geometry_with_their_units():
    pytest.importorskip("matplotlib").use("Agg")
    field = geometry_field(lambda robot: robot.proximal[0] * robot.base, name="product", unit="length^2")
    ax = jk.plot.section(jk.sweep(FIVE_BAR, field, jk.Grid(**{"proximal[0]": (1.0, 2.0, 3), "base": (1.0, 2.0, 3)})))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("base (length)", "proximal[0] (length)")
    count = geometry_field(lambda robot: (robot.c2 > 0).astype(jnp.int8), name="count", dtype="int8")
    ax = jk.plot.section(jk.sweep(ROBOT, count, GRID))
    legend = ax.get_legend()
    assert legend.get_title().get_text() == "count"
    assert [text.get_text() for text in legend.get_texts()] == ["no value", "0", "1"]


CANNOT = {
    "unknown": (AREA, jk.Grid(c4=(0.0, 1.0, 3)), r"axis 'c4'.* no number of rpr3-analytic's geometry"),
    "joints": (AREA, jk.Grid(rho1=(0.0, 1.0, 3)), r"axis 'rho1'.* choose among c2, c3, d3"),
    "no free axis": (AREA, jk.Grid(c2=1.0), "no free axis"),
    "joint field": ("forward_count", jk.Grid(c3=(0.0, 1.0, 3)), r"'c3'.* number of the geometry.* over joints"),
    "pose field": ("direct_determinant", jk.Grid(c3=(0.0, 1.0, 3)), r"'c3'.* field over poses"),
    "not traced": (
        geometry_field(lambda robot: float(robot.c2)),
        GRID,
        r"cannot be traced .*traced=False",
    ),
    "a vector": (geometry_field(lambda robot: robot.limits.low), GRID, r"shape \(3,\).* for each design"),
    "a list": (geometry_field(lambda robot: [1, 2], traced=False), GRID, r"shape \(2,\)"),
    "nothing": (geometry_field(lambda robot: None, traced=False), GRID, "returns no number"),
    "cut off": (geometry_field(lambda robot: 0.5, traced=False, dtype="int8"), GRID, "cut off"),
}


@pytest.mark.parametrize("case", CANNOT)
def test_what_cannot_be_swept_is_one_sentence(case):
    field, grid, message = CANNOT[case]
    with pytest.raises(jk.InputError, match=message) as caught:
        jk.sweep(ROBOT, field, grid)
    assert "\n" not in str(caught.value)


def test_an_entry_and_its_vector_are_one_number():
    field = geometry_field(lambda robot: robot.base, name="own")
    with pytest.raises(jk.InputError, match=r"'proximal' and 'proximal\[0\]'.* leave one of them out"):
        jk.sweep(FIVE_BAR, field, jk.Grid(**{"proximal[0]": (1.0, 2.0, 3), "proximal": 1.0}))


def test_float32_is_refused():
    with pytest.raises(jk.InputError, match="in which no design is computed"):
        jk.sweep(ROBOT, AREA, GRID, precision="float32")


def test_declarations_that_do_not_go_together():
    with pytest.raises(jk.InputError, match="walls"):
        geometry_field(area_of, walls=lambda robot, x: x)
    with pytest.raises(jk.InputError, match="not traced and its domain is 'pose'"):
        jk.fields.from_function(area_of, name="area", domain="pose", traced=False)
    with pytest.raises(jk.InputError, match="'pose', 'joints' or 'geometry'"):
        jk.fields.from_function(area_of, name="area", domain="design")
