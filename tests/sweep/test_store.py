import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr

import jaxkin as jk
from jaxkin.sweep import engine, plan, tiler
from jaxkin.sweep.lock import let_go, locked

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
}
#: What coordinates may meet, and the axis that is damaged then.
COORDINATES = {
    "gone": ("rho1", lambda s: shutil.rmtree(s / "rho1")),
    "cut": ("rho3", lambda s: _cut(next((s / "rho3" / "c").iterdir()))),
    "chunk gone": ("rho1", lambda s: shutil.rmtree(s / "rho1" / "c")),
    "description gone": ("rho1", lambda s: (s / "rho1" / "zarr.json").unlink()),
    "description cut": ("rho3", lambda s: _cut(s / "rho3" / "zarr.json")),
    "a file instead": ("rho1", lambda s: (shutil.rmtree(s / "rho1"), (s / "rho1").write_text("mine"))),
    "other values": ("rho1", lambda s: _shift(s / "rho1")),
    "a fixed one changed": ("rho2", lambda s: _shift(s / "rho2")),
}


def _cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _shift(path):
    array = zarr.open_array(path, mode="r+")
    array[...] = np.nextafter(array[...], np.inf)


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


@pytest.mark.parametrize("damage", COORDINATES)
@pytest.mark.filterwarnings("ignore:Object at rho1 is not recognized")
def test_damaged_coordinates_are_told_and_written_anew_to_the_byte(damage, tmp_path, monkeypatch):
    store = tmp_path / "map.zarr"
    jk.sweep(ROBOT, "forward_count", GRID, store=store)
    whole = snapshot(store)
    axis, harm = COORDINATES[damage]
    harm(store)
    check = jk.verify_store(store)
    assert (check.ok, check.damaged_coordinates, check.damaged) == (False, [axis], [])
    assert f"the coordinates of {axis} are damaged; the same request makes them anew" in str(check)
    with pytest.raises(jk.StoreError, match=rf"damaged coordinates \({axis}\): run the same request again"):
        jk.open_store(store)
    with monkeypatch.context() as patch:
        patch.setattr(tiler.Tiler, "compute", lambda *_: pytest.fail("no tile is damaged"))
        again = jk.sweep(ROBOT, "forward_count", GRID, store=store)
    assert json.loads(again.attrs["run_log"])["rewritten_coordinates"] == [axis]
    after = snapshot(store)
    log = Path("forward_count", "run_log.jsonl")
    assert after.pop(log) != whole.pop(log)
    assert after == whole
    assert jk.verify_store(store).ok


def test_what_a_parser_says_is_the_cause_and_not_the_sentence(tmp_path):
    store = tmp_path / "map.zarr"
    for file in ("zarr.json", "forward_count/zarr.json"):
        jk.sweep(ROBOT, "forward_count", GRID, store=store)
        text = (store / file).read_text()
        (store / file).write_text(text[: len(text) // 2])
        for call in (
            lambda: jk.sweep(ROBOT, "forward_count", GRID, store=store),
            lambda: jk.open_store(store),
            lambda: jk.describe_store(store),
            lambda: jk.verify_store(store),
        ):
            with pytest.raises(jk.StoreError) as caught:
                call()
            assert caught.value.__cause__ is not None
            assert str(caught.value.__cause__) not in str(caught.value)
            for word in ("Unterminated", "Expecting", "column", "char "):
                assert word not in str(caught.value)
        (store / file).write_text(text)


def test_a_reader_gets_the_advice_of_a_reader(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    group = tmp_path / "group.zarr"
    zarr.create_group(group)
    for path in (tmp_path, tmp_path / "notes.txt", group):
        for read in (jk.open_store, jk.describe_store, jk.verify_store):
            with pytest.raises(jk.StoreError, match="give the path of one that a sweep has written") as caught:
                read(path)
            for word in ("overwrite", "choose another", "move it away"):
                assert word not in str(caught.value)
        with pytest.raises(jk.StoreError, match="move it away or choose another path"):
            jk.sweep(ROBOT, "forward_count", GRID, store=path)


def test_a_forecast_refuses_what_the_store_would_refuse_and_writes_nothing(tmp_path, monkeypatch):
    store = tmp_path / "map.zarr"
    jk.sweep(ROBOT, "forward_count", GRID, store=store)
    (tmp_path / "file").write_text("mine")
    before = snapshot(tmp_path)
    assert jk.forecast(ROBOT, "forward_count", GRID, store=store).samples == 61 * 47
    assert jk.forecast(ROBOT, "forward_count", OTHER, store=store, overwrite=True).samples == 61 * 47
    assert jk.forecast(ROBOT, "forward_count", OTHER, store=tmp_path / "a" / "b.zarr").samples == 61 * 47
    for path, grid, words in (
        (store, OTHER, "made by another request"),
        (tmp_path / "file", GRID, "no jaxkin store"),
        (tmp_path / "file" / "map.zarr", GRID, "cannot be written"),
        (tmp_path, GRID, "no jaxkin store"),
    ):
        with pytest.raises(jk.StoreError, match=words):
            jk.forecast(ROBOT, "forward_count", grid, store=path)
    with pytest.raises(jk.InputError, match=r"store is 3.*path of a folder"):
        jk.forecast(ROBOT, "forward_count", GRID, store=3)
    with pytest.raises(jk.InputError, match="workers is 0"):
        jk.forecast(ROBOT, "forward_count", GRID, store=store, workers=0)
    with monkeypatch.context() as patch:
        # Root may write everywhere.
        patch.setattr(os, "access", lambda *_, **__: False)
        with pytest.raises(jk.StoreError, match="cannot be written"):
            jk.forecast(ROBOT, "forward_count", GRID, store=tmp_path / "new.zarr")
    lock = locked(store)
    with pytest.raises(jk.StoreError, match="written by another process"):
        jk.forecast(ROBOT, "forward_count", GRID, store=store)
    let_go(lock)
    assert snapshot(tmp_path) == before


def test_a_lost_chunk_is_computed_again(tmp_path):
    store = tmp_path / "map.zarr"
    whole = jk.sweep(ROBOT, "forward_count", GRID, store=store).load()
    (store / "forward_count" / "c" / "2" / "0").unlink()
    with (store / "forward_count" / "tiles.journal").open("ab") as journal:
        journal.write(b"\xff\x00 done\n99999 done\n")
    again = jk.sweep(ROBOT, "forward_count", GRID, store=store)
    assert again.attrs["complete"] == 1
    xarray.testing.assert_equal(again.load(), whole)
