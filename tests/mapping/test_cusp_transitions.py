"""The number of cusps against one joint: the reference 3-RPR, against sections and against exact arithmetic."""

import json

import jax
import mechanism_zoo as zoo
import numpy as np
import pytest
from oracles import rpr3_cusp_curves as oracle

import jaxkin as jk
from jaxkin.mapping.cusp_curves import cusp_curves
from jaxkin.mechanisms import rpr3

REFERENCE = rpr3.reference()
WIDE = jk.Grid(rho1=(0.01, 200.0, 400), rho2=(0.0, 400.0, 400), rho3=(0.0, 400.0, 400))


@pytest.fixture(scope="module")
def wide():
    return cusp_curves(REFERENCE, WIDE)


def bands(moves):
    """Values in the middle of all bands and the counts there."""
    low, high = moves.range
    ends = np.concatenate([[low], moves.values, [high]])
    return 0.5 * (ends[1:] + ends[:-1]), np.append(moves.counts[:, 0], moves.counts[-1:, 1])


def test_all_transitions_of_the_reference(wide):
    moves = wide.transitions("rho1")
    assert wide.complete
    assert len(moves) == 22
    assert moves.doubts == ()
    # What one band says above the next says below.
    assert moves.counts[1:, 0].tolist() == moves.counts[:-1, 1].tolist()
    assert np.all(np.abs(np.diff(moves.counts, axis=1)) == 2)
    assert set(moves.kinds) == {"swallowtail", "lips", "beaks"}
    assert np.all(moves.error < 1e-12)
    # The narrowest band is 4e-11 of the range wide.
    assert 5e-9 < np.diff(moves.values).min() < 1e-8


def test_known_counts_of_the_reference(wide):
    assert wide.count("rho1", 14.98) == wide.count("rho1", 17.0) == 6
    assert wide.count(0, 14.98) == wide.pose_count("rho1", 14.98)


@pytest.mark.parametrize("axis", ["rho2", "rho3"])
def test_the_other_joints_count_on_and_off_too(wide, axis):
    moves = wide.transitions(axis)
    # rho1 = 200 cuts four branches that go on.
    assert moves.kinds.count("end") == 4
    assert moves.counts[1:, 0].tolist() == moves.counts[:-1, 1].tolist()
    change = np.abs(np.diff(moves.counts, axis=1)).ravel()
    assert change.tolist() == [1 if kind == "end" else 2 for kind in moves.kinds]


def test_swallowtails_are_critical_for_every_joint(wide):
    points = [
        {tuple(np.round(q, 8)) for q, k in zip(t.joints, t.kinds, strict=True) if k == "swallowtail"}
        for t in map(wide.transitions, wide.free)
    ]
    assert len(points[0]) == 12
    assert points[0] == points[1] == points[2]


def test_transitions_are_where_they_say(wide):
    """At every transition det A, its rate along the kernel, and the condition of its kind vanish."""
    length = float(REFERENCE.characteristic_length())

    def det(x):
        legs = np.zeros(3)
        return jax.numpy.linalg.det(jax.jacfwd(REFERENCE.constraints)(x, legs) / length)

    unit = np.array([length, length, 1.0])
    for name in wide.free:
        axis = wide.joint_names.index(name)
        moves = wide.transitions(name)
        for kind, poses in zip(moves.kinds, moves.poses, strict=True):
            if kind == "end":
                continue
            pose = poses[0]
            matrix = np.asarray(jax.jacfwd(REFERENCE.constraints)(pose, np.zeros(3))) * unit
            _, sigma, rows = np.linalg.svd(matrix)
            slope = np.asarray(jax.jacfwd(det)(pose)) * unit
            slope /= np.linalg.norm(slope)
            assert sigma[-1] / sigma[0] < 1e-11
            assert abs(slope @ rows[-1]) < 1e-9
            if kind in ("lips", "beaks"):
                leg = matrix[axis] / np.linalg.norm(matrix[axis])
                assert np.linalg.norm(np.cross(slope, leg)) < 1e-9


def test_both_sides_of_a_transition_by_sections(wide):
    moves = wide.transitions("rho1")
    for k in (0, 21):
        for side, value in ((0, moves.values[k] - 1e-3), (1, moves.values[k] + 1e-3)):
            section = jk.Grid(rho1=value, rho2=(0.0, 60.0, 400), rho3=(0.0, 60.0, 400))
            assert len(jk.cusps(REFERENCE, section)) == moves.counts[k, side]


@pytest.mark.slow
@pytest.mark.parametrize("half", [0, 1])
def test_every_band_by_a_section(wide, half):
    values, counts = bands(wide.transitions("rho1"))
    for value, count in list(zip(values, counts, strict=True))[half::2]:
        high = 3 * value + 60
        cusps = jk.cusps(REFERENCE, jk.Grid(rho1=float(value), rho2=(0.0, high, 900), rho3=(0.0, high, 900)))
        assert len(cusps) == count, value


@pytest.mark.parametrize("name", ["rho1", "rho2", "rho3"])
def test_certified_transitions_and_no_others(wide, name):
    """The oracle isolates all of them by elimination; it knows no box, so that it has no ends."""
    expected = json.loads(oracle.DATA.read_text())["reference"][name]
    moves = wide.transitions(name)
    assert [t["kind"] for t in expected] == [kind for kind in moves.kinds if kind != "end"]
    own = np.array([kind != "end" for kind in moves.kinds])
    values = np.array([t["value"] for t in expected])
    gaps = np.abs(moves.values[own] - values)
    assert np.all(gaps <= 10 * moves.error[own])
    assert gaps.max() < 1e-12 * values.max()
    assert moves.counts[own].tolist() == [[t["below"], t["above"]] for t in expected]
    np.testing.assert_allclose(moves.joints[own], [t["joints"] for t in expected], rtol=1e-9, atol=1e-9)
    length = float(REFERENCE.characteristic_length())
    poses = np.array([p[0] for p, mine in zip(moves.poses, own, strict=True) if mine])
    assert zoo.glued_distance(poses, np.array([t["pose"] for t in expected]), length).max() < 1e-9


@pytest.mark.parametrize("n", [10, 3000])
def test_the_grid_only_seeds(wide, n):
    again = cusp_curves(REFERENCE, jk.Grid(rho1=(0.01, 200.0, n), rho2=(0.0, 400.0, n), rho3=(0.0, 400.0, n)))
    np.testing.assert_allclose(again.transitions(0).values, wide.transitions(0).values, atol=1e-11)
    assert again.transitions(0).kinds == wide.transitions(0).kinds


def test_a_box_within_a_narrow_band(wide):
    moves = wide.transitions("rho1")
    k = int(np.argmin(np.diff(moves.values)))
    low, high = moves.values[k] - 1e-3, moves.values[k + 1] + 1e-3
    near = cusp_curves(REFERENCE, jk.Grid(rho1=(low, high, 99), rho2=(0.0, 60.0, 99), rho3=(0.0, 60.0, 99)))
    np.testing.assert_allclose(near.transitions(0).values, moves.values[k : k + 2], atol=1e-11)
    np.testing.assert_array_equal(near.transitions(0).counts, moves.counts[k : k + 2])
    assert near.complete
