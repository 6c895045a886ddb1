"""Curves traced from seeds to seeds: known curves, borders, glued axes, narrow gaps, singular points."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.numerics import continuation
from jaxkin.numerics.continuation import LEFT, REACHED, STUCK

OPEN = np.array([np.inf, np.inf])
AREA = 4.0


def circle(data, u):
    return jnp.stack([u[0] ** 2 + u[1] ** 2 - data])


def cassini(data, u):
    """Two ovals for data < 0, the lemniscate at 0, one oval above."""
    x, y = u
    return jnp.stack([(x * x + y * y) ** 2 - (x * x - y * y) - data])


def inside(data, u):
    return jnp.stack([AREA - u[0], AREA - u[1], AREA + u[0], AREA + u[1]])


def half_plane(data, u):
    return jnp.stack([u[1] + 0.5])


def traced(function, seeds, starts=None, inside=inside, period=OPEN, data=1.0, **options):
    seeds = np.array(seeds, float)
    starts = [(k, 1) for k in range(len(seeds))] if starts is None else starts
    return continuation.trace(function, inside, jnp.asarray(float(data)), seeds, period, starts, **options)


def values(function, piece, data=1.0):
    return np.array([np.max(np.abs(function(data, u))) for u in piece.points])


def on_circle(*degrees):
    return [(np.cos(a), np.sin(a)) for a in np.deg2rad(degrees)]


def test_a_circle_from_one_seed_closes():
    (piece,) = traced(circle, on_circle(30))
    assert (piece.source, piece.state, piece.target) == (0, REACHED, 0)
    np.testing.assert_allclose(piece.points[[0, -1]], on_circle(30, 30), atol=1e-8)
    assert values(circle, piece).max() < 1e-14
    steps = np.linalg.norm(np.diff(piece.points, axis=0), axis=1)
    assert steps.max() < 1.3 * continuation.LONGEST_STEP
    assert abs(steps.sum() - 2 * np.pi) < 5e-3


@pytest.mark.parametrize("sign", [1, -1])
def test_every_seed_has_one_successor_and_one_predecessor(sign):
    angles = [10, 300, 50, 51, 200, 120]
    pieces = traced(circle, on_circle(*angles), [(k, sign) for k in range(6)])
    assert all(piece.state == REACHED for piece in pieces)
    order = [pieces[0].source]
    while len(order) <= 6:
        order.append(pieces[order[-1]].target)
    around = [angles[k] for k in order[:-1]]
    assert sorted(around) == sorted(angles)
    assert order[-1] == 0
    turns = np.diff([*around, around[0]]) % 360
    assert turns.sum() == 360 or (360 - turns).sum() == 360


def test_the_orientation_puts_the_gradient_on_one_side():
    # The cross product of (the gradient of) one equation turns it by a right angle, always the same way.
    for piece in traced(circle, on_circle(0, 90, 200)):
        chord = piece.points[1] - piece.points[0]
        gradient = 2 * piece.points[0]
        assert np.linalg.det(np.stack([gradient, chord])) > 0


def test_two_ovals_are_two_cycles():
    root = np.sqrt((1 + np.sqrt(1 + 4 * -0.1)) / 2)
    seeds = [(root, 0.0), (-root, 0.0)]
    pieces = traced(cassini, seeds, data=-0.1)
    assert [piece.target for piece in pieces] == [0, 1]
    assert np.all(pieces[0].points[:, 0] > 0)
    assert np.all(pieces[1].points[:, 0] < 0)
    assert all(values(cassini, piece, -0.1).max() < 1e-13 for piece in pieces)


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-10, -1e-3, -1e-6, -1e-10])
def test_a_narrow_gap_is_not_bridged(gap):
    # Near the origin two branches pass each other at a distance of about the root of the gap.
    root = np.sqrt((1 + np.sqrt(1 + 4 * gap)) / 2)
    pieces = traced(cassini, [(root, 0.0), (-root, 0.0)], data=gap)
    assert all(piece.state == REACHED for piece in pieces)
    assert [piece.target for piece in pieces] == ([1, 0] if gap > 0 else [0, 1])


def test_the_lemniscate_is_traced_up_to_its_crossing_where_the_tracer_gets_stuck_or_goes_straight():
    pieces = traced(cassini, [(1.0, 0.0)], [(0, 1), (0, -1)], data=0.0)
    for piece in pieces:
        assert values(cassini, piece, 0.0).max() < 1e-12
        if piece.state == STUCK:
            assert np.linalg.norm(piece.points[-1]) < 1e-3
    apart = traced(cassini, [(1.0, 0.0), (0.2, np.sqrt((-1.08 + np.sqrt(1.08**2 + 4 * 0.0384)) / 2))], data=0.0)
    assert {piece.state for piece in apart} <= {REACHED, STUCK}
    assert any(piece.state == REACHED and piece.target != piece.source for piece in apart)


def test_a_singular_point_of_the_set_is_where_it_sticks():
    # y^2 = x^3 ends in the origin as far as tangents go.
    (piece,) = traced(lambda data, u: jnp.stack([u[1] ** 2 - u[0] ** 3]), [(1.0, 1.0)], [(0, -1)], most_steps=4000)
    (other,) = traced(lambda data, u: jnp.stack([u[1] ** 2 - u[0] ** 3]), [(1.0, 1.0)], [(0, 1)], most_steps=4000)
    stuck, left = (piece, other) if piece.state == STUCK else (other, piece)
    assert (stuck.state, left.state) == (STUCK, LEFT)
    assert stuck.target == -1
    assert np.linalg.norm(stuck.points[-1]) < 0.05


def test_a_border_is_left_inside_and_told_outside():
    pieces = traced(circle, on_circle(90), [(0, 1), (0, -1)], inside=half_plane)
    for piece in pieces:
        assert (piece.state, piece.target) == (LEFT, -1)
        assert np.all(piece.points[:, 1] >= -0.5)
        assert piece.outside[1] < -0.5
        assert np.linalg.norm(piece.outside - piece.points[-1]) < 1.3 * continuation.LONGEST_STEP
        assert abs(piece.outside @ piece.outside - 1) < 1e-12
    ends = sorted(piece.points[-1][0] for piece in pieces)
    assert ends[0] < -0.8
    assert ends[1] > 0.8


def torus(data, u):
    """A curve that closes only over both glued axes: v = 2 w + a wave."""
    return jnp.stack([jnp.sin(u[1] - 2 * u[0] - 0.3 * jnp.sin(u[0]))])


def everywhere(data, u):
    return jnp.ones(1)


def test_a_curve_round_a_glued_torus_closes_and_runs_on():
    period = np.array([2 * np.pi, 2 * np.pi])
    (piece,) = traced(torus, [(0.1, 0.2 + 0.3 * np.sin(0.1))], inside=everywhere, period=period)
    assert (piece.state, piece.target) == (REACHED, 0)
    turns = (piece.points[-1] - piece.points[0]) / (2 * np.pi)
    np.testing.assert_allclose(np.abs(turns), [1, 2], atol=1e-8)
    assert np.sign(turns[0]) == np.sign(turns[1])
    assert np.max(np.abs(np.diff(piece.points, axis=0))) < 1.3 * continuation.LONGEST_STEP


def test_seeds_a_turn_away_are_met():
    period = np.array([2 * np.pi, 2 * np.pi])
    start = np.array([0.1, 0.2 + 0.3 * np.sin(0.1)])
    middle = np.array([3.0, 6.0 + 0.3 * np.sin(3.0)])
    pieces = traced(torus, [start, middle + 2 * np.pi * np.array([-1, 2])], inside=everywhere, period=period)
    assert [piece.target for piece in pieces] == [1, 0]


def test_shorter_steps_give_more_points_on_the_same_curve():
    counts = [len(traced(circle, on_circle(0), longest=longest)[0].points) for longest in (0.06, 0.015, 0.004)]
    assert counts[0] < counts[1] < counts[2]
    assert counts[2] > 2 * np.pi / 0.004


def test_no_starts_no_pieces_and_too_few_steps_are_stuck():
    assert traced(circle, on_circle(0), []) == []
    (piece,) = traced(circle, on_circle(0), longest=1e-3, most_steps=64)
    assert piece.state == STUCK
    assert len(piece.points) == 65
