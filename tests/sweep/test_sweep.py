import json
import os
import signal
import threading

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.sweep import plan

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
REFERENCE = jk.mechanisms.rpr3.reference()
GRID = jk.Grid(rho1=(0.01, 4.0, 61), rho2=1.0, rho3=(0.02, 4.0, 47))
POSES = jk.Grid(x=(-2.0, 2.0, 5), y=(-1.0, 1.5, 4), phi=(-3.0, 3.0, 6))


def vectors(dataset, axes):
    mesh = np.meshgrid(*(np.atleast_1d(dataset[a].values) for a in axes), indexing="ij")
    return np.stack([m.ravel() for m in mesh], axis=-1)


def test_counts_are_the_counts_of_forward():
    data = jk.sweep(ROBOT, jk.fields.forward_count, GRID)
    branches = jax.vmap(jk.forward, in_axes=(None, 0))(ROBOT, vectors(data, ("rho1", "rho2", "rho3")))
    np.testing.assert_array_equal(data.forward_count.values.ravel(), np.asarray(branches.count))
    assert set(np.unique(data.forward_count)) == {0, 2, 4, 6}


@pytest.mark.parametrize(("robot", "low", "high"), [(ROBOT, 0.01, 4.0), (REFERENCE, 8.0, 22.0)])
def test_branches_are_the_branches_of_forward(robot, low, high):
    grid = jk.Grid(rho1=(low, high, 13), rho2=(low, high, 7), rho3=(low, high, 5))
    data = jk.sweep(robot, "forward_branches", grid)
    branches = jax.vmap(jk.forward, in_axes=(None, 0))(robot, vectors(data, ("rho1", "rho2", "rho3")))
    swept = data.forward_branches.transpose("rho1", "rho2", "rho3", "branch", "forward_coordinate").values
    np.testing.assert_allclose(swept.reshape(-1, 6, 3), branches.values, rtol=1e-9, atol=1e-9 * high)
    status = data.forward_branches_status.transpose("rho1", "rho2", "rho3", "branch").values.reshape(-1, 6)
    np.testing.assert_array_equal(status, branches.status)
    assert list(data.forward_coordinate.values) == ["x", "y", "phi"]


@pytest.mark.slow
def test_general_count_agrees_with_analytic_count():
    general = jk.mechanisms.rpr3.general(1.0, 0.0, 1.0, 1.0, 1.0, -np.pi / 2)
    grid = jk.Grid(rho1=(0.013, 4.0, 12), rho2=1.0, rho3=(0.027, 4.0, 12))
    one, other = (jk.sweep(robot, "forward_count", grid) for robot in (ROBOT, general))
    np.testing.assert_array_equal(one.forward_count, other.forward_count)


def test_pose_fields_are_the_single_pose_functions():
    names = ("direct_determinant", "smallest_singular_value", "inverse_condition_number")
    fields = {name: jk.sweep(ROBOT, name, POSES) for name in names}
    inverse = jk.sweep(ROBOT, "inverse_branches", POSES)
    margins = jk.sweep(ROBOT, "limit_margins", POSES)
    for index, pose in enumerate(vectors(fields[names[0]], ("x", "y", "phi"))):
        joints = jk.inverse(ROBOT, pose).values[0]
        measures = jk.conditioning(ROBOT, pose, joints)
        for name, value in zip(names, measures, strict=True):
            assert fields[name][name].values.ravel()[index] == pytest.approx(float(value), rel=1e-12, abs=1e-14)
        np.testing.assert_allclose(inverse.inverse_branches.values.reshape(3, -1)[:, index], joints, rtol=1e-14)
        expected = jk.margins(ROBOT, pose, joints)
        for limit in margins.limit.values:
            assert margins.limit_margins.sel(limit=limit).values.ravel()[index] == pytest.approx(float(expected[limit]))


def test_limits_turn_counts_to_zero_outside_and_margins_negative():
    limits = jk.Limits.lengths(3, low=0.5, high=2.0)
    robot = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0, limits=limits)
    data = jk.sweep(robot, "forward_count", GRID)
    free = jk.sweep(ROBOT, "forward_count", GRID)
    inside = (data.rho1 >= 0.5) & (data.rho1 <= 2.0) & (data.rho3 >= 0.5) & (data.rho3 <= 2.0)
    np.testing.assert_array_equal(data.forward_count, free.forward_count.where(inside, 0))
    margins = jk.sweep(robot, "limit_margins", POSES).limit_margins
    assert float(margins.min()) < 0 < float(margins.max())


def test_result_is_labelled():
    data = jk.sweep(ROBOT, "forward_count", GRID)
    assert data.forward_count.dims == ("rho1", "rho3")
    assert float(data.rho2) == 1.0
    assert data.rho1.attrs["units"] == "length"
    assert data.forward_count.attrs["units"] == "1"
    assert data.attrs["complete"] == 1
    request = json.loads(data.attrs["request"])
    assert request["grid"]["rho1"] == [0.01, 4.0, 61]
    assert request["geometry"]["c2"] == 1.0
    assert json.loads(data.attrs["run_log"])["jax"] == jax.__version__


@pytest.mark.parametrize("name", ["forward_count", "forward_branches", "smallest_singular_value"])
def test_results_depend_on_neither_tiles_nor_workers(name, monkeypatch):
    grid = GRID if name.startswith("forward") else POSES
    field = jk.Field(**{**vars(jk.fields.by_name(name)), "block": lambda robot: 60})
    whole = jk.sweep(ROBOT, field, grid, workers=1)
    monkeypatch.setattr(plan, "_TILE_SAMPLES", 60)
    pieces = jk.sweep(ROBOT, field, grid, workers=3)
    # Another shape of block is another loop of the compiler, which may round the last digit otherwise.
    default = jk.sweep(ROBOT, name, grid)
    for variable in whole.data_vars:
        np.testing.assert_array_equal(whole[variable].values, pieces[variable].values)
        np.testing.assert_allclose(whole[variable].values, default[variable].values, rtol=1e-9, atol=1e-12)


def test_one_compilation_serves_all_chunks_and_the_next_sweep(monkeypatch, caplog):
    monkeypatch.setattr(plan, "_TILE_SAMPLES", 64)
    field = jk.fields.from_function(lambda robot, q: q[0] * robot.c2, name="my_product", domain="joints")
    field = jk.Field(**{**vars(field), "block": lambda robot: 32})
    # The configuration, not the context manager, which holds for this thread only.
    jax.config.update("jax_log_compiles", True)
    try:
        jk.sweep(ROBOT, field, GRID)
        first = _block_compilations(caplog)
        # Another geometry and another section of the same shape: no new kernel.
        other = jk.Grid(rho1=(1.0, 2.0, 61), rho2=3.0, rho3=(0.0, 1.0, 47))
        jk.sweep(jk.mechanisms.rpr3.analytic(1.5, 0.2, 0.7), field, other)
    finally:
        jax.config.update("jax_log_compiles", False)
    assert first == 1
    assert _block_compilations(caplog) == 1


def _block_compilations(caplog):
    return sum("Finished XLA compilation of jit(_block_values)" in r.getMessage() for r in caplog.records)


def test_own_field():
    field = jk.fields.from_function(
        lambda robot, pose: jnp.hypot(pose[0], pose[1]) / robot.c2, name="reach", domain="pose", unit="length"
    )
    data = jk.sweep(ROBOT, field, POSES)
    np.testing.assert_allclose(data.reach, np.hypot(data.x, data.y) + 0 * data.phi)
    assert data.reach.attrs["units"] == "length"


def own(function, name="own", **options):
    return jk.sweep(ROBOT, jk.fields.from_function(function, name=name, domain="joints", **options), GRID)


def test_own_fields_of_whole_numbers_take_whole_numbers_alone():
    assert own(lambda robot, q: q[0] > 1, dtype="int8").own.dtype == np.int8
    assert own(lambda robot, q: (q > 1).sum(), dtype="uint8").own.dtype == np.uint8
    assert own(lambda robot, q: 3, dtype="int8").own.values.max() == 3
    assert own(lambda robot, q: 3).own.dtype == np.float64


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: jk.sweep(ROBOT, "forward_cuont", GRID), ["forward_cuont", "did you mean 'forward_count'"]),
        (lambda: jk.sweep(ROBOT, 3, GRID), ["int", "jk.Grid"]),
        (lambda: jk.sweep(ROBOT, "forward_count", {"rho1": 1}), ["dict"]),
        (lambda: jk.sweep("rpr3", "forward_count", GRID), ["str", "mechanism"]),
        (lambda: jk.sweep(ROBOT, "forward_count", POSES), ["'x'", "rho1, rho2, rho3"]),
        (lambda: jk.sweep(ROBOT.replace(d3=jnp.asarray(0.0)), "forward_count", GRID), ["d3=0", "degenerate"]),
        (lambda: jk.fields.from_function(len, name="n", domain="time"), ["time", "'pose', 'joints' or 'geometry'"]),
        (lambda: jk.fields.from_function(len, name="forward_count", domain="pose"), ["exists"]),
        (lambda: jk.fields.from_function(len, name="", domain="pose"), ["name of a field is ''", "not empty"]),
        (lambda: jk.fields.from_function(len, name=" ", domain="pose"), ["name of a field is ' '"]),
        (lambda: jk.fields.from_function(len, name=["n"], domain="pose"), ["name of a field is ['n']", "text"]),
        (lambda: jk.fields.from_function(len, name="a/b", domain="pose"), ["'a/b'", "without slashes"]),
        (lambda: jk.Field("", "pose", tuple, tuple), ["name of a field is ''"]),
        (lambda: own(lambda robot, q: q[0], name="rho1"), ["variable 'rho1'", "axis", "another name"]),
        (lambda: own(lambda robot, q: q), ["shape (3,)", "one number", "every entry"]),
        (lambda: own(lambda robot, q: q[:1]), ["shape (1,)"]),
        (lambda: own(lambda robot, q: (q[0], q[1])), ["returns tuple", "one number"]),
        (lambda: own(lambda robot, q: None), ["returns NoneType"]),
        (lambda: own(lambda robot, q: q[0], dtype="int8"), ["declared as int8", "returns float64", "cut off"]),
        (lambda: own(lambda robot, q: q[0], dtype="bool"), ["declared as bool", "returns float64"]),
        (lambda: own(lambda robot, q: q[0] + 1j), ["declared as float64", "returns complex128"]),
    ],
)
def test_bad_requests_are_named(call, words):
    with pytest.raises((jk.InputError, jk.GeometryError)) as caught:
        call()
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_error_in_a_field_reaches_the_user():
    def broken(robot, q):
        raise RuntimeError("no such thing")

    with pytest.raises(RuntimeError, match="no such thing"):
        jk.sweep(ROBOT, jk.fields.from_function(broken, name="broken", domain="joints"), GRID)


def _interrupting_field(after: int) -> jk.Field:
    """A field whose host side sends Ctrl-C to this process after some blocks."""
    calls = iter(range(10**6))

    def unpack(arrays):
        if next(calls) == after:
            os.kill(os.getpid(), signal.SIGINT)
            threading.Event().wait(0.3)
        return arrays

    base = jk.fields.from_function(lambda robot, q: q[0] + q[2], name="slow_sum", domain="joints")
    return jk.Field(**{**vars(base), "block": lambda robot: 64, "unpack": unpack})


@pytest.mark.skipif(not hasattr(os, "kill"), reason="needs POSIX signals")
@pytest.mark.usefixtures("heeds_ctrl_c")
def test_ctrl_c_leaves_usable_data(monkeypatch, tmp_path):
    monkeypatch.setattr(plan, "_TILE_SAMPLES", 64)
    with pytest.raises(jk.SweepInterrupted) as caught:
        jk.sweep(ROBOT, _interrupting_field(6), GRID, workers=1)
    data = caught.value.dataset
    done = np.isfinite(data.slow_sum.values)
    assert 0 < caught.value.samples_done == done.sum() < done.size
    assert data.attrs["complete"] == 0
    expected = (data.rho1 + data.rho3).values
    np.testing.assert_array_equal(data.slow_sum.values[done], expected[done])

    store = tmp_path / "cut.zarr"
    with pytest.raises(jk.SweepInterrupted, match=r"cut\.zarr"):
        jk.sweep(ROBOT, _interrupting_field(6), GRID, workers=1, store=store)
    resumed = jk.sweep(ROBOT, _interrupting_field(10**6), GRID, workers=1, store=store)
    np.testing.assert_array_equal(resumed.slow_sum.values, expected)
    assert resumed.attrs["complete"] == 1


def test_progress_is_silent_when_piped_and_shows_when_asked(capsys, monkeypatch):
    from jaxkin.sweep import progress

    jk.sweep(ROBOT, "forward_count", GRID)
    assert capsys.readouterr() == ("", "")
    monkeypatch.setattr(progress, "_PATIENCE", 0.0)
    jk.sweep(ROBOT, "forward_count", GRID, progress=True)
    assert "forward_count" in capsys.readouterr().err
