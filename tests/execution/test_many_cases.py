"""Very many cases: looked at in part, and made one by one."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.execution import sweep
from gfmdlayer.execution.cost import estimate, total
from gfmdlayer.execution.sweep import Cases, cases


def product(first: int, second: int) -> Config:
    values = {"layer.thickness": range(first), "layer.material.tau": range(1, second + 1)}
    return Config(name="many", grid={"points": 256}, sweep={key: [*found] for key, found in values.items()})


def test_cases_are_made_when_they_are_asked_for() -> None:
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
    assert [lazy[i] for i in range(12)] == list(lazy) == lazy[:] == every
    assert [list(case.values.values()) for case in every[:3]] == [
        [1, 0.3, 0.1, 5], [1, 0.3, 0.1, 6], [1, 0.3, 0.2, 5],
    ]  # fmt: skip
    assert every[11].values == {
        "punch.radius": 2, "layer.poisson": 0.4, "layer.thickness": 0.3, "time.end": 6,
    }  # fmt: skip
    with pytest.raises(IndexError):
        lazy[12]


def test_a_million_cases_are_checked_in_part_and_in_little_memory(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """What a check costs is the number of cases made, which does not grow beyond some thousands."""
    made: list[dict[str, object]] = []
    with_values = Config.with_values

    def counted(self: Config, values: dict[str, object]) -> Config:
        made.append(values)
        return with_values(self, values)

    monkeypatch.setattr(Config, "with_values", counted)
    monkeypatch.setattr(sweep, "EXAMINED", 100)
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
    assert "examined   100 cases at random; a run examines all before it starts" in shown


def test_what_is_added_up_from_a_part_is_near_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep, "EXAMINED", 100)
    lazy = Cases(product(30, 20))
    assert len(lazy.examined()) == 100
    found = total((estimate(case.config) for case in lazy.examined()), 100 / len(lazy))
    whole = total(estimate(case.config) for case in lazy)
    assert found.steps == whole.steps
    # The pairs of a case are within a factor of three of each other: 100 scatter by 5 % at most.
    assert found.pairs == pytest.approx(whole.pairs, rel=0.15)


def test_more_cases_than_memory_holds_are_refused_before_any_is_made(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    path, out = tmp_path / "many.yaml", tmp_path / "out"
    path.write_text(product(1000, 1000).dump())
    monkeypatch.setattr(sweep, "EXAMINED", 10)
    monkeypatch.setattr(sweep.preflight, "memory_limits", lambda: [(4e9, "the job may have", True)])
    monkeypatch.setattr(Cases, "__iter__", lambda _: pytest.fail("a case was made"))
    assert main(["run", str(path), "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert "preparing 1000000 cases" in said
    assert "sweep: 1000000 cases in one run: about 6.73 GB of memory are needed" in said
    assert said.endswith("take fewer values, or more parts (--shard I/N)\n")
    assert not out.exists()


def test_a_shard_keeps_its_own_cases_alone() -> None:
    lazy, shard = Cases(product(30, 20)), sweep.Shard(2, 100)
    expected = [case.index for case in shard.share(lazy[:])]
    tracemalloc.start()
    own = sweep.own_cases(lazy, shard)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [case.index for case in own] == expected
    assert len(own) == 6
    assert peak < 600 * sweep.CASE_BYTES / 4


def test_a_shard_of_a_thousand_million_is_found_at_once() -> None:
    """Parts beyond the number of cases have none, and cost nothing."""
    every = cases(product(3, 2))
    assert sweep.Shard(1, 10**9).share(every) == every[:1]
    assert sweep.Shard(10**9, 10**9).share(every) == []
