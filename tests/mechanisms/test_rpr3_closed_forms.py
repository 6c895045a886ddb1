"""Closed forms of the analytic family: against Wenger and Chablat's print, eliminations, and each other."""

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracles import rpr3_elimination
from rpr3_checks import assert_on_constraints, factors, few, geometries, lengths, sections, sides

import jaxkin as jk
from jaxkin.core.errors import InputError
from jaxkin.mechanisms import _rpr3_analytic, rpr3
from jaxkin.mechanisms import rpr3_closed_forms as forms

EXAMPLE = rpr3.analytic(*zoo.EXAMPLE)
Q = 3 * np.sqrt(3)


# --- S ------------------------------------------------------------------------------------------------------


def printed_quartic(rho1, rho2, rho3):
    """S as printed, with the plus before rho3^8."""
    return (
        rho2**8
        - 4 * (rho1**2 + 3) * rho2**6
        + (2 * rho3**4 + (20 - 4 * rho1**2) * rho3**2 + 16 * rho1**2 + 44 + 8 * rho1**2 * (rho1**2 + 2)) * rho2**4
        + ((20 - 4 * rho1**2) * rho3**4 + (8 * rho1**4 - 80 * rho1**2 - 88) * rho3**2) * rho2**2
        + (-8 * rho1**6 + 24 * rho1**4 - 32) * rho2**2
        + rho3**8
        - 4 * (rho1**2 + 3) * rho3**6
        + (16 * rho1**6 + 44 + 8 * rho1**4) * rho3**4
        + (24 * rho1**4 - 8 * rho1**6 - 32) * rho3**2
        - 64
        + rho1**8
        - 16 * rho1**6
        + 64 * rho1**2
    )


def corrected_quartic(rho1, rho2, rho3):
    """S with the three terms corrected: 44 + 16 rho1^2 + 8 rho1^4 twice, and 4 rho1^8."""
    middle = 44 + 16 * rho1**2 + 8 * rho1**4
    return (
        rho2**8
        - 4 * (rho1**2 + 3) * rho2**6
        + (2 * rho3**4 + (20 - 4 * rho1**2) * rho3**2 + middle) * rho2**4
        + ((20 - 4 * rho1**2) * rho3**4 + (8 * rho1**4 - 80 * rho1**2 - 88) * rho3**2) * rho2**2
        + (-8 * rho1**6 + 24 * rho1**4 - 32) * rho2**2
        + rho3**8
        - 4 * (rho1**2 + 3) * rho3**6
        + middle * rho3**4
        + (24 * rho1**4 - 8 * rho1**6 - 32) * rho3**2
        + 4 * rho1**8
        - 16 * rho1**6
        + 64 * rho1**2
        - 64
    )


def test_quartic_of_the_example_is_the_corrected_print():
    rho = np.random.default_rng(0).uniform(0, 2.5, (200, 3))
    true, one, two, three = np.asarray(forms.quartic(EXAMPLE, rho)), *rho.T
    np.testing.assert_allclose(true, corrected_quartic(*rho.T), atol=1e-9)
    wrong = -(one**2) * (3 * one**6 - 16 * one**4 * three**4 - 16 * two**4 + 16 * three**4)
    np.testing.assert_allclose(printed_quartic(*rho.T) - true, wrong, atol=1e-9)
    assert np.max(np.abs(wrong)) > 1


@few
@given(geometries, lengths)
def test_quartic_is_the_discriminant_of_the_eliminated_cubic(geometry, rho):
    exact = rpr3_elimination.double_root(geometry, rho)
    scale = sides(geometry) ** 4 + max(map(abs, (*geometry, *rho))) ** 12
    assert float(forms.quartic(rpr3.analytic(*geometry), rho)) == pytest.approx(-exact / 4, rel=0, abs=1e-12 * scale)


@few
@given(geometries, lengths)
def test_sign_of_the_quartic_tells_the_number_of_real_angles(geometry, rho):
    value = float(forms.quartic(rpr3.analytic(*geometry), rho))
    a, b = rho[0] ** 2 - rho[1] ** 2, rho[0] ** 2 - rho[2] ** 2
    cubic = np.array(_rpr3_analytic.characteristic_cubic(geometry, a, b))
    if abs(value) > 1e-6 * sides(geometry) ** 4 and abs(cubic[0]) > 1e-6:
        assert np.sum(np.abs(np.roots(cubic).imag) < 1e-9) == (3 if value < 0 else 1)


# --- Q1 to Q4 -----------------------------------------------------------------------------------------------


def test_conics_of_the_example_are_the_printed_ones():
    one, two, three = rho = np.random.default_rng(1).uniform(0, 3, (3, 100))
    printed = {
        "Q1": two**2 / 2 - 2 - one * two + one**2 + one * three + three**2 / 2,
        "Q2": two**2 / 2 - 2 + one * two + one**2 + one * three + three**2 / 2,
        "Q3": two**2 / 2 - 2 + one * two + one**2 - one * three + three**2 / 2,
        "Q4": two**2 / 2 - 2 - one * two + one**2 - one * three + three**2 / 2,
    }
    values = forms.conics(EXAMPLE, rho.T)
    assert list(values) == list(printed)
    for name, value in printed.items():
        np.testing.assert_allclose(values[name], value, atol=1e-13)


@few
@given(geometries)
def test_conics_are_what_eliminating_the_pose_leaves(geometry):
    # The elimination leaves K (rho1^2 - rho2^2)^2 Q1 Q2 Q3 Q4 with K a constant of the geometry, unless a
    # leading coefficient vanishes: hence the odd lengths.
    robot, constants = rpr3.analytic(*geometry), []
    for rho in ((1.031, 0.517, 2.013), (1.259, 0.763, 0.521), (0.541, 1.523, 1.771)):
        product = np.prod([float(v) for v in forms.conics(robot, rho).values()]) * (rho[0] ** 2 - rho[1] ** 2) ** 2
        constants.append(rpr3_elimination.parallel_legs(geometry, rho) / product)
    np.testing.assert_allclose(constants, constants[0], rtol=1e-8)


# --- cusps --------------------------------------------------------------------------------------------------


def test_cusp_edges_of_the_example():
    edges = forms.cusp_edges(EXAMPLE)
    np.testing.assert_allclose(np.degrees(edges.phi), [-90, 30, 150], rtol=1e-15)
    np.testing.assert_allclose(edges.a, [2, (Q - 5) / 2, -(Q + 5) / 2], rtol=1e-14)
    np.testing.assert_allclose(edges.b, [2, -(Q + 5) / 2, (Q - 5) / 2], rtol=1e-14)
    np.testing.assert_allclose(edges.h, [np.sqrt(2), -np.sqrt(1 / 8), np.sqrt(1 / 8)], rtol=1e-14)


@few
@given(geometries)
def test_cusp_edges_are_triple_roots_120_degrees_apart(geometry):
    (c2, c, d), edges = geometry, forms.cusp_edges(rpr3.analytic(*geometry))
    phi = np.array(edges.phi)
    assert -np.pi <= phi[0]
    assert phi[2] < np.pi
    np.testing.assert_allclose(np.diff(phi), 2 * np.pi / 3, rtol=1e-14)
    np.testing.assert_allclose(
        d * (c2 - 2 * c) * np.cos(1.5 * phi), (d * d + c * c2 - c * c) * np.sin(1.5 * phi), atol=1e-12
    )
    for angle, a, b in zip(phi, edges.a, edges.b, strict=True):
        s, k = np.sin(angle / 2), np.cos(angle / 2)
        cube = np.array([k**3, -3 * k**2 * s, 3 * k * s**2, -(s**3)])  # (S k - C s)^3
        cubic = np.array(_rpr3_analytic.characteristic_cubic(geometry, a, b))
        np.testing.assert_allclose(cubic, cube * (cubic @ cube) / (cube @ cube), atol=1e-11 * np.abs(cubic).max())


@pytest.mark.parametrize(
    "geometry", [(1.0, 0.5, 1.0), (2.0, -1.0, 3**0.5), (2.0, 2.5, -(1.25**0.5)), (-1.0, 1.0, 2**0.5)]
)
def test_cusp_angles_of_special_bases_stay_in_order(geometry):
    # Isosceles bases, and those with a cusp at the seam phi = pi.
    phi = np.array(forms.cusp_edges(rpr3.analytic(*geometry)).phi)
    assert np.all(np.diff(phi) > 2)
    assert -np.pi <= phi[0] < phi[2] < np.pi


@few
@given(geometries, st.floats(0.1, 4))
def test_cusp_cubic_is_the_product_over_the_edges(geometry, rho1):
    c2, c, d = geometry
    robot, m = rpr3.analytic(*geometry), c * c - 2 * c * c2 + d * d
    b = np.array(forms.cusp_edges(robot).b)
    scale = np.abs(b).max() + rho1**2
    np.testing.assert_allclose(np.sum(b), -3 * m, atol=1e-12 * scale)
    np.testing.assert_allclose(np.prod(b), -(m**3), atol=1e-12 * scale**3)
    expected = -d * d * np.poly(rho1**2 - b)
    gaps = np.abs(forms.cusp_cubic(robot, rho1) - expected) / (d * d * scale ** np.arange(4))
    assert gaps.max() < 1e-12


@few
@given(geometries, st.floats(0.1, 3))
def test_cusp_cubic_is_the_restored_print(geometry, rho1):
    # Eq. (8) has c2 = 1. Every coefficient as printed; the exponents of d, all printed d^3, and of c^3 = c restored.
    (_, c, d), R1 = geometry, rho1**2
    printed = (
        -(d**2),
        3 * d**2 * c**2 + 3 * d**4 + 3 * d**2 * R1 - 6 * d**2 * c,
        (
            12 * d**2 * R1 * c - 15 * d**2 * c**3 - 6 * d**2 * R1 * c**2 + 69 / 4 * d**2 * c**4 - 27 / 2 * c**5
            + 27 / 4 * c**6 + 57 / 4 * d**4 * c**2 - 3 / 2 * d**4 * c + 27 / 4 * d**4 - 6 * d**4 * R1
            + 3 / 2 * d**2 * c**2 + 27 / 4 * c**4 + 15 / 4 * d**6 - 3 * d**2 * R1**2
        ),
        (
            -27 * c**6 * R1 / 4 + 3 * c**2 * d**6 - 57 * d**4 * R1 * c**2 / 4 - 6 * c * d**6 + 3 * d**4 * R1**2
            - 6 * d**2 * c**5 + c**6 * d**2 - 69 * d**2 * R1 * c**4 / 4 - 3 * d**2 * R1 * c**2 / 2 - 8 * d**2 * c**3
            + 12 * d**2 * c**4 - 6 * d**2 * R1**2 * c + 3 * d**2 * R1**2 * c**2 + 15 * d**2 * R1 * c**3
            - 27 * c**4 * R1 / 4 + d**2 * R1**3 + 27 * c**5 * R1 / 2 + 3 * d**4 * c**4 - 27 * d**4 * R1 / 4
            - 12 * d**4 * c**3 + 3 * d**4 * R1 * c / 2 + 12 * d**4 * c**2 + d**8 - 15 * d**6 * R1 / 4
        ),
    )  # fmt: skip
    value = forms.cusp_cubic(rpr3.analytic(1.0, c, d), rho1)
    np.testing.assert_allclose(value, printed, atol=1e-10 * (1 + R1) ** 3)


def test_cusps_of_the_example_at_rho2_1():
    # Wenger and Chablat 2009 print (1.73205080, 1) and (1.04789131, 2.48920718), truncated.
    joints, poses = map(np.array, forms.section_cusps(EXAMPLE, 1, 1.0))
    np.testing.assert_allclose(joints[0], [np.sqrt(3), 1, 1], rtol=1e-14)
    np.testing.assert_allclose(joints[1], [np.sqrt((Q - 3) / 2), 1, np.sqrt(1 + Q)], rtol=1e-14)
    low, high = 0.292893218813452, 1.70710678118655
    np.testing.assert_allclose(poses[0], [[high, low, -np.pi / 2], [low, high, -np.pi / 2]], rtol=1e-13)
    second = [[1.04434026359920, -0.0861952735297266, np.pi / 6], [-0.861327561706983, -0.596817428362493, np.pi / 6]]
    np.testing.assert_allclose(poses[1], second, rtol=1e-13)
    assert np.all(np.isnan(joints[2]))
    assert np.all(np.isnan(poses[2]))


@pytest.mark.parametrize(
    ("geometry", "value", "number"),
    [
        ((1.0, 2.0, -1.25), 1.0, 0),
        ((1.5, -0.7, 0.4), 1.0, 1),
        (zoo.EXAMPLE, 1.0, 2),
        (zoo.EXAMPLE, 2.28540504, 2),
        (zoo.EXAMPLE, 2.28540505, 3),  # above sqrt((21 + 12 sqrt 3) / 8)
        (zoo.EXAMPLE, 0.16408469, 1),  # below sqrt((21 - 12 sqrt 3) / 8)
        (zoo.EXAMPLE, 0.16408470, 2),
    ],
)
def test_a_section_has_0_to_3_cusps(geometry, value, number):
    joints = forms.section_cusps(rpr3.analytic(*geometry), 1, value).joints
    assert np.sum(np.isfinite(joints[:, 0])) == number


@few
@given(geometries, sections)
def test_section_cusps_are_the_physical_points_of_the_edges(geometry, section):
    (axis, value), robot = section, rpr3.analytic(*geometry)
    edges, (joints, poses) = forms.cusp_edges(robot), map(np.array, forms.section_cusps(robot, axis, value))
    a, b = np.array(edges.a), np.array(edges.b)
    r1 = value**2 + (0, a, b)[axis] + 0 * a
    physical = (r1 - a > 0) & (r1 - b > 0) & (r1 > np.array(edges.h) ** 2)
    np.testing.assert_array_equal(np.isfinite(joints[:, 0]), physical)
    np.testing.assert_allclose(joints[physical] ** 2, np.stack([r1, r1 - a, r1 - b], 1)[physical], atol=1e-11)
    np.testing.assert_array_equal(joints[physical, axis], value)
    for sheet in (0, 1):
        assert_on_constraints(geometry, poses[physical, sheet], joints[physical])
        assert np.max(factors(robot, geometry, poses[:, sheet])[1][physical], initial=0) < 1e-13


def test_cusps_are_traceable_and_differentiable():
    one = jax.jit(lambda robot, value: forms.section_cusps(robot, 1, value).joints[:2])
    slope = jax.jacfwd(one, argnums=1)(EXAMPLE, 1.0)
    np.testing.assert_allclose(slope, (one(EXAMPLE, 1 + 1e-6) - one(EXAMPLE, 1 - 1e-6)) / 2e-6, atol=1e-8)
    gradient = jax.grad(lambda robot: jnp.nansum(forms.section_cusps(robot, 1, 1.0).poses))(EXAMPLE)
    assert np.all(np.isfinite([gradient.c2, gradient.c3, gradient.d3]))
    batch = rpr3.analytic(np.array([1.0, 1.5]), np.array([0.0, -0.7]), np.array([1.0, 0.4]))
    mapped = jax.vmap(lambda robot: forms.section_cusps(robot, 1, 1.0))(batch)
    whole = forms.section_cusps(batch, 1, np.array([1.0, 1.0]))
    jax.tree.map(np.testing.assert_allclose, mapped, whole)


# --- input --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("function", [forms.section_cusps, forms.section_crossings, forms.section_curves])
@pytest.mark.parametrize(
    ("axis", "value", "text"),
    [
        (3, 1.0, "axis is 3"),
        ("rho1", 1.0, "axis is 'rho1'"),
        (1, 0.0, "value is 0.0"),
        (1, -1.0, "value is -1.0"),
        (1, np.inf, "value is inf"),
        (1, "long", "value is 'long'"),
    ],
)
def test_bad_sections_are_named(function, axis, value, text):
    with pytest.raises(InputError, match=text):
        function(EXAMPLE, axis, value)


def test_other_bad_input_is_named():
    with pytest.raises(InputError, match="analytic family alone"):
        forms.quartic(rpr3.reference(), (1.0, 1.0, 1.0))
    with pytest.raises(InputError, match="last axis"):
        forms.conics(EXAMPLE, (1.0, 1.0))
    with pytest.raises(InputError, match="batched or traced"):
        forms.section_curves(rpr3.analytic(np.ones(2), np.zeros(2), np.ones(2)), 1, 1.0)
    with pytest.raises(InputError, match="one concrete number"):
        forms.section_crossings(EXAMPLE, 1, np.array([1.0, 2.0]))
    with pytest.raises(InputError, match="samples is 3"):
        forms.section_curves(EXAMPLE, 1, 1.0, samples=3)


def test_the_module_is_public():
    assert jk.mechanisms.rpr3_closed_forms is forms
