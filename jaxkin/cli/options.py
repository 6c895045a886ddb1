"""What several commands share: parsing of geometry and grids, and how JAX is started."""

import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jaxkin.core.errors import InputError

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism
    from jaxkin.sweep.grid import Grid

set_option: Callable[..., Any] = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="NAME=VALUE",
    help="Change the geometry, e.g. --set c2=1.5, --set elbows=1:-1:1.",
)
limit_option: Callable[..., Any] = click.option(
    "--limit",
    "limits",
    multiple=True,
    metavar="JOINT=LOW:HIGH",
    help="Limit a joint, e.g. --limit rho1=0.5:2, --limit rho1x=-1:1, --limit theta1=0.5:3.",
)
fix_option: Callable[..., Any] = click.option(
    "--fix", "fixes", multiple=True, metavar="AXIS=VALUE", help="Fix an axis."
)
grid_option: Callable[..., Any] = click.option(
    "--grid", "grids", multiple=True, metavar="AXIS=LOW:HIGH:N", help="Sample an axis."
)
json_option: Callable[..., Any] = click.option("--json", "as_json", is_flag=True, help="Print JSON, for programs.")


def start_jax() -> None:
    """Switches float64 on, and keeps compiled kernels in a cache of the command line's own."""
    import jax

    from jaxkin.core.precision import enable_x64

    enable_x64()
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = os.environ.get("JAXKIN_CACHE_DIR") or str(Path(home) / "jaxkin")
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # A cache that cannot be written only costs time.
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def number(what: str, text: str) -> float:
    """Returns a finite number from text.

    Raises:
        InputError: It is none.
    """
    try:
        value = float(text.replace("_", "?"))  # Python would read 1_0 as 10.
    except ValueError:
        raise InputError(f"{what} is {text!r}: it must be a number.") from None
    if not math.isfinite(value):
        raise InputError(f"{what} is {text!r}: it must be a finite number.")
    return value


def pairs(option: str, items: tuple[str, ...]) -> dict[str, str]:
    """Splits NAME=VALUE items.

    Raises:
        InputError: One has no "=", or a name stands twice.
    """
    result: dict[str, str] = {}
    for item in items:
        name, equals, value = item.partition("=")
        if not equals or not name.strip():
            raise InputError(f"{option} got {item!r}: write it as NAME=VALUE.")
        if name.strip() in result:
            raise InputError(f"{option} got {name.strip()!r} twice: give it once.")
        result[name.strip()] = value.strip()
    return result


def robot_of(name: str, changes: tuple[str, ...], limits: tuple[str, ...] = ()) -> "Mechanism":
    """Makes the mechanism that a command names, with its geometry and limits changed."""
    from jaxkin.mechanisms.catalogue import create

    parsed: dict[str, float | tuple[float, ...]] = {}
    for key, value in pairs("--set", changes).items():
        if "," in value:
            raise InputError(f"--set {key} is {value!r}: write several numbers with colons, {value.replace(',', ':')}.")
        parts = [number(f"--set {key}", part) for part in value.split(":")]
        parsed[key] = tuple(parts) if len(parts) > 1 else parts[0]
    intervals = {}
    for key, value in pairs("--limit", limits).items():
        ends = value.split(":")
        if len(ends) != 2:
            raise InputError(f"--limit {key} is {value!r}: write it as LOW:HIGH, for instance {key}=0:1.")
        intervals[key] = (number(f"--limit {key} (low)", ends[0]), number(f"--limit {key} (high)", ends[1]))
    return create(name, **parsed).with_limits(**intervals)


def grid_of(fixes: tuple[str, ...], grids: tuple[str, ...], fix: str = "--fix", grid: str = "--grid") -> "Grid":
    """Makes the grid of NAME=VALUE and NAME=LOW:HIGH:N, which are given by options of these names."""
    from jaxkin.sweep.grid import Grid

    axes: dict[str, Any] = {key: number(f"{fix} {key}", value) for key, value in pairs(fix, fixes).items()}
    for key, value in pairs(grid, grids).items():
        if key in axes:
            given = f"by {fix} and {grid}" if fix != grid else f"by {grid} twice"
            raise InputError(f"The axis {key!r} is given {given}: give it once.")
        parts = value.split(":")
        if len(parts) != 3:
            raise InputError(f"{grid} {key} is {value!r}: write it as LOW:HIGH:N, for instance {key}=0:4:2000.")
        low, high = number(f"{grid} {key} (low)", parts[0]), number(f"{grid} {key} (high)", parts[1])
        try:
            count = int(parts[2])
        except ValueError:
            raise InputError(f"{grid} {key} has n = {parts[2]!r}: the number of samples must be an integer.") from None
        axes[key] = (low, high, count)
    return Grid(**axes)
