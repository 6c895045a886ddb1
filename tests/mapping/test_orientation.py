"""Aspects, solids, balls and reachable shares of the 3-PPPS' orientations against exact numbers."""

import json
import math

import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.core.errors import InputError
from jaxkin.mapping import orientation
from jaxkin.mechanisms import ppps3, rpr3
from jaxkin.mechanisms import ppps3_closed_forms as closed
from jaxkin.numerics import haar, rotations

RIGHT = math.pi / 2


@pytest.fixture(scope="module")
def robot() -> ppps3.PPPS3:
    return ppps3.create(1.3)


@pytest.fixture(scope="module")
def aspects(robot: ppps3.PPPS3) -> orientation.OrientationAspects:
    return orientation.orientation_aspects(robot)


def limited(**bounds: tuple[float, float]) -> ppps3.PPPS3:
    """Returns a robot of side 1 of which only the named joints are limited."""
    names = [axis.name for axis in ppps3.PPPS3.joint_axes]
    parts = []
    for group in (names, list(ppps3.PASSIVE)):
        low, high = zip(*(bounds.get(name, (-math.inf, math.inf)) for name in group), strict=True)
        parts.append(jk.Limits(jnp.array(low), jnp.array(high)))
    return ppps3.create(limits=parts[0], passive_limits=parts[1])


def watertight(solid: orientation.Solid) -> bool:
    """True where every directed side of a triangle occurs once, and its opposite once."""
    sides = np.concatenate([solid.faces[:, [0, 1]], solid.faces[:, [1, 2]], solid.faces[:, [2, 0]]])
    there = set(map(tuple, sides.tolist()))
    return len(there) == len(sides) and all((b, a) in there for a, b in there)


def euler_characteristic(solid: orientation.Solid) -> int:
    return len(solid.vertices) - len(solid.faces) // 2


def test_four_aspects_of_a_quarter_and_pi_cubed(robot: ppps3.PPPS3, aspects: orientation.OrientationAspects):
    assert [a.label for a in aspects] == list(robot.forward_labels)
    for aspect in aspects:
        assert aspect.share == pytest.approx(0.25, abs=1e-9)
        assert aspect.volume == pytest.approx(math.pi**3, abs=1e-9)
        assert aspect.share_error < 1e-9
        assert aspect.volume_error < 1e-8
    assert sum(a.volume for a in aspects) == pytest.approx(4 * math.pi**3)


def test_representatives_are_the_deepest_rotations(aspects: orientation.OrientationAspects):
    deepest = ([1, 1, 1], [-1, 1, -1], [-1, -1, 1], [1, -1, -1])
    for aspect, diagonal in zip(aspects, deepest, strict=True):
        np.testing.assert_allclose(aspect.rotation, np.diag(diagonal), atol=1e-13)
        assert (np.sign([aspect.rotation[1, 1], aspect.rotation[2, 2]]) == aspect.signs).all()


def test_neighbours_differ_in_the_sign_of_the_factor_between(aspects: orientation.OrientationAspects):
    for aspect in aspects:
        assert set(aspect.neighbours) == {"R22", "R33"}
        for name, label in aspect.neighbours.items():
            other = aspects[label]
            changed = [one != two for one, two in zip(aspect.signs, other.signs, strict=True)]
            assert changed == [name == "R22", name == "R33"]
            assert other.neighbours[name] == aspect.label


def test_the_record_names_prints_and_writes(aspects: orientation.OrientationAspects):
    assert aspects["home"] is aspects[0]
    assert aspects["R22 < 0, R33 > 0"].signs == (-1, 1)
    assert "0.25" in str(aspects)
    assert len(json.loads(aspects.to_json())["aspects"]) == 4
    with pytest.raises(KeyError, match="home"):
        aspects["south"]


@pytest.mark.parametrize("n", [2, 5, 12])
@pytest.mark.parametrize("chart", ["xyz", "zxy"])
def test_the_home_solid_is_closed_exact_and_of_volume_pi_cubed(robot: ppps3.PPPS3, chart: str, n: int):
    solid = orientation.aspect_solid(robot, chart=chart, n=n)
    assert watertight(solid)
    assert euler_characteristic(solid) == 2
    assert solid.residual <= 1e-12
    assert solid.volume == pytest.approx(math.pi**3, abs=1e-9)
    assert {solid.names[k] for k in np.unique(solid.patch)} == {"R22", "R33", "chart"}
    make = rotations.matrix_from_xyz if chart == "xyz" else rotations.matrix_from_zxy
    for name, k in (("R22", 1), ("R33", 2)):
        m = make(*jnp.asarray(solid.vertices[solid.on(name)].reshape(-1, 3).T))
        assert np.abs(m[k][k]).max() <= 1e-15
    np.testing.assert_allclose(np.abs(solid.vertices[solid.on("chart")][..., 1]), RIGHT)
    assert len(solid.edges) > 0


def test_the_xyz_solid_is_the_described_one(robot: ppps3.PPPS3):
    solid = orientation.aspect_solid(robot, n=10)
    phi, theta, sigma = solid.vertices.T
    low, high = (np.asarray(end) for end in closed.home_interval(phi, theta))
    # At the torn points (+-pi/2, 0) all sigma are in the closure.
    torn = (np.abs(np.abs(phi) - RIGHT) < 1e-12) & (np.abs(theta) < 1e-12)
    assert ((sigma >= low - 1e-12) & (sigma <= high + 1e-12))[~torn].all()
    assert np.ptp(sigma[torn & (phi > 0)]) == pytest.approx(2 * math.pi)
    # Triangles on R22 = 0 approach the surface: their middles' residuals fall with 1/n^2.
    errors = []
    for n in (4, 8, 16):
        mesh = orientation.aspect_solid(robot, n=n)
        middle = mesh.vertices[mesh.on("R22")].mean(axis=1)
        m = rotations.matrix_from_xyz(*jnp.asarray(middle.T))
        errors.append(float(np.abs(m[1][1]).max()))
    assert errors[1] < errors[0] / 3
    assert errors[2] < errors[1] / 3


@pytest.mark.parametrize("chart", ["xyz", "zxy"])
def test_the_other_aspects_are_solids_with_their_signs(robot: ppps3.PPPS3, chart: str):
    make = rotations.matrix_from_xyz if chart == "xyz" else rotations.matrix_from_zxy
    for label, signs in zip(robot.forward_labels, closed.SIGNS, strict=True):
        solid = orientation.aspect_solid(robot, label, chart, n=4)
        assert watertight(solid)
        assert solid.residual <= 1e-12
        # A small copy about the middle is inside.
        center = solid.vertices.mean(axis=0)
        m = make(*jnp.asarray((0.1 * solid.vertices + 0.9 * center).T))
        assert (np.sign(m[1][1]) == signs[0]).all()
        assert (np.sign(m[2][2]) == signs[1]).all()


def test_the_joint_solid_converges_to_its_volume(robot: ppps3.PPPS3):
    exact = 8 / math.sqrt(3) * 1.3**3
    errors = []
    for n in (8, 16, 32):
        solid = orientation.joint_solid(robot, n)
        assert watertight(solid)
        assert euler_characteristic(solid) == 2
        assert solid.residual <= 1e-12
        errors.append(exact - solid.volume)
    assert errors[0] > 0
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.02)
    assert float(closed.joints_volume(robot)) == pytest.approx(exact, rel=1e-13)
    mirrored = orientation.joint_solid(ppps3.create(1.3, mirrored=True), 16)
    assert watertight(mirrored)
    assert mirrored.volume == pytest.approx(exact - errors[1], rel=1e-12)


def test_the_largest_ball_about_home_is_ninety_degrees(robot: ppps3.PPPS3):
    ball = orientation.largest_rotation_ball(robot)
    assert ball.radius == pytest.approx(RIGHT, abs=1e-12)
    assert ball.radii == pytest.approx({"R22": RIGHT, "R33": RIGHT}, abs=1e-12)
    assert ball.share == pytest.approx((RIGHT - 1) / math.pi, abs=1e-12)
    assert ball.residual < 1e-12
    assert min(ball.converged.values()) > 0.5 * ball.starts
    angle = rotations.rotation_angle(rotations.from_array(jnp.asarray(ball.touching)))
    np.testing.assert_allclose(angle, RIGHT, atol=1e-9)
    for number, axis in ((0, 1), (1, 2)):
        touching = ball.touching[ball.touching_factor == number]
        # Axes in the plane of x and z for R22, of x and y for R33, all round.
        vector = (touching[:, [2, 0, 1], [1, 2, 0]] - touching[:, [1, 2, 0], [2, 0, 1]]) / 2
        np.testing.assert_allclose(vector[:, axis], 0, atol=1e-6)
        turn = np.arctan2(vector[:, 3 - axis], vector[:, 0])
        assert np.diff(np.sort(turn)).max() < 0.5
        nearest = np.asarray(closed.nearest_singular_rotation(("R22", "R33")[number], turn))
        np.testing.assert_allclose(nearest, touching, atol=1e-6)
    # And no rotation inside is in another aspect.
    inside = haar.random_rotations(40000)
    inside = inside[np.trace(inside, axis1=1, axis2=2) > 1 + 1e-9]
    assert (inside[:, 1, 1] > 0).all()
    assert (inside[:, 2, 2] > 0).all()
    assert len(inside) / 40000 == pytest.approx(ball.share, abs=0.01)


def test_a_ball_about_another_centre_touches_the_nearest_of_many_samples(robot: ppps3.PPPS3):
    center = np.asarray(rotations.as_array(rotations.matrix_from_xyz(*map(jnp.asarray, (0.4, -0.3, 0.2)))))
    ball = orientation.largest_rotation_ball(robot, center)
    sampled = haar.random_rotations(200000)
    near = np.arccos(np.clip((np.einsum("ij,nij->n", center, sampled) - 1) / 2, -1, 1)) < ball.radius
    assert (sampled[near][:, 1, 1] > 0).all()
    assert (sampled[near][:, 2, 2] > 0).all()
    # R33 is the cosine between the third axes: the shortest turn to a right angle takes the rest of it, asin(R33).
    assert ball.radii["R33"] == pytest.approx(math.asin(center[2, 2]), abs=1e-9)
    assert ball.radii["R22"] == pytest.approx(math.asin(center[1, 1]), abs=1e-9)


def test_without_limits_the_whole_aspect_is_reachable():
    found = orientation.reachable_share(ppps3.create(), (0.3, -0.2, 5.0))
    assert found.share == pytest.approx(0.25, abs=1e-6)
    assert found.aspect_share == pytest.approx(0.25, abs=1e-6)
    assert found.volume == pytest.approx(math.pi**3, abs=1e-4)
    assert found.binding == {}


def test_a_limit_on_a_joint_of_the_position_is_all_or_nothing():
    machine = limited(rho1y=(-1.0, 1.0), rho1x=(-2.0, 2.0))
    assert orientation.reachable_share(machine, (0.0, 0.5, 0.0)).share == pytest.approx(0.25, abs=1e-6)
    found = orientation.reachable_share(machine, (0.0, 1.5, 0.0))
    assert found.share == 0.0
    assert found.volume == 0.0
    assert found.binding == pytest.approx({"rho1y_high": 0.25}, abs=1e-6)


def test_limits_that_forbid_the_half_by_symmetry():
    # rho2z - z = -(sqrt3 R31 + R32) / 2. In the chart Z-X-Y, (beta, gamma) -> (-beta, -gamma) changes the signs of R31
    # and R32, and neither R22 nor R33 nor Haar's measure.
    machine = limited(rho2z=(-math.inf, 1.0))
    found = orientation.reachable_share(machine, (0.0, 0.0, 1.0), tolerance=1e-4)
    assert found.share == pytest.approx(0.125, abs=1e-5)
    assert list(found.binding) == ["rho2z_high"]
    assert found.binding["rho2z_high"] == pytest.approx(0.125, abs=1e-5)


def test_limits_of_all_nine_joints_against_random_rotations():
    every = [axis.name for axis in ppps3.PPPS3.joint_axes] + list(ppps3.PASSIVE)
    machine = limited(**dict.fromkeys(every, (-0.9, 0.95)))
    position = np.array([0.2, 0.1, 0.1])
    found = orientation.reachable_share(machine, position, tolerance=1e-3)
    sampled = haar.random_rotations(20000)
    angles = jnp.stack(rotations.xyz_from_matrix(rotations.from_array(jnp.asarray(sampled))), axis=-1)
    poses = jnp.concatenate([jnp.tile(position, (20000, 1)), angles], axis=1)
    joints = jnp.stack(machine.inverse_kernel(tuple(poses.T))[0].values, axis=-1)
    margins = machine.margins(poses, joints)
    home = (sampled[:, 1, 1] > 0) & (sampled[:, 2, 2] > 0)
    good = home & np.all([np.asarray(value) > 0 for value in margins.values()], axis=0)
    assert 0.02 < found.share < 0.2
    assert found.share == pytest.approx(good.mean(), abs=4 * math.sqrt(0.2 / 20000))
    for name, share in found.binding.items():
        assert share == pytest.approx((home & (np.asarray(margins[name]) <= 0)).mean(), abs=4 * math.sqrt(0.2 / 20000))
    assert list(found.binding.values()) == sorted(found.binding.values(), reverse=True)
    # The Euler volume by the same samples, each weighing 8 pi^2 / cos(theta) of a share.
    weight = np.where(good, 8 * math.pi**2 / np.cos(np.asarray(angles[:, 1])), 0.0)
    assert found.volume == pytest.approx(weight.mean(), abs=5 * weight.std() / math.sqrt(20000))


def test_what_is_refused(robot: ppps3.PPPS3):
    planar = rpr3.reference()
    for call in (orientation.orientation_aspects, orientation.largest_rotation_ball, orientation.aspect_solid):
        with pytest.raises(InputError):
            call(planar)
    with pytest.raises(InputError, match="label"):
        orientation.aspect_solid(robot, "south")
    with pytest.raises(InputError, match="label"):
        orientation.reachable_share(robot, (0, 0, 0), "south")
    with pytest.raises(InputError, match="chart"):
        orientation.aspect_solid(robot, chart="abc")
    with pytest.raises(InputError, match="n is"):
        orientation.joint_solid(robot, 1)
    with pytest.raises(InputError, match="position"):
        orientation.reachable_share(robot, (0, 0))
    with pytest.raises(InputError, match="singular"):
        orientation.largest_rotation_ball(robot, closed.nearest_singular_rotation("R33", 0.3))
    with pytest.raises(InputError, match="rotation"):
        orientation.largest_rotation_ball(robot, np.diag([1.0, 1.0, -1.0]))


@pytest.mark.slow
def test_the_volume_of_a_small_region_is_not_lost():
    """No volume in the chart is less than 8 pi^2 times the share of the rotations, as 1 / cos(theta) >= 1."""
    robot, position = ppps3.create(side=1.3), [0.08251642, 0.89554635, -0.58480141]
    joints = np.asarray(jk.inverse(robot, [*position, 0.36, -0.16, -0.5]).values[0])
    width = np.array([50.0, 50.0, 0.03, 0.03, 0.03, 0.03])
    narrow = ppps3.create(side=1.3, limits=jk.Limits(joints - width, joints + width))
    found = jk.reachable_share(narrow, position, tolerance=1e-5)
    assert found.volume + found.volume_error >= 8 * np.pi**2 * found.share > 1e-5
    assert found.volume > 1e-5
