"""What an adaptive sweep returns: measures, dense maps, files, a figure; and bad requests."""

import json
import math

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray

import jaxkin as jk
from tests.oracles import rpr3_regions

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
LIMITED = ROBOT.with_limits(rho1=(0.5, 2.0), rho2=(0.25, 2.5))
SECTION = jk.Grid(rho1=(0.0, 4.0, 161), rho2=1.0, rho3=(0.0, 4.0, 150))
TURN = (-math.pi, math.pi)


def test_measures_bound_the_exact_areas():
    grid = jk.Grid(x=(-1.0, 1.0, 257), y=(-1.0, 1.0, 257), phi=0.0)
    field = jk.fields.from_function(
        lambda robot, pose: (pose[0] - 0.1) ** 2 + (pose[1] + 0.1) ** 2 <= 0.36,
        name="in_large_disc",
        domain="pose",
        dtype="bool",
    )
    found = jk.sweep(ROBOT, field, grid, adaptive=True).measure()
    inside = found.sel(label=True)
    exact = math.pi * 0.36
    assert float(inside.low) < exact < float(inside.high)
    assert float(inside.measure) == pytest.approx(exact, abs=1e-3)
    assert float(found["measure"].sum()) == pytest.approx(4.0, rel=1e-12)
    assert found.attrs["total"] == pytest.approx(sum(found.attrs[k] for k in ("boundary", "sampled", "proved")))
    assert found["measure"].attrs["units"] == "length length"


def test_areas_of_the_analytic_section():
    section = jk.Grid(rho1=(0.0, 4.0, 1025), rho2=1.0, rho3=(0.0, 4.0, 1025))
    found = jk.sweep(ROBOT, "forward_count", section, adaptive=True).measure()
    exact = json.loads(rpr3_regions.DATA.read_text())["analytic 1 0 1, rho2 = 1, [0, 4]^2"]["area_by_count"]
    for number, area in ((int(number), area) for number, area in exact.items()):
        own = found.sel(label=number)
        assert float(own.proved_low) < float(own.low) < area < float(own.high) < float(own.proved_high)
        assert float(own["measure"]) == pytest.approx(area, abs=2e-3)


def test_branches_are_measured_each():
    found = jk.sweep(LIMITED, "inverse_branches", jk.Grid(x=(-3.0, 3.0, 65), y=(-3.0, 3.0, 65), phi=0.4), adaptive=True)
    measure = found.measure()
    assert measure["measure"].dims == ("branch", "label")
    assert measure["measure"].sum("label").values == pytest.approx([36.0])


def test_another_grid_takes_the_nearest_labels():
    found = jk.sweep(ROBOT, "forward_count", SECTION, adaptive=True)
    other = jk.Grid(rho1=(0.1, 3.9, 77), rho2=1.0, rho3=(0.1, 5.0, 91))
    far = found.to_dense(other).forward_count
    dense = jk.sweep(ROBOT, "forward_count", other).forward_count
    inside = far.rho3 <= 4.0
    assert np.all(far.where(~inside, -1) == -1)
    assert float((far != dense).where(inside, False).mean()) < 0.02
    xarray.testing.assert_equal(found.to_dense(SECTION).forward_count, found.to_dense().forward_count)
    turn = jk.sweep(
        ROBOT,
        "direct_determinant",
        jk.Grid(x=(-3.0, 3.0, 97), y=0.3, phi=(*TURN, 90)),
        adaptive=jk.Adaptive(label="sign"),
    )
    shifted = turn.to_dense(jk.Grid(x=(-3.0, 3.0, 50), y=0.3, phi=(0.0, 2 * math.pi, 64))).direct_determinant_sign
    assert set(np.unique(shifted)) == {-1, 1}


@pytest.mark.parametrize("name", ["inverse_branches", "binding_limit"])
def test_coordinates_of_text_go_through_a_file_without_a_warning(name, tmp_path):
    grid = jk.Grid(x=(-3.0, 3.0, 33), y=(-3.0, 3.0, 33), phi=0.4)
    found = jk.sweep(LIMITED, name, grid, adaptive=jk.Adaptive(probes=100))
    found.to_zarr(tmp_path / "cells.zarr", consolidated=False)
    read = jk.AdaptiveSweep.of(xarray.open_zarr(tmp_path / "cells.zarr", consolidated=False, chunks=None))
    xarray.testing.assert_identical(read.to_dataset().load(), found.to_dataset())
    assert list(read.axis.values) == ["x", "y"]


def test_a_result_goes_through_a_file(tmp_path):
    found = jk.sweep(ROBOT, "forward_count", SECTION, adaptive=True)
    found.to_zarr(tmp_path / "cells.zarr", consolidated=False)
    read = jk.AdaptiveSweep.of(xarray.open_zarr(tmp_path / "cells.zarr", consolidated=False, chunks=None))
    xarray.testing.assert_identical(read.to_dense(), found.to_dense())
    assert "proved" in repr(read)
    assert "Dimensions" in repr(found.isel(cell=slice(0, 5)))
    with pytest.raises(jk.InputError, match="all cells"):
        found.isel(cell=slice(0, 5)).to_dense()


def test_a_result_is_an_xarray_dataset_with_its_request():
    found = jk.sweep(ROBOT, jk.fields.forward_count, SECTION, adaptive=jk.Adaptive(seed=7))
    assert isinstance(found, xarray.Dataset)
    assert found.forward_count.dims == ("cell",)
    assert found.low.dims == found.high.dims == ("cell", "axis")
    assert list(found.axis.values) == ["rho1", "rho3"]
    request = json.loads(found.attrs["request"])
    assert request["adaptive"]["seed"] == 7
    assert request["adaptive"]["stride"] == 32
    assert found.attrs["request_hash"] != jk.sweep(ROBOT, "forward_count", SECTION).attrs["request_hash"]
    assert type(found.to_dataset()) is xarray.Dataset


def test_the_figure_draws_every_cell():
    for result in (
        jk.sweep(ROBOT, "forward_count", SECTION, adaptive=jk.Adaptive(proof=4)),
        jk.sweep(
            LIMITED, "inverse_branches", jk.Grid(x=(-3.0, 3.0, 40), y=(-3.0, 3.0, 40), phi=0.4), adaptive=True
        ).isel(branch=0),
    ):
        ax = jk.plot.cells(result)
        drawn = sum(len(c.get_paths()) for c in ax.collections)
        assert drawn == result.sizes["cell"]
        assert f"{result.attrs['evaluations']:,} of" in ax.get_title()
        plt.close(ax.figure)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: jk.Adaptive(stride=0), ["stride is 0", "at least 1"]),
        (lambda: jk.Adaptive(stride=2.0), ["stride is 2.0", "whole"]),
        (lambda: jk.Adaptive(stride=True), ["stride is True"]),
        (lambda: jk.Adaptive(stride=12), ["stride is 12", "power of two", "8 or 16"]),
        (lambda: jk.Adaptive(probes=-1), ["probes is -1", "at least 0"]),
        (lambda: jk.Adaptive(seed="a"), ["seed is 'a'"]),
        (lambda: jk.Adaptive(label=3), ["label is 3"]),
        (lambda: sweep(adaptive=jk.Adaptive(stride=256)), ["stride is 256", "160", "128"]),
        (lambda: sweep(adaptive="yes"), ["'yes'", "jk.Adaptive"]),
        (lambda: sweep(adaptive=True, store="x.zarr"), ["held in this process", "leave store out"]),
        (lambda: sweep("forward_count", adaptive=jk.Adaptive(label="sign")), ["forward_count", "sign"]),
        (lambda: sweep("forward_count", adaptive=jk.Adaptive(label="sing")), ["'sing'", "'forward_count'"]),
        (lambda: sweep(named("size"), adaptive=True), ["'size'", "another name"]),
        (lambda: signs("smallest_singular_value"), ["'smallest_singular_value'", "sign", "cannot be negative"]),
        (lambda: signs("inverse_condition_number"), ["'inverse_condition_number'", "cannot be negative"]),
        (lambda: poses("direct_determinant"), ["real numbers", "jk.Adaptive(label='sign')"]),
        (lambda: jk.fields.from_function(len, name="n", domain="pose", dtype="complex128"), ["complex128", "'bool'"]),
        (lambda: jk.fields.from_function(len, name="n", domain="pose", dtype="what"), ["what", "integer"]),
        (lambda: sweep(adaptive=True).to_dense(3), ["int", "jk.Grid"]),
        (
            lambda: sweep(adaptive=True).to_dense(jk.Grid(rho1=(0.0, 1.0, 3), rho2=2.0, rho3=(0.0, 1.0, 3))),
            ["rho2", "1.0"],
        ),
        (lambda: jk.plot.cells(3), ["int", "adaptive"]),
        (lambda: jk.plot.cells(sweep()), ["no cells", "jk.plot.section"]),
    ],
)
def test_bad_requests_are_named(call, words):
    with pytest.raises(jk.InputError) as caught:
        call()
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def sweep(field="forward_count", **options):
    return jk.sweep(ROBOT, field, SECTION, **options)


def named(name):
    return jk.fields.from_function(lambda robot, q: q[0] > 1, name=name, domain="joints", dtype="bool")


def poses(field, how=True):
    return jk.sweep(ROBOT, field, jk.Grid(x=(-1.0, 1.0, 9), y=0.0, phi=(*TURN, 8)), adaptive=how)


def signs(field):
    return poses(field, jk.Adaptive(label="sign"))
