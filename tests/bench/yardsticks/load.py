"""Compile the C yardsticks with the machine's gcc and wrap them with ctypes."""

import ctypes
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
FLAGS = ("-std=gnu11", "-O3", "-march=native", "-ffast-math", "-fopenmp-simd", "-fPIC")
WIDE = ("-mprefer-vector-width=512", "-DLANES=8")

_array = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
_bytes = np.ctypeslib.ndpointer(np.uint8, flags="C_CONTIGUOUS")
_size, _real = ctypes.c_size_t, ctypes.c_double
_FLAT = (_size, _real, _real, _real, _array, _array, _array)
_GRID = (_size, _size, _real, _real, _real, _array, _real, _array, _bytes)
_SIGNATURES = {
    "count_cubic": (*_FLAT, _bytes),
    "count_sturm": (*_FLAT, _bytes),
    "branches_cubic": (*_FLAT, _array),
    "branches_general": (_size, _array, _array, _array, _array, _array),
    "count_grid_cubic": _GRID,
    "count_grid_sturm": _GRID,
}


@dataclass(frozen=True)
class Rpr3C:
    """The compiled yardsticks. Arrays are contiguous; every method fills and returns `out`, which it makes if not given."""

    library: ctypes.CDLL
    flags: tuple[str, ...]

    def _count(
        self, name: str, geometry: tuple[float, float, float], rho: tuple[np.ndarray, ...], out: np.ndarray | None
    ) -> np.ndarray:
        out = np.empty(rho[0].shape, np.uint8) if out is None else out
        getattr(self.library, name)(rho[0].size, *geometry, *rho, out)
        return out

    def _grid(
        self,
        name: str,
        geometry: tuple[float, float, float],
        rho1: np.ndarray,
        rho2: float,
        rho3: np.ndarray,
        out: np.ndarray | None,
    ) -> np.ndarray:
        out = np.empty((rho1.size, rho3.size), np.uint8) if out is None else out
        getattr(self.library, name)(rho1.size, rho3.size, *geometry, rho1, rho2, rho3, out)
        return out

    def count_cubic(self, c2, c3, d3, rho1, rho2, rho3, out=None) -> np.ndarray:
        return self._count("count_cubic", (c2, c3, d3), (rho1, rho2, rho3), out)

    def count_sturm(self, c2, c3, d3, rho1, rho2, rho3, out=None) -> np.ndarray:
        return self._count("count_sturm", (c2, c3, d3), (rho1, rho2, rho3), out)

    def count_grid_cubic(self, c2, c3, d3, rho1, rho2, rho3, out=None) -> np.ndarray:
        return self._grid("count_grid_cubic", (c2, c3, d3), rho1, rho2, rho3, out)

    def count_grid_sturm(self, c2, c3, d3, rho1, rho2, rho3, out=None) -> np.ndarray:
        return self._grid("count_grid_sturm", (c2, c3, d3), rho1, rho2, rho3, out)

    def branches_cubic(self, c2, c3, d3, rho1, rho2, rho3, out=None) -> np.ndarray:
        """Poses as an array (6 lanes, (x, y, phi), n), NaN where there is none."""
        out = np.empty((6, 3, rho1.size)) if out is None else out
        self.library.branches_cubic(rho1.size, c2, c3, d3, rho1, rho2, rho3, out)
        return out

    def branches_general(self, geometry, rho1, rho2, rho3, out=None) -> np.ndarray:
        """The same for base and platform (c2, c3, d3, l2, l3, beta); samples must be a multiple of 8."""
        if rho1.size % 8:
            raise ValueError(f"{rho1.size} samples are no multiple of 8, the vectors' length")
        out = np.empty((6, 3, rho1.size)) if out is None else out
        self.library.branches_general(rho1.size, np.array(geometry), rho1, rho2, rho3, out)
        return out


def load(extra: tuple[str, ...] = ()) -> Rpr3C | None:
    """The compiled library, or None without a gcc that can build it. `extra=WIDE` asks for 512-bit vectors."""
    library = compiled(("rpr3.c", "rpr3_general.c"), _SIGNATURES, extra)
    return library and Rpr3C(library, FLAGS + extra)


def compiled(sources: tuple[str, ...], signatures: dict[str, tuple], extra: tuple[str, ...] = ()) -> ctypes.CDLL | None:
    """Builds source files and declares their functions; None without a gcc that can do it."""
    gcc = shutil.which("gcc")
    if gcc is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        made, shared = [f"{folder}/{Path(source).stem}.o" for source in sources], f"{folder}/made.so"
        # Linking apart, without -ffast-math: with it, gcc adds start-up code that flushes denormals in the whole process.
        link = [gcc, "-shared", *made, "-o", shared]
        try:
            for source, target in zip(sources, made, strict=True):
                given = [*FLAGS, *extra, "-c", str(HERE / source), "-o", target]
                subprocess.run([gcc, *given], check=True, capture_output=True)
            if subprocess.run([*link, "-lmvec", "-lm"], capture_output=True).returncode:
                subprocess.run([*link, "-lm"], check=True, capture_output=True)
            library = ctypes.CDLL(shared)
        except (OSError, subprocess.CalledProcessError):
            return None
    for name, arguments in signatures.items():
        function = getattr(library, name)
        function.argtypes, function.restype = arguments, None
    return library


_SPATIAL = {
    "ppps3_frames": (_size, _real, _array, _array, _bytes),
    "ppps3_branches": (_size, _real, _array, _array, _bytes),
    "tlpm_branches": (_size, _real, _array, _array, _array, _bytes),
    "tlpm_interference": (_size, _real, _array, _array, _array),
    "rpr3_conditioning": (_size, ctypes.c_int, _array, _array, _array),
    "tlpm_conditioning": (_size, ctypes.c_int, _array, _array, _array),
    "ppps3_conditioning": (_size, ctypes.c_int, _array, _array),
    "rpr3_conditioning_grid": (_size, _size, _size, ctypes.c_int, _array, _array, _array, _array, _array),
    "tlpm_conditioning_grid": (_size, _size, _size, ctypes.c_int, _array, _array, _array, _array, _array),
    "ppps3_conditioning_grid": (_size, _size, _size, ctypes.c_int, _array, _array, _array, _array),
}


def load_spatial() -> ctypes.CDLL | None:
    """The functions of spatial.c as they are declared there, or None without gcc."""
    return compiled(("spatial.c",), _SPATIAL)
