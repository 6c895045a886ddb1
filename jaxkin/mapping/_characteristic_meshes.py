"""Lifts of singular surfaces: the other assembly modes over their vertices' joints, as triangles of their own."""

from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from jaxkin.core.branches import stack_lanes
from jaxkin.core.mechanism import Mechanism
from jaxkin.kinematics.legs import Legs, leg_discriminants, leg_joints
from jaxkin.kinematics.solve import inside_limits, inverse_lanes
from jaxkin.mapping import _isosurface
from jaxkin.mapping._characteristic_records import CharacteristicSurface, sign_text
from jaxkin.mapping._lifts import SINGULAR, linked, measured, modes_over, same_working_mode, units_of
from jaxkin.mapping.batch import in_blocks
from jaxkin.mapping.meshes import SingularSurfaces, Surface
from jaxkin.numerics.gluing import short_way

#: So far, in units, a fixed coordinate of the box may be missed.
_SLICE = 1e-9


def lifted_meshes(
    robot: Mechanism, legs: Legs | None, singular: SingularSurfaces
) -> tuple[tuple[CharacteristicSurface, ...], dict[str, Any]]:
    """Lifts every singular surface; returns the meshes and what was counted on the way."""
    found, several = list[CharacteristicSurface](), legs is not None and len(legs.modes) > 1
    counts = {"triangles lifted": 0, "triangles dropped where a mode becomes singular": 0}
    away = 0
    for number, surface in enumerate(singular):
        for joints, valid in _working_modes(robot, legs, surface.vertices):
            mesh = _Lifted(robot, legs, surface, joints, valid)
            own = mesh.in_slice(singular.request["box"], singular.pose_names)
            away += int(np.sum(~own))
            counts["triangles lifted"] += len(mesh.faces)
            counts["triangles dropped where a mode becomes singular"] += mesh.dropped
            for sign, working in mesh.labels(own):
                name = f"{sign_text(sign, working, several)}, over {surface.name}"
                found.append(mesh.surface(name, number, sign, working, own))
    if len(singular.pose_names) > 3:
        counts["lifted triangles outside the fixed coordinates"] = away
    return tuple(found), counts


def _working_modes(robot: Mechanism, legs: Legs | None, poses: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns the joints of poses and where they are valid, once for every working mode."""
    if len(poses) == 0:
        return []
    if legs is not None:
        modes = [partial(_leg_mode, robot, legs, jnp.asarray(signs, float)) for signs in legs.modes]
        return [in_blocks(mode, poses) for mode in modes]
    values, valid = in_blocks(partial(_inverse, robot), poses)
    return [(values[:, lane], valid[:, lane]) for lane in range(values.shape[1])]


@partial(jax.jit, static_argnums=1)
def _leg_mode(robot: Mechanism, legs: Legs, signs: Array, poses: Array) -> tuple[Array, Array]:
    def one(pose: Array) -> tuple[Array, Array]:
        joints = leg_joints(robot, legs, signs, pose)
        reached = jnp.all(leg_discriminants(robot, legs, pose) > 0)
        return joints, reached & inside_limits(robot, tuple(joints))

    return jax.vmap(one)(poses)


@jax.jit
def _inverse(robot: Mechanism, poses: Array) -> tuple[Array, Array]:
    branches = stack_lanes(inverse_lanes(robot, tuple(poses[:, k] for k in range(poses.shape[1]))))
    return branches.values, branches.valid


class _Lifted:
    """One singular surface in one working mode, lifted.

    Attributes:
        modes: The modes over its vertices.
        faces: ``(m, 3)`` lifted triangles, by vertex * lanes + lane.
        dropped: How many there might be more.
    """

    def __init__(self, robot: Mechanism, legs: Legs | None, surface: Surface, joints: np.ndarray, valid: np.ndarray):
        self.robot = robot
        valid = valid & np.all(np.isfinite(joints), axis=1)
        safe = np.where(valid[:, None], joints, 1.0)
        _, _, size, working, _ = measured(robot, legs, surface.vertices, safe)
        # A surface of one working mode need not be singular in another.
        valid &= size <= SINGULAR
        modes = modes_over(robot, legs, safe).without(surface.vertices, robot)
        own = valid[:, None] & np.all(modes.working == working[:, None], axis=-1)
        modes = replace(modes, regular=modes.regular & own)
        self.modes, self.lanes = modes, modes.regular.shape[1]
        self.faces, self.dropped = self._faces(surface.faces)

    def _faces(self, faces: np.ndarray) -> tuple[np.ndarray, int]:
        """Returns the triangles all of whose edges carry a mode round to itself."""
        if not self.modes.regular.any():
            return np.zeros((0, 3), int), 0
        edges, inverse = np.unique(_isosurface.all_edges(faces), axis=0, return_inverse=True)
        links = same_working_mode(self.modes, edges, linked(self.robot, self.modes, edges))
        sides = inverse.reshape(3, -1).T
        # all_edges sorts the ends of an edge: vertices in ascending order make all three run forwards.
        ordered, parity = np.sort(faces, axis=1), _odd(faces)
        numbers = {side: _edge_numbers(edges, sides, ordered[:, list(side)]) for side in ((0, 1), (1, 2), (0, 2))}
        lane = np.broadcast_to(np.arange(self.lanes), (len(faces), self.lanes))
        second, third = links[numbers[0, 1]], links[numbers[0, 2]]
        round_ = np.take_along_axis(links[numbers[1, 2]], np.maximum(second, 0), axis=1)
        good = (second >= 0) & (third >= 0) & (round_ == third)
        lanes = np.stack([lane, second, third], axis=-1)
        lifted = ordered[:, None, :] * self.lanes + lanes
        lifted = np.where(parity[:, None, None], lifted[..., [0, 2, 1]], lifted)
        most = np.max(np.sum(self.modes.regular[faces], axis=-1), axis=1)
        return lifted[good], int(np.sum(most - good.sum(axis=1)))

    def in_slice(self, box: dict[str, Any], names: tuple[str, ...]) -> np.ndarray:
        """Returns which lifted triangles have the box's fixed coordinates."""
        fixed = [(k, box[name]) for k, name in enumerate(names) if not isinstance(box[name], list)]
        poses = self._poses(self.faces)
        unit, good = units_of(self.robot), np.ones(len(self.faces), bool)
        for k, value in fixed:
            good &= np.all(np.abs(poses[..., k] - value) <= _SLICE * unit[k], axis=1)
        return good

    def _poses(self, nodes: np.ndarray) -> np.ndarray:
        return self.modes.poses[np.divmod(nodes, self.lanes)]

    def labels(self, own: np.ndarray) -> list[tuple[int, tuple[int, ...]]]:
        """Returns the distinct signs and working modes of the lifted triangles."""
        at = np.divmod(self.faces[own][:, 0], self.lanes)
        pairs = {(int(s), tuple(map(int, w))) for s, w in zip(self.modes.sign[at], self.modes.working[at], strict=True)}
        return sorted(pairs, reverse=True)

    def surface(
        self, name: str, source: int, sign: int, working: tuple[int, ...], own: np.ndarray
    ) -> CharacteristicSurface:
        """Returns the lifted triangles of one label as a mesh."""
        at = np.divmod(self.faces[:, 0], self.lanes)
        same = own & (self.modes.sign[at] == sign) & np.all(self.modes.working[at] == working, axis=-1)
        nodes, faces = np.unique(self.faces[same], return_inverse=True)
        vertex, lane = np.divmod(nodes, self.lanes)
        poses, faces, origin = _opened(self.robot, self.modes.poses[vertex, lane], faces.reshape(-1, 3))
        return CharacteristicSurface(
            name=name,
            vertices=poses,
            faces=faces,
            joints=self.modes.joints[vertex][origin],
            sign=sign,
            working_mode=working,
            source=source,
            residual=float(np.max(self.modes.residual[vertex, lane], initial=0.0)),
            boundary=_isosurface.single_edges(faces),
        )


def _odd(faces: np.ndarray) -> np.ndarray:
    """True where sorting a triangle's vertices turns it over."""
    order = np.argsort(faces, axis=1)
    return np.array([1, -1])[((order[:, 1] - order[:, 0]) % 3 != 1).astype(int)] < 0


def _edge_numbers(edges: np.ndarray, sides: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Returns which of each triangle's sides, ``(m, 3)`` edge numbers, has the given ends ``(m, 2)``."""
    same = np.all(edges[sides] == pairs[:, None], axis=-1)
    return sides[np.arange(len(sides)), np.argmax(same, axis=1)]


def _opened(robot: Mechanism, poses: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Puts triangles that lie over the glued end of an angle at both ends, with vertices of their own.

    Returns:
        Poses, triangles, and the vertex from which each pose was copied.
    """
    origin = np.arange(len(poses))
    for k, axis in enumerate(robot.pose_axes):
        if axis.period is None or len(faces) == 0:
            continue
        angle = poses[:, k][faces]
        over = np.ptp(angle, axis=1) > 0.5 * axis.period
        if not over.any():
            continue
        parts, whole = [faces[~over]], (poses, origin)
        for end in (np.min, np.max):
            near = end(angle[over], axis=1, keepdims=True)
            moved = near + short_way(angle[over] - near, np.array(axis.period))
            old = faces[over].reshape(-1)
            copies = poses[old].copy()
            copies[:, k] = moved.reshape(-1)
            parts.append(len(whole[0]) + np.arange(len(old)).reshape(-1, 3))
            whole = np.concatenate([whole[0], copies]), np.concatenate([whole[1], origin[old]])
        faces, (poses, origin) = np.concatenate(parts), whole
    kept, faces = np.unique(faces, return_inverse=True)
    return poses[kept], faces.reshape(-1, 3), origin[kept]
