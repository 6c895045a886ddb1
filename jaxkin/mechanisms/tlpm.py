"""The TLPM of Fu and Gao: three limbs of actuated length carry a point, three active wrists turn the platform.

Pose ``(x, y, z)``: position of the point p in which the limbs' axes meet, from its place in the initial configuration;
joints ``(l1, l2, l3)``: strokes, so that limb i is L_i0 + l_i long. The universal joints of the limbs are at
q_i = (L cos eta_i, L sin eta_i, -h). All lengths in mm. Position depends on the strokes alone; the platform's
orientation is the wrists' business, and an input here (``TLPM.orientation``). It matters for the wrist angles and for
link interference.

References:
    Fu, J. and Gao, F., "Kinematic performances of a novel TLPM parallel robot". Eqs. (1)-(3), (5), (6), (13)-(15) are
    correct as printed, with eta = 0, 120, -120 degrees and one common L_0 = sqrt(L^2 + h^2) in (3)-(6). Wrong in print:
    (4) has l2 for l3 in its second term and a spurious L_0 in its third; (7)-(9) need a sign and have velocities and
    rates exchanged, see ``stroke_jacobian``; the limit of det at p = q_i, see ``TLPM.factors``; (16)-(23) and the limit
    of the distances, see ``jaxkin.mechanisms._tlpm_wrist``.
    What the paper gives is the position of p, the strokes, the singular plane, and angles and distances as conditions.
    Everything that depends on the platform's orientation is our completion, and marked [ours]; no link size, no stroke
    limit and no L is printed, so those defaults are ours as well (h = 590 follows from Table 1).
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, ClassVar, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.bodies import Body
from jaxkin.core.branches import Lane
from jaxkin.core.errors import GeometryError, Status
from jaxkin.core.mechanism import Axis, Count, Limits, Mechanism, as_reals, mechanism, plain
from jaxkin.core.precision import TOLERANCES
from jaxkin.core.tracing import is_traced
from jaxkin.mechanisms import _tlpm_bodies, _tlpm_wrist
from jaxkin.mechanisms._geometry import batch_limits, checked_numbers, leaves, vector_leaf
from jaxkin.mechanisms._tlpm_wrist import (
    CLEARANCE_NAMES,
    ELBOW_MODES,
    LINK_NAMES,
    ElbowModes,
    WristAngles,
    elbow_modes,
    link_clearances,
    links,
    wrist_angles,
)
from jaxkin.numerics.fusion import materialise, waist
from jaxkin.numerics.spheres import Shells

Numbers: TypeAlias = ArrayLike | Sequence[Any]

#: eta_i of the paper, order fixed by its Eqs. (3) and (4).
LIMB_ANGLES = (0.0, 2 * math.pi / 3, -2 * math.pi / 3)
#: Intervals of theta_i1 and theta_i2 (text after Eq. (23)).
WRIST_LIMITS = ((math.pi / 10, math.pi), (math.pi / 6, math.pi))


@mechanism
class TLPM(Mechanism):
    """The TLPM; use ``create`` to build one.

    Attributes:
        base_radius: L, mm.
        height: h, mm: the base plane is z = -h.
        limb_angles: ``(3,)`` eta_i1, rad.
        initial_lengths: ``(3,)`` L_i0, mm.
        limits: Strokes, mm.
        a: Side of the links' square cross-section, mm.
        b: Distance from p at which link 2 begins on the limb's axis, mm [ours].
        r1: Distance from p to the joint of links 2 and 3, on the R1 axis, mm [ours].
        r2: Distance from p to the end of link 3, on the R2 axis, mm [ours].
        beta2: Angle between the R2 axes and the platform's z axis, rad (45 degrees in Eq. (20)).
        platform_angles: ``(3,)`` eta_i2, rad: directions of the R2 axes on the platform.
        wrist_limits: Limits of theta_i1 and theta_i2, two values each, rad.
        orientation: ``(4,)`` quaternion (w, x, y, z) of the platform; any length but zero [ours].
        elbows: Sign of each limb's wrist, +1 or -1 [ours].
    """

    id: ClassVar[str] = "tlpm"
    pose_axes = (Axis("x", "mm"), Axis("y", "mm"), Axis("z", "mm"))
    joint_axes = (Axis("l1", "mm"), Axis("l2", "mm"), Axis("l3", "mm"))
    max_branches = 2
    forward_block: ClassVar[int] = 1 << 15
    forward_labels: ClassVar[tuple[str, ...]] = ("upper, z > -h", "lower, z < -h")
    leaf_units: ClassVar[dict[str, str]] = {
        "limb_angles": "rad",
        "beta2": "rad",
        "platform_angles": "rad",
        "orientation": "1",
    }

    base_radius: Array
    height: Array
    limb_angles: Array
    initial_lengths: Array
    limits: Limits
    a: Array
    b: Array
    r1: Array
    r2: Array
    beta2: Array
    platform_angles: Array
    wrist_limits: Limits
    orientation: Array
    elbows: tuple[int, int, int] = dataclasses.field(default=(1, 1, 1), metadata={"static": True})

    def base_points(self) -> tuple[tuple[Array, Array], ...]:
        """Returns the horizontal coordinates of q1, q2, q3 (Eq. (1)); they lie in the plane z = -h."""
        cos, sin = jnp.cos(self.limb_angles), jnp.sin(self.limb_angles)
        return tuple((self.base_radius * cos[..., k], self.base_radius * sin[..., k]) for k in range(3))

    def _base_once(self) -> tuple[tuple[Array, Array], ...]:
        """Returns the points for kernels, of which every loop over samples would otherwise take sines and cosines."""
        kept = materialise(*(coordinate for point in self.base_points() for coordinate in point))
        return tuple(zip(kept[::2], kept[1::2], strict=True))

    def characteristic_length(self) -> Array:
        """Returns sqrt(L^2 + h^2), the length of a limb in the initial configuration."""
        return jnp.sqrt(self.base_radius**2 + self.height**2)

    def geometry_ok(self) -> Array:
        """True where q1, q2, q3 form a triangle and every size is positive and finite."""
        cos, sin = jnp.cos(self.limb_angles), jnp.sin(self.limb_angles)
        area = (cos[..., 1] - cos[..., 0]) * (sin[..., 2] - sin[..., 0]) - (sin[..., 1] - sin[..., 0]) * (
            cos[..., 2] - cos[..., 0]
        )
        ok = (jnp.abs(area) > TOLERANCES.geometry) & (self.base_radius > 0) & jnp.isfinite(self.height)
        for size in (self.base_radius, self.a, self.b, self.r1, self.r2):
            ok = ok & jnp.isfinite(size) & (size > 0)
        norm = jnp.sum(self.orientation**2, axis=-1)
        for vector in (self.initial_lengths, self.platform_angles):
            ok = ok & jnp.all(jnp.isfinite(vector), axis=-1)
        return ok & jnp.isfinite(norm) & (norm > 0) & jnp.isfinite(self.beta2)

    def lengths(self, joints: tuple[Array, ...]) -> tuple[Array, ...]:
        """Returns the limbs' lengths L_i0 + l_i."""
        return tuple(self.initial_lengths[k] + joints[k] for k in range(3))

    def _squares(self, pose: tuple[Array, ...], base: tuple[tuple[Array, Array], ...]) -> tuple[Array, ...]:
        x, y, z = pose
        w = z + self.height
        return tuple((x - qx) * (x - qx) + (y - qy) * (y - qy) + w * w for qx, qy in base)

    def constraints(self, pose: Array, joints: Array) -> Array:
        """Returns |p - q_i|^2 - (L_i0 + l_i)^2, ``(3,)``, mm^2 (Eq. (2) squared)."""
        lengths = self.initial_lengths + joints
        return jnp.stack(self._squares((pose[0], pose[1], pose[2]), self.base_points())) - lengths * lengths

    def constraint_scales(self, pose: Array, joints: Array) -> Array:
        """Returns (L_i0 + l_i)^2 + L^2 + h^2, ``(3,)``."""
        del pose
        return (self.initial_lengths + joints) ** 2 + self.characteristic_length() ** 2

    def inverse_kernel(self, pose: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns the strokes |p - q_i| - L_i0; a limb of zero length is a serial singularity."""
        squares = self._squares(pose, self._base_once())
        zero = TOLERANCES.inverse_singular * (self.characteristic_length() + sum(map(jnp.abs, pose)))
        singular = jnp.zeros(jnp.shape(squares[0]), bool)
        for square in squares:
            singular = singular | (square <= zero * zero)
        return (
            Lane(
                values=tuple(jnp.sqrt(square) - self.initial_lengths[k] for k, square in enumerate(squares)),
                status=jnp.where(singular, jnp.int8(Status.SINGULAR), jnp.int8(Status.OK)),
                multiplicity=jnp.where(singular, jnp.int8(2), jnp.int8(1)),
                residual=jnp.zeros(jnp.shape(squares[0])),
            ),
        )

    def jacobian_kernel(
        self, pose: tuple[Array, ...], joints: tuple[Array, ...]
    ) -> tuple[tuple[tuple[Array, ...], ...], tuple[Array, ...]]:
        """Returns dF/dp, rows 2 (p - q_i), and the diagonal of dF/dl, -2 (L_i0 + l_i)."""
        x, y, z = pose
        rows = tuple((2 * (x - qx), 2 * (y - qy), 2 * (z + self.height)) for qx, qy in self._base_once())
        return rows, tuple(-2 * length for length in self.lengths(joints))

    def _solved(self, joints: tuple[Array, ...]) -> tuple[Array, Array, Array, Array, Array]:
        """Returns x, y, (z + h)^2 (0 within its blur), where that is close to zero, and where all lengths are positive.

        The differences of the three spheres are linear in x and y; for eta = 0, +-120 degrees they are Eqs. (3) and
        (4), x = (s2 + s3 - 2 s1) / (6 L) and y = (s3 - s2) / (2 sqrt3 L) up to sign of the order, with s_i = (L_i0 +
        l_i)^2.
        """
        r1, x, y, inverse = self._foot(joints)
        _, r2, r3 = self.lengths(joints)
        x1, y1 = self._base_once()[0]
        far = jnp.sqrt((x - x1) * (x - x1) + (y - y1) * (y - y1))
        square = (r1 - far) * (r1 + far)
        blur = TOLERANCES.double_length**2 * (r1 * r1 + r2 * r2 + r3 * r3 + self.base_radius**2)
        near = jnp.abs(square)
        positive = (r1 > 0) & (r2 > 0) & (r3 > 0)
        # Where two limbs almost coincide x and y are known the worse, and with them the square.
        doubt = 10 * blur * jnp.maximum(1.0, self.base_radius**2 * jnp.abs(inverse))
        return x, y, jnp.where(near <= blur, 0.0, square), (near > blur) & (near <= doubt), positive

    def _foot(self, joints: tuple[Array, ...]) -> tuple[Array, Array, Array, Array]:
        """Returns the first limb's length, x, y, and the inverse of twice the area of the triangle of the q_i."""
        r1, r2, r3 = self.lengths(joints)
        (x1, y1), (x2, y2), (x3, y3) = self._base_once()
        # |q_i| = L for all i, so the constant terms cancel.
        g2, g3 = (r2 - r1) * (r2 + r1) / 2, (r3 - r1) * (r3 + r1) / 2
        ax, ay, bx, by = x1 - x2, y1 - y2, x1 - x3, y1 - y3
        inverse = 1 / (ax * by - ay * bx)
        return r1, (g2 * by - g3 * ay) * inverse, (ax * g3 - bx * g2) * inverse, inverse

    def forward_kernel(self, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns the upper mode z > -h and its mirror image in the base plane (Eqs. (3)-(6), corrected).

        On the plane z = -h they are one double pose, in the first lane. Squaring accepts lengths that are not positive:
        these have no pose, and the status OUTSIDE_LIMITS. (z + h)^2 carries a rounding of about 1e-16 of the lengths'
        squares, so that z is unresolved within 1e-8 of them from the plane; there the status is UNDECIDED or SINGULAR.
        """
        x, y, square, close, positive = self._solved(joints)
        root = jnp.sqrt(jnp.where(positive, square, jnp.nan))
        residual = self._residual((x, y, root), joints)
        plain = jnp.where(close, jnp.int8(Status.UNDECIDED), jnp.int8(Status.OK))
        empty = jnp.where(close, jnp.int8(Status.UNDECIDED), jnp.int8(Status.NO_REAL_SOLUTION))
        empty = jnp.where(positive, empty, jnp.int8(Status.OUTSIDE_LIMITS))
        lanes = []
        for sign in (1.0, -1.0):
            here = root >= 0 if sign > 0 else root > 0
            nowhere = jnp.where(here, 0.0, jnp.nan)
            number = jnp.where(here, jnp.where(root > 0, jnp.int8(1), jnp.int8(2)), jnp.int8(0))
            lanes.append(
                Lane(
                    values=(x + nowhere, y + nowhere, sign * root - self.height + nowhere),
                    status=jnp.where(here, jnp.where(number > 1, jnp.int8(Status.SINGULAR), plain), empty),
                    multiplicity=number,
                    residual=residual + nowhere,
                )
            )
        return tuple(lanes)

    def _residual(self, point: tuple[Array, ...], joints: tuple[Array, ...]) -> Array:
        x, y, w = point
        worst = jnp.zeros_like(x)
        size = self.base_radius**2 + self.height**2
        for (qx, qy), r in zip(self._base_once(), self.lengths(joints), strict=True):
            off = jnp.abs((x - qx) * (x - qx) + (y - qy) * (y - qy) + w * w - r * r)
            worst = jnp.maximum(worst, off / (r * r + size))
        return worst

    def count_kernel(self, joints: tuple[Array, ...]) -> Count:
        """Returns 2 poses above and below the base plane, 1 on it, or 0."""
        _, _, square, close, positive = self._solved(joints)
        number = jnp.where(square > 0, jnp.int8(2), jnp.where(square == 0, jnp.int8(1), jnp.int8(0)))
        return Count(jnp.where(positive, number, jnp.int8(0)), positive & (close | (square == 0)))

    def count_walls(self, joints: Array) -> Array:
        """Returns (z + h)^2, ``(1,)``, whose sign decides between two poses and none within the strokes."""
        r1, x, y, _ = self._foot((joints[0], joints[1], joints[2]))
        x1, y1 = self.base_points()[0]
        return (r1 * r1 - ((x - x1) * (x - x1) + (y - y1) * (y - y1)))[None]

    def factors(self, pose: Array) -> dict[str, Array]:
        """Returns z + h, mm: the robot is singular in the base plane and nowhere else.

        det dF/dp = 16 (z + h) A with the area A of the triangle q1 q2 q3, A = (3 sqrt3 / 4) L^2 for eta = 0, +-120
        degrees.

        References:
            Fu and Gao, Eq. (12), is correct for the printed rows (q_i - p) / |q_i - p|; the text after it says that the
            determinant tends to zero for p -> q_i. It does not: it tends to -(sqrt3 / 2) cos(gamma), gamma being the
            angle of approach to the z axis, and at p = q_i the row is undefined. That is a serial singularity (length
            zero).
        """
        return {"z + h": pose[2] + self.height}

    def clearances(self) -> tuple[str, ...]:
        """Returns the twelve pairs of links that are told apart."""
        return CLEARANCE_NAMES

    def margin_unit(self, name: str) -> str:
        """Returns rad for the wrist angles, mm for all others."""
        return "rad" if name.startswith("theta") else "mm"

    def bodies(self, pose: ArrayLike) -> tuple[Body, ...]:
        """Returns what the robot looks like in one pose: base, limbs, links of the wrists, and platform, mm."""
        return _tlpm_bodies.bodies(self, checked_numbers("pose", pose, (3,), "x, y and z of p in mm"))

    def reach_spheres(self) -> tuple[Shells, Array]:
        """Returns the spheres about q_i between which the strokes hold p, and the z of the plane of the q_i."""
        centres = jnp.stack([jnp.stack(point, axis=-1) for point in self.base_points()], axis=-2)
        lengths = self.initial_lengths + self.limits.low, self.initial_lengths + self.limits.high
        return Shells(centres, *lengths), -self.height

    def limit_fields(self) -> dict[str, tuple[str, ...]]:
        """Returns the fields of limits: strokes and wrist angles."""
        return {**super().limit_fields(), "wrist_limits": ("theta1", "theta2")}

    def margins(self, pose: Array, joints: Array) -> dict[str, Array]:
        """Returns the distances to the limits of strokes, wrist angles and link distances; negative is a violation.

        The twelve link distances less sqrt(2) a are sufficient only: a negative one means "not proven free", not
        "interfering". See ``jaxkin.mechanisms._tlpm_wrist``. At a pose that is not finite all are NaN.
        """
        margins = super().margins(pose, joints)
        for k in range(3):
            margins[f"length{k + 1}"] = self.initial_lengths[k] + joints[..., k]
        point = waist(*(pose[..., k] for k in range(3)))
        nowhere = _tlpm_wrist.nowhere(point)
        return {name: value + nowhere for name, value in margins.items()} | _tlpm_wrist.margins(self, point)


def create(
    base_radius: ArrayLike = 590.0,
    height: ArrayLike = 590.0,
    stroke: Numbers = (-200.0, 200.0),
    initial_lengths: Numbers | None = None,
    *,
    limb_angles: Numbers = LIMB_ANGLES,
    a: ArrayLike = 25.0,
    b: ArrayLike = 150.0,
    r1: ArrayLike = 150.0,
    r2: ArrayLike = 110.0,
    beta2: ArrayLike = math.pi / 4,
    platform_angles: Numbers | None = None,
    wrist_limits: Limits | None = None,
    orientation: Numbers = (1.0, 0.0, 0.0, 0.0),
    elbows: Sequence[int] = (1, 1, 1),
) -> TLPM:
    """Returns a TLPM. All lengths in mm, angles in rad.

    Args:
        base_radius: L, positive. Not printed in the paper; 590 is ours.
        height: h; 590 follows from Table 1 (z1 + z2 = -2 h).
        stroke: ``(l_min, l_max)`` of all limbs, or ``((min1, min2, min3), (max1, max2, max3))``. Not printed.
        initial_lengths: L_i0, one number or three; sqrt(L^2 + h^2) by default, so that p = 0 at zero strokes.
        limb_angles: eta_i1.
        a: Side of the links' square section. Link sizes are not printed; these defaults are ours.
        b: Where link 2 begins on the limb's axis, from p.
        r1: Where links 2 and 3 meet on the R1 axis, from p.
        r2: Where link 3 ends on the R2 axis, from p.
        beta2: Angle between R2 axis and the platform's z axis.
        platform_angles: eta_i2; as ``limb_angles`` by default.
        wrist_limits: Limits of theta_i1, theta_i2; (pi/10, pi) and (pi/6, pi) by default, as printed.
        orientation: Quaternion (w, x, y, z) of the platform.
        elbows: +1 or -1 for each limb's wrist.

    Raises:
        GeometryError: A value is not finite, a size is not positive, the strokes' interval is empty or makes a limb's
            length not positive, the base is no triangle, limits are the wrong way round, an elbow is not +-1, or the
            quaternion is zero.

    Arrays of one shape make a batch of robots for ``jax.vmap``. Traceable: under ``jit``, ``vmap`` and
    ``grad`` nothing is checked, and a bad geometry shows as the status INVALID_GEOMETRY.
    """
    scalars = leaves(base_radius=base_radius, height=height, a=a, b=b, r1=r1, r2=r2, beta2=beta2)
    like = scalars["base_radius"]
    if initial_lengths is None:
        initial = jnp.sqrt(like**2 + scalars["height"] ** 2)[..., None] * jnp.ones(3)
    else:
        ends = leaves(initial_lengths=initial_lengths)["initial_lengths"]
        initial = vector_leaf("initial_lengths", ends if ends.ndim else jnp.full(3, ends), 3, like)
    wrist = Limits(*jnp.asarray(WRIST_LIMITS).T) if wrist_limits is None else wrist_limits
    robot = TLPM(
        **scalars,
        limb_angles=vector_leaf("limb_angles", limb_angles, 3, like),
        initial_lengths=initial,
        limits=batch_limits("stroke", _strokes(stroke), 3, like, ("l1", "l2", "l3")),
        platform_angles=vector_leaf(
            "platform_angles", limb_angles if platform_angles is None else platform_angles, 3, like
        ),
        wrist_limits=batch_limits("wrist_limits", wrist, 2, like, ("theta1", "theta2")),
        orientation=vector_leaf("orientation", orientation, 4, like),
        elbows=_checked_elbows(elbows),
    )
    if not any(map(is_traced, jax.tree_util.tree_leaves(robot))):
        _check(robot)
    return robot


def _strokes(stroke: Numbers) -> Limits:
    values = as_reals(stroke)
    if values is None:
        raise GeometryError(f"stroke is {stroke!r}: it must be (low, high), numbers in mm.")
    if values.shape not in ((2,), (2, 3)):
        raise GeometryError(
            f"stroke has shape {values.shape}: it must be (low, high), or three low and three high values, mm."
        )
    low, high = values
    return Limits(jnp.broadcast_to(low, (3,)), jnp.broadcast_to(high, (3,)))


def _checked_elbows(elbows: Sequence[int]) -> tuple[int, int, int]:
    signs = tuple(elbows) if isinstance(elbows, Sequence | np.ndarray) else (elbows,) * 3
    if len(signs) != 3 or any(sign not in (1, -1) for sign in signs):
        raise GeometryError(f"elbows is {elbows!r}: it must be three signs, +1 or -1, one for each limb.")
    return int(signs[0]), int(signs[1]), int(signs[2])


def _check(robot: TLPM) -> None:
    """Names what is wrong with a concrete geometry."""
    for name in ("base_radius", "a", "b", "r1", "r2"):
        value = getattr(robot, name)
        if not np.all(np.asarray(value) > 0):
            raise GeometryError(f"{name} is {value}: it must be positive, mm.")
    low, high = np.asarray(robot.limits.low), np.asarray(robot.limits.high)
    if not np.all(low < high):
        raise GeometryError(f"stroke is from {low} to {high}: the interval is empty; give low < high, mm.")
    initial = np.asarray(robot.initial_lengths)
    shortest = np.min(initial + low)
    if not shortest > 0 and not np.all(initial > 0):
        raise GeometryError(
            f"initial_lengths is {plain(initial)}, which with a stroke from {np.min(low):g} mm makes a limb "
            f"{shortest:g} mm long: it must stay longer than zero; give the limbs' lengths at zero stroke."
        )
    if not shortest > 0:
        raise GeometryError(
            f"stroke begins at {np.min(low):g} mm, which makes a limb {shortest:g} mm long: it must stay longer than "
            "zero; raise the lower stroke or the initial length."
        )
    if not np.all(np.sum(np.asarray(robot.orientation) ** 2, axis=-1) > 0):
        raise GeometryError(f"orientation is {robot.orientation}: a quaternion (w, x, y, z) must not be zero.")
    if not np.all(robot.geometry_ok()):
        raise GeometryError(
            f"limb_angles is {robot.limb_angles}: q1, q2, q3 must form a triangle; move two limbs apart."
        )


def stroke_jacobian(robot: TLPM, pose: ArrayLike) -> Array:
    """Returns dl/dp, ``(3, 3)``: row i is (p - q_i) / |p - q_i|.

    det = 2 A (z + h) / (r1 r2 r3), positive above the base plane, with the area A of the triangle q1 q2 q3; the home of
    L = sqrt2 h is isotropic, det = 1.

    References:
        Fu and Gao, Eqs. (7)-(9), (11), (12). Printed rows (q_i - p) / |q_i - p| together with J_inv = +I need
        J_dir v = -dl/dt; here the sign is in the rows, and det has the opposite sign of (12). The text exchanges the
        velocity of the end effector and the joint rates; the denominators of (11) are the roots of its u_i.
    """
    return _stroke_jacobian(robot, _tlpm_wrist.checked_point("stroke_jacobian", robot, pose))


@jax.jit
def _stroke_jacobian(robot: TLPM, pose: Array) -> Array:
    rows = []
    for qx, qy in robot.base_points():
        away = pose - jnp.stack([qx, qy, -robot.height])
        rows.append(away / jnp.sqrt(jnp.sum(away * away)))
    return jnp.stack(rows)


__all__ = [
    "CLEARANCE_NAMES",
    "ELBOW_MODES",
    "LIMB_ANGLES",
    "LINK_NAMES",
    "TLPM",
    "WRIST_LIMITS",
    "ElbowModes",
    "WristAngles",
    "create",
    "elbow_modes",
    "link_clearances",
    "links",
    "stroke_jacobian",
    "wrist_angles",
]
