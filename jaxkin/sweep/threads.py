"""Tiles on this machine: threads that run compiled blocks side by side; JAX and NumPy let go of the interpreter."""

import concurrent.futures
import itertools
import os
import threading
from collections.abc import Callable, Iterable, Iterator


def cores() -> int:
    """Returns how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_in_threads(work: Callable[[int], None], numbers: Iterable[int], workers: int) -> Iterator[int]:
    """Does the work of every number, and yields it when it is done.

    What is under way is finished, and counted by ``work``, where the consumer or one of the others fails.
    """
    stop = threading.Event()

    def unless_stopped(number: int) -> int | None:
        if stop.is_set():
            return None
        work(number)
        return number

    queue = iter(numbers)
    pool = concurrent.futures.ThreadPoolExecutor(workers, thread_name_prefix="jaxkin-sweep")
    # Few wait, so that a list of millions of tiles costs nothing.
    under_way = {pool.submit(unless_stopped, number) for number in itertools.islice(queue, 2 * workers)}
    try:
        while under_way:
            # A wait with a timeout lets Ctrl-C through.
            done, under_way = concurrent.futures.wait(under_way, 0.2, concurrent.futures.FIRST_COMPLETED)
            for future in done:
                number = future.result()
                under_way |= {pool.submit(unless_stopped, more) for more in itertools.islice(queue, 1)}
                if number is not None:
                    yield number
    finally:
        stop.set()
        _wait_for_all(under_way)
        pool.shutdown()


def _wait_for_all(futures: set[concurrent.futures.Future]) -> None:
    """Waits for what is under way, through a second Ctrl-C too: a store must not be let go while it is written."""
    # Not by joining threads, which Python 3.11 takes for dead after a Ctrl-C (https://bugs.python.org/issue45274).
    while futures:
        try:
            futures = concurrent.futures.wait(futures, 0.2).not_done
        except KeyboardInterrupt:
            continue
