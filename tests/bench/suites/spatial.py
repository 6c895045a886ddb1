"""The 3-PPPS and the TLPM on one core: kernels in cache, sweeps into fresh memory, operations compiled."""

import re
from collections import Counter
from collections.abc import Callable

import jax
import numba_spatial
import numpy as np
import numpy_spatial
from kernel import compiled
from load import load_spatial
from metric import Metric, Times, mistakes, speedup, throughput
from suites.conditioning import tlpm_size

import jaxkin as jk
from jaxkin.mechanisms import _tlpm_wrist
from jaxkin.sweep import fields

Run = Callable[[], object]

#: Samples of one call of a yardstick in cache, for each robot.
KERNEL_BLOCK = 1 << 12
TLPM_BLOCK = 1 << 14
#: Samples of one timed run in cache.
SAMPLES = 1 << 18
#: Results of one sweep are larger than what malloc keeps: they come in fresh pages.
INVERSE = {"phi": (-2.0, 2.0, 128), "theta": (-1.0, 1.0, 64), "sigma": (-2.0, 2.0, 128)}
FORWARD = {"rho2z": (-0.6, 0.6, 64), "rho3y": (-1.0, 1.0, 128), "rho3z": (-0.6, 0.6, 64)}
#: Strokes stay within +-200 all over this cube.
REACH = (-100.0, 100.0)
#: Largest difference of two results: 1e-11 of the TLPM's lengths; the 3-PPPS is measured near its singularities too.
AGREEMENT = 1e-8
#: Opcodes that the paper counts.
OPERATIONS = ("sine", "cosine", "sqrt", "divide", "multiply", "add", "subtract")


def measure() -> list[Metric]:
    """Times both robots, then counts operations."""
    jk.enable_x64()
    ppps3, tlpm = jk.mechanisms.ppps3.create(), jk.mechanisms.tlpm.create()
    rng = np.random.default_rng(1)
    return [*_ppps3(ppps3, rng), *_tlpm(tlpm, rng), *_clearances(tlpm, rng), *_operations(ppps3, rng)]


def _ppps3(robot: jk.Mechanism, rng: np.random.Generator) -> list[Metric]:
    pose = rng.uniform(-1, 1, (6, KERNEL_BLOCK)) * np.array([[1.0], [1.0], [1.0], [3.1], [1.5], [3.1]])
    joints = np.stack(robot.inverse_kernel(tuple(pose))[0].values)
    axes = [np.linspace(*INVERSE[name]) for name in ("phi", "theta", "sigma")]
    lengths = [0.1, 0.0, 0.0, *(np.linspace(*FORWARD[name]) for name in FORWARD)]
    flat = np.stack([a.ravel() for a in np.broadcast_arrays(*lengths[:3], *np.meshgrid(*lengths[3:], indexing="ij"))])
    shape = tuple(map(len, axes))
    nb = numba_spatial

    found = _in_cache("3-PPPS inverse", fields.inverse_branches, robot, pose, nb.ppps3_inverse, ((6,),))
    grid = jk.Grid(x=0.1, y=0.2, z=0.3, **INVERSE)
    rival = nb.ppps3_inverse_grid and (lambda: nb.ppps3_inverse_grid(0.1, 0.2, 0.3, *axes, np.empty((6, *shape))))
    found += _swept("3-PPPS inverse", "inverse_branches", robot, grid, {"numba": rival}, 15)
    grid = jk.Grid(rho1y=0.1, rho1z=0.0, rho2y=0.0, **FORWARD)
    library = load_spatial()
    for name, field, kernel, entries, goal in (
        ("3-PPPS frames", fields.forward_frames, "ppps3_frames", 12, 8),
        ("3-PPPS Euler angles", fields.forward_branches, "ppps3_branches", 6, 3),
    ):
        function, shapes = getattr(nb, kernel), ((4, entries), (4,))
        others = {"NumPy": getattr(numpy_spatial, kernel), "C": _in_c(library, kernel)}
        rivals = {"numba": function, "C": others["C"]}
        found += _in_cache(name, field, robot, joints, function, shapes, others)
        found += _swept(name, field.name, robot, grid, _fresh(rivals, flat, shapes), goal)
    return found


def _in_c(library, name: str, *size: np.ndarray) -> Callable | None:
    """Returns a C yardstick as numba's are called: samples, arrays to fill."""
    if library is None:
        return None
    return lambda given, *out: getattr(library, name)(given.shape[1], np.nan, *size, given, *out)


def _fresh(rivals: dict[str, Callable | None], given: np.ndarray, shapes) -> dict[str, Run | None]:
    """Returns runs that fill new arrays."""
    return {
        name: function and (lambda f=function: f(given, *_outputs(shapes, given.shape[1])))
        for name, function in rivals.items()
    }


def _tlpm(robot: jk.Mechanism, rng: np.random.Generator) -> list[Metric]:
    base = np.array(robot.base_points())
    size = (base, float(robot.height), float(robot.initial_lengths[0]))
    cube = rng.uniform(*REACH, (3, TLPM_BLOCK))
    flat = np.stack([a.ravel() for a in np.meshgrid(*(np.linspace(*REACH, 128) for _ in range(3)), indexing="ij")])
    nb, found = numba_spatial, []
    numbers = tlpm_size(robot)
    others = {
        "NumPy": lambda given: numpy_spatial.tlpm_branches(numbers, given),
        "C": _in_c(load_spatial(), "tlpm_branches", numbers),
    }
    for name, field, function, shapes, goal, more in (
        ("TLPM inverse", fields.inverse_branches, nb.tlpm_inverse, ((3,),), 15, {}),
        ("TLPM forward", fields.forward_branches, nb.tlpm_branches, ((2, 3), (2,)), 30, others),
    ):
        own = function and (lambda *given, f=function: f(*size, *given))
        rivals = {"numba": own, **({"C": more["C"]} if more else {})}
        found += _in_cache(name, field, robot, cube, own, shapes, more)
        grid = jk.Grid(**{axis.name: (*REACH, 128) for axis in field.axes(robot)})
        found += _swept(name, field.name, robot, grid, _fresh(rivals, flat, shapes), goal)
    return found


def _outputs(shapes: tuple[tuple[int, ...], ...], n: int) -> list[np.ndarray]:
    """Makes a yardstick's arrays: numbers first, then bytes."""
    return [np.empty((*shape, n), dtype) for shape, dtype in zip(shapes, (float, np.uint8), strict=False)]


def _repeated(call: Run, times: int) -> Run:
    """Returns a run of many calls, each of which frees what the one before returned."""

    def run() -> None:
        for _ in range(times):
            call()

    return run


def _in_cache(
    name: str, field, robot, given: np.ndarray, yardstick, shapes, others: dict[str, Callable | None] | None = None
) -> list[Metric]:
    """Times a field's kernel on random samples, and compares what it finds with the yardsticks'."""
    n = given.shape[1]
    # The same samples over and over: as many a call as a sweep takes.
    arguments = tuple(jax.device_put(np.tile(given, max(1, field.block(robot) // n))))
    kernel, calls = compiled(field.kernel, robot, arguments), SAMPLES // n
    runs: dict[str, Run] = {
        "jaxkin": _repeated(lambda: jax.block_until_ready(kernel(robot, arguments)), SAMPLES // len(arguments[0])),
    }
    fills = {"numba": yardstick, "C": (others or {}).get("C")}
    numpy_ = (others or {}).get("NumPy")
    out = _outputs(shapes, n)
    runs |= {rival: _repeated(lambda f=fill: f(given, *out), calls) for rival, fill in fills.items() if fill}
    if numpy_:
        runs["NumPy"] = _repeated(lambda: numpy_(given), calls)
    times = Times(runs)
    metrics = [throughput(f"spatial: {name}, kernel in cache", SAMPLES, times.median("jaxkin"))]
    arrays = field.unpack(tuple(np.asarray(a) for a in kernel(robot, arguments)))
    numbers = np.stack([array[:n] for array in arrays[: out[0].size // n]])
    for rival in (each for each in runs if each != "jaxkin"):
        if rival == "NumPy":
            values = numpy_(given)
        else:
            fills[rival](given, *out)
            values = out[0]
        goal = 1.0 if rival == "numba" else None
        ratio = times.ratio(rival, "jaxkin")
        metrics.append(speedup(f"spatial: {name}, kernel / {rival}, in cache", ratio, goal))
        metrics.append(mistakes(f"spatial: {name}, unlike {rival}'s", _unlike(numbers, values.reshape(-1, n))))
    return metrics


def _unlike(one: np.ndarray, other: np.ndarray) -> int:
    """Counts samples that differ, up to a turn in an angle."""
    gap = np.abs(one - other)
    same = (np.minimum(gap, np.abs(gap - 2 * np.pi)) <= AGREEMENT) | (np.isnan(one) & np.isnan(other))
    return int((~same.all(axis=0)).sum())


def _swept(name: str, field: str, robot, grid, rivals: dict[str, Run | None], goal: float) -> list[Metric]:
    runs: dict[str, Run] = {"jaxkin": lambda: jk.sweep(robot, field, grid, workers=1, progress=False)}
    runs |= {rival: run for rival, run in rivals.items() if run}
    times = Times(runs)
    samples = grid.bind(fields.by_name(field).axes(robot), "any").size
    metrics = [throughput(f"spatial: {name}, sweep", samples, times.median("jaxkin"), goal)]
    for rival in (each for each in runs if each != "jaxkin"):
        ratio, wanted = times.ratio(rival, "jaxkin"), 1.0 if rival == "numba" else None
        metrics.append(speedup(f"spatial: {name}, sweep / {rival}, fresh memory", ratio, wanted))
    return metrics


def _clearances(robot, rng: np.random.Generator) -> list[Metric]:
    """Times the twelve clearances; numba gets the segments ready, and so has less to do."""
    pose = rng.uniform(*REACH, (3, KERNEL_BLOCK))
    kernel = jax.jit(lambda robot, pose: tuple(_tlpm_wrist.clearances(robot, pose).values()))
    arguments, calls = tuple(jax.device_put(pose)), SAMPLES // KERNEL_BLOCK
    runs: dict[str, Run] = {
        "jaxkin": _repeated(lambda: jax.block_until_ready(kernel(robot, arguments)), calls),
    }
    if numba_spatial.segment_distances:
        ends = np.moveaxis(np.asarray(jax.vmap(lambda p: _tlpm_wrist.links(robot, p))(pose.T)), 0, -1)
        start, run = np.ascontiguousarray(ends[:, 0]), np.ascontiguousarray(ends[:, 1] - ends[:, 0])
        out, bound = np.empty((12, KERNEL_BLOCK)), np.sqrt(2.0) * float(robot.a)
        names = {name: k for k, name in enumerate(_tlpm_wrist.LINK_NAMES)}
        pairs = np.array([[names[link] for link in pair.split("-")] for pair in _tlpm_wrist.CLEARANCE_NAMES])
        runs["numba"] = lambda: [numba_spatial.segment_distances(start, run, pairs, bound, out) for _ in range(calls)][
            -1
        ]
    times = Times(runs)
    metrics = [throughput("spatial: TLPM, 12 clearances, kernel in cache", SAMPLES, times.median("jaxkin"), 1)]
    if "numba" in runs:
        ratio = times.ratio("numba", "jaxkin")
        metrics.append(speedup("spatial: TLPM, 12 clearances / numba's distances alone", ratio, 0.5))
        unlike = _unlike(np.stack([np.asarray(array) for array in kernel(robot, arguments)]), out)
        metrics.append(mistakes("spatial: TLPM, 12 clearances, unlike numba's", unlike))
    grid = jk.Grid(**{axis.name: (*REACH, 64) for axis in robot.pose_axes})
    return metrics + _swept("TLPM, all margins", "limit_margins", robot, grid, {}, 1)


def operations(function: Callable, *arguments: object) -> Counter[str]:
    """Counts arithmetic on arrays in the compiled program, repetitions in several loops included."""
    text = jax.jit(function).lower(*arguments).compile().as_text()
    return Counter(op for op in re.findall(r"= f64\[\d[\d,]*\]\S* ([a-z]+)\(", text) if op in OPERATIONS)


def _operations(robot, rng: np.random.Generator) -> list[Metric]:
    given = tuple(rng.uniform(-0.3, 0.3, (6, 64)))
    kernels = {
        "inverse": lambda robot, pose: robot.inverse_kernel(pose)[0].values,
        "forward, one Euler triple": lambda robot, joints: robot.forward_kernel(joints)[0].values,
        "forward, one frame": lambda robot, joints: robot.frame_kernel(joints)[0].values,
        "forward, four frames": lambda robot, joints: [lane.values for lane in robot.frame_kernel(joints)],
    }
    known = operations(lambda x, y: (x * y + x, x / (x * x + 1)), *given[:2])
    expected = Counter(multiply=2, add=2, divide=1)
    metrics = [mistakes("spatial: operations miscounted in a known program", 0 if known == expected else 1)]
    for name, kernel in kernels.items():
        counts = operations(kernel, robot, given)
        metrics += [
            Metric(f"spatial: 3-PPPS {name}, {op}", counts[op], "a sample", "lower") for op in OPERATIONS if counts[op]
        ]
    return metrics
