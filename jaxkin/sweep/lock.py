"""The place of a store, which one process has at a time; and who looks whether somebody has it."""

import contextlib
import os
import time
from pathlib import Path

import filelock

from jaxkin.core.errors import StoreError
from jaxkin.core.words import given

try:
    import fcntl
except ImportError:  # Windows.
    fcntl = None

#: How often a lock is tried that others let go of at the same moment, and seconds between two tries.
_TRIES, _NAP = 5, 0.01


def aside(path: Path, what: str) -> Path:
    """Returns the place beside a store of what helps to make it."""
    return path.with_name(f".{path.name}.jaxkin-{what}")


def locked(path: Path) -> filelock.BaseFileLock:
    """Takes the place of a store for this process; the system gives it back when the process dies, however it dies.

    The file lies beside the store, so that a store can be made and replaced under it.

    Raises:
        StoreError: Another process has it.
    """
    file = aside(path, "lock")
    for _ in range(_TRIES):
        lock = filelock.FileLock(file, timeout=0)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file.touch()
            before = file.stat()
            lock.acquire()
            if os.path.samestat(before, file.stat()):
                return lock
        except filelock.Timeout:
            # Whoever only looks, as ``being_written`` does, has let go of it by then.
            time.sleep(_NAP)
            continue
        except FileNotFoundError as error:
            if not path.parent.is_dir():
                raise not_writable(path, error) from error
        except OSError as error:
            raise not_writable(path, error) from error
        # Whoever had it removed the file when this process had it open already: this lock keeps nobody out.
        lock.release()
    raise taken(path)


def let_go(lock: filelock.BaseFileLock) -> None:
    """Gives a place back, and removes the file while nobody else can have it."""
    with contextlib.suppress(OSError):  # Windows removes no open file; it stays, and does no harm.
        os.unlink(lock.lock_file)
    lock.release()


def being_written(path: Path) -> bool:
    """Tells whether a process has the place of a store; a file that a dead process left says nothing."""
    file = aside(path.resolve() if path.is_symlink() else path, "lock")
    if fcntl is None:
        return _taken_by_trying(file)
    try:
        # Open for reading alone, as a store may be another user's; and shared, so that two who look see nobody.
        with open(file, "rb") as opened:
            fcntl.flock(opened, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _taken_by_trying(file: Path) -> bool:
    if not file.exists():
        return False
    lock = filelock.FileLock(file, timeout=0)
    try:
        lock.acquire()
    except (filelock.Timeout, OSError):
        return True
    lock.release()
    return False


def taken(path: Path) -> StoreError:
    """Returns what is told to the second of two processes."""
    return StoreError(
        f"{path} is being written by another process: wait for it, then run the same request again, or choose another "
        "store."
    )


def not_writable(path: Path, error: OSError) -> StoreError:
    """Returns what is told where a store cannot be made."""
    return StoreError(
        f"{path} cannot be written ({error.strerror or error}): choose a folder that you may write, on a disk with "
        f"space. What is there is read by {given('jk.open_store')}."
    )
