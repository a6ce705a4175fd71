"""Prony series from measured curves: their error, the number of branches, and refusals."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer import cli
from gfmdlayer.body.continuous import FractionalZener
from gfmdlayer.body.materials import Prony
from gfmdlayer.body.shifts import WLF
from gfmdlayer.case.model import simulate
from gfmdlayer.config import load
from gfmdlayer.files.tables import Answers, TableError
from gfmdlayer.fitting.laws import ACCURACY, MARGIN, FittedLaw, fit
from gfmdlayer.fitting.material import fit_figure, write_fit
from gfmdlayer.fitting.measurement import CreepCurve, FitError, MasterCurve, RelaxationCurve, read
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.recording import Recording

KNOWN = Prony(1.0, ((3.0, 1e-3), (2.0, 3e-2), (4.0, 1.0), (1.0, 30.0)))
RANGE = {MasterCurve: (1e-3, 1e4), RelaxationCurve: (1e-4, 1e3), CreepCurve: (1e-4, 1e3)}
T_OF_G = np.geomspace(0.01, 100.0, 20)
G_OF_T = 1 + 9 * np.exp(-T_OF_G)
ROWS_OF_G = "\n".join(f"{t!r},{g!r}" for t, g in zip(T_OF_G.tolist(), G_OF_T.tolist(), strict=True))
KINDS = pytest.mark.parametrize("kind", [MasterCurve, RelaxationCurve])


def measured(kind, material, rows=120, noise=0.0, seed=0):
    abscissa = np.geomspace(*RANGE[kind], rows)
    moduli = kind("", abscissa, np.empty(0)).predicted(material, abscissa)
    errors = noise * np.random.default_rng(seed).standard_normal(moduli.shape)
    return kind("measured.csv", abscissa, moduli * (1 + errors))


def deviation(fitted, truth):
    """Fitted curve over the true one, minus one."""
    curve = fitted.measurement
    return curve.predicted(fitted.material, curve.abscissa) / curve.predicted(truth, curve.abscissa) - 1


def rms(values):
    return float(np.sqrt(np.mean(values**2)))


def fractional_zener(kind, abscissa, alpha):
    """Cole-Cole form of a solid of G0 = tau = 1, or its relaxation, which tests/body integrates."""
    if kind is RelaxationCurve:
        relaxation = FractionalZener(1.0, 100.0, 1.0, alpha).relaxation_modulus(abscissa)
        return kind("mittag-leffler", abscissa, relaxation[np.newaxis])
    power = (1j * abscissa) ** alpha
    modulus = 1 + 99 * power / (1 + power)
    return kind("cole-cole", abscissa, np.stack([modulus.real, modulus.imag]))


@KINDS
@pytest.mark.parametrize("seed", range(3))
def test_a_known_series_is_found_again_within_the_noise(kind, seed):
    noise = 0.02
    fitted = fit(measured(kind, KNOWN, noise=noise, seed=seed))
    count = fitted.measurement.moduli.size
    assert len(fitted.material.branches) in {4, 5}
    # The error against the data is the noise, its rms known to 1/sqrt(2 count), and the margin; four of them.
    assert abs(fitted.rms / noise - 1) < 4 / np.sqrt(2 * count) + (MARGIN - 1)
    # The fit errs by noise sqrt(parameters/count), and by what the margin lets pass, a third of the noise.
    found = 2 * len(fitted.material.branches) + 1
    allowed = noise * (2 * np.sqrt(found / count) + np.sqrt(MARGIN**2 - 1))
    assert rms(deviation(fitted, KNOWN)) < allowed < noise


@KINDS
def test_a_known_series_is_found_exactly_where_there_is_no_noise(kind):
    fitted = fit(measured(kind, KNOWN), branches=4).material
    # The search ends where a step changes logarithms of times by 1e-6 or the error's square by 1e-8.
    np.testing.assert_allclose(fitted.branch_times, KNOWN.branch_times, rtol=1e-4)
    np.testing.assert_allclose(fitted.branch_moduli, KNOWN.branch_moduli, rtol=1e-4)
    np.testing.assert_allclose(fitted.G0, 1, rtol=1e-4)


@pytest.mark.parametrize("alpha", [0.3, 0.5, 0.7])
@KINDS
def test_a_fractional_zener_solid_over_eight_decades_is_fitted_to_a_percent(kind, alpha):
    x = np.geomspace(1e-4, 1e4, 81)
    fitted = fit(fractional_zener(kind, x, alpha))
    assert len(fitted.material.branches) <= 20
    assert fitted.largest < 0.01
    if kind is MasterCurve:
        between = fractional_zener(kind, np.sqrt(x[1:] * x[:-1]), alpha)
        assert FittedLaw(between, fitted.material, 0).largest < 0.01


def test_both_kinds_of_curve_tell_of_the_same_solid():
    """The master curve's series relaxes as the Mittag-Leffler function, away from the ends of its range."""
    series = fit(fractional_zener(MasterCurve, np.geomspace(1e-4, 1e4, 81), 0.5)).material
    relaxing = fractional_zener(RelaxationCurve, np.geomspace(1e-3, 1e3, 31), 0.5)
    assert FittedLaw(relaxing, series, 0).largest < 0.01


@pytest.mark.parametrize("noise", [0.0, 0.02])
@KINDS
def test_branches_are_the_fewest_that_are_enough(kind, noise):
    curve = measured(kind, KNOWN, noise=noise)
    chosen = fit(curve)
    count = len(chosen.material.branches)
    enough = max(MARGIN * chosen.least, ACCURACY)
    assert chosen.rms <= enough
    assert fit(curve, branches=count - 1).rms > enough
    assert not noise or chosen.rms > chosen.least / MARGIN  # nothing lies far below what any series reaches


@pytest.mark.parametrize("branches", [1, 2, 3, 7])
def test_as_many_branches_as_asked(branches):
    curve = fractional_zener(MasterCurve, np.geomspace(1e-4, 1e4, 41), 0.5)
    found = fit(curve, branches=branches).material
    assert len(found.branches) == branches
    assert (np.diff(found.branch_times) > 0).all()


def test_each_branch_reduces_the_error():
    curve = fractional_zener(MasterCurve, np.geomspace(1e-4, 1e4, 41), 0.5)
    errors = [fit(curve, branches=count).rms for count in (2, 4, 6, 8, 10)]
    assert all(after < before / 2 for before, after in pairwise(errors))


def test_branches_of_no_use_are_left_out():
    assert len(fit(measured(MasterCurve, KNOWN), branches=12).material.branches) == 4


@KINDS
def test_the_unit_of_moduli_and_times_does_not_matter(kind):
    curve = measured(kind, KNOWN, noise=0.02)
    here = fit(curve).material
    there = fit(curve.slowed(1e-7).in_units_of(1e-6)).material
    # Both searches end within their tolerance of the same minimum, which noise makes as flat as it is.
    np.testing.assert_allclose(there.branch_times, 1e-7 * here.branch_times, rtol=1e-3)
    np.testing.assert_allclose(there.branch_moduli, 1e6 * here.branch_moduli, rtol=1e-3)


@KINDS
def test_the_response_of_a_branch_is_that_of_the_material_and_its_slope(kind):
    curve, times, step = measured(kind, KNOWN, rows=9), KNOWN.branch_times, 1e-5
    total = curve.constant * KNOWN.G0 + curve.response(times) @ KNOWN.branch_moduli
    np.testing.assert_allclose(total.reshape(curve.moduli.shape), curve.moduli, rtol=1e-14)
    slope = (curve.response(times * np.exp(step)) - curve.response(times * np.exp(-step))) / (2 * step)
    # Central differences: step^2 of truncation and ulp/step of rounding.
    np.testing.assert_allclose(curve.sensitivity(times), slope, atol=1e-10)


@KINDS
def test_a_liquid_is_refused(kind):
    liquid = Prony(1e-9, KNOWN.branches[:3])
    curve = measured(kind, liquid, rows=60, noise=0.02)
    if kind is RelaxationCurve:
        seen = curve.abscissa < 8.0  # the plateau is not measured
        curve = replace(curve, abscissa=curve.abscissa[seen], moduli=curve.moduli[:, seen])
    with pytest.raises(FitError, match=rf"flows like a liquid.* measure at {kind.slower}"):
        fit(curve)
    assert fit(curve, relaxed=1e-6).material.G0 == 1e-6


def test_a_liquid_is_fitted_where_it_is_named_one():
    liquid = Prony(0.0, KNOWN.branches[:3])
    found = fit(measured(MasterCurve, liquid, rows=60), branches=3, relaxed=0.0).material
    assert found.G0 == 0
    # The search ends where a step changes logarithms of times by 1e-6 or the error's square by 1e-8.
    np.testing.assert_allclose(found.branch_times, liquid.branch_times, rtol=1e-4)


# Creep: the strain of a series follows from its retardation times, independently of the fit (tests/body).


LIQUID = pytest.mark.parametrize("G0", [1.0, 0.0], ids=["solid", "liquid"])


@LIQUID
def test_creep_of_a_series_gives_the_series(G0):
    known = Prony(G0, KNOWN.branches)
    found = fit(measured(CreepCurve, known), branches=len(known.branches)).material
    assert pytest.approx(G0, rel=1e-4) == found.G0
    np.testing.assert_allclose(found.branch_times, known.branch_times, rtol=1e-4)  # as of the other curves
    np.testing.assert_allclose(found.branch_moduli, known.branch_moduli, rtol=1e-4)


@LIQUID
@pytest.mark.parametrize("seed", range(3))
def test_noise_does_not_make_a_solid_of_a_liquid_or_the_reverse(G0, seed):
    known, noise = Prony(G0, KNOWN.branches), 0.02
    fitted = fit(measured(CreepCurve, known, noise=noise, seed=seed))
    assert (fitted.material.G0 > 0) is (G0 > 0)
    # The fit errs by noise sqrt(parameters/count), and by what the margin lets pass, a third of the noise.
    count, found = fitted.measurement.moduli.size, 2 * len(fitted.material.branches) + 1
    assert rms(deviation(fitted, known)) < noise * (2 * np.sqrt(found / count) + np.sqrt(MARGIN**2 - 1))


def test_creep_and_relaxation_tell_of_the_same_solid():
    """The relaxation that follows from a creep curve with a continuous spectrum is the law's."""
    law = FractionalZener(1.0, 100.0, 1.0, 0.5)
    series = fit(measured(CreepCurve, law)).material
    relaxing = fractional_zener(RelaxationCurve, np.geomspace(1e-3, 1e2, 31), 0.5)
    assert FittedLaw(relaxing, series, 0).largest < 0.01


def test_creep_refuses_a_relaxed_modulus():
    with pytest.raises(FitError, match="a creep curve has its own, or 0 for a liquid"):
        fit(measured(CreepCurve, KNOWN), relaxed=1.5)


def test_an_elastic_solid_is_refused():
    rigid = RelaxationCurve("", np.geomspace(1e-3, 1e3, 20), np.full((1, 20), 3.0))
    with pytest.raises(FitError, match="nothing relaxes"):
        fit(rigid)


@pytest.mark.parametrize("branches", [-1, 0, 8])
def test_an_impossible_number_of_branches_is_refused(branches):
    # 16 numbers determine 7 branches of two parameters, and G0.
    with pytest.raises(FitError, match=f"got {branches} branches; must be 1 to 7 for 8 rows"):
        fit(measured(MasterCurve, KNOWN, rows=8), branches=branches)


@pytest.mark.parametrize("relaxed", [-1.0, 12.0, float("nan")])
def test_an_impossible_relaxed_modulus_is_refused(relaxed):
    with pytest.raises(FitError, match="must be > 0 and below the highest measured, "):
        fit(measured(MasterCurve, KNOWN, rows=8), relaxed=relaxed)


ROWS = [(10.0**i, 1.0 + i, 2.0) for i in range(8)]


def table(rows, separator=",", head=""):
    return head + "".join(separator.join(map(str, row)) + "\n" for row in rows)


def changed(row, *numbers):
    return table([*ROWS[:row], numbers, *ROWS[row + 1 :]])


@pytest.mark.parametrize(
    "content",
    [
        table(ROWS),
        table(ROWS, ";"),
        table(ROWS, "\t"),
        table(ROWS, ", ", "# from the laboratory\n\nomega, G', G''\n"),
        table(ROWS, " ", "omega [rad/s] G' [Pa] G'' [Pa]\n"),
        table(ROWS, ";", "ω;G';G''\nrad/s;Pa;Pa\n"),
        "\ufeff" + table(ROWS).replace("\n", "  # good\r\n"),
    ],
)
def test_a_master_curve_is_read_in_every_notation(tmp_path, content):
    path = tmp_path / "data.csv"
    path.write_text(content, encoding="utf-8")
    curve = read(path)
    assert isinstance(curve, MasterCurve)
    np.testing.assert_array_equal(np.vstack([curve.abscissa, curve.moduli]), np.transpose(ROWS))


ZENER = Prony(1e5, [(9e5, 1.0)])
OMEGA = np.geomspace(1e-3, 1e3, 61)


@pytest.mark.parametrize(
    ("head", "columns", "unit"),
    [
        ("Frequency [rad/s],G' [MPa],G'' [MPa]", lambda w, G: (w, G.real / 1e6, G.imag / 1e6), 1e6),
        ("omega [rad/s],G' [Pa],G'' [kPa]", lambda w, G: (w, G.real, G.imag / 1e3), 1.0),
        ("f (Hz),E'' (kPa),E' (MPa)",
         lambda w, G: (w / 2 / np.pi, 2.6 * G.imag / 1e3, 2.6 * G.real / 1e6), 1e3),
        ("f [kHz],E*/Pa,phase [deg]",
         lambda w, G: (w / 2e3 / np.pi, 2.6 * abs(G), np.degrees(np.angle(G))), 1.0),
        ("T [°C],tan delta,omega [1/s],|G*| [GPa]",
         lambda w, G: (25 + 0 * w, G.imag / G.real, w, abs(G) / 1e9), 1e9),
        ("J'' [1/MPa],J' [1/kPa],omega [rad/min]",
         lambda w, G: (-1e6 * (1 / G).imag, 1e3 * (1 / G).real, 60 * w), 1e6),
        ("w [rad/s],Speichermodul [kPa],Verlustmodul [kPa]",
         lambda w, G: (w, G.real / 1e3, G.imag / 1e3), 1e3),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)  # fmt: skip
def test_columns_are_read_in_their_own_units_and_any_order(tmp_path, head, columns, unit):
    path = tmp_path / "data.csv"
    rows = np.column_stack(columns(OMEGA, ZENER.complex_modulus(OMEGA)))[::-1]  # from high to low
    path.write_text(head + "\n" + table(rows.tolist()))
    curve = read(path, 0.3, Answers(modulus="G"))
    found = fit(curve).material
    assert (found.G0, found.glassy) == pytest.approx((1e5 / unit, 1e6 / unit), rel=1e-4)  # of the search
    assert found.branch_times == pytest.approx([1.0], rel=1e-4)
    assert curve.units == ("s", {1.0: "Pa", 1e3: "kPa", 1e6: "MPa", 1e9: "GPa"}[unit])
    assert "sorted by angular frequency" in " ".join(curve.notes)


@pytest.mark.parametrize(
    ("head", "size"),
    [("t [ms],J(t) [1/MPa]", 1e6), ("time (ms);D(t) (1/MPa)", 1e6 / 2.6), ("t [ms] J [MPa^-1]", 1e6)],
)
def test_creep_is_read_with_its_units_and_its_row_at_rest_is_left_out(tmp_path, head, size):
    path, t = tmp_path / "creep.csv", np.geomspace(1e-3, 1e3, 61)
    rows = [(0.0, 0.0), *zip((1e3 * t).tolist(), (ZENER.creep_compliance(t) * size).tolist(), strict=True)]
    separator = ";" if ";" in head else " " if "J [" in head else ","
    path.write_text(head + "\n" + table(rows, separator))
    curve = read(path, 0.3)
    found = fit(curve).material
    assert (found.G0, found.glassy) == pytest.approx((0.1, 1.0), rel=1e-4)
    assert found.branch_times == pytest.approx([1.0], rel=1e-4)
    assert "The row at t = 0 is left out" in curve.notes[0]


def test_two_columns_are_a_relaxation_curve(tmp_path):
    path = tmp_path / "data.csv"
    path.write_text(table([row[:2] for row in ROWS], head="time,G\n"))
    curve = read(path)
    assert isinstance(curve, RelaxationCurve)
    assert curve.source == "data.csv"
    np.testing.assert_array_equal(curve.moduli, [[row[1] for row in ROWS]])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (changed(0, 0, 1, 2), ":1: angular frequency = 0; must be > 0"),
        (changed(0, -1, 1, 2), ":1: angular frequency = -1; must be > 0"),
        (changed(4, 1e4, -1, 2), ":5: G' = -1; must be > 0"),
        (changed(4, 1e4, 1, -2), ":5: G'' = -2; must be > 0"),
        (changed(4, 1e4, 1, float("nan")), ":5: G'' is 'nan' in '10000.0,1,nan'; must be a number"),
        (changed(4, 1e3, 1, 2), ":5: angular frequency = 1000 again, after line 4; must be one row for each"),
        (changed(4, 1e4, 1), ":5: '10000.0,1' holds 2 columns; must be 3, as above"),
        (table([(t, 1.0) for t in (1, 2, 3, 3)]), ":4: time = 3 again, after line 3"),
        (table([(t, 1.0 - t) for t in (0.5, 2)]), ":2: G(t) = -1; must be > 0"),
        (table(ROWS[:7], head="# seven\n"), ": holds 7 rows of numbers; must be at least 8"),
        (table([(*row, 1.0) for row in ROWS]), ":1: holds 4 numbers; must be 3 numbers (angular frequency, "),
        ("", ":1: holds no rows of numbers"),
        ("omega G' G''\n", ":1: holds no rows of numbers"),
        (table(ROWS, head="f [Hz], G', spread\n"), ": the columns 'f [Hz]', \"G'\" make no curve"),
        (table(ROWS, head="omega, G' [Pa], G'' [Pa]\n"), ": G' has a unit, but angular frequency has none"),
        (table(ROWS, head="f [1/s], G' [Pa], G'' [Pa]\n"), ": heading 'f [1/s]' in '1/s' may be a freq"),
        (table(ROWS, head="omega, storage modulus, loss modulus\n"),
         ": heading 'storage modulus' may be in shear (G) or in tension (E)"),
        (table([(*row, 2e3 / row[1]) for row in ROWS], head="omega, G', G'', tan delta\n"),
         ": tan delta is 1e+03 times the value that follows from G' and G''"),
        (table(ROWS, head="omega [rad/s], |G*| [Pa], phase\n"), ": "),
    ],
)  # fmt: skip
def test_bad_data_are_refused_with_file_and_line(tmp_path, content, message):
    path = tmp_path / "data.csv"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(TableError) as refused:
        read(path)
    assert str(refused.value).startswith(f"{path}{message}")


def test_a_shift_of_temperature_multiplies_times_by_its_factor():
    factor = WLF(C1=17.44, C2=51.6, reference=25.0).factor(60.0)
    # The rounding of ln aT = -16.2 counts as many times in aT.
    assert factor == pytest.approx(10 ** (-17.44 * 35 / 86.6), rel=20 * np.finfo(float).eps)
    slowed = [measured(kind, KNOWN, rows=20).slowed(factor) for kind in RANGE]
    faster = Prony(1.0, tuple((G, tau * factor) for G, tau in KNOWN.branches))
    for curve in slowed:
        np.testing.assert_allclose(curve.predicted(faster, curve.abscissa), curve.moduli, rtol=1e-13)


@pytest.mark.parametrize(
    ("temperature", "message"),
    [
        (-30.0, "must be above -26.6"),
        (-26.6, "must be above -26.6"),
        (-26.5, r"shifts times by 8.98e\+03 decades"),
        (float("nan"), "must be above -26.6"),
        (float("inf"), "decades; must be"),
    ],
)
def test_a_temperature_to_which_a_law_cannot_shift_is_refused(data, temperature, message):
    with pytest.raises(FitError, match=message):
        write_fit(data, temperature=temperature, held=WLF(C1=17.44, C2=51.6, reference=25.0))


@pytest.fixture
def data(tmp_path, monkeypatch):
    """A file with a master curve in units of 2e6, in the working folder."""
    monkeypatch.chdir(tmp_path)
    curve = measured(MasterCurve, KNOWN, rows=40).in_units_of(0.5e-6)
    np.savetxt("rubber 1.csv", np.column_stack([curve.abscissa, *curve.moduli]), header="omega G' G''")
    return Path("rubber 1.csv")


def test_the_material_written_can_be_loaded_and_run(data):
    shift = WLF(C1=17.44, C2=51.6, reference=25.0)
    report = write_fit(data, normalise=True, temperature=30.0, held=shift)
    read_back = load("rubber 1.yaml", ["grid.points=32", "time.end=0.03", "time.step=0.01"])
    assert read_back.name == "rubber-1"
    assert isinstance(read_back.layer.material, Prony)
    material = read_back.layer.material
    assert material.relaxed == 1
    # The search's tolerance as above, and seven digits.
    np.testing.assert_allclose(material.branch_times, KNOWN.branch_times * shift.factor(30.0), rtol=1e-4)
    np.testing.assert_allclose(material.branch_moduli, KNOWN.branch_moduli, rtol=1e-4)
    recording = Recording()
    simulate(read_back, recording)
    assert recording.count == 4
    assert recording.last("mean_pressure") > 0
    notes = [line for line in Path("rubber 1.yaml").read_text().splitlines() if line.startswith("#")]
    assert notes[0] == "# Prony series of 4 branches, fitted to the master curve 'rubber 1.csv' of 40 rows."
    assert "from reference 25 with C1 = 17.44, C2 = 51.6; times multiplied by aT = 0.02879" in notes[3]
    assert notes[4] == "# Moduli are in units of G0 = 2e+06 of the data, times in the unit of the data."
    assert all(note[2:] in report for note in notes)
    assert "warning" not in report
    assert Path("rubber 1.png").read_bytes().startswith(b"\x89PNG")


@KINDS
def test_the_figure_shows_the_data_the_fit_and_the_error(kind):
    fitted = fit(measured(kind, KNOWN, noise=0.02))
    curve = fitted.measurement
    above, below = fit_figure(fitted).axes
    shown = [np.asarray(line.get_ydata()) for line in above.lines]
    smooth = np.log(np.asarray(above.lines[1].get_xdata()))
    for i, modulus in enumerate(curve.moduli):
        np.testing.assert_array_equal(shown[2 * i], modulus)
        line = np.interp(np.log(curve.abscissa), smooth, shown[2 * i + 1])
        # The line is drawn through 500 points, 0.032 apart in the logarithm, whose square bounds the sag.
        np.testing.assert_allclose(line, curve.predicted(fitted.material, curve.abscissa)[i], rtol=2e-3)
        np.testing.assert_allclose(np.asarray(below.lines[i].get_ydata()), 100 * fitted.errors[i])
    assert above.get_xscale() == above.get_yscale() == below.get_xscale() == "log"


def test_the_axes_have_the_units_in_the_names_of_the_columns(tmp_path):
    path, rows = tmp_path / "curve.csv", "".join(f"{2.0**i},{1 + i},{1 + i}\n" for i in range(12))
    for header, units in (("f [Hz], E' [kPa], E'' [kPa]", ("rad/s", "kPa")), ("omega,G',G''", ("", ""))):
        path.write_text(f"{header}\n{rows}")
        above, below = fit_figure(fit(read(path), branches=1)).axes
        labels = above.get_ylabel(), below.get_xlabel()
        ends = [f" ({unit})" if unit else "" for unit in units]
        assert labels == (f"$G'$, $G''${ends[1]}", rf"$\omega${ends[0]}")


def test_the_summary_warns_about_extrapolated_moduli(tmp_path, data):
    curve = fractional_zener(MasterCurve, np.geomspace(0.03, 3, 41), 0.5)
    lowest, highest = curve.moduli[0, [0, -1]]
    np.savetxt(data, np.column_stack([curve.abscissa, *curve.moduli]))
    report = write_fit(data, tmp_path)
    assert f"is extrapolated: the lowest measured modulus is {lowest:.4g}" in report
    assert f"is extrapolated: the highest measured modulus is {highest:.4g}" in report


def test_rows_crowded_at_one_end_are_pointed_out(data):
    t = np.linspace(1e-3, 100, 1000)
    np.savetxt(data, np.column_stack([t, KNOWN.relaxation_modulus(t)]))
    assert "and dominate the fit" in write_fit(data)


@pytest.mark.parametrize("existing", ["rubber 1.yaml", "rubber 1.png"])
def test_nothing_is_overwritten_unless_forced(data, existing):
    Path(existing).write_text("precious")
    with pytest.raises(ResultsError, match=f"{existing}: exists; .*--force"):
        write_fit(data)
    assert sorted(path.name for path in Path().iterdir()) == sorted([data.name, existing])
    assert Path(existing).read_text() == "precious"
    write_fit(data, force=True)
    assert not Path(existing).read_bytes().startswith(b"precious")


def test_the_data_are_never_overwritten(data):
    data = data.rename("rubber.yaml")
    with pytest.raises(ResultsError, match=r"rubber.yaml: is the data; choose another --out"):
        write_fit(data, force=True)


@pytest.mark.parametrize(
    ("out", "material"),
    [
        ("new/folder", "new/folder/rubber 1.yaml"),
        ("new/soft.yml", "new/soft.yml"),
        ("v1.2", "v1.2/rubber 1.yaml"),
    ],
)
def test_the_material_goes_to_the_file_or_folder_that_is_asked_for_in_the_unit_of_the_data(
    data, out, material
):
    report = write_fit(data, Path(out))
    warning = "warning: the moduli are in the unit of the data (G0 = 2e+06); give halfspace.shear_modulus"
    assert warning in report
    assert report.splitlines()[-2:] == [
        f"material: {material}",
        f"figure: {Path(material).with_suffix('.png')}",
    ]
    assert load(material).layer.material.model == "prony"


def test_the_command_line_fits_with_its_options(data, capsys):
    shift = ["--temperature", "30", "--reference", "25", "--wlf", "17.44", "51.6"]
    arguments = [
        *("fit-material", str(data), "--out", "out.yaml", "--branches", "2", "--normalise"),
        *("--relaxed-modulus", "1.9e6", "--force", *shift),
    ]
    assert cli.main(arguments) == 0
    assert "in units of G0 = 1.9e+06" in capsys.readouterr().out
    written = load("out.yaml").layer.material
    assert isinstance(written, Prony)
    assert (written.G0, len(written.branches)) == (1, 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (lambda _: ["absent.csv"], "absent.csv: cannot be read"),
        (lambda data: [data, "--branches", "0"], "got 0 branches; must be 1 to 39 for 40 rows"),
        (lambda data: [data, "--wlf", "17", "51"], "--wlf: needs --reference"),
        (lambda data: [data, "--temperature", "30"], "--temperature: needs --reference and --wlf"),
        (lambda data: [data, "--wlf", "17", "51", "--reference", "5"], "also needs --temperature"),
        (lambda data: [data, "--out", data], "cannot be written"),
        (lambda data: [data, "--temperature", "0", "--reference", "60", "--wlf", "17", "51"],
         "--temperature: got 0, where the wlf law has no value; must be above 9 degrees Celsius"),
    ],
)  # fmt: skip
def test_the_command_line_refuses_in_a_line(data, arguments, message, capsys):
    assert cli.main(["fit-material", *arguments(str(data))]) == 2
    error = capsys.readouterr().err
    assert error.startswith("gfmdlayer: ")
    assert message in error
    assert error.count("\n") == 1
    assert list(Path().iterdir()) == [data]


@pytest.mark.parametrize("heading", ["omega [Hz]", "frequency [1/s]"])
def test_the_option_that_a_message_names_settles_the_frequency(heading, tmp_path):
    """What is typed as the refusal says is taken: with Hz a period of 2 pi, with rad/s one of 1."""
    path = tmp_path / "curve.csv"
    rows = [f"{f},1,{0.1 + f}" for f in range(1, 10)]
    path.write_text("\n".join([f"{heading},G' [Pa],G'' [Pa]", *rows]))
    with pytest.raises(TableError, match="--units frequency=Hz or --units frequency=rad/s"):
        read(path, answers=Answers(key=""))
    for unit, factor in (("Hz", 2 * np.pi), ("rad/s", 1.0)):
        curve = read(path, answers=Answers(units=(("frequency", unit),)))
        assert curve.abscissa[0] == pytest.approx(factor, rel=1e-15)


@pytest.mark.parametrize(
    "heading", ["E_rel", "Erel", "Eh", "Young", "Young modulus", "E-Modul", "elastic modulus"]
)
def test_names_of_youngs_modulus_are_no_shear_moduli(tmp_path, heading):
    path = tmp_path / "a.csv"
    path.write_text(f"t,{heading}\n{ROWS_OF_G}")
    found = read(path, 0.4)
    assert found.moduli[0] == pytest.approx(G_OF_T / 2.8)


def test_poissons_ratio_is_not_ignored_and_columns_without_headings_are_said_to_be_in_shear(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(ROWS_OF_G)
    assert "taken in shear; --modulus E" in " ".join(read(path, answers=Answers(key="")).notes)
    with pytest.raises(TableError, match=r"no headings: its moduli may be in shear, .* --modulus E or G"):
        read(path, 0.4, Answers(key=""))
    assert read(path, 0.4, Answers(modulus="E")).moduli[0] == pytest.approx(G_OF_T / 2.8)
    path.write_text(f"t,something\n{ROWS_OF_G}")
    with pytest.raises(TableError, match="'something' is not read"):
        read(path)
