"""Columns of measured data by their names: frequency in Hz, moduli in tension, tan delta.

    omega = 2 pi f,      G = E/(2 (1 + nu)),      G'' = G' tan delta

with Poisson's ratio nu, which is taken as constant over frequency and time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from gfmdlayer.arrays import FloatArray

# Patterns of a name without its unit, in small letters.
_NAMES = {
    "omega": r"omega|w|ω|angular[ _]frequency",
    "frequency": r"f|nu|freq|frequency|hz",
    "time": r"t|time",
    "storage": r"([ge])('|′|_?prime|_?storage)|storage([ _]modulus)?",
    "loss": r"([ge])(''|\"|″|′′|_?(double|dbl)_?prime|_?loss)|loss([ _]modulus)?",
    "tan": r"tan[ _]?\(?(d|delta|δ)\)?|tand|loss[ _](factor|tangent)",
    "relaxation": r"([ge])(\(t\))?|modulus",
}
_UNIT = re.compile(r"\s*(\[[^\]]*\]|\((?!t\)|d\)|delta\)|δ\))[^)]*\)|/\s*(?!tan).*)\s*$")

MASTER, RELAXATION = ("omega", "storage", "loss"), ("time", "relaxation")
WAYS = "omega or f with two of G', G'', tan delta; or t, G; E for G in tension"


def recognised(header: str) -> tuple[str, ...] | None:
    """Return the quantities of the columns that a line names, E in front of moduli in tension.

    Parameters
    ----------
    header : str
        The line, with commas, semicolons, tabs or at least two spaces between names, or one.

    Returns
    -------
    tuple of str, optional
        None where a name is not that of a quantity.
    """
    apart = re.search(r"[,;\t]|\S\s{2,}\S", header)
    separated = re.split(r"[,;\t]|\s{2,}", header) if apart else header.split()
    found = [quantity(name) for name in separated]
    return None if None in found else tuple(map(str, found))


def quantity(name: str) -> str | None:
    """Return the quantity of a column by its name, or None; E in front of a modulus in tension."""
    plain = name.strip().strip('"') if name.strip().startswith('"') else name.strip()
    in_hertz = re.search(r"\bhz\b", plain.lower()) is not None
    plain = _UNIT.sub("", plain.lower()).strip()
    for found, pattern in _NAMES.items():
        if match := re.fullmatch(pattern, plain):
            tension = "E " if match.re.groups and match[1] == "e" else ""
            return tension + ("frequency" if in_hertz and found == "omega" else found)
    return None


def is_relaxation_time(name: str) -> bool:
    """Whether a column is named as the relaxation times of a series: tau, tau_k [s], τ."""
    plain = _UNIT.sub("", name.strip().strip('"').lower()).strip()
    return re.fullmatch(r"(tau|τ)([ _]?[ikn]|_relax)?|relaxation[ _]times?", plain) is not None


def symbols(quantities: Sequence[str]) -> tuple[str, ...]:
    """Return the quantities as messages write them: omega, E', tan delta."""
    plain = {
        "frequency": "f",
        "time": "t",
        "storage": "G'",
        "loss": "G''",
        "tan": "tan delta",
        "relaxation": "G",
    }
    written = (plain.get(each.removeprefix("E "), each) for each in quantities)
    tension = (each.startswith("E ") for each in quantities)
    return tuple(
        text.replace("G", "E") if is_E else text for text, is_E in zip(written, tension, strict=True)
    )


def names_one_curve(quantities: Sequence[str]) -> bool:
    """Whether columns are those of one master curve or relaxation curve."""
    plain = {each.removeprefix("E ") for each in quantities}
    master = len(plain & {"omega", "frequency"}) == 1 and len(plain & {"storage", "loss", "tan"}) == 2
    return len(quantities) == len(plain) and ((master and len(plain) == 3) or plain == {*RELAXATION})


def converted(quantities: Sequence[str], rows: FloatArray, poisson: float) -> FloatArray:
    """Return angular frequency, storage and loss modulus in shear, or time and relaxation modulus.

    Parameters
    ----------
    quantities : sequence of str
        Of the columns, which name one curve.
    rows : ndarray, shape (rows, columns)
        The data.
    poisson : float
        Poisson's ratio, for moduli in tension.

    Returns
    -------
    ndarray, shape (rows, 3) or (rows, 2)
    """
    known = {}
    for each, values in zip(quantities, rows.T, strict=True):
        tension = each.startswith("E ")
        known[each.removeprefix("E ")] = values / (2 * (1 + poisson)) if tension else values
    if "time" in known:
        return np.column_stack([known["time"], known["relaxation"]])
    if "frequency" in known:
        known["omega"] = 2 * math.pi * known["frequency"]
    if "storage" not in known:
        known["storage"] = known["loss"] / known["tan"]
    if "loss" not in known:
        known["loss"] = known["storage"] * known["tan"]
    return np.column_stack([known[each] for each in MASTER])
