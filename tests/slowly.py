"""`gfmdlayer` with steps that take 50 ms: a signal meets a short case at work, in whatever process."""

from __future__ import annotations

import sys
import time

from gfmdlayer.study.case_run import Checkpoints
from gfmdlayer.study.claims import Claim

advance = Claim.advance


def slowly(self: Claim, simulated_time: float) -> None:
    time.sleep(0.05)
    advance(self, simulated_time)


Claim.advance = slowly  # type: ignore[method-assign]
Checkpoints.stepwise = property(lambda _: True)  # type: ignore[method-assign, assignment]

if __name__ == "__main__":  # and not in the processes that it starts
    from gfmdlayer.cli import main

    sys.exit(main())
