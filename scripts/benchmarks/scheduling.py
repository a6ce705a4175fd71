"""A sweep of 100 000 cases on 1 to 4096 ranks: the real scheduler in a simulated cluster.

`gfmdlayer.execution.schedule.Schedule` submits, cancels and takes over as it does under MPI, but the executor
behind it is a discrete-event simulation: a manager on rank 0 serves one message after the other, the other
ranks compute for as long as a case costs, and the clock jumps from event to event. Costs are drawn from those
of the figures' cases, run here; what a hand-over takes is measured between two ranks, if there is an mpirun.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from itertools import count
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from benchmarks.mpi import over_ranks
from benchmarks.ranks import figures
from benchmarks.tables import Cell, Effort, Table

from gfmdlayer.arrays import FloatArray
from gfmdlayer.execution.case_run import run_case, warm_up
from gfmdlayer.execution.cost import estimate
from gfmdlayer.execution.folder import Folder
from gfmdlayer.execution.schedule import Outcome, Schedule
from gfmdlayer.execution.workers import WorkerPool

EFFORT = Effort(points=(1 << 14,), steps=100_000)
QUICK = Effort(points=(1 << 14,), steps=2_000)
RANKS = (1, 2, 4, 16, 64, 256, 1024, 2048, 4096)
BROAD = 1.5  # standard deviation of the logarithm of cost in a sweep over grids and solvers

Seconds = dict[str, float]
HAND_OVER = {"submission": 2e-6, "service": 2e-4, "round_trip": 7e-4, "round_trip_computing": 9e-4}


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

    def __init__(self, ranks: int, hand_over: Seconds) -> None:
        self.now = self.served = 0.0
        self._idle, self._hand_over = ranks - 1, hand_over
        # A message waits for the manager's thread while Python computes in the other one.
        self._delay = max(0.0, hand_over["round_trip_computing"] - hand_over["round_trip"])
        self._service, self._free = hand_over["service"], 0.0
        self._queue: deque[tuple[Future[Outcome], Costly]] = deque()
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._order = count()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **_: Any) -> Future[Any]:  # noqa: ARG002
        """Take a case into the queue; the manager hands it out if a rank is idle."""
        future: Future[Any] = Future()
        self._queue.append((future, args[0]))
        if self._idle:
            self._idle -= 1
            self._serve(self.now, self._hand_out)
        self._pass(self._hand_over["submission"])
        return future

    def compute(self, case: Costly) -> Outcome:
        """Let rank 0 compute a case; serving the others takes its time too."""
        end, served = self.now + case.seconds, self.served
        self._service += self._delay
        while self._events and self._events[0][0] <= end + (self.served - served):
            self.step()
        self._service -= self._delay
        self.now = end + (self.served - served)
        return Outcome(case.index, "complete", seconds=case.seconds)

    def step(self) -> None:
        """Go on to the next event."""
        self.now, _, happen = heappop(self._events)
        happen()

    def finished(self) -> bool:
        """Whether nothing is under way."""
        return not self._events

    def _pass(self, seconds: float) -> None:
        end = self.now + seconds
        while self._events and self._events[0][0] <= end:
            self.step()
        self.now = end

    def _serve(self, asked: float, done: Callable[[], None]) -> None:
        """Have the manager do something when it is free."""
        self._free = max(asked, self._free) + self._service
        self.served += self._service
        heappush(self._events, (self._free, next(self._order), done))

    def _hand_out(self) -> None:
        while self._queue:
            future, case = self._queue.popleft()
            if future.set_running_or_notify_cancel():
                back = self.now + self._hand_over["round_trip"] - self._hand_over["service"] + case.seconds
                heappush(self._events, (back, next(self._order), partial(self._come_back, future, case)))
                return
        self._idle += 1

    def _come_back(self, future: Future[Outcome], case: Costly) -> None:
        def receive() -> None:
            future.set_result(Outcome(case.index, "complete", seconds=case.seconds))
            self._hand_out()

        self._serve(self.now, receive)


class _Settled(SimpleQueue):  # type: ignore[type-arg]
    """The schedule's queue of outcomes: to wait for one is to let the clock go on."""

    cluster: Cluster

    def get(self, block: bool = True, timeout: float | None = None) -> Any:  # noqa: ARG002
        while self.empty() and not self.cluster.finished():
            self.cluster.step()
        if self.empty():
            raise AssertionError("the schedule waits for a case that nobody has")
        return super().get_nowait()


def makespan(costs: FloatArray, ranks: int, hand_over: Seconds) -> tuple[float, float]:
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
    settled = _Settled()
    settled.cluster = cluster
    pool = WorkerPool(cluster, ranks, "simulated ranks", joins=True)
    ended: set[int] = set()
    with TemporaryDirectory() as name:
        schedule = Schedule(
            pool, cluster.compute, Folder(Path(name)), lambda outcome: ended.add(outcome.index), settled
        )
        items = [Costly(index, float(seconds)) for index, seconds in enumerate(costs)]
        number = sum(1 for _ in schedule.run(items))
    if not number == len(ended) == len(costs):
        raise AssertionError(f"{len(costs)} cases, but {number} outcomes of {len(ended)} cases")
    return cluster.now, cluster.served


def measure(effort: Effort) -> list[Table]:
    """Simulate sweeps of as many cases as the effort has steps."""
    hand_over, source = measured_hand_over()
    random = np.random.default_rng(1)
    recorded, error = recorded_costs()
    like_figures = random.choice(recorded, effort.steps) * np.exp(random.normal(0, 0.05, effort.steps))
    broad = np.exp(random.normal(0, BROAD, effort.steps))
    broad *= like_figures.mean() / broad.mean()
    rows = list(_rows("figures 2 to 4", like_figures, error, hand_over, random))
    rows += _rows("broad", broad, error, hand_over, random)
    rows += _rows("broad, 1 s a case", broad / broad.mean(), error, hand_over, random)
    title = f"Simulated schedule of {effort.steps} cases: efficiency against the bound"
    service, round_trip, computing = (
        f"{hand_over[key] * 1e6:.0f} us" for key in ("service", "round_trip", "round_trip_computing")
    )
    note = (
        "Efficiency is the sum of the costs over ranks times makespan; no schedule passes its bound. Cases "
        f"begin in the order of an estimate that is off by {error:.0%} (standard deviation). 'broad' is "
        f"lognormal, with a standard deviation of {BROAD} of the logarithm. 'manager' is the part of the "
        f"time in which it serves, {service} a case; a hand-over and back takes {round_trip}, "
        f"{computing} while rank 0 computes ({source})."
    )
    return [Table("scheduling", title, rows, note)]


def _rows(
    name: str, costs: FloatArray, error: float, hand_over: Seconds, random: np.random.Generator
) -> Iterator[dict[str, Cell]]:
    guess = costs * np.exp(random.normal(0, error, costs.size))
    ordered = costs[np.argsort(-guess)]
    for ranks in RANKS:
        bound = costs.sum() / ranks / shortest(costs, ranks)
        total, served = makespan(ordered, ranks, hand_over)
        given, _ = makespan(costs, ranks, hand_over)
        yield {
            "cases": name,
            "mean cost [s]": float(costs.mean()),
            "ranks": ranks,
            "efficiency": float(costs.sum() / ranks / total),
            "bound": float(bound),
            "efficiency / bound": float(costs.sum() / ranks / total / bound),
            "in given order": float(costs.sum() / ranks / given / bound),
            "manager": served / total,
        }


def shortest(costs: FloatArray, ranks: int) -> float:
    """Return the seconds that no schedule can fall below: of one case more than ranks, two share a rank."""
    falling = -np.sort(-costs)
    two = falling[ranks - 1] + falling[ranks] if ranks < costs.size else 0.0
    return float(max(costs.sum() / ranks, falling[0], two))


def recorded_costs() -> tuple[FloatArray, float]:
    """Run the figures' quick cases; return the seconds of the full ones, by points and steps.

    And how far the estimate is off: the standard deviation of the logarithm.
    """
    quick, full = figures(quick=True), figures(quick=False)
    wisdom = warm_up(quick)
    with TemporaryDirectory() as name:
        folder = Folder(Path(name))
        folder.cases.mkdir()
        outcomes = [run_case(case, folder, wisdom) for case in quick]
    if any(outcome.state != "complete" for outcome in outcomes):
        raise RuntimeError("a case of the figures failed")
    seconds = np.array([outcome.seconds for outcome in outcomes])
    work = np.array([[estimate(case.config).work for case in found] for found in (quick, full)])
    return seconds * work[1] / work[0], float(np.std(np.log(seconds / work[0])))


def measured_hand_over() -> tuple[Seconds, str]:
    """Measure between two ranks, or return what was measured elsewhere; and say which."""
    answer = over_ranks(2, str(Path(__file__).with_name("hand_over.py")))
    if answer is None:
        return HAND_OVER, "measured elsewhere; there is no mpirun here"
    return dict(json.loads(answer)), "measured here with mpirun -n 2"
