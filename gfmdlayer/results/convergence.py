"""The estimated errors of a case as a file, `convergence.h5`, and as words.

    estimate: case, column, moment, value, scale, error, verdict, order_seen, order_expected, richardson, note
    (estimate, source): errors, shares of each source in the error; orders of each
    run: source, case, size, cost, seconds, and values (estimate, run) of the numbers in each run

Errors are in the units of their column. A moment is `end`, `peak` (the largest magnitude), a time, or
`worst`: the largest error at common times, relative to the largest value of the column.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.files.whole import unfinished
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.netcdf import naming
from gfmdlayer.results.reader import ESTIMATES, open_labelled

if TYPE_CHECKING:
    import xarray

FILE = ESTIMATES
COUNTED_NOTE = "counted by points: the interpolated area is surer"


@dataclass(frozen=True)
class ErrorReport:
    """How sure the numbers of a case are.

    Attributes
    ----------
    data : xarray.Dataset
        All estimates along `estimate`, their parts along `source`, and the runs along `run`.
    suggested : dict
        Dotted keys and their values, with which the errors are estimated to be below `to`.
    notes : tuple of str
        What the estimates cannot see, and why some are missing.
    failed : tuple of str
        Variations that failed.

    Examples
    --------
    >>> config = {"grid": {"points": 96}, "time": {"end": 1.0, "step": 0.25}}
    >>> sure = gfmdlayer.converge(config, columns=["force"])
    >>> bool(0 < sure["force"] < 0.1 * sure.data["scale"][0])
    True
    """

    data: xarray.Dataset

    @property
    def suggested(self) -> dict[str, Any]:
        """Keys and values for the asked accuracy."""
        found: dict[str, Any] = json.loads(self.data.attrs["suggested"])
        return found

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not estimated, or not seen, and why."""
        return tuple(str(self.data.attrs["notes"]).splitlines())

    @property
    def failed(self) -> tuple[str, ...]:
        """Variations that failed, with their reasons."""
        return tuple(str(self.data.attrs["failed"]).splitlines())

    def __getitem__(self, column: str) -> float:
        """Return the largest error of a column over moments and cases, in its units."""
        held = self.data["error"].where(self.data["column"] == column)
        if column not in self.data["column"]:
            raise KeyError(column)
        return float(held.max())

    def __str__(self) -> str:
        """Return the table and the answer in words."""
        return "\n".join((*self.table(), "", *self.words()))

    def table(self) -> list[str]:
        """Return a line for each estimate."""
        data, cases = self.data, [*dict.fromkeys(self.data["case"].to_numpy().tolist())]
        sources = [str(name) for name in data["source"].to_numpy() if name != "images"]
        width = max([6, *(len(str(name)) for name in data["column"].to_numpy())])
        heads = [f"{'column':{width}}  {'at':6}  {'value':>11}  {'sure to':>8}"]
        lines = ["  ".join([*heads, *(f"{name:>9}" for name in sources), "order (expected)"])]
        for case in cases:
            lines += [f"case {case}"] if len(cases) > 1 else []
            own = data.isel(estimate=data["case"].to_numpy() == case)
            prescribed = own["verdict"].to_numpy() == "prescribed"
            kept = own.isel(estimate=~prescribed)
            lines += [self._row(kept.isel(estimate=i), sources, width) for i in range(kept.sizes["estimate"])]
            names = dict.fromkeys(own["column"].to_numpy()[prescribed].tolist())
            lines += [f"prescribed: {', '.join(names)}"] if names else []
        return lines

    @staticmethod
    def _row(one: xarray.Dataset, sources: list[str], width: int) -> str:
        scale = float(one["scale"])

        def part(error: float) -> str:
            return "" if math.isnan(error) else f"{error / scale:.1e}" if error else "0"

        value, seen = float(one["value"]), float(one["order_seen"])
        verdict, expected = str(one["verdict"].to_numpy()), float(one["order_expected"])
        order = f"{seen:.1f}" if math.isfinite(seen) and verdict in ("order", "off") else verdict
        parts = {name: float(one["errors"].sel(source=name)) for name in sources}
        first = f"{one['column'].to_numpy()!s:{width}}  {one['moment'].to_numpy()!s:6}"
        shown = f"{value:11.5g}" if math.isfinite(value) else " " * 11
        ends = f"{order} ({expected:.2g})" if math.isfinite(expected) else verdict
        cells = [
            first,
            shown,
            f"{part(float(one['error'])):>8}",
            *(f"{part(parts[name]):>9}" for name in sources),
        ]
        return "  ".join([*cells, ends]).rstrip()

    def words(self) -> list[str]:
        """Return the answer in words: the largest error, where it comes from, and what to take."""
        data = self.data
        lines = [
            "97 of 100 errors are below `sure to`, a part of the largest value, nearly all"
            " below three times it.",
        ]
        relative = (data["error"] / data["scale"]).to_numpy()
        if not np.isfinite(relative).any():
            return ["No error can be estimated.", *self._endings()]
        # Of counted areas, which are interpolated better, only where nothing else is asked for.
        among = np.where(data["note"].to_numpy() == COUNTED_NOTE, np.nan, relative)
        relative = among if np.isfinite(among).any() else relative
        worst = data.isel(estimate=int(np.nanargmax(relative)))
        parts = {
            str(n): float(worst["errors"].sel(source=n)) for n in data["source"].to_numpy() if n != "images"
        }
        most = max(parts, key=lambda name: np.nan_to_num(parts[name], nan=-1.0))
        label, moment = str(worst["case"].to_numpy()), str(worst["moment"].to_numpy())
        where = f", worst in {label}" if label else ""
        head = f"{worst['column'].to_numpy()} ({moment}) {np.nanmax(relative):.1e}{where}"
        lines.append(f"Largest: {head}, most of it from {most}.")
        return [*lines, *self._endings()]

    def _endings(self) -> list[str]:
        attrs = self.data.attrs
        keys = ", ".join(f"{key}: {_shown(value)}" for key, value in self.suggested.items())
        to = f"{attrs['to']:g}"
        answer = f"All columns are within {to}, as far as they are estimated."
        if keys:
            answer = f"For {to} in all columns take {keys}, {attrs['suggested_cost']:.2g} times the cost."
        cost = f"{attrs['runs']} runs, {attrs['work']:.2g} times the work of the case beside it."
        failed = [f"failed: {line}" for line in self.failed]
        return [answer, cost, *self._images(), *(f"note: {line}" for line in self.notes), *failed]

    def _images(self) -> list[str]:
        """Return by how much the periodic images shift each column: no part of its error."""
        data = self.data
        if "images" not in data["source"]:
            return []
        shifts = (data["errors"].sel(source="images") / data["scale"]).to_numpy()
        names, most = data["column"].to_numpy(), dict[str, float]()
        for name, shift in zip(names.tolist(), shifts.tolist(), strict=True):
            if shift > 1e-12:  # not NaN, nor prescribed
                most[name] = max(shift, most.get(name, 0.0))
        listed = ", ".join(f"{name} {shift:.1e}" for name, shift in most.items())
        return [f"images: without the periodic images {listed} different (not in the sum)."] if listed else []

    def as_json(self) -> dict[str, Any]:
        """Return the estimates as plain data: of each column its worst moment, and the suggestion."""
        data, columns = self.data, dict[str, Any]()
        relative = (data["error"] / data["scale"]).to_numpy()
        for i, name in enumerate(data["column"].to_numpy().tolist()):
            before = columns.get(name)
            if before is not None and not relative[i] > before["relative"]:
                continue
            one = data.isel(estimate=i)
            errors = {str(s): float(one["errors"].sel(source=s)) for s in data["source"].to_numpy()}
            columns[name] = {
                "value": _number(one["value"]),
                "error": _number(one["error"]),
                "relative": float(relative[i]) if relative[i] == relative[i] else None,
                "at": str(one["moment"].to_numpy()),
                "case": str(one["case"].to_numpy()),
                "sources": {s: error for s, error in errors.items() if math.isfinite(error)},
                "verdict": str(one["verdict"].to_numpy()),
                "note": str(one["note"].to_numpy()),
            }
        more = {name: data.attrs[name] for name in ("to", "runs", "work")}
        more |= {"suggested": self.suggested, "notes": list(self.notes), "failed": list(self.failed)}
        return {"columns": columns, **{k: v.item() if hasattr(v, "item") else v for k, v in more.items()}}

    def write(self, path: Path) -> None:
        """Write the file; ResultsError if it cannot be written."""
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            with unfinished(path, ".h5") as part:
                self.data.to_netcdf(part, engine="h5netcdf")


def _number(value: Any) -> float | None:
    return float(value) if math.isfinite(float(value)) else None


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def open_convergence(path: str | Path) -> ErrorReport:
    """Open the file, or that of a results folder; ResultsError if there is none."""
    path = Path(path)
    file = path / FILE if path.is_dir() else path
    if not file.is_file():
        raise ResultsError(f"{path}: no {FILE}; `gfmdlayer converge` writes it")
    with open_labelled(file) as data:
        if "errors" not in data or "suggested" not in data.attrs:
            raise ResultsError(f"{file}: holds no estimates of errors; `gfmdlayer converge` writes them")
        return ErrorReport(data.load())
