"""The boundary of the stroke workspace as meshes: closed, on its surfaces, and around the right volume."""

import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.mapping.workspace import workspace_surfaces, workspace_volume
from jaxkin.mechanisms import rpr3, tlpm

HOME = 590 * math.sqrt(2)
THIRDS = np.array([0.0, 2 * math.pi / 3, -2 * math.pi / 3])
SPHERES = {f"l{i} = l{i}_{end}" for i in (1, 2, 3) for end in ("min", "max")}
FLAT = "z = -h, singular"
CASES = {
    "curved cube": (-200.0, 200.0),
    "flat piece of one part": (-400.0, 400.0),
    "flat piece of three parts": (-300.0, 300.0),
    "hemispheres": (-600.0, 0.0),
    "small hemispheres": (-830.0, 2000.0),
    "three balls and a little": (-834.0, 100.0),
    "tiny": (-1e-3, 1e-3),
}


def random_design(seed):
    rng = np.random.default_rng(seed)
    reach = 100.0 * (1 + seed % 6)
    return tlpm.create(
        base_radius=rng.uniform(400, 800),
        height=rng.uniform(400, 800),
        stroke=(-reach * rng.uniform(0.6, 1.0, 3), reach * rng.uniform(0.6, 1.0, 3)),
        initial_lengths=HOME + rng.uniform(-50, 50, 3),
        limb_angles=THIRDS + rng.uniform(-0.25, 0.25, 3),
    )


def inside(robot, branch, points, slack):
    """True where the strokes allow the points and they are on the right side of the base plane."""
    shells, plane = robot.reach_spheres()
    centres = np.column_stack([np.asarray(shells.centres), np.full(3, float(plane))])
    distance = np.linalg.norm(points[:, None] - centres, axis=-1)
    side = (points[:, 2] - float(plane)) * (1 if branch == "upper" else -1)
    within = np.all(
        (distance >= np.asarray(shells.low) - slack) & (distance <= np.asarray(shells.high) + slack), axis=1
    )
    return within & (side >= -slack)


@pytest.mark.parametrize("stroke", CASES.values(), ids=CASES)
@pytest.mark.parametrize("branch", ["upper", "lower"])
def test_meshes_are_closed_and_converge(stroke, branch):
    robot = tlpm.create(stroke=stroke)
    coarse, fine = (workspace_surfaces(robot, branch, n) for n in (12, 48))
    for found in (coarse, fine):
        assert found.open_edges == 0
        assert found.residual <= 1e-12
    assert fine.volume == float(workspace_volume(robot).volume)
    assert fine.mesh_volume == pytest.approx(fine.volume, rel=1.5e-3)
    assert abs(fine.mesh_volume - fine.volume) <= abs(coarse.mesh_volume - coarse.volume) / 8 + 1e-9 * fine.volume
    for patch in fine:
        assert patch.mesh_area == pytest.approx(patch.area, rel=1e-2)
        assert inside(robot, branch, patch.vertices, 1e-9 * HOME).all()


def test_faces_of_the_curved_cube():
    found = workspace_surfaces(tlpm.create())
    assert {patch.name for patch in found} == SPHERES
    corners = {tuple(v) for v in found["l1 = l1_min"].vertices} & {tuple(v) for v in found["l2 = l2_max"].vertices}
    assert len(corners) > 2
    # By symmetry the three faces of shortest limbs are congruent.
    assert found["l1 = l1_min"].area == pytest.approx(found["l3 = l3_min"].area, rel=1e-12)


def test_flat_piece():
    robot = tlpm.create(stroke=(-400.0, 400.0))
    found = workspace_surfaces(robot)
    assert {patch.name for patch in found} == SPHERES | {FLAT}
    flat = found[FLAT]
    assert flat.singular
    np.testing.assert_array_equal(flat.vertices[:, 2], -590.0)
    # In the plane the area is that of three annuli's intersection; here by counting.
    x = np.linspace(-1300, 1300, 2601)
    grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    shells, _ = robot.reach_spheres()
    away = np.linalg.norm(grid[:, None] - np.asarray(shells.centres), axis=-1)
    count = np.sum(np.all((away > np.asarray(shells.low)) & (away < np.asarray(shells.high)), axis=1))
    assert flat.area == pytest.approx(count, rel=2e-3)


@pytest.mark.slow
def test_areas_of_spherical_faces_by_their_own_integral():
    """dA = r ds_j ds_k / (8 A w), with s the squared lengths and A the area of the triangle of the q_i."""
    robot = tlpm.create(stroke=(-200.0, 150.0))
    found = workspace_surfaces(robot, n=4)
    x, weights = np.polynomial.legendre.leggauss(40)
    low, high = (HOME - 200) ** 2, (HOME + 150) ** 2
    s = (low + high) / 2 + (high - low) / 2 * x
    for e, r in (("min", HOME - 200), ("max", HOME + 150)):
        sj, sk = np.meshgrid(s, s)
        px = (sj + sk - 2 * r**2) / (6 * 590)
        py = (sj - sk) / (2 * math.sqrt(3) * 590)
        w = np.sqrt(r**2 - (px - 590) ** 2 - py**2)
        area = r * np.sum(np.outer(weights, weights) / w) * ((high - low) / 2) ** 2 / (6 * math.sqrt(3) * 590**2)
        assert found[f"l1 = l1_{e}"].area == pytest.approx(area, rel=1e-12)


def test_triangles_look_outwards():
    for branch in ("upper", "lower"):
        robot = tlpm.create(stroke=(-400.0, 400.0))
        for patch in workspace_surfaces(robot, branch, 24):
            a, b, c = (patch.vertices[patch.faces[:, k]] for k in range(3))
            normal = np.cross(b - a, c - a)
            size = np.linalg.norm(normal, axis=1)
            middle, normal = (a + b + c)[size > 1] / 3, (normal / size[:, None])[size > 1]
            step = 3.0 * (np.sqrt(size[size > 1]) / 40 + 1)[:, None] * normal
            assert not inside(robot, branch, middle + step, 0.0).all()
            assert inside(robot, branch, middle - step, 0.0).mean() > 0.9
            assert inside(robot, branch, middle + step, 0.0).mean() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_designs(seed):
    found = workspace_surfaces(random_design(seed), n=24)
    assert found.open_edges == 0
    assert found.residual <= 1e-12
    assert found.mesh_volume == pytest.approx(found.volume, rel=2e-2)
    np.testing.assert_allclose(
        [p.mesh_area for p in found if p.area > 1e-3 * found.area],
        [p.area for p in found if p.area > 1e-3 * found.area],
        rtol=0.06,
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 180))
def test_many_random_designs(seed):
    found = workspace_surfaces(random_design(seed), n=32)
    assert found.open_edges == 0
    assert found.residual <= 1e-12
    assert found.mesh_volume == pytest.approx(found.volume, rel=1e-2)


def test_branches_are_mirror_images():
    upper, lower = (workspace_surfaces(tlpm.create(stroke=(-300.0, 300.0)), b, 8) for b in ("upper", "lower"))
    for one, other in zip(upper, lower, strict=True):
        assert one.name == other.name
        np.testing.assert_allclose(other.vertices, one.vertices * [1, 1, -1] - [0, 0, 1180], atol=1e-9)


def test_record():
    found = workspace_surfaces(tlpm.create(stroke=(-300.0, 300.0)), n=6)
    assert len(found) == 7
    assert found[-1] is found[FLAT]
    assert len(found[:3]) == 3
    assert "no open edges" in str(found)
    content = json.loads(found.to_json())
    assert content["request"]["n"] == 6
    assert len(content["patches"]) == 7
    with pytest.raises(KeyError, match="l1_min"):
        found["l9"]


def test_refusals():
    robot = tlpm.create()
    with pytest.raises(InputError, match="did you mean 'lower'"):
        workspace_surfaces(robot, "lowr")
    with pytest.raises(InputError, match="at least 2"):
        workspace_surfaces(robot, n=1)
    with pytest.raises(InputError, match="reach_spheres"):
        workspace_surfaces(rpr3.reference())
    with pytest.raises(InputError, match="cannot be traced"):
        jax.jit(lambda r: workspace_surfaces(tlpm.create(r)).volume)(590.0)
    with pytest.raises(InputError, match="batch of robots"):
        workspace_surfaces(jax.vmap(lambda r: tlpm.create(r))(jnp.array([500.0, 600.0])))
    with pytest.raises(GeometryError, match="reach nothing"):
        workspace_surfaces(tlpm.create(stroke=(-634.0, -534.0)))
