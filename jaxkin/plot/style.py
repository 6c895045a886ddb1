"""Colours, labels and ticks that all figures share."""

import math
import re

from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.ticker import FuncFormatter, MultipleLocator

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

#: Signs of the direct determinant.
SIGN_COLOURS = {1: OKABE_ITO["blue"], -1: OKABE_ITO["vermillion"], 0: OKABE_ITO["black"]}

_GREEK = ("rho", "phi", "theta", "sigma", "alpha", "beta", "gamma", "psi", "mu", "eta")


def count_colour(number: int) -> str:
    """Returns the colour of a number of solutions."""
    return COUNT_COLOURS.get(number, OTHER_COUNT)


def number(value: float) -> str:
    """Returns a number with three decimals and a proper minus sign."""
    return f"{value + 0.0:.3f}".replace("-", "−")


def symbol(name: str) -> str:
    """Returns an axis name or a short expression as a formula: ``rho1x``, ``R22``, ``z + h``, ``cos(theta)``."""
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


def words(text: str) -> str:
    """Returns words with formulas in place of the names in them, as in ``"rho1x_low"`` or ``"upper, z > -h"``."""
    text = text.replace("_", " ").replace(" -", " −")
    return re.sub(r"\b([A-Za-z]+\d+[a-z]?|[b-zB-Z])\b", lambda match: symbol(match[0]), text)


def value(name: str, number: float) -> str:
    """Returns ``name = number`` with four digits and a proper minus sign."""
    return f"{symbol(name)} = {round(number, 12) + 0.0:.4g}".replace("-", "−")


def axis_label(name: str, unit: str) -> str:
    """Returns a label with its unit."""
    return f"{symbol(name)} ({unit})" if unit and unit != "1" else symbol(name)


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
    """Gives an axis ticks at multiples of pi / 2."""
    axis.set_major_locator(MultipleLocator(math.pi / 2))
    axis.set_major_formatter(FuncFormatter(lambda value, _: _in_pi(value)))


def _in_pi(value: float) -> str:
    halves = round(2 * value / math.pi)
    if halves == 0:
        return "0"
    sign = "−" if halves < 0 else ""
    count, half = abs(halves), abs(halves) % 2
    if half:
        return f"{sign}{'' if count == 1 else count}π/2"
    return f"{sign}{'' if count == 2 else count // 2}π"
