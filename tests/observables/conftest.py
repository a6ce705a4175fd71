"""A run that is stopped, as by a signal."""

import pytest

from gfmdlayer.execution.case_run import run_case
from gfmdlayer.execution.interrupts import Stopped
from gfmdlayer.execution.status import StatusFile


@pytest.fixture
def run_up_to(monkeypatch):
    """Run a case up to a simulated time."""
    advance = StatusFile.advance

    def run(time, case, folder):
        def stopping(self, simulated):
            advance(self, simulated)
            if simulated >= time:
                raise Stopped

        with monkeypatch.context() as once:
            once.setattr(StatusFile, "advance", stopping)
            assert run_case(case, folder).state == "stopped"

    return run
