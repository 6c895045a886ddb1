"""What a store holds, and whether it still holds what was written."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from jaxkin.core.provenance import difference, environment
from jaxkin.sweep.manifest import damaged_store, read_manifest
from jaxkin.sweep.stored import journal_of, run_logs
from jaxkin.sweep.threads import cores
from jaxkin.sweep.units import bytes_text, grid_text


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
            f"  samples     {self.samples:,}, {self.tiles_done:,} of {self.tiles:,} tiles whole"
            + ("" if self.complete else ": the same request goes on"),
            f"  size        {bytes_text(self.stored_bytes)} on the disk, {bytes_text(self.raw_bytes)} uncompressed",
            f"  runs        {len(self.runs)}, {seconds:.4g} s in all",
            f"  request     {self.request_hash}",
        ]
        if differs != "nothing differs":
            lines.append(f"  begun with  other versions: {differs}")
        return "\n".join(lines)


@dataclass(frozen=True)
class StoreCheck:
    """Whether a store holds what was written.

    Attributes:
        path: Its folder.
        tiles: Tiles in all.
        tiles_done: Tiles that the journal says are whole.
        damaged: Numbers of those whose files are not what was written.
    """

    path: str
    tiles: int
    tiles_done: int
    damaged: list[int]

    @property
    def ok(self) -> bool:
        """True where the store is complete and undamaged."""
        return self.tiles_done == self.tiles and not self.damaged

    def to_json(self) -> dict[str, Any]:
        """Returns all of it, for programs."""
        return {**asdict(self), "ok": self.ok}

    def __str__(self) -> str:
        """One line for a person, with a remedy."""
        if self.ok:
            return f"{self.path}: all {self.tiles:,} tiles are as they were written"
        parts = []
        if self.damaged:
            some = ", ".join(map(str, self.damaged[:10])) + (", ..." if len(self.damaged) > 10 else "")
            parts.append(f"{len(self.damaged)} of {self.tiles_done:,} tiles are damaged ({some})")
        if self.tiles_done < self.tiles:
            parts.append(f"{self.tiles - self.tiles_done:,} of {self.tiles:,} tiles are missing")
        return f"{self.path}: {' and '.join(parts)}; the same request computes them"


def describe_store(path: str | Path) -> StoreInfo:
    """Tells what a store says of itself, without reading its data.

    Raises:
        StoreError: There is no jaxkin store at this path, or its description is damaged.
    """
    path = Path(path)
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
        stored_bytes=sum(file.stat().st_size for file in path.rglob("*") if file.is_file()),
        runs=run_logs(path, manifest),
    )


def verify_store(path: str | Path) -> StoreCheck:
    """Reads every tile of a store, and compares it with the checksum that was taken when it was written.

    Changes nothing: the same request computes again what is damaged.

    Raises:
        StoreError: There is no jaxkin store at this path, or its description is damaged.
    """
    path = Path(path)
    manifest = read_manifest(path)
    try:
        group = zarr.open_group(path, mode="r")
        for name in manifest.request["grid"]:
            np.asarray(group[name][...])  # type: ignore[index]
        journal = journal_of(path, manifest)
    except Exception as error:
        raise damaged_store(path, error) from error
    return StoreCheck(str(path), manifest.tiles, len(journal), journal.damaged(workers=cores()))
