"""`output.snapshots: every` keeps the surface after every accepted step, and changes nothing else."""

import numpy as np
import pytest

from gfmdlayer.config import Config, ConfigError, digest
from gfmdlayer.config.model import stem
from gfmdlayer.study.cost import estimate

EVERY = {"output.snapshots": "every"}


@pytest.mark.parametrize("steps", [{"time.step": 0.25}, {"time.step": "adaptive", "time.tolerance": 1e-2}])
def test_each_row_has_its_snapshot_and_the_bits_of_a_run_without(run, steps):
    case = {"grid.points": 64, "time.end": 2.0, "solver.method": "active_set", **steps}
    without, every = run(case), run(case | EVERY)
    np.testing.assert_array_equal([time for time, _, _ in every.snapshots], every["time"])
    assert without.snapshots == []
    assert every.rows == without.rows
    for (_, _, pressure), mean in zip(every.snapshots, every["mean_stress"], strict=True):
        assert pressure.mean() == pytest.approx(mean, rel=1e-12)


def test_it_counts_on_the_disk_and_as_another_beginning():
    config = Config(name="x").with_values({"grid.points": 256, "time.step": 0.5, "time.end": 2.0})
    every = config.with_values(EVERY)
    fields = 3 * 256 * 8
    assert estimate(every).storage - estimate(config).storage == 5 * fields
    # A run that goes on from a state without the earlier snapshots would lack them.
    assert stem(every) != stem(config)
    assert stem(every) == stem(every.with_values({"time.end": 4.0}))
    assert digest(every) != digest(config)


def test_another_word_is_refused():
    with pytest.raises(
        ConfigError, match=r"output\.snapshots: got .*'evry'; must be a list of times, .* or the word"
    ):
        Config(name="x", output={"snapshots": "evry"})
