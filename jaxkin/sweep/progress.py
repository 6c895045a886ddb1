"""A progress bar on long work, silent when piped."""

import sys
import time

from tqdm import tqdm

#: Seconds before a bar shows up: short work stays silent.
_PATIENCE = 1.0


class Progress:
    """Counts finished samples; a context manager.

    Args:
        total: Samples in all.
        label: What is being computed.
        before: Samples that are there from an earlier run; they do not count in the rate.
        show: True or False to force or forbid the bar; None shows it only on a terminal.
    """

    def __init__(self, total: int, label: str, before: int = 0, show: bool | None = None):
        self._options = {
            "total": total,
            "desc": label,
            "unit": " samples",
            "unit_scale": True,
            "leave": False,
            "initial": before,
        }
        self._show = sys.stderr.isatty() if show is None else show
        self._start = time.perf_counter()
        self._bar: tqdm | None = None
        self._done = before

    def __enter__(self) -> "Progress":
        """Starts the clock."""
        return self

    def add(self, samples: int) -> None:
        """Counts samples as done."""
        self._done += samples
        if not self._show:
            return
        if self._bar is None and time.perf_counter() - self._start > _PATIENCE:
            self._bar = tqdm(file=sys.stderr, **self._options)  # type: ignore[arg-type]
        if self._bar is not None:
            self._bar.update(self._done - self._bar.n)

    def __exit__(self, *_: object) -> None:
        """Removes the bar."""
        if self._bar is not None:
            self._bar.close()
