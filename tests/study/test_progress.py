"""Progress of a run: enough on a terminal, little in a log, for any number of cases."""

import io
import re
import time
from dataclasses import replace
from functools import partial

import pytest
from rich.console import Console

from gfmdlayer.study import claims
from gfmdlayer.study import progress as reports
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.progress import Progress, Reporter, Screen
from gfmdlayer.study.schedule import Outcome


def told(folder, outcomes, complete=0):
    stream = io.StringIO()
    with Reporter(folder, range(len(outcomes) + complete), complete, lambda: reports.Log(stream)) as reporter:
        for outcome in outcomes:
            reporter.ended(outcome)
    return [line.partition("  ")[2] for line in stream.getvalue().splitlines()]


def test_ten_thousand_cases_do_not_flood_a_log(tmp_path):
    """Each kind of end is told for the first ones, and that there are more; one line sums up."""
    folder = Folder(tmp_path)
    outcomes = [Outcome(i, "failed" if i % 2 else "complete", "why", 0.01) for i in range(10_000)]
    outcomes[77] = Outcome(77, "failed", "why", 3.0)
    lines = told(folder, outcomes)
    assert len(lines) == 2 * (reports.SHOWN_ENDS + 1) + 1
    assert "case 0001 FAILED (2 of 10000): why" in lines
    assert re.fullmatch(r"10000 cases ended in .+, 5000 of them FAILED; slowest 0077 in 3\.0 s", lines[-1])


def test_a_run_that_found_everything_complete_sums_nothing_up(tmp_path):
    assert told(Folder(tmp_path), [], complete=3) == []


def test_a_terminal_has_a_line_for_each_case_at_work_that_it_has_room_for():
    case = claims.Running(7, "here", 1, 2.0, 8.0, 0.0, 10.0, "thickness = 0.1", 5, 4.0, 0.0)
    at_work = (case, *(replace(case, index=i, simulated_time=6.0) for i in range(8, 40)))
    progress = Progress(40, 3, 1, at_work, 90.0, Outcome(2, "complete", seconds=30.0))
    console = Console(width=120, height=10, file=io.StringIO())
    screen = Screen(console)
    screen.advance(progress)
    screen.close()
    lines = console.file.getvalue().splitlines()
    assert len(lines) == 10 - 6 + 2  # room for four cases, how many more, all of them
    assert re.fullmatch(r"0007  \S+ +25%  time 2 of 8 +18 s left +thickness = 0\.1 *", lines[0])
    assert lines[4].strip() == "and 29 more at work"
    assert "3 of 40 complete, 33 running, 1 failed, 1 min 30 s left, slowest 0002 in 30 s" in lines[5]


def test_a_long_preparation_gets_a_line_at_its_start_and_one_at_its_end(tmp_path, monkeypatch):
    """Kernels compile for some 20 s on a new machine; where they are compiled there is nothing to say."""
    work = "compiling kernels, once per machine"
    monkeypatch.setattr(reports, "READ_INTERVAL", 0.001)
    for threshold in (1000.0, 0.0):
        monkeypatch.setattr(reports, "PREPARATION", threshold)
        stream = io.StringIO()
        with Reporter(Folder(tmp_path), range(3), 0, partial(reports.Log, stream)) as reporter:
            with reporter.preparing(work):
                while threshold == 0.0 and work not in stream.getvalue():
                    time.sleep(0.001)
                time.sleep(0.01)  # some more readings of the status
            lines = [line.partition("  ")[2] for line in stream.getvalue().splitlines()]
        if threshold == 0.0:
            assert lines[0] == work
            assert re.fullmatch(r"kernels and transforms are ready after .+ s", lines[1])
        assert len(lines) == (2 if threshold == 0.0 else 0)


def test_preparation_has_a_line_above_the_moving_ones_of_a_terminal(tmp_path, monkeypatch):
    monkeypatch.setattr(reports, "PREPARATION", 0.0)
    console = Console(width=120, height=10, file=io.StringIO())
    with (
        Reporter(Folder(tmp_path), range(3), 0, lambda: Screen(console)) as reporter,
        reporter.preparing("compiling kernels, once per machine"),
    ):
        while "compiling" not in console.file.getvalue():
            time.sleep(0.001)
    assert console.file.getvalue().splitlines()[0].strip() == "compiling kernels, once per machine"


def test_the_time_left_counts_cases_by_their_expected_seconds(tmp_path, monkeypatch):
    """Before a step is done nothing is measured and none is shown; later it follows the pace."""
    now = [1000.0]
    monkeypatch.setattr(reports.time, "monotonic", lambda: now[0])
    expected = {0: 10.0, 1: 90.0, 2: 100.0}
    reporter = Reporter(Folder(tmp_path), range(3), 0, lambda: reports.Log(io.StringIO()), expected, 2)

    begun = claims.Running(2, "here", 1, 0.0, 2.0, 0.0, 0.0)
    assert reporter._progress((begun,)).seconds_left is None
    first_steps = replace(begun, simulated_time=0.01, steps=5, expected=1000)
    assert reporter._progress((first_steps,)).seconds_left is None
    now[0] += 15  # twice as fast as expected: 60 s of work by two workers in 15 s
    reporter.ended(Outcome(0, "complete", seconds=5.0))
    at_work = (claims.Running(2, "here", 1, 1.0, 2.0, 0.0, 0.0, "", 5, 0.0, 0.0, 10),)
    seconds = reporter._progress(at_work).seconds_left
    # 60 of 200 expected seconds are done in 30 s of two workers.
    assert seconds == pytest.approx(140 * 30 / 60 / 2)


def test_adaptive_steps_tell_the_progress_where_time_passes_slowly_at_first():
    case = claims.Running(0, "here", 1, 0.1, 8.0, 0.0, 20.0, "", 10, 0.0, 0.0, 40)
    assert case.effort == 0.25
    assert case.seconds_left == pytest.approx(60.0)
    assert replace(case, simulated_time=7.0).effort == 7 / 8
    assert replace(case, steps=4000).effort == claims.STEPS_TRUSTED


def test_a_run_of_adaptive_steps_is_shown_by_its_steps():
    """The hold is nearly all of the time, and the ramp nearly all of the work."""
    case = claims.Running(0, "here", 1, 1e-3, 1.0, 0.0, 20.0, "", 50, 0.0, 0.0, 100)
    assert Progress(1, 0, 0, (case,)).fraction == 0.5
    stream = io.StringIO()
    log = reports.Log(stream)
    log._last = -1e9
    log.advance(Progress(1, 0, 0, (case,)))
    assert "50%: 0 of 1 complete, 1 running" in stream.getvalue()


def test_cases_in_memory_show_their_steps_too():
    at_work = claims.AtWork(0, 1.0, "", 10)
    for _ in range(4):
        at_work.advance(1e-6)
    assert at_work.running.effort == 0.4
