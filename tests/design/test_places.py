"""Prescribed workspaces: their poses, their samples, what moves them, and what is refused."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.design import ball, box, poses, reach

ROBOT = jk.mechanisms.rpr3.general(2.1, 0.8, 1.7, 0.9, 0.75, 1.1)
TLPM = jk.mechanisms.tlpm.create(590.0, 600.0, ((-150.0, -200.0, -180.0), (200.0, 190.0, 170.0)))
PPPS3 = jk.mechanisms.ppps3.create()
FREE = {"x": (0.0, 1.0), "y": (0.2, 0.6), "phi": (-0.1, 0.3)}

REFUSED = {
    "wrong axis": (lambda: box(ROBOT, **FREE, z=0.0), "box has an axis 'z': the pose axes are x, y, phi"),
    "missing axis": (lambda: box(ROBOT, x=(0.0, 1.0), y=0.0), "box lacks the pose axis 'phi'"),
    "low above high": (lambda: box(ROBOT, **{**FREE, "x": (1.0, 0.0)}), "x goes from 1 to 0: low must be less"),
    "empty interval": (lambda: box(ROBOT, **{**FREE, "x": (1.0, 1.0)}), "x goes from 1 to 1: low must be less"),
    "infinite interval": (lambda: box(ROBOT, **{**FREE, "x": (0.0, np.inf)}), "x is (0.0, inf)"),
    "three numbers": (lambda: box(ROBOT, **{**FREE, "x": (0.0, 1.0, 2.0)}), "must be (low, high) or one number"),
    "a word": (lambda: box(ROBOT, **{**FREE, "x": "wide"}), "x is 'wide'"),
    "nothing free": (lambda: box(ROBOT, x=0.0, y=0.0, phi=0.0), "box has no free axis"),
    "one sample": (lambda: box(ROBOT, 1, **FREE), "n is 1 along x: it must be a whole number, at least 2"),
    "half a sample": (lambda: box(ROBOT, {"x": 2.5}, **FREE), "n is 2.5 along x"),
    "samples of a fixed axis": (
        lambda: box(ROBOT, {"phi": 3}, **{**FREE, "phi": 0.0}),
        "along 'phi', which is not free",
    ),
    "radius zero": (lambda: ball(ROBOT, {"x": 0.0, "y": 0.0}, 0.0, phi=0.0), "the radius is 0.0"),
    "radius negative": (lambda: ball(ROBOT, {"x": 0.0, "y": 0.0}, -1.0, phi=0.0), "the radius is -1.0"),
    "radius NaN": (lambda: ball(ROBOT, {"x": 0.0, "y": 0.0}, np.nan, phi=0.0), "the radius is nan"),
    "axis twice": (lambda: ball(ROBOT, {"x": 0.0, "y": 0.0}, 1.0, x=0.0, phi=0.0), "the axis 'x' is given twice"),
    "mixed units": (lambda: ball(ROBOT, {"x": 0.0, "phi": 0.0}, 1.0, y=0.0), "the units length, rad"),
    "center an interval": (lambda: ball(ROBOT, {"x": (0.0, 1.0), "y": 0.0}, 1.0, phi=0.0), "must be one number"),
    "no axis": (lambda: ball(ROBOT, {}, 1.0, **FREE), "the center has 0 axes"),
    "four axes": (lambda: ball(PPPS3, dict.fromkeys("xyz", 0.0) | {"phi": 0.0}, 1.0), "the center has 4 axes"),
    "missing beside a ball": (lambda: ball(ROBOT, {"x": 0.0, "y": 0.0}, 1.0), "ball lacks the pose axis 'phi'"),
    "poses of another length": (lambda: poses(ROBOT, [[0.0, 1.0]]), "of shape (k, 3), (x, y, phi)"),
    "no poses": (lambda: poses(ROBOT, np.zeros((0, 3))), "of shape (k, 3)"),
    "NaN poses": (lambda: poses(ROBOT, [0.0, np.nan, 0.0]), "poses must be finite"),
    "no identity": (lambda: reach(ROBOT), "have no identity along a path"),
    "no limits": (lambda: reach(PPPS3), "rho1y goes from -inf to inf: give it finite limits"),
    "no lane": (lambda: reach(TLPM, 3, 2), "lane is 2: choose 0 to 1"),
    "samples of no joint": (lambda: reach(TLPM, {"l4": 3}), "along 'l4', which is not free"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused_is_told_in_one_sentence(name):
    make, told = REFUSED[name]
    with pytest.raises(jk.InputError, match=re.escape(told)) as caught:
        make()
    sentence = str(caught.value)
    assert sentence.startswith("jk.design.")
    assert sentence.endswith(".")
    assert "\n" not in sentence
    assert not re.search(r"[a-z]\. [A-Z]", sentence)


def test_samples_fill_a_box_up_to_its_borders():
    place = box(ROBOT, {"x": 3, "y": 4}, **FREE)
    assert place.numbers == (3, 4, 7)
    found = np.asarray(place.sampled(ROBOT, None, place.samples()))
    assert found.shape == (3 * 4 * 7, 3)
    for k, (low, high) in enumerate(FREE.values()):
        assert (found[:, k].min(), found[:, k].max()) == pytest.approx((low, high), abs=1e-15)
    assert len(place.samples(2)) == 5 * 7 * 13
    coarse, fine = ({tuple(row) for row in np.round(place.samples(d), 12)} for d in (1, 2))
    assert coarse < fine


def test_fixed_axes_are_fixed():
    place = box(ROBOT, 3, x=(0.0, 1.0), y=0.4, phi=-0.2)
    assert place.dimension == 1
    found = np.asarray(place.sampled(ROBOT, None, place.samples()))
    np.testing.assert_allclose(found[:, 1:], [[0.4, -0.2]] * 3, rtol=1e-15)


@pytest.mark.parametrize("axes", [("x",), ("x", "y"), ("x", "y", "z")])
def test_balls_hold_their_middle_and_their_surface(axes):
    center = dict(zip("xyz", (10.0, -20.0, 30.0), strict=True))
    rest = {name: center[name] for name in "xyz" if name not in axes}
    place = ball(TLPM, {name: center[name] for name in axes}, 50.0, 9, **rest)
    found = np.asarray(place.sampled(TLPM, None, place.samples()))
    away = np.linalg.norm(found - [10.0, -20.0, 30.0], axis=1)
    assert away.max() == pytest.approx(50.0, rel=1e-14)
    assert away.min() == pytest.approx(0.0, abs=1e-12)
    assert place.dimension == len(axes)
    inside = np.random.default_rng(0).uniform(-1.0, 1.0, (500, len(axes)))
    found = np.asarray(place.sampled(TLPM, None, inside))
    assert np.linalg.norm(found - [10.0, -20.0, 30.0], axis=1).max() <= 50.0 * (1 + 1e-14)
    for k in range(len(axes)):
        assert found[:, k].min() < [10.0, -20.0, 30.0][k] - 25.0
        assert found[:, k].max() > [10.0, -20.0, 30.0][k] + 25.0


@pytest.mark.parametrize(("axes", "volume"), [(1, 2.0), (2, np.pi), (3, 4 * np.pi / 3)])
def test_the_stretch_integrates_to_the_volume(axes, volume):
    names = "xyz"[:axes]
    place = ball(TLPM, dict.fromkeys(names, 0.0), 10.0, 5, **dict.fromkeys("xyz"[axes:], 0.0))
    nodes, weights = np.polynomial.legendre.leggauss(12)
    u = np.stack(np.meshgrid(*[nodes] * axes, indexing="ij"), axis=-1).reshape(-1, axes)
    w = np.prod(np.stack(np.meshgrid(*[weights] * axes, indexing="ij"), axis=-1).reshape(-1, axes), axis=1)
    stretch = jax.vmap(lambda row: place.stretch(TLPM, row, None))(jnp.asarray(u))
    assert float(np.sum(np.asarray(stretch) * w)) == pytest.approx(volume * 10.0**axes, rel=1e-12)


def test_a_center_moves_every_pose():
    listed = poses(ROBOT, [[0.0, 0.1, 0.2], [0.4, 0.5, 0.0]])
    for place in (box(ROBOT, 3, **FREE), ball(ROBOT, {"x": 0.5, "y": 0.4}, 0.2, 3, phi=(0.0, 0.2)), listed):
        shift = np.array([0.3, -0.2, 0.1])
        before = np.asarray(place.sampled(ROBOT, None, place.samples()))
        after = np.asarray(place.sampled(ROBOT, jnp.asarray(place.center + shift), place.samples()))
        np.testing.assert_allclose(after - before, np.broadcast_to(shift, before.shape), atol=1e-15)
        np.testing.assert_allclose(place.middle(ROBOT, jnp.asarray(place.center + shift)), place.center + shift)


@pytest.mark.parametrize("lane", [0, 1])
def test_all_of_reach_is_within_limits_and_moves_with_them(lane):
    place = reach(TLPM, 4, lane)
    found = np.asarray(place.sampled(TLPM, None, place.samples()))
    assert found.shape == (64, 3)
    low, high = np.asarray(TLPM.limits.low), np.asarray(TLPM.limits.high)
    joints = np.array(
        [
            np.asarray(jk.inverse(TLPM.with_limits(**dict.fromkeys(("l1", "l2", "l3"), (-1e3, 1e3))), pose).values[0])
            for pose in found
        ]
    )
    assert np.all(joints >= low - 1e-9)
    assert np.all(joints <= high + 1e-9)
    np.testing.assert_allclose(joints.min(axis=0), low, atol=1e-9)
    np.testing.assert_allclose(joints.max(axis=0), high, atol=1e-9)
    wider = TLPM.with_limits(l1=(-100.0, 150.0))
    moved = np.asarray(place.sampled(wider, None, place.samples()))
    assert np.abs(moved - found).max() > 10.0
    # The two assembly modes are on either side of the plane of the base points, z = -h.
    assert np.all((found[:, 2] + 600.0) * (1, -1)[lane] > 0)


def test_places_say_what_they_are():
    assert str(box(ROBOT, x=(0.0, 1.0), y=0.4, phi=(-0.5, 0.5))) == "x = 0 .. 1, phi = -0.5 .. 0.5, y = 0.4"
    assert str(ball(ROBOT, {"x": 0.0, "y": 1.0}, 0.5, phi=0.25)) == "ball of radius 0.5 in x, y, phi = 0.25"
    assert str(poses(ROBOT, [0.0, 1.0, 0.2])) == "1 pose"
    assert str(reach(TLPM)) == "all that the joint limits reach"
