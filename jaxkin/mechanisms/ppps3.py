"""The 3-PPPS with U-shaped base: three legs of three prismatic joints each, six of them actuated.

Pose ``(x, y, z, phi, theta, sigma)``: position P of the platform's point C1, and R = Rx(phi) Ry(theta) Rz(sigma).
Joints ``(rho1y, rho1z, rho2y, rho2z, rho3y, rho3z)``; rho1x, rho2x and rho3x are passive (``passive_joints``). The
platform is an equilateral triangle of side s with V1 = (0, 0, 0), V2 = s (-sqrt3/2, -1/2, 0), V3 = s (-sqrt3/2, 1/2,
0); its corners are W_i = P + R V_i and, in the legs' coordinates, C1 = (rho1x, rho1y, rho1z), C2 = (-rho2y, rho2x,
rho2z), C3 = (rho3y, -rho3x, rho3z).

References:
    Chablat, D., Baron, L., Jha, R. and Rolland, L., "The 3-PPPS parallel robot with U-shape base, a 6-DOF parallel
    robot with simple kinematics", Advances in Robot Kinematics, 2018, hal-01782286. Eqs. (1)-(3), (5)-(11), (13),
    (20)-(24) are correct as printed. Wrong in print: (4) exchanges V2 and V3 (all of (8)-(11) and (16)-(24) need them
    as above; as printed it is the mirrored robot, ``create(mirrored=True)``); (12), (14) and (15) have signs wrong, see
    ``reduced_joints``; for (25)-(28) see ``jaxkin.mechanisms._ppps3_forward``; (29) has a factor cos(theta) of the
    Euler angles, not of the robot, see ``PPPS3.factors``.
"""

import dataclasses
import math
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.bodies import Body
from jaxkin.core.branches import Lane
from jaxkin.core.errors import GeometryError, InputError, Status
from jaxkin.core.mechanism import Axis, Count, Limits, Mechanism, angle, as_reals, concrete_reals, mechanism
from jaxkin.core.tracing import is_traced
from jaxkin.mechanisms import _ppps3_bodies, _ppps3_forward
from jaxkin.mechanisms._geometry import batch_limits, checked_kind, checked_numbers, leaves
from jaxkin.mechanisms._spatial_poses import (
    checked_pose_vector,
    pose_from_quaternion,
    pose_from_rotation,
    position_and_quaternion,
    position_and_rotation,
)
from jaxkin.numerics import rotations
from jaxkin.numerics.fusion import materialise
from jaxkin.numerics.small_linalg import Matrix3
from jaxkin.numerics.trigonometry import cos_sin

_SQRT3 = math.sqrt(3.0)
PASSIVE = ("rho1x", "rho2x", "rho3x")
_ACTUATED = ("rho1y", "rho1z", "rho2y", "rho2z", "rho3y", "rho3z")
#: Squares of larger joints could overflow, as in ``jk.forward``.
_LARGEST = 1e60


@mechanism
class PPPS3(Mechanism):
    """The 3-PPPS with U-shaped base; use ``create`` to build one.

    Attributes:
        side: Side s of the platform (1 in the paper).
        base_radius: Distance of A1, A2, A3 from the origin (2 in the paper): where the legs stand. It enters no
            equation.
        limits: Limits of the six actuated joints.
        passive_limits: Limits of the three passive joints; they count in ``margins``.
        mirrored: True for V2 and V3 as Eq. (4) of the paper prints them: the robot mirrored in the plane y = 0, whose
            poses are (x, y, z, -phi, theta, -sigma) at the same joints.
    """

    id: ClassVar[str] = "ppps3"
    pose_axes = (
        Axis("x", "length"),
        Axis("y", "length"),
        Axis("z", "length"),
        angle("phi"),
        Axis("theta", "rad", -math.pi / 2, math.pi / 2),
        angle("sigma"),
    )
    joint_axes = tuple(Axis(name, "length") for name in _ACTUATED)
    max_branches = 4
    forward_block: ClassVar[int] = 1 << 13
    covered: ClassVar[tuple[str, ...]] = ("theta",)
    forward_labels: ClassVar[tuple[str, ...]] = tuple(
        f"R22 {'>' if s22 > 0 else '<'} 0, R33 {'>' if s33 > 0 else '<'} 0" for s22, s33 in _ppps3_forward.SIGNS
    )

    side: Array
    base_radius: Array
    limits: Limits
    passive_limits: Limits
    mirrored: bool = dataclasses.field(default=False, metadata={"static": True})

    @property
    def mirror(self) -> float:
        """The sign of -y of V2: 1, or -1 for the mirrored robot."""
        return -1.0 if self.mirrored else 1.0

    def twin(self, pose: Any) -> Any:
        """Returns the pose with the other Euler triple of the same rotation, (phi + pi, pi - theta, sigma + pi)."""
        return np.array([0.0, 0.0, 0.0, math.pi, math.pi, math.pi]) + pose * np.array([1.0, 1.0, 1.0, 1.0, -1.0, 1.0])

    def characteristic_length(self) -> Array:
        """Returns the side of the platform."""
        return self.side

    def geometry_ok(self) -> Array:
        """True where the side and the base's radius are positive and finite."""
        return jnp.isfinite(self.side) & (self.side > 0) & jnp.isfinite(self.base_radius) & (self.base_radius > 0)

    def _halves(self, m: Matrix3) -> tuple[Array, Array, Array, Array]:
        """Returns s (sqrt3 R11 +- m R12) / 2 and s (sqrt3 R31 +- m R32) / 2: -x and -z of V2 and V3 turned."""
        long, short = self.side * (_SQRT3 / 2), self.side * (self.mirror / 2)
        (r11, r12, _), _, (r31, r32, _) = m
        return long * r11 + short * r12, long * r11 - short * r12, long * r31 + short * r32, long * r31 - short * r32

    def constraints(self, pose: Array, joints: Array) -> Array:
        """Returns Eqs. (6)-(11), ``(6,)``, lengths: the legs' coordinates of the corners, passive joints left out."""
        return self.closure(pose[:3], rotations.matrix_from_xyz(pose[3], pose[4], pose[5]), joints)

    def closure(self, position: Array, matrix: Matrix3, joints: Array) -> Array:
        """Returns the constraints of a position and a rotation matrix."""
        x, y, z = position[0], position[1], position[2]
        y1, z1, y2, z2, y3, z3 = (joints[k] for k in range(6))
        x2, x3, h2, h3 = self._halves(matrix)
        return jnp.stack(
            [y1 - y, z1 - z, 2 * (x2 - y2 - x), 2 * (h2 + z2 - z), 2 * (x3 + y3 - x), 2 * (h3 + z3 - z)],
        )

    def constraint_scales(self, pose: Array, joints: Array) -> Array:
        """Returns twice the side and the magnitudes of the lengths in each equation, ``(6,)``."""
        x, y, z = jnp.abs(pose[0]), jnp.abs(pose[1]), jnp.abs(pose[2])
        of_pose = jnp.stack([y, z, x, z, x, z])
        return 2 * (self.side + of_pose + jnp.abs(joints))

    def inverse_kernel(self, pose: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns the one set of joints (Eqs. (20)-(24)); it is never singular."""
        x, y, z, phi, theta, sigma = pose
        # Each of the four results would otherwise compute the sines again, and a grid each of them at every sample.
        turns = materialise(*(entry for angle in (phi, theta, sigma) for entry in cos_sin(angle)))
        x2, x3, h2, h3 = self._halves(rotations.xyz_product(*turns))
        values = (y, z, x2 - x, z - h2, x - x3, z - h3)
        shape = jnp.broadcast_shapes(*(jnp.shape(value) for value in values))
        return (
            Lane(
                values=values,
                status=jnp.full(shape, jnp.int8(Status.OK)),
                multiplicity=jnp.full(shape, jnp.int8(1)),
                residual=jnp.zeros(shape),
            ),
        )

    def jacobian_kernel(
        self, pose: tuple[Array, ...], joints: tuple[Array, ...]
    ) -> tuple[tuple[tuple[Any, ...], ...], tuple[float, ...]]:
        """Returns dF/dpose, numbers but for what the angles do, and the diagonal of dF/djoints, all numbers."""
        del joints
        cp, sp, ct, st, cs, ss = materialise(*(entry for angle in pose[3:] for entry in cos_sin(angle)))
        (r11, r12, _), _, (r31, r32, _) = rotations.xyz_product(cp, sp, ct, st, cs, ss)
        # d(R11, R12) and d(R31, R32) by phi, theta and sigma.
        top = ((0.0, 0.0), (-st * cs, st * ss), (r12, -r11))
        bottom = ((cp * ss + sp * st * cs, cp * cs - sp * st * ss), (-cp * ct * cs, cp * ct * ss), (r32, -r31))
        long, short = self.side * _SQRT3, self.side * self.mirror
        x2, x3 = ((0.0, *(long * one + sign * short * two for one, two in top[1:])) for sign in (1.0, -1.0))
        h2, h3 = (tuple(long * one + sign * short * two for one, two in bottom) for sign in (1.0, -1.0))
        rows = (
            (0.0, -1.0, 0.0, 0.0, 0.0, 0.0),
            (0.0, 0.0, -1.0, 0.0, 0.0, 0.0),
            (-2.0, 0.0, 0.0, *x2),
            (0.0, 0.0, -2.0, *h2),
            (-2.0, 0.0, 0.0, *x3),
            (0.0, 0.0, -2.0, *h3),
        )
        return rows, (1.0, 1.0, -2.0, 2.0, 2.0, 2.0)

    def forward_kernel(self, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns the four assembly modes by the signs of (R22, R33); see ``_ppps3_forward``."""
        return _ppps3_forward.lanes(self.side, self.mirror, joints)

    def count_kernel(self, joints: tuple[Array, ...]) -> Count:
        """Returns the number of assembly modes from the signs of a and b; see ``_ppps3_forward``."""
        return _ppps3_forward.count(self.side, self.mirror, joints)

    def frame_kernel(self, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns the assembly modes as ``(x, y, z, R11, R12, ..., R33)``, without trigonometric functions."""
        found = []
        for mode in _ppps3_forward.modes(self.side, self.mirror, joints):
            none = mode.x * 0
            values = (mode.x, joints[0] + none, joints[1] + none, *(entry for row in mode.matrix for entry in row))
            found.append(Lane(values, mode.status, mode.multiplicity, mode.residual))
        return tuple(found)

    def factors(self, pose: Array) -> dict[str, Array]:
        """Returns R22 and R33, which vanish at the singularities of the robot.

        det dF/dpose = -8 sqrt3 s^3 cos(theta) R22 R33 (mirrored or not) has a third factor, ``chart_factors``.

        References:
            Chablat et al. 2018, Eq. (29): cos(phi) cos(theta)^2 (sin(phi) sin(theta) sin(sigma) - cos(phi) cos(sigma))
            is -cos(theta) R22 R33. Its zero set is correct; one of the two cos(theta) is in R33 = cos(phi) cos(theta).
        """
        m = rotations.matrix_from_xyz(pose[3], pose[4], pose[5])
        return {"R22": m[1][1], "R33": m[2][2]}

    def chart_factors(self, pose: Array) -> dict[str, Array]:
        """Returns cos(theta), which vanishes where the Euler angles are singular (gimbal lock).

        It is no singularity of the robot, but there R33 = R23 = 0: gimbal lock is only met at poses that are singular
        already, and adds nothing to the zero set. On SO(3) it is two circles, no surface.
        """
        return {"cos(theta)": jnp.cos(pose[4])}

    def bodies(self, pose: ArrayLike) -> tuple[Body, ...]:
        """Returns what the robot looks like in one pose: base, legs, platform and their joints."""
        return _ppps3_bodies.bodies(self, checked_numbers("pose", pose, (6,), "one pose (x, y, z, phi, theta, sigma)"))

    def limit_fields(self) -> dict[str, tuple[str, ...]]:
        """Returns the fields of limits: actuated joints and passive ones."""
        return {**super().limit_fields(), "passive_limits": PASSIVE}

    def margins(self, pose: Array, joints: Array) -> dict[str, Array]:
        """Returns the distances to the limits of all nine prismatic joints; negative is a violation."""
        margins = super().margins(pose, joints)
        passive = _passive(self, tuple(pose[..., k] for k in range(6)))
        for k, (name, value) in enumerate(zip(PASSIVE, passive, strict=True)):
            margins[f"{name}_low"] = value - self.passive_limits.low[k]
            margins[f"{name}_high"] = self.passive_limits.high[k] - value
        return margins


def create(
    side: ArrayLike = 1.0,
    base_radius: ArrayLike = 2.0,
    *,
    mirrored: bool = False,
    limits: Limits | None = None,
    passive_limits: Limits | None = None,
) -> PPPS3:
    """Returns a 3-PPPS with U-shaped base.

    Args:
        side: Side of the platform, positive; 1 in the paper.
        base_radius: Distance of the legs' origins A1, A2, A3 from O; 2 in the paper. For drawings only.
        mirrored: True for the platform as Eq. (4) of the paper prints it.
        limits: Limits of the six actuated joints, in the order of ``joint_axes``; none by default.
        passive_limits: Limits of rho1x, rho2x, rho3x, measured from O as in Eq. (3); none by default.

    Raises:
        GeometryError: A value is no finite number, a size is not positive, limits are the wrong way round, or
            ``mirrored`` is neither True nor False (nor 1 nor 0).

    Arrays of one shape make a batch of robots for ``jax.vmap``. Traceable: under ``jit``, ``vmap`` and
    ``grad`` nothing is checked, and a bad geometry shows as the status INVALID_GEOMETRY.
    """
    values = leaves(side=side, base_radius=base_radius)
    robot = PPPS3(
        **values,
        limits=batch_limits("limits", Limits.none(6) if limits is None else limits, 6, values["side"], _ACTUATED),
        passive_limits=batch_limits(
            "passive_limits", Limits.none(3) if passive_limits is None else passive_limits, 3, values["side"], PASSIVE
        ),
        mirrored=_checked_mirrored(mirrored),
    )
    if not any(map(is_traced, values.values())) and not np.all(robot.geometry_ok()):
        name, value = ("base_radius", base_radius) if np.all(values["side"] > 0) else ("side", side)
        raise GeometryError(f"{name} is {value}: it must be positive; give the length.")
    return robot


def _checked_mirrored(mirrored: bool) -> bool:
    number = concrete_reals(mirrored)
    if number is None or number.shape != () or float(number) not in (0.0, 1.0):
        raise GeometryError(f"mirrored is {mirrored!r}: it must be True or False (or 1 or 0), and not traced.")
    return bool(number)


def _checked_robot(who: str, robot: PPPS3) -> None:
    checked_kind(f"jk.mechanisms.ppps3.{who}", robot, PPPS3, "3-PPPS, made with jk.mechanisms.ppps3.create()")


def _passive(robot: PPPS3, pose: tuple[Array, ...]) -> tuple[Array, Array, Array]:
    x, y, _, phi, theta, sigma = pose
    _, (r21, r22, _), _ = rotations.matrix_from_xyz(phi, theta, sigma)
    long, short = robot.side * (_SQRT3 / 2) * r21, robot.side * (robot.mirror / 2) * r22
    return x, y - long - short, long - short - y


def passive_joints(robot: PPPS3, pose: ArrayLike) -> Array:
    """Returns rho1x, rho2x, rho3x at a pose, ``(3,)``, lengths from O.

    rho1x = x, rho2x = y of W2, rho3x = -y of W3 [our completion: the paper leaves them out].
    """
    _checked_robot("passive_joints", robot)
    return _passive_joints(robot, checked_pose_vector("pose", pose))


@jax.jit
def _passive_joints(robot: PPPS3, pose: Array) -> Array:
    return jnp.stack(_passive(robot, tuple(pose[k] for k in range(6))))


class Reduced(NamedTuple):
    """The paper's change of variables, which leaves the orientation as it is.

    Attributes:
        joints: ``(3,)`` (mu2z, mu3y, mu3z); the other three are zero.
        passive: ``(3,)`` (mu1x, mu2x, mu3x).
        position: ``(3,)`` (x', y', z').
    """

    joints: Array
    passive: Array
    position: Array


def reduced_joints(joints: ArrayLike) -> Array:
    """Returns (mu2z, mu3y, mu3z), ``(3,)``, which alone decide the orientation and the number of assembly modes.

    mu2z = rho2z - rho1z, mu3y = rho3y + rho2y, mu3z = rho3z - rho1z.

    References:
        Chablat et al. 2018, Eqs. (13)-(14); printed mu3y = rho3y - rho2y has the sign of an older convention.
    """
    q = as_reals(joints)
    if q is None:
        raise InputError(f"The joints are {joints!r}: they must be real numbers of shape (6,), or (..., 6).")
    if q.shape[-1:] != (6,):
        raise InputError(f"The joints have shape {q.shape}: they must be (6,), or (..., 6).")
    return jnp.stack([q[..., 3] - q[..., 1], q[..., 4] + q[..., 2], q[..., 5] - q[..., 1]], axis=-1)


def reduced(robot: PPPS3, pose: ArrayLike, joints: ArrayLike) -> Reduced:
    """Returns the change of variables of a configuration, all of it.

    mu1x = rho1x + rho2y, mu2x = rho2x - rho1y, mu3x = rho3x + rho1y; x' = x + rho2y, y' = y - rho1y, z' = z - rho1z.

    References:
        Chablat et al. 2018, Eqs. (12)-(15). Printed with other signs: mu1x = rho1x - rho2y, mu3x = rho3x + rho2y,
        x' = x - rho2y. They assume C2x = +rho2y, which is -rho2y in (3), (8) and (21).
    """
    _checked_robot("reduced", robot)
    pose, q = checked_pose_vector("pose", pose), checked_pose_vector("joints", joints)
    p1, p2, p3 = passive_joints(robot, pose)
    y1, z1, y2 = q[0], q[1], q[2]
    return Reduced(
        reduced_joints(q),
        jnp.stack([p1 + y2, p2 - y1, p3 + y1]),
        jnp.stack([pose[0] + y2, pose[1] - y1, pose[2] - z1]),
    )


def twist_jacobian(robot: PPPS3, pose: ArrayLike) -> Array:
    """Returns J with d(joints)/dt = J (v, omega), ``(6, 6)``: v the velocity of C1, omega the spatial angular velocity.

    A polynomial of the rotation's entries: there is no serial singularity. det J = (sqrt3 / 2) s^3 R22 R33 is free of
    the Euler angles' own singularity; its rows are lengths per radian on the right half [our completion].
    """
    _checked_robot("twist_jacobian", robot)
    return _twist_jacobian(robot, checked_pose_vector("pose", pose))


@jax.jit
def _twist_jacobian(robot: PPPS3, pose: Array) -> Array:
    _, matrix = position_and_rotation(pose)
    long, short = robot.side * (_SQRT3 / 2), robot.side * (robot.mirror / 2)
    rows = []
    for axis, sign, corner in ((1, 1.0, 0), (2, 1.0, 0), (0, -1.0, 2), (2, 1.0, 2), (0, 1.0, 3), (2, 1.0, 3)):
        own = {0: (0.0, 0.0, 0.0), 2: (-long, -short, 0.0), 3: (-long, short, 0.0)}[corner]
        turned = matrix @ jnp.stack([jnp.asarray(entry, float) for entry in own])
        unit = jnp.eye(3)[axis]
        # d W / dt = v + omega x (R V), and e . (omega x r) = omega . (r x e).
        rows.append(sign * jnp.concatenate([unit, jnp.cross(turned, unit)]))
    return jnp.stack(rows)


def self_motion(robot: PPPS3, joints: ArrayLike, turn: ArrayLike) -> Array:
    """Returns the pose ``(6,)`` of a self-motion at the angle ``turn``, rad.

    At R32 = +-1, that is (mu2z, mu3y, mu3z) = s (-+1/2, 0, +-1/2) (mirrored: the opposite), the platform is vertical
    and turns freely about the fixed z axis at locked joints, its corners sliding as in an elliptic trammel: R =
    Rz(turn) Rx(+-pi/2), x + rho2y = s (sqrt3 / 2) cos(turn) [our completion]. Every pose of it is singular.

    Raises:
        InputError: The joints have no self-motion (not checked under tracing).
    """
    _checked_robot("self_motion", robot)
    q, given = checked_pose_vector("joints", joints), as_reals(turn)
    if given is None:
        raise InputError(f"The turn is {turn!r}: it must be one angle, a number in rad.")
    turn = given
    if turn.shape != ():
        raise InputError(f"The turn has shape {turn.shape}: it must be one angle; for many use jax.vmap.")
    found = _ppps3_forward.known(robot.side, robot.mirror, tuple(q[k] for k in range(6)))
    if not is_traced(found.self_motion) and not bool(found.self_motion):
        mu = [float(value) for value in reduced_joints(q) / robot.side]
        raise InputError(
            f"(mu2z, mu3y, mu3z) = ({mu[0]:.6g}, {mu[1]:.6g}, {mu[2]:.6g}) sides has no self-motion: it must be "
            "(-1/2, 0, 1/2) or (1/2, 0, -1/2)."
        )
    up = jnp.where(found.r32 > 0, 1.0, -1.0)
    matrix = rotations.matrix_from_zxy(turn, up * (math.pi / 2), jnp.zeros_like(turn))
    x = robot.side * (_SQRT3 / 2) * jnp.cos(turn) - q[2]
    return jnp.stack([x, q[0], q[1], *rotations.xyz_from_matrix(matrix)])


__all__ = [
    "PPPS3",
    "Reduced",
    "create",
    "passive_joints",
    "pose_from_quaternion",
    "pose_from_rotation",
    "position_and_quaternion",
    "position_and_rotation",
    "reduced",
    "reduced_joints",
    "self_motion",
    "twist_jacobian",
]
