"""Zarr stores: written tile by tile, continued by the same request only, trusted where checksums agree."""

import contextlib
import errno
import json
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import filelock
import numpy as np
import zarr

from jaxkin.core.errors import StoreError
from jaxkin.core.provenance import Request
from jaxkin.sweep import result
from jaxkin.sweep.journal import Journal, checksum
from jaxkin.sweep.manifest import (
    JOURNAL,
    LOCK,
    RUN_LOG,
    Manifest,
    beside,
    check_environment,
    check_layout,
    lay_out,
    read_manifest,
    tile_file,
)
from jaxkin.sweep.plan import Plan, extent

#: What Zarr leaves of a file that it did not finish.
_TORN = "*.partial"


class TileWriter:
    """Writes tiles into a store that exists; on any machine that sees the store's folder, and as many at once as like.

    Args:
        path: The store.
        plan: Its plan.
    """

    def __init__(self, path: Path, plan: Plan):
        self.path, self._plan = path, plan
        self._arrays = {v.name: zarr.open_array(path / v.name, mode="r+") for v in plan.variables}

    def write(self, number: int, arrays: dict[str, np.ndarray]) -> list[str]:
        """Writes one tile; returns the checksum of each of its files.

        Raises:
            StoreError: It cannot be written; nothing of the tile counts then.
        """
        box, files = self._plan.box(number), self.files(number)
        with storage_errors(self.path):
            for (name, values), file in zip(arrays.items(), files, strict=True):
                # What is there may be damaged, and Zarr would read it where a tile is cut off by the grid's edge.
                file.unlink(missing_ok=True)
                self._arrays[name][(..., *box)] = values
            return [checksum(file) for file in files]

    def files(self, number: int) -> list[Path]:
        """Returns the file of a tile in each variable."""
        place = np.unravel_index(number, self._plan.counts)
        return [tile_file(self.path, v.name, len(v.lead), place) for v in self._plan.variables]


class Store:
    """One store, and the right to write into it; use ``Store.open``, and ``close``."""

    def __init__(self, path: Path, plan: Plan, lock: filelock.BaseFileLock):
        self.path, self._plan, self._lock = path, plan, lock
        self.writer = TileWriter(path, plan)
        self._journal = Journal(path / plan.field.name / JOURNAL, plan.tiles, self.writer.files)
        self._journalling = threading.Lock()
        with storage_errors(path):
            for variable in plan.variables:
                for torn in (path / variable.name).rglob(_TORN):
                    torn.unlink(missing_ok=True)
            #: Tiles that were journalled and whose data has changed or gone since.
            self.damaged = self._journal.damaged()
            # Rewritten in order: a torn last line must not swallow the next one.
            self._journal.forget(self.damaged)
        self.done = self._journal.done()

    @classmethod
    def open(cls, path: Path, request: Request, plan: Plan, attrs: dict[str, Any], *, overwrite: bool) -> "Store":
        """Opens the store of a request, or makes it.

        Args:
            path: Its folder.
            request: What determines the numbers.
            plan: How they are cut.
            attrs: Further attributes of the result.
            overwrite: Replaces a jaxkin store, whatever request made it.

        Raises:
            StoreError: The path holds something else, another request's store, one that another process writes, one
                begun by another version, or it cannot be written.
        """
        if path.exists() and not _is_empty_folder(path):
            manifest = read_manifest(path)
            lock = _locked(path, manifest.field)
            if not overwrite:
                return cls._continued(path, request, plan, manifest, lock)
            old = path.with_name(f".{path.name}.{os.getpid()}.old")
            with storage_errors(path):
                os.rename(path, old)
                shutil.rmtree(old)
            lock.release()
        # Made aside and renamed, so that a store that exists is whole.
        aside = path.with_name(f".{path.name}.{os.getpid()}.new")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            lay_out(aside, request, plan, attrs)
            os.replace(aside, path)
        except OSError as error:
            if (path / "zarr.json").exists():
                remedy = "another process made it meanwhile; wait for it, then run the same request again"
            else:
                remedy = "choose a folder that you may write, on a disk with space"
            raise StoreError(f"{path} cannot be written ({error.strerror or error}): {remedy}.") from error
        finally:
            shutil.rmtree(aside, ignore_errors=True)
        return cls(path, plan, _locked(path, plan.field.name))

    @classmethod
    def _continued(
        cls, path: Path, request: Request, plan: Plan, manifest: Manifest, lock: filelock.BaseFileLock
    ) -> "Store":
        try:
            if manifest.request != json.loads(request.text):
                raise StoreError(
                    f"{path} was made by another request ({request.difference(manifest.request)}): choose another "
                    "store, or replace it with overwrite=True (--force)."
                )
            check_layout(path, plan, manifest)
            store = cls(path, plan, lock)
            if not store.done.all():
                check_environment(path, manifest)
            return store
        except BaseException:
            lock.release()
            raise

    def room(self, number: int) -> dict[str, np.ndarray]:
        """Returns where a tile is to be computed before it is written."""
        return result.allocate(self._plan.variables, extent(self._plan.box(number)))

    def keep(self, number: int, arrays: dict[str, np.ndarray]) -> None:
        """Writes one tile, and journals it."""
        self.record(number, self.writer.write(number, arrays))

    def record(self, number: int, sums: list[str]) -> None:
        """Journals a tile that was written, here or elsewhere.

        Raises:
            StoreError: The journal cannot be written.
        """
        with self._journalling, storage_errors(self.path):
            self._journal.add(number, sums)
            self.done[number] = True

    def close(self, log: dict[str, Any] | None) -> None:
        """Puts the journal in order, appends a log of this run, if any, and lets others write."""
        try:
            if log is not None:
                with storage_errors(self.path), open(beside(self.path, self._plan.field.name, RUN_LOG), "a") as file:
                    self._journal.settle()
                    file.write(json.dumps(log) + "\n")
        finally:
            self._lock.release()


@contextlib.contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Turns what a disk has to say into one sentence with a remedy."""
    try:
        yield
    except OSError as error:
        if isinstance(error, StoreError):
            raise
        full = error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
        remedy = "free space" if full else "see to the disk or the folder's rights"
        raise StoreError(
            f"{path} cannot be written ({error.strerror or error}): {remedy}, then run the same request again; the "
            "tiles that are whole are kept."
        ) from error


def _locked(path: Path, field: str) -> filelock.BaseFileLock:
    """Takes the store for this process; the system gives it back when the process dies, however it dies.

    Raises:
        StoreError: Another process has it.
    """
    (path / field).mkdir(exist_ok=True)
    lock = filelock.FileLock(beside(path, field, LOCK), timeout=0)
    try:
        lock.acquire()
    except filelock.Timeout:
        raise StoreError(
            f"{path} is being written by another process: wait for it, then run the same request again, or choose "
            "another store."
        ) from None
    except OSError as error:
        raise StoreError(f"{path} cannot be written ({error.strerror}): choose a folder that you may write.") from error
    return lock


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())
