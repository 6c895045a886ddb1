"""Wide vectors: which kernels get them, and that they change nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.sweep import vectors
from jaxkin.sweep.engine import planned
from jaxkin.sweep.tiler import Tiler, _compiled_block, _compiled_wide

RPR3 = jk.mechanisms.rpr3.analytic(1.0, 0.3, 0.8)
REFERENCE = jk.mechanisms.rpr3.reference()
TLPM = jk.mechanisms.tlpm.create()
PPPS3 = jk.mechanisms.ppps3.create()

JOINTS = {"rho1": (8.0, 22.0, 61), "rho2": 11.0, "rho3": (8.0, 22.0, 67)}
SHORT = {"rho1": (0.0, 4.0, 61), "rho2": 1.0, "rho3": (0.0, 4.0, 67)}
PLANE = {"x": (-1.0, 1.5, 21), "y": (-1.0, 1.0, 17), "phi": (-3.0, 3.0, 13)}
SPACE = {"x": (-90.0, 90.0, 21), "y": (-80.0, 80.0, 17), "z": (-70.0, 70.0, 13)}
TURNS = {"x": 0.1, "y": 0.0, "z": 0.2, "phi": (-1.0, 1.0, 21), "theta": (-1.0, 1.0, 17), "sigma": (-1.0, 1.0, 13)}
STROKES = {
    **dict.fromkeys(("rho1y", "rho1z", "rho2y", "rho3y"), 0.1),
    "rho2z": (-0.9, 0.9, 61),
    "rho3z": (-0.9, 0.9, 67),
}
HANDS = [
    (RPR3, "forward_count", SHORT),
    (RPR3, "forward_branches", SHORT),
    (REFERENCE, "forward_branches", JOINTS),
    (RPR3, "smallest_singular_value", PLANE),
    (RPR3, "inverse_branches", PLANE),
    (TLPM, "inverse_condition_number", SPACE),
    (TLPM, "binding_limit", SPACE),
    (PPPS3, "direct_determinant", TURNS),
    (PPPS3, "forward_branches", STROKES),
]


def _tiler(robot, field, axes):
    plan, _ = planned("test", robot, field, jk.Grid(**axes), "float64")
    return Tiler(robot, plan), plan


@pytest.fixture
def wide_machine(monkeypatch):
    monkeypatch.setattr(vectors, "_machine_has_them", lambda: True)


@pytest.mark.parametrize(("robot", "field", "axes"), HANDS, ids=lambda x: x if isinstance(x, str) else None)
def test_both_widths_give_the_same_numbers(wide_machine, robot, field, axes):
    """Where the processor has no wide vectors both are compiled alike, and this says nothing."""
    tiler, plan = _tiler(robot, field, axes)
    assert tiler._run.func is _compiled_wide
    block = tuple(slice(0, n) for n in plan.block)
    wide, narrow = (
        [np.asarray(a) for a in kernel(tiler._robot, tiler._coordinates(block), **tiler._run.keywords)]
        for kernel in (_compiled_wide, _compiled_block)
    )
    for one, other in zip(wide, narrow, strict=True):
        if one.dtype.kind == "f":
            largest = np.nanmax(np.abs(other))
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * largest)
        else:
            assert np.array_equal(one, other)


def test_an_arctangent_is_computed_as_ever(wide_machine):
    """With wide vectors jaxlib 0.10 makes nonsense of it."""
    grid = jk.Grid(rho1=(0.0, 4.0, 101), rho2=1.0, rho3=(0.0, 4.0, 97))
    field = jk.fields.from_function(lambda robot, q: jnp.arctan(q[0] - q[2]), name="my_angle", domain="joints")
    tiler, _ = _tiler(RPR3, field, {"rho1": (0.0, 4.0, 101), "rho2": 1.0, "rho3": (0.0, 4.0, 97)})
    assert tiler._run.func is _compiled_block
    found = jk.sweep(RPR3, field, grid)["my_angle"].values
    rho1, rho3 = np.linspace(0, 4, 101)[:, None], np.linspace(0, 4, 97)
    np.testing.assert_allclose(found, np.arctan(rho1 - rho3), rtol=1e-15, atol=1e-16)


@pytest.mark.parametrize(
    ("function", "serves"),
    [
        (lambda x: jnp.sqrt(x * x + 1) / jnp.sin(x), True),
        (jnp.arctan, False),
        (lambda x: jax.lax.fori_loop(0, 3, lambda k, y: jnp.arctan(y), x), False),
        (lambda x: jax.lax.cond(x[0] > 0, jnp.exp, jnp.negative, x), False),
        (jax.jit(lambda x: jax.vmap(jnp.tan)(x)), False),
    ],
)
def test_what_is_called_by_name_is_found_in_loops_and_calls(wide_machine, function, serves):
    assert vectors.serve(jax.jit(function).trace(np.linspace(0.1, 1.0, 8))) is serves


def test_a_machine_without_them_has_none(monkeypatch):
    monkeypatch.setattr(vectors, "_machine_has_them", lambda: False)
    assert not vectors.serve(jax.jit(jnp.negative).trace(np.ones(8)))


#: One-argument operations of the list, each over its own domain.
@pytest.mark.parametrize("name", ["abs", "ceil", "cos", "floor", "reciprocal", "round", "rsqrt", "sign", "sin", "sqrt"])
@pytest.mark.parametrize("count", [1000, 1 << 14, (1 << 14) + 3])
def test_operations_bear_wide_vectors(name, count):
    function = jax.lax.rsqrt if name == "rsqrt" else getattr(jnp, name)
    x = np.random.default_rng(0).uniform(0.01, 30.0, count)
    wide = jax.jit(function, compiler_options=vectors.WIDE)(x)
    exact = 1 / np.sqrt(x) if name == "rsqrt" else getattr(np, name)(x)
    np.testing.assert_allclose(np.asarray(wide), exact, rtol=4e-16, atol=1e-15)
