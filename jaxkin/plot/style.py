"""Colours, labels and ticks that all figures share."""

import math
import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, Locator, MaxNLocator

from jaxkin.core.errors import InputError

#: Okabe and Ito's palette, told apart by all common kinds of colour vision.
OKABE_ITO = {
    "black": "#000000",
    "orange": "#E69F00",
    "sky": "#56B4E9",
    "green": "#009E73",
    "yellow": "#F0E442",
    "blue": "#0072B2",
    "vermillion": "#D55E00",
    "purple": "#CC79A7",
}

#: Numbers of solutions; 2 green, 4 yellow, 6 red as in Wenger and Chablat 2009, Fig. 3, and 0 white.
COUNT_COLOURS = {
    0: "#FFFFFF",
    2: OKABE_ITO["green"],
    4: OKABE_ITO["yellow"],
    6: OKABE_ITO["vermillion"],
    8: OKABE_ITO["sky"],
    10: OKABE_ITO["purple"],
    12: OKABE_ITO["blue"],
}
#: Numbers without a colour of their own: odd ones, on singular surfaces.
OTHER_COUNT = "#777777"

#: Other counts, from 0; beyond the last, and odd numbers of solutions, are grey.
TALLY_COLOURS = (
    "#FFFFFF",
    *(OKABE_ITO[c] for c in ["sky", "green", "orange", "yellow", "purple", "vermillion", "blue"]),
)

#: Signs of the direct determinant.
SIGN_COLOURS = {1: OKABE_ITO["blue"], -1: OKABE_ITO["vermillion"], 0: OKABE_ITO["black"]}

_GREEK = ("rho", "phi", "theta", "sigma", "alpha", "beta", "gamma", "psi", "mu", "eta")


def count_colour(number: int) -> str:
    """Returns the colour of a number of solutions."""
    return COUNT_COLOURS.get(number, OTHER_COUNT)


def tally_colour(number: int) -> str:
    """Returns the colour of a count of anything but solutions."""
    return TALLY_COLOURS[number] if 0 <= number < len(TALLY_COLOURS) else OTHER_COUNT


def number(value: float) -> str:
    """Returns a number with three decimals and a proper minus sign."""
    return f"{value + 0.0:.3f}".replace("-", "−")


def symbol(name: str) -> str:
    """Returns an axis name or a short expression as a formula: ``rho1x``, ``R22``, ``z + h``, ``cos(theta)``.

    Names that are words stay words: ``base_radius``, ``proximal[0]``, ``rho1_low``.
    """
    if "_" in name or "[" in name or (len(name) > 2 and name.isalpha() and name not in _GREEK):
        return words(name)
    function = re.fullmatch(r"(cos|sin|tan)\((\w+)\)", name)
    if function is not None:
        return rf"$\{function[1]}{symbol(function[2]).strip('$')}$"
    if " " in name:
        return f"${' '.join(symbol(part).strip('$') for part in name.split())}$"
    match = re.fullmatch(r"([A-Za-z]+?)(\d+[a-z]?)?", name)
    if match is None:
        return name
    stem, index = match.groups()
    stem = rf"\{stem}" if stem in _GREEK else stem
    return f"${stem}_{{{index}}}$" if index else f"${stem}$"


def greek(name: str) -> str:
    """Returns the name of a Greek letter as a formula, other texts as they are."""
    return symbol(name) if name in _GREEK else name


def words(text: str) -> str:
    """Returns words with formulas in place of the names in them, as in ``"rho1x_low"`` or ``"upper, z > -h"``."""
    text = text.replace("_", " ").replace(" -", " −")
    return re.sub(r"\b([A-Za-z]+\d+[a-z]?|[b-zB-Z])\b", lambda match: symbol(match[0]), text)


def value(name: str, number: float) -> str:
    """Returns ``name = number`` with four digits and a proper minus sign."""
    return f"{symbol(name)} = {round(number, 12) + 0.0:.4g}".replace("-", "−")


def in_lines(texts: Iterable[str]) -> str:
    """Returns texts on one line, or on two if they are many."""
    texts = list(texts)
    half = len(texts) if len(texts) <= 3 else (len(texts) + 1) // 2
    return "\n".join(", ".join(part) for part in (texts[:half], texts[half:]) if part)


def check_kind(given: Any, kinds: type | tuple[type, ...], needed: str) -> None:
    """Refuses what cannot be drawn.

    Args:
        given: An argument.
        kinds: What it may be.
        needed: The same in words, and where to get it.

    Raises:
        InputError: It is something else.
    """
    if not isinstance(given, kinds):
        raise InputError(f"Cannot draw an object of type {type(given).__name__}: give {needed}.")


def with_unit(text: str, unit: str) -> str:
    """Returns a text with its unit in parentheses, if it has one."""
    return f"{text} ({unit.replace('^2', '²').replace('^3', '³')})" if unit not in ("", "1") else text


def axis_label(name: str, unit: str) -> str:
    """Returns a label with its unit."""
    return with_unit(symbol(name), unit)


def dress(ax: Axes, x: tuple[str, str], y: tuple[str, str]) -> None:
    """Labels both axes, given as (name, unit); equal aspect where the units agree, ticks in pi for angles."""
    ax.set_xlabel(axis_label(*x))
    ax.set_ylabel(axis_label(*y))
    for (_, unit), axis in ((x, ax.xaxis), (y, ax.yaxis)):
        if unit == "rad":
            ticks_in_pi(axis)
    if x[1] == y[1] and x[1] != "rad":
        ax.set_aspect("equal")


def ticks_in_pi(axis: Axis) -> None:
    """Gives an axis ticks at multiples of pi / 2, and decimal ones where there are fewer than three of those."""
    axis.set_major_locator(_AngleLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: _angle(value)))


#: An axis has so many ticks, except that many turns have the larger number at most.
_LEAST_TICKS, _MOST_TICKS = 3, 9


class _AngleLocator(Locator):
    """Ticks of an axis in radians."""

    def __call__(self) -> list[float]:
        return self.tick_values(*self.axis.get_view_interval())  # type: ignore[union-attr]

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        low, high = sorted((vmin, vmax))
        step = math.pi / 2
        while (high - low) / step > _MOST_TICKS - 1 + 1e-9:
            step *= 2
        ticks = step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
        if len(ticks) >= _LEAST_TICKS:
            return ticks.tolist()
        return list(MaxNLocator(5, steps=[1, 2, 5, 10], min_n_ticks=_LEAST_TICKS).tick_values(low, high))


def _angle(value: float) -> str:
    if abs(value - round(2 * value / math.pi) * math.pi / 2) < 1e-9:
        return _in_pi(value)
    return f"{round(value, 12):g}".replace("-", "−")


def _in_pi(value: float) -> str:
    halves = round(2 * value / math.pi)
    if halves == 0:
        return "0"
    sign = "−" if halves < 0 else ""
    count, half = abs(halves), abs(halves) % 2
    if half:
        return f"{sign}{'' if count == 1 else count}π/2"
    return f"{sign}{'' if count == 2 else count // 2}π"
