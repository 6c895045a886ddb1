"""Sections of the analytic family's joint space in closed form: correct, exact at their ends, and complete."""

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from hypothesis import given
from oracles import rpr3_exact
from rpr3_checks import assert_on_constraints, factors, few, geometries, padded, sections, sides, squared_lengths

from jaxkin.mechanisms import rpr3
from jaxkin.mechanisms import rpr3_closed_forms as forms

EXAMPLE = rpr3.analytic(*zoo.EXAMPLE)


def test_crossings_of_the_example_at_rho2_1():
    joints = forms.section_crossings(EXAMPLE, 1, 1.0).joints
    expected = [[0.866524711911001, 1, 0.148133801733571], [0.195472401235419, 1, 1.79885811212486]]
    np.testing.assert_allclose(joints, expected, rtol=1e-13)


@few
@given(geometries, sections)
def test_crossings_are_all_points_on_both_curves(geometry, section):
    (axis, value), robot = section, rpr3.analytic(*geometry)
    joints, poses = forms.section_crossings(robot, axis, value)
    assert_on_constraints(geometry, poses, joints)
    assert np.max(factors(robot, geometry, poses), initial=0) < 1e-12
    assert np.all(np.diff(poses[:, 2]) >= 0)
    # No other: changes of sign of the fixed leg's length along f1 = f2 = 0, on a fine grid of phi.
    phi = np.linspace(-np.pi, np.pi, 8001)
    s, c = np.sin(phi / 2), np.cos(phi / 2)
    zero = padded(second_factor, robot, np.stack([0 * phi, 0 * phi, phi], axis=1))
    h = zero / geometry[2]  # f2 = -d3 h + its value at x = y = 0
    inside = squared_lengths(geometry, np.stack([-h * s, h * c, phi], 1))[:, axis] > value**2
    assert len(poses) >= np.sum(inside[1:] != inside[:-1])
    assert len(poses) in (0, 2, 4, 6)


def second_factor(robot, poses):
    return jax.vmap(robot.factors)(poses)["f2"]


@few
@given(geometries, sections)
def test_curves_satisfy_all_equations(geometry, section):
    (axis, value), robot = section, rpr3.analytic(*geometry)
    size = max(*map(abs, geometry), value)
    for piece in forms.section_curves(robot, axis, value, samples=60):
        np.testing.assert_array_equal(piece.joints[:, axis], value)
        assert np.all(piece.joints >= 0)
        if piece.virtual:
            assert np.all(np.isnan(piece.poses))
        else:
            assert np.all((piece.poses[:, 2] >= -np.pi) & (piece.poses[:, 2] < np.pi))
            assert_on_constraints(geometry, piece.poses, piece.joints)
            assert np.max(factors(robot, geometry, piece.poses)[piece.label == "S"]) < 1e-13
        if piece.label == "S":
            r = piece.joints**2
            spread = np.abs(r - r[:, :1]).max() * np.abs(geometry).max()
            surface = np.abs(padded(forms.quartic, robot, piece.joints))
            assert np.max(surface) < 1e-11 * (sides(geometry) + size**3 + spread) ** 4
        else:
            conic = np.abs(padded(forms.conics, robot, piece.joints)[piece.label])
            assert np.max(conic) < 1e-12 * (size + piece.joints.max()) ** 4


@few
@given(geometries, sections)
def test_ends_and_cusps_are_exact(geometry, section):
    (axis, value), robot = section, rpr3.analytic(*geometry)
    pieces = forms.section_curves(robot, axis, value, samples=60)
    crossings = forms.section_crossings(robot, axis, value).joints
    for piece in pieces:
        for end in [] if piece.closed else [piece.joints[0], piece.joints[-1]]:
            gap = np.min(np.abs(crossings - end).max(axis=1), initial=np.inf)
            assert np.min(end) == 0 or (piece.virtual and gap < 1e-12 * (1 + end.max()))
    real = np.concatenate([np.zeros((0, 6)), *(np.hstack([p.joints, p.poses]) for p in pieces if p.label == "S")])
    joints, poses = map(np.array, forms.section_cusps(robot, axis, value))
    for k in np.flatnonzero(np.isfinite(joints[:, 0])):
        for pose in poses[k]:
            near = np.abs(real[:, :3] - joints[k]).max(1) + zoo.glued_distance(real[:, 3:], pose)
            assert np.nanmin(near) < 1e-9


@few
@given(geometries, sections)
def test_pieces_are_smooth_in_the_workspace(geometry, section):
    (axis, value), robot = section, rpr3.analytic(*geometry)
    for piece in forms.section_curves(robot, axis, value):
        if not piece.virtual:
            following = np.roll(piece.poses, -1, axis=0)
            steps = zoo.glued_distance(piece.poses, following, value + float(robot.characteristic_length()))
            assert np.max(steps if piece.closed else steps[:-1]) < 0.1


def crossed(piece, free, starts, ends):
    """Tells which segments of the section meet the piece."""
    points = piece.joints[:, free]
    points = np.concatenate([points, points[:1]]) if piece.closed else points
    u, w, a, b = points[:-1], points[1:], starts[:, None], ends[:, None]

    def cross(m, n):
        return m[..., 0] * n[..., 1] - m[..., 1] * n[..., 0]

    apart = (cross(b - a, u - a) > 0) != (cross(b - a, w - a) > 0)
    return np.any(apart & ((cross(w - u, a - u) > 0) != (cross(w - u, b - u) > 0)), axis=1)


@pytest.mark.parametrize("seed", range(6))
def test_the_number_of_modes_changes_nowhere_else(seed):
    # The curves are complete: between neighbours on a grid with different counts there is one of them.
    rng = np.random.default_rng(seed)
    robot, axis, value = rpr3.analytic(*zoo.random_analytic(rng, 1)[0]), seed % 3, rng.uniform(0.1, 2)
    free = [k for k in range(3) if k != axis]
    points = np.stack(np.meshgrid(*[np.linspace(0.013, 4, 36)] * 2), axis=-1)
    joints = np.insert(points.reshape(-1, 2), axis, value, axis=1)
    number = np.array(counts(robot, jnp.asarray(joints))).reshape(points.shape[:2])
    curves = [piece for piece in forms.section_curves(robot, axis, value) if not piece.virtual]
    changes = 0
    for one, two in [(np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])]:
        change = (number[one] != number[two]).ravel()
        starts, ends = (points[part].reshape(-1, 2)[change] for part in (one, two))
        assert np.all(np.any([crossed(piece, free, starts, ends) for piece in curves], axis=0))
        changes += change.sum()
    assert changes > 20


@jax.jit
def counts(robot, joints):
    return robot.count_kernel((joints[:, 0], joints[:, 1], joints[:, 2])).number


@pytest.mark.parametrize("geometry", [zoo.EXAMPLE, (1.5, -0.7, 0.4), (1.0, 2.0, -1.25)])
def test_counts_jump_by_4_at_s_by_2_at_the_conics_by_0_where_virtual(geometry):
    robot, seen = rpr3.analytic(*geometry), set()
    pieces = forms.section_curves(robot, 1, 1.0, samples=200)
    for number, piece in enumerate(pieces):
        others = np.concatenate([other.joints for k, other in enumerate(pieces) if k != number])
        for share in (0.1, 0.2, 0.3, 0.4, 0.6, 0.7, 0.8):
            k = int(share * len(piece.joints))
            point, along = piece.joints[k], piece.joints[k + 1] - piece.joints[k - 1]
            if np.min(np.linalg.norm(others - point, axis=1)) < 0.03 or np.linalg.norm(along) < 1e-3:
                continue
            across = 1e-4 * np.array([-along[2], 0, along[0]]) / np.linalg.norm(along)
            one, two = (rpr3_exact.count_analytic(*geometry, *(point + sign * across)).count for sign in (1, -1))
            jump = 0 if piece.virtual else 4 if piece.label == "S" else 2
            assert abs(one - two) == jump, (piece.label, point)
            seen.add(jump)
    assert seen == {0, 2, 4}


def test_chords_are_close_to_the_curve():
    for coarse, fine in zip(*(forms.section_curves(EXAMPLE, 1, 1.0, samples=n) for n in (100, 1500)), strict=True):
        start, end = coarse.joints[:-1], coarse.joints[1:]
        points, chord = fine.joints[:-20:10, None], end - start
        share = np.sum((points - start) * chord, axis=2) / np.maximum(np.sum(chord**2, axis=1), 1e-300)
        foot = start + np.clip(share, 0, 1)[..., None] * chord
        assert np.min(np.linalg.norm(points - foot, axis=2), axis=1).max() < (np.pi / 100) ** 2 * np.ptp(fine.joints)


def test_pieces_of_the_example_at_rho2_1():
    pieces = EXAMPLE.closed_form_curves(1, 1.0)
    kinds = [(piece.label, piece.virtual, piece.closed) for piece in pieces]
    assert sorted(kinds) == [
        *((name, False, False) for name in ("Q1", "Q2", "Q3", "Q4")),
        ("S", False, True),
        ("S", True, False),
        ("S", True, False),
    ]
