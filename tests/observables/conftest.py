"""A run that is stopped, as by a signal."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from gfmdlayer.execution.case_run import run_case
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.interrupts import Stopped
from gfmdlayer.execution.status import StatusFile
from gfmdlayer.execution.sweep import SweepCase

RunUpTo = Callable[[float, SweepCase, Folder], None]


@pytest.fixture
def run_up_to(monkeypatch: pytest.MonkeyPatch) -> RunUpTo:
    """Run a case up to a simulated time."""
    advance = StatusFile.advance

    def run(time: float, case: SweepCase, folder: Folder) -> None:
        def stopping(self: StatusFile, simulated: float) -> None:
            advance(self, simulated)
            if simulated >= time:
                raise Stopped

        with monkeypatch.context() as once:
            once.setattr(StatusFile, "advance", stopping)
            assert run_case(case, folder).state == "stopped"

    return run
