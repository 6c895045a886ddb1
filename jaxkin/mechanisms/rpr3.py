"""The planar 3-RPR: three extensible legs between a base and a moving triangle.

Pose ``(x, y, phi)``: position of the platform point B1 and angle of B1B2; joints ``(rho1, rho2, rho3)``: leg lengths.
The base is A1 = (0, 0), A2 = (c2, 0), A3 = (c3, d3).

References:
    Wenger, P. and Chablat, D., "Kinematic analysis of a class of analytic planar 3-RPR parallel
    manipulators", Computational Kinematics, 2009, hal-00412923: Eqs. (1)-(3) are the constraints, (6)
    defines the analytic family. The text after (5) says that the *inverse* kinematics fails where
    RV - SU = 0; it is the forward kinematics.
    Innocenti, C. and Parenti-Castelli, V., 1998: the reference geometry of ``reference``.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from jaxkin.core.branches import Lane
from jaxkin.core.errors import GeometryError, Status
from jaxkin.core.mechanism import Axis, Count, Limits, Mechanism, angle, mechanism
from jaxkin.core.precision import TOLERANCES
from jaxkin.core.tracing import is_traced
from jaxkin.mechanisms import _rpr3_analytic, _rpr3_general, rpr3_closed_forms
from jaxkin.mechanisms._geometry import batch_limits, leaves
from jaxkin.mechanisms.catalogue import CATALOGUE
from jaxkin.numerics.fusion import materialise
from jaxkin.numerics.spheres import Shells
from jaxkin.numerics.trigonometry import cos_sin

Point = tuple[Array, Array]


class _PlanarRPR3(Mechanism):
    """What both families share: the equations, written with the platform's points in its own frame."""

    pose_axes = (Axis("x", "length"), Axis("y", "length"), angle("phi"))
    joint_axes = (Axis("rho1", "length", 0.0), Axis("rho2", "length", 0.0), Axis("rho3", "length", 0.0))
    max_branches = 6

    c2: Array
    c3: Array
    d3: Array
    limits: Limits

    def base_points(self) -> tuple[Point, Point, Point]:
        """Returns A1, A2, A3."""
        zero = jnp.zeros_like(self.c2)
        return (zero, zero), (self.c2, zero), (self.c3, self.d3)

    def platform_points(self) -> tuple[Point, Point, Point]:
        """Returns B1, B2, B3 in the platform's frame."""
        raise NotImplementedError

    def outline(self, pose: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Returns the points A ``(3, 2)`` and B ``(3, 2)`` of one pose, for drawing."""
        x, y, phi = np.asarray(pose, dtype=float)
        turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
        own = np.array(self.platform_points(), dtype=float)
        return np.array(self.base_points(), dtype=float), own @ turn.T + (x, y)

    def reach_rings(self, phi: ArrayLike) -> Shells:
        """Returns the rings between which the leg limits hold B1 at one angle of the platform."""
        cos, sin = jnp.cos(phi), jnp.sin(phi)
        pairs = zip(self.base_points(), self.platform_points(), strict=True)
        centres = [jnp.stack([ax - bx * cos + by * sin, ay - bx * sin - by * cos]) for (ax, ay), (bx, by) in pairs]
        return Shells(jnp.stack(centres), self.limits.low, self.limits.high)

    def _legs(self, x: Array, y: Array, cos: Array, sin: Array) -> list[tuple[Array, Array, Array]]:
        """Returns of each leg both components, and their moment about B1: half the derivative by phi."""
        legs = []
        for (ax, ay), (bx, by) in zip(self.base_points(), self.platform_points(), strict=True):
            armx, army = bx * cos - by * sin, bx * sin + by * cos
            dx, dy = x + armx - ax, y + army - ay
            legs.append((dx, dy, dy * armx - dx * army))
        return legs

    def _legs_once(self, pose: tuple[Array, ...]) -> list[tuple[Array, Array, Array]]:
        """Returns the legs for kernels, of which each result would otherwise compute sine and cosine again."""
        return self._legs(pose[0], pose[1], *materialise(*cos_sin(pose[2])))

    def jacobian_kernel(
        self, pose: tuple[Array, ...], joints: tuple[Array, ...]
    ) -> tuple[tuple[tuple[Array, ...], ...], tuple[Array, ...]]:
        """Returns dF/dpose and the diagonal of dF/djoints."""
        rows = tuple((2 * dx, 2 * dy, 2 * moment) for dx, dy, moment in self._legs_once(pose))
        return rows, tuple(-2 * q for q in joints)

    def constraints(self, pose: Array, joints: Array) -> Array:
        """Returns |B_i - A_i|^2 - rho_i^2, ``(3,)`` (Wenger and Chablat 2009, Eqs. (1)-(3))."""
        legs = self._legs(pose[0], pose[1], jnp.cos(pose[2]), jnp.sin(pose[2]))
        return jnp.stack([dx * dx + dy * dy for dx, dy, _ in legs]) - joints * joints

    def constraint_scales(self, pose: Array, joints: Array) -> Array:
        """Returns rho_i^2 + L^2, ``(3,)``, with the characteristic length L."""
        del pose
        return joints * joints + self.characteristic_length() ** 2

    def characteristic_length(self) -> Array:
        """Returns the root of the mean squared distance of the six joint centres from A1 and B1."""
        points = (*self.base_points()[1:], *self.platform_points()[1:])
        return jnp.sqrt(sum(px * px + py * py for px, py in points) / 4)  # type: ignore[arg-type]

    def inverse_kernel(self, pose: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns the three positive lengths; a leg of zero length is a serial singularity."""
        x, y, _ = pose
        squares = [dx * dx + dy * dy for dx, dy, _ in self._legs_once(pose)]
        zero = TOLERANCES.inverse_singular * (self.characteristic_length() + jnp.abs(x) + jnp.abs(y))
        singular = jnp.zeros(jnp.shape(x), bool)
        for square in squares:
            singular = singular | (square <= zero * zero)
        return (
            Lane(
                values=tuple(jnp.sqrt(square) for square in squares),
                status=jnp.where(singular, jnp.int8(Status.SINGULAR), jnp.int8(Status.OK)),
                multiplicity=jnp.where(singular, jnp.int8(2), jnp.int8(1)),
                residual=jnp.zeros(jnp.shape(squares[0])),
            ),
        )


@mechanism
class AnalyticRPR3(_PlanarRPR3):
    """The analytic family: the platform is the base mirrored in a line of the plane.

    Use ``analytic`` to build one.

    Attributes:
        c2: Abscissa of A2; also the length B1B2.
        c3: Abscissa of A3.
        d3: Ordinate of A3.
        limits: Joint limits.
    """

    id: ClassVar[str] = "rpr3-analytic"
    forward_block: ClassVar[int] = 1 << 14

    c2: Array
    c3: Array
    d3: Array
    limits: Limits

    def platform_points(self) -> tuple[Point, Point, Point]:
        """Returns the base mirrored in its own x axis (Eq. (6))."""
        zero = jnp.zeros_like(self.c2)
        return (zero, zero), (self.c2, zero), (self.c3, -self.d3)

    def geometry_ok(self) -> Array:
        """True where the base is a proper triangle: c2 and d3 finite and not zero."""
        size = jnp.abs(self.c2) + jnp.abs(self.c3) + jnp.abs(self.d3)
        smallest = jnp.minimum(jnp.abs(self.c2), jnp.abs(self.d3))
        return jnp.isfinite(size) & (smallest > TOLERANCES.geometry * size)

    def forward_kernel(self, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns all assembly modes in six lanes; see ``_rpr3_analytic.forward``."""
        return _rpr3_analytic.forward((self.c2, self.c3, self.d3), joints)

    def count_kernel(self, joints: tuple[Array, ...]) -> Count:
        """Returns the number of assembly modes from signs alone; see ``_rpr3_analytic.count``."""
        return _rpr3_analytic.count((self.c2, self.c3, self.d3), joints)

    def count_walls(self, joints: Array) -> Array:
        """Returns S and Q1 to Q4, ``(5,)``, between whose zeros the number of assembly modes is constant.

        It is twice the number of real roots of the cubic (7) with h^2 < rho1^2. A root appears or vanishes where the
        discriminant S does (the cubic is never identically zero), and h^2 - rho1^2 changes its sign along one only
        where the legs are parallel, on a quadric: h is a smooth function of the root, as c2 S and g have no common
        zero. The virtual part of S is no wall; it costs proofs, not their truth.
        """
        return jnp.stack(list(self.closed_forms(joints).values()))

    def factors(self, pose: Array) -> dict[str, Array]:
        """Returns the factors of the direct determinant, ``f1`` (a length) and ``f2`` (a length cubed).

        With half-angle sine S and cosine C: f1 = x C + y S and
        f2 = d3 (x S - y C) - 2 c3 d3 S^3 + 2 (c3 c2 - c3^2 + d3^2) S^2 C + 2 d3 (c3 - c2) S C^2,
        and det dF/d(x, y, phi) = -16 c2 f1 f2. Both change sign over the seam phi = +-pi, their product
        does not.

        References:
            Wenger and Chablat 2009, f1 and f2, which are correct as printed (there in t = S/C, times
            powers of C).
        """
        x, y, phi = pose[0], pose[1], pose[2]
        s, c = jnp.sin(phi / 2), jnp.cos(phi / 2)
        c2, c3, d3 = self.c2, self.c3, self.d3
        f2 = (
            d3 * (x * s - y * c)
            - 2 * c3 * d3 * s**3
            + 2 * (c3 * c2 - c3**2 + d3**2) * s**2 * c
            + 2 * d3 * (c3 - c2) * s * c**2
        )
        return {"f1": x * c + y * s, "f2": f2}

    def closed_form_curves(self, axis: int, value: float) -> list[rpr3_closed_forms.Piece]:
        """Returns all singular curves of the section rho[axis] = value; see ``rpr3_closed_forms.section_curves``."""
        return rpr3_closed_forms.section_curves(self, axis, value)

    def closed_forms(self, joints: Array) -> dict[str, Array]:
        """Returns the polynomials of the joint space by label, S and Q1 to Q4; see ``rpr3_closed_forms``."""
        return {"S": rpr3_closed_forms.quartic(self, joints), **rpr3_closed_forms.conics(self, joints)}


@mechanism
class GeneralRPR3(_PlanarRPR3):
    """Any planar 3-RPR; use ``general`` to build one.

    Attributes:
        c2: Abscissa of A2.
        c3: Abscissa of A3.
        d3: Ordinate of A3.
        l2: Length B1B2.
        l3: Length B1B3.
        beta: Angle from B1B2 to B1B3, counter-clockwise, rad.
        limits: Joint limits.
    """

    leaf_units: ClassVar[dict[str, str]] = {"beta": "rad"}
    id: ClassVar[str] = "rpr3"
    forward_block: ClassVar[int] = 1 << 13

    c2: Array
    c3: Array
    d3: Array
    l2: Array
    l3: Array
    beta: Array
    limits: Limits

    def platform_points(self) -> tuple[Point, Point, Point]:
        """Returns B1, B2, B3 in the platform's frame."""
        zero = jnp.zeros_like(self.c2)
        return (zero, zero), (self.l2, zero), (self.l3 * jnp.cos(self.beta), self.l3 * jnp.sin(self.beta))

    def geometry_ok(self) -> Array:
        """True where no two legs share both joints and neither triangle is a point."""
        return jnp.isfinite(self._spread()) & (self._worst_pair() > TOLERANCES.geometry * self._spread())

    def _spread(self) -> Array:
        (_, _), (c2, _), (c3, d3) = self.base_points()
        (_, _), (l2, _), (bx, by) = self.platform_points()
        return jnp.sqrt(c2 * c2 + c3 * c3 + d3 * d3 + l2 * l2 + bx * bx + by * by)

    def _worst_pair(self) -> Array:
        """The smallest, over pairs of legs, distance of both joints together; and each triangle's size."""
        base, platform = self.base_points(), self.platform_points()

        def apart(points: tuple[Point, ...], i: int, j: int) -> Array:
            return jnp.hypot(points[i][0] - points[j][0], points[i][1] - points[j][1])

        pairs = ((0, 1), (0, 2), (1, 2))
        worst = jnp.minimum(*(sum(apart(points, i, j) for i, j in pairs) for points in (base, platform)))  # type: ignore[arg-type]
        for i, j in pairs:
            worst = jnp.minimum(worst, apart(base, i, j) + apart(platform, i, j))
        return worst

    def forward_kernel(self, joints: tuple[Array, ...]) -> tuple[Lane, ...]:
        """Returns all assembly modes in six lanes; see ``_rpr3_general.forward``.

        A platform that mirrors the base belongs to the analytic family, in which the general elimination sees
        nothing but double roots; its kernel solves it.
        """
        shape = jnp.broadcast_shapes(*(jnp.shape(rho) for rho in joints))
        joints = tuple(jnp.broadcast_to(rho, shape) for rho in joints)
        base, platform = self.base_points(), self.platform_points()
        length = self.characteristic_length()
        return jax.lax.cond(
            self._mirrored(),
            lambda q: _rpr3_analytic.forward((self.c2, self.c3, self.d3), q),
            lambda q: _rpr3_general.forward(base, platform, length, q),
            joints,
        )

    def _mirrored(self) -> Array:
        """True where the platform is the base mirrored in its own x axis, a proper triangle (Eq. (6))."""
        (bx, by), spread = self.platform_points()[2], self._spread()
        apart = jnp.abs(self.l2 - self.c2) + jnp.abs(bx - self.c3) + jnp.abs(by + self.d3)
        proper = jnp.minimum(jnp.abs(self.c2), jnp.abs(self.d3)) > TOLERANCES.geometry * spread
        return proper & (apart <= TOLERANCES.geometry * spread)


def analytic(c2: ArrayLike, c3: ArrayLike, d3: ArrayLike, limits: Limits | None = None) -> AnalyticRPR3:
    """Returns a member of Wenger and Chablat's analytic family.

    Args:
        c2: Abscissa of A2, not zero; also the platform's side B1B2.
        c3: Abscissa of A3.
        d3: Ordinate of A3, not zero.
        limits: Joint limits; by default lengths are only not negative.

    Raises:
        GeometryError: A value is not finite, or c2 or d3 is zero (also against the size of the others).

    Arrays of one shape make a batch of robots for ``jax.vmap``. Traceable: under ``jit``, ``vmap`` and
    ``grad`` nothing is checked, and a bad geometry shows as the status INVALID_GEOMETRY.
    """
    values = leaves(c2=c2, c3=c3, d3=d3)
    robot = AnalyticRPR3(**values, limits=_limits(limits, values["c2"]))
    if not any(map(is_traced, values.values())) and not np.all(robot.geometry_ok()):
        raise GeometryError(
            f"c2={c2}, c3={c3}, d3={d3}: neither c2 nor d3 may be zero (A1, A2, A3 must form a triangle); "
            "for aligned joints use rpr3.general."
        )
    return robot


def general(
    c2: ArrayLike,
    c3: ArrayLike,
    d3: ArrayLike,
    l2: ArrayLike,
    l3: ArrayLike,
    beta: ArrayLike,
    limits: Limits | None = None,
) -> GeneralRPR3:
    """Returns a general planar 3-RPR.

    Args:
        c2: Abscissa of A2.
        c3: Abscissa of A3.
        d3: Ordinate of A3.
        l2: Length B1B2, not negative.
        l3: Length B1B3, not negative.
        beta: Angle from B1B2 to B1B3, counter-clockwise, rad.
        limits: Joint limits; by default lengths are only not negative.

    Raises:
        GeometryError: A value is not finite, a side is negative, all base or all platform joints
            coincide, or two legs share both of their joints.

    Arrays of one shape make a batch of robots for ``jax.vmap``. Traceable: under ``jit``, ``vmap`` and
    ``grad`` nothing is checked, and a bad geometry shows as the status INVALID_GEOMETRY.
    """
    values = leaves(c2=c2, c3=c3, d3=d3, l2=l2, l3=l3, beta=beta)
    robot = GeneralRPR3(**values, limits=_limits(limits, values["c2"]))
    if not any(map(is_traced, values.values())):
        for name in ("l2", "l3"):
            if np.any(np.asarray(values[name]) < 0):
                raise GeometryError(f"{name} is {values[name]}: a side must not be negative; turn beta by pi instead.")
        if not np.all(robot.geometry_ok()):
            raise GeometryError(
                f"c2={c2}, c3={c3}, d3={d3}, l2={l2}, l3={l3}, beta={beta}: two legs share both joints, or all "
                "joints of the base or of the platform coincide; move at least one of them."
            )
    return robot


def reference(limits: Limits | None = None) -> GeneralRPR3:
    """Returns the field's reference geometry (Innocenti and Parenti-Castelli 1998; Merlet; Zein, Wenger, Chablat).

    Base (0, 0), (15.91, 0), (0, 10); platform sides 17.04, 16.54, 20.84, B3 counter-clockwise from B1B2. The
    angle that circulates as 0.8822603 moves the poses by up to 0.02; it is computed from the sides here.
    """
    return general(**CATALOGUE["rpr3"].geometry, limits=limits)


def _limits(limits: Limits | None, leaf: Array) -> Limits:
    return batch_limits("limits", Limits.lengths(3) if limits is None else limits, 3, leaf)
