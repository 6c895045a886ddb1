"""What a report is made of: chapters, tables and pictures, and how they are written."""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Cell = str | float | int | None


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        title: What it shows.
        header: Names of the columns.
        rows: Numbers and texts; None is an empty cell.
    """

    title: str
    header: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]

    def csv(self) -> str:
        """Returns the table as CSV, floats with all their digits; None is an empty cell."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(self.rows)
        return buffer.getvalue()

    def markdown(self) -> str:
        """Returns the table as Markdown, floats to 12 digits."""
        return markdown_table(self.header, [[_text(cell) for cell in row] for row in self.rows])


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Returns a Markdown table; a bar within a cell is escaped."""
    lines = [list(header), ["---"] * len(header), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def _text(cell: Cell) -> str:
    return "" if cell is None else f"{cell:.12g}" if isinstance(cell, float) else str(cell)


@dataclass(frozen=True)
class Picture:
    """A figure with its caption."""

    figure: Figure
    caption: str

    @classmethod
    def of(cls, axes: Axes | np.ndarray, caption: str) -> "Picture":
        """Returns the whole figure of Axes, or of an array of them."""
        figure = np.ravel(np.asarray(axes, dtype=object))[0].get_figure(root=True)
        return cls(figure, caption)

    def contents(self, name: str) -> dict[str, bytes]:
        """Returns the files ``name.png`` and ``name.pdf``."""
        files = {}
        for suffix in ("png", "pdf"):
            buffer = io.BytesIO()
            self.figure.savefig(buffer, format=suffix, dpi=200)
            files[f"{name}.{suffix}"] = buffer.getvalue()
        return files


@dataclass(frozen=True)
class Chapter:
    """One question and its answer.

    Attributes:
        title: The question, as a heading.
        text: Paragraphs.
        pictures: By the name of their files.
        tables: By the name of their files.
        data: Whole results as JSON text, by the name of their files.
    """

    title: str
    text: tuple[str, ...]
    pictures: dict[str, Picture] = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)
    data: dict[str, str] = field(default_factory=dict)

    def contents(self) -> dict[str, bytes]:
        """Returns the chapter's files by name."""
        files = {f"{name}.csv": table.csv().encode() for name, table in self.tables.items()}
        files |= {f"{name}.json": (text + "\n").encode() for name, text in self.data.items()}
        for name, picture in self.pictures.items():
            files |= picture.contents(name)
        return files

    def markdown(self) -> str:
        """Returns the chapter for a reader."""
        blocks = [f"## {self.title}\n", *(f"{paragraph}\n" for paragraph in self.text)]
        blocks += [f"![{p.caption}]({name}.png)\n\n{p.caption}\n" for name, p in self.pictures.items()]
        blocks += [f"{t.title} (`{name}.csv`):\n\n{t.markdown()}" for name, t in self.tables.items()]
        if self.data:
            blocks.append("Data: " + ", ".join(f"`{name}.json`" for name in self.data) + "\n")
        return "\n".join(blocks)


def strict(value: Any) -> Any:
    """Writes numbers that JSON lacks as text."""
    if isinstance(value, dict):
        return {key: strict(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [strict(entry) for entry in value]
    return str(value) if isinstance(value, float) and value - value != 0 else value
