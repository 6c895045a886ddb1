"""What a singularity map is made of: curves, crossings, and how they are summed up."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, overload

import numpy as np

if TYPE_CHECKING:
    import xarray


#: Entries of the evidence that are zero where all searches agree.
DISAGREEMENTS = ("of these on no traced curve", "contradictory pieces", "cusp poses on no traced curve")
_DOUBT = "  DOUBTFUL: the searches disagree; try more samples, another range, or a section a little apart"


class _OverSection:
    """What results over a section share beside their own content."""

    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any]

    @property
    def complete(self) -> bool:
        """False where the searches disagree or a tracer was lost: see ``evidence``. True is no proof."""
        return not any(self.evidence.get(name) for name in DISAGREEMENTS)

    def _summary(self, lines: list[str]) -> str:
        lines = [*lines, *(f"  {name}: {value}" for name, value in self.evidence.items())]
        return "\n".join(lines if self.complete else [*lines, _DOUBT])

    def _json(self, **own: Any) -> str:
        content = {
            "request": self.request,
            "joint_axes": list(self.joint_names),
            "pose_axes": list(self.pose_names),
            "units": self.units,
            **own,
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)


@dataclass(frozen=True)
class Curve:
    """A piece of the singular set over a section, in order along the curve.

    Attributes:
        joints: ``(k, n_joint)`` joint values; a glued joint that runs over its whole period in one turn, so that it
            jumps where the curve crosses the seam (``numpy.unwrap`` makes it continuous).
        poses: ``(k, n_pose)`` the singular pose over each, angles in [-pi, pi); NaN on a virtual curve.
        closed: True where the last point is followed by the first (which is not repeated).
        residual: Largest dimensionless residual of the equations along the curve.
        label: Factor of the singularity, or name of the closed form, that vanishes here; "" where there is none. Over
            poses also ``det A`` or ``det B, leg k``, and the working mode where there are several (signs of the legs'
            entries of B, 0 for the leg that is singular), and ``self-motion`` where the joints stand still.
        virtual: True where the polynomial vanishes but the pose is complex: no singular pose, no change of count.
        ends: What the curve ends on, for instance ``("rho3 = 4", "crossing")``; two empty texts where closed. Over
            poses ``"det B, leg k"`` where the curve goes on in the working mode with that leg's other sign.
    """

    joints: np.ndarray
    poses: np.ndarray
    closed: bool
    residual: float
    label: str = ""
    virtual: bool = False
    ends: tuple[str, str] = ("", "")

    def __len__(self) -> int:
        """Number of points."""
        return len(self.joints)


@dataclass(frozen=True)
class Crossings:
    """Points where the singular set crosses itself: the gradient of the determinant vanishes. They are no cusps.

    Attributes:
        joints: ``(n, n_joint)``.
        poses: ``(n, n_pose)``.
        residual: ``(n,)`` dimensionless.
    """

    joints: np.ndarray
    poses: np.ndarray
    residual: np.ndarray

    def __len__(self) -> int:
        """Number of crossings."""
        return len(self.joints)


@dataclass(frozen=True)
class SingularCurves(_OverSection, Sequence[Curve]):
    """All singular curves of a section of the joint space or of the workspace.

    Attributes:
        curves: The curves, longest first.
        crossings: Where they cross in pose space.
        request: What determines the numbers: mechanism, geometry, section, method.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for completeness, by name.
        self_motions: Curves of singular poses over one joint point each: the mechanism moves with its joints locked.
    """

    curves: tuple[Curve, ...]
    crossings: Crossings
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)
    self_motions: tuple[Curve, ...] = ()

    @overload
    def __getitem__(self, index: int) -> Curve: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Curve, ...]: ...
    def __getitem__(self, index: int | slice) -> Curve | tuple[Curve, ...]:
        """Returns one curve, or a tuple of them."""
        return self.curves[index]

    def __len__(self) -> int:
        """Number of curves."""
        return len(self.curves)

    def __iter__(self) -> Iterator[Curve]:
        """Runs over the curves."""
        return iter(self.curves)

    @property
    def residual(self) -> float:
        """Largest dimensionless residual of all points."""
        return max((curve.residual for curve in (*self.curves, *self.self_motions)), default=0.0)

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free axes."""
        return tuple(name for name, value in self.request["section"].items() if isinstance(value, list))

    def __str__(self) -> str:
        """A summary of a few lines."""
        closed = sum(curve.closed for curve in self.curves)
        virtual = sum(curve.virtual for curve in self.curves)
        lines = [
            f"{len(self)} singular curves over {', '.join(self.free)} ({closed} closed, {virtual} virtual), "
            f"{sum(map(len, self.curves))} points, {len(self.crossings)} crossings, residual {self.residual:.1e}"
        ]
        lines += [
            f"  {curve.label or 'curve'}: {len(curve)} points, "
            + ("closed" if curve.closed else f"from {curve.ends[0]} to {curve.ends[1]}")
            + (", virtual" if curve.virtual else "")
            for curve in self.curves
        ]
        lines += [
            f"  self-motion at {coordinates(self.joint_names, motion.joints[0])}: {len(motion)} poses"
            for motion in self.self_motions
        ]
        return self._summary(lines)

    def to_dataset(self) -> "xarray.Dataset":
        """Returns all points in one table: dimension ``point``, with the number of their curve."""
        import xarray

        numbers = np.concatenate([np.full(len(c), k) for k, c in enumerate(self.curves)] or [np.zeros(0, int)])
        columns: dict[str, Any] = {"curve": ("point", numbers)}
        for names, which in ((self.joint_names, "joints"), (self.pose_names, "poses")):
            points = np.concatenate([getattr(c, which) for c in self.curves] or [np.zeros((0, len(names)))])
            columns |= {n: ("point", points[:, k], {"units": self.units[n]}) for k, n in enumerate(names)}
        attributes = {
            "curve_label": json.dumps([c.label for c in self.curves]),
            "curve_closed": json.dumps([c.closed for c in self.curves]),
            "curve_virtual": json.dumps([c.virtual for c in self.curves]),
            "request": json.dumps(self.request),
        }
        return xarray.Dataset(columns, attrs=attributes)

    def to_json(self) -> str:
        """Returns everything as JSON text; complex poses are null."""
        curves, motions = ([_plain(c) for c in part] for part in (self.curves, self.self_motions))
        crossings = {"joints": self.crossings.joints.tolist(), "poses": self.crossings.poses.tolist()}
        return self._json(curves=curves, crossings=crossings, self_motions=motions)


def _plain(curve: Curve) -> dict[str, Any]:
    return {
        "label": curve.label,
        "closed": curve.closed,
        "virtual": curve.virtual,
        "ends": list(curve.ends),
        "residual": curve.residual,
        "joints": curve.joints.tolist(),
        "poses": None if curve.virtual else curve.poses.tolist(),
    }


@dataclass(frozen=True)
class Other:
    """A point at which the cusp equations hold, and that is no cusp.

    Attributes:
        kind: ``"crossing"`` (the gradient of det A vanishes), ``"isolated point"`` (the same, and the singular set
            is this point alone), ``"self-motion"`` (a curve of singular poses over this one joint point),
            ``"swallowtail or higher"`` (the third coefficient vanishes as well), or ``"double kernel"`` (A loses two
            ranks).
        joints: ``(n_joint,)``.
        pose: ``(n_pose,)``.
    """

    kind: str
    joints: np.ndarray
    pose: np.ndarray


@dataclass(frozen=True)
class Cusps(_OverSection):
    """All cusps of a section: joint points at which three assembly modes meet in one pose.

    Attributes:
        joints: ``(n, n_joint)``, one row a distinct joint point.
        poses: n arrays ``(k_i, n_pose)``: the triple poses over each (two for the analytic 3-RPR).
        residual: ``(n,)`` largest dimensionless residual of the constraints, det A and the second coefficient.
        error: ``(n,)`` estimated error of the joint values, in their unit: how far Newton's method, started
            nearby again, ends apart.
        third: ``(n,)`` smallest third coefficient w (F_xxx v v v - 3 F_xx v A+ F_xx v v) over the poses,
            dimensionless (rows of A of order one): not zero where no more than three solutions meet.
        others: What satisfies the cusp equations and is none, by name.
        request: What determines the numbers.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        evidence: What speaks for completeness, by name.
    """

    joints: np.ndarray
    poses: tuple[np.ndarray, ...]
    residual: np.ndarray
    error: np.ndarray
    third: np.ndarray
    others: tuple[Other, ...]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    evidence: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        """Number of distinct joint points."""
        return len(self.joints)

    def __str__(self) -> str:
        """A summary of a few lines."""
        lines = [f"{len(self)} cusps, {sum(map(len, self.poses))} triple poses"]
        for k, (joints, poses) in enumerate(zip(self.joints, self.poses, strict=True)):
            quality = (
                f"error {self.error[k]:.0e}, residual {self.residual[k]:.0e}, third coefficient {self.third[k]:.2g}"
            )
            lines.append(f"  [{k}] {coordinates(self.joint_names, joints)}  ({quality})")
            lines += [f"      {coordinates(self.pose_names, pose)}" for pose in poses]
        lines += [f"  no cusp, {other.kind}: {coordinates(self.joint_names, other.joints)}" for other in self.others]
        return self._summary(lines)

    def to_json(self) -> str:
        """Returns everything as JSON text."""
        found = [
            {
                "joints": joints.tolist(),
                "poses": poses.tolist(),
                "residual": float(self.residual[k]),
                "error": float(self.error[k]),
                "third_coefficient": float(self.third[k]),
            }
            for k, (joints, poses) in enumerate(zip(self.joints, self.poses, strict=True))
        ]
        others = [{"kind": o.kind, "joints": o.joints.tolist(), "pose": o.pose.tolist()} for o in self.others]
        return self._json(cusps=found, others=others)


def coordinates(names: tuple[str, ...], values: np.ndarray) -> str:
    """Writes a point as text, to 15 digits."""
    return ", ".join(f"{name} = {value:.15g}" for name, value in zip(names, values, strict=True))
