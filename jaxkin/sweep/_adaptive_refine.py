"""Refinement: cells whose samples differ are halved, and what is met of a boundary is followed to single steps.

After every round the same holds: a cell of more than one step has known samples of one label only, wherever in it, on
its faces too. So a boundary that enters a cell through a face shared with finer ones splits it as well.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from jaxkin.core.errors import InputError
from jaxkin.sweep._adaptive_lattice import MIXED, PROVED, UNPROVED, UNTRIED, Lattice, Tree
from jaxkin.sweep._adaptive_proof import Prover
from jaxkin.sweep._adaptive_samples import Samples
from jaxkin.sweep.fields import Variable
from jaxkin.sweep.units import counted

#: Samples whose cells are looked up together.
_CHUNK = 1 << 17
#: The error estimate holds with this probability, over all rounds of probes together.
CONFIDENCE = 0.95
#: For so many probes of cells without proof one sample of a proved cell is asked for, against wrong walls.
_CHECKS = 4


@dataclass
class Probes:
    """What random samples said of cells that are constant by their known samples alone.

    Attributes:
        seed: Of the random numbers.
        asked: Probes in all.
        rounds: Rounds; all but the last one found something.
        hits: Probes that differed from their cell, which was then split.
        bound: With a probability of 95 % no larger share of the grid's samples differs from its cell's label. NaN where
            no probe was asked for.
    """

    seed: int
    asked: int = 0
    rounds: int = 0
    hits: int = 0
    bound: float = float("nan")


@dataclass
class Refinement:
    """One adaptive sweep under way.

    Attributes:
        lattice: The cells.
        samples: The samples.
        tree: The leaves.
        prover: Bounds the field's walls; None where it has none or no proof is asked for.
        proof_size: Cells of more steps are split until they are proved.
        name: The field's, for messages.
        variables: The field's variables.
    """

    lattice: Lattice
    samples: Samples
    prover: Prover | None
    proof_size: int
    name: str
    variables: tuple[Variable, ...]
    tree: Tree = field(init=False)

    def __post_init__(self) -> None:
        """Starts with no cell."""
        self.tree = Tree(self.lattice)

    def start(self) -> None:
        """Evaluates the coarsest cells and refines them until nothing known is left to do."""
        low = self.lattice.coarsest()
        pending = self._plant(np.zeros(0, np.int64), low, np.full(len(low), self.lattice.stride))
        self._settle(pending)

    def probe(self, probes: Probes, count: int) -> None:
        """Asks for random samples, in rounds of so many, until one of them finds nothing new."""
        draw = np.random.default_rng(probes.seed)
        self._check_proofs(draw, -(-count // _CHECKS))
        while True:
            tree = self.tree
            open_cells = np.flatnonzero(tree.constant & (tree.size > 1) & (tree.proof != PROVED))
            if not len(open_cells):
                probes.bound = 0.0
                return
            place, which, population = self._drawn(draw, open_cells, count)
            self.samples.meet(place)
            keys = self.lattice.keys(place)
            probes.asked, probes.rounds = probes.asked + count, probes.rounds + 1
            hits = int(np.sum(self.samples.labels(keys) != tree.label[which]))
            if not hits:
                probes.bound = _bound(count, probes.rounds) * population / math.prod(self.lattice.shape)
                return
            probes.hits += hits
            self._settle(np.unique(keys))

    def _drawn(self, draw: np.random.Generator, cells: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, int]:
        """Draws samples of cells, all as likely: their places, in which cells, and of how many samples."""
        sides = self.lattice.high(self.tree.low[cells], self.tree.size[cells]) - self.tree.low[cells]
        ends = np.cumsum(np.prod(sides, axis=1))
        which = np.searchsorted(ends, draw.integers(ends[-1], size=count), side="right")
        return self.tree.low[cells][which] + draw.integers(sides[which]), cells[which], int(ends[-1])

    def _check_proofs(self, draw: np.random.Generator, count: int) -> None:
        """Samples proved cells: no proof is better than the walls that a field declares."""
        proved = np.flatnonzero((self.tree.size > 1) & (self.tree.proof == PROVED))
        if len(proved):
            place, _, _ = self._drawn(draw, proved, count)
            self.samples.meet(place)
            self._settle(np.unique(self.lattice.keys(place)))

    def _settle(self, pending: np.ndarray) -> None:
        """Splits until no known sample differs from a cell of more than one step, and no proof is left to try."""
        while True:
            split, wrong = self._to_split(pending)
            if not len(split):
                split = self._without_proof()
            if not len(split):
                # Rounds look at fresh samples only, which costs less; all of them are looked at in the end.
                found = [self._differing(part) for part in self.samples.parts(_CHUNK)]
                split, wrong = (np.unique(np.concatenate(parts)) for parts in zip(*found, strict=True))
            if not len(split):
                return
            low, size = self.lattice.children(self.tree.low[split], self.tree.size[split])
            pending = np.concatenate([wrong, self._plant(split, low, size)])

    def _plant(self, gone: np.ndarray, low: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Evaluates new cells and puts them in the place of others; returns the fresh samples."""
        points = self.lattice.points(low, size)
        fresh = self.samples.meet(points.reshape(-1, self.lattice.dimension))
        labels = self.samples.labels(self.lattice.keys(points))
        label = np.where(np.all(labels == labels[:, :1], axis=1), labels[:, 0], MIXED)
        self.tree.replace(gone, low, size, label)
        return fresh

    def _to_split(self, pending: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mixed = np.flatnonzero(~self.tree.constant & (self.tree.size > 1))
        differing, wrong = self._differing(pending)
        return np.union1d(mixed, differing), wrong

    def _differing(self, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the constant cells of more than one step that known samples differ from, and these samples."""
        tree = self.tree
        cells, which = self.lattice.around(self.lattice.places(keys))
        leaf = tree.locate(cells)
        label = self.samples.labels(keys)[which]
        bad = tree.constant[leaf] & (tree.size[leaf] > 1) & (tree.label[leaf] != label)
        contradicted = leaf[bad][tree.proof[leaf[bad]] == PROVED]
        if len(contradicted):
            raise InputError(
                f"Field {self.name!r}: a cell of {counted(int(tree.size[contradicted[0]]), 'step')} from sample "
                f"{tree.low[contradicted[0]].tolist()} holds no wall and two labels: its walls must bound all its "
                "labels; declare the missing ones, or leave proofs out with jk.Adaptive(proof=0)."
            )
        return np.unique(leaf[bad]), np.unique(keys[which[bad]])

    def _without_proof(self) -> np.ndarray:
        """Tries to prove constant cells that were not tried, and returns those to split because it failed."""
        tree = self.tree
        if self.prover is None:
            return np.zeros(0, np.int64)
        ask = np.flatnonzero(tree.constant & (tree.proof == UNTRIED))
        tree.proof[ask] = np.where(self.prover.proved(tree.low[ask], tree.size[ask]), PROVED, UNPROVED)
        return np.flatnonzero((tree.proof == UNPROVED) & (tree.size > self.proof_size))


def _bound(count: int, rounds: int) -> float:
    """Returns the share that so many probes without a hit exclude.

    Of n probes none hits a share e with a probability of at most exp(-n e): the rule of three. Every round may stop the
    search, so each spends its part of the 5 %, of which 1 / (r (r + 1)) add up to one.
    """
    return min(1.0, -float(np.log((1 - CONFIDENCE) / (rounds * (rounds + 1)))) / count)
