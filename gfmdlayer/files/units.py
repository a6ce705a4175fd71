"""Units of measurement by their symbols and names: size in SI, and dimension.

The only table of units in the package: tables of users, force curves, topographies and the section `units` of
a configuration read it. Radians count as a dimension, so that angular and ordinary frequencies differ. Sizes
are exact fractions (but for degrees and turns, which contain pi): a conversion by a power of ten is rounded
once.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction
from functools import cache
from typing import NamedTuple

# Powers of mass, length, time, temperature, electric current, angle and amount of substance.
Dimension = tuple[int, int, int, int, int, int, int]


class Unit(NamedTuple):
    """A unit: value in SI = value * size + offset."""

    size: Fraction
    dimension: Dimension
    offset: Fraction = Fraction(0)  # of degrees Celsius and Fahrenheit


PREFIXES = {
    "a": -18, "f": -15, "p": -12, "n": -9, "u": -6, "m": -3, "": 0, "k": 3, "M": 6, "G": 9, "T": 12,
    "c": -2, "d": -1, "h": 2,
}  # fmt: skip
_PREFIX_WORDS = {
    "pico": -12,
    "nano": -9,
    "micro": -6,
    "milli": -3,
    "centi": -2,
    "kilo": 3,
    "mega": 6,
    "giga": 9,
}

_NONE: Dimension = (0, 0, 0, 0, 0, 0, 0)
_LENGTH: Dimension = (0, 1, 0, 0, 0, 0, 0)
_TIME: Dimension = (0, 0, 1, 0, 0, 0, 0)
_FORCE: Dimension = (1, 1, -2, 0, 0, 0, 0)
_STRESS: Dimension = (1, -1, -2, 0, 0, 0, 0)
_KELVIN: Dimension = (0, 0, 0, 1, 0, 0, 0)
_ANGLE: Dimension = (0, 0, 0, 0, 0, 1, 0)
_OHM: Dimension = (1, 2, -3, 0, -2, 0, 0)
# Units that take prefixes. Viscosities and moments are often written without a space: mPas, mNm.
_METRIC: dict[str, tuple[str, Dimension]] = {
    "m": ("1", _LENGTH), "s": ("1", _TIME), "g": ("1e-3", (1, 0, 0, 0, 0, 0, 0)), "N": ("1", _FORCE),
    "Pa": ("1", _STRESS), "bar": ("1e5", _STRESS), "Hz": ("1", (0, 0, -1, 0, 0, 0, 0)), "K": ("1", _KELVIN),
    "A": ("1", (0, 0, 0, 0, 1, 0, 0)), "V": ("1", (1, 2, -3, 0, -1, 0, 0)),
    "J": ("1", (1, 2, -2, 0, 0, 0, 0)),
    "W": ("1", (1, 2, -3, 0, 0, 0, 0)), "rad": ("1", _ANGLE), "dyn": ("1e-5", _FORCE),
    "ohm": ("1", _OHM), "Ω": ("1", _OHM), "mol": ("1", (0, 0, 0, 0, 0, 0, 1)),
    "Pas": ("1", (1, -1, -1, 0, 0, 0, 0)),
    "Nm": ("1", (1, 2, -2, 0, 0, 0, 0)),
}  # fmt: skip
_WORDS = {
    "meter": "m", "metre": "m", "second": "s", "newton": "N", "pascal": "Pa", "hertz": "Hz", "volt": "V",
    "dyne": "dyn",
}  # fmt: skip
_POUND = Fraction("4.4482216152605")  # of force, in N
_INCH = Fraction("0.0254")
_PSI = _POUND / _INCH**2
_TURN = Fraction(2 * math.pi)
# Units without prefixes.
_SINGLE: dict[str, tuple[Fraction | str, Dimension]] = {
    "%": ("0.01", _NONE), "percent": ("0.01", _NONE), "1": ("1", _NONE),
    "sec": ("1", _TIME), "msec": ("1e-3", _TIME), "min": ("60", _TIME), "h": ("3600", _TIME),
    "hr": ("3600", _TIME),
    "d": ("86400", _TIME), "yr": ("31557600", _TIME), "minute": ("60", _TIME), "hour": ("3600", _TIME),
    "day": ("86400", _TIME), "sekunde": ("1", _TIME), "sekunden": ("1", _TIME), "minuten": ("60", _TIME),
    "stunden": ("3600", _TIME),
    "angstrom": ("1e-10", _LENGTH), "Å": ("1e-10", _LENGTH), "micron": ("1e-6", _LENGTH),
    "in": (_INCH, _LENGTH),
    "inch": (_INCH, _LENGTH), "mil": ("25.4e-6", _LENGTH), "ft": ("0.3048", _LENGTH),
    "gf": ("9.80665e-3", _FORCE), "kgf": ("9.80665", _FORCE), "kp": ("9.80665", _FORCE),
    "lbf": (_POUND, _FORCE),
    "psi": (_PSI, _STRESS), "ksi": (1000 * _PSI, _STRESS), "Msi": (10**6 * _PSI, _STRESS),
    "atm": ("101325", _STRESS),
    "kelvin": ("1", _KELVIN), "°": (_TURN / 360, _ANGLE), "deg": (_TURN / 360, _ANGLE),
    "degree": (_TURN / 360, _ANGLE),
    "radian": ("1", _ANGLE), "rev": (_TURN, _ANGLE), "U": (_TURN, _ANGLE),
    "rpm": (_TURN / 60, (0, 0, -1, 0, 0, 1, 0)),
    "rps": (_TURN, (0, 0, -1, 0, 0, 1, 0)),
}  # fmt: skip
_FAHRENHEIT = Fraction(5, 9)
_CELSIUS = Unit(Fraction(1), _KELVIN, Fraction("273.15"))
_TEMPERATURES = {
    **dict.fromkeys(("C", "°C", "ºC", "℃", "° C", "degC", "deg C", "deg. C", "Grad C"), _CELSIUS),
    **dict.fromkeys(("celsius", "degrees Celsius"), _CELSIUS),
    **dict.fromkeys(("°F", "degF", "deg F"), Unit(_FAHRENHEIT, _KELVIN, Fraction("459.67") * _FAHRENHEIT)),
}
# Prefixes and symbols in the wrong case that have one meaning: Kpa is kPa, but mpa may be mPa or MPa.
_MISWRITTEN = [
    (r"\b[kK]p[aA]\b|\bKPa\b|\bKPA\b", "kPa"), (r"\bM(pa|PA)\b", "MPa"),
    (r"\bG(pa|PA)\b", "GPa"), (r"\b[kK][hH][zZ]\b", "kHz"),
    (r"\b(hz|HZ)\b", "Hz"),
    (r"\brads(?=\^?-)", "rad s"),
]  # fmt: skip

_PLAIN = str.maketrans("µμ\u2126⁻−–⁰¹²³⁴⁵⁶·⋅×∙*", "uuΩ---0123456.....")
_FACTOR = r"([^\W\d_]+|°|%|1(?!\d))(?:(?:\^|(?<!1))(?:\(([-+]?\d+)\)|([-+]?\d+)))?"
_MARKS = r"\s*([/.()]|\s)\s*"


@cache
def unit_of(text: str) -> Unit | None:
    """Return the unit of a text, such as nm, N/mm², Pa·s, s^-1, rad/s, °C, % or "-"; None for others."""
    text = text.strip()
    if text in _TEMPERATURES or text.lower() == "celsius":
        return _TEMPERATURES.get(text, _CELSIUS)
    if text in {"-", "–", "—"}:
        return Unit(Fraction(1), _NONE)
    plain = (
        re.sub(r"[\s_]per[\s_]", "/", text)
        .replace("_", " ")
        .replace("**", "^")
        .replace("^{", "^(")
        .replace("}", ")")
        .translate(_PLAIN)
    )
    for pattern, symbol in _MISWRITTEN:
        plain = re.sub(pattern, symbol, plain)
    if "%" in plain and plain != "%":
        return None  # the mark of a comment before a unit
    if plain.startswith("/"):
        plain = f"1{plain}"
    found, end = _product(plain, 0)
    return found if end == len(plain) else None


def _product(text: str, at: int) -> tuple[Unit | None, int]:
    """Read factors up to the end or a closing bracket; return their product, and where they end."""
    size, powers, sign, factors = Fraction(1), list(_NONE), 1, 0
    while at < len(text) and text[at] != ")":
        if text[at] == "(":
            inner, at = _product(text, at + 1)
            if inner is None or at >= len(text):
                return None, at
            at += 1
            power = re.compile(r"\^?([-+]?\d)").match(text, at)
            exponent, at = (int(power[1]), power.end()) if power else (1, at)
        else:
            match = re.match(_FACTOR, text[at:])
            inner = _symbol(match[1]) if match else None
            if match is None or inner is None:
                return None, at
            exponent, at = int(match[2] or match[3] or 1), at + match.end()
        if abs(exponent) > 9:
            return None, at
        exponent, factors = exponent * sign, factors + 1
        size *= inner.size**exponent
        powers = [old + exponent * new for old, new in zip(powers, inner.dimension, strict=True)]
        mark = re.match(_MARKS, text[at:])
        if mark and mark[1] not in "()":
            sign, at = -1 if mark[1] == "/" else 1, at + mark.end()
            if at == len(text):
                return None, at
    a, b, c, d, e, f, g = powers
    return (Unit(size, (a, b, c, d, e, f, g)) if factors else None), at


@cache
def _symbol(text: str) -> Unit | None:
    """Return the unit of a symbol with its prefix, or of a word."""
    word = text.lower().removesuffix("s") if len(text) > 3 else text  # seconds, minutes
    for name in (text, word):
        if name in _SINGLE:
            size, dimension = _SINGLE[name]
            return Unit(Fraction(size), dimension)
    for symbol, (scale, dimension) in _METRIC.items():
        prefix = text.removesuffix(symbol)
        allowed = ("", "m", "u") if symbol == "rad" else PREFIXES  # Grad is German for a degree
        if text.endswith(symbol) and prefix in allowed:
            return Unit(Fraction(scale) * Fraction(10) ** PREFIXES[prefix], dimension)
    for name, symbol in _WORDS.items():
        prefix = word.removesuffix(name)
        if word.endswith(name) and (not prefix or prefix in _PREFIX_WORDS):
            scale, dimension = _METRIC[symbol]
            return Unit(Fraction(scale) * Fraction(10) ** _PREFIX_WORDS.get(prefix, 0), dimension)
    return None


def alike(text: str) -> list[str]:
    """Return the units that differ from a text in the case of letters only: mPa and MPa for mpa."""
    every = (f"{prefix}{symbol}" for symbol in _METRIC for prefix in PREFIXES)
    return [symbol for symbol in every if symbol.lower() == text.lower() and symbol != text]
