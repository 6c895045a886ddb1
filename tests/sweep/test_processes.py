"""Two processes at one store, Ctrl-C, threads and errors: the resumed store is the uninterrupted one to the byte."""

import os
import shutil
import signal
import threading
import time
from pathlib import Path

import filelock
import numpy as np
import pytest
import small_sweep
from small_sweep import GRID, OTHER, TILES, run
from store_checks import beside, files, lines_of, settled

import jaxkin as jk
from jaxkin.sweep import engine
from jaxkin.sweep import lock as lock_module
from jaxkin.sweep.store import Store
from jaxkin.sweep.threads import run_in_threads
from jaxkin.sweep.tiler import Tiler

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the processes that die are forked")

# -- two processes ------------------------------------------------------------------------------------------------


def share(nursery, store, whole, at):
    """Stops a process at an event, comes to its store with this one, lets it go on, and returns who worked."""
    other = nursery(store=store, action="stop", at=at)
    try:
        try:
            run(store)
            winner = "this"
        except jk.StoreError as error:
            assert "is being written by another process" in str(error)  # noqa: PT017
            assert "\n" not in str(error)  # noqa: PT017
            winner = "other"
    finally:
        if other["end"] == "stopped":
            os.kill(other["pid"], signal.SIGCONT)
            nursery(reap=other["pid"])
    settled(store, whole)
    return winner


def test_of_two_processes_one_works_and_the_other_is_told(nursery, tmp_path, whole):
    assert [share(nursery, tmp_path / str(k) / "map.zarr", whole["map"], k) for k in (30, 150)] == ["other"] * 2
    # Before it has the lock, the stopped one has nothing.
    assert share(nursery, tmp_path / "first" / "map.zarr", whole["map"], 1) == "this"


@pytest.mark.slow
def test_of_two_processes_that_meet_at_any_moment_one_works(nursery, tmp_path, whole):
    winners = [
        share(nursery, tmp_path / str(k) / "map.zarr", whole["map"], k) for k in [*range(1, 9), *range(9, 250, 20)]
    ]
    assert set(winners) == {"this", "other"}


def test_the_lock_of_a_killed_process_is_free(nursery, tmp_path, whole):
    store = tmp_path / "map.zarr"
    other = nursery(store=store, action="stop", at=120)
    with pytest.raises(jk.StoreError, match="another process"):
        run(store)
    os.kill(other["pid"], signal.SIGKILL)
    assert nursery(reap=other["pid"])["end"] == "killed"
    settled(store, whole["map"])


def test_whoever_looks_at_a_store_that_is_being_written_is_told_so(nursery, tmp_path, whole):
    store = tmp_path / "map.zarr"
    other = nursery(store=store, action="stop", at=150)
    try:
        for _ in range(3):
            check, info = jk.verify_store(store), jk.describe_store(store)
            assert (check.ok, check.writing, check.damaged, info.writing) == (False, True, [], True)
            assert 0 < check.tiles_done < TILES
            assert f"{TILES - check.tiles_done} of 11 tiles are not written yet" in str(check)
            assert "a sweep is writing to it right now" in str(check)
            assert "missing" not in str(check)
            assert "a sweep is writing to it right now" in str(info)
    finally:
        os.kill(other["pid"], signal.SIGKILL)
        nursery(reap=other["pid"])
    check = jk.verify_store(store)
    assert (check.ok, check.writing) == (False, False)
    assert f"{TILES - check.tiles_done} of 11 tiles are missing; the same request makes them anew" in str(check)
    settled(store, whole["map"])
    assert str(jk.verify_store(store)).endswith("all 11 tiles are as they were written")


def test_whoever_looks_keeps_nobody_from_writing(tmp_path, whole, monkeypatch):
    acquire, looks = filelock.FileLock.acquire, iter(range(2))

    def met(self):
        # As where somebody looks at that moment.
        if next(looks, None) is not None:
            raise filelock.Timeout(self.lock_file)
        return acquire(self)

    monkeypatch.setattr(filelock.FileLock, "acquire", met)
    settled(tmp_path / "map.zarr", whole["map"])
    assert next(looks, None) is None
    assert not lock_module.being_written(tmp_path / "map.zarr")


@pytest.mark.skipif(lock_module.fcntl is None, reason="looking without taking the lock needs flock")
def test_two_who_look_see_nobody_and_need_no_right_to_write(tmp_path):
    file = lock_module.aside(tmp_path / "map.zarr", "lock")
    file.touch(0o400)
    with file.open("rb") as opened:
        lock_module.fcntl.flock(opened, lock_module.fcntl.LOCK_SH)
        assert not lock_module.being_written(tmp_path / "map.zarr")
        lock_module.fcntl.flock(opened, lock_module.fcntl.LOCK_EX)
        assert lock_module.being_written(tmp_path / "map.zarr")
    assert not lock_module.being_written(tmp_path / "map.zarr")


@pytest.mark.parametrize("anew", [False, True])
def test_a_lock_on_a_file_that_was_removed_meanwhile_is_none(anew, tmp_path, monkeypatch):
    acquire, first = filelock.FileLock.acquire, iter([True])

    def late(self):
        acquire(self)
        if next(first, False):
            os.unlink(self.lock_file)
            if anew:
                Path(self.lock_file).touch()

    monkeypatch.setattr(filelock.FileLock, "acquire", late)
    lock = lock_module.locked(tmp_path / "map.zarr")
    assert Path(lock.lock_file).exists()
    with pytest.raises(jk.StoreError, match="another process"):
        run(tmp_path / "map.zarr")
    lock.release()


@pytest.mark.parametrize("rounds", [1, pytest.param(6, marks=pytest.mark.slow)])
def test_processes_that_race_for_one_store_leave_it_whole(nursery, tmp_path, whole, rounds):
    for k in range(rounds):
        store = tmp_path / str(k) / "map.zarr"
        racers = [nursery(store=store, wait=False, other=bool(n % 2), overwrite=True)["pid"] for n in range(3)]
        for pid in racers:
            assert nursery(reap=pid)["end"] == "done"
        assert files(store) in (whole["map"], whole["other"])
        assert beside(store) == []


def test_two_threads_of_one_process_are_two_as_well(tmp_path, whole, monkeypatch):
    store = tmp_path / "map.zarr"
    begun, go_on = threading.Event(), threading.Event()
    original = Tiler.compute

    def slow(self, box, into):
        begun.set()
        assert go_on.wait(60)
        original(self, box, into)

    monkeypatch.setattr(Tiler, "compute", slow)
    thread = threading.Thread(target=run, args=[store])
    thread.start()
    assert begun.wait(60)
    with pytest.raises(jk.StoreError, match="another process"):
        run(store)
    go_on.set()
    thread.join()
    assert files(store) == whole["map"]


def test_a_link_to_a_store_is_the_store(tmp_path, whole):
    (tmp_path / "disk").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "disk" / "map.zarr")
    for grid, name in ((GRID, "map"), (OTHER, "other")):
        run(tmp_path / "link", grid, overwrite=True)
        assert (tmp_path / "link").is_symlink()
        assert files(tmp_path / "disk" / "map.zarr") == whole[name]


# -- Ctrl-C, threads, errors --------------------------------------------------------------------------------------


def interrupting(monkeypatch, error, after):
    """Makes the tile after so many raise, or the process get Ctrl-C."""
    original, left = Tiler.compute, iter(range(after))

    def compute(self, box, into):
        if next(left, None) is None:
            if error is None:
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.3)
            else:
                raise error
        original(self, box, into)

    monkeypatch.setattr(Tiler, "compute", compute)


@pytest.mark.usefixtures("heeds_ctrl_c")
def test_ctrl_c_keeps_the_tiles(tmp_path, whole, monkeypatch):
    store = tmp_path / "map.zarr"
    with monkeypatch.context() as patch:
        interrupting(patch, None, after=4)
        with pytest.raises(jk.SweepInterrupted) as caught:
            run(store, workers=1)
    assert 4 <= len(lines_of(store)) < TILES
    assert caught.value.samples_done > 0
    assert caught.value.dataset.attrs["complete"] == 0
    assert beside(store) == []
    settled(store, whole["map"])


def test_an_error_in_a_tile_is_the_users_and_keeps_the_others(tmp_path, whole, monkeypatch):
    store = tmp_path / "map.zarr"
    with monkeypatch.context() as patch:
        interrupting(patch, RuntimeError("mine"), after=5)
        with pytest.raises(RuntimeError, match="mine"):
            run(store, workers=3)
    assert len(lines_of(store)) == 5
    assert beside(store) == []
    settled(store, whole["map"])


@pytest.mark.usefixtures("heeds_ctrl_c")
def test_more_ctrl_c_do_not_let_go_of_what_is_being_written():
    written = []

    def work(number):
        if number == 0:
            for _ in range(3):
                time.sleep(0.3)
                os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.6)
        written.append(number)

    with pytest.raises(KeyboardInterrupt):
        list(run_in_threads(work, range(50), 2))
    count = len(written)
    assert 2 <= count < 10
    time.sleep(0.8)
    assert len(written) == count


def test_no_more_tiles_are_in_memory_than_workers_compute(tmp_path, monkeypatch):
    alive, most = 0, 0
    counting = threading.Lock()
    room, keep = Store.room, Store.keep

    def counted(change):
        nonlocal alive, most
        with counting:
            alive += change
            most = max(most, alive)

    monkeypatch.setattr(Store, "room", lambda self, number: (counted(1), room(self, number))[1])
    monkeypatch.setattr(Store, "keep", lambda self, *tile: (keep(self, *tile), counted(-1))[0])
    run(tmp_path / "map.zarr", workers=3)
    assert (alive, most <= 3, most >= 1) == (0, True, True)


def test_the_number_of_workers_leaves_no_trace_in_the_store(tmp_path, whole):
    run(tmp_path / "one.zarr", workers=1)
    run(tmp_path / "many.zarr", workers=5)
    assert files(tmp_path / "one.zarr") == files(tmp_path / "many.zarr") == whole["map"]


def test_checking_a_large_store_shows_how_far_it_is(pristine, tmp_path, capsys, monkeypatch):
    from jaxkin.sweep import progress

    store = tmp_path / "map.zarr"
    shutil.copytree(pristine, store)
    monkeypatch.setattr(progress, "_PATIENCE", -1.0)
    engine.sweep(small_sweep.robot(), small_sweep.HEIGHT, GRID, store=store, progress=True)
    assert "checking what is there" in capsys.readouterr().err


def test_a_million_journalled_tiles_are_read_in_seconds(tmp_path):
    from jaxkin.sweep.journal import Journal

    path = tmp_path / "tiles.journal"
    path.write_text("".join(f"{n} {n:032x} -\n" for n in range(10**6)))
    started = time.perf_counter()
    journal = Journal(path, 10**6, lambda number: [Path("none")])
    assert len(journal) == 10**6
    assert np.all(journal.done())
    assert time.perf_counter() - started < 20
