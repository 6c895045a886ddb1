"""Folders and files that commands write: refused, before anything is computed, where something could be lost."""

import contextlib
import csv
import io
import json
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxkin.core.errors import InputError, StoreError

if TYPE_CHECKING:
    pass


def check_folder(out: Path, own: str, force: bool) -> None:
    """Refuses a folder that cannot be used, or that holds things and not the command's own.

    Args:
        out: The folder that --out names; it need not exist.
        own: Name of what the command itself leaves in its folder.
        force: True where --force allows a folder of other things; what bears other names stays.

    Raises:
        StoreError: The folder is refused.
    """
    if out.exists() and not out.is_dir():
        raise StoreError(f"--out is {str(out)!r}, which is a file: choose another folder.")
    # A hidden rest of something that was stopped while it was laid out is nobody's.
    others = [p for p in out.iterdir() if not p.name.startswith(f".{own}.")] if out.is_dir() else []
    if others and not (out / own).exists() and not force:
        raise StoreError(
            f"--out is {str(out)!r}, which exists and holds something else: choose another folder, or add the result "
            "to it with --force."
        )
    parent = next(folder for folder in (out, *out.absolute().parents) if folder.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK):
        raise StoreError(f"--out is {str(out)!r}, but {str(parent)!r} cannot be written: choose another folder.")


def check_report_folder(out: Path | None, report: str, what: str, force: bool) -> Path:
    """Returns the folder of a command that makes many files, if it can be used.

    Args:
        out: The folder that --out names, or None.
        report: Name of the file that is written last, and vouches for the others.
        what: What makes many files, for the message.
        force: True where files of the same names are replaced.

    Raises:
        InputError: There is no folder.
        StoreError: The folder is refused, or holds a report already.
    """
    if out is None:
        raise InputError(f"{what} makes many files: give a folder with --out FOLDER.")
    check_folder(out, report, force)
    if (out / report).exists() and not force:
        raise StoreError(
            f"--out is {str(out)!r}, which holds a report already: choose another folder, or replace it with --force."
        )
    return out


def write_files(contents: dict[Path, bytes]) -> None:
    """Writes files aside and renames them when all are whole, so that a full disk costs nothing that existed.

    Raises:
        StoreError: One cannot be written.
    """
    asides = {path.with_name(f".{path.name}.new"): path for path in contents}
    path = Path()
    try:
        for aside, path in asides.items():
            aside.write_bytes(contents[path])
        for aside, path in asides.items():
            os.replace(aside, path)
    except OSError as error:
        raise StoreError(f"{path} cannot be written ({error.strerror}): choose another place.") from error
    finally:
        for aside in asides:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)


def pictures(paths: Iterable[Path], draw: Callable[[], Any]) -> dict[Path, bytes]:
    """Draws one figure, without a screen, and returns it in the format of each path's suffix.

    Args:
        paths: Where it will be written.
        draw: Returns the figure's Axes, one or an array of them.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    # Figures of several panels come as an array of Axes.
    figure = np.ravel(np.asarray(draw(), dtype=object))[0].get_figure(root=True)
    assert figure is not None
    contents = {}
    for path in paths:
        buffer = io.BytesIO()
        figure.savefig(buffer, format=path.suffix[1:], dpi=200)
        contents[path] = buffer.getvalue()
    plt.close("all")
    return contents


def csv_text(header: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Returns a table as CSV text; None becomes an empty cell."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return buffer.getvalue()


def request_of(path: Path) -> str | None:
    """Returns the request that a file of numbers belongs to; it is written last, so it vouches for the pictures."""
    try:
        return json.loads(path.read_text())["request_hash"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
