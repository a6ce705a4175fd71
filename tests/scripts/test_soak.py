"""Random trials, some of the many that `soak.py` makes: they end as they must, or are kept with their seeds.

The mechanics of what is computed, over cases less extreme, is in `tests/contact/test_fuzz_physics.py`.
"""

import json
import runpy
from collections import Counter
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.config import Config
from gfmdlayer.contact.solvers import SOLVERS

SCRIPTS = Path(__file__).parents[2] / "scripts"


@pytest.fixture
def soak(monkeypatch):
    """Run the script in this process."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return runpy.run_path(str(SCRIPTS / "soak.py"))["main"]


@pytest.fixture
def trials(monkeypatch):
    """Return a module of the trials."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return lambda name: import_module(f"trials.{name}")


def test_the_default_solver_converges(trials, tmp_path):
    ends = {index: trials("extremes").trial(2, index, tmp_path) for index in range(30)}
    assert {index: end for index, end in ends.items() if not end.good} == {}
    assert sum(end.kind == "converged" for end in ends.values()) > 25


@pytest.mark.parametrize("method", SOLVERS)
def test_every_solver_converges_or_says_that_it_does_not(method, trials, tmp_path):
    for index in range(6):
        end = trials("extremes").trial(3, index, tmp_path, (method,))
        assert end.good or end.kind == "not converged", (index, end)


def test_a_case_follows_from_its_seed(trials):
    draw = trials("configurations").draw
    assert repr(draw(5, 7)) == repr(draw(5, 7))
    assert repr(draw(5, 7)) != repr(draw(5, 8))
    assert repr(draw(5, 7)) != repr(draw(6, 7))


def test_damaged_configurations_are_taken_or_refused(trials, tmp_path):
    ends = Counter(trials("fuzz").trial(1, index, tmp_path).kind for index in range(80))
    assert set(ends) == {"taken", "refused"}
    assert ends["refused"] > ends["taken"]


@pytest.mark.parametrize(("first", "end"), [(0, 10), pytest.param(10, 50, marks=pytest.mark.slow)])
def test_combinations_of_abilities_are_refused_or_complete_in_all_that_follows(first, end, trials, tmp_path):
    """Each is run, drawn or reported, opened, interpolated beside half the tolerance, and balanced."""
    trial, ends = trials("combinations").trial, {}
    for index in range(first, end):
        (folder := tmp_path / str(index)).mkdir()
        ends[index] = trial(51, index, folder, 1)
    assert {index: each for index, each in ends.items() if not each.good} == {}
    counts = Counter(each.kind for each in ends.values())
    assert counts["converged"] > 0.3 * len(ends)
    assert counts["refused"] > 0.1 * len(ends)


def test_combinations_have_three_to_six_abilities_and_every_one_is_drawn(trials):
    combination = trials("combinations").combination
    drawn = [combination(51, index) for index in range(150)]
    assert {len(each.abilities) for each in drawn} == {3, 4, 5, 6}
    assert {name for each in drawn for name in each.abilities} == {*trials("combinations").ABILITIES}
    assert repr(combination(51, 7)) == repr(drawn[7]) != repr(combination(52, 7))


@pytest.mark.parametrize("together", [False, True])
def test_studies_are_configurations(together, trials, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = [
        trials("studies").study(np.random.default_rng(seed), together)
        for seed in range(30 if together else 60)
    ]
    for study in found:
        study.write(tmp_path)
        Config.model_validate(study.config)
    if together:
        assert {study.config["solver"]["method"] for study in found} == {"nested_gradient"}
    else:
        keys = {"interface", "temperature", "layers", "layer"}
        assert keys <= {key for study in found for key in study.config}
        assert any(study.config["grid"].get("geometry") for study in found)


def test_a_trial_that_a_signal_cuts_short_is_the_last_and_is_not_counted(soak, trials, tmp_path, monkeypatch):
    def trial(_, index, *__, **___):  # the flag of a run stays up in this process
        monkeypatch.setitem(soak.__globals__, "stop_requested", lambda: index == 12)
        return trials("outcomes").Outcome("cut short" if index == 12 else "converged")

    monkeypatch.setitem(soak.__globals__["KINDS"], "extremes", trial)
    arguments = ["--only", "extremes", "--out", str(tmp_path), "--first", "11", "--trials", "9"]
    assert soak(arguments) == 0
    lines = (tmp_path / "trials.jsonl").read_text().splitlines()
    assert [json.loads(line)["trial"] for line in lines] == ["1:11"]


def test_failures_are_kept_with_their_seeds(soak, trials, tmp_path, capsys, monkeypatch):
    outcome = trials("outcomes").Outcome

    def trial(_, index, folder, **__):
        (folder / "found").write_text(str(index))
        return outcome("hangs", "in the ramp") if index == 12 else outcome("converged", "", Counter(kills=2))

    monkeypatch.setitem(soak.__globals__["KINDS"], "extremes", trial)
    arguments = ["--only", "extremes", "--out", str(tmp_path / "out")]
    assert soak([*arguments, "--seed", "4", "--first", "11", "--trials", "3"]) == 1
    said = capsys.readouterr().out
    assert "FAILED  python scripts/soak.py --only extremes --seed 4:12\n        hangs: in the ramp\n" in said
    assert "| extremes | hangs | 1 | 4:12 |" in said
    assert "| extremes | converged | 2 |  |" in said
    assert "| kills | 4 |" in said
    assert (tmp_path / "out/extremes-4-12/found").read_text() == "12"
    lines = (tmp_path / "out/trials.jsonl").read_text().splitlines()
    assert [json.loads(line)["trial"] for line in lines] == ["4:11", "4:12", "4:13"]
    assert soak([*arguments, "--seed", "4:12"]) == 1
    assert len((tmp_path / "out/trials.jsonl").read_text().splitlines()) == 4
