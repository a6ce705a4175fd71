"""Fits of a force map: each curve is a case of a results folder, like a simulation of a sweep.

`gfmdlayer.study` provides workers, scheduling, requests to stop, locks, status and records of failures.
This module finds the fits that are not done yet, from the contents of their files, and writes the map.
"""

from __future__ import annotations

import hashlib
import json
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from gfmdlayer.arrays import FloatArray
from gfmdlayer.config import ConfigError
from gfmdlayer.files.tables import Answers
from gfmdlayer.files.whole import cannot_be_written, is_intact, write_text
from gfmdlayer.fitting.curve_files import SI, CurveSource, Entry, contents, sources, units_of
from gfmdlayer.fitting.elastic import CHOOSE, KINDS, NO_ADHESION
from gfmdlayer.fitting.force_curve import COLUMNS as OF_A_CURVE
from gfmdlayer.fitting.force_curve import Correction
from gfmdlayer.fitting.indentation import fit_curves
from gfmdlayer.fitting.indentation_report import COLUMNS, SCALARS, accounts, add_estimates
from gfmdlayer.fitting.measurement import FitError
from gfmdlayer.fitting.prediction import Prediction
from gfmdlayer.fitting.problem import Free, IndentationModel
from gfmdlayer.fitting.result import FitOptions, IndentationFit, unit_of_parameter
from gfmdlayer.fitting.starts import keys_with_adhesion
from gfmdlayer.results.netcdf import add_variable, new_file, opened, set_attributes
from gfmdlayer.results.provenance import provenance
from gfmdlayer.study.case_run import record_failure
from gfmdlayer.study.claims import PATIENCE, Claim, Taken, in_use, locked
from gfmdlayer.study.folder import (
    FOREIGN,
    MARK,
    WAYS_OUT,
    Folder,
    FolderError,
    name_of_run,
    refuse_unreadable,
)
from gfmdlayer.study.interrupts import Stopped
from gfmdlayer.study.progress import Display, Reporter
from gfmdlayer.study.run import Summary
from gfmdlayer.study.schedule import Outcome, Schedule
from gfmdlayer.study.workers import WorkerPool
from gfmdlayer.validation import text
from gfmdlayer.validation.units import Units, label_of

# The file cases/NNNN.h5 of the estimates of one curve:
#
# estimate, error, low, high (parameter)    value, standard error and 95 % interval
# correlation (parameter, parameter)        of the estimates
# noise, aic, bic                           of the fit


@dataclass(frozen=True)
class MapCase:
    """A curve of a map."""

    index: int  # number of the curve and of its file
    source: CurveSource  # the curve, not read yet
    contents: str  # hash of the file, or of the numbers held in memory

    @property
    def name(self) -> str:
        """The curve's name."""
        return self.source.name

    @property
    def values(self) -> dict[str, object]:
        """The curve's name, for messages."""
        return {"curve": self.name}

    @property
    def entry(self) -> Entry | None:
        """The place of the curve in a file, if it is in one."""
        return self.source.held if isinstance(self.source.held, Entry) else None


_FACTS = {"sensitivity", "sampling", "baseline", "weight", "range"}


@dataclass(frozen=True)
class FitTask:
    """Fit of one curve of a map."""

    folder: Folder  # a claimed results folder
    model: dict[str, Any]  # body and indenter
    free: Free  # free parameters
    options: FitOptions  # how curves are fitted
    answers: Answers = field(default_factory=Answers)  # what the files leave open

    def digest(self, case: MapCase) -> str:
        """Return a hash of all input that determines the estimates of a case."""
        asked = self.free if isinstance(self.free, dict) else list(self.free)
        units = [unit for _, unit in self.answers.units] or None
        key = case.entry.key if case.entry else ""
        determined = [self.model, asked, self.given, units, case.contents, key, *self.further]
        return hashlib.sha256(json.dumps(determined, default=str).encode()).hexdigest()

    @property
    def given(self) -> dict[str, Any]:
        """The options of the fit; facts that files lack only where they are given."""
        return {
            key: list(value) if isinstance(value, tuple) and key in _FACTS else value
            for key, value in vars(self.options).items()
            if key not in _FACTS or value not in (None, "none")
        }

    @property
    def further(self) -> list[Any]:
        """What is said about tables, besides units in their usual order."""
        keys = (each.name for each in fields(self.answers) if each.compare)
        said = {key: value for key in keys if (value := getattr(self.answers, key))}
        if [name for name, _ in self.answers.units] == [*OF_A_CURVE]:
            said.pop("units")
        return [said] if said else []

    def __call__(self, case: MapCase) -> Outcome:
        """Fit a curve and write its file; an error becomes the outcome, with the name of the curve."""
        begun = time.monotonic()
        try:
            with Claim(self.folder, case.index, 1.0, case.name):
                self.folder.case(case.index, "failed").unlink(missing_ok=True)
                fit = self._fit(case)
                write_estimates(self.folder.case(case.index), fit, case.name, self.digest(case))
        except Stopped:
            return Outcome(case.index, "stopped")
        except Taken:
            return Outcome(case.index, "elsewhere")
        except Exception as error:
            reason = f"curve {case.name}: {type(error).__name__}: {error}".replace("\n", "; ")
            record_failure(self.folder, case.index, case.values, reason, traceback.format_exc())
            return Outcome(case.index, "failed", reason, time.monotonic() - begun)
        return Outcome(case.index, "complete", seconds=time.monotonic() - begun)

    def _fit(self, case: MapCase) -> IndentationFit:
        model = IndentationModel(self.model)
        into, timeless = units_of(model.config.units), model.is_timeless(self.free)
        curve = case.source.curve(self.answers, into, self.options, timeless=timeless)
        fit = fit_curves([curve], model, self.free, self.options, advise=False)
        if not all(np.isfinite(each.value) for each in fit.parameters):
            raise FitError("an estimate is not a finite number")
        return fit


class Estimates(NamedTuple):
    """The contents of the file of a case."""

    keys: list[str]  # free parameters
    columns: FloatArray  # shape (4, parameters), in the order of COLUMNS
    scalars: FloatArray  # shape (3,), in the order of SCALARS
    warnings: str  # one line each


def write_estimates(path: Path, fit: IndentationFit, name: str, digest: str) -> None:
    """Write the file of a case, complete or not at all."""
    with new_file(path) as file:
        h5 = file.begin()
        add_estimates(h5, fit)
        known = {"curve": name, "digest": digest, "warnings": "\n".join(fit.warnings), "read": accounts(fit)}
        set_attributes(h5, {**provenance(), **known, "complete": 1})


def read_estimates(path: Path, digest: str | None = None) -> Estimates | None:
    """Read the file of a case; None where it is missing, damaged, or of another digest."""
    try:
        if is_intact(path) is False:
            return None
        with opened(path) as h5:
            if h5.attrs["complete"] != 1 or (digest is not None and h5.attrs["digest"] != digest):
                return None
            keys = [key.decode() for key in h5["parameter"][:]]
            columns = np.stack([h5[column][:] for column in COLUMNS])
            scalars = np.array([h5[scalar][()] for scalar in SCALARS])
            return Estimates(keys, columns, scalars, str(h5.attrs["warnings"]))
    except Exception:  # a damaged file can fail anywhere in HDF5, with any exception
        return None


# The file of a force map, DIR/sweep.h5: each parameter and its error over the curves.
#
#     G0, G0_error, G0_low, G0_high, ... (y, x)      where the positions of the curves are a grid
#                                        (curve)     else
#     noise, aic, bic, case, name, warnings          of each curve
#
# The last part of its key names a parameter, or the whole key where two share that part. A failed curve is
# NaN, and the attribute `failed` lists it.

SECTIONS = ("layer", "layers", "halfspace", "punch")
SAME_PLACE = 0.05  # of the largest spacing: positions closer than this, as of a stage, are one coordinate
_MEANINGS = {
    "": "",
    "_error": "standard error of ",
    "_low": "lower end of the 95 % interval of ",
    "_high": "upper end of the 95 % interval of ",
}


class _MapLayout(NamedTuple):
    """Coordinates of the dimensions, and the place of each case along them."""

    coordinates: dict[str, FloatArray]
    places: Sequence[tuple[int, ...]]


def collect(
    folder: Folder, cases: Sequence[MapCase], keys: Sequence[str], reasons: Mapping[int, str],
    attributes: Mapping[str, str], units: Units | None,
) -> Path:  # fmt: skip
    """Write the map from the files of its curves; `reasons` are the errors of failed curves."""
    layout = _layout([case.source.place(units_of(units)) for case in cases])
    shape = tuple(values.size for values in layout.coordinates.values())
    names = parameter_names(keys)
    tables = np.full((len(keys), len(_MEANINGS), *shape), np.nan)
    scalars = np.full((len(SCALARS), *shape), np.nan)
    numbers, labels, notes = np.full(shape, -1), np.full(shape, "", dtype=object), np.full(shape, "", object)
    failed = dict(reasons)
    for case, place in zip(cases, layout.places, strict=True):
        numbers[place], labels[place] = case.index, case.name
        if case.index in failed:
            continue
        estimates = read_estimates(folder.case(case.index))
        if estimates is None:
            failed[case.index] = f"curve {case.name}: its file cannot be read"
            continue
        notes[place] = estimates.warnings
        for row, key in enumerate(keys):
            if key in estimates.keys:  # a curve has no stiffness to fit where its depth is prescribed
                np.moveaxis(tables[row], 0, -1)[place] = estimates.columns[:, estimates.keys.index(key)]
        np.moveaxis(scalars, 0, -1)[place] = estimates.scalars
    with new_file(folder.sweep) as file:
        h5 = file.begin()
        for name, values in layout.coordinates.items():
            known = label_of(units, "length") if name != "curve" else None
            add_variable(h5, name, (name,), {"units": known} if known else {}, data=values)
        dimensions = tuple(layout.coordinates)
        for name, key, parts in zip(names, keys, tables, strict=True):
            unit = unit_of_parameter(units, key)
            for (suffix, meaning), table in zip(_MEANINGS.items(), parts, strict=True):
                described = {"long_name": f"{meaning}{key}", "key": key} | ({"units": unit} if unit else {})
                add_variable(h5, f"{name}{suffix}", dimensions, described, data=table)
        for name, table in zip(SCALARS, scalars, strict=True):
            add_variable(h5, name, dimensions, {}, data=table)
        add_variable(h5, "case", dimensions, {}, data=numbers)
        for name, words in (("name", labels), ("warnings", notes)):
            add_variable(h5, name, dimensions, {}, data=words, dtype=h5py.string_dtype())
        report = "\n".join(f"{index:04d}: {reason}" for index, reason in sorted(failed.items()))
        own = {"fitted": " ".join(names), "swept": " ".join(layout.coordinates), "failed": report}
        set_attributes(h5, {**attributes, **own, "complete": 1})
    return folder.sweep


def parameter_names(keys: Sequence[str]) -> list[str]:
    """Name parameters by the last parts of their keys, or by the whole keys where two share that part."""
    last = [key.rpartition(".")[2] for key in keys]
    taken = Counter([*last, *SCALARS, "x", "y", "curve", "case", "name", "warnings"])
    return [key if taken[part] > 1 else part for key, part in zip(keys, last, strict=True)]


def _layout(positions: Sequence[tuple[float, ...]]) -> _MapLayout:
    """Place curves on the grid of their positions, or in a row if the positions form no grid."""
    if all(len(position) == 2 for position in positions):
        x, y = np.array(positions).T
        (columns, across), (rows, up) = _levels(x), _levels(y)
        places = list(zip(rows.tolist(), columns.tolist(), strict=True))
        full = len(set(places)) == len(places) and 2 * len(places) > across.size * up.size
        if full and min(across.size, up.size) > 1:
            return _MapLayout({"y": up, "x": across}, places)
    return _MapLayout(
        {"curve": np.arange(len(positions), dtype=float)}, [(i,) for i in range(len(positions))]
    )


def _levels(values: FloatArray) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.int64]], FloatArray]:
    """Return the number of the level of each value, and the levels, ascending."""
    order = np.sort(values)
    steps = np.diff(order)
    begins = np.concatenate(([0], 1 + np.flatnonzero(steps > SAME_PLACE * steps.max(initial=0.0))))
    levels = np.add.reduceat(order, begins) / np.diff(np.append(begins, order.size))
    return np.abs(values[:, np.newaxis] - levels).argmin(axis=1), levels


class ForceMap:
    """The fits of many curves, one by one, in the results folder `directory`."""

    def __init__(
        self, curves: Any, directory: Path, model: Mapping[str, Any], free: Free,
        options: FitOptions, answers: Answers = Answers(),  # noqa: B008
    ) -> None:  # fmt: skip
        self._model, self.keys = IndentationModel(model), list(free)
        if options.contact == "detect":
            self.keys += [key for key in ("contact_point", "force_offset") if key not in self.keys]
        if options.adhesion == CHOOSE:
            allowed = ", ".join((NO_ADHESION, *KINDS))
            raise ConfigError(
                [f"adhesion: got choose, and a map has one set of parameters; must be one of {allowed}"]
            )
        if options.adhesion is not None:
            self.keys = list(keys_with_adhesion(self._model, self.keys, options.adhesion))
        if options.stiffness_error is not None and "stiffness" not in self.keys:
            self.keys.append("stiffness")
        self.folder = Folder(directory, name_of_run())
        self.task = FitTask(self.folder, dict(model), free, options, answers)
        found = list(sources(curves))
        if not found:
            raise FitError("got no curve; give at least one")
        paths = dict.fromkeys(each.held.path for each in found if isinstance(each.held, Entry))
        hashes = {path: contents(path) for path in paths}
        self.cases = [
            MapCase(i, each, hashes[each.held.path] if isinstance(each.held, Entry) else each.digest)
            for i, each in enumerate(found)
        ]

    @cached_property
    def document(self) -> str:
        """The input that determines the results, as in config.yaml."""
        free, further = self.task.free, self.task.further
        units = [unit for _, unit in self.task.answers.units]
        data: dict[str, Any] = {
            "name": self._model.config.name,
            "curves": list(
                dict.fromkeys(
                    str(case.entry.path.absolute()) if case.entry else f"{case.name} (in memory)"
                    for case in self.cases
                )
            ),
            "free": list(free),
            "fit": self.task.given | ({"units": units} if units else {}) | (further[0] if further else {}),
        }
        if isinstance(free, Mapping):
            data["free"] = {key: "free" if bounds is None else list(bounds) for key, bounds in free.items()}
        kept = self._model.config.model_dump(exclude_none=True)
        data |= {key: kept[key] for key in ("units", *SECTIONS) if key in kept}
        if self._model.adhesion is not None:
            data["adhesion"] = self._model.adhesion
        return f"{MARK}# Cases: {len(self.cases)}\n{text.written(data)}"

    def run(
        self, pool: WorkerPool, restart: bool = False, display: Callable[[], Display] | None = None
    ) -> Summary:
        """Fit the curves that are not done yet and write the map; `restart` removes earlier results."""
        with self._claimed(restart):
            done = {case.index for case in self.cases if self._is_done(case)}
            todo = [case for case in self.cases if case.index not in done]
            outcomes = {index: Outcome(index, "complete") for index in sorted(done)}
            indices = frozenset(case.index for case in self.cases)
            with Reporter(self.folder, indices, len(done), display) as reporter:
                before = f", {len(done)} complete already" if done else ""
                reporter.note(f"{len(self.cases)} curves{before}; {pool.size} {pool.kind}")
                for warning in pool.warnings:
                    reporter.note(f"warning: {warning}")
                with reporter.preparing("compiling kernels, once per machine"):
                    self._warm_up(pool, todo)
                for outcome in Schedule(pool, self.task, self.folder, reporter.ended).run(todo):
                    outcomes[outcome.index] = outcome
            collected = all(outcome.state in {"complete", "failed"} for outcome in outcomes.values())
            if collected:
                reasons = {
                    outcome.index: outcome.reason
                    for outcome in outcomes.values()
                    if outcome.state == "failed"
                }
                collect(self.folder, self.cases, self.keys, reasons, {"name": self._model.config.name},
                        self._model.config.units)  # fmt: skip
        failures = [outcomes[index] for index in sorted(outcomes) if outcomes[index].state == "failed"]
        return Summary(Counter(each.state for each in outcomes.values()), failures, collected)

    def _warm_up(self, pool: WorkerPool, todo: Sequence[MapCase]) -> None:
        """Compile the kernels here, before several processes do."""
        if todo and not pool.alone:
            with suppress(Exception):  # the fit repeats the error and records it
                curve = todo[0].source.curve(self.task.answers, SI, self.task.options, timeless=True)
                Prediction(curve).response(self._model.config, Correction())

    def _is_done(self, case: MapCase) -> bool:
        path = self.folder.case(case.index)
        refuse_unreadable(path)
        if not path.exists() or read_estimates(path) is None:
            self.folder.set_aside(path)
            return False
        if read_estimates(path, self.task.digest(case)) is None:
            raise FolderError(f"{path}: this fit used other data (has a file changed?); {WAYS_OUT}")
        return True

    @contextmanager
    def _claimed(self, restart: bool) -> Iterator[None]:
        """Claim the folder for this run, and remove leftovers of killed runs."""
        folder = self.folder
        with ExitStack() as claim:
            try:
                folder.path.mkdir(parents=True, exist_ok=True)
                known = folder.is_results()
                if not known and any(entry.name != "cases" for entry in folder.path.iterdir()):
                    raise FolderError(f"{folder.path}: {FOREIGN.format(folder.lacking)}")
                if known and not restart:
                    self._refuse_other()
                folder.cases.mkdir(exist_ok=True)
                if not claim.enter_context(locked(folder)).is_alone(PATIENCE):
                    raise in_use(folder, "another run is writing here")
                if known:
                    for path in {*folder.leftovers(), *folder.unfinished()}:
                        path.unlink(missing_ok=True)
                if restart:
                    folder.remove_results()
                if restart or not known:
                    write_text(folder.config, self.document)
            except OSError as error:
                reason = cannot_be_written(error)
                raise FolderError(f"{folder.path}: {reason}; choose another with --out") from None
            try:
                yield
            finally:
                folder.end_run()

    def _refuse_other(self) -> None:
        """Reject a folder of another model, other curves or other options."""
        before = self.folder.config.read_text(encoding="utf-8", errors="replace").splitlines()
        now = self.document.splitlines()
        changed = [
            f"{line.strip()} ({which})"
            for lines, others, which in ((now, before, "now"), (before, now, "before"))
            for line in lines
            if line not in others and not line.startswith("name:")
        ]
        if changed:
            found = f"results of another model or other curves ({'; '.join(changed[:6])})"
            raise FolderError(f"{self.folder.path}: contains {found}; {WAYS_OUT}")
