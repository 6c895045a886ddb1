"""Angles as quarter tangents: there and back, and no seam inside."""

import math

import jax.numpy as jnp
import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from jaxkin.numerics import quarter


def there_and_back(phi):
    phi = jnp.asarray(phi)
    return np.asarray(quarter.angle(quarter.from_half_angle(jnp.sin(phi / 2), jnp.cos(phi / 2))))


@given(st.floats(-math.pi, math.nextafter(math.pi, 0)), st.floats(1e-100, 1e100))
@example(-math.pi, 1.0)
@example(math.nextafter(math.pi, 0), 1.0)
@example(0.0, 1.0)
def test_round_trip(phi, weight):
    s, c = weight * math.sin(phi / 2), weight * math.cos(phi / 2)
    for sign in (1.0, -1.0):
        u = quarter.from_half_angle(jnp.asarray(sign * s), jnp.asarray(sign * c))
        found = float(quarter.angle(u))
        assert -1 <= float(u) < 1
        assert -math.pi <= found < math.pi
        gap = abs(found - phi)
        assert min(gap, 2 * math.pi - gap) <= 2e-15
        half_s, half_c = quarter.half_angle(u)
        assert float(half_c) >= 0
        assert abs(float(half_s) * c - float(half_c) * s) <= 4e-16 * weight


def test_pi_is_minus_pi():
    for s in (1.0, -1.0):
        for c in (0.0, -0.0):
            assert float(quarter.from_half_angle(jnp.asarray(s), jnp.asarray(c))) == -1.0
    assert float(quarter.angle(jnp.asarray(-1.0))) == -math.pi


def test_angles_keep_their_order():
    phi = np.linspace(-np.pi, np.pi, 20001)[:-1]
    assert np.all(np.diff(there_and_back(phi)) > 0)
    assert np.abs(there_and_back(phi) - phi).max() < 4e-15
    turned = there_and_back(phi + 2 * np.pi)
    assert np.abs(turned[1:] - phi[1:]).max() < 4e-15


def test_no_angle_sorts_last():
    assert float(quarter.from_half_angle(jnp.asarray(1.0), jnp.asarray(1e-16))) < quarter.NO_ANGLE
