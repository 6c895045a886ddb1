"""The largest ball of rotations about one rotation that holds no singularity."""

import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, concrete_reals
from jaxkin.core.precision import TOLERANCES
from jaxkin.kinematics.boundary import checked_single
from jaxkin.mapping._orientation_factors import affine_factors, checked_concrete, checked_whole
from jaxkin.mapping._orientation_records import RotationBall
from jaxkin.numerics import haar, newton

_WHO = "jk.largest_rotation_ball"
#: Steps of each search; Levenberg and Marquardt's end quadratically, also where the solutions form a curve.
_STEPS = 80
#: What counts as stationary: the equations are of order one.
_STATIONARY = 1e-12
#: Stationary angles closer than this to the smallest are the same.
_SAME = 1e-9


def largest_rotation_ball(robot: Mechanism, center: ArrayLike | None = None, starts: int = 256) -> RotationBall:
    """Finds the largest ball of rotations about a centre in which the robot is not singular [ours].

    Its radius is the smallest angle (geodesic distance on SO(3)) between the centre and a rotation at which a factor
    vanishes, so it belongs to no chart. A factor that is affine in R is a quadratic form of the quaternion q of the
    turn from the centre, and the angle is smallest where |q0| is largest: Lagrange's conditions are solved by Newton's
    damped steps from many starts, which fill the group, and the smallest of all stationary angles is taken. A search
    cannot prove that there is no smaller one; the numbers of starts that converged are reported.

    About the home pose of the 3-PPPS the radius is pi/2, for both factors, and exactly: see
    ``ppps3_closed_forms.nearest_singular_rotation``.

    Args:
        robot: A mechanism with factors that are affine in the entries of R = Rx(phi) Ry(theta) Rz(sigma) and do not
            depend on the position, as the 3-PPPS.
        center: ``(3, 3)`` rotation in the middle; the identity (home) by default.
        starts: Starts for each factor, a positive whole number.

    Raises:
        InputError: Not one such mechanism, the centre is no rotation or singular, ``starts`` is no positive whole
            number, or none of the starts converged for a factor that vanishes somewhere.
    """
    checked_single(_WHO, robot)
    checked_concrete(_WHO, center=center)
    names, factors = affine_factors(_WHO, robot)
    middle = _checked_center(center)
    at_center = factors(middle[None])[:, 0]
    if np.min(np.abs(at_center)) <= TOLERANCES.residual:
        name = names[int(np.argmin(np.abs(at_center)))]
        raise InputError(f"center is a singular rotation ({name} = 0): a ball about it is empty; choose another one.")
    quaternions = _lattice(checked_whole(_WHO, "starts", starts, 1, 256))
    radii, converged, ends = {}, {}, []
    for k, name in enumerate(names):
        form = _quadratic_form(factors.constant[k], middle.T @ factors.slope[k])
        found = _stationary(form, quaternions)
        if not len(found) and _vanishes(form):
            raise InputError(
                f"{_WHO}: starts is {len(quaternions)}, and none of them converged for {name} = 0, which exists: it "
                "must be large enough for every factor; give more, 256 for instance."
            )
        converged[name] = len(found)
        radii[name] = float(_angles(found).min(initial=np.inf))
        ends.append(found)
    radius = min(*radii.values(), np.pi)
    near = [end[_angles(end) <= radius + _SAME] for end in ends]
    number = np.repeat(np.arange(len(names)), [len(end) for end in near])
    touching = middle @ haar.matrices(np.concatenate(near))
    return RotationBall(
        center=middle,
        radius=float(radius),
        factor=min(radii, key=lambda name: radii[name]),
        radii=radii,
        touching=touching,
        touching_factor=number,
        residual=float(np.abs(factors(touching)[number, np.arange(len(number))]).max(initial=0.0)),
        share=float((radius - np.sin(radius)) / np.pi),
        starts=len(quaternions),
        converged=converged,
    )


def _vanishes(form: np.ndarray) -> bool:
    """True where q A q = 0 for some unit quaternion: the form is not definite."""
    values = np.linalg.eigvalsh(form)
    return bool(values[0] <= 0 <= values[-1])


def _checked_center(center: ArrayLike | None) -> np.ndarray:
    reals = np.eye(3) if center is None else concrete_reals(center)
    if reals is None:
        raise InputError(f"center is {center!r}: it must be a rotation matrix, (3, 3) real numbers.")
    middle = reals
    if middle.shape != (3, 3) or not np.allclose(middle.T @ middle, np.eye(3), atol=1e-9) or np.linalg.det(middle) < 0:
        raise InputError(
            f"center is {middle.tolist()}: it must be a rotation matrix, (3, 3), orthonormal with det = 1."
        )
    return middle


def _lattice(starts: int) -> np.ndarray:
    """Returns unit quaternions spread evenly over the group (Shoemake's map of a lattice in the cube)."""
    u, v, w = newton.lattice(starts, 3).T
    v, w = 2 * np.pi * v, 2 * np.pi * w
    below, above = np.sqrt(1 - u), np.sqrt(u)
    return np.stack([below * np.sin(v), below * np.cos(v), above * np.sin(w), above * np.cos(w)], axis=1)


def _quadratic_form(constant: float, slope: np.ndarray) -> np.ndarray:
    """Returns the symmetric A, ``(4, 4)``, with constant + slope . R(q) = q A q for unit quaternions q."""
    axial = np.array([slope[2, 1] - slope[1, 2], slope[0, 2] - slope[2, 0], slope[1, 0] - slope[0, 1]])
    form = np.empty((4, 4))
    form[0, 0], form[0, 1:], form[1:, 0] = np.trace(slope), axial, axial
    form[1:, 1:] = slope + slope.T - np.trace(slope) * np.eye(3)
    return form + constant * np.eye(4)


def _angles(quaternions: np.ndarray) -> np.ndarray:
    return 2 * np.arctan2(np.linalg.norm(quaternions[:, 1:], axis=1), np.abs(quaternions[:, 0]))


def _stationary(form: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Returns unit quaternions with q A q = 0 at which the angle is stationary, one for each start that converged.

    Unknowns are q and the two multipliers of e0 = a q + b A q. Where the solutions form a curve their Jacobian is
    singular; Levenberg and Marquardt's damped steps do not mind.
    """
    q, count = starts, len(starts)
    unknowns = np.concatenate([q, q[:, :1], np.zeros((count, 1))], axis=1)
    value, slope = _conditions(form, unknowns)
    damping = np.full(count, 0.05)
    for _ in range(_STEPS):
        across = np.swapaxes(slope, 1, 2)
        normal = across @ slope + damping[:, None, None] * np.eye(6)
        trial = unknowns - np.linalg.solve(normal, across @ value[..., None])[..., 0]
        new_value, new_slope = _conditions(form, trial)
        better = np.sum(new_value**2, axis=1) < np.sum(value**2, axis=1)
        damping = np.clip(np.where(better, damping * 0.2, damping * 5), 1e-14, 1e6)
        unknowns = np.where(better[:, None], trial, unknowns)
        value = np.where(better[:, None], new_value, value)
        slope = np.where(better[:, None, None], new_slope, slope)
    return unknowns[np.abs(value).max(axis=1) <= _STATIONARY, :4]


def _conditions(form: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns e0 - a q - b A q, q A q and q q - 1, ``(n, 6)``, and their slopes."""
    q, a, b = unknowns[:, :4], unknowns[:, 4, None], unknowns[:, 5, None]
    turned = q @ form
    unit = np.eye(4)[0] - a * q - b * turned
    value = np.concatenate([unit, np.stack([np.sum(q * turned, axis=1), np.sum(q * q, axis=1) - 1], axis=1)], axis=1)
    slope = np.zeros((len(q), 6, 6))
    slope[:, :4, :4] = -a[..., None] * np.eye(4) - b[..., None] * form
    slope[:, :4, 4], slope[:, :4, 5] = -q, -turned
    slope[:, 4, :4], slope[:, 5, :4] = 2 * turned, 2 * q
    return value, slope
