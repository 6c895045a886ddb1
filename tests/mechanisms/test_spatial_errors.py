"""Bad input of the spatial robots and their maps: one sentence that names it, and NaN where nothing is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.mapping import _orientation_ball as ball
from jaxkin.mechanisms import ppps3, tlpm

jk.enable_x64()

NAN = float("nan")
T, R = tlpm.create(), ppps3.create()
NOT_POSES = [["a", 0, 0], "abc", "000", [1j, 0, 0], None, [None, 0, 0], [[0], 0, 0], ["1", "2", "3"]]
OF_TLPM = [tlpm.wrist_angles, tlpm.elbow_modes, tlpm.link_clearances, tlpm.links, tlpm.stroke_jacobian]
#: Out of the reach of limbs of 50 to 150 mm: the q_i are 1022 mm apart.
TOO_SHORT = {"initial_lengths": (100, 100, 100), "stroke": (-50, 50)}


def sentence(call, *parts, error=jk.InputError):
    """Asserts that the call raises one sentence with these parts and without the names of array types."""
    with pytest.raises(error) as caught:
        call()
    text = str(caught.value)
    assert all(part in text for part in parts), text
    assert not any(name in text for name in ("Array(", "dtype", "Traced")), text
    return text


@pytest.mark.parametrize("mirrored", ["no", "", 2, -1, 0.5, NAN, (1, 1), [True], None, 1j])
def test_mirrored_is_true_or_false(mirrored):
    sentence(
        lambda: ppps3.create(mirrored=mirrored), "mirrored", repr(mirrored), "True or False", error=jk.GeometryError
    )


def test_mirrored_as_numbers_and_inside_jit():
    for yes, no in ((True, False), (1, 0), (1.0, 0.0), (np.True_, np.False_)):
        assert ppps3.create(mirrored=yes).mirrored is True
        assert ppps3.create(mirrored=no).mirrored is False
    assert jax.jit(lambda side: ppps3.create(side, mirrored=True))(2.0).mirrored is True


@pytest.mark.parametrize("function", OF_TLPM)
@pytest.mark.parametrize("pose", NOT_POSES, ids=repr)
def test_what_is_no_pose_of_the_tlpm(function, pose):
    sentence(lambda: function(T, pose), "pose is", "real numbers", "(3,)")


@pytest.mark.parametrize("function", OF_TLPM)
def test_functions_of_the_tlpm_need_one(function):
    for other in (R, "robot", None):
        sentence(lambda other=other: function(other, [0, 0, 0]), type(other).__name__, "needs a TLPM", "tlpm.create()")


@pytest.mark.parametrize(
    ("function", "rest"),
    [
        (ppps3.passive_joints, ([0] * 6,)),
        (ppps3.twist_jacobian, ([0] * 6,)),
        (ppps3.reduced, ([0] * 6, [0] * 6)),
        (ppps3.self_motion, ([0] * 6, 0.0)),
    ],
)
def test_functions_of_the_3_ppps_need_one(function, rest):
    sentence(lambda: function(T, *rest), "TLPM", "needs a 3-PPPS", "ppps3.create()")
    sentence(lambda: function(R, "abc", *rest[1:]), "'abc'", "six real numbers")


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (lambda: ppps3.pose_from_rotation(["a", 0, 0], np.eye(3)), "position is ['a', 0, 0]"),
        (lambda: ppps3.pose_from_rotation([0, 0, 0], "x"), "rotation is 'x'"),
        (lambda: ppps3.pose_from_quaternion([0, 0, 0], ["1", 0, 0, 0]), "quaternion is ['1', 0, 0, 0]"),
        (lambda: ppps3.position_and_rotation("x"), "pose is 'x'"),
        (lambda: ppps3.reduced_joints("x"), "joints are 'x'"),
        (lambda: ppps3.self_motion(R, [0] * 6, "a"), "turn is 'a'"),
        (lambda: jk.forward(T, [1 + 2j, 0, 0]), "(1+2j)"),
        (lambda: jk.inverse(T, ["1", "2", "3"]), "['1', '2', '3']"),
        (lambda: T.bodies("a"), "pose is 'a'"),
        (lambda: R.bodies("a"), "pose is 'a'"),
    ],
)
def test_text_and_complex_numbers(call, what):
    sentence(call, what, "number")


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("value", [NAN, float("inf")])
def test_nothing_is_known_at_a_pose_that_is_not_finite(place, value):
    pose, joints = jnp.array([30.0, -20.0, 10.0]).at[place].set(value), jnp.zeros(3)
    functions = [
        *OF_TLPM[:-1],
        lambda robot, p: robot.margins(p, joints),
        lambda robot, p: jk.margins(robot, p, joints),
    ]
    for function in functions:
        for call in (function, jax.jit(function)):
            found = call(T, pose)
            if isinstance(found, tlpm.ElbowModes):
                assert not np.any(found.free)
                found = (found.angle, found.clearance)
            for leaf in jax.tree_util.tree_leaves(found):
                assert np.isnan(leaf).all()
    assert np.isnan(tlpm.stroke_jacobian(T, jnp.zeros(3).at[place].set(NAN))).all()


def test_a_finite_pose_is_not_touched_by_its_neighbour_in_a_batch():
    poses = jnp.array([[30.0, -20.0, 10.0], [NAN, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found = jax.vmap(lambda p: tlpm.elbow_modes(T, p))(poses)
    for k in (0, 2):
        own = tlpm.elbow_modes(T, poses[k])
        np.testing.assert_allclose(found.clearance[k], own.clearance, rtol=1e-12)
        np.testing.assert_array_equal(found.free[k], own.free)
    assert np.isnan(found.angle[1]).all()
    assert not found.free[1].any()
    assert found.free[2].any()
    slope = jax.jacfwd(lambda p: tlpm.wrist_angles(T, p).theta1)(poses[0])
    assert np.isfinite(slope).all()
    assert np.abs(slope).max() > 1e-4


@pytest.mark.parametrize("overhang", [-1.0, -1e-9, NAN, float("inf"), "a", "3", [1.0, 2.0], None])
def test_overhang_is_a_length(overhang):
    sentence(lambda: tlpm.link_clearances(T, [0, 0, 0], overhang), "overhang is")


def test_overhang_is_traceable():
    slope = jax.grad(lambda h: tlpm.link_clearances(T, [0, 0, 0], h)["L13-L23"])(1.0)
    step = [float(tlpm.link_clearances(T, [0, 0, 0], h)["L13-L23"]) for h in (0.999, 1.001)]
    np.testing.assert_allclose(slope, (step[1] - step[0]) / 0.002, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize(
    ("interval", "parts"),
    [
        (3, ["3", "two numbers"]),
        (("a", "b"), ["('a', 'b')", "two numbers"]),
        ("12", ["'12'", "two numbers"]),
        ((1, 2, 3), ["(1, 2, 3)", "two numbers"]),
        ((1j, 2), ["1j", "two numbers"]),
        ((3, 1), ["3 and 1", "not greater", "exchange"]),
        (np.array([3.0, 1.0]), ["3 and 1", "exchange"]),
        ((NAN, 1), ["nan", "must be a number"]),
    ],
)
def test_changed_limits(interval, parts):
    sentence(lambda: T.with_limits(l1=interval), "l1", *parts)
    sentence(lambda: jax.jit(lambda x: T.with_limits(l1=interval).limits.low + x)(0.0), "l1", *parts)


def test_changed_limits_are_traceable():
    low = jax.jit(lambda x: T.with_limits(l2=(-x, x)).limits.low)(50.0)
    np.testing.assert_array_equal(low, [-200, -50, -200])
    assert jax.grad(lambda x: jnp.sum(jk.Limits.lengths(3, low=x, high=2 * x).high))(1.0) == 6.0
    for change in ({"low": "a", "high": 1}, {"high": 1j}, {"low": NAN}, {"low": None}):
        sentence(lambda change=change: jk.Limits.lengths(3, **change), "the lengths", "number")


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"initial_lengths": "x"}, ["initial_lengths is 'x'", "number"]),
        ({"base_radius": "590"}, ["base_radius is '590'", "number"]),
        ({"base_radius": None}, ["base_radius is None", "number"]),
        ({"height": 1j}, ["height is 1j", "number"]),
        ({"limb_angles": ("0", "2", "4")}, ["limb_angles", "number"]),
        ({"stroke": ("1", "2")}, ["stroke is ('1', '2')", "numbers"]),
        ({"stroke": ((0, 3, 0), (1, 2, 1))}, ["stroke: l2 is from 3 to 2", "exchange"]),
        ({"initial_lengths": 0}, ["initial_lengths is (0, 0, 0)", "-200 mm long", "longer than zero"]),
        ({"stroke": (-900, 0)}, ["stroke begins at -900", "longer than zero"]),
        ({"wrist_limits": jk.Limits(jnp.array([0.0, 2.0]), jnp.ones(2))}, ["wrist_limits: theta2 is from 2 to 1"]),
    ],
)
def test_geometry_of_the_tlpm(changes, parts):
    sentence(lambda: tlpm.create(**changes), *parts, error=jk.GeometryError)


def test_zero_initial_lengths_with_lengths_as_strokes():
    robot = tlpm.create(initial_lengths=0, stroke=(700, 900))
    np.testing.assert_allclose(jk.inverse(robot, [0.0, 0.0, 0.0]).values[0], np.full(3, 590 * np.sqrt(2)))


def test_limits_are_told_in_plain_numbers():
    limits = jk.Limits(jnp.array([1.0] * 6), jnp.array([2.0, 2.0, 0.5, 2.0, 2.0, 2.0]))
    sentence(lambda: ppps3.create(limits=limits), "limits: rho2y is from 1 to 0.5", error=jk.GeometryError)
    batch = jk.Limits(jnp.zeros((2, 3)), jnp.ones((2, 3)).at[1, 2].set(-1.0))
    sentence(
        lambda: ppps3.create(jnp.ones(2), passive_limits=batch), "rho3x (robot 1 of", "0 to -1", error=jk.GeometryError
    )
    sentence(lambda: ppps3.create(limits=jk.Limits.lengths(3)), "low=(0, 0, 0)", "6 low", error=jk.GeometryError)
    sentence(lambda: ppps3.create(limits=jk.Limits("a", "b")), "low='a'", "6 low", error=jk.GeometryError)


@pytest.mark.parametrize("starts", [0, -3, 2.5, "a", None, NAN, [1, 2]])
def test_starts_are_a_positive_whole_number(starts):
    sentence(lambda: jk.largest_rotation_ball(R, starts=starts), "starts is", "whole number", "at least 1")


def test_a_search_that_did_not_converge_is_no_result(monkeypatch):
    monkeypatch.setattr(ball, "_STEPS", 0)
    sentence(
        lambda: jk.largest_rotation_ball(R, starts=4), "starts is 4", "none of them converged for R22", "give more"
    )
    # R22 + 2 vanishes nowhere, and its search has nothing to find; R22 - 1 touches zero at home.
    unit = np.diag([0.0, 1.0, 0.0])
    assert [ball._vanishes(ball._quadratic_form(c, unit)) for c in (2.0, 0.0, -1.0, -2.0)] == [False, True, True, False]


@pytest.mark.parametrize("center", ["a", [["1", 0, 0], [0, 1, 0], [0, 0, 1]], np.eye(3) * 1j, np.eye(3) * NAN])
def test_center_is_a_rotation(center):
    sentence(lambda: jk.largest_rotation_ball(R, center), "center is", "rotation matrix")


@pytest.mark.parametrize("tolerance", ["x", "1", 0, -1, NAN, None, [1e-3]])
def test_tolerances_are_positive_numbers(tolerance):
    told = f"tolerance is {tolerance!r}"
    sentence(lambda: jk.orientation_aspects(R, tolerance=tolerance), "jk.orientation_aspects", told, "give 1e-09")
    sentence(lambda: jk.reachable_share(R, [0, 0, 0], tolerance=tolerance), "jk.reachable_share", told, "give 1e-05")
    sentence(lambda: jk.free_volume(T, tolerance=tolerance), "jk.free_volume", told, "give 0.001")


@pytest.mark.parametrize(
    ("call", "parts"),
    [
        (lambda: jk.free_volume(T, seed="a"), ["seed is 'a'", "whole number"]),
        (lambda: jk.free_volume(T, seed=-1), ["seed is -1", "at least 0"]),
        (lambda: jk.free_volume(T, ["upper"]), ["branch", "['upper']"]),
        (lambda: jk.aspect_solid(R, n="a"), ["n is 'a'", "whole number"]),
        (lambda: jk.joint_solid(R, n="a"), ["n is 'a'", "whole number"]),
        (lambda: jk.joint_solid(R, n=NAN), ["n is nan", "whole number"]),
        (lambda: jk.reachable_share(R, ["a", 0, 0]), ["position is ['a', 0, 0]", "finite numbers"]),
        (lambda: jk.reachable_share(R, [0, 0, 0], ["home"]), ["label is ['home']"]),
        (lambda: jax.jit(lambda p: jk.reachable_share(R, p))(jnp.zeros(3)), ["cannot be traced", "outside jax.jit"]),
        (lambda: jax.jit(lambda p: jk.largest_rotation_ball(R, p))(jnp.eye(3)), ["cannot be traced", "center"]),
    ],
)
def test_arguments_of_maps(call, parts):
    sentence(call, *parts)


def test_an_unknown_aspect_is_both_errors():
    aspects = jk.orientation_aspects(R, tolerance=1e-3)
    text = sentence(lambda: aspects["nohome"], "'nohome'", "'R22 > 0, R33 > 0'", "'home'")
    assert text.startswith("There is no aspect")
    with pytest.raises(KeyError):
        aspects["nohome"]


def test_strokes_that_reach_nothing_leave_nothing():
    robot = tlpm.create(**TOO_SHORT)
    found = jk.free_volume(robot)
    assert float(jk.workspace_volume(robot).volume) == 0.0
    assert (found.volume, found.error, found.sampling, found.resolution, found.share) == (0.0, 0.0, 0.0, 0.0, 0.0)
    assert found.converged
    assert "nan" not in str(found)
    assert "NaN" not in found.to_json()
