"""Shares of the rotation group against exact shares, and against another frame, another chart and random rotations."""

import math

import numpy as np
import pytest

from jaxkin.core.errors import InputError
from jaxkin.numerics import haar

RIGHT = math.pi / 2


def entry(i: int, j: int, constant: float = 0.0) -> haar.Affine:
    slope = np.zeros((1, 3, 3))
    slope[0, i, j] = 1.0
    return haar.Affine(np.array([constant]), slope)


def both(first: haar.Affine, second: haar.Affine) -> haar.Affine:
    return haar.Affine(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def patterns(positive: np.ndarray) -> np.ndarray:
    one, two = positive
    return np.stack([one & two, one & ~two, ~one & two, ~one & ~two])


def xyz(phi: np.ndarray, theta: np.ndarray) -> np.ndarray:
    zero, one = np.zeros_like(phi), np.ones_like(phi)
    about_x = np.array([[one, zero, zero], [zero, np.cos(phi), -np.sin(phi)], [zero, np.sin(phi), np.cos(phi)]])
    about_y = np.array([[np.cos(theta), zero, np.sin(theta)], [zero, one, zero], [-np.sin(theta), zero, np.cos(theta)]])
    return np.einsum("ijn,jkn->nik", about_x, about_y)


def test_the_two_rules_integrate_what_they_should():
    for degree in range(0, 23, 2):
        assert haar.K @ haar.X**degree == pytest.approx(2 / (degree + 1), abs=1e-15)
        if degree <= 12:
            assert haar.G @ haar.X**degree == pytest.approx(2 / (degree + 1), abs=1e-15)
    assert abs(haar.G @ haar.X**14 - 2 / 15) > 1e-5


@pytest.mark.parametrize("angle", [0.3, RIGHT, 2.5])
@pytest.mark.parametrize("center", [None, 5])
def test_a_ball_of_rotations_has_its_known_share(angle: float, center: int | None):
    # tr(C^T R) = 1 + 2 cos(angle) on the sphere of rotations about C; share (angle - sin angle) / pi.
    slope = np.eye(3) if center is None else haar.random_rotations(1, center)[0]
    ball = haar.Affine(np.array([-1 - 2 * math.cos(angle)]), slope[None])
    found = haar.haar_shares(ball, tolerance=1e-7)
    exact = (angle - math.sin(angle)) / math.pi
    assert abs(found.value[0] - exact) <= max(2 * found.error[0], 1e-14)
    assert found.error[0] <= 1e-7


def test_one_entry_is_even_over_its_range():
    # Archimedes: R33 is uniform in [-1, 1]. The sphere's circles R33 = const are where the integrand jumps.
    for i, j in ((2, 2), (0, 1), (2, 0)):
        found = haar.haar_shares(entry(i, j, -0.4), tolerance=1e-6)
        assert found.value[0] == pytest.approx(0.3, abs=1e-6)


def test_four_sign_patterns_of_two_entries_are_quarters():
    found = haar.haar_shares(both(entry(1, 1), entry(2, 2)), patterns, tolerance=1e-9)
    np.testing.assert_allclose(found.value, 0.25, rtol=0, atol=1e-9)
    assert (found.error <= 1e-9).all()


def test_shares_do_not_depend_on_the_fibres_nor_on_turns_from_the_left_or_right():
    functions = both(entry(1, 1, -0.2), entry(2, 2, 0.1))
    plain = haar.haar_shares(functions, patterns, tolerance=1e-4)
    turn, other = haar.random_rotations(2, seed=3)
    left = haar.haar_shares(functions, patterns, turn=turn, tolerance=1e-4)
    right = haar.haar_shares(haar.Affine(functions.constant, functions.slope @ other.T), patterns, tolerance=1e-4)
    for found in (left, right):
        assert (np.abs(found.value - plain.value) <= found.error + plain.error + 1e-12).all()
        assert np.abs(found.value - plain.value).max() < 2e-5
    assert plain.value.sum() == pytest.approx(1.0, abs=1e-5)
    assert np.ptp(plain.value) > 0.1


def test_the_euler_chart_with_its_weight_gives_the_same_share():
    functions = both(entry(1, 1, -0.2), entry(2, 2, 0.1))
    plain = haar.haar_shares(functions, tolerance=1e-4)
    chart = haar.square_shares(
        functions,
        haar.all_positive,
        xyz,
        (-math.pi, math.pi),
        (-RIGHT, RIGHT),
        weight=lambda phi, theta: np.cos(theta) / (8 * math.pi**2),
        tolerance=1e-4,
    )
    assert chart.value[0] == pytest.approx(plain.value[0], abs=2e-5)


def test_functions_of_degree_two():
    # R33^2 > c has the share 1 - sqrt(c); as a product with a random turn, so that it varies along the fibres.
    turn = haar.random_rotations(1, 8)[0]

    def square(rotations: np.ndarray) -> np.ndarray:
        return (np.einsum("nij,jk->nik", rotations, turn)[:, 2, 2] ** 2 - 0.36)[None]

    found = haar.haar_shares(square, degree=2, tolerance=1e-3)
    assert abs(found.value[0] - 0.4) <= found.error[0]
    assert found.error[0] < 1e-3


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_arcs_of_a_fibre_are_those_of_a_fine_sampling(degree: int):
    rng = np.random.default_rng(degree)
    slope, constant = rng.normal(size=(degree, 3, 3)), rng.normal(size=degree) / 2

    def product(rotations: np.ndarray) -> np.ndarray:
        return np.prod(
            [c + np.einsum("ij,nij->n", s, rotations) for c, s in zip(constant, slope, strict=True)], axis=0
        )[None]

    frames = haar.random_rotations(40, seed=degree)
    shares = haar.fibre_shares(product, haar.all_positive, frames, degree)[0]
    psi = (np.arange(20000) + 0.5) * (2 * math.pi / 20000)
    spins = np.stack(
        [np.cos(psi), -np.sin(psi), 0 * psi, np.sin(psi), np.cos(psi), 0 * psi, 0 * psi, 0 * psi, 0 * psi + 1], axis=-1
    ).reshape(-1, 3, 3)
    sampled = [float((product(frame @ spins)[0] > 0).mean()) for frame in frames]
    np.testing.assert_allclose(shares, sampled, atol=3.1 * degree / 20000)
    if degree == 1:
        exact = haar.Affine(constant, slope)
        np.testing.assert_allclose(haar.fibre_shares(exact, haar.all_positive, frames)[0], shares, atol=1e-12)


def test_constant_functions_are_all_or_nothing():
    nothing = haar.Affine(np.array([-0.1]), np.zeros((1, 3, 3)))
    assert haar.haar_shares(nothing).value[0] == 0.0
    everything = haar.Affine(np.array([0.1]), np.zeros((1, 3, 3)))
    assert haar.haar_shares(everything).value[0] == pytest.approx(1.0, abs=1e-12)


def test_the_fit_of_affine_functions():
    rng = np.random.default_rng(2)
    true = haar.Affine(rng.normal(size=4), rng.normal(size=(4, 3, 3)))
    found = haar.affine(lambda rotations: true(rotations))
    np.testing.assert_allclose(found.constant, true.constant, atol=1e-13)
    np.testing.assert_allclose(found.slope, true.slope, atol=1e-13)
    with pytest.raises(InputError, match="not affine"):
        haar.affine(lambda rotations: rotations[:, 0, 0][None] ** 2)


def test_random_rotations_are_rotations_and_even():
    rotations = haar.random_rotations(20000)
    assert np.abs(np.swapaxes(rotations, 1, 2) @ rotations - np.eye(3)).max() < 1e-14
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0, atol=1e-13)
    assert np.abs(rotations.mean(axis=0)).max() < 5 / math.sqrt(3 * 20000)


def test_a_tolerance_must_be_positive():
    with pytest.raises(InputError, match="tolerance"):
        haar.haar_shares(entry(0, 0), tolerance=0.0)


@pytest.mark.slow
def test_four_quarters_over_skew_fibres_to_nine_digits():
    turn = haar.random_rotations(1, seed=3)[0]
    found = haar.haar_shares(both(entry(1, 1), entry(2, 2)), patterns, turn=turn, tolerance=1e-9)
    np.testing.assert_allclose(found.value, 0.25, rtol=0, atol=1e-9)
    assert (found.error <= 1e-9).all()
