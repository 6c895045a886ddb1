"""Adaptive sweeps: fields that are constant in cells, sampled where they change.

The grid is the finest lattice: a dense sweep over it is what an adaptive one reproduces, at a cost that grows with the
boundaries between labels. Nothing is interpolated and nothing is guessed: the result says which cells are proved
constant, which are constant as far as samples go, and which hold a boundary.
"""

import json
import math
import time
from dataclasses import asdict, dataclass
from numbers import Integral
from typing import TYPE_CHECKING, Any

from jaxkin.core.errors import InputError, SweepInterrupted
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.provenance import Request, run_log
from jaxkin.core.words import given
from jaxkin.sweep._adaptive_labels import labelling
from jaxkin.sweep._adaptive_lattice import Lattice
from jaxkin.sweep._adaptive_proof import Prover
from jaxkin.sweep._adaptive_refine import Probes, Refinement
from jaxkin.sweep._adaptive_samples import Evaluator, Samples
from jaxkin.sweep.designs import SAID
from jaxkin.sweep.fields import Field
from jaxkin.sweep.grid import BoundGrid
from jaxkin.sweep.progress import Progress
from jaxkin.sweep.units import counted

if TYPE_CHECKING:
    from jaxkin.sweep._adaptive_result import AdaptiveSweep

#: Steps along a side of the coarsest cells, where the grid has so many, and none were asked for.
_STRIDE = 32
#: Coarsest cells that are held at most.
_MOST_CELLS = 10**7
#: Raise it when the same request gives other cells.
_VERSION = 1


@dataclass(frozen=True)
class Adaptive:
    """How an adaptive sweep refines.

    Attributes:
        stride: Grid steps along a side of the coarsest cells, a power of two; 32 by default, or fewer where no axis has
            so many steps. Whatever holds a box of this size is met.
        probes: Random samples in each round of the error estimate; 0 for none. A round that finds nothing bounds what
            was missed to about 4 / probes of the grid with 95 %.
        seed: Of the random samples.
        proof: Cells of more grid steps are split until they are proved constant, where the field has walls that
            can prove it: 1 proves all that can be, 0 tries no proof.
        label: What is constant in cells, where the field leaves a choice: ``"sign"`` of a real field, or the name of
            one of its discrete variables.

    Raises:
        InputError: A number is not whole or out of range.
    """

    stride: int | None = None
    probes: int = 4000
    seed: int = 0
    proof: int = 1
    label: str | None = None

    def __post_init__(self) -> None:
        """Checks the numbers."""
        for name in ("probes", "seed", "proof"):
            object.__setattr__(self, name, _whole(name, getattr(self, name), 0))
        if self.stride is not None:
            object.__setattr__(self, "stride", _whole("stride", self.stride, 1))
            if self.stride & (self.stride - 1):
                below = 1 << (self.stride.bit_length() - 1)
                raise InputError(
                    f"{given('jk.Adaptive: stride')} is {self.stride}: it must be a power of two, so that cells can be "
                    f"halved to one grid step; take {below} or {2 * below}."
                )
        if self.label is not None and not isinstance(self.label, str):
            raise InputError(f"jk.Adaptive: label is {self.label!r}: give the name of a variable, 'sign', or None.")


def _whole(name: str, value: Any, least: int) -> int:
    """Returns a number as the request holds it, a plain int."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < least:
        raise InputError(
            f"{given(f'jk.Adaptive: {name}')} is {value!r}: it must be a whole number of at least {least}."
        )
    return int(value)


def adaptive_options(adaptive: "bool | Adaptive | None") -> Adaptive | None:
    """Returns the options that ``jk.sweep`` was given, None for a dense sweep.

    Raises:
        InputError: It is something else.
    """
    if adaptive is None or adaptive is False:
        return None
    if adaptive is True:
        return Adaptive()
    if not isinstance(adaptive, Adaptive):
        raise InputError(f"jk.sweep: adaptive is {adaptive!r}: it must be True, False or jk.Adaptive(...).")
    return adaptive


def adaptive_sweep(
    robot: Mechanism,
    field: Field,
    grid: BoundGrid,
    request: Request,
    options: Adaptive,
    workers: int,
    progress: bool | None = None,
) -> "AdaptiveSweep":
    """Sweeps a field adaptively; what ``jk.sweep(..., adaptive=...)`` calls.

    Args:
        robot: The mechanism.
        field: A field with a label (``jaxkin.sweep._adaptive_labels``).
        grid: The grid, which is the finest lattice.
        request: That of the dense sweep; the options become a part of it.
        options: How to refine.
        workers: Threads.
        progress: As for ``jk.sweep``.

    Raises:
        InputError: The field has no label, the stride is larger than the grid, or the field's walls are wrong.
        SweepInterrupted: Ctrl-C; ``.dataset`` holds the cells so far, whose attribute ``complete`` is 0.
    """
    started = time.perf_counter()
    label = labelling(robot, field, options.label)
    lattice = _lattice(grid, options)
    evaluate = Evaluator(robot, field, grid, workers)
    walls = field.walls(robot) if options.proof else None
    prover = None if walls is None else Prover(robot, walls, grid, lattice)
    probes = Probes(options.seed)
    content = {**request.content, "adaptive": {**asdict(options), "stride": lattice.stride, "version": _VERSION}}

    with Progress(0, field.name, show=progress) as bar:
        samples = Samples(lattice, evaluate, label, bar.add)
        refinement = Refinement(lattice, samples, prover, options.proof, field.name, field.variables(robot))

        def result(complete: bool) -> "AdaptiveSweep":
            from jaxkin.sweep._adaptive_result import assemble

            log = run_log(seconds=round(time.perf_counter() - started, 3), workers=workers)
            found = assemble(refinement, label, grid, Request(content), probes, json.dumps(log), complete)
            if not field.traced:
                refused = samples.values[field.variables(robot)[-1].name]
                found.attrs |= {"untraced": SAID, "refused_designs": int(refused.sum())}
            return found

        try:
            refinement.start()
            if options.probes:
                refinement.probe(probes, options.probes)
        except KeyboardInterrupt:
            if not len(refinement.tree):
                raise
            message = f"Stopped after {counted(samples.evaluated, 'sample')} of an adaptive sweep."
            raise SweepInterrupted(message, result(False), samples.evaluated) from None
        return result(True)


def _lattice(grid: BoundGrid, options: Adaptive) -> Lattice:
    steps = tuple(n - (grid.axes[k].period is None) for k, n in zip(grid.free, grid.shape, strict=True))
    largest = 1 << (max(steps).bit_length() - 1)
    stride = min(_STRIDE, largest) if options.stride is None else options.stride
    if stride > max(steps):
        raise InputError(
            f"{given('jk.Adaptive: stride')} is {stride} and the grid has at most {counted(max(steps), 'step')} along "
            f"an axis: choose {largest} or less."
        )
    coarse = math.prod(math.ceil(count / stride) for count in steps)
    if coarse > _MOST_CELLS:
        raise InputError(
            f"The grid has {coarse:.3g} coarsest cells of {counted(stride, 'step')}, more than memory can hold: use "
            "fewer samples, or a larger stride."
        )
    lattice = Lattice(grid.shape, steps, stride)
    lattice.check()
    return lattice
