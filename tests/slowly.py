"""`gfmdlayer` with steps that take 50 ms: a signal meets a short case at work, in whatever process."""

from __future__ import annotations

import sys
import time

from gfmdlayer.study.claims import StatusFile

advance = StatusFile.advance


def slowly(self: StatusFile, simulated_time: float) -> None:
    time.sleep(0.05)
    advance(self, simulated_time)


StatusFile.advance = slowly  # type: ignore[method-assign]

if __name__ == "__main__":  # and not in the processes that it starts
    from gfmdlayer.cli import main

    sys.exit(main())
