"""``jaxkin map --adaptive``: cells, as a picture, as data and as numbers."""

import json

import numpy as np
import pytest
import xarray

import jaxkin as jk

AXES = ["--fix", "rho2=1", "--grid", "rho1=0:4:161", "--grid", "rho3=0:4:161"]
CELLS = ["map", "rpr3-analytic", *AXES, "--adaptive"]


def snapshot(folder):
    return {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_cells_are_a_picture_data_and_numbers(run, tmp_path):
    out = tmp_path / "cells"
    code, printed, err = run(*CELLS, "--out", out, "--json", "--seed", "3", "--stride", "16", "--workers", "1")
    assert (code, err) == (0, "")
    numbers = json.loads(printed)
    assert sorted(p.name for p in out.iterdir()) == ["cells.json", "cells.pdf", "cells.png", "cells.zarr"]
    assert json.loads((out / "cells.json").read_text()) == numbers
    assert (numbers["adaptive"]["seed"], numbers["adaptive"]["stride"]) == (3, 16)
    assert numbers["samples"] == 161 * 161
    assert numbers["evaluations"] < numbers["samples"]

    # The same cells as in Python, and the same map as a dense sweep.
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    grid = jk.Grid(rho1=(0.0, 4.0, 161), rho2=1.0, rho3=(0.0, 4.0, 161))
    found = jk.sweep(robot, "forward_count", grid, adaptive=jk.Adaptive(seed=3, stride=16))
    assert numbers["request_hash"] == found.attrs["request_hash"]
    assert numbers["cells"] == found.sizes["cell"]
    measured = found.measure()
    for label in measured.label.values.tolist():
        assert numbers["measures"][str(label)]["measure"] == float(measured["measure"].sel(label=label))
    read = jk.AdaptiveSweep.of(xarray.open_zarr(out / "cells.zarr", consolidated=False, chunks=None))
    dense = jk.sweep(robot, "forward_count", grid)
    np.testing.assert_array_equal(read.to_dense().forward_count, dense.forward_count)

    before = snapshot(out)
    same = [*CELLS, "--out", out, "--seed", "3", "--stride", "16"]
    assert run(*same)[0] == 0
    assert snapshot(out) == before
    (out / "cells.png").unlink()
    assert run(*same)[0] == 0
    assert set(snapshot(out)) == set(before)

    code, _, err = run(*CELLS, "--out", out, "--seed", "4")
    assert code == 2
    assert "another request" in err
    assert "--force" in err
    assert snapshot(out)[out / "cells.json"] == before[out / "cells.json"]
    assert run(*CELLS, "--out", out, "--seed", "4", "--force")[0] == 0
    assert json.loads((out / "cells.json").read_text())["adaptive"]["seed"] == 4
    assert [p.name for p in out.iterdir() if p.name.startswith(".")] == []


def test_cells_are_told_of_on_a_terminal(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, printed, _ = run(*CELLS)
    assert code == 0
    for word in ("forward_count of rpr3-analytic in", "evaluated", "nothing missed that holds a box", "between"):
        assert word in printed
    assert list(tmp_path.iterdir()) == []
    code, printed, _ = run(*CELLS, "--probes", "0", "--proof", "0", "--json")
    assert code == 0
    assert json.loads(printed)["missed_share_bound"] is None
    assert json.loads(printed)["measure_of_cells"]["proved"] == 0


def test_signs_and_branches(run, tmp_path):
    poses = ["map", "rpr3-analytic", "--fix", "phi=0.4", "--grid", "x=-3:3:65", "--grid", "y=-3:3:65", "--adaptive"]
    code, printed, _ = run(*poses, "--field", "direct_determinant", "--label", "sign", "--json")
    assert code == 0
    assert set(json.loads(printed)["measures"]) == {"negative", "zero", "positive"}  # Zero at the origin, a sample.
    cube = [a for k in (1, 2, 3) for a in ("--grid", f"rho{k}=0.1:3:9")]
    code, _, err = run("map", "rpr3-analytic", *cube, "--adaptive", "--out", tmp_path / "cube")
    assert code == 0
    assert "no picture" in err
    assert sorted(p.name for p in (tmp_path / "cube").iterdir()) == ["cells.json", "cells.zarr"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([*CELLS, "--store", "x.zarr"], ["leave --store out", "--out"]),
        ([*CELLS, "--scheduler", "tcp://127.0.0.1:1"], ["leave --scheduler out"]),
        ([*CELLS, "--float32"], ["leave --float32 out", "float64"]),
        ([*CELLS, "--resume"], ["leave --resume out"]),
        ([*CELLS, "--dry-run"], ["leave --dry-run out"]),
        ([*CELLS, "--store", "x.zarr", "--float32"], ["leave --store and --float32 out"]),
        ([*CELLS[:-1], "--seed", "0"], ["--seed is given without --adaptive"]),
        ([*CELLS[:-1], "--label", "sign"], ["--label is given without --adaptive"]),
        ([*CELLS, "--stride", "two"], ["--stride", "two"]),
    ],
)
def test_options_that_do_not_go_together_are_named(arguments, words, run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    for word in words:
        assert word in err
    assert len(err.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_cells_of_jaxkins_is_never_replaced(run, tmp_path):
    (tmp_path / "out" / "cells.zarr").mkdir(parents=True)
    (tmp_path / "out" / "cells.zarr" / "thesis.txt").write_text("years of work")
    for force in ([], ["--force"]):
        code, _, err = run(*CELLS, "--out", tmp_path / "out", *force)
        assert code == 2
        assert "no cells of jaxkin's" in err
    assert (tmp_path / "out" / "cells.zarr" / "thesis.txt").read_text() == "years of work"
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("years of work")
    code, _, err = run(*CELLS, "--out", tmp_path / "other")
    assert code == 2
    assert "holds something else" in err
