"""Fields of the spatial robots: frames, the limit that binds, labels of assembly modes; and limits by name."""

import json

import jax
import numpy as np
import pytest

import jaxkin as jk
from jaxkin.core.provenance import identity
from jaxkin.mechanisms import ppps3, tlpm

JOINTS = jk.Grid(rho1y=0.1, rho1z=0.2, rho2y=0.5, rho2z=(-0.9, 1.1, 7), rho3y=(-1.2, 0.4, 5), rho3z=(-0.8, 1.0, 6))


def test_frames_are_the_branches_as_matrices():
    robot = ppps3.create(mirrored=True)
    frames, poses = jk.sweep(robot, "forward_frames", JOINTS), jk.sweep(robot, "forward_branches", JOINTS)
    assert frames.branch.values.tolist() == poses.branch.values.tolist() == list(robot.forward_labels)
    assert np.array_equal(frames.forward_frames_status, poses.forward_branches_status)
    assert np.array_equal(frames.forward_frames_multiplicity, poses.forward_branches_multiplicity)
    here = frames.forward_frames_multiplicity.values > 0
    assert 0 < here.sum() < here.size
    entries = np.moveaxis(frames.forward_frames.values, 1, -1)[here]
    found = np.moveaxis(poses.forward_branches.values, 1, -1)[here]
    position, rotation = jax.vmap(ppps3.position_and_rotation)(found)
    assert np.max(np.abs(entries[:, :3] - position)) < 1e-12
    assert np.max(np.abs(entries[:, 3:] - rotation.reshape(-1, 9))) < 1e-12


def test_frames_are_refused_where_there_are_none():
    with pytest.raises(jk.InputError, match=r"frame_kernel.*forward_branches"):
        jk.sweep(tlpm.create(), "forward_frames", jk.Grid(l1=(0.0, 1.0, 2), l2=0.0, l3=0.0))
    with pytest.raises(jk.InputError, match="frame_kernel"):
        jk.forward_frames(tlpm.create(), [0.0, 0.0, 0.0])


def test_the_binding_limit_is_the_smallest_margin():
    robot = tlpm.create(orientation=(1.0, 0.1, 0.2, 0.3), elbows=(1, -1, 1))
    grid = jk.Grid(x=(-300.0, 300.0, 4), y=(-300.0, 300.0, 5), z=(-100.0, 200.0, 3))
    binding, margins = jk.sweep(robot, "binding_limit", grid), jk.sweep(robot, "limit_margins", grid)
    names = margins.limit.values.tolist()
    assert binding.binding_limit.attrs["flag_meanings"].split() == names
    scale = np.array([1.0 if name.startswith("theta") else float(robot.characteristic_length()) for name in names])
    scaled = margins.limit_margins.values / scale[:, None, None, None]
    assert np.array_equal(binding.binding_limit.values, np.argmin(scaled, axis=0))
    assert binding.binding_limit_margin.values == pytest.approx(np.min(scaled, axis=0), abs=1e-12)


def test_without_limits_nothing_binds():
    grid = jk.Grid(x=0.0, y=0.0, z=0.0, phi=(-1.0, 1.0, 3), theta=0.1, sigma=0.2)
    found = jk.sweep(ppps3.create(), "binding_limit", grid)
    assert np.all(found.binding_limit == -1)
    assert np.all(np.isinf(found.binding_limit_margin))


def test_limits_by_name():
    robot = ppps3.create().with_limits(rho1x=(-1.0, 2.0), rho3z=(-0.5, 0.5))
    assert float(robot.passive_limits.low[0]) == -1.0
    assert float(robot.limits.high[5]) == 0.5
    assert np.isinf(float(robot.limits.high[4]))
    assert int(jk.forward(robot, [0.0, 0.0, 0.8, 0.0, -0.8, 0.6]).count) == 0
    machine = tlpm.create().with_limits(theta1=(0.5, 3.0), l2=(-10.0, 10.0))
    assert machine.wrist_limits.low.tolist() == pytest.approx([0.5, np.pi / 6])
    assert machine.limits.high.tolist() == [200.0, 10.0, 200.0]
    with pytest.raises(jk.InputError, match=r"no limits of rho9.*rho1y"):
        robot.with_limits(rho9=(0.0, 1.0))
    with pytest.raises(jk.InputError, match="exchange"):
        robot.with_limits(rho1x=(1.0, -1.0))


def test_static_fields_are_part_of_a_robots_identity():
    assert identity(ppps3.create()) != identity(ppps3.create(mirrored=True))
    assert identity(tlpm.create()) != identity(tlpm.create(elbows=(1, 1, -1)))
    assert json.loads(json.dumps(identity(tlpm.create())["geometry"]["elbows"])) == [1, 1, 1]
