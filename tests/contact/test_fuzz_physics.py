"""Any admissible case, over a few steps: whatever the body, the punch and the history, the mechanics hold.

With --hypothesis-profile=long (see `conftest`) ten thousand cases are drawn.
"""

import math

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gfmdlayer.case.case import Case
from gfmdlayer.case.model import simulate
from gfmdlayer.config import Config
from gfmdlayer.contact.residual import scales
from gfmdlayer.drives import Drives

anything = settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


def decades(lowest, highest):
    """Numbers whose logarithms fill a range."""
    return st.floats(math.log10(lowest), math.log10(highest)).map(lambda power: float(f"{10**power:.4g}"))


poisson = st.one_of(st.just(0.5), st.sampled_from([0.4999999, 0.49, 0.0, -0.9]), st.floats(0.1, 0.49))


@st.composite
def bodies(draw, length):
    """Draw a layer on its halfspace, from hard to soft and from a film to a solid."""
    G0 = draw(st.one_of(st.just(1.0), decades(1e-9, 1e9)))
    tau = draw(st.one_of(st.just(1.0), decades(1e-6, 1e6)))
    material = {"model": "zener", "G0": G0, "Ginf": G0, "tau": tau}
    match draw(st.sampled_from(["elastic", "zener", "zener", "prony"])):
        case "zener":
            material["Ginf"] = G0 * draw(decades(1.001, 1e5))
        case "prony":
            branch = st.fixed_dictionaries(
                {
                    "G": decades(1e-3, 1e4).map(lambda G: G * G0),
                    "tau": decades(1e-3, 1e3).map(lambda t: t * tau),
                }
            )
            material = {
                "model": "prony",
                "G0": G0,
                "branches": draw(st.lists(branch, min_size=1, max_size=4)),
            }
    thickness = length * draw(st.one_of(st.sampled_from([0.0, 0.05, math.inf]), decades(1e-6, 1e3)))
    bulk = draw(st.one_of(st.just(math.inf), decades(1e-3, 1e5), decades(1e-6, 1e20)))
    if thickness == 0 and math.isinf(bulk):
        bulk = 1.0
    return {
        "layer": {"thickness": thickness, "poisson": draw(poisson), "material": material},
        "halfspace": {"shear_modulus": bulk * G0, "poisson": draw(poisson)},
    }


@st.composite
def punches(draw, length, spacing):
    """Draw a punch in a cell of this length."""
    slope = draw(decades(1e-4, 10))
    return draw(
        st.sampled_from(
            [
                {"shape": "parabola", "radius": length / slope},
                {"shape": "wedge", "slope": slope},
                {"shape": "cone", "slope": slope},
                {"shape": "flat", "width": 0.3 * length, "edge_radius": 0.2 * length},
                {"shape": "sinusoid", "amplitude": slope * length, "wavelength": length / 2},
                {"shape": "array", "counts": 2, "element": {"shape": "parabola", "radius": length / slope}},
                {
                    "shape": "self_affine",
                    "hurst": draw(st.floats(0.1, 1)),
                    "short_cutoff": draw(st.floats(2.1 * spacing, max(2.1 * spacing, length))),
                    "seed": draw(st.integers(0, 99)),
                    "rms_slope": slope,
                },
            ]
        )
    )


@st.composite
def histories(draw, most, least, tau):
    """Draw what is prescribed up to ``most``, and the time axis: sections, and a table if there is one."""
    end = tau * draw(decades(1e-3, 1e3))
    count = draw(st.integers(1, 8))
    time = {
        "end": end,
        "step": end / count,
        "integrator": draw(st.sampled_from(["exponential", "backward_euler"])),
    }
    parts = st.one_of(st.floats(1e-3, 1), st.sampled_from([0.0, 1.0]), decades(least, 1))
    if draw(st.booleans()):
        ramp = end * draw(st.sampled_from([1e-3, 0.5, 1.0, 10.0]))
        return {"time": time, "value": most * draw(parts), "ramp_time": ramp}, None
    values = draw(st.lists(parts, min_size=2, max_size=6))
    times = np.linspace(0, end, len(values))
    rows = "\n".join(f"{t!r} {most * part!r}" for t, part in zip(times.tolist(), values, strict=True))
    return {"time": time}, rows


@st.composite
def cases(draw):
    """Draw a configuration as plain data, and the table of its trajectory."""
    length = draw(st.one_of(st.just(1.0), decades(1e-6, 1e6)))
    points = draw(st.one_of(st.integers(8, 128), st.tuples(st.integers(8, 14), st.integers(8, 14)).map(list)))
    coarsest = length / (min(points) if isinstance(points, list) else points)
    data = {"name": "drawn", "grid": {"points": points, "period": length}, **draw(bodies(length))}
    data["punch"] = draw(punches(length, coarsest))
    bare = Config.model_validate({**data, "trajectory": {"depth": 0.0}})
    height = float(Case(bare).punch.mean())
    material = bare.layer.material
    tau = material.characteristic_time or material.maxwell_branches[0][1]
    control = draw(st.sampled_from(["depth", "depth", "load"]))
    most = 0.95 * height
    if control == "load":  # up to what presses the lowest mode flat
        kappa, _ = Case(bare).contact.history.terms(0.0)
        most = 2 * float(kappa[1:].min()) * height
    # Gaps are known to 1e-16 of the heights. A load that presses less than this over the tolerance deep makes
    # a residual that rounding decides: 1e-3 of the largest, 1e-6 of it in a first adaptive step, and 1e-6.
    least, finest = (1e-3, 1e-6) if control == "load" else (1e-9, 1e-9)
    history, rows = draw(histories(most, least, tau))
    data["time"] = history.pop("time")
    data["trajectory"] = {"control": control}
    if rows is None:
        data["trajectory"] |= {control: history["value"], "ramp_time": history["ramp_time"]}
    if draw(st.integers(0, 4)) == 0 and "step" in data["time"]:
        data["time"] |= {
            "step": "adaptive",
            "integrator": "exponential",
            "tolerance": draw(decades(1e-3, 1e-1)),
        }
    else:
        step, end = data["time"]["step"], data["time"]["end"]
        data["output"] = {"snapshots": [min(i * step, end) for i in range(round(end / step) + 1)]}
    data["solver"] = {
        "method": draw(st.sampled_from(["active_set"] * 3 + ["conjugate_gradient"])),
        "tolerance": draw(decades(finest, 1e-3)),
    }
    return data, rows


def simulated(folder, recording, data, rows):
    """Run a case into a recording."""
    if rows is not None:
        (folder / "trajectory.txt").write_text(rows + "\n")
        data["trajectory"] |= {"kind": "table", "file": str(folder / "trajectory.txt")}
    config = Config.model_validate(data)
    simulate(config, recording)
    return config


@anything
@given(case=cases())
def test_the_mechanics_of_any_case(tmp_path, recorder, case):
    found = recorder()
    config = simulated(tmp_path, found, *case)
    grid, tolerance = Case(config).grid, config.solver.tolerance
    for name, values in ((name, found[name]) for name in found.rows[0]):
        assert np.isfinite(values).all(), name
    assert (found["residual"] <= tolerance).all()
    assert ((found["contact_area"] >= 0) & (found["contact_area"] <= 1)).all()
    # Where less than the least presses it may pull, by the tolerance.
    case = Case(config)
    least, _ = scales(
        0.0, 0.0, case.contact.loading.problem(*case.contact.history.terms(0.0), 0.0).residual_floor
    )
    assert (found["mean_pressure"] >= -tolerance * least / (2 * config.layer.material.G0)).all()
    if config.trajectory.control == "load":
        loads = [Drives(config).drive(time) for time in found["time"]]
        np.testing.assert_allclose(found["mean_pressure"] * 2 * config.layer.material.G0, loads, rtol=1e-12)
    assert (np.diff(found["dissipated"]) >= 0).all()
    assert (found["stored"] >= 0).all()
    for (_, u, p), gap in zip(found.snapshots, found.gaps, strict=True):
        assert u.shape == p.shape == gap.shape == grid.shape
        assert (gap >= 0).all()
        if Case(config).body.mean_stiffness == 0:
            assert abs(u.mean()) <= 1e-14 * max(np.abs(u).max(), np.abs(u + gap).max())
    if len(found.snapshots) == len(found.rows):
        assert_balanced(config, found)


def assert_balanced(config, found):
    """Compare the energies, which come from the modes, with the work of the pressure on the surface."""
    # Over a step of an elastic body what is stored is work of the mean of both pressures, exactly. With
    # backward Euler what is stored and lost is the work of the last pressure less, for each mode, K |du|^2/2
    # and w |dy|^2/2, K its spring and w that of a relaxing mode with stretch y.
    elastic = config.layer.material.elastic
    if not elastic and config.time.integrator != "backward_euler":
        return
    p0, u0, energy0 = np.zeros_like(found.snapshots[0][1]), np.zeros_like(found.snapshots[0][1]), 0.0
    off = 0.0
    for row, (_, u, p), gap in zip(found.rows, found.snapshots, found.gaps, strict=True):
        energy = row["stored"] + row["dissipated"]
        during = (p0 + p) / 2 if elastic and config.time.integrator == "exponential" else p
        work = -float(np.mean(during * (u - u0)))
        # Rounding: of the energies, and of u, which is the difference of punch and gap.
        off = max(off, p.max() * (1e-10 * np.abs(u).max() + 1e-14 * np.abs(u + gap).max()))
        if elastic and config.time.integrator == "exponential":
            assert abs(energy - energy0 - work) <= off
        else:
            assert energy - energy0 - work <= off
        p0, u0, energy0 = p, u, energy
