"""What a store holds, and whether it still holds what was written."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from jaxkin.core.provenance import difference, environment
from jaxkin.sweep.coordinates import damaged_coordinates
from jaxkin.sweep.lock import being_written
from jaxkin.sweep.manifest import damaged_store, read_manifest
from jaxkin.sweep.stored import journal_of, run_logs
from jaxkin.sweep.threads import cores
from jaxkin.sweep.units import bytes_text, counted, grid_text


@dataclass(frozen=True)
class StoreInfo:
    """What a store says of itself.

    Attributes:
        path: Its folder.
        request: What determines its numbers: mechanism, geometry, field, grid, tolerances, versions.
        request_hash: SHA-256 of the request.
        environment: What besides decides about last digits.
        samples: Samples in all.
        tiles: Tiles in all.
        tiles_done: Tiles that are whole, as the journal says.
        raw_bytes: Bytes of the whole result.
        stored_bytes: Bytes on the disk.
        runs: Logs of the runs that wrote it, oldest first.
        writing: True where a sweep is writing to it.
    """

    path: str
    request: dict[str, Any]
    request_hash: str
    environment: dict[str, Any]
    samples: int
    tiles: int
    tiles_done: int
    raw_bytes: int
    stored_bytes: int
    runs: list[dict[str, Any]]
    writing: bool = False

    @property
    def complete(self) -> bool:
        """True where no tile is missing."""
        return self.tiles_done == self.tiles

    def to_json(self) -> dict[str, Any]:
        """Returns all of it, for programs."""
        return {**asdict(self), "complete": self.complete}

    def __str__(self) -> str:
        """A few lines for a person."""
        geometry = ", ".join(f"{name}={value}" for name, value in self.request["geometry"].items())
        seconds = sum(run.get("seconds", 0) for run in self.runs)
        differs = difference(environment(), self.environment)
        lines = [
            f"{self.path}: {self.request['field']['name']} of {self.request['mechanism']}",
            f"  geometry    {geometry}",
            f"  grid        {grid_text(self.request['grid'])}",
            f"  samples     {self.samples:,}, {self.tiles_done:,} of {counted(self.tiles, 'tile')} whole"
            + self._goes_on(),
            f"  size        {bytes_text(self.stored_bytes)} on the disk, {bytes_text(self.raw_bytes)} uncompressed",
            f"  runs        {len(self.runs)}, {seconds:.4g} s in all",
            f"  request     {self.request_hash}",
        ]
        if differs != "nothing differs":
            lines.append(f"  begun with  other versions: {differs}")
        return "\n".join(lines)

    def _goes_on(self) -> str:
        if self.complete:
            return ""
        return ": a sweep is writing to it right now" if self.writing else ": the same request goes on"


@dataclass(frozen=True)
class StoreCheck:
    """Whether a store holds what was written.

    Attributes:
        path: Its folder.
        tiles: Tiles in all.
        tiles_done: Tiles that the journal says are whole.
        damaged: Numbers of those whose files are not what was written.
        damaged_coordinates: Axes whose coordinates are not those of the request.
        writing: True where a sweep was writing to it when it was looked at; what is missing is no loss then.
    """

    path: str
    tiles: int
    tiles_done: int
    damaged: list[int]
    damaged_coordinates: list[str] = field(default_factory=list)
    writing: bool = False

    @property
    def ok(self) -> bool:
        """True where the store is complete and undamaged."""
        return self.tiles_done == self.tiles and not self.damaged and not self.damaged_coordinates

    def to_json(self) -> dict[str, Any]:
        """Returns all of it, for programs."""
        return {**asdict(self), "ok": self.ok}

    def __str__(self) -> str:
        """One line for a person, with a remedy."""
        if self.ok:
            whole = "its one tile is as it was" if self.tiles == 1 else f"all {self.tiles:,} tiles are as they were"
            return f"{self.path}: {whole} written"
        parts = [*self._damage(), *self._missing()]
        what = f"{self.path}: {' and '.join(parts)}"
        if not self.writing:
            return f"{what}; the same request makes them anew"
        when_done = ", and the same request makes anew what is damaged" if self._damage() else ""
        return f"{what}; a sweep is writing to it right now: verify it when that is done{when_done}"

    def _damage(self) -> list[str]:
        parts = []
        if self.damaged:
            some = ", ".join(map(str, self.damaged[:10])) + (", ..." if len(self.damaged) > 10 else "")
            are = "is" if len(self.damaged) == 1 else "are"
            parts.append(f"{len(self.damaged)} of {counted(self.tiles_done, 'tile')} {are} damaged ({some})")
        if self.damaged_coordinates:
            parts.append(f"the coordinates of {', '.join(self.damaged_coordinates)} are damaged")
        return parts

    def _missing(self) -> list[str]:
        missing = self.tiles - self.tiles_done
        if not missing:
            return []
        are, yet = "is" if missing == 1 else "are", "not written yet" if self.writing else "missing"
        return [f"{missing:,} of {counted(self.tiles, 'tile')} {are} {yet}"]


def describe_store(path: str | Path) -> StoreInfo:
    """Tells what a store says of itself, without reading its data.

    Raises:
        StoreError: There is no jaxkin store at this path, or its description is damaged.
    """
    path = Path(path)
    # Before the journal is read: what a sweep ends meanwhile is not called missing.
    writing = being_written(path)
    manifest = read_manifest(path)
    try:
        arrays = [zarr.open_array(path / name, mode="r") for name in manifest.variables]
        done = len(journal_of(path, manifest))
    except Exception as error:
        raise damaged_store(path, error) from error
    grid = arrays[0].shape[arrays[0].ndim - len(manifest.layout["tile"]) :]
    return StoreInfo(
        path=str(path),
        request=manifest.request,
        request_hash=manifest.attrs["request_hash"],
        environment=manifest.environment,
        samples=int(np.prod(grid, dtype=np.int64)),
        tiles=manifest.tiles,
        tiles_done=done,
        raw_bytes=sum(array.nbytes for array in arrays),
        stored_bytes=sum(map(_size, path.rglob("*"))),
        runs=run_logs(path, manifest),
        writing=writing,
    )


def verify_store(path: str | Path) -> StoreCheck:
    """Reads every tile of a store, and compares it with the checksum that was taken when it was written.

    Changes nothing: the same request makes anew what is damaged, coordinates too. While a sweep writes to the store,
    the answer says so, and holds for the tiles that were written until then.

    Raises:
        StoreError: There is no jaxkin store at this path, or its description is damaged.
    """
    path = Path(path)
    writing = being_written(path)
    manifest = read_manifest(path)
    try:
        journal = journal_of(path, manifest)
    except Exception as error:
        raise damaged_store(path, error) from error
    return StoreCheck(
        path=str(path),
        tiles=manifest.tiles,
        tiles_done=len(journal),
        damaged=journal.damaged(workers=cores()),
        damaged_coordinates=damaged_coordinates(path, manifest.request["grid"]),
        writing=writing,
    )


def _size(file: Path) -> int:
    """Returns the bytes of a file, none where a sweep that is writing has moved it meanwhile."""
    try:
        return file.stat().st_size if file.is_file() else 0
    except FileNotFoundError:
        return 0
