"""Groups of ranks as the workers of a run.

The ranks of a job are divided into groups of equal size. The first of each group takes cases from the
schedule as a single process would, the first of the job among them, and starts each on its group; the others
wait for that, asleep.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, TypeVar

from gfmdlayer.config import Config
from gfmdlayer.config.reader import from_python
from gfmdlayer.contact.solvers import AUTO, SOLVERS
from gfmdlayer.grid.ranks import MpiRanks, Ranks
from gfmdlayer.grid.slabs import refused
from gfmdlayer.results.checkpoint import read_about
from gfmdlayer.study.case_run import ending_together, run_case
from gfmdlayer.study.cases import Cases, SweepCase, drawn, errors_of
from gfmdlayer.study.folder import Folder, FolderError
from gfmdlayer.study.preflight import launched_size
from gfmdlayer.study.schedule import Outcome
from gfmdlayer.study.workers import LauncherError, WorkerPool, alone, guarded, ranks, world
from gfmdlayer.validation.problems import Mistake

Result = TypeVar("Result")

_POLL = 0.005  # seconds between two looks of a waiting rank


class _Group:
    """The ranks that compute a case together with this one."""

    def __init__(self, communicator: Any) -> None:
        self._ranks = MpiRanks(communicator)

    def run(self, task: Callable[..., Result], *arguments: Any, **options: Any) -> Result:
        """Run a task on all ranks of the group; return the result of this one, the first."""
        try:
            self.send(task, *arguments, **options)
            return task(*arguments, **options, ranks=self._ranks)
        except KeyboardInterrupt:  # before the first case alone; the others would wait in the midst of it
            sys.stderr.write("gfmdlayer: stopped before the first case\n")
            self._ranks.control.Abort(os.EX_TEMPFAIL)
            raise

    def serve(self) -> None:
        """Run tasks with the first rank until it dismisses the group."""
        while True:
            while not self._ranks.control.iprobe(source=0):
                time.sleep(_POLL)
            task, arguments, options = self._ranks.control.recv(source=0)
            if task is None:
                return
            task(*arguments, **options, ranks=self._ranks)

    def send(self, task: Callable[..., object] | None, *arguments: Any, **options: Any) -> None:
        """Send a task to the other ranks of the group; without one, `serve` ends there."""
        for rank in range(1, self._ranks.count):
            self._ranks.control.send((task, arguments, options), rank)


class _OwnGroup:
    """The group of this process; a task that comes from another one has no other way to it."""

    group: _Group


def run_case_together(case: SweepCase, **options: Any) -> Outcome:
    """Run a case on the group of this process, see `run_case`."""
    return _OwnGroup.group.run(run_case, case, **options)


@contextmanager
def groups_of(size: int, prepare: Callable[[], None] | None = None) -> Iterator[WorkerPool | None]:
    """Assemble a pool of groups of `size` ranks; all but the first rank get None, after the run."""
    launched = launched_size(os.environ)
    if launched is None:
        raise LauncherError(f"--ranks-per-case {size}: needs MPI ranks; start it by mpirun -n {size}")
    comm = world(launched)
    count, number = comm.Get_size(), comm.Get_rank()
    if count % size and number:
        yield None  # the first rank says it
        return
    if count % size:
        raise LauncherError(f"--ranks-per-case {size}: got {count} ranks; must be a multiple of {size}")
    with guarded(comm):
        group = comm.Split(number // size, number)
        leaders = comm.Split(int(group.Get_rank() > 0), number)
        _OwnGroup.group = _Group(group)
        if group.Get_rank() > 0:
            if prepare is not None:
                prepare()
            _OwnGroup.group.serve()
            yield None
            return
        kind = f"group{'s' * (count > size)} of {size} MPI ranks"
        with alone() if count == size else ranks(leaders, prepare) as pool:
            yield pool and replace(pool, kind=kind)
        _OwnGroup.group.send(None)


# Cases that several ranks cannot compute together are refused before any work, with the key and why.


def with_shared_solver(config: Config) -> Config:
    """Return the configuration with nested gradients where `auto` takes a solver that ranks cannot share."""
    if config.solver.method != AUTO:
        return config
    chosen = {case.config.contact_solver.method for case in Cases(config).sample()} & SOLVERS.keys()
    if all(SOLVERS[method].distributed for method in chosen):
        return config
    return from_python(config, {"solver.method": "nested_gradient"})


def input_errors_together(config: Config, ranks_per_case: int) -> Iterable[tuple[str, str]]:
    """Check the cases for several ranks, and by these ranks their numbers and input files."""
    config = with_shared_solver(config)
    sample = Cases(config).sample()
    found = (mistake for case in sample for mistake in problems_together(case.config, ranks_per_case))
    errors = [(mistake.key, mistake.message) for mistake in found]
    return list(dict.fromkeys(errors)) or _OwnGroup.group.run(_input_errors, config)


def refuse_other_ranks(folder: Folder, begun: Sequence[int], ranks_per_case: int) -> None:
    """Refuse to go on with cases that another number of ranks has begun; of very many some are read."""
    for number in drawn(begun):
        path = folder.case(number, "checkpoint")
        about = read_about(path) if path.exists() else None
        ranks = int(about["made_by"].get("ranks", 1)) if about else ranks_per_case
        if ranks != ranks_per_case:
            raise FolderError(
                f"{path}: was written by {ranks} rank{'s' * (ranks > 1)} a case, and only this number can "
                f"continue it; resume with --ranks-per-case {ranks}, or --restart to start over"
            )


def _input_errors(config: Config, ranks: Ranks) -> list[tuple[str, str]]:
    with ending_together(ranks):
        return list(errors_of(Cases(config), ranks))


def problems_together(config: Config, ranks: int) -> Iterator[Mistake]:
    """Yield why several ranks cannot share the cases of a configuration without a sweep."""
    condition = f"with {ranks} ranks a case"
    if not config.geometry.on_grid:
        message = f"got {config.grid.geometry!r}; must be periodic {condition}"
        yield Mistake(("grid", "geometry"), message, because="physics")
        return
    if reason := refused(config.grid.points, ranks):
        yield Mistake(("grid", "points"), f"got {reason}", because="physics")
    chosen = config.contact_solver.method
    if not (config.friction or SOLVERS[chosen].distributed):
        able = " or ".join(name for name, solver in SOLVERS.items() if solver.distributed)
        yield Mistake(("solver", "method"), f"got {chosen!r}; must be {able} {condition}")
    if config.output.keep_state:
        yield Mistake(("output", "keep_state"), f"got true; must be false {condition}")
    if reason := config.punch.whole_only:
        message = f"{reason}, which needs the whole surface; not possible {condition}"
        yield Mistake(("punch",), message, because="open")
