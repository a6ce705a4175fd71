"""Labels of the figures: symbols of variables and swept keys, swept values and times.

Symbols of swept keys come from the attribute `symbol` of the results, those of other variables from there or
from the paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from gfmdlayer.observables import known_columns

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

PAPER_SYMBOLS = {
    **{name: column.symbol for name, column in known_columns().items() if column.symbol},
    "displacement": "u",
    "pressure": "p",
    "x": "x",
    "y": "y",
}


def symbol(array: DataArray) -> str:
    """Return the symbol of a variable or swept key as mathtext, or its name in words if it has no symbol."""
    if "symbol" in array.attrs:
        return f"${mathtext(array.attrs['symbol'])}$"
    name = str(array.name)
    return f"${PAPER_SYMBOLS[name]}$" if name in PAPER_SYMBOLS else name.replace("_", " ")


def mathtext(plain: str) -> str:
    r"""Write a symbol of plain text, such as G_inf, nu_bulk or dt, as mathtext."""
    letter, _, index = plain.partition("_")
    if letter == "dt":
        letter = r"\Delta t"
    elif len(letter) > 1 and letter.isalpha():
        letter = f"\\{letter}"
    if len(index) > 1:
        index = r"\infty" if index == "inf" else rf"\mathrm{{{index}}}"
    return f"{letter}_{index}" if index else letter


def time_axis(dataset: Dataset) -> tuple[str, float]:
    """Return label and unit of the time axis: tau if the results have one, else the config's unit of time."""
    tau = dataset.attrs.get("tau")
    return (r"$t$", 1.0) if tau is None else (r"$t/\tau$", float(tau))


def case_titles(sweep: Dataset) -> dict[tuple[int, ...], str]:
    """Return a title, made of the swept values, for the case at each index of a sweep."""
    numbers = sweep["case"]
    order = str(sweep.attrs.get("swept", "")).split()
    swept = [coordinate for coordinate in sweep.coords.values() if "key" in coordinate.attrs]
    swept.sort(key=lambda coordinate: order.index(coordinate.attrs["key"]))
    titled = [(value_titles(coordinate), numbers.get_axis_num(coordinate.dims[0])) for coordinate in swept]
    return {
        index: ", ".join(titles[index[axis]] for titles, axis in titled)
        for index in np.ndindex(numbers.shape)
    }


def value_titles(coordinate: DataArray) -> list[str]:
    """Return the values of a swept key, each with the symbol."""
    return [f"{symbol(coordinate)} = {label}" for label in value_labels(coordinate.to_numpy().tolist())]


def value_labels(values: Sequence[object]) -> list[str]:
    """Write values for a legend, all in the same way.

    If all values are whole numbers or plain fractions they are written as 1/32, or 1/3 where the value has
    all digits of it. Infinity is written as its sign, large numbers with powers of ten, text as it is.
    """
    numbers = [float(str(value)) for value in values if not isinstance(value, str)]
    if len(numbers) < len(values):
        return [str(value) for value in values]
    fractions = [_fraction(number) for number in numbers if math.isfinite(number)]
    is_fractional = None not in fractions and any(
        fraction is not None and fraction.denominator not in (1, 2, 4) for fraction in fractions
    )
    return [_number_label(number, is_fractional) for number in numbers]


def _fraction(number: float) -> Fraction | None:
    """Return the plain fraction that a number stands for, or None."""
    fraction = Fraction(number).limit_denominator(1024)
    is_binary = fraction.denominator & (fraction.denominator - 1) == 0
    has_many_digits = len(repr(abs(number)).strip("0.")) > 10
    return fraction if float(fraction) == number and (is_binary or has_many_digits) else None


def _number_label(number: float, is_fractional: bool) -> str:
    if math.isinf(number):
        return r"$\infty$" if number > 0 else r"$-\infty$"
    if is_fractional:
        return str(_fraction(number))
    mantissa, _, exponent = f"{number:.6g}".partition("e")
    if not exponent and (abs(number) < 1e4 or number % 1000):
        return mantissa
    mantissa, _, exponent = f"{number:.5e}".partition("e")
    mantissa = mantissa.rstrip("0").rstrip(".")
    power = f"10^{{{int(exponent)}}}"
    return f"${power}$" if mantissa == "1" else rf"${mantissa}\times {power}$"
