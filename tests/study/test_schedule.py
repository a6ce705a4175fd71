"""The schedule: no rank idles, no case is lost, and a thousand ranks are served in time.

The real schedule submits, cancels and takes cases over as it does under MPI; the executor behind it is a
discrete-event simulation of a manager on rank 0 and of ranks that compute for as long as a case costs.
"""

from __future__ import annotations

import os
import signal
import time
from collections import deque
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from itertools import count
from multiprocessing import parent_process
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer.study import schedule
from gfmdlayer.study.claims import Claim
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.schedule import AHEAD, Outcome, Schedule
from gfmdlayer.study.workers import WorkerPool, alone, assemble
from tests.waiting import until

Seconds = dict[str, float]
# Of a hand-over between two ranks on one host, measured.
HAND_OVER = {"submission": 2e-6, "service": 2e-4, "round_trip": 7e-4, "round_trip_computing": 9e-4}
AT_ONCE = dict.fromkeys(HAND_OVER, 0.0)


@dataclass(frozen=True)
class Item:
    index: int


def run(pool, task, number, folder):
    cases = Schedule(pool, task, Folder(folder), lambda _: None)
    return list(cases.run([Item(index) for index in range(number)]))


class Pool(Executor):
    """Runs no case; keeps count of what it holds."""

    def __init__(self):
        self.given = []
        self.futures = []
        self.most = 0

    def submit(self, fn, /, *args, **_):  # noqa: ARG002
        future = Future()
        self.given.append(args[0].index)
        self.futures.append(future)
        self.most = max(self.most, sum(not future.done() for future in self.futures))
        return future


def test_a_pool_is_given_cases_in_order_and_never_very_many(tmp_path):
    pool = Pool()
    outcomes = run(WorkerPool(pool, 3, "fakes"), lambda item: Outcome(item.index, "complete"), 200, tmp_path)
    assert sorted(outcome.index for outcome in outcomes) == list(range(200))
    assert pool.given == list(range(200))
    assert pool.most <= AHEAD * 3


def test_few_small_cases_start_no_workers(tmp_path):
    """Others are started after the head start, and then get the cases that come first."""
    pool, late = Pool(), partial(WorkerPool, kind="fakes", starts_late=True)
    run(late(pool, 3), lambda item: Outcome(item.index, "complete"), 20, tmp_path)
    assert pool.given == []

    def slowly(item):
        if item.index == 0:
            until(lambda: len(pool.given) == AHEAD * 3)
        return Outcome(item.index, "complete")

    assert len(run(late(pool, 3), slowly, 20, tmp_path)) == 20
    assert pool.given[: AHEAD * 3] == list(range(1, AHEAD * 3 + 1))


def test_an_error_of_the_items_ends_the_run(tmp_path):
    def items():
        yield Item(0)
        raise ValueError("of the items")

    with pytest.raises(ValueError, match="of the items"), alone() as pool:
        list(
            Schedule(pool, lambda item: Outcome(item.index, "complete"), Folder(tmp_path), print).run(items())
        )


def is_alive(process):
    with suppress(OSError):
        return ") Z " not in Path("/proc", process, "stat").read_text()
    return False


def kill_oneself_once(item, folder):
    """The last items wait until three processes are at work, after the death of one."""
    with Claim(Folder(folder), item.index, 1.0):
        (folder / f"{os.getpid()}.at_work").touch()
        if item.index == 1 and parent_process() and not (folder / "killed").exists():
            (folder / "killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if item.index >= 40:
            until(lambda: sum(is_alive(path.stem) for path in folder.glob("*.at_work")) >= 3)
        time.sleep(0.05)
    return Outcome(item.index, "complete", reason=str(os.getpid()))


def test_after_a_worker_is_killed_as_many_work_on(tmp_path, monkeypatch):
    (tmp_path / "cases").mkdir()
    monkeypatch.setattr(schedule, "HEAD_START", 0.0)
    with assemble(3) as pool:
        assert pool is not None
        outcomes = run(pool, partial(kill_oneself_once, folder=tmp_path), 70, tmp_path)
    assert sorted(outcome.index for outcome in outcomes) == list(range(70))
    assert [outcome.index for outcome in outcomes if outcome.state == "failed"] == [1]
    last = {outcome.reason for outcome in outcomes[-20:]}
    assert len(last) == 3  # this process too


@dataclass(frozen=True)
class Costly:
    """A case of the simulation and the seconds that it takes."""

    index: int
    seconds: float


class Cluster(Executor):
    """Ranks, a manager and a clock.

    Parameters
    ----------
    ranks : int
        All of them; the first one manages, and computes when the schedule lets it.
    hand_over : dict
        Seconds that a hand-over takes, see `HAND_OVER`.
    """

    def __init__(self, ranks, hand_over):
        self.now = self.served = 0.0
        self._idle, self._hand_over = ranks - 1, hand_over
        # A message waits for the manager's thread while Python computes in the other one.
        self._delay = max(0.0, hand_over["round_trip_computing"] - hand_over["round_trip"])
        self._service, self._free = hand_over["service"], 0.0
        self._queue = deque()
        self._events = []
        self._order = count()

    def submit(self, fn, /, *args, **_):  # noqa: ARG002
        """Take a case into the queue; the manager hands it out if a rank is idle."""
        future = Future()
        self._queue.append((future, args[0]))
        if self._idle:
            self._idle -= 1
            self._serve(self.now, self._hand_out)
        self._pass(self._hand_over["submission"])
        return future

    def compute(self, case):
        """Let rank 0 compute a case; serving the others takes its time too."""
        end, served = self.now + case.seconds, self.served
        self._service += self._delay
        while self._events and self._events[0][0] <= end + (self.served - served):
            self.step()
        self._service -= self._delay
        self.now = end + (self.served - served)
        return Outcome(case.index, "complete", seconds=case.seconds)

    def step(self):
        """Go on to the next event."""
        self.now, _, happen = heappop(self._events)
        happen()

    def finished(self):
        """Whether nothing is under way."""
        return not self._events

    def _pass(self, seconds):
        end = self.now + seconds
        while self._events and self._events[0][0] <= end:
            self.step()
        self.now = end

    def _serve(self, asked, done):
        """Have the manager do something when it is free."""
        self._free = max(asked, self._free) + self._service
        self.served += self._service
        heappush(self._events, (self._free, next(self._order), done))

    def _hand_out(self):
        while self._queue:
            future, case = self._queue.popleft()
            if future.set_running_or_notify_cancel():
                back = self.now + self._hand_over["round_trip"] - self._hand_over["service"] + case.seconds
                heappush(self._events, (back, next(self._order), partial(self._come_back, future, case)))
                return
        self._idle += 1

    def _come_back(self, future, case):
        def receive():
            future.set_result(Outcome(case.index, "complete", seconds=case.seconds))
            self._hand_out()

        self._serve(self.now, receive)


class _Outcomes(SimpleQueue):
    """The schedule's queue of outcomes: to wait for one is to let the clock go on."""

    cluster: Cluster

    def get(self, block=True, timeout=None):  # noqa: ARG002
        while self.empty() and not self.cluster.finished():
            self.cluster.step()
        if self.empty():
            raise AssertionError("the schedule waits for a case that nobody has")
        return super().get_nowait()


def makespan(costs, ranks, hand_over):
    """Return the seconds that cases take in this order, and those that the manager served in.

    Parameters
    ----------
    costs : ndarray, shape (cases,)
        Seconds of each case.
    ranks : int
        Number of ranks.
    hand_over : dict
        Seconds that a hand-over takes, see `HAND_OVER`.
    """
    cluster = Cluster(ranks, hand_over)
    outcomes = _Outcomes()
    outcomes.cluster = cluster
    pool = WorkerPool(cluster, ranks, "simulated ranks")
    ended = set()
    with TemporaryDirectory() as name:
        cases = Schedule(
            pool, cluster.compute, Folder(Path(name)), lambda outcome: ended.add(outcome.index), outcomes
        )
        items = [Costly(index, float(seconds)) for index, seconds in enumerate(costs)]
        number = sum(1 for _ in cases.run(items))
    assert number == len(ended) == len(costs)
    return cluster.now, cluster.served


def shortest(costs, ranks):
    """Return the seconds that no schedule can fall below: of one case more than ranks, two share a rank."""
    falling = -np.sort(-costs)
    two = falling[ranks - 1] + falling[ranks] if ranks < costs.size else 0.0
    return float(max(costs.sum() / ranks, falling[0], two))


costs = st.lists(st.floats(0.01, 10.0), min_size=1, max_size=40)


@settings(max_examples=60, deadline=None)
@given(costs=costs, ranks=st.integers(1, 9))
def test_no_rank_idles_while_cases_wait(costs, ranks):
    total, _ = makespan(np.array(costs), ranks, AT_ONCE)
    # Graham (1966): where no rank idles while a case waits, the last case begins before sum/m.
    assert shortest(np.array(costs), ranks) <= total * (1 + 1e-12)
    assert total <= (sum(costs) + (ranks - 1) * max(costs)) / ranks * (1 + 1e-12)


@settings(max_examples=30, deadline=None)
@given(costs=costs, ranks=st.integers(2, 9))
def test_hand_overs_cost_no_more_than_they_take(costs, ranks):
    hand_over = {"submission": 1e-3, "service": 2e-3, "round_trip": 5e-3, "round_trip_computing": 6e-3}
    total, served = makespan(np.array(costs), ranks, hand_over)
    assert served <= 2 * len(costs) * 3e-3 * (1 + 1e-9)  # at most: out and back, service and delay
    longest = max(costs) + 5e-3
    assert total <= (sum(costs) + (ranks - 1) * longest) / ranks + len(costs) * (1e-3 + 2 * 3e-3 + 5e-3)


def test_longest_first_by_an_estimate_keeps_ranks_busy_to_the_end():
    """A thousand cases on 64 ranks, in the order of costs that are known to a factor of two."""
    random = np.random.default_rng(3)
    costs = 10 * np.exp(random.normal(0, 1.0, 1_000))
    known = costs * np.exp(random.normal(0, np.log(2), costs.size))
    total, _ = makespan(costs[np.argsort(-known)], 64, HAND_OVER)
    assert shortest(costs, 64) / total > 0.9
    in_any_order, _ = makespan(costs, 64, HAND_OVER)
    assert total < in_any_order


def test_a_thousand_ranks_are_served_in_time():
    random = np.random.default_rng(3)
    costs = -np.sort(-10 * np.exp(random.normal(0, 0.5, 20_000)))
    total, served = makespan(costs, 1024, HAND_OVER)
    # Lost are, at the end, one of the 1024 shortest cases; the first hand-overs, 0.4 ms each and one after
    # the other; and the waits of some twenty more.
    assert total - shortest(costs, 1024) <= costs[-1024] + 1024 * 4e-4 + 20 * 1e-3
    assert served == pytest.approx(20_000 * 4e-4, rel=0.1)  # once a case, and in the way of rank 0's own
