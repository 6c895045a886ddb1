"""Light on surfaces in three dimensions."""

import numpy as np

#: Where the light comes from, in the coordinates of the drawn box.
_LIGHT = np.array([0.3, -0.75, 0.6])
#: Share of colour that needs no light, and of white that full light adds.
_AMBIENT, _GLOSS = 0.62, 0.14


def shaded(colour: np.ndarray, triangles: np.ndarray, light: np.ndarray = _LIGHT) -> np.ndarray:
    """Returns a colour for every triangle, darker where its plane turns away from the light, the same on both sides.

    Args:
        colour: ``(3,)`` red, green and blue.
        triangles: ``(n, 3, 3)`` corners.
        light: ``(3,)`` direction from which it comes.
    """
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normal, axis=1)
    facing = np.abs(normal @ light) / np.where(length > 0, length, 1.0) / np.linalg.norm(light)
    facing = facing[:, None]
    return np.clip((_AMBIENT + (1 - _AMBIENT) * facing) * colour * (1 - _GLOSS * facing) + _GLOSS * facing, 0.0, 1.0)
