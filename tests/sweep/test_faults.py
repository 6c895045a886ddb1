"""Whatever happens to a sweep, the resumed store is the uninterrupted one to the byte: done for real, not mocked."""

import contextlib
import os
import random
import shutil
import subprocess

import pytest
from small_sweep import OTHER, run
from store_checks import beside, files, settled

import jaxkin as jk

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the processes that die are forked")

#: Beside a store may lie, after a kill and until the next sweep into it, only what these end with.
BESIDE = ("jaxkin-lock", "jaxkin-new", "jaxkin-old")


def killed_at(nursery, store, moments, rng):
    """Kills one process after the other at the same store, each at a file event or a moment of its own."""
    kills = 0
    for _ in range(moments):
        # Of a first run's 250 events, and of the 75 of one that finds nothing to do.
        event = {"action": "kill", "at": rng.randint(1, 120)}
        fault = event if rng.random() < 0.75 else {"after": rng.random() * 0.2}
        kills += nursery(store=store, **fault)["end"] == "killed"
        assert all(name.endswith(BESIDE) for name in beside(store)), beside(store)
    return kills


def kill_many_times(nursery, folder, whole, stores, moments):
    rng, kills = random.Random(stores), 0
    for k in range(stores):
        store = folder / str(k) / "map.zarr"
        kills += killed_at(nursery, store, moments, rng)
        settled(store, whole)
    return kills


def test_kills_at_random_moments_leave_no_trace(nursery, tmp_path, whole):
    assert kill_many_times(nursery, tmp_path, whole["map"], stores=2, moments=4) >= 5


@pytest.mark.slow
def test_many_kills_at_random_moments_leave_no_trace(nursery, tmp_path, whole):
    assert kill_many_times(nursery, tmp_path, whole["map"], stores=13, moments=4) >= 35


def kill_in_every_phase(nursery, folder, whole, every):
    """Kills at every so-maniest of the events of a first run: lay-out, tiles, journal, settling, letting go."""
    events = nursery(store=folder / "count" / "map.zarr")["events"]
    kills = 0
    for at in range(1, events + 1, every):
        store = folder / str(at) / "map.zarr"
        kills += nursery(store=store, action="kill", at=at)["end"] == "killed"
        settled(store, whole)
    return kills, events


def test_kills_in_every_phase_leave_no_trace(nursery, tmp_path, whole):
    kills, events = kill_in_every_phase(nursery, tmp_path, whole["map"], every=80)
    assert kills >= 3
    assert events > 200


@pytest.mark.slow
def test_kills_at_every_eighth_event_leave_no_trace(nursery, tmp_path, whole):
    kills, _ = kill_in_every_phase(nursery, tmp_path, whole["map"], every=8)
    assert kills >= 28


def kill_overwriting(nursery, folder, whole, moments):
    """A killed overwrite leaves the old store whole, or the new one as far as it came; never a mixture."""
    run(folder / "old" / "map.zarr", OTHER)
    outcomes = []
    for at in moments:
        store = folder / str(at) / "map.zarr"
        shutil.copytree(folder / "old" / "map.zarr", store)
        assert nursery(store=store, overwrite=True, action="kill", at=at)["end"] == "killed"
        assert all(name.endswith(BESIDE) for name in beside(store))
        try:
            run(store)
            outcomes.append("new")
        except jk.StoreError as error:
            assert "made by another request" in str(error)  # noqa: PT017
            assert files(store) == whole["other"]
            outcomes.append("old")
            run(store, overwrite=True)
        assert files(store) == whole["map"]
        assert beside(store) == []
    return outcomes


def test_a_killed_overwrite_leaves_one_of_the_two_stores(nursery, tmp_path, whole):
    assert kill_overwriting(nursery, tmp_path, whole, (12, 40, 100)) == ["old", "old", "new"]


@pytest.mark.slow
def test_overwrites_killed_at_many_moments_leave_one_of_the_two_stores(nursery, tmp_path, whole):
    assert set(kill_overwriting(nursery, tmp_path, whole, range(3, 120, 6))) == {"old", "new"}


def test_a_kill_between_the_two_moves_of_an_overwrite_gives_the_old_store_back(tmp_path, whole):
    store = tmp_path / "map.zarr"
    run(store, OTHER)
    os.rename(store, tmp_path / ".map.zarr.jaxkin-old")
    (tmp_path / ".map.zarr.jaxkin-new" / "height").mkdir(parents=True)
    with pytest.raises(jk.StoreError, match="made by another request"):
        run(store)
    assert files(store) == whole["other"]
    assert beside(store) == []


# -- a full disk --------------------------------------------------------------------------------------------------


def fill_disk_at(nursery, folder, whole, moments):
    told = 0
    for at in moments:
        store = folder / str(at) / "map.zarr"
        store.parent.mkdir()
        answer = nursery(store=store, action="full", at=at)
        if answer["end"] == "StoreError":
            told += 1
            assert "No space left on device" in answer["message"]
            assert "\n" not in answer["message"]
        assert not [p for p in store.parent.rglob("*.new") if p.is_file()]
        settled(store, whole)
    return told


def test_a_disk_that_fills_up_is_named_and_costs_nothing_that_is_whole(nursery, tmp_path, whole):
    assert fill_disk_at(nursery, tmp_path, whole["map"], (1, 25, 45)) >= 3


@pytest.mark.slow
def test_a_disk_that_fills_up_at_any_write_is_named(nursery, tmp_path, whole):
    assert fill_disk_at(nursery, tmp_path, whole["map"], range(1, 100, 7)) >= 8


@pytest.fixture
def small_disk(tmp_path):
    """A file system of half a megabyte."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=512k", "tmpfs", str(folder)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only root can mount a small disk, and not everywhere")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize("free", [0, 12_000, 60_000, 90_000])
def test_a_real_full_disk_is_named_and_the_rest_is_computed_when_there_is_space(small_disk, free, whole):
    store, ballast = small_disk / "map.zarr", small_disk / "ballast"
    with contextlib.suppress(OSError), ballast.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(4096))
    os.truncate(ballast, max(0, ballast.stat().st_size - free))
    with pytest.raises(jk.StoreError, match="No space left on device") as caught:
        run(store)
    assert "\n" not in str(caught.value)
    assert "space" in str(caught.value).split("device")[1]
    ballast.unlink()
    settled(store, whole["map"])
