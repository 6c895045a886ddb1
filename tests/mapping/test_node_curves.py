"""Node curves: both poses singular over one joint value, their balance with swallowtails, crossings in sections."""

import json

import mechanism_zoo as zoo
import numpy as np
import pytest
from section_checks import residuals

import jaxkin as jk
from jaxkin.core.errors import InputError
from jaxkin.mapping.node_curves import node_curves
from jaxkin.mechanisms import five_bar, rpr3

REFERENCE = rpr3.reference()
WIDE = jk.Grid(rho1=(0.01, 200.0, 400), rho2=(0.0, 400.0, 400), rho3=(0.0, 400.0, 400))


@pytest.fixture(scope="module")
def wide():
    return node_curves(REFERENCE, WIDE)


def test_six_node_curves_join_twelve_swallowtails(wide):
    assert len(wide) == 6
    assert wide.complete
    assert wide.excess == ()
    assert {curve.ends for curve in wide} == {("swallowtail", "swallowtail")}
    assert wide.evidence["ends of node curves on swallowtails, swallowtails of the cusp curves"] == [12, 12]


def test_both_poses_close_and_are_singular(wide):
    for curve in wide:
        for k in (0, 1):
            # Next to swallowtails the equations of the pair are nearly dependent.
            assert max(residuals(REFERENCE, curve.poses[:, k], curve.joints)) < 1e-9


def test_the_poses_are_two_between_the_swallowtails(wide):
    length = float(REFERENCE.characteristic_length())
    for curve in wide:
        gaps = zoo.glued_distance(curve.poses[:, 0], curve.poses[:, 1], length)
        assert gaps[[0, -1]].max() < 1e-12
        assert gaps[1:-1].min() > 5e-3


def crossings_of_images(curves, free):
    """Number of proper crossings of the polylines of all curves, each pair of segments once."""
    a = np.concatenate([c.joints[:-1][:, free] for c in curves] + [c.joints[-1:][:, free] for c in curves if c.closed])
    b = np.concatenate([c.joints[1:][:, free] for c in curves] + [c.joints[:1][:, free] for c in curves if c.closed])
    count = 0
    for k in range(len(a)):
        d, e = b[k] - a[k], b[k + 1 :] - a[k + 1 :]
        gap = a[k + 1 :] - a[k]
        area = d[0] * e[:, 1] - d[1] * e[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            s = (gap[:, 0] * e[:, 1] - gap[:, 1] * e[:, 0]) / area
            t = (gap[:, 0] * d[1] - gap[:, 1] * d[0]) / area
        count += int(np.sum((s > 1e-9) & (s < 1 - 1e-9) & (t > 1e-9) & (t < 1 - 1e-9)))
    return count


@pytest.mark.parametrize("value", [17.0, 25.0])
def test_nodes_of_a_section_are_the_crossings_of_its_curves(wide, value):
    section = jk.Grid(rho1=value, rho2=(0.0, 100.0, 900), rho3=(0.0, 100.0, 900))
    curves = jk.singular_curves(REFERENCE, section)
    nodes = sum(int(np.sum((c.joints[1:, 0] - value) * (c.joints[:-1, 0] - value) < 0)) for c in wide)
    assert crossings_of_images(curves, [1, 2]) == nodes
    assert nodes > 0


def test_what_the_symmetry_of_the_family_makes_of_nodes():
    robot = zoo.build(np.array(zoo.EXAMPLE))
    found = node_curves(robot, jk.Grid(rho1=(0.0, 4.0, 99), rho2=(0.0, 4.0, 99), rho3=(0.0, 4.0, 99)))
    # S = 0 carries two singular poses +-p everywhere: a surface of nodes, which is said and not traced.
    assert len(found.excess) == 1
    assert "f2 and f2" in found.excess[0]
    assert {curve.labels for curve in found} <= {("f1", "f1"), ("f1", "f2")}
    for curve in found:
        for k in (0, 1):
            # Where the poses almost meet the equations of the pair are nearly dependent.
            assert max(residuals(robot, curve.poses[2:-2, k], curve.joints[2:-2])) < 1e-9


def test_the_record_says_what_it_holds(wide):
    content = json.loads(wide.to_json())
    assert len(content["node_curves"]) == 6
    assert np.shape(content["node_curves"][0]["poses"])[1:] == (2, 3)
    assert str(wide).startswith("6 node curves over rho1, rho2, rho3 (0 closed)")
    assert wide["node curve 1"] is wide[0]


def test_what_is_no_box():
    with pytest.raises(InputError, match=r"jk\.node_curves: FiveBar has 2 joint axes"):
        node_curves(five_bar.create(9.0, (8.0, 8.0), (5.0, 5.0)), jk.Grid(theta1=(-3, 3, 9), theta2=(-3, 3, 9)))
