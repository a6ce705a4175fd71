"""`gfmdlayer.run`: the cases of a configuration as labelled data, in memory or with a folder of results.

In memory each case goes into a `Recording`; with a folder the run equals a run of the command line.
"""

from __future__ import annotations

import hashlib
import html
import io
import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from multiprocessing import current_process, parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from gfmdlayer.arrays import unmasked
from gfmdlayer.body.bodies import is_in_memory
from gfmdlayer.case.accuracy import accuracy
from gfmdlayer.case.model import ConvergenceError, model_of
from gfmdlayer.case.notes import notes
from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.config.reader import Inspection, from_python, gives
from gfmdlayer.config.sweeps import swept_keys
from gfmdlayer.config.trajectory import Trajectory
from gfmdlayer.errors import warn
from gfmdlayer.files.cache import MemoryFile
from gfmdlayer.files.whole import unfinished
from gfmdlayer.grid.grid import Grid
from gfmdlayer.observables import Observable, measured_too
from gfmdlayer.punch.shape import Shape
from gfmdlayer.punch.topography import numbers, outward_heights
from gfmdlayer.results.case_file import CaseContents, case_contents
from gfmdlayer.results.gathering import CaseRecord, Swept, labelled
from gfmdlayer.results.reader import open_results
from gfmdlayer.results.recording import Recording
from gfmdlayer.study import case_run, interrupts, workers
from gfmdlayer.study.cases import Cases, SweepCase, checked, label
from gfmdlayer.study.claims import AtWork, Claim
from gfmdlayer.study.folder import Folder, name_of_run, read_config
from gfmdlayer.study.progress import PREPARATION, Display, Progress, Reporter, make_display
from gfmdlayer.study.run import RunOptions, run_study
from gfmdlayer.study.schedule import Outcome, Schedule
from gfmdlayer.validation.entry import entry
from gfmdlayer.validation.problems import shown
from gfmdlayer.validation.sections import files_named

if TYPE_CHECKING:
    import xarray


# Arrays of Python as the files that a configuration names: in memory, or beside the results.

History = ArrayLike | tuple[ArrayLike, ArrayLike]


def with_history(history: History) -> dict[str, object]:
    """Return the keys of a trajectory that is an array of shape (m, 2), or a pair of arrays: time, drive."""
    file = _table("history", history)
    others = Trajectory.model_fields.keys() - {
        "control",
        "velocity",
        "velocity_file",
        "tangential",
        "creepage",
    }
    left_out: dict[str, object] = {f"trajectory.{key}": None for key in others}
    return left_out | {"trajectory.kind": "table", "trajectory.file": file}


def with_voltages(given: Any) -> Any:
    """Return the keys of a law, or of several, with voltages that are arrays as files; others unchanged."""
    if isinstance(given, list | tuple):
        return [with_voltages(law) for law in given]
    voltage: Any = given.get("voltage") if isinstance(given, Mapping) else None
    is_array = hasattr(voltage, "__len__") and not isinstance(voltage, str)
    return {**given, "voltage": _table("voltage", voltage)} if is_array else given


def _table(name: str, history: History) -> MemoryFile:
    """Return a file in memory with the rows of an array."""
    try:
        pair = isinstance(history, tuple) and len(history) == 2
        rows = np.column_stack([*map(unmasked, history)]) if pair else unmasked(history)  # type: ignore[arg-type]
        rows = rows.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise ConfigError([f"{name}: {error}; must be an (m, 2) array, or a pair of arrays"]) from None
    if rows.ndim != 2 or rows.shape[1] != 2:
        shape = " x ".join(map(str, rows.shape))
        raise ConfigError([f"{name}: got an array of {shape}; must be (m, 2), or a pair of arrays"])
    text = "".join(f"{time!r} {value!r}\n" for time, value in rows.tolist())
    return _held(name, ".txt", text.encode())


def with_points(
    config: str | Path | Mapping[str, Any] | Config, punch: ArrayLike, values: Mapping[str, object]
) -> dict[str, object]:
    """Return the values with the points of an array of heights, unless points are given there or before."""
    own = {"grid": values["grid"]} if "grid" in values else config
    given = "grid.points" in values or gives(own, "grid.points")
    return dict(values) if given else {**values, "grid.points": list(numbers(punch).shape)}


def with_punch(config: Config, punch: ArrayLike | Callable[..., ArrayLike]) -> dict[str, object]:
    """Return the keys of a punch that is given as an array or a function, see `outward_heights`.

    Heights that are not finite numbers of the grid's shape, or a function for several grids, are a
    ConfigError.
    """
    if callable(punch) and any(key.startswith("grid.") for key in swept_keys(config.sweep)):
        message = "a function, which is evaluated on one grid; must be an array, or no key of grid be swept"
        raise ConfigError([f"punch: got {message}"])
    heights = outward_heights(punch, Grid(config.grid.points, config.grid.period))
    stream = io.BytesIO()
    np.save(stream, -heights, allow_pickle=False)  # a profile is counted from its lowest point
    return {"punch": {"shape": "profile", "file": _held("punch", ".npy", stream.getvalue())}}


def _held(kind: str, suffix: str, contents: bytes) -> MemoryFile:
    return MemoryFile(f"{kind}-{hashlib.sha256(contents).hexdigest()[:12]}{suffix}", contents)


def on_disk(config: Config, folder: Path) -> Config:
    """Write the files of a configuration that are in memory into a folder; return the one that names them."""
    keys: dict[str, Any] = {}
    held = {key: file for key, file in files_named(config).items() if isinstance(file, MemoryFile)}
    for key, file in held.items():
        if is_in_memory(file):
            _refuse_class(key, "in a folder")
        path = folder.absolute() / file.name
        if not path.exists():
            folder.mkdir(parents=True, exist_ok=True)
            with unfinished(path) as part:
                part.write_bytes(file.contents)
        keys[key] = path
    return from_python(config, keys) if keys else config


# Progress: nothing where a run is short, else moving lines, or a bar in a notebook.

DELAY = 1.0  # seconds of a run that pass in silence

_PREPARING = "compiling kernels, once per machine (about 20 s)"


class NotebookBar(Display):
    """A bar in the output of a notebook's cell."""

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html: Callable[[str], Any] = HTML
        self._bar = display(HTML(""), display_id=True)

    def note(self, line: str) -> None:
        """Write a line of its own."""
        print(line, file=sys.stderr)  # noqa: T201

    def advance(self, progress: Progress) -> None:
        """Move the bar."""
        bar = f'<progress value="{progress.fraction:.4f}" max="1"></progress>'
        self._bar.update(self._html(f"{bar} {html.escape(progress.words)}"))


class Delayed(Display):
    """A display that `make` makes when the run has taken some time; earlier lines wait for it."""

    def __init__(self, make: Callable[[], Display]) -> None:
        self._make, self._begun = make, time.monotonic()
        self._display: Display | None = None
        self._waiting: list[str] = []

    def note(self, line: str) -> None:
        """Show an event, or keep it for later."""
        self._waiting.append(line)
        self._show()

    def advance(self, progress: Progress) -> None:
        """Show the progress of a run that takes some time."""
        self._show()
        if self._display is not None:
            self._display.advance(progress)

    def close(self) -> None:
        """Stop moving lines."""
        if self._display is not None:
            self._display.close()

    def _show(self) -> None:
        if self._display is None and time.monotonic() - self._begun > DELAY:
            self._display = self._make()
        while self._display is not None and self._waiting:
            self._display.note(self._waiting.pop(0))


def chosen_display(progress: bool | None) -> Display | None:
    """Return the display of a run; by default (None) in a notebook or a terminal, after `DELAY`."""
    make = NotebookBar if in_notebook() else make_display
    if progress is None:
        return Delayed(make) if in_notebook() or sys.stderr.isatty() else None
    return make() if progress else None


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


# Running cases in memory: the data of each come back with its outcome.

GUARD = 'a script with jobs must call run under `if __name__ == "__main__":`'


class Result(NamedTuple):
    """Contents of a case, or the error that it ended with, and the warnings of its observables."""

    data: CaseContents | None
    error: Exception | None = None
    said: Sequence[str] = ()


def _compute(case: SweepCase, threads: int | None, claim: Claim | AtWork) -> Outcome:
    """Run a case in memory."""
    begun, config = time.monotonic(), case.config
    try:
        model = model_of(config, threads, drives=case.drives)
        recording, described = Recording(), case_run.attributes(model) | {"digest": digest(config)}

        def contents() -> CaseContents:
            known = described | accuracy(model, recording)
            about = known, model.columns, config.unit, case.values, model.places
            return case_contents(recording, model.coordinates, *about)

        with claim:
            try:
                said = model.run(recording, claim.advance)
            except ConvergenceError as error:
                error.data = contents().dataset()
                raise
        result = Result(contents(), said=said)
    except interrupts.Stopped:
        return Outcome(case.index, "stopped")
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        if parent_process() is not None and not isinstance(error, ConvergenceError):
            error = RuntimeError(reason)  # errors of any class may not be sent
        return Outcome(case.index, "failed", reason, time.monotonic() - begun, result=Result(None, error))
    return Outcome(case.index, "complete", seconds=time.monotonic() - begun, result=result)


def _run_in_memory(cases: Cases, progress: bool | None, jobs: int, threads: int | None) -> xarray.Dataset:
    """Run the cases on a number of processes, this one among them; return their data."""
    config, every, display = cases.config, list(cases), chosen_display(progress)
    _warn(notes(case.config for case in every))
    if min(jobs, len(every)) == 1:
        results = _one_after_the_other(every, display, threads)
    else:
        results = _side_by_side(every, display, min(jobs, len(every)), threads)
    if any(outcome.state == "stopped" for outcome in results):
        raise KeyboardInterrupt
    if not config.sweep:
        (result,) = (_result(outcome) for outcome in results)
        if result.error is not None:
            raise result.error
        _warn(result.said)
        assert result.data is not None
        return result.data.dataset()
    return _gathered(config, every, results)


def _one_after_the_other(
    every: Sequence[SweepCase], display: Display | None, threads: int | None
) -> list[Outcome]:
    """Run the cases in this process, without a folder."""
    outcomes: list[Outcome] = []
    at_work: list[AtWork] = []
    with ExitStack() as shown:
        reporter = None
        if display is not None:
            reporter = _reported(shown, Folder(Path(os.devnull), name_of_run()), every, display)
            reporter.at_work = lambda: [case.index for case in at_work]
            reporter.claims = lambda _: [case.running for case in at_work]
        for case in every:
            steps = case.cost.steps if reporter is not None else 0
            at_work[:] = [AtWork(case.index, case.config.time.end, label(case.values), steps)]
            outcomes.append(_compute(case, threads, at_work[0]))
            at_work.clear()
            if reporter is not None:
                reporter.ended(outcomes[-1])
    return outcomes


def _side_by_side(
    every: Sequence[SweepCase], display: Display | None, jobs: int, threads: int | None
) -> list[Outcome]:
    """Run the cases on a pool of processes, this one among them."""
    outcomes: dict[int, Outcome] = {}
    with _scratch() as folder, pool_of(jobs) as pool, ExitStack() as shown:
        reporter = _reported(shown, folder, every, display or Display())
        _warn(case_run.warm_up(every))  # before several processes do
        task = partial(_compute_claimed, folder=folder, threads=threads)
        schedule = Schedule(pool, task, folder, reporter.ended)
        reporter.at_work = schedule.at_work
        for outcome in schedule.run(every):
            outcomes[outcome.index] = outcome
    return [outcomes[case.index] for case in every]


def _compute_claimed(case: SweepCase, folder: Folder, threads: int | None) -> Outcome:
    """Run a case in memory, with its claim in a folder."""
    claim = Claim(folder, case.index, case.config.time.end, label(case.values), case.cost.steps)
    return _compute(case, threads, claim)


def _reported(shown: ExitStack, folder: Folder, every: Sequence[SweepCase], display: Display) -> Reporter:
    """Show the progress of the cases until the end of a block; say what goes on in a long first step."""
    reporter = shown.enter_context(Reporter(folder, range(len(every)), 0, lambda: display))
    timer = threading.Timer(PREPARATION, _say_what_goes_on, [reporter])
    timer.start()
    shown.callback(timer.cancel)
    return reporter


def _say_what_goes_on(reporter: Reporter) -> None:
    if all(case.steps == 0 for case in reporter.claims(None)):
        reporter.note(_PREPARING)


def _result(outcome: Outcome) -> Result:
    """Return the result of a case; of one whose process died an error."""
    found: Result = outcome.result or Result(None, RuntimeError(outcome.reason))
    return found


@contextmanager
def _scratch() -> Iterator[Folder]:
    """Give a folder for the claims of cases; without one there is no progress of single cases."""
    try:
        place = tempfile.TemporaryDirectory(prefix="gfmdlayer-", ignore_cleanup_errors=True)
    except OSError:
        yield Folder(Path(os.devnull), name_of_run())
        return
    with place as name:
        folder = Folder(Path(name), name_of_run())
        folder.cases.mkdir()
        yield folder


def pool_of(jobs: int) -> AbstractContextManager[workers.WorkerPool]:
    """Give a pool of so many processes."""
    return workers.alone() if jobs == 1 else workers.processes(jobs)


Punch = ArrayLike | Callable[..., ArrayLike] | Shape | Mapping[str, Any]


@entry()
def run(
    config: str | Path | Mapping[str, Any] | Config,
    *,
    punch: Punch | None = None,
    history: History | None = None,
    out: str | Path | None = None,
    progress: bool | None = None,
    jobs: int = 1,
    threads: int | None = None,
    trust: bool = False,
    observables: Sequence[type[Observable]] = (),
    **values: object,
) -> xarray.Dataset:
    """Run a configuration and return its results.

    Parameters
    ----------
    config : path, mapping or Config
        A YAML file, the file of a case, or the same keys in Python; a mapping needs no name.
    punch : array_like, callable, shape or mapping, optional
        The punch in place of the configuration's. An array has the shape of the grid (and gives
        `grid.points` where the configuration does not); a function takes x, or x and y, as arrays. Heights
        are counted outward from the punch, as those of a measured surface: the largest touches first, and a
        round punch is -x^2/(2 R). Only differences of heights count.
    history : array_like, shape (m, 2), or pair of array_like, optional
        Time and what `trajectory.control` says, depth or load, in place of the configuration's; linear
        between the rows, from time 0 on.
    out : path, optional
        Results folder, as the command line writes it; complete cases in it are not run again. Without it
        nothing is written.
    progress : bool, optional
        Whether progress is shown; by default in a terminal or a notebook, where it takes more than a second.
    jobs : int
        Processes that compute the cases of a sweep. A script that asks for several begins with
        ``if __name__ == "__main__":``.
    threads : int, optional
        Threads for the transforms of a large grid; by default two from 2048 x 2048 points in one process,
        else one.
    trust : bool
        Of the file of a case: run the Python code that it names as its body; without it such a file is
        refused.
    observables : sequence of type
        Classes of your own that derive from `Observable`, for columns of a run in memory and one process.
    **values
        Keys of the configuration and their values: ``layer__thickness=0.1``, or
        ``**{"layer.thickness": 0.1}``; None leaves a key out. The `voltage` of an interface law may be an
        array, as `history`.

    Returns
    -------
    xarray.Dataset
        Of one case all columns along `time`, and displacement, pressure and gap along (snapshot, x[, y]), as
        `open_case` gives them; of a sweep those that `open_results` gives, along the swept keys.

    Raises
    ------
    ConfigError
        If the configuration cannot be used; with every error, before anything is computed.
    ConvergenceError
        If a step does not reach the solver's tolerance, with the state and the steps before it. A case of a
        sweep that fails is NaN, is named in the attribute `failed`, and causes a warning.
    FolderError
        If `out` cannot be used for these results.

    Examples
    --------
    >>> x = np.arange(256) / 256 - 0.5
    >>> data = gfmdlayer.run({"time": {"end": 2.0, "step": 0.1}}, punch=-(x**2) / 0.5, layer__thickness=0.1)
    >>> data.contact_area.sizes["time"], float(data.contact_area[-1]) > float(data.contact_area[10])
    (21, True)

    A sweep:

    >>> data = gfmdlayer.run({"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 256}},
    ...                      sweep={"layer.thickness": [0.05, 0.1], "layer.material.tau": [1, 10]})
    >>> dict(data.mean_pressure.sizes)
    {'thickness': 2, 'tau': 2, 'time': 3}
    """
    if getattr(current_process(), "_inheriting", False):  # it is being started, and imports the script
        raise RuntimeError(f"run was called while a process of another run starts: {GUARD}")
    check_jobs(jobs, threads)
    threads = 1 if threads is None and jobs > 1 else threads
    if not isinstance(progress, bool | None):
        raise ConfigError([f"progress: got {shown(progress)}; must be True, False or None"])
    if not isinstance(out, str | os.PathLike | None):
        raise ConfigError([f"out: got {shown(out)}; must be the name of a folder"])
    keys = {key.replace("__", "."): value for key, value in values.items()}
    if observables:
        if out is not None or jobs > 1:
            beside = "out" if out is not None else "several jobs"
            raise ConfigError(
                [f"observables: not available with {beside}: only this process has the classes"]
            )
        if isinstance(config, Config):  # what is kept with the user's has not these columns
            config = config.model_copy()
    with ExitStack() as stack:
        try:
            if observables:
                stack.enter_context(measured_too(observables))
        except (TypeError, ValueError) as error:
            raise ConfigError([f"observables: {error}"]) from None
        cases = checked(partial(configuration, config, punch, history, keys, trust))
        if jobs > 1:
            for key, file in files_named(cases.config).items():
                if is_in_memory(file):
                    _refuse_class(key, "with several jobs")
        if out is not None:
            return _run_in_folder(cases, Path(out), progress, jobs, threads)
        return _run_in_memory(cases, progress, jobs, threads)


def _refuse_class(key: str, where: str) -> NoReturn:
    """Raise a ConfigError for a body of a class that no file defines, where other processes need it."""
    key = key.removesuffix(".file")
    message = f"{key}: got a class of this session, which runs {where} cannot read"
    raise ConfigError([f"{message}; must be in a file: {{file: mine.py, ...}}"])


def check_jobs(jobs: object, threads: object = None) -> None:
    """Raise a ConfigError unless these are whole numbers above zero."""
    for name, value in (("jobs", jobs), ("threads", threads)):
        if value is None and name == "threads":
            continue
        if not isinstance(value, int) or value < 1:
            raise ConfigError([f"{name}: got {shown(value)}; must be a whole number >= 1"])


def configuration(
    config: str | Path | Mapping[str, Any] | Config,
    punch: Punch | None,
    history: History | None,
    values: dict[str, object],
    trust: bool,
    inspect: Inspection,
) -> Config:
    """Return the checked configuration, with arrays as files in memory."""
    if not isinstance(config, str | os.PathLike | Mapping | Config):
        raise ConfigError([f"config: got {type(config).__name__}; must be a path, a mapping or a Config"])
    if isinstance(punch, Shape | Mapping | str):
        values, punch = values | {"punch": punch}, None
    if punch is not None:
        values = values | {"punch": None}  # the configuration's own one need not fit into the cell
        values = values if callable(punch) else with_points(config, punch, values)
    if "interface" in values:
        values = values | {"interface": with_voltages(values["interface"])}
    if history is not None:
        values |= with_history(history)
    if isinstance(config, Config | Mapping):
        given = config if isinstance(config, Config) else {"name": "run", **config}
        if isinstance(given, Mapping) and "interface" in given:
            given = {**given, "interface": with_voltages(given["interface"])}
        found = from_python(given, values, inspect if punch is None else None)
    else:
        found = read_config(config, values, inspect if punch is None else None, trust=trust)
    return found if punch is None else from_python(found, with_punch(found, punch), inspect)


def _gathered(config: Config, every: Sequence[SweepCase], outcomes: Sequence[Outcome]) -> xarray.Dataset:
    """Return the cases of a sweep as one dataset."""
    results = [_result(outcome) for outcome in outcomes]
    errors = [result.error for result in results if result.error]
    if len(errors) == len(every):
        raise errors[0]
    _warn(dict.fromkeys(text for result in results for text in result.said))
    failed = [each for each in outcomes if each.state == "failed"]
    _warn_of_failures([f"{each.index:04d}: {each.reason}" for each in failed], len(every))
    records = [
        CaseRecord(case.index, result.data, case.values, outcome.reason or None)
        for case, outcome, result in zip(every, outcomes, results, strict=True)
    ]
    return labelled(records, Swept.of(config.sweep, config.unit, config.output.row_times))


def _run_in_folder(
    cases: Cases, out: Path, progress: bool | None, jobs: int, threads: int | None
) -> xarray.Dataset:
    """Run the cases as the command line does; return the opened results."""
    Folder(out).refuse_foreign()
    config = on_disk(cases.config, out / "arrays")
    cases = cases if config is cases.config else Cases(config)
    _warn(notes(case.config for case in cases.sample()))
    display = chosen_display(progress)
    show = None if display is None else lambda: display
    with interrupts.listening(), pool_of(jobs) as pool:
        summary = run_study(cases, out, pool, RunOptions(threads=threads), show)
    if summary.count("stopped"):
        raise KeyboardInterrupt
    if len(summary.failures) == summary.total:
        name, _, reason = summary.failures[0].reason.partition(": ")
        raise (
            ConvergenceError(reason)
            if name == ConvergenceError.__name__
            else RuntimeError(f"{name}: {reason}")
        )
    _warn_of_failures([f"{each.index:04d}: {each.reason}" for each in summary.failures], summary.total)
    return open_results(out)


def _warn_of_failures(reasons: Sequence[str], total: int) -> None:
    if reasons:
        _warn([f"{len(reasons)} of {total} cases failed and are NaN:\n" + "\n".join(reasons)])


def _warn(texts: Iterable[str]) -> None:
    """Warn of each."""
    for text in texts:
        warn(text)
