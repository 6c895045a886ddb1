"""Cusps of sections: known and certified answers, what only looks like one, and what happens around them."""

import json

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from oracles import rpr3_sections as oracle
from oracles import rpr3_torus as torus
from section_checks import SECTIONS, relabelled, residuals, rows, section, sheet, stored

import jaxkin as jk
from jaxkin.mechanisms import rpr3
from jaxkin.mechanisms import rpr3_closed_forms as forms

EXAMPLE = zoo.build(np.array(zoo.EXAMPLE))
SQUARE = section(1, 1.0)
#: (geometry, fixed leg, its length, number of cusps): a section of the family has 0, 1, 2 or 3.
FAMILY = [
    ((1.0, 2.0, -1.25), 1, 1.0, 0),
    ((1.5, -0.7, 0.4), 1, 1.0, 1),
    (zoo.EXAMPLE, 1, 1.0, 2),
    (zoo.EXAMPLE, 1, 2.5, 3),
]
ULP = np.finfo(float).eps


def cusps_of_entry(entry):
    robot, grid = stored(entry)
    return robot, jk.cusps(robot, grid)


@pytest.fixture(scope="module", params=SECTIONS, ids=lambda entry: entry["name"])
def entry(request):
    return request.param, *cusps_of_entry(request.param)


@pytest.fixture(scope="module")
def example():
    return jk.cusps(EXAMPLE, SQUARE)


def assert_sound(cusps):
    """Checks what every record of cusps must satisfy."""
    n = len(cusps)
    assert len(cusps.poses) == len(cusps.residual) == len(cusps.error) == len(cusps.third) == n
    assert np.all(cusps.residual < 1e-12)
    assert np.all(cusps.third > 1e-3)
    assert np.all((cusps.error > 0) & (cusps.error < 1e-9))
    poses = sum(map(len, cusps.poses))
    assert cusps.evidence["cusp poses found along the curves"] == poses
    assert cusps.evidence["cusp poses on no traced curve"] == 0
    assert cusps.evidence["changes of sign along the curves"] == poses


# --- known answers ----------------------------------------------------------------------------------------------


def test_the_two_cusps_of_the_example_at_rho2_1(example):
    root = np.sqrt(3)
    expected = [[np.sqrt((3 * root - 3) / 2), 1, np.sqrt(1 + 3 * root)], [root, 1, 1]]
    np.testing.assert_allclose(example.joints, expected, rtol=1e-12)
    poses = [
        [[1.04434026359920, -0.0861952735297266, np.pi / 6], [-0.861327561706983, -0.596817428362493, np.pi / 6]],
        [[1.70710678118655, 0.292893218813452, -np.pi / 2], [0.292893218813452, 1.70710678118655, -np.pi / 2]],
    ]
    np.testing.assert_allclose(np.stack(example.poses), poses, atol=1e-12)
    assert_sound(example)


def test_crossings_are_told_and_are_no_cusps(example):
    exact = forms.section_crossings(EXAMPLE, 1, 1.0)
    assert [other.kind for other in example.others] == ["crossing", "crossing"]
    poses, joints = (np.stack([getattr(other, name) for other in example.others]) for name in ("pose", "joints"))
    gaps = zoo.glued_distance(poses[:, None], exact.poses[None])
    assert gaps.min(axis=0).max() < 1e-12
    assert np.abs(joints[:, None] - exact.joints[None]).max(axis=2).min(axis=0).max() < 1e-12


@pytest.mark.parametrize(("geometry", "axis", "value", "number"), FAMILY, ids=str)
def test_members_of_the_family_have_no_one_two_or_three_cusps(geometry, axis, value, number):
    robot = rpr3.analytic(*geometry)
    cusps = jk.cusps(robot, section(axis, value, high=12.0))
    assert len(cusps) == number
    assert all(len(poses) == 2 for poses in cusps.poses)
    assert_sound(cusps)
    exact = np.asarray(forms.section_cusps(robot, axis, value).joints)
    exact = exact[np.isfinite(exact[:, 0])]
    assert len(exact) == number
    for joints, error in zip(cusps.joints, cusps.error, strict=True):
        gap = np.abs(exact - joints).max(axis=1).min()
        assert gap < 1e-12
        assert gap <= 10 * error


@pytest.mark.parametrize("axis", [0, 2])
def test_the_other_legs_fixed(axis):
    # The cusp edges do not know which leg is fixed.
    here = jk.cusps(EXAMPLE, SQUARE).joints[1]
    again = jk.cusps(EXAMPLE, section(axis, here[axis], high=8.0))
    assert np.abs(again.joints - here).max(axis=1).min() < 1e-12


# --- certified answers ------------------------------------------------------------------------------------------


def test_all_certified_cusps_and_no_others(entry):
    stored_entry, robot, cusps = entry
    expected = rows(stored_entry, "rho")
    assert len(cusps) == len(expected)
    assert all(len(poses) == 1 for poses in cusps.poses)
    assert cusps.others == ()
    assert_sound(cusps)
    if len(expected) == 0:
        return
    gaps = np.abs(cusps.joints[:, None] - expected[None]).max(axis=2)
    nearest = gaps.argmin(axis=1)
    assert sorted(nearest) == list(range(len(expected)))
    true = gaps.min(axis=1)
    assert np.all(true <= 10 * cusps.error + 4 * ULP * np.abs(expected).max())
    assert true.max() < 1e-12 * expected.max()
    poses = rows(stored_entry, "pose")[nearest]
    length = float(robot.characteristic_length())
    assert zoo.glued_distance(np.concatenate(cusps.poses), poses, length).max() < 1e-11
    assert np.all(np.diff(cusps.joints[:, next(k for k in range(3) if k != stored_entry["fixed_axis"] - 1)]) > -1e-12)


@pytest.mark.parametrize("name", ["reference, rho1 = 14.98", "reference, rho1 = 17"])
def test_six_cusps_of_the_reference(name):
    entry = next(e for e in SECTIONS if e["name"] == name)
    assert len(cusps_of_entry(entry)[1]) == 6


def test_triple_poses_close_and_are_singular(entry):
    _, robot, cusps = entry
    if len(cusps):
        joints = np.repeat(cusps.joints, [len(p) for p in cusps.poses], axis=0)
        assert max(residuals(robot, np.concatenate(cusps.poses), joints)) < 1e-12


# --- around a cusp ----------------------------------------------------------------------------------------------


@jax.jit
def forward(robot, joints):
    modes = jax.vmap(lambda q: jk.forward(robot, q))(joints)
    direct = jax.vmap(lambda q, poses: jax.vmap(lambda pose: jk.jacobians(robot, pose, q).direct)(poses))
    sign = jnp.sign(jnp.linalg.det(direct(joints, jnp.where(modes.valid[..., None], modes.values, 0.0))))
    return modes, jnp.sum(jnp.where(modes.valid, sign, 0), axis=1)


def around(joints, axis, radius, n):
    """Joint values on a circle about a point of the section."""
    angle = 2 * np.pi * (np.arange(n) + 0.37) / n
    return joints + radius * np.insert(np.stack([np.cos(angle), np.sin(angle)], axis=1), axis, 0.0, axis=1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "radius"),
    [
        ("reference, rho1 = 14.98", 1e-3),
        ("reference, rho1 = 17", 1e-3),
        ("seed 0, ordinary", 1e-3),
        ("seed 14, flat platform, many cusps", 3e-4),
    ],
)
def test_two_modes_more_inside_a_cusp_and_the_signs_balance(name, radius):
    entry = next(e for e in SECTIONS if e["name"] == name)
    robot, cusps = cusps_of_entry(entry)
    # As many samples as put several into the narrowest wedge.
    axis, n = entry["fixed_axis"] - 1, 1 << 15
    size = float(robot.characteristic_length())
    for joints, pose in zip(cusps.joints, np.concatenate(cusps.poses), strict=True):
        modes, signs = jax.tree.map(np.asarray, forward(robot, around(joints, axis, radius * size, n)))
        # A sample on one of the two folds may come out odd, and says that float64 cannot decide it.
        odd = (signs != 0) & np.any(modes.status == jk.Status.UNDECIDED, axis=1)
        assert np.sum(odd) <= 2
        modes, signs = jax.tree.map(lambda a, rows=~odd: a[rows], (modes, signs))
        np.testing.assert_array_equal(signs, 0)
        number = modes.valid.sum(axis=1)
        assert number.max() - number.min() == 2
        # The wedge is narrow: it opens like the power 3/2 of the distance.
        inside = number == number.max()
        assert 0 < inside.mean() < 0.4
        assert np.sum(inside != np.roll(inside, 1)) == 2
        near = np.where(modes.valid, zoo.glued_distance(modes.values, pose, size), np.inf) < 0.35
        assert np.all(near.sum(axis=1)[inside] == near.sum(axis=1)[~inside].max() + 2)


def test_four_modes_more_inside_a_cusp_of_the_family(example):
    for joints in example.joints:
        modes, signs = jax.tree.map(np.asarray, forward(EXAMPLE, around(joints, 1, 1e-3, 4096)))
        np.testing.assert_array_equal(signs, 0)
        number = modes.valid.sum(axis=1)
        assert (number.max(), number.min()) == (6, 2)
        assert 0 < np.mean(number == 6) < 0.3


def test_the_forward_solver_says_triple_at_cusps(example):
    for joints, poses in zip(example.joints, example.poses, strict=True):
        modes = jk.forward(EXAMPLE, joints)
        for pose in poses:
            lane = np.nanargmin(zoo.glued_distance(np.asarray(modes.values), pose))
            assert zoo.glued_distance(np.asarray(modes.values[lane]), pose) < 1e-7
            assert int(modes.multiplicity[lane]) == 3


@pytest.mark.parametrize("index", [0, 1, 3, 11])
def test_the_general_forward_solver_has_its_modes_merged_at_cusps(index):
    robot, cusps = cusps_of_entry(SECTIONS[index])
    size = float(robot.characteristic_length())
    padded = np.resize(cusps.joints, (4096, 3))
    modes = jax.tree.map(np.asarray, forward(robot, padded)[0])
    for k, poses in enumerate(cusps.poses):
        near = np.where(modes.valid[k], zoo.glued_distance(modes.values[k], poses[0], size), np.inf) < 1e-4
        assert modes.multiplicity[k][near].sum() in (2, 3)  # It calls most of them double.


# --- what must not matter -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3, 1e6])
def test_the_unit_of_length_does_not_matter(example, scale):
    scaled = jk.cusps(rpr3.analytic(scale, 0.0, scale), section(1, scale, high=6 * scale))
    np.testing.assert_allclose(scaled.joints / scale, example.joints, rtol=1e-13)
    assert [len(p) for p in scaled.poses] == [2, 2]
    assert np.all(scaled.error < 1e-13 * scale)
    np.testing.assert_allclose(scaled.third, example.third, rtol=1e-6)
    assert len(scaled.others) == 2


@pytest.mark.parametrize("n", [2, 1500, 9000])
def test_the_grid_only_seeds(example, n):
    again = jk.cusps(EXAMPLE, section(1, 1.0, n=n))
    np.testing.assert_allclose(again.joints, example.joints, rtol=1e-14)
    assert len(again.others) == 2


def test_the_numbers_of_the_legs_do_not_matter():
    entry = SECTIONS[3]
    robot, grid = stored(entry)
    other, swapped = relabelled(entry)
    one, two = jk.cusps(robot, grid).joints, jk.cusps(other, swapped).joints[:, [0, 2, 1]]
    gaps = np.abs(one[:, None] - two[None]).max(axis=2)
    assert gaps.shape == (6, 6)
    assert gaps.min(axis=0).max() < 1e-12
    assert gaps.min(axis=1).max() < 1e-12


def test_a_box_keeps_the_cusps_that_it_holds():
    some = jk.cusps(EXAMPLE, jk.Grid(rho1=(1.5, 2.0, 99), rho2=1.0, rho3=(0.9, 1.2, 99)))
    np.testing.assert_allclose(some.joints, [[np.sqrt(3), 1, 1]], rtol=1e-12)
    none = jk.cusps(EXAMPLE, jk.Grid(rho1=(1.5, 2.0, 99), rho2=1.0, rho3=(1.01, 1.2, 99)))
    assert len(none) == 0
    assert none.joints.shape == (0, 3)


def test_limits_of_the_robot_hide_cusps():
    robot = rpr3.analytic(*zoo.EXAMPLE, limits=jk.Limits(jnp.zeros(3), jnp.array([1.6, 2.0, 9.0])))
    cusps = jk.cusps(robot, SQUARE)
    assert len(cusps) == 1
    assert cusps.joints[0, 0] == pytest.approx(np.sqrt((3 * np.sqrt(3) - 3) / 2), rel=1e-12)


# --- what only looks like a cusp --------------------------------------------------------------------------------


def test_a_swallowtail_is_no_cusp():
    # det = 4 y^3 + x, which is flat to second order at y = 0: there four modes meet, not three.
    cusps = jk.cusps(sheet({(0, 4): 1.0, (1, 1): 1.0}), jk.Grid(q1=(-0.5, 0.6, 99), q2=(-0.7, 0.9, 99)))
    assert len(cusps) == 0
    assert {other.kind for other in cusps.others} == {"swallowtail or higher"}
    for other in cusps.others:
        assert np.linalg.norm(other.pose) < 1e-3


@pytest.mark.parametrize("a", [1e-2, 1e-4])
def test_two_cusps_beside_a_swallowtail(a):
    # det = 4 y^3 - 2 a y + x has its derivative by y zero at y^2 = a / 6.
    cusps = jk.cusps(sheet({(0, 4): 1.0, (1, 1): 1.0, (0, 2): -a}), jk.Grid(q1=(-0.5, 0.6, 99), q2=(-0.7, 0.9, 99)))
    y = np.sqrt(a / 6) * np.array([1, -1])
    np.testing.assert_allclose([p[0, 1] for p in cusps.poses], -y if cusps.joints[0, 0] < 0 else y, rtol=1e-9)
    assert np.all(cusps.third > 1e-4)
    assert cusps.others == ()


@pytest.mark.parametrize("a", [0.3, 0.01, 1e-4])
def test_cusps_of_a_sheet_are_the_zeros_of_two_derivatives(a):
    # det = y^2 + x^2 - a: cusps where y = 0, x = +-sqrt a.
    robot = sheet({(0, 3): 1 / 3, (2, 1): 1.0, (0, 1): -a})
    cusps = jk.cusps(robot, jk.Grid(q1=(-1.5, 1.0, 99), q2=(-3.0, 3.0, 99)))
    np.testing.assert_allclose(cusps.joints, np.sqrt(a) * np.array([[-1, -1], [1, 1]]), rtol=1e-11)
    assert cusps.others == ()


# --- the record ---------------------------------------------------------------------------------------------------


def test_the_record_says_what_it_holds(example):
    content = json.loads(example.to_json())
    assert content["request"]["mechanism"] == "rpr3-analytic"
    assert [c["joints"] for c in content["cusps"]] == example.joints.tolist()
    assert [c["poses"] for c in content["cusps"]] == [p.tolist() for p in example.poses]
    assert [o["kind"] for o in content["others"]] == ["crossing", "crossing"]
    text = str(example)
    assert text.startswith("2 cusps, 4 triple poses")
    assert "1.73205080756888" in text
    assert text.count("no cusp, crossing") == 2


# --- many samples -----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("block", range(5))
def test_cusps_of_random_robots(block):
    for seed in range(7000 + 40 * block, 7040 + 40 * block):
        geometry, axis, value = torus.random_section(seed)
        try:
            exact = np.array([c.floats()[0] for c in oracle.cusp_points(geometry, axis, value)]).reshape(-1, 3)
        except torus.Degenerate:
            continue
        robot = rpr3.general(geometry.c2, geometry.c3, geometry.d3, geometry.l2, geometry.l3, geometry.beta)
        cusps = jk.cusps(robot, section(axis - 1, value, high=30.0))
        assert len(cusps) == len(exact), seed
        assert cusps.others == ()
        if len(exact):
            gaps = np.abs(cusps.joints[:, None] - exact[None]).max(axis=2)
            assert np.all(gaps.min(axis=1) <= 10 * cusps.error), seed
            assert gaps.min(axis=0).max() < 1e-11, seed


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_cusps_of_random_members(seed):
    rng = np.random.default_rng(seed)
    for k in range(50):
        geometry, axis, value = zoo.random_analytic(rng, 1)[0], k % 3, rng.uniform(0.1, 3)
        robot = rpr3.analytic(*geometry)
        cusps, exact = jk.cusps(robot, section(axis, value, high=20.0)), forms.section_cusps(robot, axis, value)
        exact = np.asarray(exact.joints)[np.isfinite(np.asarray(exact.joints[:, 0]))]
        assert len(cusps) == len(exact)
        assert all(len(poses) == 2 for poses in cusps.poses)
        if len(exact):
            gaps = np.abs(cusps.joints[:, None] - exact[None]).max(axis=2)
            assert np.all(gaps.min(axis=1) <= 10 * cusps.error)
            assert gaps.min(axis=0).max() < 1e-12
