"""The journal of a store: which tiles are whole, and the checksum of each of their files."""

import hashlib
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from jaxkin.sweep.threads import run_in_threads

#: "<tile> <checksum of its file in each variable> ...": a torn last line does not match.
_LINE = re.compile(r"^(\d{1,9})((?: (?:[0-9a-f]{32}|-))+)\n", re.MULTILINE)


#: Zarr writes no file where there is nothing but the fill value.
_NO_FILE = "-"


def checksum(path: Path) -> str:
    """Returns BLAKE2 of a file, "-" where there is none."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()
    except FileNotFoundError:
        return _NO_FILE
    except OSError as error:
        return f"unreadable ({error.strerror})"


class Journal:
    """One text file, a line for each tile, written after the tile's data.

    After a power failure a line may be on the disk and its tile's data not: therefore no line is believed before the
    checksums of its files were compared, when a sweep goes on.

    Args:
        path: The file; it need not exist.
        tiles: Number of tiles of the store.
        files: Tile -> its file in each variable.
    """

    def __init__(self, path: Path, tiles: int, files: Callable[[int], list[Path]]):
        self.path, self._tiles, self._files = path, tiles, files
        self._known = self._read()

    def _read(self) -> dict[int, str]:
        try:
            text = self.path.read_text(encoding="ascii", errors="replace")
        except FileNotFoundError:
            return {}
        known = {int(number): sums.strip() for number, sums in _LINE.findall(text)}
        return {number: sums for number, sums in known.items() if number < self._tiles}

    def __len__(self) -> int:
        """Number of tiles that the journal says are whole."""
        return len(self._known)

    def damaged(self, checked: Callable[[int], None] = lambda number: None, workers: int = 2) -> list[int]:
        """Reads the files of every journalled tile, and returns those whose data is not what was written.

        Args:
            checked: Is called with every tile that was read.
            workers: How many files are read at once.
        """
        wrong: list[int] = []

        def check(number: int) -> None:
            if [checksum(path) for path in self._files(number)] != self._known[number].split():
                wrong.append(number)

        for number in run_in_threads(check, sorted(self._known), workers):
            checked(number)
        return sorted(wrong)

    def done(self) -> np.ndarray:
        """Returns for every tile whether it is whole, ``(tiles,)``."""
        whole = np.zeros(self._tiles, bool)
        whole[list(self._known)] = True
        return whole

    def forget(self, numbers: Iterable[int]) -> None:
        """Takes tiles back, on the disk too."""
        for number in numbers:
            self._known.pop(number, None)
        self.settle()

    def add(self, number: int, sums: list[str]) -> None:
        """Appends a tile that is whole now."""
        line = " ".join([str(number), *sums])
        with open(self.path, "a", encoding="ascii") as file:
            file.write(line + "\n")
            file.flush()
            os.fsync(file.fileno())
        self._known[number] = " ".join(sums)

    def settle(self) -> None:
        """Rewrites the file in the tiles' order, so that it says the same whatever happened on the way."""
        text = "".join(f"{number} {self._known[number]}\n" for number in sorted(self._known))
        aside = self.path.with_suffix(".new")
        try:
            with open(aside, "w", encoding="ascii") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            os.replace(aside, self.path)
        finally:
            aside.unlink(missing_ok=True)
