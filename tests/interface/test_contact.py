"""Contact under an interface law: the solver, and a whole case, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from gfmdlayer.config import Config
from gfmdlayer.contact.newton.solver import Newton
from gfmdlayer.contact.problem import Problem
from gfmdlayer.grid.grid import Grid
from gfmdlayer.grid.transforms import Transforms
from gfmdlayer.interface.adhesion import Exponential
from gfmdlayer.model import simulate
from gfmdlayer.results.journal import Recording

LAW = Exponential(work=1e-3, range=4e-3).interaction()


def test_a_flat_punch_lifts_a_compressible_layer_to_where_stress_and_traction_balance() -> None:
    # kappa_0 u = tau(g0 - u) for a uniform surface; of the two roots the one nearer to rest is stable.
    stiffness, gap = 100.0, 0.01
    kappa = stiffness + Grid((32,), (1.0,)).wavenumbers
    problem = Problem(kappa, np.zeros(kappa.size, complex), np.full(32, gap), interface=LAW)
    found = Newton(Transforms((32,))).solve(problem, np.full(32, np.inf), 1e-9)
    assert found.converged
    rise = brentq(lambda u: stiffness * u - LAW.traction(np.array(gap - u)), 0, gap / 2, xtol=1e-16)
    # The residual bounds the stress that is out of balance by 1e-9 of tau(0) = 0.25; over kappa_0 -
    # tau'(gap), which is at least half of kappa_0 here.
    np.testing.assert_allclose(found.displacement, rise, atol=2e-9 * 0.25 / stiffness)
    assert found.mean_pressure == pytest.approx(-stiffness * rise, abs=1e-9)
    assert found.contact_area == 0


def run(config: Config, **values: object) -> list[dict[str, float]]:
    recording = Recording()
    simulate(config.with_values(values), recording)
    return recording.rows


@pytest.mark.parametrize("control", ["depth", "load"])
def test_a_case_takes_an_interface_law_and_its_energy_balances(control: str) -> None:
    config = Config(name="adhesion").with_values(
        {
            "grid.points": 512,
            "halfspace.shear_modulus": 1.0,
            "layer.material": {"model": "zener", "G0": 1.0, "Ginf": 3.0, "tau": 1.0},
            "trajectory": {"control": control, control: 0.01},
            "time": {"end": 2.0, "step": 0.02, "integrator": "exponential"},
        }
    )
    adhesive = run(config, interface={"work": 1e-3, "range": 4e-3})
    hard = run(config)
    assert all(row["residual"] <= 1e-6 for row in adhesive)
    after = [row for row in adhesive if row["time"] >= 1.0]
    # Attraction takes a part of the load at a given depth, and sinks the punch under a given load.
    if control == "depth":
        assert after[-1]["mean_pressure"] < hard[-1]["mean_pressure"]
    else:
        assert after[-1]["depth"] > hard[-1]["depth"]
        assert after[-1]["mean_pressure"] == pytest.approx(hard[-1]["mean_pressure"], rel=1e-12)
    assert after[-1]["contact_area"] > hard[-1]["contact_area"]
    # In the hold the balance changes by the truncation error of the history, (dt/tau)^2/12 of the heat.
    change = [row["energy_residual"] - after[0]["energy_residual"] for row in after]
    assert np.abs(change).max() < 0.02**2 / 12 * after[-1]["dissipated"] + 1e-9 * abs(after[-1]["work"])


def test_an_adhesive_cylinder_rolls_and_its_energy_balances() -> None:
    config = Config(name="rolling").with_values(
        {
            "grid.points": 256,
            "layer": {"thickness": 0.1, "material": {"model": "zener", "G0": 1.0, "Ginf": 3.0, "tau": 1.0}},
            "halfspace.shear_modulus": 1.0,
            "trajectory": {"control": "depth", "depth": 0.004, "ramp_time": 0.5, "velocity": 0.05},
            "time": {"end": 1.5, "step": 0.05},
        }
    )
    adhesive = run(config, interface={"law": "exponential", "work": 1e-3, "range": 4e-3})
    hard = run(config)
    last = adhesive[-1]
    # The edge behind opens against the attraction of a stiffened body: the punch is held back by more.
    assert last["tangential_force"] > 2 * hard[-1]["tangential_force"] > 0
    # The balance misses the truncation error of the history, (dt/tau)^2/12 of the heat, and the work of the
    # residual, 1e-6 of the strength over the way of a point in each of 30 steps, at most the range.
    change = last["energy_residual"] - adhesive[10]["energy_residual"]
    assert abs(change) < 0.05**2 / 12 * last["dissipated"] + 30 * 1e-6 * 1e-3
