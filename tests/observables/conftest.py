"""A run that is stopped, as by a signal."""

import pytest

from gfmdlayer.study.case_run import run_case
from gfmdlayer.study.claims import Claim
from gfmdlayer.study.interrupts import Stopped


@pytest.fixture
def run_up_to(monkeypatch):
    """Run a case up to a simulated time."""
    advance = Claim.advance

    def run(time, case, folder):
        def stopping(self, simulated):
            advance(self, simulated)
            if simulated >= time:
                raise Stopped

        with monkeypatch.context() as once:
            once.setattr(Claim, "advance", stopping)
            assert run_case(case, folder).state == "stopped"

    return run
