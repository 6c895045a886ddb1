"""Wrist angles and link distances of the TLPM."""


def margins(robot, pose):
    """Returns the margins."""
    del robot, pose
    return {}
