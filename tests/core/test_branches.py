"""What a result says of itself."""

import jax
import jax.numpy as jnp
import mechanism_zoo as zoo
import numpy as np

import jaxkin as jk
from jaxkin.core.branches import Lane, stack_lanes
from jaxkin.mechanisms import rpr3


def test_summary_of_six_modes():
    lines = str(jk.forward(rpr3.reference(), zoo.REFERENCE_JOINTS)).splitlines()
    assert lines[0] == "6 real solutions in 6 lanes"
    assert len(lines) == 7
    assert "12.1756697522" in lines[1]
    assert "residual" in lines[1]


def test_summary_names_doubles_and_empty_lanes():
    robot = rpr3.analytic(*zoo.EXAMPLE)
    text = str(jk.forward(robot, (np.sqrt(3), 1.0, 1.0)))
    assert "2 real solutions in 6 lanes" in text
    assert "multiplicity 3" in text
    assert "singular" in text
    assert f"other lanes: {jk.Status.NO_REAL_SOLUTION.sentence}" in text
    outside = str(jk.forward(robot, (-1.0, 1.0, 1.0)))
    assert outside.splitlines() == [
        "0 real solutions in 6 lanes",
        f"  other lanes: {jk.Status.OUTSIDE_LIMITS.sentence}",
    ]


def test_sentences_follow_the_lanes():
    branches = jk.forward(rpr3.analytic(*zoo.EXAMPLE), (2.0, 1.0, 1.5))
    assert branches.sentences() == [jk.Status.OK.sentence] * 2 + [jk.Status.NO_REAL_SOLUTION.sentence] * 4


def test_batched_and_traced_results_print_their_shape():
    batch = zoo.forward_batch(zoo.build(np.repeat([zoo.EXAMPLE], 4, axis=0)), jnp.ones((4, 3)))
    assert str(batch) == "Branches(values(4, 6, 3))"
    assert batch.count.shape == (4,)
    seen = []

    def inside(joints):
        branches = jk.forward(rpr3.analytic(*zoo.EXAMPLE), joints)
        seen.append(str(branches))
        return branches.count

    jax.jit(inside)(jnp.ones(3))
    assert seen == ["Branches(values(6, 3))"]


def test_stacked_lanes():
    n = 5
    lanes = tuple(
        Lane(
            values=(jnp.full(n, 10.0 * k), jnp.full(n, 10.0 * k + 1)),
            status=jnp.full(n, k, jnp.int8),
            multiplicity=jnp.full(n, k, jnp.int8),
            residual=jnp.full(n, 0.1 * k),
        )
        for k in range(3)
    )
    branches = stack_lanes(lanes)
    assert branches.values.shape == (n, 3, 2)
    np.testing.assert_array_equal(branches.values[0], [[0, 1], [10, 11], [20, 21]])
    np.testing.assert_array_equal(branches.valid[0], [False, True, True])
    np.testing.assert_array_equal(branches.count, [2] * n)


def test_branches_pass_through_transformations():
    branches = jk.forward(rpr3.analytic(*zoo.EXAMPLE), (1.2, 1.0, 1.1))
    doubled = jax.tree_util.tree_map(lambda a: jnp.stack([a, a]), branches)
    assert isinstance(doubled, jk.Branches)
    np.testing.assert_array_equal(doubled.count, [6, 6])
