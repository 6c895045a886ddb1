"""What a Zarr store says of itself: the request, how it is cut, and with what it was begun."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from jaxkin.core.errors import StoreError
from jaxkin.core.provenance import Request, difference, environment
from jaxkin.sweep import result
from jaxkin.sweep.plan import Plan

#: Files beside the main array's chunks.
JOURNAL, RUN_LOG = "tiles.journal", "run_log.jsonl"


@dataclass(frozen=True)
class Manifest:
    """What a store says of itself.

    Attributes:
        request: Content of the request that made it.
        environment: What besides it decides about last digits.
        layout: Samples of blocks, chunks and tiles.
        tiles: Number of tiles.
        attrs: All attributes of the group.
    """

    request: dict[str, Any]
    environment: dict[str, Any]
    layout: dict[str, Any]
    tiles: int
    attrs: dict[str, Any]

    @property
    def field(self) -> str:
        """Name of the field, and of the array beside which the journal lies."""
        return self.request["field"]["name"]

    @property
    def variables(self) -> list[str]:
        """Names of the arrays that hold results."""
        return self.request["variables"]


def read_manifest(path: Path) -> Manifest:
    """Returns what a store says of itself.

    Raises:
        StoreError: There is no readable jaxkin store.
    """
    if not path.is_dir() or not (path / "zarr.json").exists():
        raise StoreError(
            f"{path} exists and is no jaxkin store: move it away or choose another path; jaxkin replaces only stores "
            "of its own."
            if path.exists()
            else f"There is no store {path}: give the path of one that a sweep has written."
        )
    try:
        attrs = json.loads((path / "zarr.json").read_text())["attributes"]
        request = Request(json.loads(attrs["request"]))
        if request.hash != attrs["request_hash"]:
            raise ValueError("its request is not the one that it was made with")
        content = request.content
        json.loads(attrs["labels"])
        if not content["field"]["name"] == content["variables"][0]:
            raise ValueError("its first variable is not the field")
        return Manifest(
            content, json.loads(attrs["environment"]), json.loads(attrs["layout"]), int(attrs["tiles"]), attrs
        )
    except (KeyError, TypeError, ValueError, IndexError, OSError) as error:
        reason = " ".join(str(error).split())[:200]
        raise StoreError(
            f"{path} holds a Zarr group without a readable jaxkin request ({reason}; cut short, of an older "
            "jaxkin, or of another program): move it away or choose another path; --force replaces only what is surely "
            "jaxkin's."
        ) from error


def lay_out(path: Path, request: Request, plan: Plan, attrs: dict[str, Any]) -> None:
    """Writes metadata and coordinates of an empty store."""
    manifest = {
        **result.request_attrs(request),
        **attrs,
        "tiles": plan.tiles,
        # Zarr 3 has no settled format for text, so labels travel as an attribute.
        "labels": json.dumps(result.labels(plan.variables)),
        "layout": json.dumps(plan.layout()),
        "environment": json.dumps(environment()),
    }
    group = zarr.create_group(path, attributes=manifest)
    for variable in plan.variables:
        group.create_array(
            variable.name,
            shape=(*variable.lead, *plan.grid.shape),
            chunks=(*variable.lead, *plan.chunk),
            shards=(*variable.lead, *plan.tile),
            dtype=variable.dtype,
            compressors=compressors(np.dtype(variable.dtype)),
            fill_value=variable.missing,
            dimension_names=result.variable_dims(variable, plan.grid),
            attributes=result.variable_attrs(variable),
        )
    for name, (dims, values, axis_attrs) in result.axis_coordinates(plan.grid).items():
        array = group.create_array(
            name, shape=values.shape, dtype="float64", dimension_names=dims, attributes=axis_attrs
        )
        array[...] = values


def compressors(dtype: np.dtype) -> list[Any]:
    """Returns the codecs of a variable, by measurement, and a checksum of every chunk for whoever reads it."""
    from zarr.codecs import BloscCodec, BloscShuffle, Crc32cCodec, ZstdCodec

    if dtype.kind == "f":
        packed = BloscCodec(typesize=dtype.itemsize, cname="lz4", clevel=1, shuffle=BloscShuffle.shuffle)
    else:
        packed = ZstdCodec(level=1)
    return [packed, Crc32cCodec()]


def damaged_store(path: Path, error: Exception) -> StoreError:
    """Returns the one answer to whatever Zarr meets in damaged files."""
    reason = " ".join(str(error).split())[:200] or type(error).__name__
    return StoreError(
        f"{path} is a damaged jaxkin store ({reason}): move it away, or replace it with overwrite=True (--force)."
    )


def check_request(path: Path, request: Request, manifest: Manifest) -> None:
    """Raises unless the store is of this request.

    Raises:
        StoreError: It is another's.
    """
    if manifest.request != json.loads(request.text):
        raise StoreError(
            f"{path} was made by another request ({request.difference(manifest.request)}): choose another store, or "
            "replace it with overwrite=True (--force)."
        )


def check_layout(path: Path, plan: Plan, manifest: Manifest) -> None:
    """Raises unless the store has every array as it was laid out, and its coordinates.

    Raises:
        StoreError: It is damaged, or was laid out by another version.
    """
    if manifest.layout != plan.layout():
        raise StoreError(
            f"{path} was laid out by another version of jaxkin (tiles of {manifest.layout.get('tile')} there and "
            f"{plan.layout()['tile']} here): finish it with that version, or replace it with overwrite=True (--force)."
        )
    try:
        group = zarr.open_group(path, mode="r")
        for variable in plan.variables:
            array = group[variable.name]
            shape, shards = (*variable.lead, *plan.grid.shape), (*variable.lead, *plan.tile)
            expected = shape, shards, np.dtype(variable.dtype)
            if not isinstance(array, zarr.Array) or (array.shape, array.shards, array.dtype) != expected:
                raise ValueError(f"the array {variable.name!r} has another layout")
        for name, (_, values, _) in result.axis_coordinates(plan.grid).items():
            if not np.array_equal(np.asarray(group[name][...]), values):  # type: ignore[index]
                raise ValueError(f"the coordinates {name!r} are not those of the request")
        if manifest.tiles != plan.tiles:
            raise ValueError("its number of tiles is another")
    except Exception as error:
        raise damaged_store(path, error) from error


def check_environment(path: Path, manifest: Manifest) -> None:
    """Raises where what is left to compute might be rounded otherwise than what is there.

    Raises:
        StoreError: It might.
    """
    here = environment()
    if here != manifest.environment:
        raise StoreError(
            f"{path} was begun with {difference(here, manifest.environment)}, and may be rounded otherwise: go on "
            "with what it was begun with, or replace it with overwrite=True (--force)."
        )


def beside(path: Path, field: str, name: str) -> Path:
    """Returns the place of a file that is jaxkin's own."""
    # In the main array's folder, where Zarr does not look for members of the group.
    return path / field / name


def tile_file(path: Path, name: str, lead: int, place: tuple[Any, ...]) -> Path:
    """Returns the file of the tile at a place among the tiles, in a variable with so many leading dimensions."""
    return path.joinpath(name, "c", *["0"] * lead, *map(str, place))
