"""Attack gfmdlayer at random for hours, and keep every failure with its seed.

The kinds of trials are drawn at random:

    extremes    an extreme case in memory: it converges to finite numbers, or an error names the step
    fuzz        a damaged configuration for `gfmdlayer check`: accepted, or rejected with a clear message
    kills       a study on one process, several processes, MPI ranks, or ranks with a shared surface; killed
    faults      the same with full disks, damaged and lost files, failing locks, folders without permission
    combos      three to six abilities together: refused in words, or run, drawn, reported, opened, compared
                with a run of half the tolerance, the energies balanced

Kills and faults end with a bitwise comparison with an undisturbed run. (S, i) determines trial i of seed S,
except for the moment at which a signal arrives.

    python scripts/soak.py 2                                        # hours
    python scripts/soak.py --only extremes --seed 7 --trials 1000 --methods fire newton
    python scripts/soak.py combos --seed 51                         # 2000 of this kind
    python scripts/soak.py --only kills --seed 1:17                 # trial 17 of seed 1 again
    python scripts/soak.py --table                                  # table of the results so far

The folder --out (default: soak) has trials.jsonl, one line per trial, and the files of each failed trial.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from trials import combinations, extremes, faults, fuzz, launches, runs
from trials.configurations import DEFAULT, draw
from trials.outcomes import GOOD, Outcome

from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.study.interrupts import stop_requested
from gfmdlayer.study.preflight import THREAD_VARIABLES
from gfmdlayer.study.workers import threads_each

KINDS: Mapping[str, Any] = {
    "extremes": extremes.trial,
    "fuzz": fuzz.trial,
    "kills": runs.killed,
    "faults": faults.trial,
    "combos": combinations.trial,
}
SHARES = {
    "extremes": 0.3,
    "fuzz": 0.3,
    "kills": 0.25,
    "faults": 0.15,
    "combos": 0.3,
}  # of the trials of all kinds
MANY = 2000  # trials of a single kind
SHOWN = 12  # failures of a kind that the table names


def main(arguments: Sequence[str] | None = None) -> int:
    """Run trials up to the given time or number; the exit status is 1 after any failure."""
    options = _parse(arguments)
    if options.table:
        print(table(_read(options.out)))
        return 0
    options.out.mkdir(parents=True, exist_ok=True)
    end = time.monotonic() + 3600 * options.hours
    failed = 0
    for index in _numbers(options):
        if time.monotonic() >= end:
            break
        failed += not _one(options, index)
        if stop_requested():
            break
    print(table(_read(options.out)))
    return int(failed > 0)


def _one(options: argparse.Namespace, index: int) -> bool:
    """Run a trial and record it."""
    kind = _kind(options, index)
    trial = KINDS[kind]
    if kind == "extremes":
        trial = partial(trial, methods=tuple(options.methods))
        if options.show:
            print(draw(options.seed, index, tuple(options.methods)))
    if kind == "kills" and options.ways:
        trial = partial(trial, ways=tuple(options.ways))
    folder = Path(tempfile.mkdtemp(prefix="soak-"))
    began = time.monotonic()
    outcome: Outcome = trial(options.seed, index, folder)
    if stop_requested():  # a signal has cut the trial short
        shutil.rmtree(folder, ignore_errors=True)
        return True
    line = {
        "trial": f"{options.seed}:{index}",
        "kind": kind,
        "end": outcome.kind,
        "text": outcome.text[-4000:],
    }
    line |= {"events": dict(outcome.events), "seconds": round(time.monotonic() - began, 2)}
    with (options.out / "trials.jsonl").open("a", encoding="utf-8") as lines:
        lines.write(json.dumps(line) + "\n")
    if outcome.good:
        shutil.rmtree(folder, ignore_errors=True)
    else:
        kept = options.out / f"{kind}-{options.seed}-{index}"
        shutil.rmtree(kept, ignore_errors=True)
        shutil.move(folder, kept)
        print(
            f"FAILED  {_again(options, kind, index)}\n        {outcome.kind}: {outcome.text[:400]}",
            flush=True,
        )
    return outcome.good


def _again(options: argparse.Namespace, kind: str, index: int) -> str:
    command = f"python scripts/soak.py --only {kind} --seed {options.seed}:{index}"
    if kind == "extremes" and options.methods != [DEFAULT]:
        command += f" --methods {' '.join(options.methods)}"
    if kind == "kills" and options.ways:
        command += f" --ways {' '.join(options.ways)}"
    return command


def _kind(options: argparse.Namespace, index: int) -> str:
    if len(options.only) == 1:
        return str(options.only[0])
    shares = np.array([SHARES[kind] for kind in options.only])
    rng = np.random.default_rng((options.seed, index, len(KINDS)))
    return str(rng.choice(options.only, p=shares / shares.sum()))


def _numbers(options: argparse.Namespace) -> Iterable[int]:
    most = options.trials if options.trials is not None else sys.maxsize
    return range(options.first, options.first + most)


def table(lines: Iterable[Mapping[str, Any]]) -> str:
    """Return the trials by kind and end, the seeds of failed ones, and the number of their events."""
    ends: defaultdict[tuple[str, str], list[str]] = defaultdict(list)
    events: Counter[str] = Counter()
    slowest: dict[str, int] = {}
    for line in lines:
        ends[line["kind"], line["end"]].append(line["trial"])
        for name, count in line["events"].items():
            if name.startswith("slowest"):
                slowest[name] = max(slowest.get(name, 0), count)
            else:
                events[name] += count
    rows = ["| trials | end | number | seeds |", "|---|---|---|---|"]
    for (kind, end), trials in sorted(ends.items()):
        which = "" if end in GOOD else ", ".join(trials[:SHOWN]) + " ..." * (len(trials) > SHOWN)
        rows.append(f"| {kind} | {end} | {len(trials)} | {which} |")
    rows += ["", "| event | number |", "|---|---|"]
    rows += [f"| {name} | {count} |" for name, count in (*sorted(events.items()), *sorted(slowest.items()))]
    return "\n".join(rows)


def _read(folder: Path) -> Iterator[dict[str, Any]]:
    with (folder / "trials.jsonl").open(encoding="utf-8") as lines:
        yield from map(json.loads, lines)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add(
        "hours",
        nargs="?",
        help=f"no trial starts after this time; or a kind of trials: so many of it, {MANY}",
    )
    add("--seed", default="1", help="seed of all trials; S:I runs only trial I")
    add("--trials", type=int, help="number of trials")
    add("--first", type=int, default=0, help="number of the first trial")
    add("--only", nargs="+", choices=list(KINDS), default=list(KINDS), metavar="KIND", help="kinds of trials")
    add(
        "--methods",
        nargs="+",
        choices=list(SOLVERS),
        default=[DEFAULT],
        metavar="SOLVER",
        help="for extremes",
    )
    add(
        "--ways",
        nargs="+",
        choices=list(launches.WAYS),
        default=[],
        metavar="WAY",
        help="launches of kills: %(choices)s",
    )
    add("--out", type=Path, default=Path("soak"), help="folder of the results (default: soak)")
    add("--show", action="store_true", help="print the extreme cases")
    add("--table", action="store_true", help="only print the table of the folder")
    options = parser.parse_args(arguments)
    if options.hours in KINDS:
        options.only, options.hours = [options.hours], None
        options.trials = MANY if options.trials is None else options.trials
    try:
        options.hours = np.inf if options.hours is None else float(options.hours)
    except ValueError:
        parser.error(f"got {options.hours!r}; must be a number of hours, or one of {', '.join(KINDS)}")
    seed, colon, index = options.seed.partition(":")
    options.seed = int(seed)
    if colon:
        options.first, options.trials = int(index), 1
    if options.trials is None and options.hours == np.inf and not options.table:
        parser.error("give HOURS, --trials or --seed S:I")
    return options


if __name__ == "__main__":
    if not os.environ.keys() >= set(THREAD_VARIABLES):  # they must be set before the import of numpy
        threads_each(os.environ)
        os.execv(sys.executable, [sys.executable, *sys.argv])
    sys.exit(main())
