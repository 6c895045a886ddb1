"""What ``jk.aspects`` returns: aspects with their numbers, the cells behind them, and paths through these."""

import json
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from jax.typing import ArrayLike

from jaxkin.core.errors import InputError
from jaxkin.kinematics.boundary import checked_vector
from jaxkin.kinematics.legs import working_mode
from jaxkin.mapping._aspect_assembly import Charted, located_aspects
from jaxkin.mapping._aspect_paths import path_between
from jaxkin.mapping.named import NamedParts


@dataclass(frozen=True, eq=False)
class Aspect:
    """One aspect: a largest connected set of poses, with their joints, that holds no singularity.

    Attributes:
        name: For instance ``"det > 0"``, with the working mode and a number where there are several.
        sign: Sign of det A = det dF/dpose in it.
        working_mode: Signs of the diagonal of B = dF/djoints; one number, of the sheet, where equations hold several
            joints.
        volume: Of its poses, in the product of the free axes' units.
        error: Estimate of the volume's error.
        proved: Volume of the cells proved to lie in it: a lower bound; 0 where all was sampled.
        pose: ``(n_pose,)`` the pose of largest clearance that a search found, serial singularities kept off: there the
            smaller of the smallest singular value of dq/dx and four times that of dx/dq (scaled) is largest.
        joints: ``(n_joint,)`` its joints.
        clearance: Smallest singular value of -B^-1 A there, scaled by the characteristic length.
        touches_edge: True where it reaches an end of the grid beyond which the axis goes on: it may go on there, and
            join another one.
        cells: Number of cells proved to lie in it, or of nodes where all was sampled.
    """

    name: str
    sign: int
    working_mode: tuple[int, ...]
    volume: float
    error: float
    proved: float
    pose: np.ndarray
    joints: np.ndarray
    clearance: float
    touches_edge: bool
    cells: int

    @property
    def mode(self) -> str:
        """The working mode in words: one sign a leg, or the number of a sheet where equations hold several joints."""
        if self.name.startswith("sheet "):
            return f"sheet {self.working_mode[0]}"
        return " ".join(f"{sign:+d}"[0] for sign in self.working_mode)

    def __str__(self) -> str:
        """A summary of one line."""
        edge = ", reaches the edge of the grid" if self.touches_edge else ""
        volume = f"volume {self.volume:.8g} +- {self.error:.1g}"
        return f"{self.name}: {volume}, clearance {self.clearance:.4g} at its deepest{edge}"


@dataclass(frozen=True, eq=False)
class Slice:
    """Leaves of the cells that a plane cuts, for drawing.

    Attributes:
        axes: Names of the two axes.
        low: ``(k, 2)`` lower corners.
        high: ``(k, 2)`` upper corners.
        aspect: ``(k,)`` number of the aspect, -1 for cells not proved regular.
        working_mode: ``(k, n_joint)`` the sheet of each cell.
    """

    axes: tuple[str, str]
    low: np.ndarray
    high: np.ndarray
    aspect: np.ndarray
    working_mode: np.ndarray


@dataclass(frozen=True, eq=False)
class Aspects(NamedParts[Aspect]):
    """All aspects of a mechanism over a box of poses.

    Attributes:
        aspects: The aspects: by working mode, positive determinants first, largest first.
        doubts: What could change the count, one sentence each; empty where nothing is known that could.
        evidence: What speaks for the count, by name.
        request: What determines the numbers.
        pose_names: Names of the pose axes.
        joint_names: Names of the joint axes.
        units: Unit of every axis.
        free: Names of the free pose axes.
    """

    kind: ClassVar[str] = "aspects"

    aspects: tuple[Aspect, ...]
    doubts: tuple[str, ...]
    evidence: dict[str, Any]
    request: dict[str, Any]
    pose_names: tuple[str, ...]
    joint_names: tuple[str, ...]
    units: dict[str, str]
    free: tuple[str, ...]
    _charted: Charted = field(repr=False)

    @property
    def parts(self) -> tuple[Aspect, ...]:
        """The aspects."""
        return self.aspects

    @property
    def count(self) -> int:  # type: ignore[override]
        """Number of aspects."""
        return len(self.aspects)

    @property
    def volume(self) -> np.ndarray:
        """``(count,)`` volumes."""
        return np.array([aspect.volume for aspect in self.aspects])

    @property
    def error(self) -> np.ndarray:
        """``(count,)`` estimates of the volumes' errors."""
        return np.array([aspect.error for aspect in self.aspects])

    @property
    def sign(self) -> np.ndarray:
        """``(count,)`` signs of det A."""
        return np.array([aspect.sign for aspect in self.aspects], int)

    @property
    def touches_edge(self) -> np.ndarray:
        """``(count,)`` True where an aspect reaches an end of the grid."""
        return np.array([aspect.touches_edge for aspect in self.aspects], bool)

    def aspect_of(self, pose: ArrayLike, joints: ArrayLike | None = None) -> int:
        """Returns the number of the aspect that holds a configuration; -1 outside all, or where it is undecided.

        Args:
            pose: ``(n_pose,)``; fixed axes at their values.
            joints: ``(n_joint,)``, for the working mode; not needed where there is only one.

        Raises:
            InputError: Not so many numbers, fixed axes elsewhere, or no joints although there are several sheets.
        """
        sheet, point = self._placed(pose, joints)
        return int(located_aspects(self._charted, sheet, point[None])[0])

    def path(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        start_joints: ArrayLike | None = None,
        goal_joints: ArrayLike | None = None,
    ) -> np.ndarray | None:
        """Returns poses from one to another without a singularity between them, or None where there is no such path.

        The straight lines between consecutive poses lie in cells proved regular, but for those in undecided cells near
        either end, and lines through undecided cells by which components were joined; these are sampled. Glued angles
        run on continuously.

        Args:
            start: ``(n_pose,)``.
            goal: ``(n_pose,)``; a glued angle ends a whole number of turns from it.
            start_joints: Joints of the start, where there are several working modes.
            goal_joints: Joints of the goal.

        Returns:
            ``(k, n_pose)``, or None where the two are not in one aspect.

        Raises:
            InputError: As for ``aspect_of``.
        """
        sheet, first = self._placed(start, start_joints)
        other, last = self._placed(goal, goal_joints)
        if sheet != other:
            return None
        points = path_between(self._charted, sheet, first, last)
        if points is None:
            return None
        poses = np.tile(self._charted.fixed, (len(points), 1))
        poses[:, list(self._charted.free)] = points
        return poses

    def slice(self, **fixed: float) -> Slice:
        """Returns the cells that the plane at a value of one free axis cuts; with two free axes all of them.

        Args:
            fixed: ``axis=value`` for one of three free axes.

        Raises:
            InputError: Not exactly two axes remain, or an axis is not free.
        """
        for name in fixed:
            if name not in self.free:
                raise InputError(f"Aspects.slice: {name!r} is no free axis: choose among {', '.join(self.free)}.")
        rest = tuple(name for name in self.free if name not in fixed)
        if len(rest) != 2:
            raise InputError(
                f"Aspects.slice: {len(rest)} axes remain ({', '.join(rest)}): fix {len(self.free) - 2} of "
                f"{', '.join(self.free)} so that two remain."
            )
        places = {self.free.index(name): value for name, value in fixed.items()}
        keep = [self.free.index(name) for name in rest]
        low, high, aspect, sheet = self._charted.cut(places, keep)
        modes = np.array(self._charted.modes)
        return Slice((rest[0], rest[1]), low, high, aspect, modes[sheet])

    def _placed(self, pose: ArrayLike, joints: ArrayLike | None) -> tuple[int, np.ndarray]:
        """Returns the sheet and the free coordinates of a configuration."""
        robot = self._charted.robot
        given = checked_vector("Aspects", "the pose", pose, robot.pose_axes)
        vector = np.asarray(given)
        modes = self._charted.modes
        for k, name in enumerate(self.pose_names):
            if name not in self.free and abs(vector[k] - self._charted.fixed[k]) > 1e-9 * (1 + abs(vector[k])):
                raise InputError(
                    f"Aspects: {name} is {vector[k]:g}, but these aspects are of poses with {name} = "
                    f"{self._charted.fixed[k]:g}: ask for such a pose, or make aspects with {name} free."
                )
        sheet = 0
        if joints is not None:
            found = checked_vector("Aspects", "the joints", joints, robot.joint_axes)
            mode = np.asarray(working_mode(robot, self._charted.legs, given, found)).astype(int)
            sheet = modes.index(tuple(mode.tolist())) if tuple(mode.tolist()) in modes else -1
        elif len(modes) > 1:
            raise InputError(
                f"Aspects: the pose alone leaves {len(modes)} working modes open: give its joints as well."
            )
        return sheet, vector[list(self._charted.free)]

    def __str__(self) -> str:
        """A summary of a few lines."""
        unit = " x ".join(self.free)
        lines = [f"{self.count} aspects over {unit}" + ("" if self.doubts else ", no doubt known")]
        lines += [f"  [{k}] {aspect}" for k, aspect in enumerate(self.aspects)]
        lines += [f"  {name}: {value}" for name, value in self.evidence.items()]
        lines += [f"  DOUBT: {doubt}" for doubt in self.doubts]
        return "\n".join(lines)

    def to_json(self) -> str:
        """Returns everything but the cells as JSON text."""
        aspects = [
            {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in vars(aspect).items()}
            for aspect in self.aspects
        ]
        content = {
            "request": self.request,
            "pose_axes": list(self.pose_names),
            "joint_axes": list(self.joint_names),
            "units": self.units,
            "free": list(self.free),
            "count": self.count,
            "aspects": aspects,
            "doubts": list(self.doubts),
            "evidence": self.evidence,
        }
        return json.dumps(content, indent=2)
