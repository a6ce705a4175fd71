"""`gfmdlayer.converge`: how sure each number of a case is.

The variations of a case (`variants`) are a sweep by combinations, and run as one: in a results folder, by one
process or several, resumable. Then its columns are compared (`estimates`), and the errors of all sources add
up. Of a sweep the corners and the middle are varied.
"""

from __future__ import annotations

import json
import math
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gfmdlayer.case.model import model_of
from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.config.reader import from_python
from gfmdlayer.convergence.estimates import LOWEST, PRESCRIBED, ErrorOfValue, estimate
from gfmdlayer.convergence.variants import (
    COUNTED,
    Values,
    Variations,
    corners,
    expected_order,
    is_smooth,
)
from gfmdlayer.files.locks import read_json
from gfmdlayer.interactive.run import History, Punch, chosen_display, configuration, on_disk, pool_of
from gfmdlayer.observables import totals
from gfmdlayer.results.convergence import COUNTED_NOTE, FILE, ErrorReport
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import open_case
from gfmdlayer.study import interrupts
from gfmdlayer.study.cases import Cases, SweepCase, checked, label
from gfmdlayer.study.cost import estimate as cost_of
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.progress import Display
from gfmdlayer.study.run import RunOptions, run_study
from gfmdlayer.study.workers import WorkerPool
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import nearest

if TYPE_CHECKING:
    import xarray

    from gfmdlayer.arrays import BoolArray, FloatArray

PARTS = 3  # common times in each stretch of the trajectory
SAME_TIME = 1e-6  # of the end
FEW_POINTS = {1: 16, 2: 100}  # in contact, below which the estimates may be too small
UNRESOLVED = 1 / 3  # error over the largest value, beyond which a number says nothing
SHARE = 0.05  # of the error, above which a source takes part in the suggestion
MARGIN = 2.0  # of the asked accuracy
MOST = 4.0  # times as many points in one suggestion: no order reaches further
FINEST = 1e-9  # tolerance that is suggested
MOMENTS = ("end", "peak", "worst")
# Measures of the numerics themselves, which have no error.
NUMERICS = frozenset({"time", "residual", "contact_area_error", "area_error", "energy_residual"})
MOST_QUARTERS = 64  # of periods of an oscillation, at whose ends runs are compared
VARIANTS = "convergence"  # folder of the runs


@dataclass(frozen=True)
class AskedErrors:
    """The columns and moments whose errors are asked for, and the accuracy."""

    columns: tuple[str, ...] = ()  # all of them, if empty
    moments: tuple[str | float, ...] = MOMENTS
    to: float = 1e-3  # of the largest value

    @property
    def times(self) -> list[float]:
        """The moments that are times."""
        return [float(moment) for moment in self.moments if not isinstance(moment, str)]


@dataclass(frozen=True)
class Run:
    """What the comparison reads of a run."""

    time: FloatArray
    columns: Mapping[str, FloatArray]
    attrs: Mapping[str, Any]

    @property
    def work(self) -> float:
        """Points times FFT pairs; seconds where there are none."""
        pairs = self.columns.get("transforms")
        if pairs is None:
            return float(self.attrs["wall_seconds"])
        return float(np.sum(pairs)) * float(self.attrs["points"])

    def at(self, column: str, times: FloatArray) -> FloatArray:
        """Return a column at times; NaN where there is no row."""
        t, values = self.time, self.columns[column]
        i = np.minimum(np.searchsorted(t, times - 1e-9 * t[-1]), len(t) - 1)
        return np.where(np.abs(t[i] - times) <= SAME_TIME * t[-1], values[i], np.nan)

    def peak(self, column: str) -> float:
        """Return the largest magnitude of a column."""
        finite = np.abs(self.columns[column][np.isfinite(self.columns[column])])
        return float(finite.max()) if finite.size else math.nan


@entry()
def converge(
    config: str | Path | Mapping[str, Any] | Config,
    columns: str | Sequence[str] = (),
    at: str | float | Sequence[str | float] = MOMENTS,
    to: float = 1e-3,
    *,
    punch: Punch | None = None,
    history: History | None = None,
    out: str | Path | None = None,
    keep: bool = False,
    progress: bool | None = None,
    jobs: int = 1,
    threads: int | None = None,
    trust: bool = False,
    **values: object,
) -> ErrorReport:
    """Estimate how sure each number of a case is.

    One numerical choice at a time is varied: points, on coarser grids; time step or tolerance, tolerances of
    the solver and of laws, on half the points; the period of an isolated contact. All runs beside the case
    together take about 1.7 times its work on a surface, and 3.3 times on a line.

    Parameters
    ----------
    config : path, mapping or Config
        As of `gfmdlayer.run`. Of a sweep the corners and the middle are varied.
    columns : str or sequence of str, optional
        Columns of the results; by default all that are numbers at each time.
    at : str, float, or sequence of these
        Moments: end, peak (the largest magnitude), worst (the largest error at common times), or times.
    to : float
        Accuracy for which numerical choices are suggested, relative to the largest value of each column.
    punch, history, progress, jobs, threads, trust, **values : as of `gfmdlayer.run`
        The error of points is unknown for heights that are given for each point.
    out : path, optional
        Results folder: `convergence.h5` is written there, and a stopped run goes on.
    keep : bool
        Whether the results of all runs are kept, in the folder `convergence` there.

    Returns
    -------
    ErrorReport
        Errors by column, moment and source; printed, they are a table and an answer in words.

    Raises
    ------
    ConfigError
        If the configuration cannot be used, or there is no such column or moment.
    ResultsError
        If the case itself failed.
    FolderError
        If `out` cannot be used.

    Examples
    --------
    >>> config = {"grid": {"points": 128}, "time": {"end": 1.0, "step": 0.1}}
    >>> sure = gfmdlayer.converge(config, "force", "end")
    >>> bool(sure["force"] < 0.1 * sure.data["value"][0]), list(sure.suggested)
    (True, ['grid.points'])
    """
    keys = {key.replace("__", "."): value for key, value in values.items()}
    cases = checked(partial(configuration, config, punch, history, keys, trust))
    asked = asked_of(cases, columns, at, to)
    display = chosen_display(progress)
    with ExitStack() as held:
        if out is None:
            place = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="gfmdlayer-")))
        else:
            place = Path(out)
        held.enter_context(interrupts.listening())
        pool = held.enter_context(pool_of(jobs))
        show = None if display is None else lambda: display
        found = estimated(
            cases,
            place,
            pool,
            asked,
            RunOptions(threads=1 if threads is None and jobs > 1 else threads),
            show,
            keep=keep,
        )
    if found is None:
        raise KeyboardInterrupt
    return found


def asked_of(
    cases: Cases, columns: str | Sequence[str], at: str | float | Sequence[str | float], to: float
) -> AskedErrors:
    """Return what is asked for; ConfigError where a column or a moment is none of the cases."""
    names = (columns,) if isinstance(columns, str) else tuple(columns)
    moments = (at,) if isinstance(at, str | int | float) else tuple(at)
    wrong, first = list[str](), cases[0]
    known = [name for name in number_columns(first.config) if name not in NUMERICS]
    wrong += [
        f"columns: got {name!r}; must be of {', '.join(known)}{nearest(name, known)}"
        for name in names
        if name not in known
    ]
    end = min(case.config.time.end for case in cases.sample())
    for moment in moments:
        if isinstance(moment, str) and moment not in MOMENTS:
            wrong.append(f"at: got {moment!r}; must be {', '.join(MOMENTS)} or a time")
        elif not isinstance(moment, str) and not 0 < moment <= end:
            wrong.append(f"at: got {moment!r}; must be > 0 and <= {end:g}, the end of the run")
    if not 0 < to < 1:
        wrong.append(f"to: got {to!r}; must be a number between 0 and 1, relative to the largest value")
    if not moments:
        wrong.append("at: got nothing; must be at least one moment")
    if wrong:
        raise ConfigError(wrong)
    return AskedErrors(names, moments, to)


def number_columns(config: Config) -> list[str]:
    """Return the columns of a case that are real numbers at each time; counts have no error to estimate."""
    return [c.name for c in model_of(config).columns if c.along is None and c.dtype != "i8"]


def estimated(
    cases: Cases,
    place: Path,
    pool: WorkerPool,
    asked: AskedErrors,
    options: RunOptions,
    display: Callable[[], Display] | None,
    *,
    keep: bool = False,
) -> ErrorReport | None:
    """Run the variations in a folder of `place` and write the estimates there; None where stopped."""
    every, compared, failed = chosen(cases), [], dict[str, None]()
    for case in every:
        folder = place / VARIANTS / f"{case.index:04d}"
        base, times = base_case(on_disk(case.config, place / "arrays"), asked)
        varied = Variations(base, times)
        runs = _computed(varied, folder, pool, options, display)
        if runs is None:
            return None
        found, reasons = runs
        failed |= dict.fromkeys(reasons)
        compared.append(_OneCase(case, varied, found, times, asked))
    report = ErrorReport(Comparison(cases.config, compared, [*failed], asked).dataset())
    report.write(place / FILE)
    if not keep:
        for case in every:
            shutil.rmtree(place / VARIANTS / f"{case.index:04d}", ignore_errors=True)
        with suppress(OSError):  # of others
            (place / VARIANTS).rmdir()
    return report


def _computed(
    varied: Variations,
    place: Path,
    pool: WorkerPool,
    options: RunOptions,
    display: Callable[[], Display] | None,
) -> tuple[dict[str, Run], list[str]] | None:
    """Return the runs of all variations by name, and why others failed; None where a run was stopped."""
    folder, failed = Folder(place), dict[str, str]()
    while True:
        rows = [row for row in varied.rows if _name(row) not in failed]
        summary = run_study(Cases(_sweep(varied.config, rows)), place, pool, options, display)
        if summary.count("stopped") or summary.count("elsewhere"):
            return None
        numbers = dict(zip(map(_name, rows), folder.case_numbers(), strict=True))
        lost = [row for row in rows if not folder.case(numbers[_name(row)]).exists()]
        for row in lost:
            record = read_json(folder.case(numbers[_name(row)], "failed")) or {}
            failed[_name(row)] = str(record.get("reason", "no result"))
        if varied.base in lost or not varied.without(lost):
            break
        options = replace(options, restart=False)
    reasons = []
    for name, reason in failed.items():
        row = json.loads(name)
        changed = ", ".join(f"{key} = {value}" for key, value in row.items() if value != varied.base[key])
        reasons.append(f"{changed or 'the case itself'}: {reason}".replace("\n", " "))
    names = [_name(row) for row in varied.rows if _name(row) not in failed]
    return {name: _read(folder.case(numbers[name])) for name in names if name in numbers}, reasons


def chosen(cases: Cases) -> list[SweepCase]:
    """Return the cases that are varied: the only one, or the corners and the middle of a sweep."""
    if not cases.config.sweep:
        return [cases[0]]
    return [cases[i] for i in corners([cases.values(i) for i in range(len(cases))])]


def base_case(config: Config, asked: AskedErrors) -> tuple[Config, list[float]]:
    """Return a case without snapshots, and the common times of its runs."""
    end, motion = config.time.end, config.trajectory
    ends = {float(time) for time, _ in motion.corners if 0 < time < end} | {float(end)}
    if (drive := motion.tangential) is not None and drive.period is not None:
        start = drive.start or 0.0
        quarters = min(4 * math.ceil(drive.cycles or (end - start) / drive.period), MOST_QUARTERS)
        ends |= {start + drive.period * k / 4 for k in range(quarters + 1)}
    stops = sorted({round(time, 12) for time in ends if 0 < time <= end})
    thirds = [np.linspace(a, b, PARTS + 1)[1:] for a, b in zip([0.0, *stops], stops, strict=False)]
    rounded = (float(f"{time:.12g}") for time in [*np.concatenate(thirds), *asked.times])
    times = sorted({min(time, float(end)) for time in rounded})  # none is past the end
    return config.with_values({"output.snapshots": []}), times


def better(config: Config, found: ErrorReport) -> Config:
    """Return a configuration with the suggested numerical choices."""
    return from_python(config, found.suggested) if found.suggested else config


def _sweep(config: Config, rows: Sequence[Values]) -> Config:
    """Return the configuration whose cases are the variations."""
    keys = [*rows[0]]
    zipped = {key: [row[key] for row in rows] for key in keys}
    return from_python(config, {"sweep": {"zip": zipped}, "output.snapshots": []})


def _name(row: Values) -> str:
    return json.dumps(row, sort_keys=True, default=str)


def _read(path: Path) -> Run:
    with open_case(path) as data:
        held = {
            str(n): np.asarray(v.to_numpy(), float) for n, v in data.data_vars.items() if v.dims == ("time",)
        }
        points = math.prod(data.sizes[axis] for axis in "xy" if axis in data.sizes)
        return Run(data["time"].to_numpy(), held, {**data.attrs, "points": points})


class Comparison:
    """The estimates from all runs of some cases."""

    def __init__(
        self, config: Config, every: Sequence[_OneCase], failed: Sequence[str], asked: AskedErrors
    ) -> None:
        self._config, self._every, self._failed, self._asked = config, every, failed, asked
        self._notes: dict[str, None] = {}

    def dataset(self) -> xarray.Dataset:
        """Compare the runs of each case; ResultsError where no case has an estimate."""
        rows = [row for one in self._every for row in one.rows()]
        if (among := len(Cases(self._config))) > 1:
            self._notes[f"{len(self._every)} of {among} cases: corners and middle of the sweep"] = None
        self._notes |= dict.fromkeys(note for one in self._every for note in one.notes)
        if not rows:
            reasons = next(iter(self._failed), "no column has a value")
            raise ResultsError(f"{self._config.name}: no error can be estimated: {reasons}")
        runs = [(one.label, *each) for one in self._every for each in one.all_runs()]
        return self._labelled(rows, runs, self._suggested(rows))

    def _suggested(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Return the keys that bring every column below the asked accuracy of its largest value."""
        to, share, keys = self._asked.to, dict[tuple[str, str], float](), dict[str, Any]()
        for row in rows:
            if row["column"] in COUNTED or not row["error"] > to * row["scale"]:
                continue
            parts = {s: e for s, e in row["errors"].items() if s != "images" and e > SHARE * row["error"]}
            for source, error in parts.items():
                if source == "points" and row["verdict"] == "not resolved":
                    factor = 1 / MOST
                else:
                    order = row["orders"][source]
                    factor = (to / MARGIN / len(parts) * row["scale"] / error) ** (1 / order)
                at = source, row["keys"][source]
                share[at] = min(share.get(at, 1.0), factor)
        swept = {key for one in self._every for key in one.values}
        base, config = self._every[0].varied.base, self._every[0].varied.config
        for (source, key), factor in share.items():
            if factor >= 1:
                continue
            if key in swept:
                self._notes[f"{key} is swept: nothing is suggested for it"] = None
            elif source == "points":
                points = base[key] if isinstance(base[key], list) else [base[key]]
                more = [finer(n, max(factor, 1 / MOST)) for n in points]
                keys[key] = more[0] if len(more) == 1 else more
                if factor < 1 / MOST:
                    self._notes[
                        "four times the points at most are suggested at once: ask again with them"
                    ] = None
            elif source == "step":
                end = config.time.end
                keys[key] = end / math.ceil(end / base[key] / factor)
            elif source == "period":
                self._notes["a larger grid.period lowers the error of an isolated contact"] = None
            else:
                keys[key] = max(float(f"{base[key] * min(factor, 0.7):.1g}"), FINEST)
        return keys

    def _labelled(
        self,
        rows: Sequence[Mapping[str, Any]],
        runs: Sequence[tuple[str, str, float, Run]],
        keys: Mapping[str, Any],
    ) -> xarray.Dataset:
        import xarray

        sources = list(dict.fromkeys(source for row in rows for source in row["errors"]))
        numbers = ("value", "scale", "error", "order_seen", "order_expected", "richardson")
        words = ("case", "column", "moment", "verdict", "note")
        held: dict[str, Any] = {
            name: ("estimate", np.array([row[name] for row in rows], float)) for name in numbers
        }
        held |= {name: ("estimate", np.array([str(row[name]) for row in rows], str)) for name in words}
        for name in ("errors", "orders"):
            table = [[row[name].get(source, math.nan) for source in sources] for row in rows]
            held[name] = ("estimate", "source"), np.array(table, float)
        held["run_case"] = "run", np.array([case for case, *_ in runs], str)
        held["run_source"] = "run", np.array([source for _, source, *_ in runs], str)
        held["size"] = "run", np.array([size for _, _, size, _ in runs], float)
        held["cost"] = "run", np.array([run.work for *_, run in runs], float)
        held["seconds"] = (
            "run",
            np.array([run.attrs.get("wall_seconds", math.nan) for *_, run in runs], float),
        )
        table = [
            [_value(row, run) if row["case"] == case else math.nan for case, _, _, run in runs]
            for row in rows
        ]
        held["values"] = ("estimate", "run"), np.array(table, float)
        attrs: dict[str, Any] = {
            "name": self._config.name, "digest": digest(self._config), "to": self._asked.to,
            "suggested": json.dumps(keys), "suggested_cost": _dearer(self._every[0].varied.config, keys),
            "runs": len({id(run) for *_, run in runs}),
            "work": float(np.mean([one.work for one in self._every])),
            "notes": "\n".join(self._notes), "failed": "\n".join(self._failed),
            "cases": len(self._every), "times": self._every[0].times,
        }  # fmt: skip
        return xarray.Dataset(held, {"source": np.array(sources, str)}, attrs)


def _value(row: Mapping[str, Any], run: Run) -> float:
    """Return the number of a row in a run; of the worst moment the value at its time."""
    column, moment = row["column"], row["moment"]
    if column not in run.columns:
        return math.nan
    if moment == "end":
        return float(run.columns[column][-1])
    return run.peak(column) if moment == "peak" else float(run.at(column, np.array([row["time"]]))[0])


def _dearer(config: Config, keys: Mapping[str, Any]) -> float:
    """Return the cost of a case with other keys, over its own."""
    if not keys:
        return 1.0
    try:
        return cost_of(config.with_values(keys)).work / max(cost_of(config).work, 1e-300)
    except ConfigError:
        return math.nan


def finer(n: int, factor: float) -> int:
    """Return the next even number of points with factors 2, 3, 5 that is at least n over a factor."""
    least = 2 * math.ceil(n / factor / 2)
    return next(m for m in range(least, 4 * least, 2) if is_smooth(m))


class _OneCase:
    """The estimates of one case."""

    def __init__(
        self,
        case: SweepCase,
        varied: Variations,
        runs: Mapping[str, Run],
        times: Sequence[float],
        asked: AskedErrors,
    ) -> None:
        self.label, self.values, self.varied, self._asked = label(case.values), case.values, varied, asked
        self._config, self._base, self.notes = varied.config, runs.get(_name(varied.base)), list[str]()
        self.times = np.array(times)
        ladders = {
            source.name: {
                size: runs[_name(values)] for size, values in source.ladder.items() if _name(values) in runs
            }
            for source in varied.sources
        }
        if "images" in ladders:
            ladders["images"] = self._as_totals(ladders["images"])
        self._runs = {name: found for name, found in ladders.items() if len(found) > 1 and 1.0 in found}

    def _as_totals(self, found: Mapping[float, Run]) -> dict[float, Run]:
        """Return runs with alike columns: totals, as those of an isolated contact are."""
        cell = math.prod(self._config.grid.period)
        if (own := found.get(1.0)) is None:
            return {**found}
        return {**found, 1.0: replace(own, columns=totals(own.columns, cell))}

    @property
    def work(self) -> float:
        """Work of the runs beside the case, over that of the case."""
        if self._base is None:
            return math.nan
        every = {
            id(run): run for found in self._runs.values() for run in found.values() if run is not self._base
        }
        return sum(run.work for run in every.values()) / max(self._base.work, 1e-300)

    def all_runs(self) -> list[tuple[str, float, Run]]:
        """Return source, size and contents of each run."""
        return [(name, size, run) for name, found in self._runs.items() for size, run in found.items()]

    def rows(self) -> list[dict[str, Any]]:
        """Return an estimate for each column and moment."""
        base = self._base
        if base is None:
            self._say("the case itself failed")
            return []
        for source in self.varied.sources:
            if source.refused:
                self._say(f"{source.name}: {source.refused[0]}")
            if source.name not in self._runs:
                self._say(f"{source.name}: no estimate")
        names = self._asked.columns or [n for n in number_columns(self._config) if n not in NUMERICS]
        refused = self._refusals(base)
        return [
            row
            for name in names
            for moment in self._asked.moments
            if (row := self._row(base, name, moment, refused)) is not None
        ]

    def _say(self, line: str) -> None:
        self.notes.append(f"{self.label}: {line}" if self.label else line)

    def _refusals(self, base: Run) -> dict[str, str]:
        """Return why some moments have no estimate; leave out times of sudden changes."""
        every = [run for name, found in self._runs.items() if name != "images" for run in found.values()]
        jumps = [np.ravel(run.attrs.get("instability_time", [])).astype(float) for run in [base, *every]]
        ends = sorted({round(float(run.time[-1]), 6) for run in [base, *every]})
        refused = {}
        if len({each.size for each in jumps}) > 1:
            number = sorted({each.size for each in jumps})
            refused["worst"] = (
                f"the runs jump {number[0]} to {number[-1]} times: no `worst`, energies are rough"
            )
        if len(ends) > 1:
            reason = f"the runs end at {ends[0]:g} to {ends[-1]:g}: no `end`, no `worst`"
            refused |= {"end": reason, "worst": reason}
        for reason in dict.fromkeys(refused.values()):
            self._say(reason)
        points, axes = int(base.attrs.get("most_contact_points", 0)), len(self._config.grid.points)
        if 0 < points < FEW_POINTS[axes]:
            self._say(f"{points} points in contact: estimates may be too small")
        sudden = self._sudden(base, jumps)
        if sudden.any():
            at = ", ".join(f"{time:.4g}" for time in self.times[sudden])
            self._say(
                f"contact or stick changes by half within a step, or jumps, near t = {at}: not in `worst`"
            )
            self.times = self.times[~sudden]
        if said := str(base.attrs.get("warnings", "")):
            for line in said.splitlines():
                self._say(line)
        return refused

    def _sudden(self, base: Run, jumps: Sequence[FloatArray]) -> BoolArray:
        """Whether contact or stick change by half within a step beside a time, or the runs jump there."""
        times, t, sudden = self.times, base.time, np.zeros(len(self.times), bool)
        if {"step", "tolerance"} & self._runs.keys():
            for values in (base.columns[name] for name in COUNTED & base.columns.keys()):
                beside = (values[max(j - 1, 0) : j + 2] for j in np.abs(t[:, None] - times).argmin(0))
                most = 0.5 * np.nanmax(np.abs(values), initial=0.0)
                sudden |= np.array([np.ptp(each) > most for each in beside], bool)
        if len({each.size for each in jumps}) == 1:
            for at in zip(*jumps, strict=True):
                around = max(at) - min(at)
                sudden |= (times > min(at) - around) & (times < max(at) + around)
        return sudden

    def _row(
        self, base: Run, column: str, moment: str | float, refused: Mapping[str, str]
    ) -> dict[str, Any] | None:
        """Return the estimate of a column at a moment, with its parts; None for a column without values."""
        scale = base.peak(column)
        if not scale > 0:
            return None
        named = moment if isinstance(moment, str) else f"{moment:g}"
        time = math.nan if isinstance(moment, str) else float(moment)
        row: dict[str, Any] = {
            "case": self.label,
            "column": column,
            "moment": named,
            "scale": scale,
            "note": "",
        }
        row |= {
            "value": self._of(base, column, moment),
            "error": math.nan,
            "time": time,
            "errors": {},
            "orders": {},
        }
        row |= {"keys": {}, "order_seen": math.nan, "order_expected": math.nan, "richardson": math.nan}
        ended = named == "peak" and base.peak(column) == abs(base.columns[column][-1])  # as a sum over time
        if reason := refused.get("end" if ended else named, ""):
            return row | {"verdict": "refused", "note": reason}
        found: dict[str, tuple[ErrorOfValue, float]] = {}
        varies = False
        for source in self.varied.sources:
            if (runs := self._runs.get(source.name)) is None or any(
                column not in r.columns for r in runs.values()
            ):
                continue
            expected = expected_order(source.name, column, self._config)
            if (best := self._estimate(runs, column, moment, expected)) is None:
                continue
            one, at, varied = best
            factor = scale / peak if (peak := runs[1.0].peak(column)) > 0 else 1.0
            one = one._replace(error=factor * one.error)
            varies |= varied
            row["errors"][source.name], row["keys"][source.name] = one.error, source.key
            agrees = one.verdict == "order"
            row["orders"][source.name] = max(LOWEST, one.seen) if agrees else expected
            if source.summed:
                found[source.name] = one, expected
                if moment == "worst" and (
                    math.isnan(row["time"]) or one.error >= max(row["errors"].values())
                ):
                    row["time"] = at
            if agrees and moment != "worst" and math.isfinite(one.limit):
                shift = factor * (one.limit - self._of(runs[1.0], column, moment))
                row["richardson"] = shift + (
                    row["value"] if math.isnan(row["richardson"]) else row["richardson"]
                )
        if not found:
            return row | {"verdict": "refused", "note": "no two runs have this number"}
        row["error"] = sum(one.error for one, _ in found.values())
        most, expected = max(found.values(), key=lambda each: each[0].error)
        row |= {"order_seen": most.seen, "order_expected": expected, "verdict": most.verdict}
        if not varies:
            return row | {"verdict": "prescribed", "error": 0.0}
        if row["error"] > UNRESOLVED * scale:
            row |= {"verdict": "not resolved", "note": "the runs differ by more than a third of the number"}
        elif column in COUNTED:
            row["note"] = COUNTED_NOTE
        return row

    def _estimate(
        self, runs: Mapping[float, Run], column: str, moment: str | float, expected: float
    ) -> tuple[ErrorOfValue, float, bool] | None:
        """Return the estimate of a column, its time, and whether the runs differ; of `worst` the largest."""
        if moment == "worst":
            curves = {size: run.at(column, self.times) for size, run in runs.items()}
            sets = [
                (float(t), {size: float(curve[i]) for size, curve in curves.items() if np.isfinite(curve[i])})
                for i, t in enumerate(self.times)
            ]
        else:
            values = {size: self._of(run, column, moment) for size, run in runs.items()}
            sets = [(math.nan, {size: value for size, value in values.items() if math.isfinite(value)})]
        usable = [(t, values) for t, values in sets if len(values) > 1 and 1.0 in values]
        if not usable:
            return None
        every = [(estimate(values, expected), t) for t, values in usable]
        least = PRESCRIBED * runs[1.0].peak(column)
        varied = any(max(values.values()) - min(values.values()) > least for _, values in usable)
        return *max(every, key=lambda each: each[0].error), varied

    @staticmethod
    def _of(run: Run, column: str, moment: str | float) -> float:
        if moment == "end":
            return float(run.columns[column][-1])
        if moment == "peak":
            return run.peak(column)
        return math.nan if moment == "worst" else float(run.at(column, np.array([float(moment)]))[0])
