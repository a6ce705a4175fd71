"""Abilities by abilities: each pair runs, or is refused for physics or for what is missing."""

import sys
from pathlib import Path

import pytest

from gfmdlayer import Config
from gfmdlayer.case.model import NoRecorder, model_of, simulate

sys.path.insert(0, str(Path(__file__).parents[2] / "docs/extensions"))  # where Sphinx finds them too
from abilities import TOGETHER, alone, pairs


def test_each_ability_is_accepted_alone():
    assert [name for name, refusals in alone() if refusals] == []


def test_each_pair_of_abilities_runs_or_is_refused_with_a_reason():
    assert [(pair.one, pair.other, *map(str, pair.refusals)) for pair in pairs() if not pair.verdict] == []


def test_at_most_a_tenth_of_the_pairs_is_open():
    verdicts = [pair.verdict for pair in pairs()]
    assert verdicts.count("open") <= len(verdicts) / 10


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("pair", [pair for pair in pairs() if not pair.refusals and pair.other != TOGETHER],
                         ids=lambda pair: f"{pair.one}, {pair.other}")  # fmt: skip
def test_an_accepted_pair_runs(pair):
    config = Config(**pair.config)
    assert list(model_of(config).problems()) == []
    simulate(config, NoRecorder())
