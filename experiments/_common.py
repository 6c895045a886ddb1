"""What every experiment does: float64 on, a folder for its results, figures in two formats."""

import argparse
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure, SubFigure

import jaxkin as jk
from jaxkin.papers.report import Part


def start(number: str, description: str | None) -> Path:
    """Reads ``--out``, switches float64 on, and returns the folder for results."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--out", type=Path, default=Path("out") / number, help="folder for the results")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    matplotlib.use("Agg")
    jk.enable_x64()
    return folder


def save(figure: Figure | SubFigure | None, folder: Path, name: str) -> None:
    """Saves a figure as PNG and PDF."""
    assert isinstance(figure, Figure)
    for suffix in ("png", "pdf"):
        path = folder / f"{name}.{suffix}"
        figure.savefig(path, dpi=200)
        print(path)


def finish(folder: Path, part: Part) -> None:
    """Prints what a part of a paper's reproduction checked, and writes its figures and tables."""
    print(part)
    for name, content in part.contents().items():
        (folder / name).write_bytes(content)
        print(folder / name)
