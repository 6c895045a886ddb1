"""Exceptions (each also a built-in) and the status codes of kernels with their sentences."""

from enum import IntEnum


class JaxkinError(Exception):
    """Base of every exception that jaxkin raises on purpose."""


class GeometryError(JaxkinError, ValueError):
    """A geometry that defines no working mechanism."""


class InputError(JaxkinError, ValueError):
    """An argument of the wrong shape, name, range or text."""


class PrecisionError(JaxkinError, RuntimeError):
    """float64 is needed and not enabled."""


class StoreError(JaxkinError, FileExistsError):
    """A store or output folder that holds something else, or cannot be used.

    Attributes:
        may_pass: True where the same may succeed a moment later, as on a network disk that did not answer.
    """

    may_pass: bool = False


class ClusterError(JaxkinError, ConnectionError):
    """A cluster without workers, with workers of other versions, or that was lost."""


class SweepInterrupted(JaxkinError, KeyboardInterrupt):
    """A sweep stopped by the user.

    Attributes:
        dataset: What was computed so far; samples not reached hold each variable's ``missing_value``.
        samples_done: How many samples were computed.
    """

    def __init__(self, message: str, dataset, samples_done: int):
        super().__init__(message)
        self.dataset = dataset
        self.samples_done = samples_done


class InfeasibleWarning(UserWarning):
    """No design was found that keeps all requirements of a problem."""


class Status(IntEnum):
    """Why a lane of ``Branches`` holds what it holds. ``Status(code).sentence`` explains it to a person."""

    OK = 0
    SINGULAR = 1
    NO_REAL_SOLUTION = 2
    NOT_CONVERGED = 3
    OUTSIDE_LIMITS = 4
    INVALID_INPUT = 5
    INVALID_GEOMETRY = 6
    SELF_MOTION = 7
    COMPLETENESS_UNKNOWN = 8
    UNDECIDED = 9

    @property
    def sentence(self) -> str:
        """What happened, and the remedy where there is one."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.OK: "a regular solution",
    Status.SINGULAR: "a singular solution: as many solutions as its multiplicity coincide within the stated "
    "tolerance; derivatives do not exist there, so move the input off the singularity to differentiate",
    Status.NO_REAL_SOLUTION: "no real solution in this lane; where all lanes say so, the mechanism cannot be closed at "
    "these values: move them into the reachable range",
    Status.NOT_CONVERGED: "a candidate did not converge to the residual tolerance; scale the lengths to order "
    "one, or report the input as a bug",
    Status.OUTSIDE_LIMITS: "joint values outside the limits (a negative length is always outside); widen "
    "robot.limits or change the joints",
    Status.INVALID_INPUT: "the input is not a finite number, or larger than 1e60; remove NaN and infinite "
    "values, or choose another unit",
    Status.INVALID_GEOMETRY: "the geometry of the mechanism is degenerate or not finite; build it with the "
    "mechanism's constructor, which names what is wrong",
    Status.SELF_MOTION: "self-motion: a curve of solutions instead of isolated ones; change the joints or the geometry",
    Status.UNDECIDED: "float64 cannot decide the number of solutions: two nearly meet or just miss each other here; a "
    "lane that holds one solves the equations; move the input off the singularity to be sure",
    Status.COMPLETENESS_UNKNOWN: "found by a numerical search that cannot prove that it found all; an empty lane "
    "means that nothing more was found, not that nothing more is there",
}
