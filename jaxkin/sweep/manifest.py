"""What a Zarr store says of itself: the request, how it is cut, and with what it was begun."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from jaxkin.core.errors import StoreError
from jaxkin.core.provenance import Request, difference, environment
from jaxkin.core.words import given
from jaxkin.sweep import result
from jaxkin.sweep.coordinates import write_coordinate
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


class Contradiction(ValueError):
    """What is there is not what the store says of itself; the message says how, in plain words."""


def read_manifest(path: Path, remedy: str = "give the path of one that a sweep has written") -> Manifest:
    """Returns what a store says of itself.

    Args:
        path: Its folder.
        remedy: What whoever asks may do where there is something else.

    Raises:
        StoreError: There is no readable jaxkin store.
    """
    if not path.exists():
        raise StoreError(f"There is no store {path}: give the path of one that a sweep has written.")
    if not path.is_dir() or not (path / "zarr.json").exists():
        raise StoreError(f"{path} exists and is no jaxkin store: {remedy}.")
    try:
        attrs = json.loads((path / "zarr.json").read_text())["attributes"]
        request = Request(json.loads(attrs["request"]))
        if request.hash != attrs["request_hash"]:
            raise Contradiction("its request is not the one that it was made with")
        content = request.content
        json.loads(attrs["labels"])
        if not content["field"]["name"] == content["variables"][0]:
            raise Contradiction("its first variable is not the field")
        return Manifest(
            content, json.loads(attrs["environment"]), json.loads(attrs["layout"]), int(attrs["tiles"]), attrs
        )
    except (KeyError, TypeError, ValueError, IndexError, OSError) as error:
        reason = _plainly(error, "it is cut short, of an older jaxkin, or of another program")
        raise StoreError(
            f"{path} holds a Zarr group without a readable jaxkin request ({reason}): {remedy}."
        ) from error


def _plainly(error: Exception, otherwise: str) -> str:
    """Returns jaxkin's own words; what a parser has to say is for the cause of an exception, not for a sentence."""
    return str(error) if isinstance(error, Contradiction) else otherwise


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
    for name, coordinate in result.axis_coordinates(plan.grid).items():
        write_coordinate(group, name, coordinate)


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
    reason = _plainly(error, "an array of it, or what describes one, cannot be read")
    return StoreError(
        f"{path} is a damaged jaxkin store ({reason}): move it away, or make it anew by the same request with "
        f"{given('overwrite=True')}."
    )


def check_request(path: Path, request: Request, manifest: Manifest) -> None:
    """Raises unless the store is of this request.

    Raises:
        StoreError: It is another's.
    """
    if manifest.request != json.loads(request.text):
        raise StoreError(
            f"{path} was made by another request ({request.difference(manifest.request)}): choose another store, or "
            f"replace it with {given('overwrite=True')}."
        )


def check_layout(path: Path, plan: Plan, manifest: Manifest) -> None:
    """Raises unless the store has every array of the field as it was laid out.

    Not so its coordinates: they follow from the request, and are written anew where they are damaged.

    Raises:
        StoreError: It is damaged, or was laid out by another version.
    """
    if manifest.layout != plan.layout():
        raise StoreError(
            f"{path} was laid out by another version of jaxkin (tiles of {manifest.layout.get('tile')} there and "
            f"{plan.layout()['tile']} here): finish it with that version, or replace it with {given('overwrite=True')}."
        )
    try:
        group = zarr.open_group(path, mode="r")
        for variable in plan.variables:
            array = group[variable.name]
            shape, shards = (*variable.lead, *plan.grid.shape), (*variable.lead, *plan.tile)
            expected = shape, shards, np.dtype(variable.dtype)
            if not isinstance(array, zarr.Array) or (array.shape, array.shards, array.dtype) != expected:
                raise Contradiction(f"the array {variable.name!r} has another layout")
        if manifest.tiles != plan.tiles:
            raise Contradiction("its number of tiles is another")
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
            f"with what it was begun with, or replace it with {given('overwrite=True')}."
        )


def beside(path: Path, field: str, name: str) -> Path:
    """Returns the place of a file that is jaxkin's own."""
    # In the main array's folder, where Zarr does not look for members of the group.
    return path / field / name


def tile_file(path: Path, name: str, lead: int, place: tuple[Any, ...]) -> Path:
    """Returns the file of the tile at a place among the tiles, in a variable with so many leading dimensions."""
    return path.joinpath(name, "c", *["0"] * lead, *map(str, place))
