"""Problems in files: TOML that names a mechanism of the catalogue, what varies, what is wanted and what has to be kept.

``docs/problem_files.md`` has the format.
"""

import contextlib
import inspect
import json
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from jaxkin.core.errors import GeometryError, InputError
from jaxkin.core.mechanism import Mechanism
from jaxkin.core.words import meant
from jaxkin.design import conditioning, cusp_place, margins, places, regular, volumes
from jaxkin.design.objective import Objective, Requirement
from jaxkin.design.optimise import Options
from jaxkin.design.places import Place
from jaxkin.design.problem import Parameter, Problem
from jaxkin.mechanisms.catalogue import CATALOGUE, create
from jaxkin.sweep.grid import Grid

_OBJECTIVES: dict[str, Callable[..., Objective]] = {
    function.__name__: function
    for function in (
        conditioning.inverse_condition_number,
        conditioning.smallest_singular_value,
        conditioning.global_conditioning,
        regular.regular_size,
        regular.regular_workspaces,
        regular.singularity_distance,
        margins.limit_margin,
        margins.clearance,
        margins.needed_stroke,
        cusp_place.cusp_distance,
        cusp_place.cusp_coordinate,
        volumes.workspace_volume,
    )
}
_TOP = ("name", "robot", "vary", "places", "maximise", "minimise", "require", "optimiser")
_PLACES = ("poses", "box", "ball", "reach")
_BOUNDS = ("at_least", "at_most")


def read_problem(path: str | Path) -> tuple[Problem, dict[str, Any]]:
    """Reads a problem from a TOML file.

    Args:
        path: The file; ``docs/problem_files.md`` has its format.

    Returns:
        The problem, and keywords for ``jk.design.optimise``.

    Raises:
        PrecisionError: float64 is not enabled.
        InputError: The file cannot be read, is no TOML, or something in it has no meaning; the message names where.
        GeometryError: The geometry is degenerate.
    """
    content = _loaded(Path(path))
    with _told(str(path)):
        _check_keys("The file", content, _TOP)
        if not isinstance(content.get("name", ""), str):
            raise InputError(f"name is {content['name']!r}: it must be text, in quotation marks.")
        maker, asked = _maker(_table(content, "robot")), _sides(content)
        robot = maker.robot()
        varied = _table(content, "vary")
        parameters = {name: _parameter(f"[vary] {name}", given) for name, given in varied.items()}
        objectives = _Objectives(robot, _table(content, "places", needed=False))
        sides = {side: objectives.made(f"[{side}]", _table(content, side)) for side in asked}
        options = dict(_table(content, "optimiser", needed=False))
        _check_keys("[optimiser]", options, [field.name for field in fields(Options)])
        Options(**options)
        problem = Problem(
            robot,
            vary=parameters,
            subject_to=objectives.requirements(content.get("require", [])),
            build=maker.of(parameters),
            name=content.get("name", ""),
            **sides,
        )
    return problem, options


def _loaded(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is no TOML: {error}; correct it there.") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is no TOML: it is no text in UTF-8 ({error.reason}).") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}): give the file of a problem.") from None


@contextlib.contextmanager
def _told(where: str) -> Iterator[None]:
    """Says where in the file it is that something is wrong."""
    try:
        yield
    except (InputError, GeometryError) as error:
        raise type(error)(f"{where}: {error}") from error.__cause__


def _check_keys(where: str, table: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuses keys that mean nothing."""
    names = list(known)
    for key in table:
        if key not in names:
            raise InputError(f"{where} has no key {key!r}: choose among {', '.join(names)}{meant(key, names)}")


def _chosen(where: str, what: str, name: Any, known: Iterable[str]) -> str:
    """Returns a name that is one of the known ones."""
    names = list(known)
    if name in names:
        return name
    raise InputError(
        f"{where} names the {what} {name!r}: choose among {', '.join(names) or '(none)'}{meant(name, names)}"
    )


def _table(content: Mapping[str, Any], key: str, needed: bool = True) -> dict[str, Any]:
    if key not in content and needed:
        raise InputError(f"[{key}] is missing: a problem needs [robot], [vary], and [maximise] or [minimise]; add it.")
    table = content.get(key, {})
    if not isinstance(table, dict):
        raise InputError(f"{key} is {table!r}: it must be a table; write [{key}] and its keys below.")
    return table


def _sides(content: Mapping[str, Any]) -> list[str]:
    sides = [side for side in ("maximise", "minimise") if side in content]
    if len(sides) != 1:
        has = "both [maximise] and [minimise]" if sides else "neither [maximise] nor [minimise]"
        raise InputError(f"There is {has}: give one of them, and the other quantities as [[require]].")
    return sides


@dataclass(frozen=True)
class _Maker:
    """Makes a mechanism of the catalogue from a file's numbers.

    Attributes:
        mechanism: Its name in the catalogue.
        geometry: Arguments of its constructor.
        limits: Limits that are set on what the constructor makes.
    """

    mechanism: str
    geometry: dict[str, Any]
    limits: dict[str, Any]

    def robot(self, **varied: Any) -> Mechanism:
        """Makes it, with some arguments as they vary; traceable."""
        return create(self.mechanism, **{**self.geometry, **varied}).with_limits(**self.limits)

    def of(self, names: Iterable[str]) -> "_Build | None":
        """Returns what makes it from the arguments that vary, or None where only plain numbers do."""
        numbers = CATALOGUE[self.mechanism].geometry
        arguments = tuple(name for name in names if name in numbers and not isinstance(numbers[name], tuple))
        return _Build(self, arguments) if arguments else None


class _Build:
    """``Problem.build`` of a file: takes the arguments that vary, and tells requests what stays."""

    def __init__(self, maker: _Maker, arguments: tuple[str, ...]):
        self._maker = maker
        kinds = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY) for name in arguments]
        self.__signature__ = inspect.Signature(kinds)
        kept = {"geometry": maker.geometry, "limits": maker.limits}
        self.__qualname__ = f"{maker.mechanism} {json.dumps(kept, sort_keys=True)}"

    def __call__(self, **varied: Any) -> Mechanism:
        return self._maker.robot(**varied)


def _maker(table: dict[str, Any]) -> _Maker:
    _check_keys("[robot]", table, ("mechanism", "geometry", "limits"))
    mechanism = _chosen("[robot]", "mechanism", table.get("mechanism"), CATALOGUE)
    entry = CATALOGUE[mechanism]
    geometry, limits = (_table(table, key, needed=False) for key in ("geometry", "limits"))
    _check_keys("geometry of [robot]", geometry, (*entry.geometry, *entry.options))
    with _told("[robot]"):
        made = _Maker(mechanism, {key: _fixed(value) for key, value in geometry.items()}, {})
        joints = [name for names in made.robot().limit_fields().values() for name in names]
    _check_keys("limits of [robot]", limits, joints)
    return _Maker(mechanism, made.geometry, {key: _fixed(value) for key, value in limits.items()})


def _fixed(value: Any) -> Any:
    """Returns TOML's arrays as tuples."""
    return tuple(map(_fixed, value)) if isinstance(value, list) else value


def _parameter(where: str, given: Any) -> Any:
    if not isinstance(given, dict):
        return given
    _check_keys(where, given, [field.name for field in fields(Parameter)])
    for end in ("low", "high"):
        if end not in given:
            raise InputError(f"{where} has no {end!r}: a number that varies needs low and high.")
    return Parameter(**{key: _fixed(value) for key, value in given.items()})


class _Objectives:
    """Makes objectives; equal ones once, so that they are compiled once."""

    def __init__(self, robot: Mechanism, tables: dict[str, Any]):
        self._robot = robot
        self._places = {name: _place(robot, f"[places.{name}]", given) for name, given in tables.items()}
        self._made: dict[str, Objective] = {}

    def requirements(self, tables: Any) -> list[Requirement]:
        """Makes the requirements."""
        if not isinstance(tables, list) or not all(isinstance(one, dict) for one in tables):
            raise InputError("require must be a list of tables: write [[require]], with two brackets.")
        made = []
        for number, table in enumerate(tables, 1):
            where = f"[[require]] number {number}"
            bounds = {key: table[key] for key in _BOUNDS if key in table}
            if not bounds:
                raise InputError(f"{where} has no bound: give at_least or at_most.")
            objective = self.made(where, {key: value for key, value in table.items() if key not in bounds}, _BOUNDS)
            with _told(where):
                made += [getattr(objective, key)(value) for key, value in bounds.items()]
        return made

    def made(self, where: str, table: dict[str, Any], further: tuple[str, ...] = ()) -> Objective:
        """Makes one objective; ``further`` are keys that are told as known."""
        name = _chosen(where, "objective", table.get("objective"), _OBJECTIVES)
        given = {key: value for key, value in table.items() if key != "objective"}
        accepted = list(inspect.signature(_OBJECTIVES[name]).parameters.values())[1:]
        _check_keys(where, given, ["objective", *(one.name for one in accepted), *further])
        missing = [one.name for one in accepted if one.default is one.empty and one.name not in given]
        if missing:
            raise InputError(f"{where}: {name} needs {' and '.join(missing)}, which is not given: add it.")
        key = json.dumps([name, given], sort_keys=True, default=str)
        if key not in self._made:
            self._made[key] = self._new(where, name, given)
        return self._made[key]

    def _new(self, where: str, name: str, given: dict[str, Any]) -> Objective:
        arguments = dict(given)
        if "place" in given:
            arguments["place"] = self._places[_chosen(where, "place", given["place"], self._places)]
        with _told(where):
            if "section" in given:
                section = _table(given, "section")
                arguments["section"] = Grid(**{axis: _fixed(value) for axis, value in section.items()})
            try:
                return _OBJECTIVES[name](self._robot, **arguments)
            except TypeError as error:
                raise InputError(f"{name} got a value of a wrong kind ({error}): see its arguments.") from None


def _place(robot: Mechanism, where: str, given: Any) -> Place:
    """Makes a place of its table, which has one key."""
    if not isinstance(given, dict):
        raise InputError(f"{where} is {given!r}: it must be a table with one of {', '.join(_PLACES)}.")
    _check_keys(where, given, _PLACES)
    if len(given) != 1:
        raise InputError(f"{where} has {len(given)} of {', '.join(_PLACES)}: give exactly one.")
    with _told(where):
        if "poses" in given:
            return places.poses(robot, given["poses"])
        (kind,) = given
        table = dict(_table(given, kind))
        if kind == "reach":
            _check_keys("reach", table, ("n", "lane"))
            return places.reach(robot, table.get("n", 5), table.get("lane", 0))
        axes = [axis.name for axis in robot.pose_axes]
        _check_keys(kind, table, [*axes, "n", *(("center", "radius") if kind == "ball" else ())])
        samples = [table.pop("n")] if "n" in table else []
        if kind == "box":
            return places.box(robot, *samples, **table)
        for key in ("center", "radius"):
            if key not in table:
                raise InputError(f"ball has no {key!r}: it needs center, by axis name, and radius; add it.")
        center = _table({"center": table.pop("center")}, "center")
        return places.ball(robot, center, table.pop("radius"), *samples, **table)
