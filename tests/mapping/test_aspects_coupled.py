"""Aspects where equations hold several joints: the same robots with their equations mixed, by the ordinary route."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.kinematics.jacobian import raw_jacobians
from jaxkin.kinematics.legs import legs_of, working_mode
from jaxkin.mapping.aspects import aspects
from jaxkin.mechanisms import five_bar

#: Invertible, and no entry zero: every equation holds both joints, the solutions stay.
MIX = np.array([[1.0, 0.6], [-0.4, 1.3]])
BAR = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))
BOX = {"x": (-5.0, 14.0), "y": (-13.0, 13.0)}


@jk.mechanism
class MixedBar(five_bar.FiveBar):
    """The five-bar, every equation with both joints."""

    id = "mixed-five-bar"

    def constraints(self, pose, joints):
        return jnp.asarray(MIX) @ super().constraints(pose, joints)


MIXED = MixedBar(BAR.base, BAR.proximal, BAR.distal, BAR.limits)


def box(n):
    return jk.Grid(**{name: (*ends, n) for name, ends in BOX.items()})


@pytest.fixture(scope="module")
def sampled():
    return aspects(MIXED, box(64))


@pytest.fixture(scope="module")
def plain():
    return aspects(BAR, box(256))


def configurations(count, seed=7):
    """Returns poses and joints of random configurations, by the closed form of the plain robot."""
    rng = np.random.default_rng(seed)
    poses, joints = [], []
    while len(poses) < count:
        pose = rng.uniform([-4.0, -12.0], [13.0, 12.0])
        found = jk.inverse(BAR, pose)
        valid = np.asarray(found.values)[np.asarray(found.valid)]
        if len(valid):
            poses.append(pose)
            joints.append(valid[rng.integers(len(valid))])
    return np.array(poses), np.array(joints)


def test_the_mixed_robot_has_no_sign_vectors():
    assert legs_of(MIXED) is None
    assert legs_of(BAR) is not None


def test_counts_and_areas_are_those_of_the_plain_robot(sampled, plain):
    # Chablat and Wenger 1998 name four working modes of the five-bar; the ordinary route proves cells of ten aspects.
    assert plain.count == sampled.count == 10
    large = sorted(aspect.volume for aspect in sampled if aspect.cells >= 16)
    known = sorted(plain.volume.tolist())
    assert np.allclose(large[-8:], known[-8:], rtol=0.01)
    # The two small aspects have an area of 1.17 each, ten cells.
    small = [k for k, aspect in enumerate(sampled) if aspect.cells < 16]
    assert len(large) == 8
    for k in small:
        assert any(f"aspect [{k}] has" in doubt for doubt in sampled.doubts)
    assert {aspect.working_mode for aspect in sampled} == {(1,), (2,), (3,), (4,)}
    assert sampled.evidence["sheets"] == 4


def test_areas_are_within_their_errors(sampled, plain):
    known = plain.volume
    for aspect in sampled:
        if aspect.volume > 10:
            assert np.min(np.abs(known - aspect.volume)) <= 3 * aspect.error
            assert aspect.error < 0.03 * aspect.volume
    assert sampled.volume.sum() == pytest.approx(known.sum(), rel=5e-3)


def test_sheets_are_the_working_modes_of_the_plain_robot(sampled, plain):
    legs, pairs, placed = legs_of(BAR), set(), 0
    poses, joints = configurations(40)
    same = {}
    assert legs is not None
    for pose, q in zip(poses, joints, strict=True):
        number, other = sampled.aspect_of(pose, q), plain.aspect_of(pose, q)
        if number < 0 or other < 0:
            continue
        placed += 1
        mode = tuple(np.asarray(working_mode(BAR, legs, pose, q)).astype(int).tolist())
        pairs.add((sampled[number].working_mode, mode))
        if sampled[number].cells >= 16:
            assert same.setdefault(number, other) == other
    assert placed >= 34
    assert len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs}) == 4


def test_deepest_configurations_close_and_lie_in_their_aspects(sampled):
    for k, aspect in enumerate(sampled):
        assert np.max(np.abs(np.asarray(MIXED.constraints(aspect.pose, aspect.joints)))) < 1e-9
        direct, inverse = raw_jacobians(MIXED, jnp.asarray(aspect.pose), jnp.asarray(aspect.joints))
        assert np.sign(np.linalg.det(direct)) == aspect.sign
        assert abs(np.linalg.det(inverse)) > 0
        if aspect.cells >= 16:
            assert sampled.aspect_of(aspect.pose, aspect.joints) == k


def test_a_path_meets_no_singularity(sampled, plain):
    poses, joints = configurations(24, seed=3)
    numbers = [sampled.aspect_of(pose, q) for pose, q in zip(poses, joints, strict=True)]
    made = 0
    for a, b in zip(range(23), range(1, 24), strict=True):
        path = sampled.path(poses[a], poses[b], joints[a], joints[b])
        assert (path is None) == (numbers[a] < 0 or numbers[a] != numbers[b])
        if path is None:
            continue
        made += 1
        assert np.allclose(path[0], poses[a])
        assert np.allclose(path[-1], poses[b])
        mode = np.sign(np.diag(np.asarray(raw_jacobians(BAR, jnp.asarray(poses[a]), jnp.asarray(joints[a])).inverse)))
        signs = set()
        for pose in path:
            found = jk.inverse(BAR, pose)
            for q in np.asarray(found.values)[np.asarray(found.valid)]:
                direct, inverse = raw_jacobians(BAR, jnp.asarray(pose), jnp.asarray(q))
                if np.array_equal(np.sign(np.diag(np.asarray(inverse))), mode):
                    signs.add(float(np.sign(np.linalg.det(np.asarray(direct)))))
        assert len(signs) == 1
    assert made >= 1


def test_records_say_what_was_sampled(sampled):
    assert "sampled" in sampled.doubts[0]
    assert "nothing is proved" in sampled.evidence["method"]
    assert all(aspect.proved == 0 for aspect in sampled)
    content = json.loads(sampled.to_json())
    assert content["count"] == sampled.count
    cells = sampled.slice()
    for k, aspect in enumerate(sampled):
        own = cells.aspect == k
        assert np.prod(cells.high[own] - cells.low[own], axis=1).sum() == pytest.approx(aspect.volume)
        assert np.all(cells.working_mode[own] == aspect.working_mode)


def test_what_cannot_be_served_is_said(sampled):
    with pytest.raises(jk.InputError, match="nothing bounds the pose axis 'x'"):
        aspects(MIXED)
    with pytest.raises(jk.InputError, match="too few to say anything"):
        aspects(MIXED, jk.Grid(x=(0.0, 1.0, 8), y=(0.0, 1.0, 64)))
    with pytest.raises(jk.InputError, match="leaves 4 sheets open"):
        sampled.aspect_of((4.5, 6.0))
    with pytest.raises(jk.InputError, match="do not belong to the pose"):
        sampled.aspect_of((4.5, 6.0), (0.0, 0.0))
