"""Whatever happens to a sweep, the resumed store is the uninterrupted one to the byte: done for real, not mocked."""

import contextlib
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import filelock
import numpy as np
import pytest
import small_sweep
from small_sweep import GRID, OTHER, TILES, run

import jaxkin as jk
from jaxkin.core import provenance
from jaxkin.sweep import engine
from jaxkin.sweep import store as store_module
from jaxkin.sweep.store import Store
from jaxkin.sweep.threads import run_in_threads
from jaxkin.sweep.tiler import Tiler

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the processes that die are forked")

#: Beside a store may lie, after a kill and until the next sweep into it, only what these end with.
BESIDE = ("jaxkin-lock", "jaxkin-new", "jaxkin-old")


def files(store):
    """Returns every file of a store but the run log."""
    paths = (p for p in sorted(store.rglob("*")) if p.is_file() and p.name != "run_log.jsonl")
    return {str(p.relative_to(store)): p.read_bytes() for p in paths}


def beside(store):
    return sorted(p.name for p in store.parent.iterdir() if p != store)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Files of the uninterrupted stores of both requests."""
    folder = tmp_path_factory.mktemp("whole")
    run(folder / "map.zarr")
    run(folder / "other.zarr", OTHER)
    assert beside(folder / "map.zarr") == ["other.zarr"]
    return {"map": files(folder / "map.zarr"), "other": files(folder / "other.zarr")}


@pytest.fixture(scope="module")
def nursery(tmp_path_factory):
    """Returns a function that runs the small sweep in a process of its own, which meets a fault."""
    command = [sys.executable, small_sweep.__file__]
    environment = os.environ | {
        "PYTHONWARNINGS": "ignore",
        "JAX_PLATFORMS": "cpu",
        "JAX_COMPILATION_CACHE_DIR": str(tmp_path_factory.mktemp("kernels")),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment) as server:

        def ask(**order):
            server.stdin.write(json.dumps(order, default=str) + "\n")
            server.stdin.flush()
            answer = json.loads(server.stdout.readline())
            assert answer.get("end") != "bug", answer["message"]
            return answer

        try:
            yield ask
        finally:
            server.stdin.close()
            server.wait(30)


def settled(store, whole):
    """Resumes in this process, and asserts that the store is the uninterrupted one, with nothing left behind."""
    assert run(store).attrs["complete"] == 1
    assert files(store) == whole
    assert beside(store) == []


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


# -- damage -------------------------------------------------------------------------------------------------------


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


def journal_of(store):
    return store / "height" / "tiles.journal"


def lines_of(store):
    return journal_of(store).read_text().splitlines(keepends=True)


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


@pytest.fixture(scope="module")
def pristine(tmp_path_factory):
    store = tmp_path_factory.mktemp("pristine") / "map.zarr"
    run(store)
    return store


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
    lock = store_module._locked(tmp_path / "map.zarr")
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
