"""Kernels that a case compiles on a new machine, and the processor time of each.

The time of a kernel is without that of the functions it calls. Functions of Numba's own are one row.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.common import Effort, Table, default_case
from benchmarks.rough import rough
from numba.core import event

from gfmdlayer.case.model import model_of
from gfmdlayer.config import Config

EFFORT = Effort(points=())
QUICK = EFFORT

_CASES = {"default": lambda: default_case(solver__method="active_set"), "rough": lambda: rough(512)}


def measure(_effort: Effort) -> Iterator[Table]:
    """Compile the kernels of each case in a process with an empty cache."""
    for name in _CASES:
        with TemporaryDirectory() as cache:
            folder = str(Path(__file__).parents[1])
            paths = os.pathsep.join(filter(None, (folder, os.environ.get("PYTHONPATH"))))
            environment = os.environ | {"NUMBA_CACHE_DIR": cache, "PYTHONPATH": paths}
            command = [sys.executable, __file__, name]
            answer = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        whole, found = json.loads(answer.stdout)
        parts: dict[str, float] = defaultdict(float)
        for kernel, seconds in found.items():
            parts["functions of Numba" if kernel.startswith("numba.") else kernel] += seconds
        parts |= {"the rest": whole - sum(parts.values()), "all": whole}
        ordered = sorted(parts.items(), key=lambda each: -each[1])
        rows = [{"kernel": kernel, "time [s]": seconds} for kernel, seconds in ordered]
        title = f"Kernels compiled at the first use, {name} case: {len(found)} functions"
        yield Table(f"first-use-{name}", title, rows)


class Clock(event.Listener):
    """Processor time of the compilation of each function, without that of the functions it calls."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._open = [(0.0, 0.0)]  # begin of each open function, and the time of those that it has called

    def on_start(self, _event: Any) -> None:
        """Begin a function."""
        self._open.append((time.process_time(), 0.0))

    def on_end(self, ended: Any) -> None:
        """End a function; its caller began earlier."""
        function = ended.data["dispatcher"].py_func
        begun, called = self._open.pop()
        whole = time.process_time() - begun
        self.seconds[f"{function.__module__}.{function.__qualname__}"] += whole - called
        begun, called = self._open.pop()
        self._open.append((begun, called + whole))


def compiled(config: Config) -> tuple[float, dict[str, float]]:
    """Return the processor time of a case's warm-up, and that of each function."""
    clock, begun = Clock(), time.process_time()
    with event.install_listener("numba:compile", clock):
        model_of(config).warm_up()
    return time.process_time() - begun, clock.seconds


if __name__ == "__main__":
    print(json.dumps(compiled(_CASES[sys.argv[1]]())))
