"""What a reproduction is made of: checks, tables and pictures, and the report that sums them up."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from jaxkin.reports.document import Picture, Table, markdown_table, strict


@dataclass(frozen=True)
class Check:
    """One statement of a paper beside what was found.

    Attributes:
        key: A short name, by which an erratum refers to it.
        source: Where the statement stands: an equation, a figure, a line of the text.
        what: What is compared.
        printed: What the source says, or what it should be where the source is silent.
        got: What was found.
        difference: How far off, in the unit that ``what`` names.
        tolerance: How far off it may be.
        note: What to know beside.
    """

    key: str
    source: str
    what: str
    printed: str
    got: str
    difference: float
    tolerance: float
    note: str = ""

    @property
    def passed(self) -> bool:
        """True where the difference is within the tolerance; a difference that is not a number is not."""
        return bool(self.difference <= self.tolerance)


def count_check(key: str, source: str, what: str, printed: int, got: int, note: str = "") -> Check:
    """Returns a check of a whole number, which must agree exactly."""
    return Check(key, source, what, str(printed), str(got), float(abs(printed - got)), 0.0, note)


@dataclass(frozen=True)
class Part:
    """A figure, a table or a group of equations, with what was checked.

    Attributes:
        title: What it is.
        checks: What was compared.
        pictures: By the name of their files.
        tables: By the name of their files.
    """

    title: str
    checks: tuple[Check, ...]
    pictures: dict[str, Picture] = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)

    def contents(self) -> dict[str, bytes]:
        """Returns all files of figures and tables, by name."""
        files = {f"{name}.csv": table.csv().encode() for name, table in self.tables.items()}
        for name, picture in self.pictures.items():
            files |= picture.contents(name)
        return files

    def __str__(self) -> str:
        """The checks, one a line, and the tables."""
        lines = [self.title]
        for check in self.checks:
            word = "passed" if check.passed else "FAILED"
            lines.append(
                f"  {word}  {check.source}: {check.what}: {check.got} (difference {check.difference:.2g}, "
                f"tolerance {check.tolerance:.2g})"
            )
        lines += [f"\n{table.title}\n\n{table.markdown()}" for table in self.tables.values()]
        return "\n".join(lines)


def run_parts(steps: Sequence[Callable[[], Part]], tell: Callable[[str], object] | None = None) -> tuple[Part, ...]:
    """Makes the parts of a reproduction, and tells of each as it is done."""
    parts = []
    for step in steps:
        begin = time.perf_counter()
        parts.append(step())
        if tell is not None:
            checks, seconds = parts[-1].checks, time.perf_counter() - begin
            passed = sum(check.passed for check in checks)
            tell(f"{parts[-1].title}: {passed} of {len(checks)} checks passed ({seconds:.1f} s)")
    return tuple(parts)


@dataclass(frozen=True)
class Erratum:
    """What a paper says and what is right.

    Attributes:
        where: Where it stands.
        says: What is wrong or incomplete.
        right: What is right.
        how: How that was found.
        checks: Keys of the checks that show it.
    """

    where: str
    says: str
    right: str
    how: str
    checks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """A whole reproduction.

    Attributes:
        title: Title of the paper.
        source: Where to find it.
        parts: Figures, tables, equations.
        errata: Where the paper is wrong.
        unchecked: What of the paper is not reproduced, and why.
        settings: Geometry and seeds.
        run_log: When and with what it ran.
    """

    title: str
    source: str
    parts: tuple[Part, ...]
    errata: tuple[Erratum, ...]
    unchecked: tuple[str, ...]
    settings: dict[str, Any]
    run_log: dict[str, Any]

    @property
    def checks(self) -> tuple[Check, ...]:
        """All checks, in order; they are numbered from 1."""
        return tuple(check for part in self.parts for check in part.checks)

    @property
    def passed(self) -> bool:
        """True where every check passed."""
        return all(check.passed for check in self.checks)

    def summary(self) -> str:
        """Returns a line: how many checks passed."""
        checks = self.checks
        passed = sum(check.passed for check in checks)
        return f"{passed} of {len(checks)} checks passed" + ("" if self.passed else ": SOME FAILED")

    def contents(self) -> dict[str, bytes]:
        """Returns all files by name: figures, tables, and the report, which comes last and vouches for the others."""
        files: dict[str, bytes] = {}
        for part in self.parts:
            files |= part.contents()
        files["report.md"] = self.markdown().encode()
        files["report.json"] = (self.json() + "\n").encode()
        return files

    def markdown(self) -> str:
        """Returns the report for a reader."""
        numbers = {check.key: number for number, check in enumerate(self.checks, 1)}
        blocks = [f"# {self.title}\n", f"{self.source}.\n", f"{self.summary()}.\n"]
        blocks.append("## What was checked\n")
        blocks += [_checks_table(part, numbers) for part in self.parts if part.checks]
        blocks.append("## Where the paper is wrong or incomplete\n")
        blocks.append(_errata_table(self.errata, numbers))
        blocks.append("## Figures\n")
        blocks += [f"![{p.caption}]({n}.png)\n\n{p.caption}\n" for part in self.parts for n, p in part.pictures.items()]
        blocks.append("## Tables\n")
        blocks += [f"{t.title} (`{n}.csv`):\n\n{t.markdown()}" for part in self.parts for n, t in part.tables.items()]
        blocks.append("## Not checked\n")
        blocks.append("".join(f"- {line}\n" for line in self.unchecked))
        blocks.append("## This run\n")
        blocks.append("".join(f"- {k}: {v}\n" for k, v in (*self.settings.items(), *self.run_log.items())))
        return "\n".join(blocks)

    def json(self) -> str:
        """Returns the report for a program."""
        content = {
            "title": self.title,
            "source": self.source,
            "passed": self.passed,
            "parts": [
                {
                    "title": part.title,
                    "checks": [{**vars(check), "passed": check.passed} for check in part.checks],
                    "figures": {name: picture.caption for name, picture in part.pictures.items()},
                    "tables": {name: vars(table) for name, table in part.tables.items()},
                }
                for part in self.parts
            ],
            "errata": [vars(erratum) for erratum in self.errata],
            "not_checked": list(self.unchecked),
            "settings": self.settings,
            "run_log": self.run_log,
        }
        return json.dumps(strict(content), indent=2, allow_nan=False)


def _checks_table(part: Part, numbers: dict[str, int]) -> str:
    header = ("no.", "where", "what", "printed or expected", "here", "off by", "allowed", "result", "note")
    rows = [
        (
            str(numbers[check.key]),
            check.source,
            check.what,
            check.printed,
            check.got,
            f"{check.difference:.2g}",
            f"{check.tolerance:.2g}",
            "passed" if check.passed else "**FAILED**",
            check.note,
        )
        for check in part.checks
    ]
    return f"### {part.title}\n\n{markdown_table(header, rows)}"


def _errata_table(errata: Sequence[Erratum], numbers: dict[str, int]) -> str:
    rows = []
    for erratum in errata:
        places = ", ".join(map(str, sorted(numbers[key] for key in erratum.checks)))
        how = erratum.how + (f" (no. {places})" if places else "")
        rows.append((erratum.where, erratum.says, erratum.right, how))
    return markdown_table(("where", "the paper says", "right is", "how that was checked"), rows)
