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
from jaxkin.core.words import given
from jaxkin.sweep import result
from jaxkin.sweep.coordinates import mend_coordinates
from jaxkin.sweep.journal import Journal, checksum
from jaxkin.sweep.lock import aside, being_written, let_go, locked, not_writable, taken
from jaxkin.sweep.manifest import (
    JOURNAL,
    RUN_LOG,
    Manifest,
    beside,
    check_environment,
    check_layout,
    check_request,
    lay_out,
    read_manifest,
    tile_file,
)
from jaxkin.sweep.plan import Plan, extent, tile_place
from jaxkin.sweep.progress import Progress
from jaxkin.sweep.stored import journal_of

#: What Zarr leaves of a file that it did not finish.
_TORN = f"*.{'[0-9a-f]' * 32}.partial"


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
        place = tile_place(number, self._plan.counts)
        return [tile_file(self.path, v.name, len(v.lead), place) for v in self._plan.variables]


class Store:
    """One store, and the right to write into it; use ``Store.open``, and ``close``."""

    def __init__(self, path: Path, plan: Plan, lock: filelock.BaseFileLock, show: bool | None = None):
        self.path, self._plan, self._lock = path, plan, lock
        self.writer = TileWriter(path, plan)
        self._journalling = threading.Lock()
        with storage_errors(path), Progress(plan.grid.size, "checking what is there", show=show) as bar:
            self._journal = Journal(path / plan.field.name / JOURNAL, plan.tiles, self.writer.files)
            #: Tiles that were journalled and whose data has changed or gone since.
            self.damaged = self._journal.damaged(lambda number: bar.add(plan.samples(number)))
        self.done = self._journal.done()
        self.done[self.damaged] = False
        #: Axes whose coordinates were damaged, and are written anew.
        self.mended: list[str] = []

    @classmethod
    def open(
        cls,
        path: Path,
        request: Request,
        plan: Plan,
        attrs: dict[str, Any],
        *,
        overwrite: bool,
        show: bool | None = None,
    ) -> "Store":
        """Opens the store of a request, or makes it.

        Args:
            path: Its folder.
            request: What determines the numbers.
            plan: How they are cut.
            attrs: Further attributes of the result.
            overwrite: Replaces a jaxkin store, whatever request made it.
            show: Whether a progress bar shows how much of what is there was checked; as in ``Progress``.

        Raises:
            StoreError: The path holds something else, another request's store, one that another process writes, one
                begun by another version, or it cannot be written.
        """
        # The folder itself is moved where it is replaced, not a link to it.
        path = path.resolve() if path.is_symlink() else path
        _check_ours(path)
        lock = locked(path)
        try:
            _mend_swap(path)
            # Only now, since another process may have replaced it until the lock was ours.
            there = _check_ours(path)
            if there is None or overwrite:
                _make(path, request, plan, attrs)
                return cls(path, plan, lock)
            _check_same(path, request, plan, there)
            store = cls(path, plan, lock, show)
            if not store.done.all():
                check_environment(path, there)
            # Nothing was changed until here, where the store is surely this request's.
            store._tidy()
            return store
        except BaseException:
            let_go(lock)
            raise

    def _tidy(self) -> None:
        """Removes what an earlier process left, mends coordinates, and takes damaged tiles out of the journal."""
        with storage_errors(self.path):
            self.mended = mend_coordinates(self.path, self._plan.grid)
            for variable in self._plan.variables:
                for torn in (self.path / variable.name).rglob(_TORN):
                    torn.unlink(missing_ok=True)
            # Rewritten in order: a torn last line must not swallow the next one.
            self._journal.forget(self.damaged)

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

    def values(self, name: str) -> np.ndarray:
        """Returns what there is of a variable."""
        return np.asarray(zarr.open_array(self.path / name, mode="r")[...])

    def describe(self, attrs: dict[str, Any]) -> None:
        """Adds attributes to the result.

        Raises:
            StoreError: They cannot be written.
        """
        with storage_errors(self.path):
            group = zarr.open_group(self.path, mode="r+")
            if any(group.attrs.get(name) != value for name, value in attrs.items()):
                group.attrs.update(attrs)

    def close(self, log: dict[str, Any] | None) -> None:
        """Puts the journal in order, appends a log of this run, if any, and lets others write."""
        try:
            if log is not None:
                with self._journalling, storage_errors(self.path):
                    self._journal.settle()
                    with open(beside(self.path, self._plan.field.name, RUN_LOG), "a") as file:
                        file.write(json.dumps(log) + "\n")
        finally:
            let_go(self._lock)


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
        told = StoreError(
            f"{path} cannot be written ({error.strerror or error}): {remedy}, then run the same request again; the "
            "tiles that are whole are kept."
        )
        told.may_pass = not full
        raise told from error


def check_store(path: Path, request: Request, plan: Plan, overwrite: bool) -> None:
    """Makes the checks of ``Store.open`` that can be made without reading tiles; changes nothing.

    Raises:
        StoreError: As from ``Store.open``.
    """
    path = path.resolve() if path.is_symlink() else path
    there = _check_ours(path)
    if being_written(path):
        raise taken(path)
    if there is not None and not overwrite:
        _check_same(path, request, plan, there)
        if len(journal_of(path, there)) < there.tiles:
            check_environment(path, there)
    # The lock, and a store that replaces another, are made beside it.
    needed = (path.absolute().parent, path) if path.is_dir() else (path.absolute().parent,)
    for folder in needed:
        there_is = next(place for place in (folder, *folder.parents) if place.exists())
        if not there_is.is_dir():
            raise not_writable(path, NotADirectoryError(errno.ENOTDIR, f"{there_is} is no folder"))
        if not os.access(there_is, os.W_OK | os.X_OK):
            raise not_writable(path, PermissionError(errno.EACCES, f"no right to write in {there_is}"))


def _check_same(path: Path, request: Request, plan: Plan, there: Manifest) -> None:
    check_request(path, request, there)
    check_layout(path, plan, there)


def _check_ours(path: Path) -> Manifest | None:
    """Returns what the store at a path says of itself, None where nothing is in the way of a new one.

    Raises:
        StoreError: Something else is there.
    """
    remedy = (
        f"move it away or choose another path; jaxkin replaces only stores of its own, with {given('overwrite=True')}"
    )
    return read_manifest(path, remedy) if os.path.lexists(path) and not _is_empty_folder(path) else None


def _make(path: Path, request: Request, plan: Plan, attrs: dict[str, Any]) -> None:
    """Puts an empty store where there is none, or in the place of another.

    Raises:
        StoreError: It cannot be written; what was there is there still.
    """
    new, old = aside(path, "new"), aside(path, "old")
    try:
        lay_out(new, request, plan, attrs)
        # A kill between the two moves leaves the old one aside, from where ``_mend_swap`` takes it back.
        if path.exists():
            os.rename(path, old)
        os.rename(new, path)
    except OSError as error:
        raise not_writable(path, error) from error
    finally:
        _mend_swap(path)


def _mend_swap(path: Path) -> None:
    """Ends what ``_make`` began, here or in a process that was killed: a store is laid out whole, or never was.

    Only whoever has the lock makes folders of these names, so that whatever is found is a dead process's.
    """
    new, old = aside(path, "new"), aside(path, "old")
    if old.exists() and not path.exists():
        with contextlib.suppress(OSError):
            os.rename(old, path)
    for folder in (new, old):
        shutil.rmtree(folder, ignore_errors=True)


def _is_empty_folder(path: Path) -> bool:
    return path.is_dir() and not any(path.iterdir())
