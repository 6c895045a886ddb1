"""The oracle of singular sections checked on known answers, and its routes against each other."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from flint import fmpq, fmpq_poly

from .rpr3_exact import count_general, rational, tarski_query
from .rpr3_section_scan import scan
from .rpr3_sections import components, cusp_points
from .rpr3_torus import (
    REFERENCE,
    Degenerate,
    Geometry,
    Scan,
    Section,
    analytic,
    characteristic,
    random_section,
    singular_points,
)

DATA = json.loads((Path(__file__).parents[1] / "data" / "rpr3_sections.json").read_text())["sections"]
SEEDS = range(0, 40, 3)


def harmonics(geometry, rho):
    """Fourier coefficients -3..3 of the characteristic function, and a size to compare them with."""
    nodes = 2 * np.pi * np.arange(16) / 16
    values = characteristic(geometry, rho, nodes)
    return (np.fft.fft(values) / 16)[[-3, -2, -1, 0, 1, 2, 3]], np.max(np.abs(values))


def derivative(coefficients, phi, order):
    k = np.arange(-3, 4)
    return np.sum(coefficients * (1j * k) ** order * np.exp(1j * k * phi)).real


def leg_rows(geometry, x, y, phi):
    """Halves of the derivatives of the squared leg lengths by (x, y, phi), and the lengths."""
    c, s = math.cos(phi), math.sin(phi)
    third = geometry.l3 * math.cos(geometry.beta), geometry.l3 * math.sin(geometry.beta)
    base = (0, 0), (geometry.c2, 0), (geometry.c3, geometry.d3)
    rows = []
    for (bx, by), (ax, ay) in zip(((0, 0), (geometry.l2, 0), third), base, strict=True):
        ux, uy = c * bx - s * by, s * bx + c * by
        legx, legy = x + ux - ax, y + uy - ay
        rows.append((legx, legy, legy * ux - legx * uy))
    return np.array(rows), np.hypot(*np.array(rows)[:, :2].T)


def jacobian_determinant(geometry, x, y, phi):
    """The determinant divided by the product of the rows' lengths, and the leg lengths."""
    rows, lengths = leg_rows(geometry, x, y, phi)
    return np.linalg.det(rows / np.linalg.norm(rows, axis=1)[:, None]), lengths


# --- the functions -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_the_characteristic_function_has_the_derivatives_claimed(seed):
    geometry, _, value = random_section(seed)
    section = Section(geometry, 1, value)
    alpha, phi = np.random.default_rng(seed).uniform(-3, 3, 2)
    d, e, delta = section.functions(math.cos(alpha), math.sin(alpha), math.cos(phi), math.sin(phi))
    slope = (section.functions(1, 0, *(f(phi + 1e-5) for f in (math.cos, math.sin)))[2] - delta) / 1e-5
    _, squares = section.pose(math.cos(alpha), math.sin(alpha), math.cos(phi), math.sin(phi))
    coefficients, scale = harmonics(geometry, tuple(map(math.sqrt, squares)))
    expected = 0, 2 * delta * d, 2 * e + 4 * slope * d
    for order, value in enumerate(expected):  # the lines of `characteristic` carry a factor 2, its square terms 16
        assert derivative(coefficients, phi, order) == pytest.approx(16 * value, rel=1e-3, abs=1e-10 * scale)


# --- singular points -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_singular_points_are_singular_poses_and_double_roots(seed):
    geometry, axis, value = random_section(seed)
    points = singular_points(geometry, axis, value, np.linspace(-3, 3, 25))
    assert len(points) > 10
    assert np.allclose(points[:, 2 + axis], value, rtol=0, atol=1e-13 * (1 + value))
    for phi, x, y, *rho in points:
        determinant, lengths = jacobian_determinant(geometry, x, y, phi)
        assert abs(determinant) < 1e-12
        assert np.allclose(lengths, rho, rtol=0, atol=1e-12)
        coefficients, scale = harmonics(geometry, rho)
        assert abs(derivative(coefficients, phi, 0)) < 1e-11 * scale
        assert abs(derivative(coefficients, phi, 1)) < 1e-11 * scale


@pytest.mark.parametrize("seed", SEEDS)
def test_no_singular_point_is_missing(seed):
    """At rational points of the circle the number of points is a Sturm count."""
    geometry, axis, value = random_section(seed)
    section = Section(geometry, axis, value)
    tangents = [fmpq(k, 7) for k in range(-13, 14, 2)]  # at phi = 0 a root may be at infinity
    points = singular_points(geometry, axis, value, [2 * math.atan(int(t.p) / int(t.q)) for t in tangents])
    angles, counts = np.unique(points[:, 0], return_counts=True)
    found = dict(zip(angles, counts, strict=True))
    for t in tangents:
        c, s = (1 - t**2) / (1 + t**2), 2 * t / (1 + t**2)
        nodes = [fmpq(k) for k in range(-2, 3)]
        quartic = fmpq_poly()
        for u in nodes:  # Lagrange
            value_at = section.functions((1 - u**2) / (1 + u**2), 2 * u / (1 + u**2), c, s, exact=True)[0]
            basis = fmpq_poly([value_at * (1 + u**2) ** 2])
            for v in nodes:
                if v != u:
                    basis *= fmpq_poly([-v, 1]) / (u - v)
            quartic += basis
        assert found.get(2 * math.atan(int(t.p) / int(t.q)), 0) == tarski_query(quartic)


def test_singular_points_of_the_analytic_family_lie_on_two_lines():
    points = singular_points(analytic(1.0, 0.0, 1.0), 2, 1.0, np.linspace(-3, 3, 50))
    phi, x, y = points[:, :3].T
    s, c = np.sin(phi / 2), np.cos(phi / 2)
    on_first, on_second = x * c + y * s, y * c - x * s - 2 * s * s * c + 2 * s * c * c
    assert np.all(np.minimum(abs(on_first), abs(on_second)) < 1e-9)
    assert np.sum(abs(on_first) < 1e-9) > 20
    assert np.sum(abs(on_second) < 1e-9) > 20


# --- cusps ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [14.98, 17.0])
def test_six_cusps_of_the_reference(value):
    assert len(cusp_points(REFERENCE, 1, value)) == 6
    assert components(REFERENCE, 1, value).count == 1
    assert scan(REFERENCE, 1, value, 250) == scan(REFERENCE, 1, value, 400) == Scan(1, 6)


@pytest.mark.parametrize("seed", SEEDS)
def test_cusps_are_simple_triple_roots(seed):
    geometry, axis, value = random_section(seed)
    for cusp in cusp_points(geometry, axis, value):
        assert cusp.radius() < 1e-100
        assert cusp.rho[axis - 1].contains(rational(value))
        rho, (x, y, phi) = cusp.floats()
        assert abs(jacobian_determinant(geometry, x, y, phi)[0]) < 1e-12
        coefficients, scale = harmonics(geometry, rho)
        assert max(abs(derivative(coefficients, phi, order)) for order in (0, 1, 2)) < 1e-10 * scale
        assert abs(derivative(coefficients, phi, 3)) > 1e-8 * scale


@pytest.mark.parametrize("axis", [1, 2, 3])
def test_a_cusp_of_one_section_is_a_cusp_of_the_others(axis):
    for cusp in DATA[0]["cusps"]:
        values = [c.floats() for c in cusp_points(REFERENCE, axis, cusp["rho"][axis - 1])]
        distances = [np.max(np.abs(np.subtract(rho + pose, cusp["rho"] + cusp["pose"]))) for rho, pose in values]
        assert min(distances) < 1e-11


@pytest.mark.parametrize("seed", [0, 5, 7, 10, 14])
def test_two_poses_more_inside_a_cusp(seed):
    """Near a cusp the exact count of poses is larger by two in the cusp's direction than in the three others."""
    geometry, axis, value = random_section(seed)
    free = [i for i in range(3) if i != axis - 1]
    b2, b3 = geometry.platform()[1:]
    for cusp in cusp_points(geometry, axis, value):
        rho, (x, y, phi) = cusp.floats()
        rows, _ = leg_rows(geometry, x, y, phi)
        cokernel = np.linalg.svd(rows)[0][:, 2]
        normal = (cokernel * rho)[free] / np.linalg.norm((cokernel * rho)[free])
        counts = []
        for direction in (normal, -normal, (normal[1], -normal[0]), (-normal[1], normal[0])):
            legs = list(rho)
            for i, component in zip(free, direction, strict=True):
                legs[i] += 1e-7 * component
            counts.append(count_general(b2, b3, geometry.c2, geometry.c3, geometry.d3, *legs).count)
        outside, *others, inside = sorted(counts)
        assert inside == outside + 2
        assert others == [outside, outside]
        assert max(counts[:2]) == outside


# --- the analytic family -------------------------------------------------------------------------------------


def test_known_cusps_of_the_analytic_family():
    cusps = [cusp.floats() for cusp in cusp_points(analytic(1.0, 0.0, 1.0), 2, 1.0)]
    q = 3 * math.sqrt(3)
    first, second = (math.sqrt(3), 1, 1), (math.sqrt((q - 3) / 2), 1, math.sqrt(1 + q))
    expected = [
        (*first, 1 + math.sqrt(0.5), 1 - math.sqrt(0.5), -math.pi / 2),
        (*first, 1 - math.sqrt(0.5), 1 + math.sqrt(0.5), -math.pi / 2),
        (*second, 1.04434026359920, -0.0861952735297266, math.pi / 6),
        (*second, -0.861327561706983, -0.596817428362493, math.pi / 6),
    ]
    found = sorted((*rho, *pose) for rho, pose in cusps)
    assert np.allclose(found, sorted(expected), rtol=0, atol=1e-13)


@pytest.mark.parametrize("seed", range(6))
def test_cusps_of_the_analytic_family_are_120_degrees_apart(seed):
    rng = np.random.default_rng(seed)
    c2, c3, d3 = rng.uniform((0.5, -1, 0.3), 2).round(3).tolist()
    axis = 1 + seed % 3
    cusps = cusp_points(analytic(c2, c3, d3), axis, 4.0)
    assert len(cusps) in (0, 2, 4, 6)
    assert cusps
    for cusp in cusps:
        rho, (x, y, phi) = cusp.floats()
        assert rho[axis - 1] == pytest.approx(4)
        s, c = math.sin(3 * phi / 2), math.cos(3 * phi / 2)
        assert s * (d3**2 + c2 * c3 - c3**2) == pytest.approx(c * d3 * (c2 - 2 * c3), abs=1e-13)
        determinant, lengths = jacobian_determinant(analytic(c2, c3, d3), x, y, phi)
        assert abs(determinant) < 1e-12
        assert np.allclose(lengths, rho)


# --- components ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_decompositions_and_scan_agree(seed):
    geometry, axis, value = random_section(seed)
    expected = Scan(components(geometry, axis, value).count, len(cusp_points(geometry, axis, value)))
    assert components(geometry, axis, value, over_alpha=True).count == expected.components
    assert scan(geometry, axis, value, 400) == expected


def test_special_sections_are_refused():
    flat = Geometry(2.0, 0.7, 0.0, 1.5, 1.1, 0.0)
    with pytest.raises(Degenerate):
        cusp_points(flat, 1, 2.4)
    with pytest.raises(Degenerate, match="analytic"):
        cusp_points(Geometry(-1.0, 0.0, 1.0, 1.0, 1.0, 0.0, (0.0, 1.0)), 2, 1.0)
    with pytest.raises(Degenerate):
        components(flat, 1, 2.4)
    with pytest.raises(Degenerate):
        components(analytic(1.0, 0.0, 1.0), 2, 1.0)
    with pytest.raises(ValueError, match="axis"):
        cusp_points(REFERENCE, 0, 1.0)


# --- the data file -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("entry", DATA, ids=lambda entry: entry["name"])
def test_the_data_file_is_what_the_oracle_says(entry):
    geometry, axis, value = Geometry(**entry["geometry"]), entry["fixed_axis"], entry["fixed_value"]
    assert components(geometry, axis, value).count == entry["components"]
    found = [[*rho, *pose] for rho, pose in (cusp.floats() for cusp in cusp_points(geometry, axis, value))]
    stored = [[*cusp["rho"], *cusp["pose"]] for cusp in entry["cusps"]]
    assert len(found) == len(stored)
    assert np.allclose(found, stored, rtol=1e-15, atol=1e-15)
