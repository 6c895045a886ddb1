"""Where singular curves are born and joined, on a mechanism whose answers are known.

q1 = x, q2 = y^3/3 + y (s x^2 - c) has det = y^2 + s x^2 - c: for s = 1 a circle of radius sqrt c (born at c = 0: lips),
for s = -1 a hyperbola whose branches change partners at c = 0 (beaks). Its cusps lie where y = 0, at x^2 = c / s.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk

SECTION = jk.Grid(q1=(-1.0, 1.3, 50), q2=(-1.1, 1.0, 50))


@jk.mechanism
class Bump(jk.Mechanism):
    """Two linear joints over a plane, with one fold that c opens and closes."""

    pose_axes = (jk.Axis("x", "length", -2.0, 2.0), jk.Axis("y", "length", -2.0, 2.0))
    joint_axes = (jk.Axis("q1", "length"), jk.Axis("q2", "length"))

    c: jax.Array
    s: jax.Array
    limits: jk.Limits

    def constraints(self, pose, joints):
        x, y = pose
        return jnp.stack([joints[0] - x, joints[1] - (y**3 / 3 + y * (self.s * x**2 - self.c))])


def bump(s, c):
    return Bump(c=jnp.asarray(c), s=jnp.asarray(float(s)), limits=jk.Limits.lengths(2, -9.0, 9.0))


@pytest.mark.parametrize("c", [0.5, 1e-2, 1e-6, 1e-10])
def test_loops_down_to_the_smallest_are_found_whole_with_both_cusps(c):
    curves, cusps = jk.singular_curves(bump(1, c), SECTION), jk.cusps(bump(1, c), SECTION)
    assert [curve.closed for curve in curves] == [True]
    np.testing.assert_allclose(np.hypot(*curves[0].poses.T), np.sqrt(c), rtol=1e-9, atol=1e-13)
    np.testing.assert_allclose(cusps.joints, [[-np.sqrt(c), 0], [np.sqrt(c), 0]], atol=1e-12)
    assert len(cusps.others) == len(curves.crossings) == 0


def test_at_lips_one_isolated_point_remains_and_after_them_nothing():
    curves, cusps = jk.singular_curves(bump(1, 0.0), SECTION), jk.cusps(bump(1, 0.0), SECTION)
    assert [(len(curve), curve.ends[0]) for curve in curves] == [(1, "isolated point")]
    assert len(cusps) == 0
    assert [other.kind for other in cusps.others] == ["isolated point"]
    assert len(jk.singular_curves(bump(1, -1e-6), SECTION)) == 0
    assert len(jk.cusps(bump(1, -1e-6), SECTION)) == 0


@pytest.mark.parametrize("c", [0.5, 1e-2, 1e-6, 1e-10, 0.0, -1e-6, -1e-2])
def test_at_beaks_the_branches_change_partners_and_none_is_lost(c):
    curves, cusps = jk.singular_curves(bump(-1, c), SECTION), jk.cusps(bump(-1, c), SECTION)
    assert len(curves) == 2
    assert not any(curve.closed for curve in curves)
    for curve in curves:
        x, y = curve.poses.T
        np.testing.assert_allclose(y**2 - x**2, c, atol=1e-13)
        # c > 0: y keeps its sign; c < 0: x does; c = 0: the branches y = x and y = -x go straight through.
        kept = y if c > 0 else x if c < 0 else x * y
        assert np.all(kept >= -1e-12) or np.all(kept <= 1e-12)
    assert len(curves.crossings) == (1 if c == 0 else 0)
    assert [other.kind for other in cusps.others] == (["crossing"] if c == 0 else [])
    expected = [[-np.sqrt(-c), 0], [np.sqrt(-c), 0]] if c < 0 else np.zeros((0, 2))
    np.testing.assert_allclose(cusps.joints, expected, atol=1e-12)
