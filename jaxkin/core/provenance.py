"""The request, which determines the numbers and is hashed, and the run log, which does not."""

import datetime
import hashlib
import json
import math
import os
import platform
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxkin.core.mechanism import Mechanism

#: Raise it when a kernel changes its numbers, so that old stores are not continued with new ones.
ALGORITHM_VERSION = 2


@dataclass(frozen=True)
class Request:
    """Everything that determines the numbers of a result.

    Attributes:
        content: JSON-able: mechanism, geometry, field, grid, tolerances, algorithm version.
    """

    content: dict[str, Any]

    @property
    def text(self) -> str:
        """Canonical JSON: sorted keys, no spaces, every float64 exactly."""
        return json.dumps(self.content, sort_keys=True, separators=(",", ":"))

    @property
    def hash(self) -> str:
        """SHA-256 of the canonical text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def difference(self, other: dict[str, Any]) -> str:
        """Names the first entry in which another request's content differs, with both values."""
        return difference(json.loads(self.text), other)


def difference(here: dict[str, Any], there: dict[str, Any]) -> str:
    """Names the first entry in which two nested records differ, with both values."""
    mine, theirs = _flat(here), _flat(there)
    for key in sorted(set(mine) | set(theirs)):
        if mine.get(key) != theirs.get(key):
            return f"{key} is {theirs.get(key)!r} there and {mine.get(key)!r} here"
    return "nothing differs"


def _flat(content: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            flat.update(_flat(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def jsonable(value: Any) -> Any:
    """Writes infinite limits as text, which JSON has no number for."""
    if isinstance(value, dict):
        return {key: jsonable(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [jsonable(entry) for entry in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def identity(robot: "Mechanism") -> dict[str, Any]:
    """Returns what of a mechanism, and of this program, determines numbers: the start of every request."""
    return {
        "mechanism": robot.id or f"{type(robot).__module__}.{type(robot).__qualname__}",
        "geometry": jsonable(robot.geometry()),
        "algorithm": ALGORITHM_VERSION,
    }


def environment() -> dict[str, Any]:
    """Returns what besides the request decides about last digits: the compiler, and what it compiles for."""
    import importlib.metadata

    import jax

    from jaxkin import __version__

    return {
        "jaxkin": __version__,
        "jax": jax.__version__,
        "jaxlib": importlib.metadata.version("jaxlib"),
        "platform": jax.devices()[0].platform,
        "processor": _processor(),
        "xla_flags": os.environ.get("XLA_FLAGS", ""),
    }


def processor_flags() -> frozenset[str]:
    """Returns what the processor can do, in the words of Linux; nothing where the system does not tell."""
    try:
        with open("/proc/cpuinfo", encoding="ascii", errors="replace") as file:
            return frozenset(file.read().split())
    except OSError:
        return frozenset()


def _processor() -> str:
    """Names the processor's vectors and fused multiplications, by which the same kernel may round otherwise."""
    flags = processor_flags()
    return " ".join([platform.machine(), *(flag for flag in ("avx", "avx2", "fma", "avx512f", "sve") if flag in flags)])


def run_log(**entries: Any) -> dict[str, Any]:
    """Returns what happened in this run (time, device, versions), which is no part of identity."""
    import jax
    import numpy

    return {
        "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "jax": jax.__version__,
        "numpy": numpy.__version__,
        "python": platform.python_version(),
        "device": jax.devices()[0].platform,
        **entries,
    }
