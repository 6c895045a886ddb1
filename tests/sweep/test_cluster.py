"""Sweeps on a real cluster: a scheduler and workers in processes of their own, of which some are killed."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time

import jax.numpy as jnp
import numpy as np
import pytest
import xarray

import jaxkin as jk
from jaxkin.sweep import cluster
from jaxkin.sweep.fields import Variable

distributed = pytest.importorskip("distributed")

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
GRID = jk.Grid(rho1=(0.01, 4.0, 61), rho2=1.0, rho3=(0.02, 4.0, 47))
PLANE = jk.Grid(x=(0.0, 3.0, 40), y=(0.0, 3.0, 30), phi=0.25)
TILES = 14
TIMEOUT = 60


class Cluster:
    """A scheduler and its workers, started as the documentation says; all on this machine."""

    def __init__(self, folder):
        self.folder, self._file = folder, folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--port", "0", "--scheduler-file", str(self._file))
        self.workers = []
        self.address = None

    def __enter__(self):
        try:
            _wait(self._file.exists)
            self.address = json.loads(self._file.read_text())["address"]
        except BaseException:
            self.__exit__()
            raise
        return self

    def add_worker(self, *options, **environment):
        """Starts a worker process; with a nanny, as is usual, unless told otherwise."""
        common = ("--nthreads", "1", "--nworkers", "1", "--local-directory", str(self.folder))
        self.workers.append(self._start("worker", self.address, *common, *options, **environment))

    def _start(self, *command, **environment):
        kernels = {
            "JAX_COMPILATION_CACHE_DIR": str(self.folder / "kernels"),
            "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
            "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        }
        with (self.folder / "log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", *command, "--host", "127.0.0.1", "--no-dashboard"],
                stdout=log,
                stderr=log,
                env=os.environ | kernels | environment,
                # A group of its own, so that a nanny and its child end together.
                start_new_session=True,
            )

    def __exit__(self, *_):
        """Ends every process that was started, and theirs."""
        for process in (*self.workers, self.scheduler):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait(TIMEOUT)


def _wait(what):
    end = time.monotonic() + TIMEOUT
    while not what():
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.05)


@contextlib.contextmanager
def connected(address):
    with distributed.Client(address, timeout=TIMEOUT, set_as_default=False) as client:
        yield client


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory):
    with Cluster(tmp_path_factory.mktemp("cluster")) as it:
        it.add_worker()
        it.add_worker()
        yield it


@pytest.fixture
def client(two_workers):
    with connected(two_workers.address) as client:
        client.wait_for_workers(2, timeout=TIMEOUT)
        yield client


@pytest.fixture
def lone_scheduler(tmp_path):
    """A scheduler of the test's own, without workers yet."""
    with Cluster(tmp_path) as it:
        yield it


def test_a_closed_client_is_one_sentence_and_nothing_is_written(two_workers, tmp_path):
    with connected(two_workers.address) as closed:
        pass
    for options in ({}, {"store": tmp_path / "map.zarr"}):
        with pytest.raises(jk.ClusterError, match="Client that is closed: connect a new one") as caught:
            jk.sweep(ROBOT, "forward_count", GRID, executor=closed, **options)
        assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def files(store):
    paths = (p for p in sorted(store.rglob("*")) if p.is_file() and p.name != "run_log.jsonl")
    return {str(p.relative_to(store)): p.read_bytes() for p in paths}


class Log:
    """What workers did: lines "what process number", written by them all."""

    def __init__(self, folder):
        self.path = folder / "log_of_tiles"

    def lines(self, what="tile"):
        lines = [line.split() for line in self.path.read_text().splitlines()] if self.path.exists() else []
        return [(int(pid), float(number)) for kind, pid, number in lines if kind == what]


def logged_field(folder, seconds=0.0, failing=None, error=None, times=1):
    """Makes a field that logs what is done where, takes its time, and may fail; no worker can import it."""
    path = str(folder / "log_of_tiles")

    def log(what, number):
        import os

        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.write(handle, f"{what} {os.getpid()} {number}\n".encode())
        os.close(handle)

    def kernel(robot, coordinates):
        log("trace", 0)
        x, y, phi = coordinates
        return (1000 * x + y + phi,)

    def unpack(arrays):
        import time

        number = float(arrays[0].ravel()[0])
        log("tile", number)
        time.sleep(seconds)
        if number == failing:
            log("failure", number)
            with open(path) as file:
                if file.read().count("failure") <= times:
                    raise error
        return arrays

    return jk.Field(
        "height",
        "pose",
        lambda robot: (Variable("height", "float64", "1", "height"),),
        kernel,
        block=lambda robot: 100,
        unpack=unpack,
    )


def plane(field, **options):
    return jk.sweep(ROBOT, field, PLANE, progress=False, **options)


@pytest.fixture
def local(tmp_path):
    """The same sweep in this process: its files, and its dataset."""
    (tmp_path / "here").mkdir()
    data = plane(logged_field(tmp_path / "here"), store=tmp_path / "here" / "map.zarr").load()
    assert len(Log(tmp_path / "here").lines()) == TILES
    return files(tmp_path / "here" / "map.zarr"), data


def worker_pids(client):
    return set(client.run(os.getpid).values())


# -- the same result ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["forward_count", "forward_branches"])
def test_results_are_those_of_one_process_to_the_byte(name, client, tmp_path):
    stored = jk.sweep(ROBOT, name, GRID, store=tmp_path / "many.zarr", executor=client)
    jk.sweep(ROBOT, name, GRID, store=tmp_path / "one.zarr")
    assert files(tmp_path / "many.zarr") == files(tmp_path / "one.zarr")
    held = jk.sweep(ROBOT, name, GRID, executor=client)
    for variable in held.data_vars:
        assert held[variable].values.tobytes() == stored[variable].values.tobytes()
    assert held.attrs["complete"] == stored.attrs["complete"] == 1
    assert "Client" in json.loads(held.attrs["run_log"])["workers"]


def test_tiles_are_shared_and_kernels_compiled_once_a_process(client, tmp_path, local):
    data = plane(logged_field(tmp_path, seconds=0.1), store=tmp_path / "map.zarr", executor=client)
    log = Log(tmp_path)
    assert files(tmp_path / "map.zarr") == local[0]
    assert data.attrs["complete"] == 1
    pids = {pid for pid, _ in log.lines()}
    assert pids == worker_pids(client)
    assert len(pids) == 2
    assert len(log.lines()) == len({number for _, number in log.lines()}) == TILES
    assert sorted(pid for pid, _ in log.lines("trace")) == sorted(pids)


def test_in_memory_tiles_find_their_places(client, tmp_path, local):
    data = plane(logged_field(tmp_path), executor=client)
    xarray.testing.assert_equal(data, local[1])
    assert not {pid for pid, _ in Log(tmp_path).lines()} & {os.getpid()}


def test_a_field_and_a_mechanism_of_ones_own_travel(client, tmp_path):
    offset = 0.25

    @jk.mechanism
    class TwoSliders(jk.Mechanism):
        """Two legs to one point; a class that no worker can import."""

        base: jnp.ndarray
        pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
        joint_axes = (jk.Axis("l1", "length", 0.0), jk.Axis("l2", "length", 0.0))

        def constraints(self, pose, joints):
            x, y = pose
            return jnp.stack([x**2 + y**2 - joints[0] ** 2, (x - self.base) ** 2 + y**2 - joints[1] ** 2])

    def reach(robot, pose):
        return jnp.hypot(pose[0] - robot.base, pose[1]) + offset

    robot = TwoSliders(base=jnp.asarray(1.5))
    field = jk.fields.from_function(reach, name="reach", domain="pose", unit="length")
    grid = jk.Grid(x=(-1.0, 1.0, 70), y=(-1.0, 1.0, 90))
    xarray.testing.assert_equal(jk.sweep(robot, field, grid, executor=client), jk.sweep(robot, field, grid))


# -- faults -------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def meanwhile(what, *arguments):
    """Does something in a thread during a sweep, and fails where it fails."""
    errors = []

    def work():
        try:
            what(*arguments)
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        thread.join(TIMEOUT)
    assert not errors


def test_a_killed_worker_costs_only_its_tiles(client, tmp_path, local):
    log, killed = Log(tmp_path), []

    def kill():
        _wait(lambda: len(log.lines()) >= 5)
        killed.append(log.lines()[-1][0])
        os.kill(killed[0], signal.SIGKILL)

    with meanwhile(kill):
        data = plane(logged_field(tmp_path, seconds=0.3), store=tmp_path / "map.zarr", executor=client)
    assert data.attrs["complete"] == 1
    assert files(tmp_path / "map.zarr") == local[0]
    done = log.lines()
    twice = [number for number in {n for _, n in done} if sum(n == number for _, n in done) > 1]
    # The one that it was at, and at most those that it had done whose sums had not arrived.
    assert 1 <= len(twice) <= 2
    assert {pid for pid, number in done if number in twice} >= set(killed)


def test_a_transient_failure_is_tried_again(client, tmp_path, local):
    number = Log(tmp_path / "here").lines()[5][1]
    field = logged_field(tmp_path, failing=number, error=OSError("the network disk sleeps"), times=3)
    xarray.testing.assert_equal(plane(field, executor=client), local[1])
    assert len(Log(tmp_path).lines("failure")) == 4


@pytest.mark.parametrize(
    ("error", "tries"),
    [(ZeroDivisionError("mine"), 1), (jk.StoreError("full"), 1), (jk.ClusterError("odd"), 1), (OSError("sleeps"), 4)],
    ids=lambda value: type(value).__name__,
)
def test_what_will_never_succeed_fails_at_once_with_the_error_itself(client, tmp_path, local, error, tries):
    number = Log(tmp_path / "here").lines()[5][1]
    field = logged_field(tmp_path, failing=number, error=error, times=99)
    with pytest.raises(type(error), match=str(error)):
        plane(field, store=tmp_path / "map.zarr", executor=client)
    assert len(Log(tmp_path).lines("failure")) == tries
    assert plane(logged_field(tmp_path), store=tmp_path / "map.zarr").attrs["complete"] == 1
    assert files(tmp_path / "map.zarr") == local[0]


def test_ctrl_c_cancels_and_keeps(client, tmp_path, local):
    log = Log(tmp_path)

    def interrupt():
        # The first tiles must have arrived, however busy the machine is: when the eighth begins, six are done.
        _wait(lambda: len(log.lines()) >= 8)
        os.kill(os.getpid(), signal.SIGINT)

    with meanwhile(interrupt), pytest.raises(jk.SweepInterrupted) as caught:
        plane(logged_field(tmp_path, seconds=0.3), store=tmp_path / "map.zarr", executor=client)
    assert 0 < caught.value.samples_done < 1200
    # The scheduler forgets tiles before the workers do that are at them: wait for two seconds in which none begins.
    begun = []

    def rests():
        begun.append((time.monotonic(), len(log.lines())))
        return begun[-1][0] - min(when for when, lines in begun if lines == begun[-1][1]) >= 2

    _wait(rests)
    assert begun[-1][1] < TILES
    assert plane(logged_field(tmp_path), store=tmp_path / "map.zarr", executor=client).attrs["complete"] == 1
    assert files(tmp_path / "map.zarr") == local[0]


def test_a_store_that_is_another_requests_by_now_is_not_written(client, tmp_path):
    # As where the shared disk knows no locks.
    log, store = Log(tmp_path), tmp_path / "map.zarr"

    def replace():
        _wait(lambda: len(log.lines()) >= 3)
        description = json.loads((store / "zarr.json").read_text())
        description["attributes"] |= {"request": "{}", "request_hash": "0"}
        (store / "zarr.json").write_text(json.dumps(description))

    with meanwhile(replace), pytest.raises(jk.JaxkinError) as caught:
        plane(logged_field(tmp_path, seconds=0.3), store=store, executor=client)
    assert "\n" not in str(caught.value)
    assert len(log.lines()) < TILES


# -- clusters that are none ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("executor", [4, "tcp://127.0.0.1:8786", object()])
def test_an_executor_of_a_wrong_kind_is_refused(executor):
    with pytest.raises(jk.InputError, match=r"must be a dask.distributed.Client"):
        jk.sweep(ROBOT, "forward_count", GRID, executor=executor)


def test_no_worker_is_said_and_a_worker_that_joins_late_is_used(lone_scheduler, tmp_path, local, monkeypatch):
    monkeypatch.setattr(cluster, "_PATIENCE", 0.5)
    monkeypatch.setattr(cluster, "_LOOK", 0.2)
    log = Log(tmp_path)
    with connected(lone_scheduler.address) as client:
        with pytest.raises(jk.ClusterError, match="has no workers: start one with 'dask worker tcp://127"):
            plane(logged_field(tmp_path), executor=client)
        assert log.lines() == []
        lone_scheduler.add_worker("--no-nanny")
        client.wait_for_workers(1, timeout=TIMEOUT)

        def join():
            _wait(log.lines)
            lone_scheduler.add_worker("--no-nanny")

        with meanwhile(join):
            data = plane(logged_field(tmp_path, seconds=0.8), executor=client)
    xarray.testing.assert_equal(data, local[1])
    assert len({pid for pid, _ in log.lines()}) == 2


def test_a_worker_of_another_environment_is_refused_in_one_sentence(lone_scheduler, tmp_path):
    lone_scheduler.add_worker("--no-nanny", XLA_FLAGS="--xla_cpu_enable_fast_math=true")
    with connected(lone_scheduler.address) as client, pytest.raises(jk.ClusterError) as caught:
        plane(logged_field(tmp_path), store=tmp_path / "map.zarr", executor=client)
    assert "xla_flags is '' there and '--xla_cpu_enable_fast_math=true' here" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert Log(tmp_path).lines() == []


def test_a_lost_scheduler_is_said_and_its_tiles_are_kept(lone_scheduler, tmp_path, local, monkeypatch):
    log, store = Log(tmp_path), tmp_path / "map.zarr"
    lone_scheduler.add_worker("--no-nanny")

    def kill():
        _wait(lambda: len(log.lines()) >= 4)
        lone_scheduler.scheduler.kill()

    with connected(lone_scheduler.address) as client:
        with meanwhile(kill), pytest.raises(jk.ClusterError, match="The scheduler is lost") as caught:
            plane(logged_field(tmp_path, seconds=0.3), store=store, executor=client)
        assert "\n" not in str(caught.value)
    kept = (store / "height" / "tiles.journal").read_text().splitlines()
    assert 1 <= len(kept) < TILES
    before = len(log.lines())
    assert plane(logged_field(tmp_path), store=store).attrs["complete"] == 1
    assert len(log.lines()) - before == TILES - len(kept)
    assert files(store) == local[0]


@pytest.mark.slow
def test_a_tile_that_kills_every_worker_ends_the_sweep(lone_scheduler, tmp_path):
    lone_scheduler.add_worker()

    def kernel(robot, coordinates):
        import os
        import signal

        os.kill(os.getpid(), signal.SIGKILL)
        return (coordinates[0],)

    field = jk.Field("x_again", "pose", lambda robot: (Variable("x_again", "float64", "1", "x"),), kernel)
    with (
        connected(lone_scheduler.address) as client,
        pytest.raises(jk.ClusterError, match=r"was on \d workers") as caught,
    ):
        jk.sweep(ROBOT, field, PLANE, executor=client)
    assert "\n" not in str(caught.value)


def test_nothing_to_do_asks_no_cluster(tmp_path, local):
    class Nobody:
        """Has what a client has, and can do nothing."""

        submit = nthreads = wait_for_workers = None

    data = plane(logged_field(tmp_path), store=tmp_path / "here" / "map.zarr", executor=Nobody())
    np.testing.assert_array_equal(data.height, local[1].height)
