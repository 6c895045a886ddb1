"""The group of commands, and how their errors end."""

import sys

import click

from jaxkin import __version__
from jaxkin.cli.analyse import analyse_command
from jaxkin.cli.atlas import atlas_command
from jaxkin.cli.map import map_command
from jaxkin.cli.optimise import optimise_command
from jaxkin.cli.path import path_command
from jaxkin.cli.points import forward_command, inverse_command
from jaxkin.cli.reproduce import reproduce_command
from jaxkin.cli.sections import cusps_command, loci_command
from jaxkin.cli.stores import info_command, verify_command
from jaxkin.cli.topology import aspects_command, regions_command
from jaxkin.cli.words import OPTIONS
from jaxkin.core.words import spoken


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def cli() -> None:
    """Kinematics and workspace maps of parallel robots."""


@cli.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def list_command(as_json: bool) -> None:
    """List the mechanisms with their default geometry."""
    import dataclasses
    import json

    from jaxkin.mechanisms.catalogue import CATALOGUE

    if as_json:
        click.echo(json.dumps({name: dataclasses.asdict(entry) for name, entry in CATALOGUE.items()}, indent=2))
        return
    for name, entry in CATALOGUE.items():
        geometry = ", ".join(f"{key}={_written(value)}" for key, value in entry.geometry.items())
        click.echo(f"{name:14} {entry.title}\n{'':14} {geometry}  ({entry.source})")
        if entry.options:
            click.echo(f"{'':14} also " + ", ".join(f"{key} ({how})" for key, how in entry.options.items()))


def _written(value: float | tuple[float, ...]) -> str:
    """Returns geometry as ``--set`` takes it."""
    return ":".join(f"{entry:.12g}" for entry in value) if isinstance(value, tuple) else f"{value:.12g}"


cli.add_command(inverse_command)
cli.add_command(forward_command)
cli.add_command(map_command)
cli.add_command(atlas_command)
cli.add_command(optimise_command)
cli.add_command(info_command)
cli.add_command(verify_command)
cli.add_command(loci_command)
cli.add_command(cusps_command)
cli.add_command(aspects_command)
cli.add_command(regions_command)
cli.add_command(path_command)
cli.add_command(analyse_command)
cli.add_command(reproduce_command)


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line; bad input ends with one line and exit code 2, Ctrl-C with 130."""
    from jaxkin.core.errors import JaxkinError

    try:
        with spoken(OPTIONS):
            code = cli.main(arguments, prog_name="jaxkin", standalone_mode=False)
    except click.ClickException as error:
        click.echo(f"jaxkin: {error.format_message()} See --help.", err=True)
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt) as error:
        # click turns Ctrl-C into Abort; the sentence of what was stopped is its cause.
        cause = error if isinstance(error, JaxkinError) else error.__cause__
        click.echo(f"jaxkin: {cause if isinstance(cause, JaxkinError) else 'stopped.'}", err=True)
        sys.exit(130)
    except JaxkinError as error:
        click.echo(f"jaxkin: {error}", err=True)
        sys.exit(2)
    except BrokenPipeError:
        sys.exit(0)
    except OSError as error:
        click.echo(f"jaxkin: {error.filename or 'the output'} cannot be used: {error.strerror}.", err=True)
        sys.exit(2)
    sys.exit(code if isinstance(code, int) else 0)


if __name__ == "__main__":
    main()
