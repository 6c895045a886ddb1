"""Objectives against what is known of them, and against numbers got in other ways."""

import math
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

import jaxkin as jk
from jaxkin.mechanisms import rpr3_closed_forms as closed_forms

#: 1 / the plastic number, the real root of s^3 + s^2 = 1: cos(t)^2 = sin(t)^3 at sin t = s.
INVERSE_PLASTIC = 0.7548776662466927
HOME_CUBE = 0.8554675768878


def general(seed):
    """A random planar 3-RPR without symmetry, and its numbers."""
    rng = np.random.default_rng(seed)
    numbers = np.array([2.1, 0.8, 1.7, 0.9, 0.75, 1.1]) * rng.uniform(0.9, 1.1, 6)
    return jk.mechanisms.rpr3.general(*numbers).with_limits(rho1=(0.3, 3.0), rho2=(0.3, 3.0), rho3=(0.3, 3.0)), numbers


def rates(numbers, poses, length):
    """Matrices dq / dx ``(k, 3, 3)`` of a planar 3-RPR from its leg vectors, and their legs ``(k, 3)``."""
    c2, c3, d3, l2, l3, beta = numbers
    base = np.array([(0.0, 0.0), (c2, 0.0), (c3, d3)])
    own = np.array([(0.0, 0.0), (l2, 0.0), (l3 * math.cos(beta), l3 * math.sin(beta))])
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turned = np.stack(
        [own[:, 0] * c[:, None] - own[:, 1] * s[:, None], own[:, 0] * s[:, None] + own[:, 1] * c[:, None]]
    )
    vectors = poses[:, :2].T[:, :, None] + turned - base.T[:, None, :]
    legs = np.linalg.norm(vectors, axis=0)
    moment = turned[0] * vectors[1] - turned[1] * vectors[0]
    return np.stack([vectors[0], vectors[1], moment / length], axis=-1) / legs[..., None], legs


def grid(n, *intervals):
    axes = [np.linspace(low, high, n) for low, high in intervals]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


INTERVALS = {"x": (0.62, 0.97), "y": (0.21, 0.52), "phi": (0.11, 0.34)}
LENGTH = 1.3


def test_the_home_cube_of_the_3_ppps_is_that_of_the_plastic_number():
    assert math.isclose(INVERSE_PLASTIC**3 + INVERSE_PLASTIC**2, 1.0, rel_tol=1e-15)
    assert math.isclose(math.asin(INVERSE_PLASTIC), HOME_CUBE, rel_tol=1e-13)
    robot = jk.mechanisms.ppps3.create()
    place = jk.design.box(robot, x=0.0, y=0.0, z=0.0, phi=(-1.0, 1.0), theta=(-1.0, 1.0), sigma=(-1.0, 1.0))
    objective = jk.design.regular_size(robot, place, limits=False)
    found = objective.measured(robot)
    assert found.proved
    assert found.value == pytest.approx(math.asin(INVERSE_PLASTIC), abs=1e-10)
    assert objective.unit == "rad"


@pytest.mark.parametrize("norm", ["spectral", "frobenius"])
def test_the_tlpm_is_isotropic_at_home_where_l_is_h_times_root_two(norm):
    robot = jk.mechanisms.tlpm.create(590.0 * math.sqrt(2), 590.0, (-200.0, 200.0))
    objective = jk.design.inverse_condition_number(robot, jk.design.poses(robot, [0.0, 0.0, 0.0]), norm=norm)
    assert float(objective(robot)) == pytest.approx(1.0, abs=1e-12)
    assert objective.measured(robot).value == pytest.approx(1.0, abs=1e-12)
    for share in (0.9, 1.1):
        assert float(objective(robot.replace(base_radius=robot.base_radius * share))) < 0.996


def test_the_volume_of_the_tlpm():
    robot = jk.mechanisms.tlpm.create(590.0, 590.0, (-200.0, 200.0))
    objective = jk.design.workspace_volume(robot)
    assert objective.measured(robot).value == pytest.approx(72322565.9305, abs=1e-3)
    assert float(objective(robot)) == pytest.approx(72322565.9305, abs=1e-3)
    assert objective.unit == "mm^3"


@pytest.mark.slow
def test_distances_to_cusps_are_those_of_the_closed_form():
    start, section = (
        jk.mechanisms.rpr3.analytic(1.0, 0.2, 0.9),
        jk.Grid(rho1=(0.0, 6.0, 40), rho2=1.0, rho3=(0.0, 6.0, 40)),
    )
    target = {"rho1": 1.4, "rho3": 1.7}
    objective = jk.design.cusp_distance(start, section, target, width=1e-2)
    rng = np.random.default_rng(3)
    numbers = np.array([1.0, 0.2, 0.9]) + rng.uniform(-0.15, 0.15, (8, 3))
    robots = [jk.mechanisms.rpr3.analytic(*own) for own in numbers]
    many = jax.tree.map(lambda *leaves: jnp.stack(leaves), *robots)
    coordinates = [jk.design.cusp_coordinate(start, section, joint, target) for joint in ("rho1", "rho3")]
    values, *places = (jax.jit(jax.vmap(one))(many) for one in (objective, *coordinates))
    for robot, value, *place in zip(robots, np.asarray(values), *map(np.asarray, places), strict=True):
        joints = np.asarray(closed_forms.section_cusps(robot, 1, 1.0).joints)
        joints = joints[np.isfinite(joints).all(axis=1) & np.all(joints <= 6.0, axis=1)][:, [0, 2]]
        away = np.min(np.linalg.norm(joints - [1.4, 1.7], axis=1))
        assert value == pytest.approx(math.hypot(away, 1e-2) - 1e-2, abs=1e-9)
        assert away - 1e-2 <= value <= away
        nearest = joints[np.argmin(np.linalg.norm(joints - [1.4, 1.7], axis=1))]
        np.testing.assert_allclose(place, nearest, atol=1e-9)


@pytest.mark.slow
def test_the_measured_distance_to_a_cusp_is_that_of_the_closed_form():
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    section = jk.Grid(rho1=(0.0, 4.0, 40), rho2=1.0, rho3=(0.0, 4.0, 40))
    found = jk.design.cusp_distance(robot, section, {"rho1": 1.0, "rho3": 2.0}).measured(robot)
    # Wenger and Chablat 2009: cusps at (1.04789131, 2.48920718) and (sqrt 3, 1).
    assert found.value == pytest.approx(math.hypot(0.0478913165750139, 0.4892071875813455), abs=1e-10)
    along = jk.design.cusp_coordinate(robot, section, "rho3", {"rho1": 1.0, "rho3": 2.0})
    assert along.measured(robot).value == pytest.approx(2.4892071875813455, abs=1e-10)
    assert along.unit == "length"


BAD_CUSPS = [
    ({"joint": "rho2"}, "joint is 'rho2': choose a free axis of the section, rho1 or rho3"),
    ({"near": {"rho1": 1.0}}, "near is {'rho1': 1.0}: it must give a number for each of rho1, rho3"),
    ({"near": {"rho1": 1.0, "rho3": float("nan")}}, "its values must be finite numbers"),
    ({"near": {"rho1": 1.0, "rho3": 5.0}}, "near has rho3 = 5, outside the section's 0 to 4"),
    ({"starts": 0}, "starts is 0: it must be a positive whole number"),
]


@pytest.mark.parametrize(("options", "message"), BAD_CUSPS)
def test_cusps_that_cannot_be_asked_for(options, message):
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
    section = jk.Grid(rho1=(0.0, 4.0, 40), rho2=1.0, rho3=(0.0, 4.0, 40))
    arguments = {"joint": "rho1", "near": {"rho1": 1.0, "rho3": 2.0}, **options}
    with pytest.raises(jk.InputError, match=re.escape(message)):
        jk.design.cusp_coordinate(robot, section, **arguments)


def distance_by_angles(numbers, pose, length):
    """The nearest singular pose of the analytic 3-RPR: at each angle f1 = 0 and f2 = 0 are lines."""
    c2, c3, d3 = numbers
    x, y, phi = pose

    def square(angle, which):
        s, c = np.sin(angle / 2), np.cos(angle / 2)
        if which == 0:
            away = np.abs(x * c + y * s)
        else:
            rest = -2 * c3 * d3 * s**3 + 2 * (c3 * c2 - c3**2 + d3**2) * s**2 * c + 2 * d3 * (c3 - c2) * s * c**2
            away = np.abs(d3 * (x * s - y * c) + rest) / abs(d3)
        return (away / length) ** 2 + (angle - phi) ** 2

    angles = np.linspace(phi - math.pi, phi + math.pi, 20001)
    best = math.inf
    for which in (0, 1):
        k = int(np.argmin(square(angles, which)))
        step = angles[1] - angles[0]
        ends = (angles[k] - step, angles[k] + step)
        found = scipy.optimize.minimize_scalar(square, ends, ends, (which,), method="bounded", options={"xatol": 1e-13})
        best = min(best, float(found.fun))
    return math.sqrt(best)


def test_distances_to_singularities_are_those_of_a_scan_over_the_angle():
    start = jk.mechanisms.rpr3.analytic(1.0, 0.2, 0.9)
    objective = jk.design.singularity_distance(start, [0.4, 0.5, 0.3], length=1.2)
    value = jax.jit(jax.vmap(objective))
    rng = np.random.default_rng(5)
    numbers = np.array([1.0, 0.2, 0.9]) + rng.uniform(-0.15, 0.15, (12, 3))
    poses = rng.uniform(-1.0, 1.0, (12, 3)) * [1.5, 1.5, 2.0]
    robots = [jk.mechanisms.rpr3.analytic(*own) for own in numbers]
    found = value(jax.tree.map(lambda *leaves: jnp.stack(leaves), *robots), jnp.asarray(poses))
    expected = [distance_by_angles(own, pose, 1.2) for own, pose in zip(numbers, poses, strict=True)]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_the_worst_singular_value_is_that_of_a_dense_grid():
    place = jk.design.box(general(0)[0], 5, **INTERVALS)
    objective = jk.design.smallest_singular_value(general(0)[0], place, length=LENGTH)

    def signed(numbers, poses):
        matrices, _ = rates(numbers, np.concatenate([place.center[None], poses]), LENGTH)
        determinants = np.linalg.det(matrices)
        return (np.linalg.svd(matrices, compute_uv=False)[:, -1] * np.sign(determinants * determinants[0]))[1:]

    values = []
    for seed in range(6):
        robot, numbers = general(seed)
        found = objective.measured(robot)
        dense = signed(numbers, grid(41, *INTERVALS.values())).min()
        assert dense - 1e-4 <= found.value <= dense + 1e-12
        assert signed(numbers, found.pose[None])[0] == pytest.approx(found.value, rel=1e-10)
        values.append(found.value)
    assert min(values) < 0 < max(values)


def test_conditioning_and_margins_and_strokes_are_those_of_a_dense_grid():
    robot, numbers = general(7)
    place = jk.design.box(robot, 5, **INTERVALS)
    matrices, legs = rates(numbers, grid(61, *INTERVALS.values()), LENGTH)
    sizes = np.linalg.svd(matrices, compute_uv=False)
    both = np.linalg.norm(matrices, axis=(1, 2)) * np.linalg.norm(np.linalg.inv(matrices), axis=(1, 2))
    known = {
        "spectral": (jk.design.inverse_condition_number, {"length": LENGTH}, np.min(sizes[:, -1] / sizes[:, 0])),
        "frobenius": (
            jk.design.inverse_condition_number,
            {"length": LENGTH, "norm": "frobenius"},
            np.min(3 / both),
        ),
        "margin": (jk.design.limit_margin, {}, np.min(np.minimum(legs - 0.3, 3.0 - legs))),
    }
    for name, (make, options, dense) in known.items():
        value = make(robot, place, **options).measured(robot).value
        assert dense - 1e-4 <= value <= dense + 1e-12, name
    stroke = jk.design.needed_stroke(robot, place).measured(robot).value
    assert np.max(np.ptp(legs, axis=0)) - 1e-12 <= stroke <= np.max(np.ptp(legs, axis=0)) + 1e-4


def test_the_mean_conditioning_is_that_of_a_dense_grid():
    robot, numbers = general(8)
    objective = jk.design.global_conditioning(robot, jk.design.box(robot, 6, **INTERVALS), length=LENGTH)
    found = objective.measured(robot)
    n = 60
    cells = [(low + (high - low) / (2 * n), high - (high - low) / (2 * n)) for low, high in INTERVALS.values()]
    sizes = np.linalg.svd(rates(numbers, grid(n, *cells), LENGTH)[0], compute_uv=False)
    assert found.value == pytest.approx(np.mean(sizes[:, -1] / sizes[:, 0]), abs=1e-5)
    assert abs(float(objective(robot)) - found.value) <= found.error


def test_the_mean_over_a_disc_weighs_by_area():
    robot, numbers = general(8)
    place = jk.design.ball(robot, {"x": 0.8, "y": 0.4}, 0.2, 8, phi=0.2)
    found = jk.design.global_conditioning(robot, place, length=LENGTH).measured(robot)
    xy = grid(801, (-1.0, 1.0), (-1.0, 1.0))
    xy = 0.2 * xy[np.sum(xy**2, axis=1) <= 1] + [0.8, 0.4]
    poses = np.column_stack([xy, np.full(len(xy), 0.2)])
    sizes = np.linalg.svd(rates(numbers, poses, LENGTH)[0], compute_uv=False)
    assert found.value == pytest.approx(np.mean(sizes[:, -1] / sizes[:, 0]), abs=1e-4)


def ring_area(centres, low, high, n=40000):
    """The area of an intersection of rings: by lines, on each of which the rings are pairs of intervals."""
    left, right = (
        max(c[0] - h for c, h in zip(centres, high, strict=True)),
        min(c[0] + h for c, h in zip(centres, high, strict=True)),
    )
    x = left + (right - left) * (np.arange(n) + 0.5) / n
    ends, tests = [], []
    for (cx, cy), inner, outer in zip(centres, low, high, strict=True):
        far, near = (np.sqrt(np.maximum(r**2 - (x - cx) ** 2, 0.0)) for r in (outer, inner))
        ends += [cy - far, cy - near, cy + near, cy + far]
        tests.append((cy, near, far))
    ends = np.sort(np.stack(ends), axis=0)
    middle, long = 0.5 * (ends[1:] + ends[:-1]), np.diff(ends, axis=0)
    inside = np.ones(middle.shape, bool)
    for cy, near, far in tests:
        inside &= (np.abs(middle - cy) > near) & (np.abs(middle - cy) < far)
    return float(np.sum(np.where(inside, long, 0.0)) * (right - left) / n)


@pytest.mark.parametrize("seed", range(4))
def test_areas_of_the_3_rpr_are_those_of_a_quadrature(seed):
    robot, _ = general(seed)
    rng = np.random.default_rng(seed)
    low, high = rng.uniform(0.4, 1.0, 3), rng.uniform(1.5, 2.6, 3)
    robot = robot.with_limits(**{f"rho{k + 1}": (low[k], high[k]) for k in range(3)})
    phi = float(rng.uniform(-0.5, 0.5))
    centres = []
    base, own = robot.base_points(), robot.platform_points()
    for (ax, ay), (bx, by) in zip(base, own, strict=True):
        turned = (bx * math.cos(phi) - by * math.sin(phi), bx * math.sin(phi) + by * math.cos(phi))
        centres.append((float(ax - turned[0]), float(ay - turned[1])))
    objective = jk.design.workspace_volume(robot, phi=phi)
    expected = ring_area(centres, low, high)
    assert expected > 0.1
    assert objective.measured(robot).value == pytest.approx(expected, rel=1e-5)
    assert float(objective(robot)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(("cranks", "rods"), [((2.0, 2.1), (2.4, 2.3)), ((1.2, 1.9), (2.2, 1.1))])
def test_areas_of_the_five_bar_are_those_of_a_quadrature(cranks, rods):
    robot = jk.mechanisms.five_bar.create(2.1, cranks, rods)
    low, high = np.abs(np.subtract(cranks, rods)), np.add(cranks, rods)
    expected = ring_area([(0.0, 0.0), (2.1, 0.0)], low, high)
    assert jk.design.workspace_volume(robot).measured(robot).value == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("norm", ["spectral", "frobenius"])
def test_a_place_that_a_singularity_cuts_has_negative_conditioning(norm):
    robot, _ = general(1)
    poses = grid(9, (0.3, 1.1), (0.0, 0.8), (-2.0, 2.0))
    direct = [
        float(jnp.linalg.det(jax.jacfwd(robot.constraints)(jnp.asarray(pose), jnp.ones(3)))) for pose in poses[::40]
    ]
    assert min(direct) < 0 < max(direct)
    place = jk.design.box(robot, 5, x=(0.3, 1.1), y=(0.0, 0.8), phi=(-2.0, 2.0))
    assert jk.design.inverse_condition_number(robot, place, norm=norm).measured(robot).value < -1e-3
    assert jk.design.smallest_singular_value(robot, place).measured(robot).value < -1e-3


def test_a_place_out_of_reach_is_negative():
    robot = jk.mechanisms.five_bar.create(2.1, (1.9, 2.05), (2.3, 2.2))
    place = jk.design.box(robot, 5, x=(0.6, 1.2), y=(2.0, 4.6))
    objective = jk.design.smallest_singular_value(robot, place, mode=(1, -1))
    assert float(jax.jit(objective)(robot)) < 0


@pytest.mark.parametrize("make", [jk.design.smallest_singular_value, jk.design.limit_margin])
def test_the_smoothed_value_is_within_the_stated_bound(make):
    robot, _ = general(2)
    place = jk.design.box(robot, 5, **INTERVALS)
    sharp = make(robot, place)
    parts = np.asarray(sharp.parts(robot, None))
    measured = sharp.measured(robot).value
    assert float(sharp(robot)) == parts.min()
    assert measured <= parts.min() + 1e-14
    assert sharp.smoothing_error(robot) == pytest.approx(parts.min() - measured, abs=1e-15)
    for width in (1e-3, 0.02, 0.3):
        objective = make(robot, place, width=width)
        value = float(objective(robot))
        assert parts.min() - width * math.log(parts.size) <= value <= parts.min()
        assert f"{width * math.log(parts.size):.3g} below" in objective.smoothing
    assert value < parts.min() - 0.3
    assert objective.smoothing_error(robot) == pytest.approx(value - measured, abs=1e-15)


def test_the_smoothed_stroke_is_within_the_stated_bound():
    share = 0.02
    robot, numbers = general(2)
    objective = jk.design.needed_stroke(robot, jk.design.box(robot, 5, **INTERVALS), width=share)
    _, legs = rates(numbers, grid(5, *INTERVALS.values()), LENGTH)
    strokes = np.ptp(legs, axis=0)
    parts = np.asarray(objective.parts(robot, None))
    assert np.all(parts >= strokes)
    assert np.all(parts <= strokes * (1 + 2 * share * math.log(125)))
    value = float(objective(robot))
    assert parts.max() <= value <= parts.max() + objective.width * math.log(3)
    assert objective.smoothing_error(robot) == pytest.approx(value - objective.measured(robot).value, abs=1e-15)
