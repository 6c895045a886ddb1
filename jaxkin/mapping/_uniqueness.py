"""Uniqueness domains: unions of basic regions over which no joint value has two poses."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from jaxkin.mapping.named import NamedParts


@dataclass(frozen=True, eq=False)
class UniquenessDomain:
    """A maximal connected union of adjacent basic regions of one aspect whose components are disjoint.

    Attributes:
        name: Aspect and number.
        aspect: Number of the aspect.
        regions: Numbers of its basic regions, ascending.
        components: Numbers of their components, all different.
        curves: The characteristic curves between its regions, ``(k, n_pose)`` each: they belong to it.
    """

    name: str
    aspect: int
    regions: tuple[int, ...]
    components: tuple[int, ...]
    curves: tuple[np.ndarray, ...]

    def __len__(self) -> int:
        """Number of basic regions."""
        return len(self.regions)


@dataclass(frozen=True, eq=False)
class UniquenessDomains(NamedParts[UniquenessDomain]):
    """Uniqueness domains.

    Attributes:
        domains: The domains, by their basic regions.
        complete: True where all were enumerated; False where the number of unions looked at was reached.
    """

    domains: tuple[UniquenessDomain, ...]
    complete: bool

    kind: ClassVar[str] = "uniqueness domains"

    @property
    def parts(self) -> tuple[UniquenessDomain, ...]:
        """The domains."""
        return self.domains

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [f"{len(self)} uniqueness domains" + ("" if self.complete else ", not all")]
        return "\n".join([*lines, *(f"  {d.name}: basic regions {', '.join(map(str, d.regions))}" for d in self)])


def maximal_unions(
    neighbours: list[set[int]], clashes: list[set[int]], excluded: set[int], most: int
) -> tuple[list[tuple[int, ...]], bool]:
    """Enumerates the maximal connected sets of nodes without a clash.

    Every connected set without clash is grown by one neighbour at a time from single nodes, each set once; those that
    nothing can be added to are maximal (a larger connected set would contain a neighbour that can be added).

    Args:
        neighbours: Which nodes are adjacent to each.
        clashes: Which nodes may not stand together with each.
        excluded: Nodes that may stand nowhere.
        most: How many sets are looked at; beyond, each of the sets reached is only completed by the first neighbour
            that fits, again and again.

    Returns:
        The maximal sets, ascending, and True where all were enumerated.
    """
    waiting = [frozenset([node]) for node in range(len(neighbours)) if node not in excluded]
    seen, found = set(waiting), set[frozenset[int]]()
    complete = True
    while waiting:
        union = waiting.pop()
        more = _fitting(union, neighbours, clashes, excluded)
        if not more:
            found.add(union)
            continue
        complete = complete and len(seen) < most
        for node in more if len(seen) < most else more[:1]:
            larger = union | {node}
            if larger not in seen:
                seen.add(larger)
                waiting.append(larger)
    return sorted(tuple(sorted(union)) for union in found), complete


def _fitting(
    union: frozenset[int], neighbours: list[set[int]], clashes: list[set[int]], excluded: set[int]
) -> list[int]:
    around = set[int]().union(*(neighbours[node] for node in union)) - union - excluded
    return sorted(node for node in around if not clashes[node] & union)
