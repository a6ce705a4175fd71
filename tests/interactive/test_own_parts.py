"""Laws and observables of a notebook's own classes run without files."""

from typing import Literal

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.config import Config, ConfigError

KEYS = {"grid": {"points": 64}, "time": {"end": 1.0, "step": 0.25}}


class Rouse(gfmdlayer.Material):
    """G(t) = G/1000 + G sum of exp(-k^2 t/tau)."""

    model: Literal["rouse"] = "rouse"
    G: float
    tau: float

    @property
    def relaxed(self):
        return 1e-3 * self.G

    @property
    def maxwell_branches(self):
        return tuple((self.G, self.tau / k**2) for k in range(1, 6))


class Highest(gfmdlayer.Observable):
    """The largest pressure of a row."""

    COLUMNS = (gfmdlayer.Column("highest", "largest pressure", "pressure"),)

    def measure(self, step):
        return {"highest": float(step.fields["pressure"].max())}


def test_a_law_runs_as_the_prony_series_that_it_is():
    law = Rouse(G=1.0, tau=2.0)
    series = gfmdlayer.Prony(law.relaxed, law.maxwell_branches)
    expected = gfmdlayer.run(KEYS, layer__material=series).mean_pressure
    for given in ({"layer__material": law}, {"layer": gfmdlayer.Layer(thickness=0.05, material=law)}):
        np.testing.assert_array_equal(gfmdlayer.run(KEYS, **given).mean_pressure, expected)


def test_an_observable_has_its_columns_and_leaves_none_behind():
    config = Config(name="own", **KEYS, output={"snapshots": [1.0]})
    before = gfmdlayer.run(config)
    found = gfmdlayer.run(config, observables=[Highest])
    assert float(found.highest[-1]) == float(found.pressure[-1].max())
    assert found.highest.attrs == {"long_name": "largest pressure", "units": "pressure"}
    np.testing.assert_array_equal(found.mean_pressure, before.mean_pressure)
    assert "highest" not in gfmdlayer.run(config)
    swept = gfmdlayer.run(KEYS, sweep={"layer.thickness": [0.05, 0.1]}, observables=[Highest])
    assert swept.highest.sizes["thickness"] == 2


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"observables": [3]}, "observables: got 3; must be a class that derives from gfmdlayer.Observable"),
        ({"observables": [Highest, Highest]}, "observables: Highest: there is a column 'highest'"),
        ({"observables": [Highest], "jobs": 2}, "observables: not available with several jobs"),
        ({"observables": [Highest], "out": "here"}, "observables: not available with out"),
    ],
)
def test_what_is_none_or_cannot_be_kept_is_refused(given, said):
    with pytest.raises(ConfigError, match=said):
        gfmdlayer.run(KEYS, **given)
