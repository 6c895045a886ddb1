"""Numbers of things, bytes, seconds and grids as a person says them."""

from typing import Any


def counted(number: int, thing: str) -> str:
    """Returns a number with the thing that is counted: 1 tile, 2,000 samples."""
    return f"{number:,} {thing}" if number == 1 else f"{number:,} {thing}s"


def bytes_text(count: float) -> str:
    """Returns bytes with three digits and a unit."""
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if count < 999.5:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} PB"


def time_text(seconds: float) -> str:
    """Returns a time with three digits and a unit."""
    for limit, unit, name in ((120, 1, "s"), (7200, 60, "minutes"), (172800, 3600, "hours")):
        if seconds < limit:
            return f"{seconds / unit:.3g} {name}"
    return f"{seconds / 86400:.3g} days"


def grid_text(content: dict[str, Any]) -> str:
    """Says in a few words what a request holds as its grid."""
    return ", ".join(
        f"{axis} = {value[0]:g} .. {value[1]:g} ({value[2]})" if isinstance(value, list) else f"{axis} = {value:g}"
        for axis, value in content.items()
    )
