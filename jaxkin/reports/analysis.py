"""``jaxkin analyse``: all questions asked of one mechanism, and the answers as one report.

Every chapter is one question. A chapter that cannot be answered (a mechanism without closed cells, a section through a
self-motion) says why, and the others stand.
"""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jaxkin.core.errors import JaxkinError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import identity, jsonable, run_log
from jaxkin.reports import chapters
from jaxkin.reports.chapters import Places
from jaxkin.reports.document import Chapter, strict


@dataclass(frozen=True)
class Analysis:
    """What is known of a mechanism.

    Attributes:
        title: The mechanism.
        chapters: Question by question.
        request: Mechanism, geometry and places.
        run_log: When and with what it ran.
    """

    title: str
    chapters: tuple[Chapter, ...]
    request: dict[str, Any]
    run_log: dict[str, Any]

    def contents(self) -> dict[str, bytes]:
        """Returns all files by name; the report comes last and vouches for the others."""
        files: dict[str, bytes] = {}
        for chapter in self.chapters:
            files |= chapter.contents()
        files["report.md"] = self.markdown().encode()
        files["report.json"] = (self.json() + "\n").encode()
        return files

    def markdown(self) -> str:
        """Returns the report for a reader."""
        blocks = [f"# {self.title}\n", *(chapter.markdown() for chapter in self.chapters), "## This run\n"]
        blocks.append("".join(f"- {key}: {value}\n" for key, value in self.run_log.items()))
        return "\n".join(blocks)

    def json(self) -> str:
        """Returns the report for a program: text and tables; the results have files of their own."""
        chapters = [
            {
                "title": chapter.title,
                "text": list(chapter.text),
                "figures": {name: picture.caption for name, picture in chapter.pictures.items()},
                "tables": {name: vars(table) for name, table in chapter.tables.items()},
                "data": [f"{name}.json" for name in chapter.data],
            }
            for chapter in self.chapters
        ]
        content = {"title": self.title, "request": self.request, "chapters": chapters, "run_log": self.run_log}
        return json.dumps(strict(content), indent=2, allow_nan=False)


def analyse(robot: Mechanism, places: Places, tell: Callable[[str], object] | None = None) -> Analysis:
    """Asks everything of one mechanism.

    Args:
        robot: The mechanism.
        places: Where to look.
        tell: Called with a line as each chapter is done.

    Raises:
        PrecisionError: float64 is not enabled.
    """
    begin = time.perf_counter()
    steps: list[tuple[str, Callable[[], Chapter]]] = [
        ("The mechanism", lambda: chapters.mechanism_chapter(robot)),
        ("Assembly modes", lambda: chapters.modes_chapter(robot, places)),
        ("Aspects", lambda: chapters.aspects_chapter(robot, places)),
        ("Section of the joint space", lambda: chapters.section_chapter(robot, places)),
        ("Basic regions and uniqueness domains", lambda: chapters.basic_chapter(robot, places)),
        ("Changes of assembly mode", lambda: chapters.changes_chapter(robot, places)),
    ]
    if places.box is not None:
        box = places.box
        steps.insert(5, ("Cusp curves", lambda: chapters.cusp_chapter(robot, box)))
    done = []
    for title, step in steps:
        since = time.perf_counter()
        done.append(_answered(title, step))
        if tell is not None:
            tell(f"{title} ({time.perf_counter() - since:.1f} s)")
    grids = {"poses": places.poses, "section": places.section, "box": places.box}
    request = {
        **identity(robot),
        **{name: repr(grid) if grid is not None else None for name, grid in grids.items()},
        "joints": list(map(float, places.joints)),
    }
    log = run_log(seconds=round(time.perf_counter() - begin, 1))
    return Analysis(f"Analysis of {robot}", tuple(done), jsonable(request), log)


def _answered(title: str, step: Callable[[], Chapter]) -> Chapter:
    try:
        return step()
    except JaxkinError as error:
        return Chapter(title, (f"Not answered: {error}",))
