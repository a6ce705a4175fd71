"""Progress of a run from Python: nothing where it is short, else moving lines or a bar in a notebook."""

from __future__ import annotations

import html
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from gfmdlayer.execution.progress import PREPARATION, Display, make_display
from gfmdlayer.execution.schedule import Outcome, Progress
from gfmdlayer.execution.status import Running

DELAY = 1.0  # seconds of a run that pass in silence
INTERVAL = 0.2  # seconds between two updates

_PREPARING = "compiling kernels, planning transforms, once per machine (about 20 s)"


class NotebookBar(Display):
    """A bar in the output of a notebook's cell."""

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html: Callable[[str], Any] = HTML
        self._bar = display(HTML(""), display_id=True)

    def note(self, line: str) -> None:
        """Write a line of its own."""
        print(line, file=sys.stderr)  # noqa: T201

    def advance(self, progress: Progress) -> None:
        """Move the bar."""
        bar = f'<progress value="{progress.fraction:.4f}" max="1"></progress>'
        self._bar.update(self._html(f"{bar} {html.escape(progress.words)}"))


class Delayed(Display):
    """A display that `make` makes when the run has taken some time; earlier lines wait for it."""

    def __init__(self, make: Callable[[], Display]) -> None:
        self._make, self._begun = make, time.monotonic()
        self._display: Display | None = None
        self._waiting: list[str] = []

    def note(self, line: str) -> None:
        """Show an event, or keep it for later."""
        self._waiting.append(line)
        self._show()

    def advance(self, progress: Progress) -> None:
        """Show the progress of a run that takes some time."""
        self._show()
        if self._display is not None:
            self._display.advance(progress)

    def close(self) -> None:
        """Stop moving lines."""
        if self._display is not None:
            self._display.close()

    def _show(self) -> None:
        if self._display is None and time.monotonic() - self._begun > DELAY:
            self._display = self._make()
        while self._display is not None and self._waiting:
            self._display.note(self._waiting.pop(0))


def chosen_display(progress: bool | None) -> Display | None:
    """Return the display of a run; by default (None) in a notebook or a terminal, after `DELAY`."""
    make = NotebookBar if in_notebook() else make_display
    if progress is None:
        return Delayed(make) if in_notebook() or sys.stderr.isatty() else None
    return make() if progress else None


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


class Watch:
    """Watches `total` cases that this process computes, or waits for, and updates a display, if any."""

    def __init__(self, display: Display | None, total: int) -> None:
        self._display, self._total = display, total
        self._complete = self._failed = 0
        self._begun = self._shown = time.time()
        self._preparation = threading.Timer(PREPARATION, self._note, [_PREPARING])
        self._preparation.daemon = True
        if display is not None:
            self._preparation.start()

    def case(self, index: int, end: float, label: str = "") -> Callable[[float], None]:
        """Return the function that is called with the simulated time after each step of a case."""
        begun, steps = time.time(), 0

        def advance(reached: float) -> None:
            nonlocal steps
            steps += 1
            if self._display is None:
                return
            self._preparation.cancel()
            if (now := time.time()) - self._shown > INTERVAL:
                times: dict[str, Any] = {"started": begun, "updated": now, "since": begun, "since_time": 0.0}
                at_work = Running(index, "", os.getpid(), reached, end, label=label, steps=steps, **times)
                self._show((at_work,), now)

        return advance

    def ended(self, outcome: Outcome) -> None:
        """Count a case."""
        failed = outcome.state == "failed"
        self._complete += not failed
        self._failed += failed
        if self._display is not None:
            self._preparation.cancel()
            if failed:
                self._note(f"case {outcome.index:04d} FAILED: {outcome.reason}")
            self._show((), time.time())

    def close(self) -> None:
        """Stop moving lines."""
        self._preparation.cancel()
        if self._display is not None:
            self._display.close()

    def _note(self, line: str) -> None:
        assert self._display is not None
        self._display.note(line)

    def _show(self, at_work: tuple[Running, ...], now: float) -> None:
        self._shown = now
        progress = Progress(self._total, self._complete, self._failed, at_work)
        left = (self._total - progress.done) * (now - self._begun) / progress.done if progress.done else None
        assert self._display is not None
        self._display.advance(Progress(self._total, self._complete, self._failed, at_work, left))
