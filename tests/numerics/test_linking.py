"""Linking and winding numbers: known links, laws, and an independent count of crossings in a projection."""

import numpy as np
import pytest

from jaxkin.numerics.linking import (
    linking_number,
    polygon_distances,
    sagittas,
    spanning_crossings,
    winding_number,
)


def circle(count: int, shift: float = 0.0) -> np.ndarray:
    a = 2 * np.pi * (np.arange(count) + 0.123) / count
    return np.stack([np.cos(a) + shift, np.sin(a), 0 * a], axis=1)


def torus_link(p: int, q: int, phase: float, count: int = 240) -> np.ndarray:
    """Returns one component of a (2p, 2q) torus link, p and q coprime."""
    a = 2 * np.pi * np.arange(count) / count
    radius = 2 + np.cos(q * a + phase)
    return np.stack([radius * np.cos(p * a), radius * np.sin(p * a), np.sin(q * a + phase)], axis=1)


def projected_linking(first: np.ndarray, second: np.ndarray) -> int:
    """Returns half the sum of the signs of the crossings in a projection along z: an independent definition."""
    total = 0
    for p, q in zip(first, np.roll(first, -1, 0), strict=True):
        for r, s in zip(second, np.roll(second, -1, 0), strict=True):
            u, v = q - p, s - r
            area = u[0] * v[1] - u[1] * v[0]
            w = r - p
            if area == 0:
                continue
            a, b = (w[0] * v[1] - w[1] * v[0]) / area, (w[0] * u[1] - w[1] * u[0]) / area
            if 0 <= a < 1 and 0 <= b < 1:
                over = p[2] + a * u[2] > r[2] + b * v[2]
                total += int(np.sign(area)) * (1 if over else -1)
    assert total % 2 == 0
    return total // 2


def turned(rng: np.random.Generator, *polygons: np.ndarray) -> list[np.ndarray]:
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return [p @ turn.T for p in polygons]


def hopf() -> tuple[np.ndarray, np.ndarray]:
    first = circle(40)
    second = circle(37)[:, [0, 2, 1]] + [1.0, 0.0, 0.0]
    return first, second


def test_hopf_link_and_unlink():
    first, second = hopf()
    assert abs(linking_number(first, second)) == 1
    assert linking_number(first, second) == projected_linking(*turned(np.random.default_rng(0), first, second))
    assert linking_number(first, np.add(second, [2.5, 0, 0])) == 0
    assert linking_number(first, np.add(circle(30), [0, 0, 0.5])) == 0


def test_sign_is_that_of_the_right_hand():
    """A line up through a circle that runs counter-clockwise, seen from above, closed far away."""
    up = np.array([[0, 0, -1], [0, 0, 1], [9, 0, 1], [9, 0, -1]], float)
    assert linking_number(circle(20), up) == 1
    assert spanning_crossings(circle(20), up[:2]) == 1
    assert spanning_crossings(circle(20), up[1::-1]) == -1


@pytest.mark.parametrize(("p", "q"), [(1, 1), (1, 2), (1, 3), (2, 3), (3, 2)])
def test_torus_links(p, q):
    """The components of the (2p, 2q) torus link have linking number p q."""
    first, second = torus_link(p, q, 0.0), torus_link(p, q, 1.0)
    assert abs(linking_number(first, second)) == p * q


def whitehead() -> tuple[np.ndarray, np.ndarray]:
    """Returns the reduced alternating diagram of an eight and a circle with five crossings: Whitehead's link."""
    t = np.radians(np.arange(0, 360, 1.5))
    meets = np.degrees(np.arccos(np.sqrt(1 - np.sqrt(0.75))))  # Of (2 cos t, sin 2t) with the unit circle.
    places = [0, meets, 90, 180 - meets, 180, 180 + meets, 270, 360 - meets, 360]
    height = np.interp(np.degrees(t), places, [0, 1, -1, 1, 0, -1, 1, -1, 0])
    return circle(83), np.stack([2 * np.cos(t), np.sin(2 * t), height], axis=1)


def test_whitehead_link_has_number_zero_although_linked():
    first, second = whitehead()
    assert linking_number(first, second) == 0
    assert projected_linking(first, second) == 0
    # With the crossings of the circle on one lobe exchanged it is a chain of number two.
    lobe = second * [1, 1, np.nan]
    lobe[:, 2] = np.where(second[:, 0] < 0, -second[:, 2], second[:, 2])
    assert abs(linking_number(first, lobe)) == abs(projected_linking(first, lobe)) == 2


def test_random_polygons_against_the_count_of_crossings():
    rng, seen = np.random.default_rng(1), set()
    for _ in range(25):
        first, second = rng.standard_normal((2, 14, 3))
        number = linking_number(first, second)
        assert number == projected_linking(first, second)
        assert number == linking_number(second, first)
        assert number == linking_number(*turned(rng, first, second))
        assert linking_number(first[::-1], second) == -number
        assert linking_number(first * [1, 1, -1], second * [1, 1, -1]) == -number
        seen.add(number)
    assert len(seen) >= 3


def test_spanning_crossings_are_the_linking_number_of_the_curve_closed_outside():
    rng, seen = np.random.default_rng(2), set()
    for _ in range(40):
        loop = rng.uniform(-1, 1, (9, 3))
        inside = rng.uniform(-1, 1, (7, 3))
        ends = rng.standard_normal((2, 3))
        ends /= np.max(np.abs(ends), axis=1, keepdims=True)  # On the border of the box.
        curve = np.concatenate([ends[:1], inside, ends[1:]])
        number = spanning_crossings(loop, curve)
        for side in ([50.0, 3, 1], [-2, 60, 5]):
            outside = np.array([30 * ends[1], side, 30 * ends[0]])
            assert number == linking_number(loop, np.concatenate([curve, outside]))
        seen.add(number)
    assert len(seen) >= 3


def test_touching_polygons_are_not_decided():
    first, second = hopf()
    through = second.copy()
    through[0] = 0.5 * (first[3] + first[4])
    assert linking_number(first, through) is None
    line = np.array([[1.0, 0, -1], [1.0, 0, 1]])
    corner = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]])
    assert spanning_crossings(corner, line) is None


def test_winding_numbers():
    a = 2 * np.pi * np.arange(90) / 90
    twice = np.stack([np.cos(2 * a) * (1 + 0.3 * np.cos(a)), np.sin(2 * a) * (1 + 0.3 * np.cos(a))], axis=1)
    assert winding_number(twice, np.zeros(2)) == 2
    assert winding_number(twice[::-1], np.zeros(2)) == -2
    assert winding_number(twice, np.array([1.1, 0.0])) == 1
    assert winding_number(twice, np.array([3.0, 0.0])) == 0
    assert winding_number(np.array([[0, 0], [1, 0], [1, 1]], float), np.array([0.5, 0.0])) is None
    assert winding_number(np.array([[0, 0], [1, 0], [1, 1]], float), np.zeros(2)) is None


def test_distances_and_sagittas():
    line = np.array([[0.0, 0, 1], [1, 0, 1], [2, 0, 3]])
    np.testing.assert_allclose(polygon_distances(line, np.array([[0.0, 0, 0], [2, 0, 0]])), [1, 1], atol=1e-15)
    a = np.linspace(0, 1, 101)
    arc = np.stack([np.cos(a), np.sin(a), 0 * a], axis=1)
    np.testing.assert_allclose(sagittas(arc), 1 - np.cos(0.01), rtol=1e-9)
    assert len(sagittas(arc[:2])) == 1
