import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxkin as jk
from jaxkin.sweep import plan as plans
from jaxkin.sweep.engine import planned
from jaxkin.sweep.plan import boxes, extent, make_plan

ROBOTS = {
    "forward_count": jk.mechanisms.rpr3.analytic(1.0, 0.0, 1.0),
    "forward_branches": jk.mechanisms.rpr3.reference(),
}
AXIS = st.one_of(st.none(), st.integers(2, 40), st.integers(41, 5000), st.integers(5001, 200_000))


@given(st.sampled_from(list(ROBOTS)), st.tuples(AXIS, AXIS, AXIS).filter(any))
def test_tiles_are_whole_chunks_of_bounded_size(name, axes):
    robot = ROBOTS[name]
    grid = jk.Grid(**{f"rho{k + 1}": 1.0 if n is None else (0.0, 4.0, n) for k, n in enumerate(axes)})
    plan = make_plan(robot, jk.fields.by_name(name), grid.bind(robot.joint_axes, "joint"))
    assert all(t % c == 0 for t, c in zip(plan.tile, plan.chunk, strict=True))
    assert all(b <= t for b, t in zip(plan.block, plan.tile, strict=True))
    # Sides are rounded up to whole chunks, and to pieces of equal size.
    slack = 2 ** len(plan.tile)
    assert math.prod(plan.tile) <= slack * plans._TILE_SAMPLES
    assert math.prod(plan.tile) * plan.sample_bytes <= slack * plans._TILE_BYTES
    assert math.prod(plan.block) <= slack * plan.field.block(ROBOTS[name])
    assert plan.tiles == math.prod(plan.counts)


@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=3),
    st.integers(1, 60),
    st.integers(0, 10**6),
)
def test_boxes_of_tiles_make_up_the_grid(shape, target, seed):
    robot, field = ROBOTS["forward_count"], jk.fields.forward_count
    small = jk.Field(**{**vars(field), "block": lambda robot: target})
    grid = jk.Grid(**{f"rho{k + 1}": (0.0, 1.0, shape[k] + 1) if k < len(shape) else 1.0 for k in range(3)})
    plan = make_plan(robot, small, grid.bind(robot.joint_axes, "joint"))
    seen = np.zeros(plan.grid.shape, int)
    for number in range(plan.tiles):
        box = plan.box(number)
        seen[box] += 1
        assert plan.samples(number) == math.prod(extent(box))
        inside = np.zeros(extent(box), int)
        for block in boxes(extent(box), plan.block, (0,) * len(box)):
            inside[block] += 1
        assert (inside == 1).all()
    assert (seen == 1).all()
    some = np.random.default_rng(seed).random(plan.tiles) < 0.5
    assert plan.samples_of(some) == sum(plan.samples(int(n)) for n in np.flatnonzero(some))


def test_float32_halves_numbers_and_leaves_labels():
    poses = jk.Grid(x=(-1.0, 1.0, 5), y=0.0, phi=0.0)
    robot = ROBOTS["forward_count"]
    double, single = (planned("test", robot, "inverse_branches", poses, p)[0] for p in ("float64", "float32"))
    assert [v.dtype for v in double.variables] == ["float64", "int8", "int8"]
    assert [v.dtype for v in single.variables] == ["float32", "int8", "int8"]
    requests = [planned("test", robot, "inverse_branches", poses, p)[1].hash for p in ("float64", "float32")]
    assert requests[0] != requests[1]


@pytest.mark.parametrize(
    ("field", "precision", "words"),
    [
        ("forward_count", "float32", ["'float32'", "forward_count", "use 'float64'"]),
        ("forward_branches", "float32", ["close solutions"]),
        ("forward_count", "double", ["'double'", "'float64' or 'float32'"]),
    ],
)
def test_a_precision_that_is_not_enough_is_refused(field, precision, words):
    grid = jk.Grid(rho1=(0.0, 4.0, 5), rho2=1.0, rho3=1.0)
    with pytest.raises(jk.InputError) as caught:
        jk.sweep(ROBOTS["forward_count"], field, grid, precision=precision)
    for word in words:
        assert word in str(caught.value)
