"""Units of measured columns, as headings write them, and their sizes in metres, seconds and newtons."""

from __future__ import annotations

import re

from gfmdlayer.config import ConfigError
from gfmdlayer.validation.units import Units

Sizes = tuple[float, float, float]
PREFIXES = {
    "": 1.0, "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "c": 1e-2,
    "k": 1e3, "M": 1e6,
}  # fmt: skip
BASES = {"time": {"s": 1.0, "sec": 1.0, "min": 60.0, "h": 3600.0}, "depth": {"m": 1.0}, "force": {"N": 1.0}}
COLUMNS = ("time", "depth", "force")
_NAMES = {
    "time": {"t", "time"},
    "depth": {"d", "depth", "indentation", "delta", "displacement"},
    "force": {"f", "force", "load", "p"},
}
_HEADING = re.compile(r"\s*([^(\[/]*?)\s*(?:[(\[/]\s*([^)\]]*?)\s*[)\]]?)?\s*")


def size_of(unit: str, column: str) -> float | None:
    """Return the size of a unit of a column in SI; None where it is none."""
    for base, size in BASES[column].items():
        if unit.endswith(base) and unit[: -len(base)] in PREFIXES:
            prefix = unit[: -len(base)]
            if prefix and base in {"min", "h", "sec"}:
                continue
            return PREFIXES[prefix] * size
    return None


def parse_heading(heading: str) -> tuple[str | None, str]:
    """Return the column that a heading names, if it does, and its unit: ``Force (nN)`` is force and nN."""
    found = _HEADING.fullmatch(heading.strip().strip("\"'"))
    word, unit = (found[1], found[2] or "") if found else (heading, "")
    last = re.split(r"[\s_]+", word.strip().lower())
    for column, names in _NAMES.items():
        if word.strip().lower() in names or last[0] in names:
            return column, unit
    return None, unit


def in_si(units: Units | None) -> Sizes:
    """Return the sizes in SI of the units of time, length and force of a model; 1 where it has none.

    Raises
    ------
    ConfigError
        A unit is not metric.
    """
    if units is None:
        return 1.0, 1.0, 1.0
    time, length = size_of(units.time, "time"), size_of(units.length, "depth")
    stress = PREFIXES.get(units.stress.removesuffix("Pa")) if units.stress.endswith("Pa") else None
    if time is None or length is None or stress is None:
        metric = "metric, such as um, kPa and s, for curves with units"
        raise ConfigError([f"units: got {units}; must be {metric}"])
    return time, length, stress * length**2


def allowed(column: str) -> str:
    """Name the units of a column."""
    return {"time": "s, ms, min or h", "depth": "m, mm, um or nm", "force": "N, mN, uN, nN or pN"}[column]
