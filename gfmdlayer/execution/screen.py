"""Progress of a run on a terminal: a line for each case at work, one for all of them, failures above."""

from __future__ import annotations

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from gfmdlayer.execution.progress import TOLD, Progress, duration

_WIDTH = 24  # of a bar
_LINES = 12  # cases at work that are shown
_OTHER_LINES = 6  # of the terminal, left to everything else


class Screen:
    """Lines that move.

    Parameters
    ----------
    console : rich.console.Console, optional
        Where they are; standard error by default.
    """

    def __init__(self, console: Console | None = None) -> None:
        self._live = Live(console=console or Console(stderr=True), auto_refresh=False)
        self._live.start()
        self._failed = 0

    def note(self, line: str) -> None:
        """Write one line above those that move."""
        self._live.console.print(line, markup=False, highlight=False)

    def ended(self, line: str, *, failed: bool) -> None:
        """Write of the first failures what they are; the line of all cases counts the rest."""
        self._failed += failed
        if failed and self._failed <= TOLD:
            self.note(line)

    def advance(self, progress: Progress) -> None:
        """Move the lines."""
        self._live.update(self._lines(progress), refresh=True)

    def close(self) -> None:
        """Leave the lines as they are."""
        self._live.stop()

    def _lines(self, progress: Progress) -> RenderableType:
        room = max(min(_LINES, self._live.console.height - _OTHER_LINES), 1)
        shown = sorted(progress.at_work, key=lambda case: case.fraction)[:room]
        cases = Table.grid(padding=(0, 2))
        for case in sorted(shown, key=lambda case: case.index):
            left = "" if case.seconds_left is None else f"{duration(case.seconds_left)} left"
            cases.add_row(
                Text(f"{case.index:04d}"),
                _bar(case.fraction),
                Text(f"{case.fraction:4.0%}"),
                Text(f"time {case.simulated_time:.3g} of {case.end:g}"),
                Text(left),
                Text(case.label, no_wrap=True, overflow="ellipsis"),
            )
        others = len(progress.at_work) - len(shown)
        more = [Text(f"      and {others} more at work")] if others else []
        total = Table.grid(padding=(0, 2))
        total.add_row(
            Text(" all"), _bar(progress.fraction), Text(f"{progress.fraction:4.0%}"), Text(progress.words)
        )
        return Group(cases, *more, total)


def _bar(fraction: float) -> ProgressBar:
    return ProgressBar(total=1.0, completed=fraction, width=_WIDTH)
