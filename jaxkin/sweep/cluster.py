"""Tiles on many machines: futures of ``dask.distributed``; workers write their tiles, this process journals them."""

import concurrent.futures
import contextlib
import functools
import itertools
import pickle
import queue
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np

from jaxkin.core.errors import ClusterError, InputError, StoreError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.precision import enable_x64
from jaxkin.core.provenance import Request, difference, environment
from jaxkin.sweep import result
from jaxkin.sweep.manifest import read_manifest
from jaxkin.sweep.memory import Memory
from jaxkin.sweep.plan import Plan, extent
from jaxkin.sweep.store import Store, TileWriter
from jaxkin.sweep.tiler import Tiler
from jaxkin.sweep.units import counted

#: How often a tile is tried again that failed by what may pass; the scheduler itself sends those of dead workers on.
_RETRIES = 3
#: What may pass: a network disk that does not answer, a machine short of memory.
_MAY_PASS = (OSError, MemoryError, jax.errors.JaxRuntimeError)
#: Tiles that wait at the scheduler for each thread of the cluster, so that none is idle while results travel.
_AHEAD = 3
#: Seconds between two looks at how many threads the cluster has.
_LOOK = 5.0
#: Seconds in which a first worker has to appear.
_PATIENCE = 20.0


@dataclass(frozen=True)
class Recipe:
    """What a worker needs to know, sent with every tile and read once by each process.

    Attributes:
        robot: The mechanism.
        plan: How the request is cut.
        request_hash: Of what determines the numbers.
        environment: What decides about last digits, where the sweep was begun.
        store: Where tiles are written; None sends them back.
    """

    robot: Mechanism
    plan: Plan
    request_hash: str
    environment: dict[str, Any]
    store: Path | None


def check_open(client: Any) -> None:
    """Refuses a client that is closed, before anything is written.

    Raises:
        ClusterError: It is closed.
    """
    # Nothing else is asked of it yet: where nothing is left to do, no cluster is needed.
    if getattr(client, "status", None) in ("closing", "closed"):
        raise ClusterError(
            f"executor is a dask.distributed.Client that is {client.status}: connect a new one to the scheduler, and "
            "pass it while it is open."
        )


def run_on_cluster(
    client: Any, robot: Mechanism, plan: Plan, request: Request, keeper: Memory | Store, numbers: list[int]
) -> Iterator[int]:
    """Does the tiles of these numbers on a cluster, and yields each when it is kept.

    Raises:
        InputError: The executor is no client of ``dask.distributed``.
        ClusterError: There are no workers, they have other versions, or the scheduler is lost.
        StoreError: A worker cannot write.
    """
    for need in ("submit", "nthreads", "wait_for_workers"):
        if not hasattr(client, need):
            raise InputError(
                f"executor is {type(client).__name__}: it must be a dask.distributed.Client (pip install "
                "'jaxkin[scale]'), or None for threads of this process."
            )
    return _tiles(client, robot, plan, request, keeper, numbers)


def _tiles(
    client: Any, robot: Mechanism, plan: Plan, request: Request, keeper: Memory | Store, numbers: list[int]
) -> Iterator[int]:
    import cloudpickle

    _wait_for_worker(client)
    store = None if keeper.path is None else keeper.path.absolute()
    recipe = cloudpickle.dumps(Recipe(robot, plan, request.hash, environment(), store))
    name = f"jaxkin-{plan.field.name}-{time.time_ns()}"
    under_way: dict[Any, int] = {}
    failures: dict[int, int] = {}
    finished: queue.Queue[Any] = queue.Queue()
    left, looked = iter(numbers), time.monotonic()

    def send(some: Iterable[int]) -> None:
        for number in some:
            # A key that was used before would bring back what it brought then.
            key = f"{name}-{number}-{failures.get(number, 0)}"
            # Not dask's own retries: they know no failure that will never pass.
            future = client.submit(_compute_tile, recipe, number, key=key, pure=False, retries=0)
            under_way[future] = number
            future.add_done_callback(finished.put)

    try:
        send(itertools.islice(left, _room(client)))
        while under_way:
            future = _next(finished, client)
            number = under_way.pop(future)
            try:
                _keep(future, number, keeper)
            except _MAY_PASS as error:
                failures[number] = failures.get(number, 0) + 1
                if failures[number] > _RETRIES or not _may_pass(error):
                    raise
                send([number])
                continue
            wanted = 1
            if time.monotonic() - looked > _LOOK:  # Workers come and go.
                wanted, looked = max(0, _room(client) - len(under_way)), time.monotonic()
            send(itertools.islice(left, wanted))
            yield number
    finally:
        if under_way and client.status == "running":
            client.cancel(list(under_way), force=True)


def _may_pass(error: BaseException) -> bool:
    """Tells whether a failure is worth another try: not a lost scheduler, a wrong worker, or a disk that is full."""
    return error.may_pass if isinstance(error, StoreError) else not isinstance(error, ClusterError)


def _wait_for_worker(client: Any) -> None:
    try:
        client.wait_for_workers(1, timeout=_PATIENCE)
    except TimeoutError:
        address = client.scheduler.address if client.scheduler else "?"
        raise ClusterError(
            f"The scheduler at {address} has no workers: start one with 'dask worker {address}'."
        ) from None


def _room(client: Any) -> int:
    """Returns how many tiles may be under way."""
    return max(4, _AHEAD * sum(client.nthreads().values()))


def _next(finished: "queue.Queue[Any]", client: Any) -> Any:
    """Waits for a future; a wait with a timeout lets Ctrl-C through, and sees where the scheduler is gone for good."""
    while True:
        try:
            return finished.get(timeout=0.2)
        except queue.Empty:
            if client.status not in ("running", "connecting"):
                raise _lost(f"the client is {client.status}") from None


def _lost(how: str) -> ClusterError:
    return ClusterError(
        f"The scheduler is lost ({how}): start it and its workers anew, then run the same request again; where there "
        "is a store, its whole tiles are kept."
    )


def _keep(future: Any, number: int, keeper: Memory | Store) -> None:
    """Takes over what a worker did, or says what happened to it."""
    import distributed
    from distributed.comm.core import CommClosedError

    try:
        outcome = future.result(timeout=60)
    except (concurrent.futures.CancelledError, CommClosedError, TimeoutError) as error:
        raise _lost(f"tile {number}: {type(error).__name__}") from error
    except distributed.KilledWorker as error:
        workers = error.allowed_failures + 1
        died = f"{counted(workers, 'worker')} when {'it' if workers == 1 else 'they'} died"
        raise ClusterError(
            f"Tile {number} was on {died}, perhaps of too little memory: give more, then run the same request again; "
            "where there is a store, its whole tiles are kept."
        ) from error
    if isinstance(keeper, Store):
        keeper.record(number, outcome)
        return
    room = keeper.room(number)
    for variable, values in outcome.items():
        room[variable][...] = values
    keeper.keep(number, room)


def _compute_tile(recipe: bytes, number: int) -> list[str] | dict[str, np.ndarray]:
    """Computes a tile in a worker: writes it and returns its checksums, or returns its arrays."""
    known, tiler, writer = _prepared(recipe)
    box = known.plan.box(number)
    arrays = result.allocate(known.plan.variables, extent(box))
    tiler.compute(box, arrays)
    if writer is None:
        return arrays
    assert known.store is not None
    if read_manifest(known.store).attrs["request_hash"] != known.request_hash:
        raise ClusterError(f"{known.store} is another request's by now: nothing of this one was written.")
    return writer.write(number, arrays)


def _prepared(recipe: bytes) -> tuple[Recipe, Tiler, TileWriter | None]:
    """Returns what a recipe says, read once a process, so that its kernel is compiled once.

    Raises:
        ClusterError: This worker would round otherwise, or does not see the store.
    """
    with _preparing:  # The first tiles come at the same moment, one for each thread.
        return _read(recipe)


_preparing = threading.Lock()


@functools.lru_cache(maxsize=4)
def _read(recipe: bytes) -> tuple[Recipe, Tiler, TileWriter | None]:
    enable_x64()
    known: Recipe = _unpickled(recipe)
    here = environment()
    if here != known.environment:
        raise ClusterError(
            f"A worker would round otherwise than where the sweep was begun: {difference(here, known.environment)}; "
            "give all of them the same."
        )
    if known.store is not None and not known.store.is_dir():
        raise ClusterError(f"A worker does not see {known.store}: choose a folder that all machines share.")
    writer = None if known.store is None else TileWriter(known.store, known.plan)
    return known, Tiler(known.robot, known.plan), writer


def _unpickled(recipe: bytes) -> Recipe:
    known = pickle.loads(recipe)
    # Registered when its module was imported; but a class of the user's own script travels by value, and was not.
    with contextlib.suppress(ValueError):
        jax.tree_util.register_dataclass(type(known.robot))
    return known
