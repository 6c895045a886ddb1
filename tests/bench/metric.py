"""What a benchmark reports, how two things are timed against each other, and when a metric is worse.

No NumPy here: the worker processes import this before they are pinned.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any, Literal

#: Tolerance of a ratio: other load on the machine moves it by less.
RATIO = 0.3
#: A metric with this tolerance is held to its goal, whatever the baseline says.
EXACT = 0.0


@dataclass(frozen=True)
class Metric:
    """One number of the suite.

    Attributes:
        name: "suite: what".
        value: The number.
        unit: "x" for ratios.
        better: Which way is better.
        tolerance: Share of the baseline by which it may be worse; ``EXACT`` holds it to its goal, None
            lets it be anything.
        goal: What it should reach.
    """

    name: str
    value: float
    unit: str
    better: Literal["higher", "lower"]
    tolerance: float | None = None
    goal: float | None = None

    def reaches(self, limit: float) -> bool:
        """Tells whether the value is at the limit or on its good side."""
        return self.value >= limit if self.better == "higher" else self.value <= limit

    def limit(self, baseline: float) -> float | None:
        """Returns the worst value that passes, or None for a metric that is only informational."""
        if self.tolerance is None:
            return None
        if self.tolerance == EXACT:
            return self.goal
        return baseline * (1 - self.tolerance if self.better == "higher" else 1 + self.tolerance)

    def record(self) -> dict[str, Any]:
        """Returns the metric for the baseline's file."""
        return asdict(self) | {"value": float(f"{self.value:.4g}")}


def speedup(name: str, value: float, goal: float | None = None) -> Metric:
    """Makes a gated ratio of speeds."""
    return Metric(name, value, "x", "higher", RATIO, goal)


def mistakes(name: str, number: int) -> Metric:
    """Makes a count of wrong answers, of which there must be none."""
    return Metric(name, number, "samples", "lower", EXACT, 0)


def throughput(name: str, samples: int, seconds: float, goal: float | None = None) -> Metric:
    """Makes an informational throughput."""
    return Metric(name, samples / seconds / 1e6, "M samples/s", "higher", None, goal)


def bandwidth(name: str, bytes_written: int, seconds: float) -> Metric:
    """Makes an informational bandwidth."""
    return Metric(name, bytes_written / seconds / 1e9, "GB/s", "higher")


def duration(name: str, seconds: float, goal: float | None = None) -> Metric:
    """Makes an informational time."""
    return Metric(name, seconds, "s", "lower", None, goal)


def seconds(run: Callable[[], object]) -> float:
    """Times one call; what it returns is freed after the clock has stopped."""
    start = time.perf_counter()
    kept = run()
    stop = time.perf_counter()
    del kept
    return stop - start


class Times:
    """Seconds of several runs, taken in turn."""

    def __init__(self, runs: Mapping[str, Callable[[], object]], rounds: int = 9):
        self.first = {name: seconds(run) for name, run in runs.items()}
        self._rounds = [{name: seconds(run) for name, run in runs.items()} for _ in range(rounds)]

    def median(self, name: str) -> float:
        """Returns the median of one run."""
        return median(each[name] for each in self._rounds)

    def ratio(self, slow: str, fast: str) -> float:
        """Returns how many times faster ``fast`` is: the median over the rounds of each round's ratio."""
        return median(each[slow] / each[fast] for each in self._rounds)

    def compiling(self, name: str) -> float:
        """Returns what the first call took more than the others."""
        return self.first[name] - self.median(name)


def worse(metrics: Iterable[Metric], baseline: dict[str, dict[str, Any]]) -> list[str]:
    """Returns a sentence for every gated metric that is worse than its tolerance allows."""
    found = []
    for metric in metrics:
        before = baseline.get(metric.name, {}).get("value")
        limit = metric.limit(metric.value if before is None else before)
        if limit is not None and not metric.reaches(limit):
            than = f"the limit {limit:.3g} (baseline {before})"
            found.append(f"{metric.name}: {metric.value:.3g} {metric.unit} is worse than {than}")
    return found
