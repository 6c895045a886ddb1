"""Tiles on this machine: threads that run compiled blocks side by side; JAX and NumPy let go of the interpreter."""

import concurrent.futures
import contextlib
import os
import queue
import threading
from collections.abc import Callable, Iterable, Iterator

#: Seconds between two looks at what the threads have done.
_NAP = 0.1


def cores() -> int:
    """Returns how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_in_threads(work: Callable[[int], None], numbers: Iterable[int], workers: int) -> Iterator[int]:
    """Does the work of every number, and yields it when it is done.

    What is under way is finished, and counted by ``work``, where the consumer or one of the others fails.
    """
    stop, taking, left = threading.Event(), threading.Lock(), iter(numbers)
    done: queue.SimpleQueue[int] = queue.SimpleQueue()

    def loop() -> None:
        while not stop.is_set():
            with taking:
                number = next(left, None)
            if number is None:
                return
            work(number)
            done.put(number)

    pool = concurrent.futures.ThreadPoolExecutor(workers, thread_name_prefix="jaxkin-sweep")
    loops = {pool.submit(loop) for _ in range(workers)}
    running = loops
    try:
        while running:
            # A wait with a timeout lets Ctrl-C through. Waking up for every number would slow down those who work.
            over, running = concurrent.futures.wait(loops, _NAP, concurrent.futures.FIRST_EXCEPTION)
            with contextlib.suppress(queue.Empty):
                while True:
                    yield done.get_nowait()
            for each in over:
                each.result()
    finally:
        stop.set()
        _wait_for_all(loops)
        pool.shutdown()


def _wait_for_all(futures: set[concurrent.futures.Future]) -> None:
    """Waits for what is under way, through a second Ctrl-C too: a store must not be let go while it is written."""
    # Not by joining threads, which Python 3.11 takes for dead after a Ctrl-C (https://bugs.python.org/issue45274).
    while futures:
        try:
            futures = concurrent.futures.wait(futures, 0.2).not_done
        except KeyboardInterrupt:
            continue
