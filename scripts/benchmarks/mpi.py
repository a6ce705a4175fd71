"""Run the script of a section in one process or on MPI ranks."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path


def mpirun() -> str | None:
    """Return the launcher of the environment's own MPI library, or of the machine's, or None."""
    return shutil.which("mpirun", path=str(Path(sys.executable).parent)) or shutil.which("mpirun")


def over_ranks(number: int, script: str, *arguments: str, folder: Path | None = None) -> str | None:
    """Run a script on MPI ranks and return the last line of its output; None without mpirun.

    One rank needs no launcher. A failed script raises RuntimeError.
    """
    launcher = mpirun()
    if number > 1 and launcher is None:
        return None
    ranks = [launcher, "-n", str(number)] if number > 1 and launcher else []
    paths = (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))
    done = subprocess.run(
        [*ranks, sys.executable, script, *arguments],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{script} on {number} ranks: {done.stderr}")
    return done.stdout.splitlines()[-1]
