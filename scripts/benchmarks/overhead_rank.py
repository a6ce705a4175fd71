"""One rank of the run that `overhead` measures: `gfmdlayer run` with a clock around every solve.

    [mpirun -n N] python overhead_rank.py CLOCK CONFIG DIR

leaves CLOCK-PID.json: seconds spent in `Solver.solve`, the number of cases, and when the first of them began.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from gfmdlayer.cli import main
from gfmdlayer.config import load
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.results.writer import CaseWriter


@dataclass
class Clock:
    """What this rank has spent."""

    solving: float = 0.0
    cases: int = 0
    begun: float = 0.0

    def around_cases(self, enter: Callable[[Any], Any]) -> Callable[[Any], Any]:
        """Count the cases by their files; what was solved before the first one was to compile the solver."""

        def counted(writer: Any) -> Any:
            if not self.cases:
                self.begun, self.solving = time.time(), 0.0
            self.cases += 1
            return enter(writer)

        return counted

    def around_solves(self, solve: Callable[..., Any]) -> Callable[..., Any]:
        """Add up the time of every solve."""

        def timed(*given: Any) -> Any:
            begun = time.perf_counter()
            solution = solve(*given)
            self.solving += time.perf_counter() - begun
            return solution

        return timed


def run(clock_file: str, config: str, directory: str) -> int:
    """Run the command line and write down what was spent."""
    clock = Clock()
    CaseWriter.__enter__ = clock.around_cases(CaseWriter.__enter__)
    solver = SOLVERS[load(Path(config)).solver.method].load()
    solver.solve = clock.around_solves(solver.solve)
    status = main(["run", config, "--out", directory])
    Path(f"{clock_file}-{os.getpid()}.json").write_text(json.dumps(asdict(clock)), encoding="utf-8")
    return status


if __name__ == "__main__":
    sys.exit(run(*sys.argv[1:]))
