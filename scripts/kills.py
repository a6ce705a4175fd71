"""Kill runs at random, resume them, and check that nothing is lost, doubled, wrong or unreadable.

A small sweep is run by one process, by two, and by two MPI ranks in turn. In each run one process, the
launcher, the leader or a worker, gets SIGKILL at a random moment, and the next run resumes the sweep. A
complete sweep is compared, bit by bit, with an undisturbed one, and the next one begins.

    python scripts/kills.py 200
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np

from gfmdlayer.results.reader import attributes, is_complete

SWEEP = """\
name: kills
grid: {points: 64}
time: {end: 2.0, step: 0.02}
output: {snapshots: [0.5, 1.0, 2.0]}
sweep: {solver.method: [active_set, conjugate_gradient, fire], layer.thickness: [0.05, .inf]}
"""
MPIRUN = Path(sys.executable).parent / "mpirun"  # that of the environment's own MPI library
GFMDLAYER = (sys.executable, "-m", "gfmdlayer", "run", "kills.yaml", "--checkpoint-every", "0", "--out")
WAYS = {
    "one process": (*GFMDLAYER, "killed"),
    "--jobs 2": (*GFMDLAYER, "killed", "--jobs", "2"),
    "mpirun -n 2": (str(MPIRUN), "-n", "2", *GFMDLAYER, "killed"),
}
EARLY = 0.2  # part of the kills that may come before the first case is begun
PATIENCE = 120.0  # seconds after which a run that lost a process counts as hanging
GRACE = 10.0  # seconds in which all processes of a run must have ended after it

Bits = dict[str, bytes]


def main() -> int:
    """Kill, resume, compare; the exit status is 1 after any failure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kills", type=int, nargs="?", default=200, help="number of kills (default: 200)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the random moments and processes")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        trial = Trial(options.seed)
        with suppress(KeyboardInterrupt):  # the counts so far are printed
            while trial.counts["kills"] < options.kills:
                trial.kill_one()
                print(f"{trial.counts['kills']} of {options.kills} kills", end="\r", file=sys.stderr)
        trial.finish()
    print("\n".join(f"{count:6d}  {event}" for event, count in trial.counts.items()))
    for failure in trial.failures:
        print(f"FAILED  {failure}")
    return 1 if trial.failures else 0


class Trial:
    """Runs and kills, with `counts` of events and a list of `failures`."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        Path("kills.yaml").write_text(SWEEP, encoding="utf-8")
        subprocess.run([*GFMDLAYER, "whole"], check=True, capture_output=True)
        self._whole = bits(Path("whole"))
        self._seconds = [seconds(path) for path in sorted(Path("whole/cases").glob("*.h5"))]
        self._results = Path("killed")
        self.counts = Counter({"kills": 0, "unreadable under a final name": 0})
        self.failures: list[str] = []

    def kill_one(self) -> None:
        """Start a run, kill one of its processes, and wait for the others."""
        way = list(WAYS)[self.counts["kills"] % len(WAYS)]
        left = sum(self._seconds[len(list(self._results.glob("cases/*.h5"))) :])
        with Path("log").open("w", encoding="utf-8") as log:
            run = subprocess.Popen(WAYS[way], stdout=log, stderr=subprocess.STDOUT)
            if self._random.random() > EARLY:
                self._wait_for_the_first_case(run)
            with suppress(subprocess.TimeoutExpired):
                run.wait(self._random.uniform(0, left))
            family = [run.pid, *descendants(run.pid)]
            if run.poll() is None:
                victim = self._random.choice(family)
                with suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)
                    self.counts.update(("kills", f"by {way}"))
            self._check_readable()
            self._await(run, family, way)
        log_text = Path("log").read_text(encoding="utf-8")
        self.counts["cases taken up from a checkpoint"] += log_text.count("goes on from time")
        self.counts["checkpoints refused"] += log_text.count("set aside")
        self._check_readable()
        if run.returncode == 0:
            self._compare()
        elif "another run is writing" in log_text or "other input" in log_text or run.returncode == 2:
            self.failures.append(f"{way}: refused:\n{log_text}")

    def finish(self) -> None:
        """Run the sweep to its end."""
        ended = subprocess.run(WAYS["one process"], capture_output=True, text=True, check=False)
        if ended.returncode == 0:
            self._compare()
        else:
            self.failures.append(f"the last run ended with {ended.returncode}: {ended.stderr}")

    def _wait_for_the_first_case(self, run: subprocess.Popen[bytes]) -> None:
        while run.poll() is None and not list(self._results.glob("cases/*.running")):
            time.sleep(0.01)

    def _await(self, run: subprocess.Popen[bytes], family: list[int], way: str) -> None:
        try:
            run.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.failures.append(f"{way}: hangs after one of its processes was killed")
        deadline = time.monotonic() + GRACE
        while any(map(alive, family)) and time.monotonic() < deadline:
            time.sleep(0.02)
        for process in filter(alive, family):
            self.failures.append(f"{way}: left process {process} behind")
            os.kill(process, signal.SIGKILL)
        run.wait()

    def _check_readable(self) -> None:
        for path in self._results.rglob("*.h5"):
            try:
                contents(path)
                whole = path.name == "sweep.h5" or is_complete(path)
            except OSError:
                whole = False
            if not whole:
                self.counts["unreadable under a final name"] += 1
                self.failures.append(f"{path} is not readable")

    def _compare(self) -> None:
        found = bits(self._results)
        for name in found.keys() ^ self._whole.keys():
            self.failures.append(f"{name} is in one of the two sweeps only")
        for name in found.keys() & self._whole.keys():
            if found[name] != self._whole[name]:
                self.failures.append(f"{name} has other bits")
        left = {path.name for path in self._results.glob("cases/*") if path.suffix != ".h5"} - {".lock"}
        if left:
            self.failures.append(f"left behind: {', '.join(sorted(left))}")
        self.counts["complete sweeps, compared bit by bit"] += 1
        shutil.rmtree(self._results)


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


def descendants(pid: int) -> list[int]:
    """Return the children of a process, and theirs."""
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            state, parent = (entry / "stat").read_text().rpartition(")")[2].split()[:2]
            if state != "Z":
                parents.setdefault(int(parent), []).append(int(entry.name))
    found = [pid]
    for process in found:  # which grows in the loop
        found += parents.get(process, [])
    return found[1:]


def alive(pid: int) -> bool:
    """Whether a process still runs; a zombie does not."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


if __name__ == "__main__":
    sys.exit(main())
