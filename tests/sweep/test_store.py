import json
import os
import shutil

import numpy as np
import pytest
import xarray

import jaxkin as jk
from jaxkin.sweep import engine, plan, tiler

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
GRID = jk.Grid(rho1=(0.01, 4.0, 61), rho2=1.0, rho3=(0.02, 4.0, 47))
OTHER = jk.Grid(rho1=(0.01, 4.0, 61), rho2=1.5, rho3=(0.02, 4.0, 47))


@pytest.fixture(autouse=True)
def _small_tiles(monkeypatch):
    """Makes blocks, and so tiles, of a few rows."""
    monkeypatch.setattr(plan, "_TILE_SAMPLES", 200)
    make = engine.make_plan
    monkeypatch.setattr(engine, "make_plan", lambda robot, field, *more: make(robot, small_blocks(field), *more))


def small_blocks(field):
    return jk.Field(**{**vars(field), "block": lambda robot: 200})


def snapshot(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("name", ["forward_count", "forward_branches"])
def test_store_holds_what_memory_holds(name, tmp_path):
    stored = jk.sweep(ROBOT, name, GRID, store=tmp_path / "map.zarr")
    held = jk.sweep(ROBOT, name, GRID)
    assert set(stored.variables) == set(held.variables)
    for variable in held.variables:
        np.testing.assert_array_equal(stored[variable].values, held[variable].values)
        assert stored[variable].dtype == held[variable].dtype
        assert stored[variable].dims == held[variable].dims
        assert stored[variable].attrs == held[variable].attrs
    assert stored.attrs["request_hash"] == held.attrs["request_hash"]
    assert stored.attrs["complete"] == 1


def test_any_program_can_open_it(tmp_path):
    jk.sweep(ROBOT, "forward_count", GRID, store=tmp_path / "map.zarr")
    raw = xarray.open_zarr(tmp_path / "map.zarr", consolidated=False, chunks=None)
    assert raw.forward_count.dims == ("rho1", "rho3")
    assert raw.rho1.attrs["units"] == "length"


def test_the_same_request_goes_on_where_it_stopped(tmp_path, monkeypatch):
    store = tmp_path / "map.zarr"
    whole = jk.sweep(ROBOT, "forward_count", GRID, store=store).load()
    journal = store / "forward_count" / "tiles.journal"
    lines = journal.read_text().splitlines(keepends=True)
    assert len(lines) > 5
    # As after a kill: some tiles done, the last line torn.
    journal.write_text("".join(lines[:3]) + "17")
    computed = []
    original = tiler.Tiler.compute
    monkeypatch.setattr(
        tiler.Tiler, "compute", lambda self, box, into: (computed.append(box), original(self, box, into))
    )
    again = jk.sweep(ROBOT, "forward_count", GRID, store=store)
    assert len(computed) == len(lines) - 3
    xarray.testing.assert_equal(again.load(), whole)
    computed.clear()
    jk.sweep(ROBOT, "forward_count", GRID, store=store)
    assert computed == []


def test_a_store_of_another_request_is_refused_and_untouched(tmp_path):
    store = tmp_path / "map.zarr"
    jk.sweep(ROBOT, "forward_count", GRID, store=store)
    before = snapshot(store)
    with pytest.raises(jk.StoreError) as caught:
        jk.sweep(ROBOT, "forward_count", OTHER, store=store)
    for word in ("grid.rho2 is 1.0 there and 1.5 here", "overwrite=True"):
        assert word in str(caught.value)
    assert isinstance(caught.value, FileExistsError)
    assert snapshot(store) == before
    replaced = jk.sweep(ROBOT, "forward_count", OTHER, store=store, overwrite=True)
    assert float(replaced.rho2) == 1.5


def test_what_is_no_store_is_never_replaced(tmp_path):
    folder, file = tmp_path / "folder", tmp_path / "file"
    folder.mkdir()
    (folder / "thesis.txt").write_text("years of work")
    file.write_text("more")
    for path in (folder, file):
        for overwrite in (False, True):
            with pytest.raises(jk.StoreError, match="no jaxkin store"):
                jk.sweep(ROBOT, "forward_count", GRID, store=path, overwrite=overwrite)
    assert (folder / "thesis.txt").read_text() == "years of work"
    assert file.read_text() == "more"


def test_a_store_cut_short_in_its_description_is_refused(tmp_path):
    store = tmp_path / "map.zarr"
    jk.sweep(ROBOT, "forward_count", GRID, store=store)
    text = (store / "zarr.json").read_text()
    (store / "zarr.json").write_text(text[: len(text) // 2])
    with pytest.raises(jk.StoreError, match="without a readable jaxkin request"):
        jk.sweep(ROBOT, "forward_count", GRID, store=store)


def test_an_empty_folder_is_taken_and_parents_are_made(tmp_path):
    (tmp_path / "empty").mkdir()
    assert jk.sweep(ROBOT, "forward_count", GRID, store=tmp_path / "empty").attrs["complete"] == 1
    assert jk.sweep(ROBOT, "forward_count", GRID, store=tmp_path / "a" / "b.zarr").attrs["complete"] == 1


@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(jk.StoreError, match="cannot be written"):
        jk.sweep(ROBOT, "forward_count", GRID, store=tmp_path / "map.zarr")


def test_a_parent_that_is_a_file_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(jk.StoreError, match="cannot be written"):
        jk.sweep(ROBOT, "forward_count", GRID, store=tmp_path / "file" / "map.zarr")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_the_run_log_is_no_part_of_identity(tmp_path):
    one = jk.sweep(ROBOT, "forward_count", GRID, store=tmp_path / "map.zarr", workers=1)
    other = jk.sweep(ROBOT, "forward_count", GRID, workers=2)
    assert one.attrs["request_hash"] == other.attrs["request_hash"]
    assert json.loads(one.attrs["run_log"])["workers"] == 1


DAMAGE = {
    "array description gone": lambda s: (s / "forward_count" / "zarr.json").unlink(),
    "array description cut": lambda s: _cut(s / "forward_count_nearly_double" / "zarr.json"),
    "array gone": lambda s: shutil.rmtree(s / "forward_count"),
    "coordinates gone": lambda s: shutil.rmtree(s / "rho1"),
    "coordinates cut": lambda s: _cut(next((s / "rho3" / "c").iterdir())),
    "coordinates' chunk gone": lambda s: shutil.rmtree(s / "rho1" / "c"),
}


def _cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_store_is_refused_in_one_sentence_and_replaced_when_asked(damage, tmp_path):
    store = tmp_path / "map.zarr"
    whole = jk.sweep(ROBOT, "forward_count", GRID, store=store).load()
    DAMAGE[damage](store)
    with pytest.raises(jk.StoreError, match="damaged") as caught:
        jk.sweep(ROBOT, "forward_count", GRID, store=store)
    assert "\n" not in str(caught.value)
    assert "overwrite=True" in str(caught.value)
    xarray.testing.assert_equal(jk.sweep(ROBOT, "forward_count", GRID, store=store, overwrite=True).load(), whole)


def test_a_lost_chunk_is_computed_again(tmp_path):
    store = tmp_path / "map.zarr"
    whole = jk.sweep(ROBOT, "forward_count", GRID, store=store).load()
    (store / "forward_count" / "c" / "2" / "0").unlink()
    with (store / "forward_count" / "tiles.journal").open("ab") as journal:
        journal.write(b"\xff\x00 done\n99999 done\n")
    again = jk.sweep(ROBOT, "forward_count", GRID, store=store)
    assert again.attrs["complete"] == 1
    xarray.testing.assert_equal(again.load(), whole)
