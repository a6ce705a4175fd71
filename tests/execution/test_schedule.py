"""Who gets which case when: nobody idles, nothing is lost, and a thousand ranks are served in time."""

from __future__ import annotations

import os
import signal
import sys
import time
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.schedule import AHEAD, Outcome, Schedule
from gfmdlayer.execution.workers import WorkerPool, assemble

sys.path.append(str(Path(__file__).parents[2] / "scripts"))
from benchmarks import scheduling as simulated

AT_ONCE = dict.fromkeys(simulated.HAND_OVER, 0.0)


@dataclass(frozen=True)
class Item:
    index: int


def run(pool: WorkerPool, task: Any, number: int, folder: Path) -> list[Outcome]:
    schedule: Schedule[Item] = Schedule(pool, task, Folder(folder), lambda _: None)
    return list(schedule.run([Item(index) for index in range(number)]))


class Pool(Executor):
    """Gives each case back when the next but `depth` comes; keeps count of what it holds."""

    def __init__(self) -> None:
        self.given: list[int] = []
        self.held: list[tuple[Future[Outcome], int]] = []
        self.most = 0

    def submit(self, fn: Any, /, *args: Any, **_: Any) -> Future[Any]:  # noqa: ARG002
        future: Future[Any] = Future()
        self.given.append(args[0].index)
        self.held.append((future, args[0].index))
        self.most = max(self.most, sum(not future.done() for future, _ in self.held))
        return future


def test_a_pool_is_given_cases_in_order_and_never_very_many(tmp_path: Path) -> None:
    pool = Pool()
    schedule: Schedule[Item] = Schedule(
        WorkerPool(pool, 3, "fakes", joins=False), print, Folder(tmp_path), lambda _: None  # type: ignore[arg-type]
    )  # fmt: skip
    outcomes = schedule.run([Item(index) for index in range(200)])
    import threading

    def work() -> None:
        for _ in range(200):
            while not pool.held:
                time.sleep(0.001)
            future, index = pool.held.pop(0)
            future.set_result(Outcome(index, "complete"))

    worker = threading.Thread(target=work)
    worker.start()
    assert sorted(outcome.index for outcome in outcomes) == list(range(200))
    worker.join()
    assert pool.given == list(range(200))
    assert pool.most <= AHEAD * 3


def kill_oneself_once(item: Item, folder: Path) -> Outcome:
    running = Folder(folder).case(item.index, "running")
    if item.index == 1 and not (folder / "killed").exists():
        running.write_text("{}")
        (folder / "killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.05)
    return Outcome(item.index, "complete", reason=str(os.getpid()))


def test_after_a_worker_is_killed_as_many_work_on(tmp_path: Path) -> None:
    from functools import partial

    (tmp_path / "cases").mkdir()
    with assemble(2) as pool:
        assert pool is not None
        outcomes = run(pool, partial(kill_oneself_once, folder=tmp_path), 40, tmp_path)
    assert sorted(outcome.index for outcome in outcomes) == list(range(40))
    assert [outcome.index for outcome in outcomes if outcome.state == "failed"] == [1]
    last = {outcome.reason for outcome in outcomes[-20:]}
    assert len(last) == 2
    assert str(os.getpid()) not in last


costs = st.lists(st.floats(0.01, 10.0), min_size=1, max_size=40)


@settings(max_examples=60, deadline=None)
@given(costs=costs, ranks=st.integers(1, 9))
def test_no_rank_idles_while_cases_wait(costs: list[float], ranks: int) -> None:
    total, _ = simulated.makespan(np.array(costs), ranks, AT_ONCE)
    # Graham (1966): where no rank idles while a case waits, the last case begins before sum/m.
    assert simulated.shortest(np.array(costs), ranks) <= total * (1 + 1e-12)
    assert total <= (sum(costs) + (ranks - 1) * max(costs)) / ranks * (1 + 1e-12)


@settings(max_examples=30, deadline=None)
@given(costs=costs, ranks=st.integers(2, 9))
def test_hand_overs_cost_no_more_than_they_take(costs: list[float], ranks: int) -> None:
    hand_over = {"submission": 1e-3, "service": 2e-3, "round_trip": 5e-3, "round_trip_computing": 6e-3}
    total, served = simulated.makespan(np.array(costs), ranks, hand_over)
    assert served <= 2 * len(costs) * 3e-3 * (1 + 1e-9)  # at most: out and back, service and delay
    longest = max(costs) + 5e-3
    assert total <= (sum(costs) + (ranks - 1) * longest) / ranks + len(costs) * (1e-3 + 2 * 3e-3 + 5e-3)


def test_longest_first_keeps_a_thousand_ranks_busy_to_the_end() -> None:
    random = np.random.default_rng(3)
    costs = -np.sort(-10 * np.exp(random.normal(0, 0.5, 20_000)))
    total, served = simulated.makespan(costs, 1024, simulated.HAND_OVER)
    # Lost are, at the end, one of the 1024 shortest cases, 4.4 s where the ranks have 220 s to do; the first
    # hand-overs, 0.4 ms each and one after the other; and the waits of some twenty more.
    assert total - simulated.shortest(costs, 1024) <= costs[-1024] + 1024 * 4e-4 + 20 * 1e-3
    assert served == pytest.approx(20_000 * 4e-4, rel=0.1)  # once a case, and in the way of rank 0's own


@pytest.mark.parametrize(("ranks", "least"), [(1, 6.0), (2, 3.0), (3, 3.0), (6, 3.0)])
def test_the_bound_is_that_of_sum_longest_and_pair(ranks: int, least: float) -> None:
    assert simulated.shortest(np.array([1.0, 1.0, 1.0, 3.0]), ranks) == least
