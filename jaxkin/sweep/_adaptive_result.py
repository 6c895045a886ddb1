"""What an adaptive sweep found: labelled cells with their evidence, as an ``xarray.Dataset`` with two methods more."""

import json
import math
from typing import Any

import numpy as np
import xarray

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Axis
from jaxkin.core.provenance import Request
from jaxkin.sweep import result as labelled
from jaxkin.sweep._adaptive_dense import CellMap
from jaxkin.sweep._adaptive_labels import Labelling
from jaxkin.sweep._adaptive_lattice import PROVED, Lattice
from jaxkin.sweep._adaptive_proof import corner_coordinates
from jaxkin.sweep._adaptive_refine import Probes, Refinement
from jaxkin.sweep.fields import Variable
from jaxkin.sweep.grid import BoundGrid, Grid, Span
from jaxkin.sweep.units import counted

#: Values of the variable ``constant``.
BOUNDARY, SAMPLED, PROVED_CONSTANT = 0, 1, 2
#: What is stored of each sample besides its label has this in its name.
AT_SAMPLES = "_at_samples"
#: Attribute of a stored result that holds its coordinates of text, as in the stores of dense sweeps.
_NAMES = "labels"


class AdaptiveSweep(xarray.Dataset):
    """Cells in which a field is constant, and the evidence for it; an ``xarray.Dataset`` made by ``jk.sweep``.

    Variables over ``cell``: the label (the field's own variable), ``low`` and ``high`` corners ``(cell, axis)``,
    ``place`` and ``size`` in grid steps, ``level`` (0 for the coarsest), and ``constant``: 0 the cell is one grid step
    wide and its corners differ (its label is the one of most of them), 1 all samples met in it are alike, 2 it is
    proved constant. Variables over ``sample`` hold what was evaluated.

    What always holds: a part of one label that holds a box of the sides ``resolution`` is met; and a part of which one
    sample is met (samples joined through cells of one step, diagonals included) is reproduced to its last sample. Of
    other parts, ``missed_share_bound`` says how large a share of the grid's samples they are at most, with 95 %, from
    ``probes`` random samples in ``probe_rounds`` rounds by ``seed``. Where all cells of more than one step are proved
    nothing is missed; a proof holds for exact values of the field, and is as good as the walls that it declares.
    """

    __slots__ = ()

    @classmethod
    def of(cls, dataset: xarray.Dataset) -> "AdaptiveSweep":
        """Returns a dataset, read from a file for instance, with these methods again."""
        attrs = dict(dataset.attrs)
        names = json.loads(attrs.pop(_NAMES, "{}"))
        return cls(dataset.data_vars, coords=dataset.coords, attrs=attrs).assign_coords(names)

    def to_zarr(self, *args: Any, **kwargs: Any) -> Any:
        """Writes the result as ``xarray.Dataset.to_zarr`` does, with coordinates of text as an attribute.

        ``jk.AdaptiveSweep.of`` makes coordinates of them again.
        """
        # Zarr 3 has no settled format for text.
        names = {str(name): each.values.tolist() for name, each in self.coords.items() if each.dtype.kind in "UTO"}
        plain = self.to_dataset().drop_vars(names).assign_attrs({_NAMES: json.dumps(names)})
        return plain.to_zarr(*args, **kwargs)

    def to_dataset(self) -> xarray.Dataset:
        """Returns a plain ``xarray.Dataset`` of the same content."""
        return xarray.Dataset(self.data_vars, coords=self.coords, attrs=self.attrs)

    @property
    def label(self) -> xarray.DataArray:
        """The label of each cell."""
        return self[self.attrs["label"]]

    def to_dense(self, grid: Grid | None = None) -> xarray.Dataset:
        """Returns the map on a product grid, as a dense sweep does.

        Args:
            grid: Over the same axes, with the same ones fixed at the same values; by default the grid of the sweep, of
                which every sample is reproduced. Elsewhere a sample takes the label of its cell, at a boundary that of
                the nearest evaluated corner; outside the cells it is ``not_computed``.

        Returns:
            The label over the grid; on the own grid the field's other variables too, where they were evaluated.

        Raises:
            InputError: The grid has other axes.
        """
        if not self._is_whole():
            raise InputError("to_dense needs all cells of the sweep: call it first, and select of what it returns.")
        own = self._grid()
        bound = own if grid is None else self._bound(grid, own)
        variable = _variable_of(self.label)
        cells = CellMap(self._lattice(), self.place.values, self["size"].values, self.constant.values != BOUNDARY)
        samples = self.sample_place.values
        label = np.moveaxis(self.label.values, -1, 0)
        at_samples = np.moveaxis(self[f"{variable.name}{AT_SAMPLES}"].values, -1, 0)
        if grid is None:
            dense = {variable.name: cells.own(label, at_samples, samples)}
            others = [name for name in self.data_vars if str(name).endswith(AT_SAMPLES)]
            variables = [variable]
            for name in others:
                other = _variable_of(self[name], str(name).removesuffix(AT_SAMPLES))
                if other.name != variable.name:
                    variables.append(other)
                    dense[other.name] = cells.scattered(np.moveaxis(self[name].values, -1, 0), samples, other.missing)
        else:
            dense = {
                variable.name: cells.nearest(self._steps(bound, own), label, at_samples, samples, variable.missing)
            }
            variables = [variable]
        made = {
            v.name: (labelled.variable_dims(v, bound), dense[v.name], labelled.variable_attrs(v)) for v in variables
        }
        names = {name: list(values) for v in variables for name, values in v.dims}
        kept = {
            key: self.attrs[key] for key in ("mechanism", "field", "request", "request_hash", "complete", "run_log")
        }
        return xarray.Dataset(made, coords={**labelled.axis_coordinates(bound), **names}, attrs=kept)

    def measure(self) -> xarray.Dataset:
        """Returns the area or volume of each label (of each branch), in the product of the axes' units.

        Returns:
            ``measure``: constant cells, and boundary cells shared by their corners; ``low`` and ``high``: without, and
            with all boundary cells that have a corner of the label; both hold where constant cells are what their
            samples say. ``proved_low`` and ``proved_high`` hold without that: cells proved, and all that is not proved
            to be another label. Attributes: ``total``, ``boundary``, ``proved``, ``sampled``.
        """
        from jaxkin.sweep._adaptive_measure import measured

        return measured(self, self._lattice())

    def __repr__(self) -> str:
        """A summary of a few lines."""
        return _summary(self) if self._is_whole() else super().__repr__()

    def _is_whole(self) -> bool:
        """False for what was selected of a result: evidence holds for all cells together."""
        if not {"place", "size", "constant"} <= set(self.data_vars) or "label" not in self.attrs:
            return False
        if {"cell", "sample", "axis"} - set(self.dims):
            return False
        lattice = self._lattice()
        place, size = self.place.values.astype(np.int64), self["size"].values.astype(np.int64)
        return bool(np.prod(lattice.high(place, size) - place, axis=1).sum() == math.prod(lattice.steps))

    def _axes(self) -> tuple[Axis, ...]:
        return tuple(Axis(**axis) for axis in json.loads(self.attrs["axes"]))

    def _grid(self) -> BoundGrid:
        content = json.loads(self.attrs["request"])["grid"]
        return Grid(**content).bind(self._axes(), "same")

    def _lattice(self) -> Lattice:
        grid, request = self._grid(), json.loads(self.attrs["request"])
        steps = tuple(n - (grid.axes[k].period is None) for k, n in zip(grid.free, grid.shape, strict=True))
        return Lattice(grid.shape, steps, request["adaptive"]["stride"])

    def _bound(self, grid: Grid, own: BoundGrid) -> BoundGrid:
        if not isinstance(grid, Grid):
            raise InputError(
                f"to_dense got {type(grid).__name__}: pass a jk.Grid, or nothing for the sweep's own grid."
            )
        bound = grid.bind(self._axes(), "same")
        for axis, mine, other in zip(own.axes, own.values, bound.values, strict=True):
            if isinstance(mine, Span) != isinstance(other, Span) or (not isinstance(mine, Span) and mine != other):
                raise InputError(
                    f"to_dense: the axis {axis.name!r} is {other!r} and was {mine!r} in the sweep: the same axes must "
                    "be free, and the others have the same values."
                )
        return bound

    def _steps(self, bound: BoundGrid, own: BoundGrid) -> list[np.ndarray]:
        """Returns the coordinates of another grid in steps of the own one, along each free axis."""
        found = []
        for k, ends in zip(own.free, corner_coordinates(own), strict=True):
            low, step = ends[0], (ends[-1] - ends[0]) / (len(ends) - 1)
            found.append((bound.coordinate(k) - low) / step)
        return found


def _variable_of(data: xarray.DataArray, name: str | None = None) -> Variable:
    """Returns the record of a variable of the field that stands over cells or samples."""
    dims = tuple((str(dim), tuple(data[dim].values.tolist())) for dim in data.dims[:-1])
    attrs = dict(data.attrs)
    missing: Any = attrs.pop("not_computed", False if data.dtype == bool else np.nan)
    unit, long_name = attrs.pop("units"), attrs.pop("long_name")
    return Variable(name or str(data.name), data.dtype.name, unit, long_name, dims, missing, attrs)


def assemble(
    refinement: Refinement,
    labels: Labelling,
    grid: BoundGrid,
    request: Request,
    probes: Probes,
    log: str,
    complete: bool,
) -> AdaptiveSweep:
    """Labels the cells and samples of a refinement."""
    tree, lattice, samples = refinement.tree, refinement.lattice, refinement.samples
    constant = np.where(tree.constant, np.where(tree.proof == PROVED, PROVED_CONSTANT, SAMPLED), BOUNDARY)
    high = lattice.high(tree.low, tree.size)
    variable = labels.variable
    lead = tuple(name for name, _ in variable.dims)
    ends = corner_coordinates(grid)
    axes = [grid.axes[k] for k in grid.free]
    units = {"units": ", ".join(f"{axis.name}: {axis.unit}" for axis in axes)}
    meanings = {"flag_values": [BOUNDARY, SAMPLED, PROVED_CONSTANT], "flag_meanings": "boundary sampled proved"}
    at = {variable.name: labels.values(samples.label)} | samples.values
    known = {v.name: v for v in refinement.variables}
    known[variable.name] = variable
    sampled = {
        f"{name}{AT_SAMPLES}": (
            (*(dim for dim, _ in known[name].dims), "sample"),
            values,
            labelled.variable_attrs(known[name]),
        )
        for name, values in at.items()
    }
    names = {dim: list(values) for v in known.values() for dim, values in v.dims}
    return AdaptiveSweep(
        {
            variable.name: (
                (*lead, "cell"),
                labels.values(_cell_labels(refinement)),
                labelled.variable_attrs(variable),
            ),
            "low": (("cell", "axis"), _corner(ends, tree.low), units),
            "high": (("cell", "axis"), _corner(ends, high), units),
            "place": (("cell", "axis"), tree.low.astype(np.int32), {"units": "grid steps"}),
            "size": ("cell", tree.size.astype(np.int32), {"units": "grid steps"}),
            "level": ("cell", np.round(np.log2(lattice.stride / tree.size)).astype(np.int8), {"units": "1"}),
            "constant": ("cell", constant.astype(np.int8), {"units": "1", **meanings}),
            "sample_place": (
                ("sample", "axis"),
                lattice.places(samples.keys).astype(np.int32),
                {"units": "grid steps"},
            ),
            **sampled,
        },
        coords={
            "axis": [axis.name for axis in axes],
            **{grid.axes[k].name: grid.coordinate(k)[0] for k in range(len(grid.axes)) if k not in grid.free},
            **names,
        },
        attrs=_evidence(refinement, grid, request, probes, variable, log, complete),
    )


def _corner(ends: list[np.ndarray], place: np.ndarray) -> np.ndarray:
    return np.stack([axis[row] for axis, row in zip(ends, place.T, strict=True)], axis=1)


def _cell_labels(refinement: Refinement) -> np.ndarray:
    """Returns the number of each cell's label: of a mixed one that of most corners, of the first among equals."""
    tree, lattice = refinement.tree, refinement.lattice
    number = tree.label.copy()
    mixed = np.flatnonzero(~tree.constant)
    corners = lattice.corners(tree.low[mixed], lattice.high(tree.low[mixed], tree.size[mixed]))
    labels = refinement.samples.labels(lattice.keys(corners))
    times = np.sum(labels[:, :, None] == labels[:, None, :], axis=1)
    number[mixed] = labels[np.arange(len(mixed)), np.argmax(times, axis=1)]
    return number


def _evidence(
    refinement: Refinement,
    grid: BoundGrid,
    request: Request,
    probes: Probes,
    variable: Variable,
    log: str,
    complete: bool,
) -> dict[str, Any]:
    lattice = refinement.lattice
    ends = corner_coordinates(grid)
    steps = [(axis[-1] - axis[0]) / n for axis, n in zip(ends, lattice.steps, strict=True)]
    names = [grid.axes[k].name for k in grid.free]
    sides = {
        name: float(step * min(lattice.stride, n)) for name, step, n in zip(names, steps, lattice.steps, strict=True)
    }
    axes = [{"name": axis.name, "unit": axis.unit, "period": axis.period} for axis in grid.axes]
    return {
        **labelled.request_attrs(request),
        "label": variable.name,
        "axes": json.dumps(axes),
        "grid_samples": grid.size,
        "evaluations": refinement.samples.evaluated,
        "resolution": json.dumps(sides),
        "walls": int(refinement.prover is not None),
        "probes": probes.asked,
        "probe_rounds": probes.rounds,
        "probe_hits": probes.hits,
        "seed": probes.seed,
        "missed_share_bound": probes.bound,
        "complete": int(complete),
        "run_log": log,
    }


def _summary(found: AdaptiveSweep) -> str:
    attrs, constant = found.attrs, found.constant.values
    size = found.high.values - found.low.values
    share = np.prod(size, axis=1) / np.sum(np.prod(size, axis=1))
    proved, sampled, boundary = (float(np.sum(share[constant == k])) for k in (PROVED_CONSTANT, SAMPLED, BOUNDARY))
    sides = ", ".join(f"{name} {side:.4g}" for name, side in json.loads(attrs["resolution"]).items())
    lines = [
        f"{attrs['field']} of {attrs['mechanism']} in {counted(found.sizes['cell'], 'cell')}"
        + ("" if attrs["complete"] else " (interrupted)"),
        f"  {attrs['evaluations']:,} of {counted(attrs['grid_samples'], 'sample')} evaluated "
        f"({attrs['evaluations'] / attrs['grid_samples']:.2%})",
        f"  measure: {proved:.2%} proved constant, {sampled:.2%} constant by samples, {boundary:.2%} in boundary cells",
        f"  nothing missed that holds a box of {sides}, or hangs together with what was met",
    ]
    if not attrs["complete"]:
        return "\n".join(lines[:-1])
    if not np.any((constant == SAMPLED) & (found["size"].values > 1)):
        lines.append("  every cell of more than one grid step is proved: no sample of the grid differs")
    elif attrs["probes"]:
        lines.append(
            f"  with 95 % at most {attrs['missed_share_bound']:.2e} of the samples differ "
            f"({counted(attrs['probes'], 'random probe')} in {counted(attrs['probe_rounds'], 'round')}, seed "
            f"{attrs['seed']}; {attrs['probe_hits']} found something)"
        )
    else:
        lines.append("  no estimate of what was missed: no random probes were asked for")
    return "\n".join(lines)
