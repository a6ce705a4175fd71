"""Faults of disk and files: a run must report them; the next run must find those between runs."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
from trials.configurations import choose
from trials.launches import Launch, Limits
from trials.outcomes import Outcome, Patience, Wrong
from trials.runs import ENDS, PATIENCE, Trial, tried

SHIM = "int flock(int fd, int how) {{ (void)fd; (void)how; __errno_location()[0] = {}; return -1; }}"
DECLARED = "extern int *__errno_location(void);\n"
LOCK_ERRORS = (37, 95, 22, 38)  # ENOLCK, EOPNOTSUPP, EINVAL, ENOSYS of Linux


def trial(seed: int, index: int, folder: Path) -> Outcome:
    """Disturb runs of a study by faults, and by kills between them."""
    rng = np.random.default_rng((seed, index))
    ways = choose(rng, ("forked",), ("forked", "serial"), ("processes",), ("ranks",), ("grids",))
    return tried(Trial(rng, folder, ways), "grids" in ways, _disturb)


def _disturb(trial: Trial, seconds: float, status: int) -> None:
    if trial.rng.random() < 0.5 or not trial.out.exists():
        trial.kill_one(seconds, status)
    # A case that ranks share cannot go on alone, and under MPI its own files are beyond the limit too.
    able = [fault for fault in FAULTS if fault is not _full_disk or "grids" not in trial.ways]
    fault = choose(trial.rng, *able)
    trial.events[f"faults: {fault.__name__.removeprefix('_').replace('_', ' ')}"] += 1
    fault(trial, seconds, status)


def _begun_anew(trial: Trial) -> str:
    """Choose a launch of a new process, to which limits apply, not a fork with loaded libraries."""
    return str(choose(trial.rng, *("serial" if way == "forked" else way for way in trial.ways)))


def _full_disk(trial: Trial, *_: object) -> None:
    way = choose(trial.rng, "serial", "processes")
    _ended(trial.launch(way, limits=Limits(file_size=int(10 ** trial.rng.uniform(3.7, 6)))), 2)


def _no_locks(trial: Trial, _: float, status: int) -> None:
    source, shim = trial.folder / "flock.c", trial.folder / "flock.so"
    source.write_text(DECLARED + SHIM.format(choose(trial.rng, *LOCK_ERRORS)))
    if shutil.which("cc") is None:
        return
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(shim), str(source)], check=True)
    _ended(trial.launch(_begun_anew(trial), limits=Limits({"LD_PRELOAD": str(shim)})), status, only=True)


def _folder_that_may_not_be_written(trial: Trial, seconds: float, _: int) -> None:
    run = trial.launch(_begun_anew(trial), limits=Limits(bound=True))
    patience = Patience(PATIENCE)
    while run.poll() is None and not list(trial.out.glob("cases/*.running")) and patience:
        pass
    run.wait(trial.rng.uniform(0, seconds))
    places = [place for place in (trial.out, trial.out / "cases") if place.exists()]
    for place in places:
        place.chmod(0o555)
    try:
        _ended(run, 2)
    finally:
        for place in places:
            place.chmod(0o755)


def _flipped_byte(trial: Trial, _: float, status: int) -> None:
    def flip(path: Path) -> None:
        content = bytearray(path.read_bytes())
        content[trial.rng.integers(len(content))] ^= 1 << trial.rng.integers(8)
        path.write_bytes(content)

    _damaged(trial, flip, status)


def _file_cut_short(trial: Trial, _: float, status: int) -> None:
    _damaged(trial, lambda path: os.truncate(path, int(trial.rng.integers(path.stat().st_size))), status)


def _lost_file(trial: Trial, _: float, status: int) -> None:
    _damaged(trial, Path.unlink, status)


FAULTS = (
    _full_disk,
    _no_locks,
    _folder_that_may_not_be_written,
    _flipped_byte,
    _flipped_byte,
    _file_cut_short,
    _lost_file,
)


def _damaged(trial: Trial, damage: Callable[[Path], None], status: int) -> None:
    """Damage a file; the next run repairs it, or refuses the folder and names the file. Then restore it."""
    files = sorted(path for path in trial.out.rglob("*") if path.is_file() and path.stat().st_size)
    if not files:
        return
    path = choose(trial.rng, *files)
    trial.events[
        f"damaged: {'*' if path.stem.isdecimal() else path.stem.partition('-')[0]}{path.suffix}"
    ] += 1
    kept = path.read_bytes()
    damage(path)
    run = trial.launch(choose(trial.rng, *trial.ways))
    _ended(run, 2)
    if run.status == 2:
        if str(path.relative_to(trial.out).parts[0]) not in run.text():
            raise Wrong("unclear message", f"{path.name} is damaged: {run.text()}")
        path.write_bytes(kept)
        trial.events["refused until the file was restored"] += 1
    elif run.status != status:
        raise Wrong("not mended", f"{path.name} is damaged: status {run.status}: {run.text()}")


def _ended(run: Launch, *statuses: int, only: bool = False) -> None:
    """Wait for the end of a run; its status must be one of these or, unless `only`, a usual one."""
    run.wait(PATIENCE)
    told = run.text()
    if run.poll() is None:
        raise Wrong("hangs", told)
    if run.status not in (statuses if only else (*ENDS, *statuses)):
        raise Wrong("ended badly", f"status {run.status}: {told}")
    if run.crashed():
        raise Wrong("traceback", told)
