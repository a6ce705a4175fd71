"""Run a section's script over MPI ranks, where there is an mpirun."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path


def over_ranks(number: int, script: str, *arguments: str) -> str | None:
    """Return the last line that a script prints on this many ranks; None without an mpirun.

    Raises
    ------
    RuntimeError
        Where the script fails.
    """
    beside = Path(sys.executable).parent / "mpirun"  # that of the environment's own MPI library
    mpirun = str(beside) if beside.exists() else shutil.which("mpirun")
    if mpirun is None:
        return None
    found = (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH"))
    done = subprocess.run(
        [mpirun, "-n", str(number), sys.executable, script, *arguments],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, found))},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{script} on {number} ranks: {done.stderr}")
    return done.stdout.splitlines()[-1]
