"""Runs the benchmarks and prints one table; see README.md. No part of the test suite."""

import argparse
import importlib
import json
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE / "yardsticks")]

import machine  # noqa: E402
from metric import Metric, worse  # noqa: E402

BASELINE = HERE / "baseline.json"

#: Modules of ``suites`` and how many cores each is pinned to; None leaves it all of them.
SUITES: dict[str, int | None] = {
    "count_map": 1,
    "analytic_branches": 1,
    "general_branches": 1,
    "sections": 1,
    "spatial": 1,
    "conditioning": 1,
    "design": 1,
    "topology": None,
    "two_cores": None,
    "memory": None,
    "command_line": None,
}


def measure(suite: str) -> list[Metric]:
    """Runs one suite in this process."""
    return importlib.import_module(f"suites.{suite}").measure()


def main() -> int:
    """Runs what the command line asks for and returns the exit code."""
    parser = argparse.ArgumentParser(description="Benchmarks of jaxkin.")
    parser.add_argument("--only", action="append", choices=SUITES, help="run this suite; may be repeated")
    parser.add_argument("--save", action="store_true", help=f"write {BASELINE.name}")
    parser.add_argument("--check", action="store_true", help="exit 1 if worse than the baseline allows")
    options = parser.parse_args()
    if options.save and options.only:
        parser.error("--save needs all suites: leave out --only.")
    saved = json.loads(BASELINE.read_text()) if BASELINE.exists() else {"machine": None, "metrics": {}}

    metrics: list[Metric] = []
    print(", ".join(f"{key}: {value}" for key, value in machine.description().items()))
    for suite in options.only or SUITES:
        with machine.worker(SUITES[suite]) as pool:
            found = pool.submit(measure, suite).result()
        for metric in found:
            print(_row(metric, saved["metrics"]), flush=True)
        metrics += found

    if options.save:
        records = {metric.name: metric.record() for metric in metrics}
        content = {"machine": machine.description(), "metrics": records}
        BASELINE.write_text(json.dumps(content, indent=2) + "\n")
    return _check(metrics, saved, partial=bool(options.only)) if options.check else 0


def _row(metric: Metric, baseline: dict[str, dict]) -> str:
    goal = ""
    if metric.goal is not None:
        goal = f"goal {metric.goal:g} {'met' if metric.reaches(metric.goal) else 'MISSED'}"
    before = baseline.get(metric.name)
    than = f"was {before['value']:.3g}" if before else ""
    return f"{metric.name:64}{metric.value:10.3g} {metric.unit:12} {than:12} {goal}".rstrip()


def _check(metrics: list[Metric], saved: dict, partial: bool) -> int:
    if saved["machine"] != machine.description():
        print(f"The baseline is of another machine ({saved['machine']}): make one of your own with --save.")
    failures = worse(metrics, saved["metrics"])
    if not partial:
        measured = {metric.name for metric in metrics}
        gated = (name for name, record in saved["metrics"].items() if record["tolerance"] is not None)
        failures += [f"{name}: in the baseline, but not measured" for name in gated if name not in measured]
    for failure in failures:
        print("WORSE", failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
