"""``jaxkin info`` and ``jaxkin verify``: what a store holds, and whether it still holds what was written."""

import json
from pathlib import Path

import click

from jaxkin.cli.options import json_option


@click.command("info")
@click.argument("store", type=Path)
@json_option
def info_command(store: Path, as_json: bool) -> None:
    """Tell what a store holds, without reading its data."""
    from jaxkin.sweep.inspection import describe_store

    info = describe_store(_store_of(store))
    click.echo(json.dumps(info.to_json(), indent=2) if as_json else str(info))


@click.command("verify")
@click.argument("store", type=Path)
@json_option
def verify_command(store: Path, as_json: bool) -> int:
    """Compare every tile of a store with its checksum; ends with 1 where one is damaged or missing.

    Changes nothing: the command that made the store computes what is damaged or missing.
    """
    from jaxkin.sweep.inspection import verify_store

    check = verify_store(_store_of(store))
    click.echo(json.dumps(check.to_json(), indent=2) if as_json else str(check))
    return 0 if check.ok else 1


def _store_of(path: Path) -> Path:
    """Takes the folder of ``map --out`` for the store in it."""
    inside = path / "map.zarr"
    return inside if not (path / "zarr.json").exists() and inside.exists() else path
