"""Runs that are killed and disturbed at random, and taken up until they are complete.

A study is run undisturbed; then again, by launchers drawn for each attempt, while signals hit all of its
processes, one of them or the launcher, and faults hit its files. What has a final name must be readable at
any time, all processes must end soon after one is killed, nothing may end in a traceback, and what is
complete must equal the undisturbed run bit by bit.
"""

from __future__ import annotations

import os
import shutil
import signal
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
from trials.configurations import Draw, choose
from trials.launches import Launch, Limits, alive, command, waited
from trials.outcomes import Outcome, Patience, Wrong
from trials.studies import Study, study

from gfmdlayer.results.reader import attributes, is_complete

LONGEST = 60.0  # seconds of an undisturbed run, above which a study is not used
GRACE = 10.0  # seconds in which all processes of a run must have ended after one was killed
LATE = 0.8  # part of the kills that come after the first case has begun
GROWING = 0.3  # part of the studies that begin with one case
PATIENCE = 180.0  # seconds after which a run counts as one that hangs
ATTEMPTS = 12  # disturbed runs of a trial
ENDS = (0, 1, 75)  # exit status of a run that could do its work
SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
KEEPER = "resource_tracker"  # of Python's semaphores, whose death Python answers with a traceback of its own
DEAF = "hydra_pmi_proxy"  # of MPICH, which does nothing at SIGINT
LEFT = (".aside", ".xdmf")
Bits = dict[str, bytes]


class Trial:
    """A study, its undisturbed run, and the folder `out` of disturbed ones."""

    def __init__(self, rng: Draw, folder: Path, ways: tuple[str, ...]) -> None:
        self.rng, self.folder, self.ways = rng, folder, ways
        self.events: Counter[str] = Counter()
        self.out = folder / "out"
        self._arguments = ("run", "study.yaml", "--checkpoint-every", str(choose(rng, 0, 0, 0.05)), "--out")
        self.environment = {"XDG_CACHE_HOME": str(folder / "cache"), "HOME": str(folder)}

    def launch(self, way: str, out: str = "out", limits: Limits | None = None) -> Launch:
        """Start a run."""
        limits = limits or Limits()
        limits.environment |= self.environment
        return Launch(way, (*self._arguments, out), self.folder, limits)

    def whole(self, chosen: Study, out: str = "whole") -> Launch:
        """Run a study undisturbed."""
        chosen.write(self.folder)
        run = self.launch("grids" if "grids" in self.ways else "forked", out)
        run.wait(LONGEST)
        self.stop(run)
        if run.crashed():
            raise Wrong("traceback", run.text())
        return run

    def stop(self, run: Launch) -> None:
        """Kill a run that has not ended."""
        for process in run.family():
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        run.wait(GRACE)

    def grow(self, chosen: Study, spent: float) -> None:
        """Begin the results with the first case of a study alone, up to a random moment."""
        first = {key: values[:1] for key, values in chosen.config["sweep"].items()}
        Study(chosen.config | {"sweep": first}, chosen.tables).write(self.folder)
        run = self.launch(choose(self.rng, *self.ways))
        run.wait(self.rng.uniform(0, 3) * spent)
        self.stop(run)
        chosen.write(self.folder)
        self.events["growing studies"] += 1

    def kill_one(self, spent: float, status: int) -> None:
        """Start a run, send a signal at a random moment, and wait until all has ended."""
        way = choose(self.rng, *self.ways)
        run = self.launch(way)
        if self.rng.random() < LATE:
            patience = Patience(PATIENCE)
            while run.poll() is None and not list(self.out.glob("cases/*.running")) and patience:
                pass
            run.wait(self.rng.uniform(0, spent))
        else:
            run.wait(self.rng.uniform(0, 0.2 if way == "forked" else 3.0))
        family = run.family()
        if not family:
            self._complete(run, status)
            return
        number, whom = choose(self.rng, *SIGNALS), choose(self.rng, "all", "one", "launcher")
        one = choose(self.rng, *(each for each in family if KEEPER not in command(each)))
        victims = {"all": family, "one": [one], "launcher": [run.pid]}[whom]
        goes_on = number == signal.SIGINT and all(DEAF in command(victim) for victim in victims)
        struck = [_struck(victim, number) for victim in victims]
        goes_on |= not any(struck)
        self.events.update(("kills", f"kills: {way}", f"kills: {number.name} to {whom}"))
        self._check_readable()
        goes_on |= way == "processes" and run.pid not in victims  # another worker takes its place
        self._await(run, family, f"{way}, {number.name} to {whom}", PATIENCE if goes_on else GRACE)
        self._check_readable()
        if run.status == status and (self.out / "sweep.h5").exists():
            self._complete(run, status)

    def finish(self, status: int) -> None:
        """Run to the end, and compare with the undisturbed run."""
        run = self.launch(choose(self.rng, *self.ways))
        run.wait(PATIENCE)
        if run.poll() is None:
            self.stop(run)
            raise Wrong("hangs", f"the last run: {run.text()}")
        self._complete(run, status)

    def _complete(self, run: Launch, status: int) -> None:
        """Compare a run that has ended with the undisturbed one, and remove its results."""
        if run.status != status or run.crashed():
            raise Wrong("ended badly", f"with {run.status}, not {status}: {run.text()}")
        self._check_readable()
        self.compare()
        self.events["compared bit by bit"] += 1
        shutil.rmtree(self.out)

    def compare(self) -> None:
        """Compare with the undisturbed run."""
        whole, found = bits(self.folder / "whole"), bits(self.out)
        different = sorted(name for name in whole.keys() | found.keys() if whole.get(name) != found.get(name))
        if different:
            raise Wrong("other bits", ", ".join(different[:20]))
        expected = {path.name for path in (self.folder / "whole/cases").iterdir()}
        left = {path.name for path in (self.out / "cases").iterdir() if path.suffix not in LEFT} - expected
        if left - {".lock"}:
            raise Wrong("left behind", ", ".join(sorted(left)))

    def _await(self, run: Launch, family: list[int], told: str, grace: float) -> None:
        """Wait until all processes have ended, which may take `grace` on a machine that serves them alone."""
        patience, delays = Patience(PATIENCE), {process: waited(process) for process in family}
        late = spent = 0.0
        while (living := [process for process in family if alive(process)]) and patience:
            # Of all: those that end last, as the launcher, may have waited for those that had no processor.
            late = max(late, *(waited(process) - delays[process] for process in living))
            spent = patience.spent - late
            run.poll()
        for process in living:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        run.wait(GRACE)
        if living:
            raise Wrong("hangs", f"{told}: {len(living)} of {len(family)} processes left: {run.text()}")
        if run.crashed():
            raise Wrong("traceback", f"{told}: {run.text()}")
        if spent > grace:
            raise Wrong(
                "ends late", f"{told}: after {patience.spent:.1f} s, {late:.1f} s of them without a processor"
            )
        if grace == GRACE:
            slowest = round(1000 * max(spent, 0.0))
            self.events["slowest end in ms"] = max(self.events["slowest end in ms"], slowest)

    def _check_readable(self) -> None:
        for path in self.out.rglob("*.h5"):
            try:
                contents(path)
                whole = path.name == "sweep.h5" or is_complete(path)
            except FileNotFoundError:  # set aside or replaced meanwhile
                continue
            except OSError:
                whole = False
            if not whole:
                raise Wrong("unreadable", f"{path.name} under its final name")


def _struck(process: int, number: int) -> bool:
    """Send a signal; return whether the process had not ended before."""
    with suppress(ProcessLookupError):
        os.kill(process, number)
        return True
    return False


def killed(seed: int, index: int, folder: Path, ways: tuple[str, ...] = ()) -> Outcome:
    """Kill runs of a study by one of the ways to start it, several times."""
    rng = np.random.default_rng((seed, index))
    drawn = choose(
        rng, ("forked",), ("forked", "serial"), ("processes", "forked"), ("ranks", "forked"), ("grids",)
    )
    trial = Trial(rng, folder, ways or drawn)
    return tried(trial, "grids" in trial.ways, Trial.kill_one)


def tried(trial: Trial, together: bool, disturb: Callable[[Trial, float, int], None]) -> Outcome:
    """Run a study undisturbed, disturb runs of it several times, and compare.

    `together`: ranks share a surface. `disturb` takes the trial, and the seconds and the exit status of the
    undisturbed run.
    """
    try:
        chosen = study(trial.rng, together)
        run = trial.whole(chosen)
        if run.status not in (0, 1):
            kind = "refused" if run.status == 2 else "too long"
            return Outcome(kind, run.text(), Counter({f"studies {kind}": 1}))
        spent = sum(map(seconds, (trial.folder / "whole/cases").glob("*.h5")))
        if trial.rng.random() < GROWING:
            trial.grow(chosen, spent)
        for _ in range(trial.rng.integers(1, ATTEMPTS + 1)):
            disturb(trial, spent, run.status)
        if trial.out.exists():
            trial.finish(run.status)
    except Wrong as wrong:
        kind, text = wrong.args
        return Outcome(kind, text, trial.events)
    return Outcome("equal", "", trial.events)


def bits(folder: Path) -> Bits:
    """Return every variable of every file below a folder."""
    return {
        f"{path.relative_to(folder)}:{name}": value
        for path in folder.rglob("*.h5")
        for name, value in contents(path).items()
    }


def contents(path: Path) -> Bits:
    """Return the bits of every variable of a file."""
    with h5py.File(path, locking=False) as h5:
        values = {name: np.asarray(h5[name]) for name in h5}
    return {
        name: str(v.tolist()).encode() if v.dtype.hasobject else v.tobytes() for name, v in values.items()
    }


def seconds(path: Path) -> float:
    """Return how long a case took."""
    return float(str(attributes(path)["wall_seconds"]))
