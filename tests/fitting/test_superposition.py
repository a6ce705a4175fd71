"""Curves at several temperatures: shift factors, laws behind them, and the master curve, with intervals."""

from pathlib import Path

import numpy as np
import pytest

from gfmdlayer import WLF, Arrhenius, FractionalZener, Prony, cli, fit_material, load
from gfmdlayer.files.tables import TableError
from gfmdlayer.fitting.measurement import CreepCurve, FitError, MasterCurve, RelaxationCurve
from gfmdlayer.fitting.superposition import superposed

# Nine branches, a decade apart, over the glass transition of a rubber.
RUBBER = Prony(5.0, tuple((10 ** (3 - 0.6 * abs(k)), 10.0**-k) for k in range(5, -4, -1)))
TRUE = WLF(C1=12.0, C2=110.0, reference=10.0)
TEMPERATURES = (-20.0, -5.0, 10.0, 25.0, 40.0, 60.0)
NOISE = 0.01


def curves(kind, law=RUBBER, shift=TRUE, noise=NOISE, seed=0, heights=(0.0,) * 6):
    """Curves of three decades at each temperature, with relative noise, and moduli times 10^height."""
    rng = np.random.default_rng(seed)
    found = []
    for T, height in zip(TEMPERATURES, heights, strict=True):
        abscissa = np.geomspace(0.1, 100.0, 16)
        at_reference = kind("", abscissa, np.empty(0)).slowed(1 / shift.factor(T))
        moduli = kind("", abscissa, np.empty(0)).predicted(law, at_reference.abscissa) * 10**height
        errors = noise * rng.standard_normal(moduli.shape)
        found.append(kind(f"at{T:g}.csv", abscissa, moduli * (1 + errors), ("s", "kPa"), temperature=T))
    return found


def contains(number, value):
    return number.interval[0] <= value <= number.interval[1]


@pytest.mark.parametrize("kind", [MasterCurve, RelaxationCurve, CreepCurve])
def test_curves_without_noise_give_the_constants_of_wlf(kind):
    found = superposed(curves(kind, noise=0.0), 10.0)
    C1, C2 = found.constants
    # The dense series has 20 times a decade, none of them the true ones: its moduli err by some 1e-4.
    assert C1.value == pytest.approx(12.0, rel=1e-3)
    assert C2.value == pytest.approx(110.0, rel=1e-3)
    assert found.reference == 10.0
    assert (np.diff(found.master.abscissa) > 0).all()


@pytest.mark.slow  # the single fit above is the quick form
def test_intervals_contain_the_constants_and_the_factors():
    """Of 12 draws with 2 constants and 5 factors: 95 % of 84, less four standard deviations of 12 draws."""
    inside = 0
    for seed in range(12):
        found = superposed(curves(MasterCurve, seed=seed), 10.0)
        inside += sum(map(contains, found.constants, (12.0, 110.0)))
        for T, factor in zip(TEMPERATURES, found.factors, strict=True):
            inside += factor.interval is not None and contains(factor, np.log10(TRUE.factor(T)))
    assert inside / 84 > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 12)


def test_free_factors_follow_any_law_and_heights_are_found():
    heights = (0.02, 0.01, 0.0, -0.01, -0.02, -0.03)
    energy = Arrhenius(activation_energy=1.5e5, reference=10.0)
    law = FractionalZener(1.0, 1e3, 1e-2, 0.6)
    found = superposed(curves(MasterCurve, law, energy, 0.002, heights=heights), 10.0, "free", vertical=True)
    assert found.law is None
    off = []
    for T, factor, height, true in zip(TEMPERATURES, found.factors, found.vertical, heights, strict=True):
        for number, exact in ((factor, np.log10(energy.factor(T))), (height, true)):
            off.append(abs(number.value - exact) / (number.stderr or 1e-9))
            assert number.value == pytest.approx(exact, abs=0.03)  # hold only together where G is a power law
    assert np.sum(np.array(off) > 2) <= 2  # of ten, 2.3 % each: by chance in .1 % of all draws
    again = superposed(curves(MasterCurve, law, energy, 0.002), 10.0, "arrhenius")
    assert contains(again.constants[0], 1.5e5)
    assert again.constants[0].unit == "J/mol"


def test_a_law_that_is_held_needs_no_search_and_constants_move_with_the_reference():
    held = superposed(curves(MasterCurve, noise=0.0), None, TRUE)
    assert [each.value for each in held.constants] == [12.0, 110.0]
    assert not any(each.vary for each in held.constants)
    elsewhere = superposed(curves(MasterCurve, noise=0.0), 25.0)
    C1, C2 = elsewhere.constants
    # C2 grows by the change of the reference, C1 C2 stays.
    assert C2.value == pytest.approx(125.0, rel=2e-3)
    assert C1.value == pytest.approx(12.0 * 110 / 125, rel=2e-3)


def rows(shift=TRUE, unit="degC", offset=0.0):
    lines = [f"T [{unit}];omega [rad/s];G' [kPa];G'' [kPa]"]
    for curve in curves(MasterCurve, shift=shift):
        numbers = zip(curve.abscissa, *curve.moduli, strict=True)
        lines += [f"{curve.temperature + offset};{w};{a};{b}" for w, a, b in numbers]
    return "\n".join(lines) + "\n"


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_one_table_with_temperatures_is_a_material_that_a_run_takes(capsys):
    Path("dma.csv").write_text(rows(unit="K", offset=273.15))
    assert cli.main(["fit-material", "dma.csv", "--reference", "10"]) == 0
    said = capsys.readouterr().out
    assert "Curves at -20, -5, 10, 25, 40, 60 degrees Celsius are shifted to 10." in said
    assert Path("dma.png").exists()
    values = ["grid.points=32", "time.end=1e-3", "time.step=5e-4", "temperature.value=25"]
    units = "units={length: m, stress: kPa, time: s}"
    material = load("dma.yaml", [units, *values]).layer.material
    assert material.shift.law == "wlf"
    fit = fit_material("dma.csv", reference=10.0)
    assert fit.material.shift == material.shift
    assert fit.material.shift.factor(25.0) == pytest.approx(TRUE.factor(25.0), rel=0.02)
    assert f"{fit['C1'].value:.6e}" in str(fit)
    data = fit.to_dataset()
    assert data["log10_aT"].sel(temperature=10.0).item() == pytest.approx(0.0, abs=1e-9)
    assert data["value"].sel(parameter="C2").item() == fit["C2"].value
    assert (fit.ndata, fit.nfree) == (192, 192 - fit.nvarys)
    assert fit.redchi**0.5 == pytest.approx(NOISE, rel=0.3)
    axes = fit.plot("shift.png").axes
    assert [each.get_title(loc="left")[:3] for each in axes] == ["(a)", "(b)", "(c)", "(d)"]


def test_files_of_one_temperature_each_are_joined(capsys):
    for curve in curves(MasterCurve):
        np.savetxt(curve.source, np.column_stack([curve.abscissa, *curve.moduli]), header="omega G' G''")
    files = {T: f"at{T:g}.csv" for T in TEMPERATURES}
    found = fit_material(files, reference=10.0)
    assert contains(found["C1"], 12.0)
    command = ["fit-material", *files.values(), "--reference", "10", "--out", "one.yaml"]
    assert cli.main(command) == 2
    assert "has no temperature" in capsys.readouterr().err
    degrees = [f"{T:g}" for T in TEMPERATURES]
    assert cli.main([*command, "--temperatures", *degrees[1:]]) == 2
    assert "got 5 for 6 files" in capsys.readouterr().err
    assert cli.main([*command, "--shift", "free", "--vertical", "--temperatures", *degrees]) == 0
    said = capsys.readouterr().out
    assert "log10 bT" in said
    assert "without a shift" in said
    held = ["--wlf", "12", "110", "--force", "--temperatures", *degrees]
    assert cli.main([*command, *held]) == 0
    assert "held" in capsys.readouterr().out


def test_what_cannot_be_shifted_is_refused():
    every = curves(MasterCurve)
    for chosen, options, words in (
        (every[:1], {}, "needs? curves at two or more"),
        (every[:2], {}, "wlf has two constants"),
        (every, {"shift": "wfl"}, "got 'wfl'; must be one of wlf, arrhenius, free"),
        (every, {"shift": "free", "reference": 11.0}, "must be one of -20, -5"),
        (every, {"reference": 90.0}, "must be from -20 to 60"),
        (every, {"shift": WLF(C1=12.0, C2=20.0, reference=10.0)}, "must be above -10"),
        (every, {"shift": TRUE, "reference": 20.0}, "give one"),
        ([*every[:2], *curves(RelaxationCurve)[2:]], {}, "differ in kind"),
    ):
        with pytest.raises(FitError, match=words):
            superposed(chosen, **options)
    Path("ramp.csv").write_text("T,omega,G',G''\n" + "".join(f"{i / 4},{i + 1},2,1\n" for i in range(40)))
    with pytest.raises(TableError, match="the temperature changes by"):
        fit_material("ramp.csv")


def test_a_fit_of_columns_has_the_names_of_lmfit_and_intervals_of_its_numbers():
    """Intervals of a law of four numbers, of 20 draws: 95 % of 80, less four standard deviations of 20."""
    true, omega, inside = FractionalZener(1.0, 100.0, 1.0, 0.6), np.geomspace(1e-4, 1e4, 60), 0
    modulus = true.complex_modulus(omega)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        storage, loss = (
            part * (1 + NOISE * rng.standard_normal(60)) for part in (modulus.real, modulus.imag)
        )
        fit = fit_material({"omega": omega, "G'": storage, "G''": loss}, "fractional_zener")
        inside += sum(contains(fit[key], getattr(true, key)) for key in ("G0", "Ginf", "tau", "exponent"))
    assert inside / 80 > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 20)
    assert fit.params["tau"].vary
    assert fit.params["tau"].stderr > 0
    with pytest.raises(KeyError, match="beta: must be one of G0, Ginf, tau, exponent"):
        fit["beta"]
    material, picture = fit.write("out/")
    assert load(material).layer.material.model == "fractional_zener"
    assert picture.exists()


def test_creep_that_goes_on_to_the_end_is_said_to_be_taken_as_a_liquid():
    t = np.geomspace(1e-2, 10.0, 40)
    liquid = Prony(0.0, ((1.0, 0.1), (2.0, 5.0)))
    solid = Prony(1.0, ((1.0, 0.1), (2.0, 1.0)))
    said = [fit_material({"t": t, "J(t)": law.creep_compliance(t)}).warnings for law in (liquid, solid)]
    assert any("is taken as a liquid" in line for line in said[0])
    assert not any("is taken as a liquid" in line for line in said[1])
    told = fit_material({"t": t, "J(t)": liquid.creep_compliance(t)}, relaxed_modulus=0.0).warnings
    assert not any("is taken as a liquid" in line for line in told)


def test_curves_that_do_not_superpose_and_factors_that_do_not_bend_are_said():
    heights = (0.0, 0.2, 0.0, 0.2, 0.0, 0.2)
    lines = []
    for curve in curves(MasterCurve, heights=heights):
        numbers = zip(curve.abscissa, *curve.moduli, strict=True)
        lines += [f"{curve.temperature};{w};{a};{b}" for w, a, b in numbers]
    Path("uneven.csv").write_text("\n".join(["T [degC];omega [rad/s];G' [kPa];G'' [kPa]", *lines]))
    assert "do not lie on one master curve" in str(fit_material("uneven.csv", shift="free", reference=10.0))
    upright = fit_material("uneven.csv", shift="free", reference=10.0, vertical=True)
    assert "do not lie on one master curve" not in str(upright)
    straight = WLF(C1=0.1 * 1e7 / np.log(10), C2=1e7, reference=10.0)  # ln aT = -.1 (T - 10)
    with pytest.raises(FitError, match="do not bend as those of wlf"):
        superposed(curves(MasterCurve, shift=straight), 10.0)
