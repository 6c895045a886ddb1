"""Tracks that a referee found to end without saying where."""

import numpy as np

import jaxkin as jk
from jaxkin.mechanisms import rpr3


def test_a_fold_is_named_where_a_short_leg_makes_safe_steps_short():
    # Safe steps are 7e-4 of the rest of the way here; the second singular value is 0.56: the fold is a simple one.
    robot = rpr3.general(
        1.7825089570555213, 1.9033976822043486, 0.9113434032822891, 0.8360070995802167, 1.2804427664859495, 0.66645567
    )
    path = np.array([[0.11340035834, 2.5117832879, 3.2761109336], [0.05146497815, 2.5569113685, 3.3403562839]])
    poses = np.asarray(jk.forward(robot, path[0]).values)
    start = poses[np.nanargmin(np.abs(poses[:, 2] - 2.6665))]
    track = jk.track(robot, path, start)
    assert track.fold is not None
    assert abs(track.fold - 0.5805) < 1e-3
    assert track.verified
    assert track.singular_value < 1e-9
