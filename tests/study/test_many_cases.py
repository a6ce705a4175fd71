"""Very many cases: looked at in part, and made one by one."""

import json
import pickle
import re
import shutil
import tracemalloc
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config, ConfigError
from gfmdlayer.study import cases as made_cases
from gfmdlayer.study import interrupts
from gfmdlayer.study import run as running
from gfmdlayer.study.cases import Cases, cases
from gfmdlayer.study.cost import total
from gfmdlayer.study.folder import FolderError
from gfmdlayer.study.schedule import Outcome


def product(first, second):
    values = {"layer.thickness": range(first), "layer.material.tau": range(1, second + 1)}
    return Config(name="many", grid={"points": 256}, sweep={key: [*found] for key, found in values.items()})


def tiny():
    """Return twelve cases of three steps."""
    values = {"layer.thickness": [0.02, 0.1, 0.3], "layer.material.tau": [1, 2, 3, 4]}
    config = {"grid": {"points": 32}, "time": {"end": 0.03, "step": 0.01}, "trajectory": {"ramp_time": 0.03}}
    return Config(name="tiny", **config, sweep=values)


@pytest.fixture
def made(monkeypatch):
    """Return the values of the cases that are made."""
    found = []
    with_values = Config.with_values

    def counted(self, values):
        found.append(values)
        return with_values(self, values)

    monkeypatch.setattr(Config, "with_values", counted)
    return found


def test_cases_are_made_when_they_are_asked_for():
    config = Config(
        name="few",
        sweep={
            "zip": {"punch.radius": [1, 2], "layer.poisson": [0.3, 0.4]},
            "layer.thickness": [0.1, 0.2, 0.3],
            "time.end": [5, 6],
        },
    )
    lazy, every = Cases(config), cases(config)
    assert len(lazy) == len(every) == 12
    assert [lazy[i] for i in range(12)] == list(lazy) == every
    assert [list(case.values.values()) for case in every[:3]] == [
        [1, 0.3, 0.1, 5], [1, 0.3, 0.1, 6], [1, 0.3, 0.2, 5],
    ]  # fmt: skip
    assert every[11].values == {
        "punch.radius": 2, "layer.poisson": 0.4, "layer.thickness": 0.3, "time.end": 6,
    }  # fmt: skip
    with pytest.raises(IndexError):
        lazy[12]


def test_a_million_cases_are_checked_in_part_and_in_little_memory(monkeypatch, capsys, tmp_path, made):
    """What a check costs is the number of cases made, which does not grow beyond some thousands."""
    monkeypatch.setattr(made_cases, "BLOCK", 100)
    path = tmp_path / "many.yaml"
    path.write_text(product(1000, 1000).dump())
    made.clear()
    tracemalloc.start()
    assert main(["check", str(path), "--out", str(tmp_path / "out")]) == 0
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(made) < 2 * 100 + 100
    assert peak < 50e6
    shown = capsys.readouterr().out
    assert "many: 1000000 cases" in shown
    assert "  0001  thickness = 0, tau = 2\n" in shown
    assert "  ... and 999980 more" in shown
    assert "examined   100 cases at random, as a run does; it checks each before its start" in shown


def test_what_is_added_up_from_a_part_is_near_the_whole(monkeypatch):
    monkeypatch.setattr(made_cases, "BLOCK", 100)
    lazy = Cases(product(30, 20))
    assert len(lazy.sample()) == 100
    found = total((case.cost for case in lazy.sample()), 100 / len(lazy))
    whole = total(case.cost for case in lazy)
    assert found.steps == pytest.approx(whole.steps, rel=1e-3)
    # The pairs of a case are within a factor of three of each other: 100 scatter by 5 % at most.
    assert found.pairs == pytest.approx(whole.pairs, rel=0.15)


def test_a_run_of_very_many_begins_after_a_look_at_some_and_takes_little_memory(monkeypatch, run_here, made):
    """Three cases run, then the run is asked to stop; the others are neither made nor counted one by one."""
    monkeypatch.setattr(made_cases, "BLOCK", 50)
    ended = []

    def compute(case, **_):
        if interrupts.stop_requested():
            return Outcome(case.index, "stopped")
        ended.append(case.index)
        if len(ended) == 3:
            interrupts.request_stop()
        return Outcome(case.index, "complete")

    monkeypatch.setattr(running, "run_case", compute)
    monkeypatch.setattr(running, "warm_up", lambda *_, **__: [])
    monkeypatch.setattr(interrupts._Flag, "raised", False)
    config = product(500, 400)
    made.clear()
    tracemalloc.start()
    summary, log = run_here(config)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert ended == [0, 1, 2]
    assert summary.states == {"complete": 3, "stopped": 199_997}
    assert len(made) < 50 + 50
    assert peak < 100 * 200_000  # bytes a case, of which one that is made takes 6500
    assert "200000 cases; 1 process" in log


def test_cases_made_in_their_turn_have_the_bits_of_cases_made_before(monkeypatch, run_here, bits):
    """Also where the run goes on from a folder with a damaged file, which no look before the run has met."""
    assert run_here(tiny(), "whole")[0].collected
    monkeypatch.setattr(made_cases, "BLOCK", 4)
    assert run_here(tiny(), "out")[0].states["complete"] == 12
    assert bits("out") == bits("whole")
    for number in (1, 7):
        Path(f"out/cases/{number:04d}.h5").unlink()
    Path("out/cases/0009.h5").write_bytes(b"damaged")
    summary, log = run_here(tiny(), "out")
    assert (summary.count("complete"), summary.collected) == (12, True)
    assert "12 cases, 10 complete already" in log
    assert "reading the 10 cases that were complete before the run" in log
    assert "case 0009 is damaged: set aside as 0009.h5.aside, computed again" in log
    assert "3 cases ended" in log
    Path("out/cases/0009.h5.aside").unlink()
    assert bits("out") == bits("whole")


def test_a_complete_file_of_other_input_is_refused_and_not_replaced_after_a_long_run_too(
    monkeypatch, run_here
):
    run_here(tiny(), "out")
    shutil.copy("out/cases/0000.h5", "out/cases/0009.h5")
    before = Path("out/cases/0009.h5").read_bytes()
    monkeypatch.setattr(made_cases, "BLOCK", 4)
    Path("out/cases/0001.h5").unlink()
    with pytest.raises(FolderError, match=r"0009.h5: was computed from other input"):
        run_here(tiny(), "out")
    assert Path("out/cases/0001.h5").exists()
    assert Path("out/cases/0009.h5").read_bytes() == before


def test_values_that_are_found_impossible_in_their_turn_fail_alone(monkeypatch, run_here):
    monkeypatch.setattr(made_cases, "BLOCK", 4)
    with_values = Config.with_values

    def impossible(self, values):
        if values.get("layer.material.tau") == 2:
            raise ConfigError(["layer.material.tau: got 2; must be another"])
        return with_values(self, values)

    config = tiny()
    monkeypatch.setattr(Config, "with_values", impossible)
    monkeypatch.setattr(made_cases, "drawn", lambda items: items[:1])
    summary, log = run_here(config)
    assert [outcome.index for outcome in summary.failures] == [1, 5, 9]
    assert (summary.count("complete"), summary.collected) == (9, True)
    assert re.search(r"case 0001 FAILED \(. of 12\): ConfigError: layer.material.tau: got 2; must", log)
    assert json.loads(Path("out/cases/0005.failed").read_text())["values"]["layer.material.tau"] == 2


class Grows:
    """Adds to an object while that is pickled, as another thread does that computes with it."""

    def __init__(self, of):
        self.of = of

    def __reduce__(self):
        vars(self.of)["more"] = 1
        return int, ()


@pytest.mark.parametrize("part", ["case", "config", "layer"])
def test_a_case_is_sent_while_more_is_derived_of_it(part):
    """Executors pickle in a thread of their own: "dictionary changed size during iteration" ended a case."""
    case = Cases(Config(name="sent"))[0]
    holder = {"case": case, "config": case.config, "layer": case.config.layer}[part]
    vars(holder)["first"] = Grows(holder)
    assert pickle.loads(pickle.dumps(case)).config.name == "sent"
    assert vars(holder)["more"] == 1
