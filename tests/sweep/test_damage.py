"""Whatever is damaged in a store is found, and mended or refused in one sentence."""

import json
import os
import random
import shutil

import pytest
import small_sweep
from small_sweep import OTHER, run
from store_checks import beside, files, journal_of, lines_of, settled

import jaxkin as jk
from jaxkin.core import provenance
from jaxkin.sweep.tiler import Tiler


def data_file(store, rng):
    return rng.choice([p for p in sorted(store.rglob("c/*/*")) if p.is_file() and p.parts[-4].startswith("height")])


def flip(store, rng):
    file = data_file(store, rng)
    content = bytearray(file.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    file.write_bytes(content)


def cut(store, rng):
    file = data_file(store, rng)
    os.truncate(file, rng.randrange(file.stat().st_size))


def delete(store, rng):
    data_file(store, rng).unlink()


def append(store, rng):
    with data_file(store, rng).open("ab") as file:
        file.write(b"\0")


def swap(store, rng):
    one, other = data_file(store, rng), data_file(store, rng)
    while one.read_bytes() == other.read_bytes():
        other = data_file(store, rng)
    one.rename(store / "aside")
    other.rename(one)
    (store / "aside").rename(other)


def fill_hole(store, rng):
    """Puts a file where there is none, because all of the tile is the fill value."""
    file = data_file(store, rng)
    hole = next(p for p in (file.parent.parent / "0" / str(k) for k in range(9)) if not p.exists())
    hole.parent.mkdir(exist_ok=True)
    shutil.copy(file, hole)


def journal_cut(store, rng):
    os.truncate(journal_of(store), rng.randrange(journal_of(store).stat().st_size))


def journal_gone(store, rng):
    journal_of(store).unlink()


def journal_edited(store, rng):
    lines = lines_of(store)
    k = rng.randrange(len(lines))
    lines[k] = lines[k].replace(lines[k][-5], "0" if lines[k][-5] != "0" else "1")
    journal_of(store).write_text("".join(lines))


def journal_swapped(store, rng):
    first, *_, last = (line.split() for line in lines_of(store))
    journal_of(store).write_text(" ".join([first[0], *last[1:]]) + "\n" + " ".join([last[0], *first[1:]]) + "\n")


def journal_doubled(store, rng):
    lines = lines_of(store)
    journal_of(store).write_text("".join([*lines, f"3 {'0' * 32} -\n", *lines[5:2:-1], "4 -\n", "11 - - -\n"]))


def journal_nonsense(store, rng):
    journal_of(store).write_bytes(
        b"\xff\xfe\0" + rng.randbytes(99) + b"\n-1 - -\n" + b"9" * 5000 + b" - -\n99999999 - -\n" + b"\0" * 4096
    )


def journal_without_last_newline(store, rng):
    os.truncate(journal_of(store), journal_of(store).stat().st_size - 1)


def foreign_partial(store, rng):
    (store / "height" / "c" / f"0.{'0' * 32}.partial").write_bytes(b"half")


DAMAGE = (
    flip,
    cut,
    delete,
    append,
    swap,
    fill_hole,
    journal_cut,
    journal_gone,
    journal_edited,
    journal_swapped,
    journal_doubled,
    journal_nonsense,
    journal_without_last_newline,
    foreign_partial,
)


@pytest.mark.parametrize("damage", DAMAGE, ids=lambda damage: damage.__name__)
def test_damage_is_found_and_only_what_is_damaged_is_computed_again(damage, pristine, tmp_path, whole, monkeypatch):
    computed = []
    original = Tiler.compute
    monkeypatch.setattr(Tiler, "compute", lambda self, box, into: (computed.append(box), original(self, box, into)))
    for seed in range(3):
        store = tmp_path / str(seed) / "map.zarr"
        shutil.copytree(pristine, store)
        damage(store, random.Random(seed))
        before = files(store)
        assert before != whole["map"]
        computed.clear()
        settled(store, whole["map"])
        if not damage.__name__.startswith("journal") and damage is not foreign_partial:
            assert 1 <= len(computed) <= 2


def test_the_tiles_that_were_recomputed_are_in_the_run_log(pristine, tmp_path):
    store = tmp_path / "map.zarr"
    shutil.copytree(pristine, store)
    delete(store, random.Random(0))
    assert len(json.loads(run(store).attrs["run_log"])["recomputed_tiles"]) == 1


@pytest.mark.filterwarnings("ignore:Object at notes.txt is not recognized")
def test_foreign_files_stay_and_change_nothing(pristine, tmp_path, whole):
    store = tmp_path / "map.zarr"
    shutil.copytree(pristine, store)
    names = ("notes.txt", "height/readme", "height/c/9/9", "height/c/notes.partial")
    for name in names:
        (store / name).parent.mkdir(exist_ok=True)
        (store / name).write_text("mine")
    assert run(store).attrs["complete"] == 1
    assert files(store) == whole["map"] | dict.fromkeys(names, b"mine")


def rewrite(store, change):
    """Changes the attributes of a store as an editor would."""
    description = json.loads((store / "zarr.json").read_text())
    change(description["attributes"])
    (store / "zarr.json").write_text(json.dumps(description))


def _other_geometry(attrs):
    request = json.loads(attrs["request"])
    request["geometry"]["c2"] = 1.25
    attrs["request"] = json.dumps(request, sort_keys=True, separators=(",", ":"))


def _other_hash(attrs):
    attrs["request_hash"] = "0" * 64


def _no_labels(attrs):
    attrs["labels"] = "{"


def _other_tiles(attrs):
    attrs["tiles"] += 1


def _other_layout(attrs):
    attrs["layout"] = json.dumps(json.loads(attrs["layout"]) | {"tile": [1, 1]})


@pytest.mark.parametrize("change", [_other_geometry, _other_hash, _no_labels, _other_tiles, _other_layout])
def test_a_changed_description_is_refused_in_one_sentence_and_nothing_is_touched(change, pristine, tmp_path):
    store = tmp_path / "map.zarr"
    shutil.copytree(pristine, store)
    rewrite(store, change)
    refused(store)


def refused(store, match=None, **options):
    before = files(store)
    with pytest.raises(jk.StoreError, match=match) as caught:
        run(store, **options)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 700
    assert files(store) == before
    assert beside(store) == []


def _other_jaxlib(attrs):
    attrs["environment"] = json.dumps(json.loads(attrs["environment"]) | {"jaxlib": "0.1.2"})


def test_another_jaxlib_opens_a_whole_store_and_goes_on_with_no_other(pristine, tmp_path):
    store = tmp_path / "map.zarr"
    shutil.copytree(pristine, store)
    rewrite(store, _other_jaxlib)
    assert run(store).attrs["complete"] == 1
    lines = lines_of(store)
    journal_of(store).write_text("".join(lines[:4]) + "torn")
    refused(store, match="jaxlib is '0.1.2' there")
    journal_of(store).write_text("".join(lines))
    flip(store, random.Random(1))
    refused(store, match="jaxlib is '0.1.2' there")


@pytest.mark.parametrize("name", ["tiles.journal", "c"])
def test_what_cannot_be_read_is_named_in_one_sentence(name, pristine, tmp_path):
    store = tmp_path / "map.zarr"
    shutil.copytree(pristine, store)
    place = store / "height" / name
    shutil.rmtree(place) if place.is_dir() else place.unlink()
    place.write_text("") if name == "c" else place.mkdir()
    with pytest.raises(jk.StoreError, match="cannot be written") as caught:
        run(store)
    assert "\n" not in str(caught.value)
    assert beside(store) == []


# -- another request ----------------------------------------------------------------------------------------------


def test_another_request_is_refused_and_the_store_untouched(pristine, tmp_path, monkeypatch):
    store = tmp_path / "map.zarr"
    shutil.copytree(pristine, store)
    lines = lines_of(store)
    journal_of(store).write_text("".join(lines[:7]) + "12")
    refused(store, "grid.phi is 0.25 there and 0.5 here", grid=OTHER)
    refused(store, "field.version is '1' there and '2' here", field=small_sweep.field(version="2"))
    refused(store, "another request", field="inverse_branches")
    with monkeypatch.context() as patch:
        patch.setattr(small_sweep, "robot", lambda: jk.mechanisms.rpr3.analytic(1.25, 0.0, 1.0))
        refused(store, "geometry.c2 is 1.0 there and 1.25 here")
    with monkeypatch.context() as patch:
        patch.setattr(provenance, "ALGORITHM_VERSION", provenance.ALGORITHM_VERSION + 1)
        refused(store, "algorithm is ")
    refused(store, "laid out by another version", field=small_sweep.field(block=50))


def test_another_precision_is_refused(tmp_path):
    single = small_sweep.field(single=True)
    run(tmp_path / "map.zarr", field=single)
    refused(tmp_path / "map.zarr", "precision is 'float64' there and 'float32' here", field=single, precision="float32")
