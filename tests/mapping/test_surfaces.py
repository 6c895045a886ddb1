import json
import math

import hypothesis
import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from jax import Array

import jaxkin as jk
from jaxkin.core.branches import Lane
from jaxkin.mechanisms import rpr3

TURN = (-math.pi, math.pi)
EXAMPLE = zoo.build(np.array(zoo.EXAMPLE))
RIGHT = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 2.0]])


class _Rails(jk.Mechanism):
    """Carriages on three vertical rails carry the point (x, y, z) by rods; each has two places for a pose."""

    def constraints(self, pose, joints):
        off = pose[:2] - self.feet
        return jnp.sum(off**2, axis=1) + (pose[2] - joints) ** 2 - self.rod**2

    def characteristic_length(self):
        return self.rod


@jk.mechanism
class Rails(_Rails):
    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"), jk.Axis("z", "length"))
    joint_axes = (jk.Axis("q1", "length"), jk.Axis("q2", "length"), jk.Axis("q3", "length"))
    feet: Array
    rod: Array

    def inverse_kernel(self, pose):
        x, y, z = pose
        squares = [self.rod**2 - (x - foot[0]) ** 2 - (y - foot[1]) ** 2 for foot in self.feet]
        here = (squares[0] >= 0) & (squares[1] >= 0) & (squares[2] >= 0)
        count, roots = jnp.where(here, jnp.int8(1), jnp.int8(0)), [jnp.sqrt(jnp.maximum(s, 0.0)) for s in squares]
        status = jnp.where(here, jnp.int8(jk.Status.OK), jnp.int8(jk.Status.NO_REAL_SOLUTION))
        return tuple(
            Lane(tuple(jnp.where(here, z + (-1) ** k * r, jnp.nan) for k, r in zip(mode, roots, strict=True)),
                 status, count, jnp.zeros_like(x))
            for mode in np.ndindex(2, 2, 2)
        )  # fmt: skip


@jk.mechanism
class RailsAndTurn(jk.Mechanism):
    """The same with a turntable of its own drive: a fourth pose axis, which no singularity depends on."""

    pose_axes = (*Rails.pose_axes, jk.angle("psi"))
    joint_axes = (*Rails.joint_axes, jk.angle("drive"))
    rails: Rails

    def constraints(self, pose, joints):
        return jnp.append(self.rails.constraints(pose[:3], joints[:3]), jnp.sin(pose[3] - joints[3]))

    def characteristic_length(self):
        return self.rails.rod

    def inverse_kernel(self, pose):
        lanes = self.rails.inverse_kernel(pose[:3])
        return tuple(lane._replace(values=(*lane.values, pose[3] + 0 * lane.values[0])) for lane in lanes)


@jk.mechanism
class Unsolved(_Rails):
    pose_axes = Rails.pose_axes
    joint_axes = Rails.joint_axes
    feet: Array
    rod: Array


@jk.mechanism
class Coupled(_Rails):
    """The second drive moves the first carriage a little as well."""

    pose_axes = Rails.pose_axes
    joint_axes = Rails.joint_axes
    feet: Array
    rod: Array

    def constraints(self, pose, joints):
        return super().constraints(pose, joints + jnp.array([0.1, 0.0, 0.0]) * joints[1])


def rails(feet: np.ndarray = RIGHT) -> Rails:
    return Rails(feet=jnp.asarray(feet), rod=jnp.asarray(3.0))


def box(size: float, n: int, phi: tuple[float, float] = TURN) -> jk.Grid:
    return jk.Grid(x=(-size, size, n), y=(-size, size, n), phi=(*phi, n))


def dimensionless_determinants(robot, poses: np.ndarray) -> np.ndarray:
    """The determinant of the direct Jacobian, by the public functions alone, rows and columns made dimensionless."""
    length = float(robot.characteristic_length())
    joints = _joints(robot, poses)
    direct = np.asarray(jax.vmap(lambda x, q: jk.jacobians(robot, x, q).direct)(jnp.asarray(poses), joints))
    rows = np.asarray(joints) ** 2 + length**2
    return np.linalg.det(direct * np.array([length, length, 1.0]) / rows[:, :, None])


def _joints(robot, poses: np.ndarray) -> Array:
    return jax.vmap(lambda pose: jk.inverse(robot, pose).values[0])(jnp.asarray(poses))


def glued_counts(surface: jk.Surface) -> tuple[int, int, int]:
    """Numbers of vertices, edges and triangles after the seam's pairs are made one."""
    alias = np.arange(len(surface.vertices))
    alias[surface.seam[:, 1]] = surface.seam[:, 0]
    faces = alias[surface.faces]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return len(np.unique(faces)), len(np.unique(edges, axis=0)), len(faces)


def assert_closed(surface: jk.Surface, ends: np.ndarray) -> None:
    """The rim of a surface without holes lies on the faces of the box."""
    rim = surface.vertices[surface.boundary]
    on_face = (np.abs(rim) == ends) & (rim[:, :1] == rim)
    assert on_face.all(axis=1).any(axis=1).all()


@pytest.fixture(scope="module")
def example() -> jk.SingularSurfaces:
    return jk.singular_surfaces(EXAMPLE, box(3.0, 60))


@pytest.fixture(scope="module")
def reference() -> jk.SingularSurfaces:
    return jk.singular_surfaces(jk.mechanisms.rpr3.reference(), box(30.0, 40))


def test_the_example_has_the_two_factors_in_one_piece_each(example):
    assert [surface.name for surface in example] == ["f1", "f2"]
    assert example.glued == ("phi",)
    for surface in example:
        assert surface.components == 1
        assert surface.unpolished == 0
        assert surface.residual <= 1e-12
        assert_closed(surface, np.array([3.0, 3.0, math.pi]))
    assert example["f2"] is example[1]
    assert example[:1] == (example["f1"],)
    with pytest.raises(KeyError, match=r"f3.*'f1', 'f2'"):
        example["f3"]


def test_every_vertex_of_the_example_is_singular_by_jacobians_alone(example):
    for surface in example:
        assert np.abs(dimensionless_determinants(EXAMPLE, surface.vertices)).max() <= 1e-12


def test_the_example_consists_of_the_lines_of_the_paper(example):
    x, y, phi = example["f1"].vertices.T
    np.testing.assert_allclose(x * np.cos(phi / 2) + y * np.sin(phi / 2), 0, atol=1e-14)
    x, y, phi = example["f2"].vertices.T
    s, c = np.sin(phi / 2), np.cos(phi / 2)
    np.testing.assert_allclose(y * c - x * s, 2 * s**2 * c - 2 * s * c**2, atol=1e-14)


def test_the_two_lines_of_each_angle_are_perpendicular(example):
    """Directions from the vertices alone: at a node in phi those of one surface lie in one line."""
    directions = []
    for surface in example:
        angles, count = np.unique(surface.vertices[:, 2], return_counts=True)
        lines = {}
        for phi in angles[count >= 10]:
            points = surface.vertices[surface.vertices[:, 2] == phi, :2]
            _, size, axes = np.linalg.svd(points - points.mean(axis=0))
            assert size[1] <= 1e-13 * size[0]
            lines[phi] = axes[0]
        directions.append(lines)
    shared = set(directions[0]) & set(directions[1])
    assert len(shared) == 61  # 60 samples, and the seam twice
    for phi in shared:
        assert abs(directions[0][phi] @ directions[1][phi]) <= 1e-13


def test_the_seam_pairs_are_the_same_pose_on_both_faces(example, reference):
    for surface in (*example, *reference):
        low, high = surface.vertices[surface.seam.T]
        assert len(low) >= 40
        np.testing.assert_array_equal(low[:, :2], high[:, :2])
        assert set(low[:, 2]) == {-math.pi}
        assert set(high[:, 2]) == {math.pi}
        for end in TURN:
            assert np.sum(surface.vertices[:, 2] == end) == len(surface.seam)


def test_each_surface_of_the_example_closes_to_a_band(example):
    for surface in example:
        vertices, edges, faces = glued_counts(surface)
        assert vertices - edges + faces == 0


def test_factors_cross_where_the_closed_form_says(example):
    (curve,) = example.crossings
    assert curve.names == ("f1", "f2")
    assert curve.residual <= 1e-12
    x, y, phi = curve.poses.T
    s, c = np.sin(phi / 2), np.cos(phi / 2)
    height = 2 * s**2 * c - 2 * s * c**2
    np.testing.assert_allclose(np.stack([x, y]), np.stack([-height * s, height * c]), atol=1e-14)
    assert np.all(np.diff(phi) >= 0)
    assert (phi[0], phi[-1]) == TURN
    assert len(curve.segments) == len(curve.poses) - 1
    # Neighbours in the list are neighbours on the curve.
    assert np.all(np.abs(np.diff(curve.segments, axis=1)) == 1)


@pytest.mark.parametrize("n", [15, 24, 41])
def test_refinement_does_not_change_the_pieces(n, reference):
    assert [surface.components for surface in jk.singular_surfaces(EXAMPLE, box(3.0, n))] == [1, 1]
    general = jk.singular_surfaces(jk.mechanisms.rpr3.reference(), box(30.0, n))
    assert [surface.components for surface in general] == [surface.components for surface in reference] == [1]


def test_without_gluing_the_faces_are_ends():
    (first, second) = jk.singular_surfaces(EXAMPLE, box(3.0, 24, phi=(-3.0, 3.0)))
    assert len(first.seam) == len(second.seam) == 0
    assert_closed(first, np.array([3.0, 3.0, 3.0]))


def test_a_mechanism_without_factors_has_its_determinant(reference):
    (surface,) = reference
    assert surface.name == "det"
    assert surface.unpolished == 0
    robot = jk.mechanisms.rpr3.reference()
    assert np.abs(dimensionless_determinants(robot, surface.vertices)).max() <= 1e-12
    assert_closed(surface, np.array([30.0, 30.0, math.pi]))
    assert reference.crossings == ()


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_platform_similar_to_the_base_is_singular_at_a_whole_plane_even_in_the_glued_face(side):
    robot = jk.mechanisms.rpr3.general(side, 0.0, side, 2.0, 2.0, math.pi / 2)
    (surface,) = jk.singular_surfaces(robot, box(3.0, 21))
    assert np.abs(dimensionless_determinants(robot, surface.vertices)).max() <= 1e-12
    assert surface.components == 1
    plane = np.abs(surface.vertices[:, 2]) <= 1e-12
    # Nearly one for each column of the grid; where another sheet crosses, a cell sees no change of sign.
    assert 19**2 <= plane.sum() <= 21**2
    # The other plane lies in the seam and stands on one of the two faces.
    assert 19**2 <= np.sum(np.abs(surface.vertices[:, 2]) >= math.pi - 1e-12) <= 21**2


@hypothesis.settings(max_examples=5)
@hypothesis.given(st.integers(0, 10**6))
def test_random_geometries(seed):
    rng = np.random.default_rng(seed)
    for geometry in (zoo.random_analytic(rng, 1)[0], zoo.random_general(rng, 1)[0]):
        robot = zoo.build(geometry)
        found = jk.singular_surfaces(robot, box(3.0, 16))
        assert len(found) >= 1
        for surface in found:
            assert surface.unpolished == 0
            assert np.abs(dimensionless_determinants(robot, surface.vertices)).max() <= 1e-12
            assert_closed(surface, np.array([3.0, 3.0, math.pi]))


def test_every_working_mode_has_its_surface_and_holes_where_it_ends():
    found = jk.singular_surfaces(rails(), jk.Grid(x=(-4.0, 4.0, 20), y=(-4.0, 4.0, 20), z=(-1.0, 1.0, 4)))
    # All rods up or all down: the determinant has one sign.
    assert [surface.name for surface in found] == [f"det, working mode {k}" for k in range(1, 7)]
    robot = rails()
    for mode, surface in enumerate(found, 1):
        joints = jax.vmap(lambda x, k=mode: jk.inverse(robot, x).values[k])(jnp.asarray(surface.vertices))
        direct = jax.vmap(lambda x, q: jk.jacobians(robot, x, q).direct)(jnp.asarray(surface.vertices), joints)
        assert np.abs(np.linalg.det(np.asarray(direct) / 9)).max() <= 1e-12
        assert surface.unpolished == 0
        rim = surface.vertices[surface.boundary]
        assert np.any(np.abs(rim[:, :, 2]) < 1)  # a hole's rim, inside the box
    assert found.glued == ()


def test_a_fourth_pose_axis_is_fixed():
    robot = RailsAndTurn(rails=rails())
    axes = {"x": (-4.0, 4.0, 12), "y": (-4.0, 4.0, 12), "z": (-1.0, 1.0, 3)}
    found = jk.singular_surfaces(robot, jk.Grid(**axes, psi=0.7))
    plain = jk.singular_surfaces(rails(), jk.Grid(**axes))
    assert len(found) == len(plain) == 6
    assert found.free == ("x", "y", "z")
    for surface, other in zip(found, plain, strict=True):
        assert set(surface.vertices[:, 3]) == {0.7}
        np.testing.assert_allclose(surface.vertices[:, :3], other.vertices, atol=1e-12)


def test_without_inverse_kinematics_the_legs_give_the_same_surfaces():
    robot, own = rails(), Unsolved(feet=jnp.asarray(RIGHT), rod=jnp.asarray(3.0))
    grid = jk.Grid(x=(-2.0, 3.0, 12), y=(-2.0, 3.0, 12), z=(-1.0, 1.0, 6))
    given, found = jk.singular_surfaces(robot, grid), jk.singular_surfaces(own, grid)
    assert len(found) == len(given) > 0
    assert found.residual <= 1e-12
    signs = {surface.name.removeprefix("det, working mode ") for surface in found}
    assert signs <= {"".join(mode) for mode in np.ndindex(2, 2, 2) for mode in [["+-"[k] for k in mode]]}
    # dF/dq = 2 (q - z): the kernel's mode k has q - z positive where its index is even, as the sign says.
    for surface in found:
        twin = given[f"det, working mode {int(surface.name[-3:].replace('+', '0').replace('-', '1'), 2)}"]
        assert len(twin.vertices) == len(surface.vertices)
        np.testing.assert_allclose(np.sort(twin.vertices, axis=0), np.sort(surface.vertices, axis=0), atol=1e-9)


def test_the_joints_of_the_vertices_close_the_mechanism():
    own = Unsolved(feet=jnp.asarray(RIGHT), rod=jnp.asarray(3.0))
    grid = jk.Grid(x=(-2.0, 3.0, 12), y=(-2.0, 3.0, 12), z=(-1.0, 1.0, 6))
    for robot, box_ in ((own, grid), (EXAMPLE, box(3.0, 12)), (rails(), grid)):
        found = jk.singular_surfaces(robot, box_)
        assert found.joint_names == tuple(axis.name for axis in robot.joint_axes)
        for surface in found:
            assert surface.joints.shape == (len(surface.vertices), 3)
            closing = jax.vmap(robot.constraints)(jnp.asarray(surface.vertices), jnp.asarray(surface.joints))
            assert np.max(np.abs(np.asarray(closing))) < 1e-12 * 100


def test_serial_surfaces_are_where_a_rod_lies_across_its_rail():
    own = Unsolved(feet=jnp.asarray(RIGHT), rod=jnp.asarray(3.0))
    found = jk.singular_surfaces(own, jk.Grid(x=(-4.0, 5.0, 24), y=(-4.0, 5.0, 24), z=(-1.0, 1.0, 4)), kind="serial")
    assert [surface.name for surface in found] == ["det B, leg 1", "det B, leg 2", "det B, leg 3"]
    assert found.residual <= 1e-12
    for surface, foot in zip(found, RIGHT, strict=True):
        np.testing.assert_allclose(np.hypot(*(surface.vertices[:, :2] - foot).T), 3.0, rtol=1e-14)
        others = [np.hypot(*(surface.vertices[:, :2] - other).T) for other in RIGHT]
        assert np.max(others) <= 3.0 + 1e-12
        closing = jax.vmap(own.constraints)(jnp.asarray(surface.vertices), jnp.asarray(surface.joints))
        assert np.max(np.abs(np.asarray(closing))) < 1e-10
    # A 3-RPR has lengths, which are not negative: no surface.
    assert len(jk.singular_surfaces(EXAMPLE, box(3.0, 8), kind="serial")) == 0
    with pytest.raises(jk.InputError, match="choose 'parallel', 'serial' or 'both'"):
        jk.singular_surfaces(EXAMPLE, box(3.0, 8), kind="type 1")


def test_joint_limits_cut_holes():
    limits = jk.Limits.lengths(3, low=0.0, high=20.0)
    robot = jk.mechanisms.rpr3.reference(limits)
    (cut,) = jk.singular_surfaces(robot, box(30.0, 20))
    legs = _joints(jk.mechanisms.rpr3.reference(), cut.vertices)
    assert 15.0 < float(jnp.max(legs)) <= 20.0


def test_no_surface_in_the_box():
    found = jk.singular_surfaces(EXAMPLE, jk.Grid(x=(2.0, 3.0, 8), y=(2.0, 3.0, 8), phi=(0.2, 0.4, 8)))
    assert len(found) == 0
    assert list(found) == []
    assert found.residual == 0.0
    assert str(found).startswith("0 singular surfaces over x, y, phi")
    nowhere = jk.Limits.lengths(3, low=1e3, high=2e3)
    assert len(jk.singular_surfaces(jk.mechanisms.rpr3.reference(nowhere), box(30.0, 8))) == 0


@jk.mechanism
class Jumping(rpr3.AnalyticRPR3):
    """Its factors are wrong: one jumps over zero everywhere, the other where x = 0.3 and y < 0."""

    def factors(self, pose):
        x, y, phi = pose
        step = jnp.where(x < 0.3, -1.0, 1.0)
        return {"jump": step, "half": jnp.where(y < 0, step, x - 0.3 + 0.1 * jnp.sin(phi) * y)}


def test_vertices_that_do_not_converge_are_dropped_and_counted():
    robot = Jumping(EXAMPLE.c2, EXAMPLE.c3, EXAMPLE.d3, EXAMPLE.limits)
    jump, half = found = jk.singular_surfaces(robot, box(2.0, 10))
    assert (len(jump.vertices), len(jump.faces), jump.components) == (0, 0, 0)
    assert jump.unpolished >= 100
    assert half.unpolished > 0
    assert half.residual <= 1e-12
    np.testing.assert_allclose(half.vertices[:, 0], 0.3 - 0.1 * np.sin(half.vertices[:, 2]) * half.vertices[:, 1])
    assert np.all(half.vertices[:, 1] >= 0)
    assert "vertices dropped" in str(found)


def test_summary_and_json(example):
    text = str(example)
    assert "2 singular surfaces over x, y, phi, phi glued" in text
    assert "f1: 1 piece" in text
    assert "f1 = f2 = 0" in text
    content = json.loads(example.to_json())
    assert content["request"]["mechanism"] == "rpr3-analytic"
    assert content["request"]["geometry"]["c2"] == 1.0
    assert content["request"]["box"]["phi"] == [*TURN, 60]
    np.testing.assert_array_equal(content["surfaces"][1]["vertices"], example["f2"].vertices)
    assert content["crossings"][0]["names"] == ["f1", "f2"]


def test_bad_boxes_and_mechanisms_are_refused_with_the_remedy():
    with pytest.raises(jk.InputError, match="as its mechanism"):
        jk.singular_surfaces(3.0, box(3.0, 8))
    with pytest.raises(jk.InputError, match=r"jk\.Grid over the pose axes"):
        jk.singular_surfaces(EXAMPLE, {"x": 1})
    with pytest.raises(jk.InputError, match="axis 'rho1'; the pose space has x, y, phi"):
        jk.singular_surfaces(EXAMPLE, jk.Grid(rho1=(0.0, 1.0, 4), rho2=1.0, rho3=1.0))
    with pytest.raises(jk.InputError, match="exactly three free axes"):
        jk.singular_surfaces(EXAMPLE, jk.Grid(x=(0.0, 1.0, 4), y=(0.0, 1.0, 4), phi=1.0))
    two = zoo.TwoSliders(first=jnp.asarray(1.0), second=jnp.asarray(1.0))
    with pytest.raises(jk.InputError, match="2 free axes"):
        jk.singular_surfaces(two, jk.Grid(x=(0.0, 1.0, 4), y=(0.0, 1.0, 4)))
    with pytest.raises(jk.InputError, match="batch of robots"):
        jk.singular_surfaces(zoo.build(np.array([zoo.EXAMPLE] * 2)), box(3.0, 8))
    with pytest.raises(jk.InputError, match="cannot be traced"):
        jax.jit(lambda r: jk.singular_surfaces(r, box(3.0, 8)))(EXAMPLE)
    coupled = Coupled(feet=jnp.asarray(RIGHT), rod=jnp.asarray(3.0))
    with pytest.raises(jk.InputError, match=r"inverse_kernel\(pose\), or factors\(pose\)"):
        jk.singular_surfaces(coupled, jk.Grid(x=(0.0, 1.0, 4), y=(0.0, 1.0, 4), z=(0.0, 1.0, 4)))


def test_a_determinant_that_vanishes_everywhere_is_refused():
    with pytest.raises(jk.GeometryError, match="degenerate"):
        jk.singular_surfaces(EXAMPLE.replace(d3=jnp.asarray(0.0)), box(3.0, 8))
    twice = rails(np.array([[0.0, 0.0], [0.0, 0.0], [2.0, 0.0]]))
    with pytest.raises(jk.GeometryError, match=r"working mode 0, 1, 6, 7, vanishes.*two equations depend"):
        jk.singular_surfaces(twice, jk.Grid(x=(-1.0, 1.0, 6), y=(-1.0, 1.0, 6), z=(-1.0, 1.0, 6)))
