"""Fits of a force map: each curve is a case of a results folder, as a simulation of a sweep is.

Pools of workers, scheduling, requests to stop, locks, status, records of failures and files that are whole
are those of `gfmdlayer.execution`. Here are the rest: the fits that are not done yet, found by the contents
of their files, and the map of all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import Any

from gfmdlayer.config import text
from gfmdlayer.execution.claim import held, leftovers, refuse_unreadable, remove_results
from gfmdlayer.execution.folder import FOREIGN, MARK, WAYS_OUT, Folder, FolderError
from gfmdlayer.execution.progress import Display, Log, Reporter
from gfmdlayer.execution.run import Summary
from gfmdlayer.execution.schedule import Outcome, Schedule
from gfmdlayer.execution.workers import WorkerPool
from gfmdlayer.files.whole import cannot_be_written, write_text
from gfmdlayer.fitting.indentation.curve_files import Units, contents, entries, read_curve
from gfmdlayer.fitting.indentation.estimates import FitOptions
from gfmdlayer.fitting.indentation.forward import Prediction
from gfmdlayer.fitting.indentation.parameters import Free, Model
from gfmdlayer.force_maps.case_file import FitTask, MapCase, read_estimates
from gfmdlayer.force_maps.map_file import collect


class ForceMap:
    """The fits of many curves, one by one.

    Parameters
    ----------
    paths : sequence of Path
        Files of curves, and folders of them.
    directory : Path
        Results folder.
    model : mapping
        Body and indenter.
    free : sequence or mapping
        Free parameters.
    options : FitOptions
        How curves are fitted.
    units : sequence of str, optional
        Of columns without their own.

    Raises
    ------
    TableError
        A file of curves cannot be read.
    ConfigError
        The model is not possible.
    """

    def __init__(
        self, paths: Sequence[Path], directory: Path, model: Mapping[str, Any], free: Free,
        options: FitOptions, units: Units | None = None,
    ) -> None:  # fmt: skip
        self._model, self.keys = Model(model), list(free)
        if options.contact == "detect":
            self.keys += [key for key in ("contact_point", "force_offset") if key not in self.keys]
        self.folder = Folder(directory)
        self.task = FitTask(self.folder, dict(model), free, options, units)
        found = entries(paths)
        hashes = {path: contents(path) for path in dict.fromkeys(entry.path for entry in found)}
        self.cases = [MapCase(i, entry, hashes[entry.path]) for i, entry in enumerate(found)]

    @cached_property
    def document(self) -> str:
        """What determines the results, as config.yaml keeps it."""
        free = self.task.free
        data: dict[str, Any] = {
            "name": self._model.config.name,
            "curves": [
                str(path.absolute()) for path in dict.fromkeys(case.entry.path for case in self.cases)
            ],
            "free": list(free),
            "fit": vars(self.task.options) | ({"units": list(self.task.units)} if self.task.units else {}),
        }
        if isinstance(free, Mapping):
            data["free"] = {key: "free" if bounds is None else list(bounds) for key, bounds in free.items()}
        kept = self._model.config.model_dump(exclude_none=True)
        data |= {key: kept[key] for key in ("units", "layer", "layers", "halfspace", "punch") if key in kept}
        return f"{MARK}# Cases: {len(self.cases)}\n{text.written(data)}"

    def run(
        self, pool: WorkerPool, restart: bool = False, display: Callable[[], Display] | None = None
    ) -> Summary:
        """Fit the curves that are not done yet, and write the map of all.

        Parameters
        ----------
        pool : WorkerPool
            The processes that compute.
        restart : bool
            Remove earlier results first.
        display : callable, optional
            Makes the display of progress; by default nothing is shown.

        Raises
        ------
        FolderError
            The folder cannot be used for these results.
        """
        with self._claimed(restart):
            done = {case.index for case in self.cases if self._is_done(case)}
            todo = [case for case in self.cases if case.index not in done]
            outcomes = {index: Outcome(index, "complete") for index in sorted(done)}
            indices = frozenset(case.index for case in self.cases)
            with Reporter(self.folder, indices, len(done), display or _nothing) as reporter:
                before = f", {len(done)} complete already" if done else ""
                reporter.note(f"{len(self.cases)} curves{before}; {pool.size} {pool.kind}")
                for warning in pool.warnings:
                    reporter.note(f"warning: {warning}")
                with reporter.preparing("compiling kernels, once per machine"):
                    self._warm_up(pool, todo)
                for outcome in Schedule(pool, self.task, self.folder, reporter.ended).run(todo):
                    outcomes[outcome.index] = outcome
            collected = all(each.state in {"complete", "failed"} for each in outcomes.values())
            if collected:
                reasons = {each.index: each.reason for each in outcomes.values() if each.state == "failed"}
                collect(self.folder, self.cases, self.keys, reasons, {"name": self._model.config.name})
        return Summary(tuple(outcomes[index] for index in sorted(outcomes)), collected)

    def _warm_up(self, pool: WorkerPool, todo: Sequence[MapCase]) -> None:
        """Compile the kernels here, before several processes do."""
        if todo and not pool.alone:
            with suppress(Exception):  # the fit will meet it again, and be recorded as failed
                curve = read_curve(todo[0].entry, self.task.units)
                Prediction(curve).force(self._model.config)

    def _is_done(self, case: MapCase) -> bool:
        path = self.folder.case(case.index)
        refuse_unreadable(path)
        if not path.exists() or read_estimates(path) is None:
            self.folder.set_aside(path)
            return False
        if read_estimates(path, self.task.digest(case)) is None:
            raise FolderError(f"{path}: was fitted to other data (has a file changed?); {WAYS_OUT}")
        return True

    @contextmanager
    def _claimed(self, restart: bool) -> Iterator[None]:
        """Hold the folder for this run, without the files that killed runs left."""
        folder = self.folder
        with ExitStack() as claim:
            try:
                folder.path.mkdir(parents=True, exist_ok=True)
                known = folder.is_results()
                if not known and any(entry.name != "cases" for entry in folder.path.iterdir()):
                    raise FolderError(f"{folder.path}: {FOREIGN}")
                if known and not restart:
                    self._refuse_other()
                folder.cases.mkdir(exist_ok=True)
                if known:
                    with leftovers(folder) as left:
                        for path in left:
                            path.unlink(missing_ok=True)
                claim.enter_context(held(folder))
                if restart:
                    remove_results(folder)
                if restart or not known:
                    write_text(folder.config, self.document)
            except OSError as error:
                reason = cannot_be_written(error)
                raise FolderError(f"{folder.path}: {reason}; choose another with --out") from None
            try:
                yield
            finally:
                with suppress(OSError):
                    folder.stop.unlink(missing_ok=True)

    def _refuse_other(self) -> None:
        """Refuse a folder of another model, other curves or other options."""
        before = self.folder.config.read_text(encoding="utf-8", errors="replace").splitlines()
        now = self.document.splitlines()
        changed = [
            f"{line.strip()} (now)" for line in now if line not in before and not line.startswith("name:")
        ]
        changed += [
            f"{line.strip()} (before)" for line in before if line not in now and not line.startswith("name:")
        ]
        if changed:
            raise FolderError(
                f"{self.folder.path}: holds results of another model or other curves "
                f"({'; '.join(changed[:6])}); {WAYS_OUT}"
            )


def _nothing() -> Display:
    return Log(StringIO())
