"""float64 is asked for and never switched on by itself; tolerances are one frozen table."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import jax.numpy as jnp
import pytest

import jaxkin as jk
from jaxkin.core import precision


def test_importing_and_building_leave_float32_alone():
    code = """
import jax.numpy as jnp
import jaxkin as jk
from jaxkin.mechanisms import rpr3
robot = rpr3.analytic(1.0, 0.0, 1.0)
assert jnp.zeros(1).dtype == "float32" and robot.c2.dtype == "float32"
try:
    jk.jacobians(robot, (0.0, 1.0, 0.0), (1.0, 1.0, 1.0))
except jk.PrecisionError as error:
    print(error)
"""
    root = Path(jk.__file__).parents[1]
    result = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert "jk.jacobians" in result.stdout
    assert "jaxkin.enable_x64()" in result.stdout


def test_float64_is_on_here():
    precision.require_x64("the tests")
    assert jnp.zeros(1).dtype == "float64"


def test_tolerances_are_frozen_and_in_order():
    with pytest.raises(dataclasses.FrozenInstanceError):
        jk.TOLERANCES.residual = 1.0
    assert (
        jk.TOLERANCES.residual < jk.TOLERANCES.double_length < jk.TOLERANCES.double_angle < jk.TOLERANCES.triple_angle
    )
