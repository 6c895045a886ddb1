"""Where the number of cusps of a section changes: from monotone pieces of the cusp curves, without a section (no JAX).

A joint rises or falls strictly along a cusp curve between its critical points and the ends. The section at a value has
one cusp pose for every piece whose range holds the value, so that the number between two transitions is exact, however
close they are. Pieces that have the same image (by a symmetry of the mechanism) count as one cusp.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Transitions:
    """All values of one joint at which the number of cusps of the section through it changes.

    Attributes:
        axis: Name of the joint.
        range: The ends between which the values lie.
        values: ``(n,)`` ascending.
        counts: ``(n, 2)`` number of cusps (distinct joint points) below and above.
        poses_counts: ``(n, 2)`` the same in cusp poses, of which several may share one joint point.
        kinds: n texts: ``"swallowtail"`` (the cusp curve is tangent to the kernel: two cusps and a node vanish),
            ``"lips"`` and ``"beaks"`` (the section is tangent to the singular surface; with definite and indefinite
            Hessian), ``"end"`` (a cusp curve ends on a border or where its poses cease to be real).
        joints: ``(n, n_joint)`` where it happens.
        poses: n arrays ``(k_i, n_pose)``.
        error: ``(n,)`` estimated error of the values, in their unit.
        joint_names: Names of the joint axes.
        doubts: What makes a count doubtful, in words; empty where nothing does.
    """

    axis: str
    range: tuple[float, float]
    values: np.ndarray
    counts: np.ndarray
    poses_counts: np.ndarray
    kinds: tuple[str, ...]
    joints: np.ndarray
    poses: tuple[np.ndarray, ...]
    error: np.ndarray
    joint_names: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of transitions."""
        return len(self.values)

    def __str__(self) -> str:
        """A summary of a few lines."""
        low, high = self.range
        lines = [f"{len(self)} transitions of the number of cusps for {self.axis} in {low:g} .. {high:g}"]
        lines += [
            f"  {self.axis} = {value:.12g}: {below} to {above}, {kind} (error {error:.0e})"
            for value, (below, above), kind, error in zip(self.values, self.counts, self.kinds, self.error, strict=True)
        ]
        return "\n".join([*lines, *(f"  DOUBTFUL: {doubt}" for doubt in self.doubts)])

    def content(self) -> dict[str, object]:
        """Returns everything as lists and numbers, for JSON."""
        return {
            "axis": self.axis,
            "range": list(self.range),
            "transitions": [
                {
                    "value": float(self.values[k]),
                    "below": int(self.counts[k, 0]),
                    "above": int(self.counts[k, 1]),
                    "kind": self.kinds[k],
                    "joints": self.joints[k].tolist(),
                    "poses": self.poses[k].tolist(),
                    "error": float(self.error[k]),
                }
                for k in range(len(self))
            ],
            "doubts": list(self.doubts),
        }


@dataclass(frozen=True, eq=False)
class Event:
    """A point of the cusp curves at which monotone pieces of one joint meet or end."""

    value: float
    error: float
    kind: str
    joints: np.ndarray
    pose: np.ndarray


@dataclass(frozen=True, eq=False)
class Pieces:
    """The monotone pieces of all cusp curves for one joint.

    Attributes:
        low: ``(n,)`` the smaller value at the ends of each piece.
        high: ``(n,)`` the greater.
        events: ``(n, 2)`` the events at the lower and the upper end, -1 on the box's own ends of this joint.
        image: ``(n,)`` number of the image: pieces with one number share their joint points.
    """

    low: np.ndarray
    high: np.ndarray
    events: np.ndarray
    image: np.ndarray

    def count(self, value: float) -> tuple[int, int]:
        """Returns the numbers of distinct joint points and of poses at a value; ends of pieces do not count."""
        here = (self.low < value) & (value < self.high)
        return len(set(self.image[here].tolist())), int(np.sum(here))


def transitions_of(
    axis: str,
    ends: tuple[float, float],
    pieces: Pieces,
    events: Sequence[Event],
    groups: np.ndarray,
    joint_names: tuple[str, ...],
    doubts: tuple[str, ...],
) -> Transitions:
    """Gathers the events at one joint point, drops those that change nothing, and counts between them.

    Args:
        axis: Name of the joint.
        ends: Its range.
        pieces: The monotone pieces.
        events: What happens at their ends.
        groups: ``(len(events),)`` number of the joint point of each event.
        joint_names: Names of the joint axes.
        doubts: What is doubtful, in words.
    """
    members = [np.flatnonzero(groups == g) for g in dict.fromkeys(groups.tolist())]
    kept = [own for own in members if _changes(pieces, own)]
    order = np.argsort([events[own[0]].value for own in kept], kind="stable") if kept else []
    kept = [kept[k] for k in order]
    values = np.array([events[own[0]].value for own in kept])
    errors = np.array([max(events[k].error for k in own) for own in kept])
    below, above = _neighbours(values, errors, ends)
    counts = np.array([[pieces.count(x) for x in (a, b)] for a, b in zip(below, above, strict=True)], int)
    counts = counts.reshape(len(kept), 2, 2)
    n = len(joint_names)
    return Transitions(
        axis=axis,
        range=ends,
        values=values,
        counts=counts[:, :, 0],
        poses_counts=counts[:, :, 1],
        kinds=tuple(_kind([events[k].kind for k in own]) for own in kept),
        joints=np.array([events[own[0]].joints for own in kept]).reshape(len(kept), n),
        poses=tuple(np.array([events[k].pose for k in own]) for own in kept),
        error=errors,
        joint_names=joint_names,
        doubts=doubts,
    )


def _kind(kinds: list[str]) -> str:
    named = [kind for kind in kinds if kind != "end"]
    return named[0] if named else "end"


def _changes(pieces: Pieces, own: np.ndarray) -> bool:
    """True where the number of poses, or of joint points, differs on both sides of events."""
    above = np.isin(pieces.events[:, 0], own)
    below = np.isin(pieces.events[:, 1], own)
    images = [set(pieces.image[side].tolist()) for side in (above, below)]
    return len(images[0]) != len(images[1]) or int(above.sum()) != int(below.sum())


def _neighbours(values: np.ndarray, errors: np.ndarray, ends: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Returns a value in the band below and one in the band above each transition; ties share their bands."""
    n = len(values)
    tied = np.zeros(max(n - 1, 0), bool)
    for k in range(n - 1):
        tied[k] = values[k + 1] - values[k] <= errors[k] + errors[k + 1]
    below, above = np.zeros(n), np.zeros(n)
    for k in range(n):
        first = last = k
        while first > 0 and tied[first - 1]:
            first -= 1
        while last < n - 1 and tied[last]:
            last += 1
        below[k] = 0.5 * (values[first] + (values[first - 1] if first else ends[0]))
        above[k] = 0.5 * (values[last] + (values[last + 1] if last < n - 1 else ends[1]))
    return below, above
