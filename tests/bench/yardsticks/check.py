"""Do the yardsticks agree, and how fast are they on one core? Run by hand: python check.py"""

import time
from collections.abc import Callable

import numpy as np

from load import WIDE, load
from numba_rpr3 import count_numba
from numpy_rpr3 import branches_general_companion, count_closed_form

FAMILY = ((1.0, 0.0, 1.0), (1.5, -0.7, 0.4))
BENCHMARK = (15.91, 0.0, 10.0, 17.04, 20.84, 0.88260310976443155)
BENCHMARK_POSES = np.array(
    [
        (-8.7265953318629088, 12.175669752170042, -0.98697423784544515),
        (-5.4956608154528646, -13.935498276039359, -0.047331369366917773),
        (-14.896128100172762, 1.5829616619626078, 0.24530953099162642),
        (-13.419939013974376, -6.6562479567101796, 0.58567278325855305),
        (14.920133247154399, -1.3379177430462295, 1.0020385399022499),
        (14.673943655735036, -3.0126031249259319, 2.1329043650891289),
    ]
)


def speed(run: Callable[[], object], samples: int, repeats: int = 7) -> float:
    """Median throughput in M samples/s."""
    run()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return samples / float(np.median(times)) / 1e6


def residual(geometry: tuple[float, ...], poses: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Largest leg-length error of each pose (..., 3), for base and platform (c2, c3, d3, l2, l3, beta) and rho (..., 3)."""
    c2, c3, d3, l2, l3, beta = geometry
    x, y, phi = np.moveaxis(poses, -1, 0)
    legs = [np.hypot(x, y), np.hypot(x + l2 * np.cos(phi) - c2, y + l2 * np.sin(phi))]
    legs.append(np.hypot(x + l3 * np.cos(phi + beta) - c3, y + l3 * np.sin(phi + beta) - d3))
    return np.abs(np.stack(legs, -1) - rho).max(-1)


def sign_changes(geometry: tuple[float, ...], rho: np.ndarray, steps: int) -> np.ndarray:
    """Number of sign changes of P(phi) around the circle, an independent count of the assembly modes of a general 3-RPR."""
    c2, c3, d3, l2, l3, beta = geometry
    phi = np.linspace(-np.pi, np.pi, steps, endpoint=False)
    r1, r2, r3 = (rho.T**2)[..., None]
    u = l2 * np.exp(1j * phi) - c2
    v = l3 * np.exp(1j * (phi + beta)) - complex(c3, d3)
    # p = x + iy solves 2 Re(conj(u) p) = a, 2 Re(conj(v) p) = b
    a, b = r2 - r1 - np.abs(u) ** 2, r3 - r1 - np.abs(v) ** 2
    P = np.abs(a * v - b * u) ** 2 - 4 * r1 * (u.conj() * v).imag ** 2
    return (np.signbit(P) != np.signbit(np.roll(P, 1, 1))).sum(1)


def check_counts(samples: int = 1_000_000) -> None:
    rng = np.random.default_rng(1)
    rho = rng.uniform(0, 4, (3, samples))
    libraries = {"gcc": load(), "gcc 512": load(WIDE)}
    chunk = 1 << 15
    parts = [slice(o, o + chunk) for o in range(0, samples, chunk)]
    # Through rho1 = rho2 and rho1 = rho3 exactly, where phi = 0 and (with c3 = 0) phi = pi are roots.
    # A dozen of these points lie exactly on a singularity (a double pose), where rounding decides the count: they may differ.
    axis1, axis3, rho2 = np.arange(1, 2001) / 500, np.arange(1, 2001) / 500, 1.0
    flat = [np.ascontiguousarray(r).ravel() for r in np.broadcast_arrays(axis1[:, None], rho2, axis3)]
    for geometry in FAMILY:
        print(f"c2, c3, d3 = {geometry}")
        reference = count_closed_form(*geometry, *rho)
        reference_grid = count_closed_form(*geometry, *flat).reshape(2000, 2000)
        print("  share of 0 2 4 6:", np.bincount(reference, minlength=7)[::2] / samples)
        numpy_speed = speed(lambda: [count_closed_form(*geometry, *rho[:, p]) for p in parts], samples)
        print(f"  {'NumPy closed form':28}{'':24}{numpy_speed:8.1f} M/s in chunks", flush=True)

        def report(name: str, run: Callable[..., np.ndarray]) -> None:
            out = np.empty(samples, np.uint8)
            wrong = int((run(*geometry, *rho) != reference).sum())
            small = [r[:chunk].copy() for r in rho]
            whole = speed(lambda: run(*geometry, *rho, out), samples)
            warm = speed(lambda: [run(*geometry, *small, out[:chunk]) for _ in range(100)], 100 * chunk)
            print(f"  {name:28}{wrong:8} differ{whole:17.1f} M/s flat{warm:10.1f} M/s in cache")

        if count_numba is not None:
            report("numba", count_numba)
        for label, library in libraries.items():
            if library is None:
                print(f"  {label}: absent")
                continue
            report(f"{label} cubic", library.count_cubic)
            report(f"{label} sturm", library.count_sturm)
            for name, run in (("cubic", library.count_grid_cubic), ("sturm", library.count_grid_sturm)):
                wrong = int((run(*geometry, axis1, rho2, axis3) != reference_grid).sum())
                out = np.empty((2000, 2000), np.uint8)
                rate = speed(lambda: run(*geometry, axis1, rho2, axis3, out), out.size)
                rows = [slice(o, o + 16) for o in range(0, 2000, 16)]
                chunked = speed(lambda: [run(*geometry, axis1[p], rho2, axis3, out[p]) for p in rows], out.size)
                print(
                    f"  {f'{label} grid {name}':28}{wrong:8} differ{rate:17.1f} M/s whole{chunked:9.1f} M/s in chunks of 16 rows"
                )
            poses = library.branches_cubic(*geometry, *rho)
            wrong = int(((~np.isnan(poses[:, 0])).sum(0) != reference).sum())
            c2, c3, d3 = geometry
            error = residual((c2, c3, d3, c2, np.hypot(c3, d3), np.arctan2(-d3, c3)), np.moveaxis(poses, 1, 2), rho.T)
            outs, small = np.empty((6, 3, 4096)), [r[:4096].copy() for r in rho]
            rate = speed(lambda: [library.branches_cubic(*geometry, *small, outs) for _ in range(100)], 409600)
            whole = np.empty((6, 3, samples))
            rate_whole = speed(lambda: library.branches_cubic(*geometry, *rho, whole), samples)
            print(
                f"  {f'{label} branches':28}{wrong:8} differ{rate_whole:17.1f} M/s flat{rate:10.1f} M/s in cache, "
                f"residual median {np.nanmedian(error):.1e} worst {np.nanmax(error):.1e}"
            )


def check_general(samples: int = 20_000) -> None:
    one = np.array([[14.98, 15.38, 12.0]])
    poses = branches_general_companion(*BENCHMARK, *one.T)[0]
    poses = poses[np.argsort(poses[:, 2])]
    print(f"general companion: benchmark poses off by {np.abs(poses - BENCHMARK_POSES).max():.1e}")
    rho = np.random.default_rng(2).uniform(0, 30, (samples, 3))
    poses = branches_general_companion(*BENCHMARK, *rho.T)
    error = residual(BENCHMARK, poses, rho[:, None])
    count = (~np.isnan(poses[..., 0])).sum(1)
    subset = slice(0, 2000)
    wrong = int((count[subset] != sign_changes(BENCHMARK, rho[subset], 20_000)).sum())
    rate = speed(lambda: branches_general_companion(*BENCHMARK, *rho.T), samples)
    print(
        f"  counts {np.bincount(count, minlength=7)}, {wrong} of 2000 differ from sign changes, "
        f"residual median {np.nanmedian(error):.1e} worst {np.nanmax(error):.1e}"
    )
    print(f"  {rate:.3f} M/s, {1 / rate:.2f} us a sample")


if __name__ == "__main__":
    check_counts()
    check_general()
