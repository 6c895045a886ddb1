"""The one loop over samples: checked, cut into tiles, computed where there are workers, kept where it is asked for."""

import functools
import math
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxkin.core.errors import GeometryError, InputError, SweepInterrupted
from jaxkin.core.leaves import LeafPlace, leaf_places
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import Request, identity, run_log
from jaxkin.core.words import given
from jaxkin.kinematics.boundary import checked_mechanism
from jaxkin.sweep import fields
from jaxkin.sweep.adaptive import Adaptive, adaptive_options, adaptive_sweep
from jaxkin.sweep.designs import SAID, refusals
from jaxkin.sweep.fields import Field, Variable
from jaxkin.sweep.grid import BoundGrid, Grid
from jaxkin.sweep.memory import Memory
from jaxkin.sweep.plan import Plan, check_precision, make_plan
from jaxkin.sweep.progress import Progress
from jaxkin.sweep.single import single_error
from jaxkin.sweep.store import Store
from jaxkin.sweep.stored import open_store
from jaxkin.sweep.threads import cores, run_in_threads
from jaxkin.sweep.tiler import Tiler
from jaxkin.sweep.units import counted

if TYPE_CHECKING:
    import xarray

#: More tiles than this would take hours to list; more samples on one axis, gigabytes of coordinates.
_MOST_TILES, _MOST_ALONG = 10**7, 10**8


def sweep(
    robot: Mechanism,
    field: Field | str,
    grid: Grid,
    *,
    store: str | Path | None = None,
    overwrite: bool = False,
    workers: int | None = None,
    executor: Any = None,
    precision: str = "float64",
    progress: bool | None = None,
    adaptive: "bool | Adaptive" = False,
) -> "xarray.Dataset":
    """Computes a field at every sample of a grid.

    Args:
        robot: The mechanism.
        field: One of ``jk.fields``, its name, or a field of your own from ``jk.fields.from_function``.
        grid: A ``Grid`` over all axes of the field's space. Of a field over geometries, over any of the mechanism's
            numbers (``c3``, ``proximal[0]``, ``rho1_low``); those that it does not name stay as they are.
        store: Folder of a Zarr store for results that outlive the process or the memory; the same request
            goes on where it stopped. Without it the result is held in memory.
        overwrite: Replaces a jaxkin store, whatever request made it, and starts anew. Nothing else is ever replaced.
        workers: Threads that run compiled blocks side by side; the number of cores by default.
        executor: A ``dask.distributed.Client`` (extra ``scale``): its workers compute the tiles, and write them where
            there is a store, which must lie in a folder that all of them see. The result is the same, to the byte.
        precision: "float32" computes and stores floating-point fields of one configuration in half the bytes; the
            result's attribute ``float32_error`` says how far off it is, from samples computed in float64 as well.
        progress: True or False to force or forbid the progress bar; by default it shows on a terminal.
        adaptive: True or ``jk.Adaptive(...)`` for a field that is constant in cells (a count, a label, a sign): samples
            only where it changes, with a proof or an estimate that nothing larger than a stated size is missed. Held
            in memory.

    Returns:
        An ``xarray.Dataset`` whose main variable bears the field's name: dimensions in the mechanism's order
        of axes, fixed axes as scalar coordinates, units and the request in the attributes. From a store it
        is opened lazily. A field that cannot be traced is computed one design at a time and says so in the attribute
        ``untraced``; ``refused_designs`` counts those without a value, and ``first_refusal`` gives a reason. An
        adaptive one is a ``jk.AdaptiveSweep``, a dataset with the dimension ``cell`` and the methods ``to_dense`` and
        ``measure``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The field is unknown, the grid does not fit the mechanism, or an option is of the wrong kind.
        GeometryError: The mechanism's geometry is degenerate.
        StoreError: The store holds something else, is written by another process, or cannot be written.
        ClusterError: The executor has no workers, loses its scheduler, or has workers of other versions.
        SweepInterrupted: Ctrl-C; ``.dataset`` holds what was computed, and a store keeps it.
    """
    if store is not None and not isinstance(store, (str, Path)):
        raise InputError(f"jk.sweep: store is {store!r}: it must be the path of a folder, or None.")
    plan, request = planned("jk.sweep", robot, field, grid, precision)
    check_workers("jk.sweep", workers, executor)
    options = adaptive_options(adaptive)
    if options is not None:
        _check_adaptive(store, executor, precision)
        return adaptive_sweep(robot, plan.field, plan.grid, request, options, workers or cores(), progress)
    if store is None:
        check_size(plan)
    attrs = single_error(robot, plan) if precision == "float32" else {}
    attrs |= {} if plan.field.traced else {"untraced": SAID}
    if store is None:
        return _run(robot, plan, request, Memory(plan, request, attrs), workers, executor, progress)
    keeper = Store.open(Path(store), request, plan, attrs, overwrite=overwrite, show=progress)
    return _run(robot, plan, request, keeper, workers, executor, progress)


def planned(
    who: str, robot: Mechanism, field: Field | str, grid: Grid, precision: str = "float64"
) -> tuple[Plan, Request]:
    """Checks what a sweep is asked for; returns how it is cut and what determines its numbers.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The field is unknown, the grid does not fit the mechanism, or the precision is not enough.
        GeometryError: The mechanism's geometry is degenerate.
    """
    checked_mechanism(who, robot)
    field = fields.by_name(field) if isinstance(field, str) else field
    if not isinstance(field, Field) or not isinstance(grid, Grid):
        raise InputError(
            f"{who} got {type(field).__name__} and {type(grid).__name__}: pass a field (jk.fields.forward_count or "
            "its name) and a jk.Grid."
        )
    if not bool(np.all(robot.geometry_ok())):
        raise GeometryError(f"{robot}: the geometry is degenerate or not finite; build it with its constructor.")
    bound = bound_grid(robot, field, grid)
    field = field.over(tuple(axis.name for axis in bound.axes))
    check_precision(field, precision)
    plan = make_plan(robot, field, bound, precision)
    _check_names(plan)
    if plan.tiles > _MOST_TILES or max(bound.shape) > _MOST_ALONG:
        raise InputError(f"The grid has {bound.size:.3g} samples: that is more than one sweep can list; use fewer.")
    return plan, _request(robot, field, bound, plan.variables, precision)


def bound_grid(robot: Mechanism, field: Field, grid: Grid) -> BoundGrid:
    """Fits a grid to the axes of a field: all of a space, or some numbers of the geometry.

    Raises:
        InputError: The grid does not fit.
    """
    places, axes = leaf_places(robot), field.axes(robot)
    own = {axis.name for axis in axes}
    for name in grid.axes:
        if field.domain == "geometry" and name not in own:
            raise InputError(
                f"The grid has an axis {name!r}, which is no number of {robot.id or type(robot).__name__}'s geometry, "
                f"over which {field.name!r} is a field: choose among {', '.join(places)}."
            )
        if field.domain != "geometry" and name in places and name not in own:
            space = "joints" if field.domain == "joints" else "poses"
            raise InputError(
                f"The grid has an axis {name!r}, which is a number of the geometry, and {field.name!r} is a field over "
                f"{space} ({', '.join(axis.name for axis in axes)}): sweep a field over geometries, or change the "
                "number in the mechanism."
            )
    if field.domain != "geometry":
        return grid.bind(axes, "joint" if field.domain == "joints" else "pose")
    _check_numbers_once(places, grid)
    return grid.bind(axes, "geometry", every=False)


def _check_numbers_once(places: dict[str, LeafPlace], grid: Grid) -> None:
    """Refuses a grid that names an entry of a vector, and the whole of it."""
    whole = {places[name].field: name for name in grid.axes if name == places[name].field}
    for name in grid.axes:
        if whole.get(places[name].field, name) != name:
            raise InputError(
                f"The grid has the axes {whole[places[name].field]!r} and {name!r}, which is an entry of it: leave one "
                "of them out."
            )


def _check_names(plan: Plan) -> None:
    """Refuses a variable that bears the name of a coordinate of the result."""
    coordinates = {axis.name for axis in plan.grid.axes} | {name for v in plan.variables for name, _ in v.dims}
    for variable in plan.variables:
        if variable.name in coordinates:
            raise InputError(
                f"Field {plan.field.name!r} has a variable {variable.name!r}, which is the name of an axis of the "
                "result: give it another name."
            )


def check_workers(who: str, workers: int | None, executor: Any = None) -> None:
    """Refuses what cannot be the number of threads, or an executor that is closed.

    Raises:
        InputError: It is one of these.
        ClusterError: The executor is closed.
    """
    if workers is not None and (not isinstance(workers, int) or isinstance(workers, bool) or workers < 1):
        raise InputError(f"{who}: workers is {workers!r}: it must be a whole number of threads, at least 1.")
    if workers is not None and executor is not None:
        raise InputError(
            f"{given('workers')} is {workers}, and {given('executor')} is given as well: the cluster's workers have "
            "their own threads; leave one of the two out."
        )
    if executor is not None:
        from jaxkin.sweep.cluster import check_open

        check_open(executor)


def _check_adaptive(store: str | Path | None, executor: Any, precision: str) -> None:
    who = given("jk.sweep: ")
    for name, value in (("store", store), ("executor", executor)):
        if value is not None:
            raise InputError(
                f"{who}adaptive sweeps are computed and held in this process: leave {given(name)} out, and "
                f"{given('write the result, which is an xarray.Dataset')}."
            )
    if precision != "float64":
        need = given("precision='float64'")
        raise InputError(f"{who}adaptive sweeps tell labels apart, which needs {need}.")


def check_size(plan: Plan) -> None:
    """Refuses a result that this machine cannot hold, before anything is allocated.

    Raises:
        InputError: It cannot.
    """
    size = plan.grid.size
    need = size * plan.sample_bytes
    have = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") if hasattr(os, "sysconf") else math.inf
    if need > 0.8 * have:
        raise InputError(
            f"The grid has {size:.3g} samples, which need {need / 1e9:.0f} GB; this machine has {have / 1e9:.0f} GB: "
            f"give {given('store=...')}, or use fewer samples."
        )


def _request(
    robot: Mechanism, field: Field, grid: BoundGrid, variables: tuple[Variable, ...], precision: str
) -> Request:
    from jaxkin.core.precision import TOLERANCES

    return Request(
        {
            **identity(robot),
            "field": {"name": field.name, "version": field.version},
            "variables": [variable.name for variable in variables],
            "grid": grid.content(),
            "tolerances": vars(TOLERANCES),
            "precision": precision,
        }
    )


def _run(
    robot: Mechanism,
    plan: Plan,
    request: Request,
    keeper: Memory | Store,
    workers: int | None,
    executor: Any,
    show: bool | None,
) -> "xarray.Dataset":
    """Computes what is missing, and returns the result, or what there is of it where the user stops the work."""
    started = time.perf_counter()
    todo = np.flatnonzero(~keeper.done)
    workers = max(1, min(workers or cores(), len(todo)))
    entries: dict[str, Any] = {"workers": workers if executor is None else str(executor)}
    if isinstance(keeper, Store):
        entries["tiles_kept"] = int(keeper.done.sum())
        entries["recomputed_tiles"] = keeper.damaged
        entries["rewritten_coordinates"] = keeper.mended
    worked = bool(len(todo) or entries.get("rewritten_coordinates"))
    finish = functools.partial(_finish, robot, plan, keeper, worked, started, entries)
    try:
        if len(todo):
            with Progress(plan.grid.size, plan.field.name, plan.samples_of(keeper.done), show) as bar:
                for number in _tiles_done(robot, plan, request, keeper, todo, workers, executor):
                    bar.add(plan.samples(number))
    except KeyboardInterrupt:
        done = plan.samples_of(keeper.done)
        kept = f"; the finished tiles are in {keeper.path}, the same request goes on there" if keeper.path else ""
        samples = counted(plan.grid.size, "sample")
        raise SweepInterrupted(f"Stopped after {done:,} of {samples}{kept}.", finish(), done) from None
    except BaseException:
        keeper.close(None)
        raise
    return finish()


def _tiles_done(
    robot: Mechanism,
    plan: Plan,
    request: Request,
    keeper: Memory | Store,
    todo: np.ndarray,
    workers: int,
    executor: Any,
) -> Iterator[int]:
    """Yields every tile when it is kept."""
    if executor is not None:
        from jaxkin.sweep.cluster import run_on_cluster

        return run_on_cluster(executor, robot, plan, request, keeper, todo.tolist())
    tiler = Tiler(robot, plan)

    def work(number: int) -> None:
        arrays = keeper.room(number)
        tiler.compute(plan.box(number), arrays)
        keeper.keep(number, arrays)

    return run_in_threads(work, todo.tolist(), workers)


def _finish(
    robot: Mechanism, plan: Plan, keeper: Memory | Store, worked: bool, started: float, entries: dict[str, Any]
) -> "xarray.Dataset":
    if not plan.field.traced:
        keeper.describe(refusals(plan.field, robot, plan.grid, keeper.values(plan.variables[-1].name)))
    log = run_log(seconds=round(time.perf_counter() - started, 3), **entries)
    keeper.close(log if worked else None)
    return keeper.dataset(log) if isinstance(keeper, Memory) else open_store(keeper.path)
