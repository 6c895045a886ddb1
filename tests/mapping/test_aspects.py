"""Aspects: known counts and volumes, paths, seams, limits, and what is refused."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.kinematics.singularity import raw_conditioning
from jaxkin.mapping.aspects import aspects
from jaxkin.mechanisms import five_bar, ppps3, rpr3, tlpm

PI = np.pi
FIVE_BAR = five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0))


def planar(n=32, size=4.0, start=-PI):
    return jk.Grid(x=(-size, size, n), y=(-size, size, n), phi=(start, start + 2 * PI, n))


@jax.jit
def measured(robot, poses, joints):
    """Returns the largest residual, det A and the clearance of configurations, from the constraints alone."""

    def one(pose, q):
        a = jax.jacfwd(robot.constraints)(pose, q)
        clearance = raw_conditioning(robot, pose, q).smallest_singular_value
        return jnp.max(jnp.abs(robot.constraints(pose, q))), jnp.linalg.det(a), clearance

    return jax.vmap(one)(poses, joints)


@pytest.fixture(scope="module")
def analytic():
    return aspects(rpr3.analytic(1.0, 0.0, 1.0), planar(64))


@pytest.fixture(scope="module")
def bar():
    return aspects(FIVE_BAR, jk.Grid(x=(-5.0, 14.0, 256), y=(-13.0, 13.0, 256)))


def dense_path(path, per_line=20):
    t = np.arange(per_line) / per_line
    lines = path[:-1, None] + t[None, :, None] * np.diff(path, axis=0)[:, None]
    return np.concatenate([lines.reshape(-1, path.shape[1]), path[-1:]])


def legs(robot, poses):
    return np.asarray(jax.vmap(lambda p: jk.inverse(robot, p).values[0])(jnp.asarray(poses)))


def test_the_analytic_robot_has_two_aspects(analytic):
    # At each phi two perpendicular lines make four quadrants; a turn exchanges opposite ones: two components remain.
    assert analytic.count == 2
    assert analytic.doubts == ()
    assert analytic.evidence["stable"]
    assert analytic.sign.tolist() == [1, -1]
    assert analytic.touches_edge.all()
    box = 8 * 8 * 2 * PI
    assert abs(analytic.volume.sum() - box) < 1e-3 * box
    for k, aspect in enumerate(analytic):
        residual, determinant, clearance = measured(
            rpr3.analytic(1.0, 0.0, 1.0), aspect.pose[None], aspect.joints[None]
        )
        assert residual[0] < 1e-12
        assert np.sign(determinant[0]) == aspect.sign
        assert clearance[0] == pytest.approx(aspect.clearance, rel=1e-9)
        assert aspect.clearance > 0.9
        assert analytic.aspect_of(aspect.pose) == k
        assert analytic.aspect_of(aspect.pose, aspect.joints) == k


@pytest.mark.parametrize("start", [-PI, -1.234, 2.0])
def test_the_count_does_not_depend_on_where_the_seam_is(start):
    found = aspects(rpr3.analytic(1.0, 0.3, -0.7), planar(32, start=start))
    assert found.count == 2
    assert abs(found.volume.sum() - 128 * PI) < 4e-3 * 128 * PI


def test_the_count_does_not_depend_on_the_size_of_the_robot():
    small = aspects(rpr3.general(1.0, 0.0, 0.8, 1.1, 1.2, 0.9), planar(32))
    large = aspects(rpr3.general(1e3, 0.0, 0.8e3, 1.1e3, 1.2e3, 0.9), planar(32, 4e3))
    assert small.count == large.count
    assert np.allclose(large.volume, small.volume * 1e6, rtol=1e-6)
    assert small.evidence["cells tested, by level"] == large.evidence["cells tested, by level"]


def test_a_robot_without_declared_factors_has_the_same_aspects(analytic):
    found = aspects(rpr3.general(1.0, 0.0, 1.0, 1.0, 1.0, -PI / 2), planar(64))
    assert found.count == 2
    assert np.allclose(found.volume, analytic.volume, rtol=2e-3)


def test_a_path_keeps_its_sign_and_its_clearance(analytic):
    robot = rpr3.analytic(1.0, 0.0, 1.0)
    poses = np.array([[1.0, -2.0, 3.0], [-2.0, 1.5, -2.5], [2.0, 2.5, 0.3], [-1.0, -1.0, 1.4], [0.5, 3.0, -0.6]])
    which = [analytic.aspect_of(pose) for pose in poses]
    assert set(which) <= {0, 1}
    made = 0
    for a in range(len(poses)):
        for b in range(a):
            path = analytic.path(poses[a], poses[b])
            assert (path is None) == (which[a] != which[b])
            if path is None:
                continue
            made += 1
            assert np.array_equal(path[0], poses[a])
            turns = (path[-1, 2] - poses[b, 2]) / (2 * PI)
            assert abs(turns - round(turns)) < 1e-12
            assert np.max(np.abs(np.diff(path[:, 2]))) < 1.0
            points = dense_path(path)
            _, determinant, clearance = measured(robot, points, legs(robot, points))
            assert np.all(np.sign(determinant) == analytic[which[a]].sign)
            assert np.min(clearance) > 0
    assert made >= 3


def test_opposite_quadrants_are_joined_around_the_seam(analytic):
    robot = rpr3.analytic(1.0, 0.0, 1.0)
    rng = np.random.default_rng(2)
    poses = rng.uniform([-3, -3, -1], [3, 3, 1], (60, 3))
    signs = np.array([[np.sign(value) for value in robot.factors(pose).values()] for pose in poses])
    deep = [k for k in range(60) if min(map(abs, map(float, robot.factors(poses[k]).values()))) > 0.5]
    first = next(k for k in deep if signs[k].tolist() == [1, 1])
    second = next(k for k in deep if signs[k].tolist() == [-1, -1])
    path = analytic.path(poses[first], poses[second])
    assert path is not None
    # f1 and f2 both change their signs, which no path does that stays on one side of the seam.
    assert abs(path[-1, 2] - poses[second, 2]) > 6


def test_the_ppps_has_four_quarters():
    grid = jk.Grid(x=0.0, y=0.0, z=0.0, phi=(-PI, PI, 32), theta=(-PI / 2, PI / 2, 16), sigma=(-PI, PI, 32))
    found = aspects(ppps3.create(), grid)
    assert found.count == 4
    assert found.doubts == ()
    assert np.allclose(found.volume, PI**3, rtol=2e-3)
    assert found.volume.sum() == pytest.approx(4 * PI**3, rel=1e-9)
    assert not found.touches_edge.any()
    assert found.evidence["walls do not depend on"] == ["x", "y", "z"]
    assert found.aspect_of(np.zeros(6)) in range(4)
    with pytest.raises(jk.InputError, match=r"x is 0.5, but these aspects are of poses with x = 0"):
        found.aspect_of(np.array([0.5, 0, 0, 0, 0, 0]))


def test_the_strokes_of_the_tlpm_leave_two_aspects():
    robot = tlpm.create()
    found = aspects(robot, limits="joints")
    assert found.count == 2
    assert found.sign.tolist() == [1, -1]
    exact = jk.workspace_volume(robot).volume
    assert np.allclose(found.volume, exact, rtol=2e-4)
    assert np.all(np.abs(found.volume - exact) < found.error)
    assert all(aspect.proved < exact for aspect in found)
    assert not found.touches_edge.any()


def test_the_five_bar_has_ten_aspects_two_of_them_small(bar):
    # Counted by a dense scan, and mirrored in the base line: (+, +) with (-, -), (+, -) with (-, +).
    by_mode = {mode: [a for a in bar if a.working_mode == mode] for mode in ((1, 1), (1, -1), (-1, 1), (-1, -1))}
    assert [len(part) for part in by_mode.values()] == [2, 3, 3, 2]
    total = [sum(a.volume for a in part) for part in by_mode.values()]
    # The reach: two circular rings of radii 3 and 13, 9 apart.
    assert np.allclose(total, _two_rings(9.0, 3.0, 13.0), rtol=2e-3)
    assert min(bar.volume) / total[1] < 0.005
    assert bar.doubts == ()


def _two_rings(apart, inner, outer):
    def lens(r1, r2):
        if apart >= r1 + r2:
            return 0.0
        if apart <= abs(r1 - r2):
            return PI * min(r1, r2) ** 2
        a1 = np.arccos((apart**2 + r1**2 - r2**2) / (2 * apart * r1))
        a2 = np.arccos((apart**2 + r2**2 - r1**2) / (2 * apart * r2))
        return r1**2 * (a1 - np.sin(2 * a1) / 2) + r2**2 * (a2 - np.sin(2 * a2) / 2)

    return lens(outer, outer) - 2 * lens(inner, outer) + lens(inner, inner)


def test_configurations_of_the_five_bar_are_told_apart_by_their_joints(bar):
    for k, aspect in enumerate(bar):
        assert bar.aspect_of(aspect.pose, aspect.joints) == k
    with pytest.raises(jk.InputError, match="4 working modes open: give its joints"):
        bar.aspect_of(bar[0].pose)
    first, other = bar[0], bar[2]
    assert bar.path(first.pose, other.pose, first.joints, other.joints) is None
    assert bar.aspect_of(np.array([30.0, 0.0]), np.zeros(2)) == -1


def test_a_path_of_the_five_bar_stays_on_its_sheet(bar):
    rng = np.random.default_rng(4)
    poses = np.stack([rng.uniform(-4, 13, 400), rng.uniform(-12, 12, 400)], axis=1)
    modes = jk.inverse(FIVE_BAR, jnp.array([4.0, 6.0])).values
    joints = modes[0]
    k = bar.aspect_of(np.array([4.0, 6.0]), joints)
    mode = np.array(bar[k].working_mode)
    made = 0
    for pose in poses:
        found = jk.inverse(FIVE_BAR, pose)
        for q in np.asarray(found.values)[np.asarray(found.valid)]:
            if made < 4 and bar.aspect_of(pose, q) == k:
                made += 1
                path = bar.path(np.array([4.0, 6.0]), pose, joints, q)
                points = dense_path(path)
                on_sheet = _five_bar_joints(points, mode)
                residual, determinant, clearance = measured(FIVE_BAR, points, on_sheet)
                assert np.max(residual) < 1e-9
                assert np.all(np.sign(determinant) == bar[k].sign)
                assert np.min(clearance) > 0
    assert made == 4


def _five_bar_joints(points, mode):
    """Returns crank angles by the law of cosines, the elbow on the side that the sign of dF_k/dtheta_k says."""
    columns = []
    for pivot, sign in zip((0.0, 9.0), mode, strict=True):
        dx, dy = points[:, 0] - pivot, points[:, 1]
        r = np.hypot(dx, dy)
        angle = np.arccos((r**2 + 64 - 25) / (2 * 8 * r))
        # dF/dtheta = 2 l (dx sin theta - dy cos theta) = 2 l r sin(theta - direction).
        columns.append(np.arctan2(dy, dx) + sign * angle)
    return np.stack(columns, axis=1)


def test_a_neck_along_a_stretched_leg_is_walked():
    # det A keeps its sign along the circle r = 5.2 about pivot 2, in a strip much narrower than the cells.
    robot = five_bar.create(9.1, (9.0, 3.0), (5.8, 8.2))
    found = aspects(robot)
    assert found.count == 12
    assert found.doubts == ()
    assert found.evidence["components joined along inner walls"] == 2
    tip = np.array([9.33903807, -5.19525909])
    (large,) = [a for a in found if a.working_mode == (1, -1) and a.sign < 0 and a.volume > 20]
    q = next(
        q for q in np.asarray(jk.inverse(robot, tip).values) if found.aspect_of(tip, q) == found.aspects.index(large)
    )
    path = found.path(tip, large.pose, q, large.joints)
    assert path is not None
    _, determinant, clearance = measured(robot, dense_path(path), _joints_of(robot, dense_path(path), (1, -1)))
    assert np.all(determinant < 0)
    assert np.min(clearance) > 0
    # Through the narrow part, in which no cell of the finest level fits.
    depth = np.hypot(path[:, 0] - 9.1, path[:, 1]) - 5.2
    assert np.ptp(path[depth < 1e-3, 0]) > 0.1
    assert np.min(depth) > 0


def _joints_of(robot, points, mode):
    """Returns the joints of one working mode: the signs of dF_k/dtheta_k say which solution that is."""

    def one(point):
        found = jk.inverse(robot, point).values
        slope = jax.vmap(lambda q: jnp.diagonal(jax.jacfwd(robot.constraints, argnums=1)(point, q)))(found)
        return found[jnp.argmax(jnp.all(jnp.sign(slope) == jnp.array(mode), axis=1))]

    return jax.jit(jax.vmap(one))(jnp.asarray(points))


def test_mirrored_aspects_are_equally_deep(bar):
    # The base line is an axis of symmetry, at which signs of working modes and of det A change.
    for aspect in bar:
        if aspect.volume > 2:
            mirror = [
                other
                for other in bar
                if other.working_mode == tuple(-s for s in aspect.working_mode)
                and other.sign == -aspect.sign
                and abs(other.volume - aspect.volume) < 1e-6
            ]
            assert len(mirror) == 1
            assert mirror[0].clearance == pytest.approx(aspect.clearance, rel=1e-3)


def test_leg_limits_bound_the_box_and_cut_aspects():
    robot = rpr3.analytic(1.0, 0.0, 1.0).with_limits(rho1=(0.5, 2.0), rho2=(0.5, 2.0), rho3=(0.5, 2.0))
    found = aspects(robot, jk.Grid(x=(-2.1, 2.1, 48), y=(-2.1, 2.1, 48), phi=(-PI, PI, 48)))
    assert found.count == 4
    assert not found.touches_edge.any()
    for aspect in found:
        assert np.all((aspect.joints > 0.5) & (aspect.joints < 2.0))
    poses = np.random.default_rng(0).uniform([-2.1, -2.1, -PI], [2.1, 2.1, PI], (40_000, 3))
    inside = np.all(np.abs(legs_of_poses(robot, poses) - 1.25) < 0.75, axis=1)
    share = inside.mean() * 4.2**2 * 2 * PI
    assert abs(found.volume.sum() - share) < 4 * 4.2**2 * 2 * PI * np.sqrt(inside.mean() / 40_000)
    free = aspects(robot, planar(32), limits=False)
    assert free.count == 2


def legs_of_poses(robot, poses):
    base, own = (np.array(part, float) for part in (robot.base_points(), robot.platform_points()))
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, :1] + own[:, 0] * c[:, None] - own[:, 1] * s[:, None] - base[:, 0]
    y = poses[:, 1:2] + own[:, 0] * s[:, None] + own[:, 1] * c[:, None] - base[:, 1]
    return np.hypot(x, y)


def test_the_cost_grows_with_the_boundary(analytic):
    tested = np.array(analytic.evidence["cells tested, by level"])
    # Halving the cells makes eight times as many in the volume, four times as many on the walls.
    assert np.all(tested[2:] / tested[1:-1] < 5)
    assert tested.sum() < 0.4 * 64**3


def test_a_slice_shows_the_cells_of_a_plane(analytic):
    cut = analytic.slice(phi=0.5)
    assert cut.axes == ("x", "y")
    area = np.prod(cut.high - cut.low, axis=1)
    assert area.sum() == pytest.approx(64.0)
    robot = rpr3.analytic(1.0, 0.0, 1.0)
    middle = np.column_stack([0.5 * (cut.low + cut.high), np.full(len(area), 0.5)])
    for pose, number in list(zip(middle, cut.aspect, strict=True))[::37]:
        if number >= 0:
            determinant = -16.0 * np.prod(list(robot.factors(pose).values()))
            assert np.sign(determinant) == analytic[number].sign
    with pytest.raises(jk.InputError, match="fix 1 of x, y, phi"):
        analytic.slice()


def test_results_print_and_write_themselves(analytic):
    text = str(analytic)
    assert text.startswith("2 aspects over x x y x phi, no doubt known")
    assert "cells undecided, by level" in text
    content = json.loads(analytic.to_json())
    assert content["count"] == 2
    assert content["request"]["grid"]["x"] == [-4.0, 4.0, 64]
    assert analytic["det > 0"] is analytic[0]
    with pytest.raises(KeyError, match="the aspects are 'det > 0', 'det < 0'"):
        analytic["upper"]


@pytest.mark.parametrize(
    ("robot", "grid", "options", "message"),
    [
        (rpr3.analytic(1.0, 0.0, 1.0), None, {}, "nothing bounds the pose axis 'x'"),
        (ppps3.create(), None, {}, "6 pose axes, more than three: pass a grid .* x, y, z, on which"),
        (FIVE_BAR, jk.Grid(x=(-5.0, 14.0, 8), y=0.5), {}, "8 cells along x, too few to say anything"),
        (FIVE_BAR, jk.Grid(x=(-5.0, 14.0, 64)), {}, "lacks the pose axis 'y'"),
        (FIVE_BAR, (1, 2), {}, "pass a jaxkin.Grid"),
        (FIVE_BAR, None, {"limits": "all"}, "limits is 'all'"),
        (FIVE_BAR, None, {"clearance": -1.0}, "clearance is -1.0"),
        (
            rpr3.analytic(1.0, 0.0, 1.0),
            jk.Grid(x=(-1.0, 1.0, 16), y=0.0, phi=(-4.0, 4.0, 16)),
            {},
            "phi goes from -4 to 4, more than its period",
        ),
    ],
)
def test_what_cannot_be_answered_is_refused(robot, grid, options, message):
    with pytest.raises(jk.InputError, match=f"jk.aspects.*{message}|{message}"):
        aspects(robot, grid, **options)


@jk.mechanism
class Stage(jk.Mechanism):
    """Two crossed sliders: poses are joints, and limits are walls parallel to the cells."""

    id = "stage"
    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.Axis("q1", "length"), jk.Axis("q2", "length"))
    limits: jk.Limits

    def constraints(self, pose, joints):
        return pose - joints


@pytest.mark.parametrize("high", [1.0, 1.3])
@pytest.mark.parametrize("grid", [None, jk.Grid(x=(-1.3, 1.4, 32), y=(-1.7, 1.7, 32))], ids=["own box", "coarse"])
def test_the_error_sees_walls_parallel_to_the_cells(high, grid):
    stage = Stage(limits=jk.Limits(np.full(2, -1.0), np.full(2, high)))  # type: ignore[arg-type]
    (found,) = aspects(stage, grid)
    assert abs(found.volume - (1 + high) ** 2) <= found.error
