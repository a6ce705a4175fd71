"""The configuration stored in a folder of results: its sweep, and the numbers of the cases' files.

The head of config.yaml says how many cases the sweep has, and their numbers where these do not run from 0.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from gfmdlayer.config import ConfigError, sweeps
from gfmdlayer.config.geometries import GEOMETRIES
from gfmdlayer.config.measures import ConfigMeasures
from gfmdlayer.config.model import Config, unit_label
from gfmdlayer.results.names import ResultsError
from gfmdlayer.validation import text
from gfmdlayer.validation.problems import InconsistentError
from gfmdlayer.validation.quantities import measured
from gfmdlayer.validation.sections import described
from gfmdlayer.validation.units import Units

MARK = "# Results of gfmdlayer: their configuration, every default written out.\n"
_CASES, _FILES = "# Cases: ", "# Files: "
_CASES_OF_RUN = re.compile(r"[0-9]{1,9}")


def head(numbers: Sequence[int]) -> str:
    """Return the head of a stored configuration, with the numbers of its cases."""
    files = f"{_FILES}{', '.join(_ranges(numbers))}\n"
    grown = any(number != place for place, number in enumerate(numbers))
    return f"{MARK}{_CASES}{len(numbers)}\n{files * grown}"


def is_stored(config: Path) -> bool:
    """Whether a file of YAML is the configuration of results."""
    with config.open("rb") as file:
        return file.readline() == MARK.encode()


def document(config: Path) -> dict[str, Any]:
    """Return the data of a stored configuration; works without the input files that it names.

    Swept numbers with units are converted: they are coordinates.
    """
    data = text.read(config.read_text(encoding="utf-8", errors="replace"), str(config)).data
    try:
        if isinstance(data, dict) and isinstance(sweep := data.get("sweep"), dict):
            with measured(ConfigMeasures(data)):
                return data | {"sweep": sweeps.with_numbers(sweep, lambda key: described(Config, key)[1])}
    except InconsistentError:
        data = None
    if not isinstance(data, dict):
        raise ResultsError(f"{config}: cannot be read; must be as the run wrote it")
    return data


def unit_of(config: Mapping[str, Any]) -> Callable[[str], str]:
    """Return how a stored configuration labels units; no file or code that it names is needed, or read."""
    given, trajectory, grid = (config.get(key) or {} for key in ("units", "trajectory", "grid"))
    try:
        units = Units(**given) if given else None
        geometry = GEOMETRIES[grid.get("geometry") or "periodic"]
        points, control = grid.get("points"), str(trajectory.get("control", "depth"))
    except (AttributeError, ConfigError, KeyError, TypeError):  # forged, or of another version
        return str
    is_line = geometry.on_grid and not (isinstance(points, list) and len(points) > 1)
    return partial(unit_label, units=units, control=control, is_line=is_line)


def case_numbers(config: Path) -> Sequence[int]:
    """Return the numbers of the cases in the order of the sweep, mostly from the head alone."""
    with config.open(encoding="utf-8", errors="replace") as file:
        _, cases, files = (file.readline().rstrip("\n") for _ in range(3))
    number = cases.removeprefix(_CASES)
    known = _CASES_OF_RUN.fullmatch(number)
    count = int(number) if known else sweeps.count(document(config).get("sweep") or {})
    if files.startswith(_FILES):
        numbers = list(islice(_numbers(files.removeprefix(_FILES)), count + 1))
        if len(numbers) == count:
            return numbers
    return range(count)


def must_agree(config: Path, numbers: Sequence[int], count: int) -> None:
    """Refuse a configuration of results that was changed: it names other cases than its sweep has."""
    if len(numbers) != count:
        counts = f"names {len(numbers)} cases, and its sweep has {count}"
        raise ResultsError(f"{config}: {counts}; must be as the run wrote it")


def _ranges(numbers: Sequence[int]) -> Iterator[str]:
    """Yield numbers as text: 0-2, 6, 3-5."""
    first = last = numbers[0]
    for number in (*numbers[1:], -1):
        if number != last + 1:
            yield str(first) if first == last else f"{first}-{last}"
            first = number
        last = number


def _numbers(ranges: str) -> Iterator[int]:
    """Yield the numbers of ranges, "0-3, 7"."""
    for part in ranges.split(","):
        first, _, last = part.strip().partition("-")
        yield from range(int(first), int(last or first) + 1)
