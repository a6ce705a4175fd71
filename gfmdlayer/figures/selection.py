"""Selection of the cases and columns that a figure shows, and notes on the others.

A selection is kept in attributes of the coordinates of the swept keys: `among`, the number of values before
it, and `asked`, the value that the user asked for. `notes` writes them below the figure.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

import numpy as np

from gfmdlayer.figures.labels import Quantity, quantity, symbol, value_labels
from gfmdlayer.results.names import OVER_TIME, SAME_TIME, ResultsError
from gfmdlayer.validation.problems import nearest

if TYPE_CHECKING:
    from pathlib import Path

    from xarray import DataArray, Dataset

Time = float | Literal["end", "max", "min"]
Wanted = str | float | tuple[float, float]
INTERPOLATED = "contact_area_interpolated"
MOST_NAMED = 3  # failed cases
SAME_VALUE = 1e-12  # relative difference of values that rounding tells apart
MOST_WARNINGS = 1  # below a figure


def swept(dataset: Dataset) -> list[DataArray]:
    """Return the coordinates of the swept keys, in the order swept; fixed ones have no dimension."""
    order = str(dataset.attrs.get("swept", "")).split()
    found = [coordinate for coordinate in dataset.coords.values() if "key" in coordinate.attrs]
    return sorted(found, key=lambda coordinate: order.index(coordinate.attrs["key"]))


def default_abscissa(dataset: Dataset) -> str:
    """Return time, or a swept key where each case has one row, as of steady states."""
    keys = [str(key.name) for key in swept(dataset) if key.ndim and key.dtype.kind in "if"]
    alone = all(dataset.sizes.get(name, 1) == 1 for name in ("time", "row"))
    return keys[0] if keys and alone else "time"


def case_dimensions(dataset: Dataset) -> list[str]:
    """Return the dimensions along which there are cases: the swept keys, or `case` for a list."""
    return [str(name) for name in dataset["case"].dims] if "case" in dataset.coords else []


def value_titles(coordinate: DataArray) -> list[str]:
    """Return the values of a swept key, each with its symbol and unit; a mapping has neither."""
    values = np.atleast_1d(coordinate.to_numpy()).tolist()
    if any("=" in str(value) for value in values):
        titles = zip(values, value_labels(values), quantity(coordinate).equals(values), strict=True)
        return [label if "=" in str(value) else title for value, label, title in titles]
    return quantity(coordinate).equals(values)


def case_titles(sweep: Dataset) -> dict[tuple[int, ...], str]:
    """Return a title, made of the swept values, for the case at each index of a sweep."""
    numbers = sweep["case"]
    titled = [
        (value_titles(coordinate), numbers.get_axis_num(coordinate.dims[0]))
        for coordinate in swept(sweep)
        if coordinate.ndim
    ]
    return {
        index: ", ".join(titles[index[axis]] for titles, axis in titled)
        for index in np.ndindex(numbers.shape)
    }


def select(sweep: Dataset, wanted: Mapping[str, Wanted]) -> Dataset:
    """Select cases by the values of swept keys.

    A value is a number, of which the nearest is taken; a range (from, to), or "from:to", with its ends; or a
    text, or a part of one.
    """
    for name, value in wanted.items():
        key = find_key(sweep, name)
        if key.ndim == 0:
            raise ResultsError(f"{name} is selected twice, as {key.name} and {key.attrs['key']}")
        sweep = chosen(sweep, key, *_places(key, value))
    return sweep


def find_key(sweep: Dataset, name: str) -> DataArray:
    """Return a swept key, named whole or as its dimension; ResultsError if it is not swept."""
    keys = {part: each for each in swept(sweep) for part in (str(each.name), str(each.attrs["key"]))}
    if name not in keys:
        known = ", ".join(str(each.name) for each in swept(sweep))
        must = f"must be one of {known}" if known else "there is no sweep"
        raise ResultsError(f"{name} is not swept; {must}{nearest(name, keys)}")
    return keys[name]


def chosen(sweep: Dataset, key: DataArray, places: Sequence[int], asked: str = "") -> Dataset:
    """Return the cases at some places along a swept key; a single place fixes the key.

    The dimension of a fixed key goes, except the dimension `case` of a list. `asked` is the value that the
    user asked for, if it is not one of them.
    """
    dimension = str(key.dims[0])
    is_held = len(places) == 1 and dimension != "case"
    taken = sweep.isel({dimension: places[0] if is_held else list(places)})
    counted = taken["case" if dimension == "case" else str(key.name)]
    counted.attrs = {"among": key.size, **counted.attrs}
    if asked:
        taken[key.name].attrs = {**taken[key.name].attrs, "asked": asked}
    return taken


def notes(dataset: Dataset, columns: Sequence[str] = ()) -> list[str]:
    """Return the notes below a figure: fixed values, cases not drawn, missing columns, warnings."""
    doubts = warnings_of(dataset)
    if "case" not in dataset.coords or not swept(dataset):
        return doubts
    fixed, parts = [], []
    for key in swept(dataset):
        among, asked = int(key.attrs.get("among", 1)), key.attrs.get("asked")
        said = [f"of {among} values"] * (among > 1) + [f"nearest to {asked}"] * (asked is not None)
        if key.ndim == 0:
            fixed.append(value_titles(key)[0] + (f" ({', '.join(said)})" if said else ""))
        elif "asked" in key.attrs:
            parts.append(f"{value_titles(key)[0]}, nearest to {asked}")
        elif key.size < among:
            parts.append(f"{key.size} of {among} values of {symbol(key)}")
    cases = dataset["case"]
    if cases.size < int(cases.attrs.get("among", 0)):
        parts.append(f"{cases.size} of {cases.attrs['among']} cases")
    if waiting := _titles(dataset, {*map(int, str(dataset.attrs.get("incomplete", "")).split())}):
        parts.append(f"{len(waiting)} of {cases.size} cases not complete yet: {_named(waiting)}")
    if lost := _titles(dataset, failed_numbers(dataset)):
        parts.append(f"{len(lost)} of {cases.size} case{'s' * (cases.size > 1)} failed: {_named(lost)}")
    drawn = {name.removesuffix(OVER_TIME) for name in columns}
    lines = str(dataset.attrs.get("notes", "")).splitlines()
    parts += [line for line in lines if drawn & set(line.partition(":")[0].split(", "))]
    return [*[f"fixed: {', '.join(fixed)}"] * bool(fixed), *parts, *doubts]


def warnings_of(dataset: Dataset) -> list[str]:
    """Return the first warnings of results, and how many there are more."""
    said = str(dataset.attrs.get("warnings", "")).splitlines()
    shown = [f"warning: {line}".replace("$", "\\$") for line in said[:MOST_WARNINGS]]
    more = len(said) - MOST_WARNINGS
    return shown + [f"{more} more warning{'s' * (more > 1)}"] * (more > 0)


def failed_numbers(sweep: Dataset) -> set[int]:
    """Return the numbers of the cases of a sweep that failed."""
    return {int(line.partition(":")[0]) for line in str(sweep.attrs.get("failed", "")).splitlines()}


def must_be_complete(path: Path, results: Dataset) -> None:
    """Raise ResultsError, with the first reason, if every case of a sweep failed."""
    lost = str(results.attrs.get("failed", "")).splitlines()
    if lost and "case" in results.coords and len(lost) == results["case"].size:
        raise ResultsError(f"{path}: no complete case to draw; all {len(lost)} failed: {lost[0]}")


def _titles(sweep: Dataset, lost: Collection[int]) -> list[str]:
    """Return the titles of cases, or their numbers."""
    numbers = sweep["case"].to_numpy()
    return [
        title or f"{numbers[at]:04d}" for at, title in case_titles(sweep).items() if int(numbers[at]) in lost
    ]


def _named(titles: Sequence[str]) -> str:
    more = len(titles) - MOST_NAMED
    return " | ".join(titles[:MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _places(key: DataArray, wanted: Wanted) -> tuple[list[int], str]:
    """Return the indices of the wanted values, and the value that was asked for if only others are near."""
    values = key.to_numpy()
    if values.dtype.kind not in "if":
        return _places_of_text([str(value) for value in values], str(wanted), str(key.name)), ""
    low, high = _ends(str(key.name), wanted)
    if low < high:
        places = np.flatnonzero((values >= low) & (values <= high)).tolist()
    else:
        near = low if low in values or not math.isfinite(low) else values[np.abs(values - low).argmin()]
        places = np.flatnonzero(values == near).tolist()
    if not places:
        known = ", ".join(dict.fromkeys(f"{value:g}" for value in values))
        sought = f"from {low:g} to {high:g}" if low < high else f"{low:g}"
        raise ResultsError(f"{key.name} has no value {sought}; it has {known}")
    is_near = low < high or np.isclose(values[places[0]], low, rtol=1e-9, atol=0)
    return places, "" if is_near else f"{low:g}"


def _places_of_text(values: list[str], wanted: str, name: str) -> list[int]:
    """Return the places of a text among the values, as a file or a figure writes them, or of a part of it."""
    shown = [label.replace("$", "") for label in value_labels(values)]
    both = list(zip(values, shown, strict=True))
    places = [i for i, pair in enumerate(both) if wanted in pair]
    places = places or [i for i, pair in enumerate(both) if any(wanted in text for text in pair)]
    if not places:
        known = " | ".join(dict.fromkeys(shown))
        raise ResultsError(f"{name} has no value {wanted!r}; must be one of {known}, or a part of it")
    return places


def _ends(name: str, wanted: Wanted) -> tuple[float, float]:
    """Return the ends of a range of values, both the same for a single value."""
    ends = wanted if isinstance(wanted, tuple) else str(wanted).split(":")
    try:
        low, high = (ends[0], ends[-1]) if len(ends) <= 2 else ("", "")
        found = _number(low or "-inf"), _number(high or "inf")
    except ValueError:
        found = math.inf, -math.inf
    if not found[0] <= found[1]:
        raise ResultsError(f"{name} got {wanted!r}; must be a number, or a range such as 0.1:0.5")
    return found


def _number(text: str | float) -> float:
    """Return a number, or a fraction as the figures write it: 1/32."""
    try:
        return float(text)
    except ValueError:
        return float(Fraction(str(text).replace(" ", "")))


def default_columns(dataset: Dataset) -> list[str]:
    """Return the columns that have a panel where no others are asked for.

    Under a prescribed load or force the depth replaces the mean pressure; where cases differ in the control,
    both are drawn.
    """
    names = ["contact_area", "mean_pressure", "friction", "temperature"]
    if INTERPOLATED in dataset.data_vars:
        names[names.index("contact_area")] = INTERPOLATED
    control, depth = dataset.attrs.get("control"), _own_name(dataset, "depth")
    is_swept = any(key.attrs["key"] == "trajectory.control" for key in swept(dataset))
    if "contact_radius" in dataset:
        own = (_own_name(dataset, name) for name in ("force", "depth", "contact_radius"))
        return [name for name in own if name in dataset.data_vars]
    if "area_interpolated" in dataset:
        force = _own_name(dataset, "force")
        drawn = [force, depth] if is_swept else [force if control in ("depth", "gap") else depth]
        return [_own_name(dataset, "area_interpolated"), *drawn]
    if depth in dataset.data_vars and (is_swept or control in ("load", "force")):
        at = names.index("mean_pressure")
        names[at : at + (0 if is_swept else 1)] = [depth]
    return [name for name in names if name in dataset.data_vars]


def rows(dataset: Dataset | DataArray) -> str:
    """Return the dimension of the rows: time, or row where the cases have times of their own."""
    return "row" if "row" in dataset.dims else "time"


def column_name(dataset: Dataset, name: str, *, of_cases: bool = False) -> str:
    """Return the name of a column, or of time, in the results; ResultsError if there is none.

    With `of_cases`, a number of each case of a sweep is allowed too.
    """
    along = {rows(dataset), *case_dimensions(dataset)}
    needed = set() if of_cases else {rows(dataset)}
    columns = [str(each) for each, column in dataset.data_vars.items() if needed <= {*column.dims} <= along]
    found = _own_name(dataset, name)
    if found not in ("time", *columns):
        known = ", ".join(["time", *columns])
        if found in dataset and (others := [str(each) for each in dataset[found].dims if each not in along]):
            has = f"{name} has values along {' and '.join(others)}, which no curve has"
            raise ResultsError(f"{has}; must be one of {known}")
        if found in dataset:
            raise ResultsError(
                f"{name} is one number of each case; give x a swept key, or take one of {known}"
            )
        raise ResultsError(f"there is no column {name}; must be one of {known}{nearest(name, columns)}")
    return found


def _own_name(dataset: Dataset, name: str) -> str:
    """Return the name of a column, which differs in a sweep over a key of this name."""
    return f"{name}{OVER_TIME}" if f"{name}{OVER_TIME}" in dataset.data_vars else name


_PLACES = ("interface", "frequency")  # dimensions beside time whose places have curves of their own


def each_place(dataset: Dataset, names: Sequence[str]) -> tuple[Dataset, list[str]]:
    """Give each interface, or frequency, a column of its own, interface_peel_0 for interface_peel."""
    parts: dict[str, list[DataArray]] = {}
    for place in _PLACES:
        if place in case_dimensions(dataset):  # swept
            continue
        for name, column in dataset.data_vars.items():
            if place in column.dims:
                parts[str(name)] = [
                    column.isel({place: i}, drop=True)
                    .rename(f"{name}_{i}")
                    .assign_attrs(place=f"{place} {value:g}")
                    for i, value in enumerate(column[place].values)
                ]
    single = {str(column.name): column for columns in parts.values() for column in columns}
    wanted = [[str(column.name) for column in parts[name]] if name in parts else [name] for name in names]
    return dataset.drop_vars(parts).assign(single), [column for group in wanted for column in group]


def with_values(dataset: Dataset, asked: Sequence[str], usual: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the columns to draw, those asked for or else the usual ones, and notes on those without a value.

    ResultsError if a column that was asked for, or every column, is NaN in all rows.
    """
    empty = [name for name in asked or usual if not dataset[name].notnull().any()]
    if empty and (asked or len(empty) == len(usual)):
        lost = str(dataset.attrs.get("failed", "")).splitlines()
        why = f"; {len(lost)} of {dataset['case'].size} cases failed: {lost[0]}" if lost else ""
        raise ResultsError(f"{', '.join(empty)}: no value to draw, NaN in every row{why}")
    shown = [name for name in asked or usual if name not in empty]
    return shown, [f"{', '.join(empty)}: no value in any row".replace("_", " ")] * bool(empty)


def varying(dataset: Dataset, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the columns that vary over rows and cases, all if none does, and notes with the other values."""
    ends = {name: (float(dataset[name].min()), float(dataset[name].max())) for name in names}
    same = [name for name, (low, high) in ends.items() if high - low <= SAME_VALUE * abs(high)]
    if len(same) == len(names):
        return list(names), []
    held = {name: quantity(dataset[name], dataset.attrs) for name in same}
    said = [each.equals([float(f"{ends[name][1] / each.scale:.6g}")])[0] for name, each in held.items()]
    left = [name for name in names if name not in same]
    left = [name for name in left if not _is_swept(dataset, name)] or left  # the legend has it
    return left, [f"constant: {', '.join(said)}"] * bool(said)


def _is_swept(dataset: Dataset, name: str) -> bool:
    """Whether a column only repeats a swept number, as a temperature that does not change within a case."""
    column, keys = dataset[name], (key for key in swept(dataset) if key.dtype.kind in "if")
    same = (abs(column - key) <= SAME_VALUE * abs(key) for key in keys)
    return any(bool(each.where(column.notnull(), True).all()) for each in same)


def at_time(dataset: Dataset, name: str, time: Time | None) -> tuple[DataArray, str]:
    """Return a column at a time, by default at the end of each case, or its extreme; and words for the time.

    It is taken from the nearest row of each case; after its end a case has no value.
    """
    column, along, times = dataset[name].load(), rows(dataset), dataset["time"]
    if along not in column.dims:
        return column, ""
    clock, held = quantity(times, dataset.attrs), column.notnull()
    if time in ("max", "min"):
        return getattr(column, str(time))(along), f"{time}. over {clock.symbol}"
    if time in (None, "end"):
        at, otherwise = held.cumsum(along).argmax(along), "at the end of each case"
    else:
        asked = min(float(time or 0), float(times.max()))
        at = abs(times - asked).fillna(np.inf).argmin(along)
        column = column.where(times.max(along) * (1 + SAME_TIME) >= asked)
        otherwise = f"rows nearest to {_when(clock, asked)}"
    found = column.isel({along: at.variable})
    seen = times.isel({along: at.variable}).where(found.notnull())
    first, last = float(seen.min()), float(seen.max())
    is_one = last - first <= SAME_TIME * last
    ended = int((held.any(along) & found.isnull()).sum())
    over = f"; {ended} case{'s' * (ended > 1)} ended before" * (ended > 0)
    return found, (_when(clock, last) if is_one else otherwise) + over


def _when(clock: Quantity, time: float) -> str:
    return clock.equals([float(f"{time / clock.scale:.4g}")])[0]
