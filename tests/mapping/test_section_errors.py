"""Bad input to the maps of a section: each message names the value and says what to do."""

import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np
import pytest
from section_checks import section

import jaxkin as jk
from jaxkin.mechanisms import rpr3

EXAMPLE = zoo.build(np.array(zoo.EXAMPLE))
FREE = (0.0, 4.0, 100)
POSE = [1.0, 0.0, 0.0]
CALLS = {
    "jk.singular_curves": jk.singular_curves,
    "jk.cusps": jk.cusps,
    "jk.fold": lambda robot, grid: jk.fold(robot, grid, POSE),
}
both = pytest.mark.parametrize("name", list(CALLS))

BAD_SECTIONS = {
    "no free axis": ({"rho1": 1.0, "rho2": 1.0, "rho3": 1.0}, ["no free axis", "(low, high, n)"]),
    "one free axis": ({"rho1": FREE, "rho2": 1.0, "rho3": 1.0}, ["1 free joint axis (rho1)", "two", "free another"]),
    "three free axes": (
        {"rho1": FREE, "rho2": FREE, "rho3": FREE},
        ["3 free joint axes", "rho1, rho2, rho3", "fix the"],
    ),
    "an unknown axis": ({"rho1": FREE, "rho2": 1.0, "rho4": FREE}, ["'rho4'", "rho1, rho2, rho3"]),
    "a missing axis": ({"rho1": FREE, "rho2": FREE}, ["'rho3'", "fix it"]),
    "a negative fixed length": (
        {"rho1": FREE, "rho2": -1.0, "rho3": FREE},
        ["rho2 is fixed at -1", "limits 0 to inf"],
    ),
    "a fixed length of zero": (
        {"rho1": FREE, "rho2": 0.0, "rho3": FREE},
        ["rho2 is fixed at 0", "zero length", "positive"],
    ),
    "a free range below zero": (
        {"rho1": (-2.0, -1.0, 9), "rho2": 1.0, "rho3": FREE},
        ["rho1 goes from -2 to -1", "limits 0 to inf", "robot.limits"],
    ),
    "an unreachable section": (
        {"rho1": (5.0, 6.0, 9), "rho2": 1.0, "rho3": (5.0, 6.0, 9)},
        ["no pose reaches", "rho1 = 5 .. 6, rho2 = 1, rho3 = 5 .. 6", "widen"],
    ),
}


@both
@pytest.mark.parametrize("case", list(BAD_SECTIONS))
def test_bad_sections(name, case):
    axes, words = BAD_SECTIONS[case]
    with pytest.raises(jk.InputError) as caught:
        CALLS[name](EXAMPLE, jk.Grid(**axes))
    for word in words if "axis" in case else [name, *words]:
        assert word in str(caught.value)


@both
def test_sections_outside_the_limits_of_the_robot(name):
    limits = jk.Limits(jnp.array([0.5, 0.8, 0.0]), jnp.array([2.0, 1.2, 3.0]))
    robot = rpr3.analytic(*zoo.EXAMPLE, limits=limits)
    with pytest.raises(jk.InputError, match=r"rho2 is fixed at 1\.5, outside its limits 0\.8 to 1\.2.*widen"):
        CALLS[name](robot, section(1, 1.5))
    with pytest.raises(jk.InputError, match=r"rho1 goes from 2\.5 to 6, outside its limits 0\.5 to 2"):
        CALLS[name](robot, section(1, 1.0, low=2.5))


@both
@pytest.mark.parametrize("bad", [None, {"rho1": FREE, "rho2": 1.0, "rho3": FREE}, (FREE, 1.0, FREE)])
def test_a_section_that_is_no_grid(name, bad):
    with pytest.raises(jk.InputError, match=rf"{name} got .*Grid"):
        CALLS[name](EXAMPLE, bad)


@both
@pytest.mark.parametrize("bad", [None, "rpr3", rpr3.AnalyticRPR3])
def test_a_mechanism_that_is_none(name, bad):
    with pytest.raises(jk.InputError, match=rf"{name} got .*Mechanism"):
        CALLS[name](bad, section(1, 1.0))


@both
@pytest.mark.parametrize("change", [{"d3": 0.0}, {"c2": 0.0}, {"c3": np.nan}, {"c2": np.inf}])
def test_degenerate_geometries(name, change):
    robot = EXAMPLE.replace(**{k: jnp.asarray(v) for k, v in change.items()})
    with pytest.raises(jk.GeometryError, match=rf"{name}.*degenerate.*constructor"):
        CALLS[name](robot, section(1, 1.0))


@jk.mechanism
class Twins(jk.Mechanism):
    """Two legs that repeat each other: singular at every pose."""

    pose_axes = (jk.Axis("x", "length"), jk.Axis("y", "length"))
    joint_axes = (jk.Axis("p", "length", 0.0), jk.Axis("q", "length", 0.0))
    size: jax.Array

    def constraints(self, pose, joints):
        square = jnp.sum((pose - jnp.array([self.size, 0.0])) ** 2)
        return jnp.stack([square - joints[0] ** 2, square - joints[1] ** 2])

    def characteristic_length(self):
        return self.size


@pytest.mark.parametrize("name", ["jk.singular_curves", "jk.cusps"])
def test_a_mechanism_that_is_singular_everywhere(name):
    with pytest.raises(jk.GeometryError, match=rf"{name}.*vanishes identically.*change the geometry"):
        CALLS[name](Twins(jnp.asarray(1.0)), jk.Grid(p=FREE, q=FREE))


def test_an_unknown_method_and_a_method_without_closed_forms():
    with pytest.raises(jk.InputError, match=r"method is 'newton': choose 'trace' or 'closed form'"):
        jk.singular_curves(EXAMPLE, section(1, 1.0), method="newton")
    with pytest.raises(jk.InputError, match=r"no closed forms.*method='trace'"):
        jk.singular_curves(rpr3.reference(), section(1, 15.0, high=60.0), method="closed form")


def test_no_float64():
    code = """
import jaxkin as jk
from jaxkin.mechanisms import rpr3
robot = rpr3.analytic(1.0, 0.0, 1.0)
grid = jk.Grid(rho1=(0.0, 4.0, 9), rho2=1.0, rho3=(0.0, 4.0, 9))
for call in (jk.singular_curves, jk.cusps, lambda r, g: jk.fold(r, g, [1.0, 0.0, 0.0])):
    try:
        call(robot, grid)
    except jk.PrecisionError as error:
        print(error)
jk.enable_x64()
try:
    jk.cusps(robot, grid)
except jk.PrecisionError as error:
    print(error)
"""
    root = Path(jk.__file__).parents[1]
    result = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    lines = result.stdout.splitlines()
    assert [line.split(" ")[0] for line in lines] == ["jk.singular_curves", "jk.cusps", "jk.fold", "jk.cusps"]
    assert all("jaxkin.enable_x64()" in line for line in lines)
    assert "make the mechanism again" in lines[-1]
