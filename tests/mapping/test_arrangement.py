"""Divisions of the plane by circles, lines and seams: regions against membership, Euler's formula, outlines."""

import itertools

import numpy as np
import pytest

from jaxkin.mapping._arrangement import Unions, divide, graph


class Circles:
    """Circles, as arcs over x: upper and lower halves, cut where circles cross."""

    def __init__(self, circles):
        circles = [np.array(c, float) for c in circles]
        self.points, self.arcs = [], []  # An arc: circle, upper (1) or lower (-1) half, both ends.
        crossings = [p for a, b in itertools.combinations(circles, 2) for p in _crossings(a, b)]
        for circle in circles:
            x, y, r = circle
            for side in (1, -1):
                on = [p for p in crossings if abs(np.hypot(p[0] - x, p[1] - y) - r) < 1e-9 and (p[1] - y) * side > 0]
                ends = sorted([(x - r, y), (x + r, y), *on])
                for start, end in itertools.pairwise(ends):
                    self.arcs.append((circle, side, self._vertex(*start), self._vertex(*end)))
        self.shape = graph(*np.array(self.points).T, [arc[2] for arc in self.arcs], [arc[3] for arc in self.arcs])
        self.order = [
            sorted(map(int, live), key=lambda k, x=0.5 * (low + high): self.height(k, x))
            for live, (low, high) in zip(self.shape.live, itertools.pairwise(self.shape.bounds), strict=True)
        ]

    def _vertex(self, x, y):
        for k, point in enumerate(self.points):
            if np.hypot(point[0] - x, point[1] - y) < 1e-9:
                return k
        self.points.append((float(x), float(y)))
        return len(self.points) - 1

    def height(self, arc, x):
        circle, side = self.arcs[arc][:2]
        return circle[1] + side * np.sqrt(max(circle[2] ** 2 - (x - circle[0]) ** 2, 0.0))

    def middles(self, division):
        """A point of every trapezoid."""
        points = []
        for piece in division.trapezoids:
            x = 0.5 * (self.shape.bounds[piece.slab] + self.shape.bounds[piece.slab + 1])
            points.append((x, 0.5 * (self.height(piece.below, x) + self.height(piece.above, x))))
        return np.array(points)


def _crossings(a, b):
    gap = b[:2] - a[:2]
    d = np.hypot(*gap)
    if d < 1e-12 or not abs(a[2] - b[2]) < d < a[2] + b[2] - 1e-9:
        return []
    along = (d * d + a[2] ** 2 - b[2] ** 2) / (2 * d)
    across = np.sqrt(a[2] ** 2 - along**2)
    foot, normal = a[:2] + along * gap / d, np.array([-gap[1], gap[0]]) / d
    return [tuple(foot + sign * across * normal) for sign in (1, -1)]


AROUND = (0.5, 0.5, 0.8)


@pytest.mark.parametrize(
    ("circles", "count"),
    [
        ([], 1),
        ([(0.5, 0.5, 0.3)], 2),
        ([(0.5, 0.5, 0.3), (0.5, 0.5, 0.1)], 3),
        ([(0.4, 0.5, 0.2), (0.6, 0.5, 0.2)], 4),
        ([(0.4, 0.5, 0.2), (0.6, 0.5, 0.2), (0.5, 0.62, 0.2)], 8),
        ([(0.3, 0.5, 0.2), (0.7, 0.5, 0.2)], 3),  # They touch: one point in common, nothing between.
    ],
)
def test_circles_in_a_circle(circles, count):
    plane = Circles([AROUND, *circles])
    division = divide(plane.shape, plane.order)
    assert division.count == count
    assert division.contradictions == 0


@pytest.mark.parametrize("seed", range(12))
def test_regions_are_the_classes_of_membership_and_obey_euler(seed):
    rng = np.random.default_rng(seed)
    circles = np.column_stack([rng.uniform(0.3, 0.7, (7, 2)), rng.uniform(0.05, 0.28, 7)])
    plane = Circles([AROUND, *circles])
    division = divide(plane.shape, plane.order)
    assert division.contradictions == 0
    points = plane.middles(division)
    inside = np.hypot(*(points[:, None] - circles[:, :2]).transpose(2, 0, 1)) < circles[:, 2]
    region = np.array([piece.region for piece in division.trapezoids])
    for number in range(division.count):
        assert len(np.unique(inside[region == number], axis=0)) == 1
    parts = Unions(len(plane.points))
    for arc in plane.arcs:
        parts.join(arc[2], arc[3])
    components = len(set(parts.labels().tolist()))
    assert len(plane.points) - len(plane.arcs) + division.count == components
    # A loop goes round every region once, and round every hole in it.
    assert sum(map(len, division.loops)) == division.count + components - 1


def test_a_hole_is_a_boundary_of_its_own():
    plane = Circles([AROUND, (0.45, 0.5, 0.1)])
    division = divide(plane.shape, plane.order)
    middles = plane.middles(division)
    hole = np.hypot(*(middles - [0.45, 0.5]).T) < 0.1
    (ring,) = {piece.region for piece, within in zip(division.trapezoids, hole, strict=True) if not within}
    assert [len(loop) for loop in division.loops[ring]] == [2, 2]
    for loop in division.loops[ring]:
        for arc, rightward in loop:
            assert (division.above if rightward else division.below)[arc] == ring


def test_glued_sides_join_regions():
    """A strip between two lines: glued top to bottom what is above and below the lines is one region."""
    heights = [0.0, 0.3, 0.6, 1.0]
    points = [(x, y) for y in heights for x in (0.0, 1.0)]
    start, end = [0, 2, 4, 6], [1, 3, 5, 7]
    shape = graph(*np.array(points).T, start, end)
    order = [[0, 1, 2, 3]]
    assert divide(shape, order).count == 3
    glued = divide(shape, order, [((0, True), (3, False))])
    assert glued.count == 2
    assert glued.above[0] == glued.below[3] == glued.above[2]
    assert glued.above[1] != glued.above[0]


def test_orders_that_do_not_fit_are_told():
    """Two arcs that exchange their places between slabs without a vertex in common."""
    points = [(0, 0), (1, 0), (0, 1), (1, 1), (0.1, 0.3), (0.9, 0.3), (0.1, 0.6), (0.9, 0.6), (0.5, 0.9), (0.7, 0.9)]
    shape = graph(*np.array(points, float).T, [0, 2, 4, 6, 8], [1, 3, 5, 7, 9])
    order = [[0, 1], [0, 2, 3, 1], [0, 3, 2, 4, 1], [0, 3, 2, 1], [0, 1]]
    assert divide(shape, order).contradictions > 0


def test_unions_number_sets_by_their_first_elements():
    unions = Unions(6)
    unions.join(4, 1)
    unions.join(5, 3)
    unions.join(3, 4)
    assert unions.labels().tolist() == [0, 1, 2, 1, 1, 1]
