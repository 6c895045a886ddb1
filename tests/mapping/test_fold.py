"""The patch of poses around a singular pose: on the section, with the fold where the determinant changes its sign."""

import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from section_checks import residuals, section

import jaxkin as jk

EXAMPLE = zoo.build(np.array(zoo.EXAMPLE))
GRID = section(1, 1.0)
#: The pose over the cusp (sqrt 3, 1).
CUSP = np.array([1 + np.sqrt(0.5), 1 - np.sqrt(0.5), -np.pi / 2])
#: An ordinary singular pose: f2 = 0 at phi = 0 where y = 0.
PLAIN = np.array([1.0, 0.0, 0.0])


@pytest.fixture(scope="module", params=["cusp", "plain"])
def patch(request):
    pose = CUSP if request.param == "cusp" else PLAIN
    return request.param, pose, jk.fold(EXAMPLE, GRID, pose, radius=0.3, samples=41)


def test_shapes_and_names(patch):
    _, pose, fold = patch
    assert fold.joints.shape == fold.poses.shape == (41, 41, 3)
    assert fold.determinant.shape == (41, 41)
    assert fold.fold_joints.shape == fold.fold_poses.shape
    assert (fold.pose_names, fold.joint_names) == (("x", "y", "phi"), ("rho1", "rho2", "rho3"))
    assert fold.free == ("rho1", "rho3")
    np.testing.assert_array_equal(fold.pose, pose)


def test_poses_close_and_the_middle_is_the_singular_pose(patch):
    _, pose, fold = patch
    closing, _ = residuals(EXAMPLE, fold.poses.reshape(-1, 3), fold.joints.reshape(-1, 3))
    assert closing < 1e-13
    np.testing.assert_allclose(fold.joints[..., 1], 1.0, rtol=1e-13)
    np.testing.assert_allclose(fold.poses[20, 20], pose, atol=1e-9)
    assert abs(fold.determinant[20, 20]) < 1e-12


def test_the_fold_is_singular_and_passes_the_pose(patch):
    _, pose, fold = patch
    assert max(residuals(EXAMPLE, fold.fold_poses, fold.fold_joints)) < 1e-11
    assert zoo.glued_distance(fold.fold_poses, pose).min() < 5e-3
    assert len(fold.fold_poses) > 100


def test_the_determinant_changes_its_sign_across_the_fold(patch):
    _, pose, fold = patch
    # Rows run along the fold's tangent, columns across it.
    across = fold.determinant[20]
    assert across[0] * across[-1] < 0
    assert np.sum(np.sign(across[:20])) == -np.sum(np.sign(across[21:]))
    # Between neighbours of opposite sign there is a point of the fold.
    sign = np.sign(fold.determinant)
    i, j = np.nonzero(sign[:, 1:] * sign[:, :-1] < 0)
    spacing = zoo.glued_distance(fold.poses[20, 20], fold.poses[20, 21])
    middle = 0.5 * (fold.poses[i, j] + fold.poses[i, j + 1])
    near = np.max(np.abs(middle - pose), axis=1) < 0.25
    gaps = zoo.glued_distance(middle[near][:, None], fold.fold_poses[None]).min(axis=1)
    assert len(gaps) > 20
    assert gaps.max() < 2 * spacing


def test_sheets_over_the_joints(patch):
    kind, pose, fold = patch
    # Both sheets lie over the neighbourhood of the pose, and as many modes meet in it as a fold or a cusp has.
    joints, target = fold.joints[..., [0, 2]].reshape(-1, 2), fold.joints[20, 20]
    near = np.linalg.norm(joints - target[[0, 2]], axis=1) < 0.02
    assert {-1.0, 1.0} <= set(np.sign(fold.determinant.ravel()[near]))
    modes = jk.forward(EXAMPLE, jk.inverse(EXAMPLE, pose).values[0])
    here = np.nanargmin(zoo.glued_distance(np.asarray(modes.values), pose))
    assert int(modes.multiplicity[here]) == (3 if kind == "cusp" else 2)


def test_any_turn_of_the_angle_will_do(patch):
    _, pose, fold = patch
    turned = jk.fold(EXAMPLE, GRID, pose + np.array([0, 0, 2 * np.pi]), radius=0.3, samples=41)
    np.testing.assert_allclose(turned.joints, fold.joints, atol=1e-9)


def test_poses_that_are_not_singular_or_not_on_the_section_are_refused():
    for pose in ([1.0, 0.3, 0.0], [1.0, 0.0, 0.1], [0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]):
        with pytest.raises(jk.InputError, match=r"jk\.fold: no singular pose of the section .* jk\.cusps"):
            jk.fold(EXAMPLE, GRID, pose)
    with pytest.raises(jk.InputError, match=r"no singular pose"):
        jk.fold(EXAMPLE, section(1, 1.1), CUSP)


@pytest.mark.parametrize("bad", [[1.0, 0.0], [[1.0, 0.0, 0.0]], "abc", None])
def test_poses_of_another_shape_are_refused(bad):
    with pytest.raises(jk.InputError, match=r"jk\.fold: the pose"):
        jk.fold(EXAMPLE, GRID, bad)


@pytest.mark.parametrize("options", [{"radius": 0.0}, {"radius": -1.0}, {"radius": np.nan}, {"samples": 2}])
def test_bad_patches_are_refused(options):
    with pytest.raises(jk.InputError, match=r"radius is .* samples is"):
        jk.fold(EXAMPLE, GRID, CUSP, **options)


def test_free_joints_that_the_pose_does_not_give_are_refused():
    robot = zoo.FiveBar(*jnp.array([2.5, 1.0, 1.3]))
    grid = jk.Grid(theta1=(-3.0, 3.0, 50), theta2=(-3.0, 3.0, 50))
    with pytest.raises(jk.InputError, match="not drawn yet"):
        jk.fold(robot, grid, [1.0, 0.0])


def test_an_even_number_of_samples_is_made_odd():
    assert jk.fold(EXAMPLE, GRID, CUSP, radius=0.3, samples=40).joints.shape == (41, 41, 3)
