"""The orientation space of a robot whose singularities depend on the orientation alone: aspects, solids, balls, limits.

What belongs to the robot and not to a choice of angles is a share of all rotations (Haar measure) or a geodesic
distance; volumes and shapes belong to a chart, and are given as such.
"""

import itertools
import math
from typing import Any

import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.core.mechanism import Mechanism, concrete_reals
from jaxkin.core.provenance import identity
from jaxkin.kinematics.boundary import checked_single
from jaxkin.mapping._orientation_ball import largest_rotation_ball
from jaxkin.mapping._orientation_factors import affine_factors, affine_margins, checked_concrete, checked_tolerance
from jaxkin.mapping._orientation_records import (
    CHART,
    OrientationAspect,
    OrientationAspects,
    ReachableShare,
    RotationBall,
    Solid,
)
from jaxkin.mapping._orientation_solids import aspect_solid, joint_solid
from jaxkin.numerics import haar

__all__ = [
    "CHART",
    "OrientationAspect",
    "OrientationAspects",
    "ReachableShare",
    "RotationBall",
    "Solid",
    "aspect_solid",
    "joint_solid",
    "largest_rotation_ball",
    "orientation_aspects",
    "reachable_share",
]

#: Rotations among which every combination of signs is looked for.
_SAMPLES = 1 << 13
#: Newton steps from the best of the samples to the deepest rotation.
_DEEPER = 12
#: Shorter arcs of a fibre are rounding, and tell no neighbour.
_ARC = 1e-6
#: Tiles a side into which the chart is cut, until no region slips between the nodes.
_TILES = (1, 4, 12)
#: A margin that stays this far above zero, over the sizes in it, binds nowhere.
_CLEAR = 1e-12


def orientation_aspects(robot: Mechanism, tolerance: float = 1e-9) -> OrientationAspects:
    """Returns the aspects of the orientation space: sign classes of the factors of the singularity.

    The shares of all rotations come from an integration that knows no Euler angles (see ``jaxkin.numerics.haar``); the
    volumes in the chart X-Y-Z from another one, column by column in sigma. Neither uses a symmetry of the robot. A
    class is one aspect if it is connected, which is not checked here; those of the 3-PPPS are (see
    ``ppps3_closed_forms``).

    Args:
        robot: A mechanism with factors that are affine in the entries of R = Rx(phi) Ry(theta) Rz(sigma) and do not
            depend on the position, as the 3-PPPS.
        tolerance: Of the shares, and of the volumes in units of 8 pi^2.

    Returns:
        The classes that have rotations, all signs positive first; for the 3-PPPS in the order of ``forward_labels``.

    Raises:
        InputError: Not one such mechanism, or a tolerance that is not positive.

    References:
        Chablat, Baron, Jha and Rolland 2018, section 4: the home aspect in the chart X-Y-Z. Shares, volumes, the other
        aspects and their neighbours are ours.
    """
    who = "jk.orientation_aspects"
    checked_single(who, robot)
    tolerance = checked_tolerance(who, tolerance, 1e-9)
    names, factors = affine_factors(who, robot)
    samples = haar.random_rotations(_SAMPLES)
    positive = factors(samples) > 0
    every = _every(len(names))
    classes = [signs for signs in every if _matching(positive, signs).any()]

    def indicator(positive: np.ndarray) -> np.ndarray:
        return np.stack([_matching(positive, signs) for signs in classes])

    shares = haar.haar_shares(factors, indicator, tolerance=tolerance)
    volumes = _chart_shares(factors, indicator, tolerance * 8 * math.pi**2)
    neighbours = _neighbours(factors, classes)
    labels = [_label(names, signs) for signs in classes]
    aspects = []
    for k, signs in enumerate(classes):
        own = samples[_matching(positive, signs)]
        aspects.append(
            OrientationAspect(
                label=labels[k],
                signs=signs,
                rotation=_deepest(factors, own),
                share=float(shares.value[k]),
                share_error=float(shares.error[k]),
                volume=float(volumes.value[k]),
                volume_error=float(volumes.error[k]),
                neighbours={names[f]: labels[other] for (f, one), other in neighbours.items() if one == k},
            )
        )
    request: dict[str, Any] = {**identity(robot), "tolerance": tolerance}
    return OrientationAspects(tuple(aspects), names, request)


def reachable_share(
    robot: Mechanism, position: ArrayLike, label: str = "home", tolerance: float = 1e-5
) -> ReachableShare:
    """Returns how much of an aspect is reachable at a fixed position, within all joint limits [ours].

    The limits are those of ``robot.margins``: for the 3-PPPS of all nine prismatic joints, ``robot.limits`` and
    ``robot.passive_limits``. At a fixed position every joint is affine in the entries of R, so on every circle of
    rotations R Rz(psi) the ends of what is reachable are known exactly; see ``jaxkin.numerics.haar`` for what remains.

    Args:
        robot: A mechanism as for ``orientation_aspects``, with one working mode.
        position: ``(3,)`` the other coordinates of the pose, x, y, z.
        label: The aspect: ``"home"`` (all factors positive), or a label such as ``"R22 > 0, R33 < 0"``.
        tolerance: Of the shares, and of the volume in units of 8 pi^2.

    Raises:
        InputError: Not such a mechanism, an unknown label, a position that is not three finite numbers or is traced,
            or a tolerance that is not positive.
    """
    who = "jk.reachable_share"
    checked_single(who, robot)
    checked_concrete(who, position=position)
    tolerance = checked_tolerance(who, tolerance, 1e-5)
    names, factors = affine_factors(who, robot)
    reals = concrete_reals(position)
    place = np.full(0, np.nan) if reals is None else reals
    if place.shape != (len(robot.pose_axes) - 3,) or not np.isfinite(place).all():
        wanted = ", ".join(axis.name for axis in robot.pose_axes[:-3])
        raise InputError(f"{who}: position is {position!r}; it must be finite numbers ({wanted}).")
    signs = _signs(names, label)
    margin_names, margins = affine_margins(who, robot, place)
    size = np.linalg.svd(margins.slope, compute_uv=False).sum(axis=-1)
    scale = np.abs(margins.constant) + size
    # On rotations, |slope . R| is at most the sum of the singular values.
    binds = np.flatnonzero(margins.constant - size <= _CLEAR * scale)
    functions = haar.Affine(
        np.concatenate([factors.constant, margins.constant[binds]]),
        np.concatenate([factors.slope, margins.slope[binds]]),
    )

    def indicator(positive: np.ndarray) -> np.ndarray:
        inside = _matching(positive[: len(names)], signs)
        limits = positive[len(names) :]
        return np.concatenate([(inside & limits.all(axis=0))[None], inside[None], inside & ~limits])

    shares = haar.haar_shares(functions, indicator, tolerance=tolerance)
    volume, volume_error = _chart_volume(functions, lambda positive: indicator(positive)[:1], tolerance, shares)
    forbidden = {margin_names[k]: float(value) for k, value in zip(binds, shares.value[2:], strict=True) if value > 0}
    return ReachableShare(
        position=place,
        label=_label(names, signs),
        share=float(shares.value[0]),
        share_error=float(shares.error[0]),
        aspect_share=float(shares.value[1]),
        volume=volume,
        volume_error=volume_error,
        binding=dict(sorted(forbidden.items(), key=lambda entry: -entry[1])),
    )


def _label(names: tuple[str, ...], signs: tuple[int, ...]) -> str:
    return ", ".join(f"{name} {'>' if sign > 0 else '<'} 0" for name, sign in zip(names, signs, strict=True))


def _signs(names: tuple[str, ...], label: str) -> tuple[int, ...]:
    known = {_label(names, signs): signs for signs in _every(len(names))}
    home = next(iter(known.values()))
    if not isinstance(label, str) or (label != "home" and label not in known):
        raise InputError(
            f"label is {label!r}: the aspects are 'home', {', '.join(map(repr, known))}; give one of them."
        )
    return home if label == "home" else known[label]


def _every(count: int) -> list[tuple[int, ...]]:
    return list(itertools.product((1, -1), repeat=count))


def _matching(positive: np.ndarray, signs: tuple[int, ...]) -> np.ndarray:
    """Returns where the factors have these signs, from ``(k, ...)`` truths."""
    wanted = np.array(signs).reshape(-1, *[1] * (positive.ndim - 1)) > 0
    return (positive == wanted).all(axis=0)


def _chart_volume(
    functions: haar.Affine, indicator: haar.Indicator, tolerance: float, shares: haar.Shares
) -> tuple[float, float]:
    """Returns the volume in the chart X-Y-Z and its error, of a region whose share is known.

    The chart's density is 8 pi^2 / cos(theta) of the share's, so that no volume is less than 8 pi^2 times the share: a
    slender region that slips between the nodes shows, and is sought with finer ones.
    """
    turn = 8 * math.pi**2
    least = turn * float(shares.value[0] - 2 * shares.error[0])
    value = error = 0.0
    for tiles in _TILES:
        found = _chart_shares(functions, indicator, tolerance * turn, tiles)
        value, error = float(found.value[0]), float(found.error[0])
        if value + error >= least:
            break
    return value, max(error, least - value)


def _chart_shares(functions: haar.Affine, indicator: haar.Indicator, tolerance: float, tiles: int = 1) -> haar.Shares:
    """Integrates over the chart X-Y-Z: the columns over (phi, theta) are the fibres of turns about z."""

    def frames(phi: np.ndarray, theta: np.ndarray) -> np.ndarray:
        (cp, sp), (ct, st), zero = (np.cos(phi), np.sin(phi)), (np.cos(theta), np.sin(theta)), np.zeros_like(phi)
        rows = ((ct, zero, st), (sp * st, cp, -sp * ct), (-cp * st, sp, cp * ct))
        return np.moveaxis(np.array(rows), -1, 0)

    phis, thetas = np.linspace(-math.pi, math.pi, tiles + 1), np.linspace(-math.pi / 2, math.pi / 2, tiles + 1)
    parts = [
        haar.square_shares(functions, indicator, frames, phi, theta, tolerance=tolerance / tiles**2)
        for phi in itertools.pairwise(phis.tolist())
        for theta in itertools.pairwise(thetas.tolist())
    ]
    total = haar.Shares(*(sum(part[k] for part in parts) for k in range(3)))  # type: ignore[arg-type]
    return total


def _deepest(factors: haar.Affine, samples: np.ndarray) -> np.ndarray:
    """Returns the rotation with the largest product of the factors' sizes in the class of the samples."""
    found = samples[np.argmax(np.sum(np.log(np.abs(factors(samples))), axis=0))]
    # Turns about the three axes, to first and second order.
    first = np.array(
        [[[0, 0, 0], [0, 0, -1], [0, 1, 0]], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], [[0, -1, 0], [1, 0, 0], [0, 0, 0]]]
    )
    second = (np.einsum("aij,bjk->abik", first, first) + np.einsum("bij,ajk->abik", first, first)) / 2
    for _ in range(_DEEPER):
        value = factors(found[None])[:, 0]
        gradient = np.einsum("kij,im,amj->ka", factors.slope, found, first) / value[:, None]
        bend = np.einsum("kij,im,abmj->kab", factors.slope, found, second) / value[:, None, None]
        hessian = np.sum(bend - gradient[:, :, None] * gradient[:, None, :], axis=0)
        # The best of the samples is close to a maximum, where the Hessian is negative.
        step = -np.linalg.lstsq(hessian, gradient.sum(axis=0), rcond=1e-9)[0]
        step *= min(1.0, 0.2 / max(np.linalg.norm(step), 1e-300))
        found = found @ haar.matrices(np.append(1.0, step / 2)[None])[0]
    return found + 0.0


def _neighbours(factors: haar.Affine, classes: list[tuple[int, ...]]) -> dict[tuple[int, int], int]:
    """Returns the class across each factor's surface, ``(factor, class) -> class``, as met on circles of rotations."""
    # Circles about a skew axis, so that no entry of R is constant along them.
    skew = haar.matrices(np.array([[1.0, 0.3, -0.7, 0.2]]))[0]
    turned = haar.Affine(factors.constant, factors.slope @ skew)
    length, positive = haar.fibre_arcs(turned, haar.random_rotations(512, seed=1))
    found = {}
    for arcs, signs in zip(length, np.moveaxis(positive, 1, 0), strict=True):
        kept = signs[:, arcs > _ARC]
        for one, two in zip(kept.T, np.roll(kept, -1, axis=1).T, strict=True):
            changed = np.flatnonzero(one != two)
            if len(changed) == 1:
                pair = [classes.index(tuple(np.where(side, 1, -1).tolist())) for side in (one, two)]
                found[int(changed[0]), pair[0]], found[int(changed[0]), pair[1]] = pair[1], pair[0]
    return dict(sorted(found.items()))
