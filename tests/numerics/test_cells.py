"""The cell complex against dense arrays: neighbours, points, components over leaves of many sizes."""

import numpy as np
import pytest
from scipy import ndimage

from jaxkin.numerics.cells import CellTree, Components

SPLIT, UNDECIDED, OUTSIDE = -3, -2, -1


def grown(seed, shape, glued, levels, share=0.5, labels=2):
    """Returns a random tree, its components, and the dense label array of its finest level."""
    rng = np.random.default_rng(seed)
    tree, components = CellTree(shape, np.array(glued)), Components()
    flips = np.zeros(len(shape), int)
    for level in range(levels + 1):
        last = tree.levels[-1]
        last.status[:] = rng.integers(-1, labels, len(last.index))
        if level < levels:
            last.status[rng.random(len(last.index)) < share] = UNDECIDED
        tree.join(flips)
        components.add(tree)
        if level < levels:
            tree.split(np.flatnonzero(last.status == UNDECIDED), SPLIT)
    return tree, components


def painted(tree, levels, values):
    """Returns an array of the finest cells with a value of the leaf that holds each."""
    dense = np.full(tree.cells_along(levels), -9)
    for number, level in enumerate(tree.levels):
        step = 1 << (levels - number)
        for place, value in zip(level.index[level.child < 0], values(number)[level.child < 0], strict=True):
            dense[tuple(slice(p * step, (p + 1) * step) for p in place)] = value
    return dense


@pytest.mark.parametrize(
    ("shape", "glued", "levels"), [((3, 4), (0, 0), 4), ((4, 3), (1, 0), 4), ((3, 3, 4), (0, 1, 1), 2)]
)
@pytest.mark.parametrize("seed", range(3))
def test_components_are_those_of_the_dense_array(shape, glued, levels, seed):
    tree, components = grown(seed, shape, glued, levels)
    dense = painted(tree, levels, lambda number: tree.levels[number].status)
    found = painted(tree, levels, lambda number: components.level(number))
    expected = _glued_components(dense, glued)
    assert np.array_equal(found < 0, expected < 0)
    both = np.unique(np.stack([found[found >= 0], expected[found >= 0]]), axis=1)
    assert both.shape[1] == len(np.unique(both[0])) == len(np.unique(both[1])) == components.count


def _labelled(mask: np.ndarray) -> tuple[np.ndarray, int]:
    labels, count = ndimage.label(mask)  # type: ignore[misc]
    return labels, count


def _glued_components(dense, glued):
    """Returns components of equal labels by scipy.ndimage, glued by hand."""
    numbers, total = np.full(dense.shape, -1), 0
    for label in np.unique(dense[dense >= 0]):
        part, count = _labelled(dense == label)
        numbers[part > 0] = part[part > 0] - 1 + total
        total += count
    parent = np.arange(total)

    def root(k):
        while parent[k] != k:
            k = parent[k]
        return k

    for axis in np.flatnonzero(glued):
        first, last = np.take(dense, 0, axis), np.take(dense, -1, axis)
        same = (first == last) & (first >= 0)
        ends = np.take(numbers, 0, axis)[same], np.take(numbers, -1, axis)[same]
        for a, b in zip(*ends, strict=True):
            parent[root(a)] = root(b)
    return np.where(numbers >= 0, np.array([root(k) for k in range(total)])[numbers], -1)


@pytest.mark.parametrize("glued", [(0, 0), (1, 1)])
def test_points_are_found_in_their_leaves(glued):
    tree, _ = grown(5, (3, 5), glued, 4)
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 6, (500, 2))
    cells = tree.locate(points)
    wrapped = points % np.array(tree.shape) if glued[0] else points
    inside = np.all((wrapped >= 0) & (wrapped < tree.shape), axis=1)
    assert np.array_equal(cells >= 0, inside)
    level = tree.level_of(cells[inside])
    assert np.array_equal(np.floor(wrapped[inside] * 2.0 ** level[:, None]), tree.gathered("index", cells[inside]))
    assert np.all(tree.gathered("child", cells[inside]) < 0)


def test_labels_that_flip_over_a_seam_are_glued_flipped():
    tree, components = CellTree((2, 1), np.array([True, False])), Components()
    tree.levels[0].status[:] = [0, 1]
    tree.join(np.array([1, 0]))
    components.add(tree)
    # Over the middle 0 meets 1, over the seam 0 ^ 1 meets 1.
    assert components.count == 1
    plain, separate = CellTree((2, 1), np.array([True, False])), Components()
    plain.levels[0].status[:] = [0, 1]
    plain.join(np.array([0, 0]))
    separate.add(plain)
    assert separate.count == 2


def test_united_components_stay_united_at_later_levels():
    tree, components = CellTree((5,), np.array([False])), Components()
    tree.levels[0].status[:] = [0, UNDECIDED, 0, OUTSIDE, 0]
    tree.join(np.array([0]))
    components.add(tree)
    assert components.count == 3
    components.unite(components.of(tree, np.array([0])), components.of(tree, np.array([4])))
    tree.split(np.array([1]), SPLIT)
    tree.levels[1].status[:] = [0, 1]
    tree.join(np.array([0]))
    components.add(tree)
    assert components.count == 3
    assert components.of(tree, np.array([0, 2, 4, 5, 6, 1])).tolist() == [0, 1, 0, 0, 2, -1]
