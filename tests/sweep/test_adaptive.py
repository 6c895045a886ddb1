"""Adaptive sweeps: the dense sweep again, sample for sample; what is never missed; proofs; evidence."""

import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.sweep import _adaptive_lattice as lattices
from jaxkin.sweep import _adaptive_samples
from tests.oracles.rpr3_exact import count_analytic

ROBOT = jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0)
LIMITED = ROBOT.with_limits(rho1=(0.5, 2.0), rho2=(0.25, 2.5))
TLPM = jk.mechanisms.tlpm.create()
PPPS3 = jk.mechanisms.ppps3.create()
SECTION = jk.Grid(rho1=(0.0, 4.0, 161), rho2=1.0, rho3=(0.0, 4.0, 150))
PLANE = jk.Grid(x=(-1.0, 1.0, 101), y=(-1.0, 1.0, 91), phi=0.0)
TURN = (-math.pi, math.pi)


def dense_label(robot, field, grid, label):
    dense = jk.sweep(robot, field, grid)
    if label in dense:
        return dense[label].values
    values = dense[label.removesuffix("_sign")].values
    return np.where(np.isnan(values), 2, np.sign(np.nan_to_num(values))).astype(np.int8)


def check_proofs(found, dense):
    """Every sample in a proved cell, faces included, has the label of the cell."""
    lattice = found._lattice()
    lead = dense.ndim - lattice.dimension
    turns = [(0, steps + 1 - samples) for steps, samples in zip(lattice.steps, lattice.shape, strict=True)]
    whole = np.pad(dense, [(0, 0)] * lead + turns, mode="wrap").reshape(-1, *(n + 1 for n in lattice.steps))
    labels = found.label.values.reshape(len(whole), -1)
    proved = np.flatnonzero(found.constant.values == 2)
    low = found.place.values[proved].astype(int)
    high = lattice.high(low, found["size"].values[proved]) + 1
    for cell, begin, end in zip(proved, low.tolist(), high.tolist(), strict=True):
        block = whole[(slice(None), *map(slice, begin, end))].reshape(len(whole), -1)
        assert (block == labels[:, cell : cell + 1]).all()


CASES = {
    "count": (ROBOT, "forward_count", SECTION, {}),
    "count without proof": (ROBOT, "forward_count", SECTION, {"proof": 0, "stride": 16}),
    "count, coarse proof": (ROBOT, "forward_count", SECTION, {"proof": 8, "stride": 16}),
    "count over a line": (ROBOT, "forward_count", jk.Grid(rho1=(0.0, 4.0, 333), rho2=1.0, rho3=0.4), {}),
    "count in a box with limits": (
        LIMITED,
        "forward_count",
        jk.Grid(rho1=(0.0, 4.0, 41), rho2=(0.0, 3.0, 37), rho3=(0.0, 4.0, 29)),
        {"stride": 8},
    ),
    "count of another robot": (
        TLPM,
        "forward_count",
        jk.Grid(l1=(-300.0, 300.0, 40), l2=(-300.0, 300.0, 31), l3=0.0),
        {},
    ),
    "general count": (
        jk.mechanisms.rpr3.reference(),
        "forward_count",
        jk.Grid(rho1=14.98, rho2=(8.0, 22.0, 40), rho3=(8.0, 22.0, 49)),
        {"stride": 8},
    ),
    "sign over a turn": (
        ROBOT,
        "direct_determinant",
        jk.Grid(x=(-3.0, 3.0, 25), y=(-3.0, 3.0, 22), phi=(*TURN, 24)),
        {"label": "sign", "stride": 8},
    ),
    "sign within limits": (
        LIMITED,
        "direct_determinant",
        jk.Grid(x=(-3.0, 3.0, 97), y=0.3, phi=(*TURN, 90)),
        {"label": "sign"},
    ),
    "sign, periods twice": (
        PPPS3,
        "direct_determinant",
        # No sample at phi = +-pi / 2, where R33 vanishes and rounding alone decides.
        jk.Grid(x=0.1, y=0.2, z=0.1, phi=(*TURN, 22), theta=(-1.5, 1.5, 13), sigma=(*TURN, 18)),
        {"label": "sign", "stride": 8},
    ),
    "statuses": (LIMITED, "inverse_branches", jk.Grid(x=(-3.0, 3.0, 90), y=(-3.0, 3.0, 77), phi=0.4), {}),
    "binding limit": (
        jk.mechanisms.tlpm.create(),
        "binding_limit",
        jk.Grid(x=(-500.0, 500.0, 60), y=(-500.0, 500.0, 65), z=10.0),
        {"stride": 8},
    ),
    "statuses of branches": (
        ROBOT,
        "forward_branches",
        jk.Grid(rho1=(0.1, 4.0, 60), rho2=1.0, rho3=(0.1, 4.0, 70)),
        {},
    ),
}


#: Cases whose fields take long to compile.
SLOW = ("general count", "binding limit", "statuses of branches")


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.slow) if c in SLOW else c for c in CASES])
def test_the_dense_sweep_again(case):
    robot, field, grid, options = CASES[case]
    found = jk.sweep(robot, field, grid, adaptive=jk.Adaptive(**options))
    again = found.to_dense()
    expected = dense_label(robot, field, grid, found.attrs["label"])
    np.testing.assert_array_equal(again[found.attrs["label"]].values, expected)
    check_proofs(found, expected)
    assert found.attrs["evaluations"] == found.sizes["sample"] <= expected.size


def test_a_dense_map_has_the_labels_of_a_dense_sweep():
    dense = jk.sweep(ROBOT, "forward_count", SECTION)
    again = jk.sweep(ROBOT, "forward_count", SECTION, adaptive=True).to_dense()
    assert again.forward_count.dims == dense.forward_count.dims
    assert again.forward_count.attrs == dense.forward_count.attrs
    assert again.forward_count.dtype == dense.forward_count.dtype
    assert set(again.data_vars) == set(dense.data_vars)
    for name in dense.coords:
        xarray.testing.assert_identical(again[name], dense[name])


def test_what_is_proved_needs_no_estimate():
    found = jk.sweep(ROBOT, "forward_count", SECTION, adaptive=True)
    large = found["size"].values > 1
    assert np.all(found.constant.values[large] == 2)
    assert found.attrs["probes"] == 0
    assert found.attrs["missed_share_bound"] == 0
    assert "no sample of the grid differs" in repr(found)


def test_cells_fill_the_grid_and_boundary_cells_are_one_step_wide():
    found = jk.sweep(ROBOT, "forward_count", SECTION, adaptive=jk.Adaptive(proof=0))
    volume = np.prod(found.high.values - found.low.values, axis=1)
    assert volume.sum() == pytest.approx(16.0, rel=1e-12)
    mixed = found.constant.values == 0
    assert np.all(found["size"].values[mixed] == 1)
    np.testing.assert_array_equal(found["size"], 32 >> found.level.values)
    covered = np.zeros((160, 149), int)
    for low, size in zip(found.place.values, found["size"].values, strict=True):
        covered[low[0] : low[0] + size, low[1] : low[1] + size] += 1
    assert np.all(covered == 1)


def disc(x, y, radius, name="in_disc"):
    return jk.fields.from_function(
        lambda robot, pose: (pose[0] - x) ** 2 + (pose[1] - y) ** 2 <= radius**2, name=name, domain="pose", dtype="bool"
    )


def labelled(function, name, dtype="int32"):
    return jk.fields.from_function(
        lambda robot, pose: function(pose[0], pose[1]), name=name, domain="pose", dtype=dtype
    )


#: Closures over other numbers are other fields, each compiled anew: their numbers travel as the robot's geometry.
@settings(max_examples=40)
@given(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.floats(0.0, 0.5), st.sampled_from([4, 8, 16]))
def test_a_box_of_the_stated_size_is_never_missed(x, y, radius, stride):
    robot = jk.mechanisms.rpr3.analytic(1.0, x, 1.0).with_limits(rho1=(0.0, radius), rho2=(0.0, y + 2))
    found = jk.sweep(robot, IN_DISC, PLANE, adaptive=jk.Adaptive(stride=stride, probes=0))
    sides = json.loads(found.attrs["resolution"])
    assert sides == pytest.approx({"x": stride * 2 / 100, "y": stride * 2 / 90})
    expected = jk.sweep(robot, IN_DISC, PLANE).moving_disc.values
    again = found.to_dense().moving_disc.values
    # A disc whose inscribed box of these proportions is that large; the part outside the grid does not count.
    holds = math.hypot(*sides.values()) / 2 <= radius and max(abs(x), abs(y)) + radius <= 1
    if holds:
        assert expected.any()
    if holds or found.to_dense().moving_disc.any():
        # Met anywhere: all of it, as it hangs together.
        np.testing.assert_array_equal(again, expected)


IN_DISC = jk.fields.from_function(
    lambda robot, pose: (
        (pose[0] - robot.c3) ** 2 + (pose[1] - (robot.limits.high[1] - 2)) ** 2 <= robot.limits.high[0] ** 2
    ),
    name="moving_disc",
    domain="pose",
    dtype="bool",
)


def test_a_thin_finger_that_hangs_together_with_a_boundary_is_followed():
    def finger(x, y):
        spiral = (jnp.abs(y - 0.5 * jnp.sin(6 * x)) < 0.03) & (jnp.abs(x) < 0.9)
        return spiral | ((x + 0.7) ** 2 + y**2 < 0.04)

    field = labelled(finger, "finger", "bool")
    grid = jk.Grid(x=(-1.0, 1.0, 513), y=(-1.0, 1.0, 513), phi=0.0)
    found = jk.sweep(ROBOT, field, grid, adaptive=jk.Adaptive(stride=128, probes=0))
    np.testing.assert_array_equal(found.to_dense().finger, jk.sweep(ROBOT, field, grid).finger)
    assert found.attrs["evaluations"] < 0.1 * grid_size(grid)


def grid_size(grid):
    return math.prod(grid.axes[name].count for name in grid.free)


def test_slabs_across_the_seam_of_a_period():
    field = jk.fields.from_function(
        lambda robot, pose: jnp.floor(3 + jnp.cos(pose[2]) - pose[0]).astype(jnp.int8),
        name="slabs",
        domain="pose",
        dtype="int8",
    )
    grid = jk.Grid(x=(-1.0, 1.0, 70), y=0.0, phi=(*TURN, 77))
    found = jk.sweep(ROBOT, field, grid, adaptive=True)
    np.testing.assert_array_equal(found.to_dense().slabs, jk.sweep(ROBOT, field, grid).slabs)
    assert found.high.values[:, 1].max() == math.pi


def test_probes_find_an_island_or_bound_it():
    grid = jk.Grid(x=(-1.0, 1.0, 513), y=(-1.0, 1.0, 513), phi=0.0)
    field = disc(0.2718, 0.3141, 0.02)
    expected = jk.sweep(ROBOT, field, grid).in_disc.values
    blind = jk.sweep(ROBOT, field, grid, adaptive=jk.Adaptive(stride=64, probes=0))
    assert not blind.label.values.any()
    assert "no estimate" in repr(blind)
    few = jk.sweep(ROBOT, field, grid, adaptive=jk.Adaptive(stride=64, probes=20))
    assert few.label.values.any() or few.attrs["missed_share_bound"] > expected.mean()
    many = jk.sweep(ROBOT, field, grid, adaptive=jk.Adaptive(stride=64, probes=20000, seed=3))
    np.testing.assert_array_equal(many.to_dense().in_disc, expected)
    assert many.attrs["probe_hits"] > 0
    assert many.attrs["probe_rounds"] == 2
    assert many.attrs["seed"] == 3
    assert many.attrs["missed_share_bound"] == pytest.approx(math.log(6 / 0.05) / 20000, rel=0.05)


def test_the_bound_holds_as_often_as_it_says():
    grid = jk.Grid(x=(-1.0, 1.0, 201), y=(-1.0, 1.0, 201), phi=0.0)
    field = disc(0.271, 0.316, 0.03)
    expected = jk.sweep(ROBOT, field, grid).in_disc.values
    wrong = 0
    for seed in range(60):
        found = jk.sweep(ROBOT, field, grid, adaptive=jk.Adaptive(stride=64, probes=2000, seed=seed))
        wrong += float((found.to_dense().in_disc.values != expected).mean()) > found.attrs["missed_share_bound"]
    # 3 are expected at most; more than 8 happen once in a thousand times.
    assert wrong <= 8


def test_walls_of_ones_own_prove_and_wrong_ones_are_named():
    grid = jk.Grid(x=(-1.0, 1.0, 129), y=(-1.0, 1.0, 129), phi=0.0)

    def passed(robot, pose):
        return (pose[0] > 0.31).astype(int) + ((pose[0] + 0.27) ** 2 + (pose[1] - 0.24) ** 2 < 0.02)

    def walls(robot, pose):
        return jnp.stack([pose[0] - 0.31, (pose[0] + 0.27) ** 2 + (pose[1] - 0.24) ** 2 - 0.02])

    field = jk.fields.from_function(passed, name="passed", domain="pose", dtype="int8", walls=walls)
    found = jk.sweep(ROBOT, field, grid, adaptive=True)
    np.testing.assert_array_equal(found.to_dense().passed, jk.sweep(ROBOT, field, grid).passed)
    assert np.all(found.constant.values[found["size"].values > 1] == 2)
    # What no sample met, samples of proved cells may.
    bad = jk.fields.from_function(
        passed, name="passed_badly", domain="pose", dtype="int8", walls=lambda robot, pose: pose[:1] - 0.31
    )
    blind = jk.sweep(ROBOT, bad, grid, adaptive=jk.Adaptive(stride=64, probes=0))
    assert blind.label.values.max() == 1
    with pytest.raises(jk.InputError, match=r"no wall and two labels.*proof=0"):
        jk.sweep(ROBOT, bad, grid, adaptive=jk.Adaptive(stride=64))


def test_the_cost_grows_like_the_boundary():
    counts = []
    for n in (256, 512, 1024):
        grid = jk.Grid(rho1=(0.0, 4.0, n + 1), rho2=1.0, rho3=(0.0, 4.0, n + 1))
        counts.append(
            jk.sweep(ROBOT, "forward_count", grid, adaptive=jk.Adaptive(proof=0, probes=0)).attrs["evaluations"]
        )
    assert counts[1] / counts[0] < 2.3
    assert counts[2] / counts[1] < 2.3
    assert counts[2] < 0.04 * 1024**2


@pytest.mark.parametrize("field", ["forward_count", IN_DISC])
def test_results_depend_on_neither_block_nor_workers(field, monkeypatch):
    grid = SECTION if field == "forward_count" else PLANE
    robot = ROBOT if field == "forward_count" else ROBOT.with_limits(rho1=(0.0, 0.3), rho2=(0.0, 2.1))
    one = jk.sweep(robot, field, grid, adaptive=jk.Adaptive(probes=500), workers=1)
    monkeypatch.setattr(_adaptive_samples, "BLOCK", 97)
    other = jk.sweep(robot, field, grid, adaptive=jk.Adaptive(probes=500), workers=3)
    log = one.attrs.pop("run_log"), other.attrs.pop("run_log")
    assert json.loads(log[0])["workers"] == 1
    xarray.testing.assert_identical(one.to_dataset(), other.to_dataset())


def test_one_compilation_serves_all_rounds_and_the_next_sweep(caplog):
    field = jk.fields.from_function(
        lambda robot, q: q[0] * robot.c2 > q[2], name="my_test", domain="joints", dtype="bool"
    )
    jax.config.update("jax_log_compiles", True)
    try:
        jk.sweep(ROBOT, field, SECTION, adaptive=True)
        other = jk.Grid(rho1=(1.0, 2.0, 61), rho2=3.0, rho3=(0.0, 1.0, 47))
        jk.sweep(jk.mechanisms.rpr3.analytic(1.5, 0.2, 0.7), field, other, adaptive=True)
    finally:
        jax.config.update("jax_log_compiles", False)
    compiled = [r for r in caplog.records if "Finished XLA compilation of jit(scattered_values)" in r.getMessage()]
    assert len(compiled) == 1


def test_ctrl_c_leaves_the_cells_so_far():
    calls = iter(range(10**6))

    def unpack(arrays):
        if next(calls) == 2:
            raise KeyboardInterrupt
        return arrays

    own = labelled(lambda x, y: x * x + y * y < 0.3, "cut", "bool")
    field = jk.Field(**{**vars(own), "unpack": unpack})
    with pytest.raises(jk.SweepInterrupted) as caught:
        jk.sweep(ROBOT, field, PLANE, adaptive=True, workers=1)
    assert caught.value.dataset.attrs["complete"] == 0
    assert caught.value.samples_done == caught.value.dataset.attrs["evaluations"] > 0
    assert "interrupted" in repr(caught.value.dataset)


def test_keys_keep_cells_together():
    place = np.array([[3, 5, 1], [0, 0, 0], [7, 7, 7], [300, 2, 260]])
    keys = lattices.morton(place, 9)
    naive = [sum(((int(p) >> b) & 1) << (3 * b + 2 - k) for b in range(9) for k, p in enumerate(row)) for row in place]
    assert keys.tolist() == naive


def test_proved_cells_hold_what_the_exact_oracle_counts():
    """At points between the samples, and for other members of the family than the paper's example."""
    draw = np.random.default_rng(5)
    for geometry in ((1.0, 0.0, 1.0), (1.3, 0.45, -0.8), (-0.7, 1.1, 0.6)):
        robot = jk.mechanisms.rpr3.analytic(*geometry)
        grid = jk.Grid(rho1=(0.0, 4.0, 65), rho2=0.9, rho3=(0.1, 4.0, 65))
        found = jk.sweep(robot, "forward_count", grid, adaptive=jk.Adaptive(stride=16))
        np.testing.assert_array_equal(
            found.to_dense().forward_count, jk.sweep(robot, "forward_count", grid).forward_count
        )
        proved = np.flatnonzero(found.constant.values == 2)
        cells = proved[draw.integers(len(proved), size=60)]
        share = draw.random((60, 2))
        points = found.low.values[cells] + share * (found.high.values - found.low.values)[cells]
        for (rho1, rho3), label in zip(points.tolist(), found.forward_count.values[cells], strict=True):
            assert count_analytic(*geometry, rho1, 0.9, rho3).count == label


@settings(max_examples=25)
@given(st.floats(0.3, 2.0), st.floats(-2.0, 2.0), st.floats(0.3, 2.0), st.booleans(), st.floats(0.05, 3.0))
def test_walls_of_the_count_for_any_member(c2, c3, d3, mirrored, rho2):
    robot = jk.mechanisms.rpr3.analytic(c2, c3, -d3 if mirrored else d3)
    grid = jk.Grid(rho1=(0.0, 5.0, 49), rho2=rho2, rho3=(0.0, 5.0, 49))
    found = jk.sweep(robot, "forward_count", grid, adaptive=jk.Adaptive(stride=8))
    dense = jk.sweep(robot, "forward_count", grid)
    # Where float64 cannot decide a number, two loops of the compiler may decide it otherwise.
    differ = (found.to_dense().forward_count.values != dense.forward_count.values) & ~dense.forward_count_nearly_double
    assert not differ.any()


def test_four_free_axes():
    def inside(robot, pose):
        return jnp.sum((pose[:4] - 0.1) ** 2) < 0.5

    field = jk.fields.from_function(
        inside,
        name="in_ball",
        domain="pose",
        dtype="bool",
        walls=lambda robot, pose: jnp.sum((pose[:4] - 0.1) ** 2)[None] - 0.5,
    )
    grid = jk.Grid(x=(-1.0, 1.0, 11), y=(-1.0, 1.0, 10), z=(-1.0, 1.0, 12), phi=(*TURN, 16), theta=0.0, sigma=0.0)
    found = jk.sweep(PPPS3, field, grid, adaptive=jk.Adaptive(stride=4))
    expected = jk.sweep(PPPS3, field, grid).in_ball.values
    np.testing.assert_array_equal(found.to_dense().in_ball, expected)
    assert found.to_dense().in_ball.dims == ("x", "y", "z", "phi")
    check_proofs(found, expected)
