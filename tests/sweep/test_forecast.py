import json

import numpy as np
import pytest

import jaxkin as jk

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
GRID = jk.Grid(rho1=(0.0, 4.0, 700), rho2=1.0, rho3=(0.0, 4.0, 500))
POSES = jk.Grid(x=(-2.0, 2.0, 40), y=(-1.0, 1.5, 30), phi=(-3.0, 3.0, 20))


def test_a_forecast_counts_exactly_and_estimates_the_rest(tmp_path):
    said = jk.forecast(ROBOT, "forward_count", GRID, workers=1)
    assert said.samples == 350_000
    assert said.raw_bytes == 700_000
    jk.sweep(ROBOT, "forward_count", GRID, store=tmp_path / "map.zarr")
    info = jk.describe_store(tmp_path / "map.zarr")
    assert said.tiles == info.tiles
    assert said.raw_bytes == info.raw_bytes
    data = sum(f.stat().st_size for f in (tmp_path / "map.zarr").glob("forward_count*/c/**/*") if f.is_file())
    # Few kilobytes: what a file costs by itself is most of it.
    assert 0.2 * data < said.stored_bytes < 5 * data
    assert said.seconds > said.compiling > 0


def test_a_forecast_without_a_store_needs_memory_for_the_result():
    large = jk.Grid(rho1=(0.0, 4.0, 40_000), rho2=1.0, rho3=(0.0, 4.0, 50_000))
    held, stored = (jk.forecast(ROBOT, "forward_count", large, store=store) for store in (False, True))
    assert held.stored_bytes is None
    assert held.memory > held.raw_bytes == 4 * 10**9
    # Both include what this process has needed so far.
    assert held.memory - stored.memory > 3e9


def test_a_forecast_refuses_what_no_memory_can_hold():
    huge = jk.Grid(rho1=(0.0, 4.0, 900_000), rho2=1.0, rho3=(0.0, 4.0, 900_000))
    with pytest.raises(jk.InputError, match=r"give store=\.\.\., or use fewer samples"):
        jk.forecast(ROBOT, "forward_count", huge, store=False)


def test_a_forecast_counts_one_thing_as_one():
    one = jk.Forecast(2000, 1, 4000, None, 10**6, 0.1, 0.1, 0.0, 1)
    assert str(one).startswith("2,000 samples in 1 tile\n")
    assert "with 1 thread (" in str(one)


def test_on_a_cluster_the_longest_part_decides():
    said = jk.Forecast(
        samples=10**9,
        tiles=1000,
        raw_bytes=10**10,
        stored_bytes=10**9,
        memory=10**9,
        compiling=2.0,
        tile_computing=0.4,
        tile_writing=0.1,
        workers=2,
    )
    assert said.seconds == pytest.approx(2 + 500 * 0.5)
    few = said.on_cluster(10, task_seconds=1e-3, bandwidth=1e9)
    assert (few.computing, few.scheduling, few.storing) == pytest.approx((50, 1, 1))
    assert few.bottleneck == "computing"
    assert few.seconds == pytest.approx(52)
    assert said.on_cluster(1000, task_seconds=1e-2).bottleneck == "scheduling"
    assert said.on_cluster(1000, task_seconds=1e-4, bandwidth=1e7).bottleneck == "storing"


def test_a_forecast_refuses_what_the_sweep_refuses():
    with pytest.raises(jk.InputError, match="did you mean 'forward_count'"):
        jk.forecast(ROBOT, "forward_cuont", GRID)
    with pytest.raises(jk.InputError, match="lacks the joint axis"):
        jk.forecast(ROBOT, "forward_count", jk.Grid(rho1=(0.0, 1.0, 5)))


@pytest.mark.parametrize("name", ["smallest_singular_value", "inverse_branches", "limit_margins", "direct_determinant"])
def test_the_error_of_float32_is_what_is_told(name):
    double, single = (jk.sweep(ROBOT, name, POSES, precision=p) for p in ("float64", "float32"))
    told = json.loads(single.attrs["float32_error"])[name]
    assert single[name].dtype == np.float32
    # Where there is no limit, its margin is infinite in both.
    finite = np.isfinite(double[name].values)
    np.testing.assert_array_equal(np.isfinite(single[name].values), finite)
    gap = np.abs(single[name].values.astype(float)[finite] - double[name].values[finite])
    assert told["changed"] == 0
    # 4096 samples of 24 000 nearly meet the largest error.
    assert 0 < told["largest_absolute"] <= 3 * gap.max()
    assert gap.max() <= 3 * told["largest_absolute"]
    assert told["largest_relative"] < 1e-5
    assert "float32_error" not in double.attrs


def test_labels_of_float32_are_compared_as_labels(tmp_path):
    single = jk.sweep(ROBOT, "binding_limit", POSES, precision="float32", store=tmp_path / "map.zarr")
    told = json.loads(single.attrs["float32_error"])
    assert set(told["binding_limit"]) == {"changed"}
    double = jk.sweep(ROBOT, "binding_limit", POSES)
    share = float((single.binding_limit.values != double.binding_limit.values).mean())
    assert share == pytest.approx(told["binding_limit"]["changed"], abs=0.01)
