"""Conditioning over the workspace and interference on one core, against NumPy, numba and C."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numba_conditioning as nb
import numpy as np
import numpy_spatial
from kernel import compiled
from load import load_spatial
from metric import Metric, Times, mistakes, speedup, throughput

import jaxkin as jk
from jaxkin.mechanisms import _tlpm_wrist
from jaxkin.sweep.fields import Field, Variable, by_name

Run = Callable[[], object]

#: Samples of one call of a yardstick in cache, and of one timed run.
KERNEL_BLOCK = 1 << 13
SAMPLES = 1 << 18
#: Grids whose results come in fresh pages.
GRIDS: dict[str, dict] = {
    "3-RPR": {"x": (-2.0, 2.0, 128), "y": (-2.0, 2.0, 128), "phi": (-3.0, 3.0, 128)},
    "TLPM": {"x": (-100.0, 100.0, 128), "y": (-100.0, 100.0, 128), "z": (-100.0, 100.0, 128)},
    "3-PPPS": {"phi": (-2.0, 2.0, 64), "theta": (-1.0, 1.0, 64), "sigma": (-2.0, 2.0, 64)},
}
MEASURES = ("direct_determinant", "smallest_singular_value", "inverse_condition_number")
#: Largest difference, in units of the largest value there is.
AGREEMENT = 1e-12


def measure() -> list[Metric]:
    """Times the three measures of three robots, then forward kinematics with interference."""
    jk.enable_x64()
    rpr3 = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    tlpm, ppps3 = jk.mechanisms.tlpm.create(), jk.mechanisms.ppps3.create()
    metrics = []
    for name, robot, size in (
        ("3-RPR", rpr3, _rpr3_size(rpr3)),
        ("TLPM", tlpm, tlpm_size(tlpm)),
        ("3-PPPS", ppps3, None),
    ):
        for what, field in enumerate(MEASURES):
            metrics += _measure(name, robot, size, what, field)
    return metrics + _interference(tlpm)


def _rpr3_size(robot: jk.Mechanism) -> np.ndarray:
    points = (*robot.base_points(), *robot.platform_points())
    return np.array([*(float(c) for point in points for c in point), float(robot.characteristic_length())])


def tlpm_size(robot: jk.Mechanism) -> np.ndarray:
    """Returns the numbers that the yardsticks of the TLPM want, in the order of spatial.c."""
    own = [robot.height, robot.initial_lengths[0], robot.b, robot.r1, robot.r2, np.sqrt(2.0) * robot.a]
    axes = [c for limb in _tlpm_wrist._platform_axes(robot) for vector in limb for c in vector]
    return np.array([*(float(c) for point in robot.base_points() for c in point), *map(float, own), *map(float, axes)])


def _measure(name: str, robot, size: np.ndarray | None, what: int, field: str) -> list[Metric]:
    rng, stem = np.random.default_rng(what), {"3-RPR": "rpr3", "TLPM": "tlpm", "3-PPPS": "ppps3"}[name]
    fixed = {axis.name: 0.1 for axis in robot.pose_axes}
    grid = jk.Grid(**(fixed | GRIDS[name]))
    axes = [np.linspace(*interval) for interval in GRIDS[name].values()]
    ends = np.array([GRIDS[name].get(axis.name, (0.1, 0.1, 1))[:2] for axis in robot.pose_axes])
    pose = rng.uniform(ends[:, :1], ends[:, 1:], (len(ends), KERNEL_BLOCK))
    given = () if size is None else (size,)
    flat = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")])
    if size is None:
        flat = np.concatenate([np.full((3, flat.shape[1]), 0.1), flat])
    shape, numbers = tuple(map(len, axes)), getattr(numpy_spatial, f"{stem}_conditioning")
    here: dict[str, Callable[[np.ndarray], object]] = {}
    everywhere: dict[str, Run] = {"NumPy": lambda: numbers(what, *given, flat)}
    if nb.rpr3_conditioning:
        one, all_ = (getattr(nb, f"{stem}_conditioning{kind}") for kind in ("", "_grid"))
        here["numba"] = lambda out: one(what, *given, pose, out)
        everywhere["numba"] = lambda: all_(what, *given, *axes, np.empty(shape))
    if library := load_spatial():
        in_c, grid_in_c = (getattr(library, f"{stem}_conditioning{kind}") for kind in ("", "_grid"))
        turned = (*axes[:2], np.concatenate([np.cos(axes[2]), np.sin(axes[2])])) if stem == "rpr3" else axes
        here["C"] = lambda out: in_c(KERNEL_BLOCK, what, *given, pose, out)
        everywhere["C"] = lambda: grid_in_c(*shape, what, *given, *turned, np.empty(shape))
    label = f"conditioning: {name} {field.replace('_', ' ')}"
    wanted = numbers(what, *given, pose)
    return _in_cache(label, by_name(field), robot, pose, here, wanted, lambda: numbers(what, *given, pose)) + _swept(
        label, field, robot, grid, everywhere
    )


def _in_cache(label: str, field: Field, robot, pose: np.ndarray, rivals: dict, wanted: np.ndarray, numbers: Run):
    """Times a kernel on random samples, and compares all results with NumPy's."""
    # The same samples over and over: as many a call as a sweep takes.
    arguments = tuple(jax.device_put(np.tile(pose, max(1, field.block(robot) // KERNEL_BLOCK))))
    kernel, calls, out = compiled(field.kernel, robot, arguments), SAMPLES // KERNEL_BLOCK, np.empty(wanted.shape)
    runs: dict[str, Run] = {
        "jaxkin": repeated(lambda: jax.block_until_ready(kernel(robot, arguments)), SAMPLES // len(arguments[0])),
        "NumPy": repeated(numbers, calls),
    }
    runs |= {name: repeated(lambda run=run: run(out), calls) for name, run in rivals.items()}
    times, metrics = Times(runs, 5), []
    values = np.concatenate([np.atleast_2d(a)[:, :KERNEL_BLOCK] for a in kernel(robot, arguments)])
    found = {"jaxkin": values.reshape(wanted.shape)}
    for name, run in rivals.items():
        run(out)
        found[name] = out.copy()
    for name, values in found.items():
        metrics.append(mistakes(f"{label}, {name} unlike NumPy", unlike(values, wanted)))
    metrics.append(throughput(f"{label}, kernel in cache", SAMPLES, times.median("jaxkin")))
    return metrics + ratios(label, "kernel", times, "in cache")


def ratios(label: str, thing: str, times: Times, where: str) -> list[Metric]:
    """Returns jaxkin's speed over that of every other run."""
    goals = {"numba": 1.0}
    others = [name for name in times.first if name != "jaxkin"]
    return [
        speedup(f"{label}, {thing} / {name}, {where}", times.ratio(name, "jaxkin"), goals.get(name)) for name in others
    ]


def repeated(call: Run, times: int) -> Run:
    """Returns a run of many calls, each of which frees what the one before returned."""

    def run() -> None:
        for _ in range(times):
            call()

    return run


def unlike(one: np.ndarray, other: np.ndarray) -> int:
    """Counts numbers that differ by more than rounding of the largest one."""
    largest = np.nanmax(np.abs(other[np.isfinite(other)]), initial=0.0)
    same = (np.abs(one - other) <= AGREEMENT * largest) | (np.isnan(one) & np.isnan(other))
    return int((~same).sum())


def _swept(label: str, field: Field | str, robot, grid, rivals: dict[str, Run]) -> list[Metric]:
    runs: dict[str, Run] = {"jaxkin": lambda: jk.sweep(robot, field, grid, workers=1, progress=False)}
    times = Times(runs | rivals, 5)
    axes = (by_name(field) if isinstance(field, str) else field).axes(robot)
    metrics = [throughput(f"{label}, sweep", grid.bind(axes, "any").size, times.median("jaxkin"))]
    return metrics + ratios(label, "sweep", times, "fresh memory")


def _interference_kernel(robot, joints) -> tuple[jax.Array, ...]:
    """Both modes and the smallest of the twelve clearances of each."""
    found = []
    for lane in robot.forward_kernel(joints):
        least = jnp.inf
        for clearance in _tlpm_wrist.clearances(robot, lane.values).values():
            least = jnp.minimum(least, clearance)
        found += [*lane.values, least]
    return tuple(found)


#: A field as a user would compose it: nothing of this is in the package.
INTERFERENCE = Field(
    name="interference",
    domain="joints",
    variables=lambda robot: (
        Variable(
            "interference", "float64", "mm", "p and clearance", (("mode", (0, 1)), ("entry", ("x", "y", "z", "least")))
        ),
    ),
    kernel=_interference_kernel,
    block=lambda robot: 1 << 12,
)


def _interference(robot) -> list[Metric]:
    label, size = "conditioning: TLPM forward with interference", tlpm_size(robot)
    axes = [np.linspace(-100.0, 100.0, 64)] * 3
    flat = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")])
    n, joints = flat.shape[1], np.random.default_rng(5).uniform(-100, 100, (3, KERNEL_BLOCK))
    here, everywhere = {}, {"NumPy": lambda: numpy_spatial.tlpm_interference(size, flat)}
    if nb.tlpm_interference:
        here["numba"] = lambda out: nb.tlpm_interference(size, joints, out)
        everywhere["numba"] = lambda: nb.tlpm_interference(size, flat, np.empty((2, 4, n)))
    if library := load_spatial():
        here["C"] = lambda out: library.tlpm_interference(KERNEL_BLOCK, np.nan, size, joints, out)
        everywhere["C"] = lambda: library.tlpm_interference(n, np.nan, size, flat, np.empty((2, 4, n)))
    wanted = numpy_spatial.tlpm_interference(size, joints)
    grid = jk.Grid(**{axis.name: (-100.0, 100.0, 64) for axis in robot.joint_axes})
    return _in_cache(
        label, INTERFERENCE, robot, joints, here, wanted, lambda: numpy_spatial.tlpm_interference(size, joints)
    ) + _swept(label, INTERFERENCE, robot, grid, everywhere)
