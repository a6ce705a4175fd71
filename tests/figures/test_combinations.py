"""Pictures of sweeps of laws, of grids of two kinds, with failures, with zero among the values."""

import re

import numpy as np
import pytest
import xarray
from matplotlib.colors import LogNorm

import gfmdlayer
from gfmdlayer.cli import main
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.labels import Ticks, labelled
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.figures.plots import plot_results
from gfmdlayer.results.names import ResultsError
from tests.figures.test_everything import faults, texts
from tests.figures.test_nothing_dropped import case, sweep

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

GIVEN = {"name": "demo", "grid": {"points": 64}, "time": {"end": 1.0, "step": 0.5}}
LAWS = [{"law": "hard_wall"}, {"law": "exponential", "work": 1.0e-4, "range": 0.01}]


def words(figure):
    """The texts of a figure that has been drawn."""
    figure.draw_without_rendering()
    return " ".join(text.get_text() for text in texts(figure))


@pytest.mark.parametrize("inside", [None, {"points": 3, "every": 1}])
def test_a_sweep_of_interfaces_has_the_usual_panels(tmp_path, inside):
    output = {} if inside is None else {"output": {"inside": inside}}
    gfmdlayer.run(GIVEN | output, sweep={"interface": LAWS}, out=tmp_path)
    with gfmdlayer.open_results(tmp_path) as data:
        figure = curves_figure(data)
    assert [len(axes.lines) for axes in figure.axes] == [2, 2]
    assert "hard_wall" in words(figure)
    assert "exponential" in words(figure)
    if inside is not None:
        with gfmdlayer.open_results(tmp_path) as data:
            shown = words(curves_figure(data, y=["interface_peel_0"]))
            assert "largest tension, interface" in shown.replace("\n", " ")


def test_all_failed_cases_are_refused_with_the_first_reason(tmp_path, capsys):
    path = tmp_path / "af.yaml"
    path.write_text(
        "name: af\ngrid: {points: 64}\nsolver: {method: fire, max_iterations: 1, tolerance: 1.0e-12}\n"
        "time: {end: 1.0, step: 0.5}\nsweep: {layer.thickness: [0.05, 0.1]}\n"
    )
    out = tmp_path / "results"
    assert main(["run", str(path), "--out", str(out)]) == 1
    said = capsys.readouterr().out
    assert "no case is complete; the same command retries the failed ones" in said
    assert "complete cases are in" not in said
    for kind in ((), ("--kind", "loop"), ("--kind", "snapshots")):
        assert main(["plot", str(out), *kind]) == 2
        assert re.search(
            r"no complete case to draw; all 2 failed: 0000: ConvergenceError", capsys.readouterr().err
        )
    with gfmdlayer.open_results(out) as data, pytest.raises(ResultsError, match="2 of 2 cases failed: 0000"):
        curves_figure(data)
    assert main(["plot", str(out), "--kind", "body", "--case", "1"]) == 0  # which needs no results
    assert main(["plot", str(out), "--kind", "body", "--case", "2"]) == 2
    assert "there is no case 2; must be from 0 to 1" in capsys.readouterr().err
    path.write_text(path.read_text().partition("sweep")[0])
    assert main(["run", str(path), "--out", str(tmp_path / "one")]) == 1
    assert main(["plot", str(tmp_path / "one")]) == 2
    assert "no complete case; 0000 failed: ConvergenceError" in capsys.readouterr().err


def test_columns_without_a_value_are_left_out_and_named():
    data = sweep({"layer.thickness": [0.1, 0.2]})
    data["friction"] = data["contact_area"] * np.nan
    with labelled("symbols"):
        figure = curves_figure(data)
    assert [axes.get_ylabel() for axes in figure.axes] == [r"$\tilde{a}$", r"$\tilde{p}$"]
    assert "friction: no value in any row" in figure.get_supxlabel()
    with pytest.raises(ResultsError, match="friction: no value to draw, NaN in every row"):
        curves_figure(data, y=["friction", "contact_area"])
    both = sweep({"layer.thickness": [0.1, 0.2], "punch.radius": [1.0, 2.0]})
    both["friction"] = both["contact_area"] * np.nan
    with pytest.raises(ResultsError, match="friction: no value to draw"):
        map_figure(both, z=["friction"])


def test_contacts_along_a_line_and_on_a_surface_are_drawn_apart(tmp_path):
    given = GIVEN | {"output": {"snapshots": [1.0]}}
    gfmdlayer.run(given, sweep={"grid.points": [64, [16, 16]]}, out=tmp_path)
    plot_results(tmp_path)
    (snapshots,) = tmp_path.glob("*-snapshots.png")
    assert snapshots.name == "demo-snapshots.png"
    for number in (0, 1):
        assert plot_results(tmp_path, tmp_path / f"{number}.png", kind="snapshots", case=number)


def test_friction_under_a_net_pull_is_drawn(tmp_path):
    """The punch pulls all the time while it moves: a friction without a value has left no panel to draw."""
    law = {"law": "exponential", "work": 1e-3, "range": 0.01}
    moved = {"depth": 0.001, "velocity": 0.2}
    pulled = GIVEN | {"interface": law, "trajectory": moved, "time": {"end": 0.5, "step": 0.1}}
    found = gfmdlayer.run(pulled, out=tmp_path)
    assert (found["mean_stress"] < 0).all()
    assert np.isfinite(found["friction"][1:]).all()
    with gfmdlayer.open_results(tmp_path) as data:
        assert [len(axes.lines) for axes in curves_figure(data).axes] == [1, 1, 1]


def test_a_sweep_of_snapshots_has_the_fields_of_each_case(tmp_path):
    given = {"name": "s2", "grid": {"points": 64}, "time": {"end": 2.0, "step": 0.5}}
    gfmdlayer.run(given, sweep={"output.snapshots": [[1], [1, 2]]}, out=tmp_path)
    with gfmdlayer.open_results(tmp_path) as data:
        fields = data["pressure"].load()
    assert [int(np.isfinite(case).all(axis=1).sum()) for case in fields] == [1, 2]
    np.testing.assert_array_equal(fields[0, 0], fields[1, 0])
    assert plot_results(tmp_path, tmp_path / "both.png", kind="snapshots", case=1)


@pytest.mark.parametrize(
    "values",
    [
        [-3.0, -2.0, -0.1],
        [-1, 0],
        [0, 200, 400, 800],
        [0.0, 1.0, 1.0e3],
        [-1.0, 0.0, 10.0, 2e4],
        [200, 400, 800],
        [1e-3, 1.0, 1e3],
    ],
)
def test_swept_numbers_have_distances_along_an_axis(values):
    """A force that grows as the square of the voltage, zero included, is the square in the picture."""
    data = sweep({"interface.voltage": values})
    ends = xarray.DataArray(np.square(np.asarray(values, float)), dims="voltage")
    data["force"] = data["force"] * 0 + ends
    axes = curves_figure(data, x="voltage", y=["force"]).axes[0]
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_xdata(), values)
    np.testing.assert_allclose(line.get_ydata(), np.square(line.get_xdata()))
    assert axes.get_xscale() in ("linear", "log" if min(values) > 0 else "linear")
    dots = sweep({"interface.voltage": values, "punch.radius": values}, listed=True)
    offsets = map_figure(dots, z=["force"]).axes[0].collections[0].get_offsets()
    np.testing.assert_allclose(offsets[:, 0], values)


def test_a_curve_ends_at_its_last_positive_point_on_a_logarithmic_axis():
    """The leak of a seal that closes: no upright line to the edge of the axes, and the note stays."""
    data = sweep({"layer.thickness": [0.1, 0.2]})
    data["force"] = data["force"] * 0 + xarray.DataArray([1e-3, 1e-6, 1e-9, 0.0, 0.0], dims="time")
    figure = curves_figure(data, y=["force", "contact_area"], log=["y"])
    figure.draw_without_rendering()
    for line in figure.axes[0].lines:
        path = line.get_transform().transform_path(line.get_path()).vertices
        seen = path[np.isfinite(path).all(axis=1)]
        assert len(seen) == 3
        assert (np.diff(seen[:, 0]) > 0).all()
    assert "values of force that are not positive are left out" in figure.get_supxlabel()


@pytest.mark.parametrize("spread", [1.5, 500.0, 1e6])  # linear, logarithmic with round ticks, over decades
@pytest.mark.parametrize("unit", ["m", "length"])
def test_numbers_in_the_cells_of_a_map_are_those_of_its_bar(unit, spread):
    data = sweep({"layer.thickness": [0.1, 0.2, 0.4], "punch.radius": [1.0, 2.0, 4.0]})
    values = 2e-9 * np.geomspace(1.0, spread, 9).reshape(3, 3)
    of_cases = xarray.DataArray(values, dims=("thickness", "radius"))
    data["mean_gap"] = (data["force"] * 0 + of_cases).assign_attrs(units=unit)
    figure = map_figure(data, z=["mean_gap"])
    panel, bar = figure.axes
    assert isinstance(panel.collections[0].norm, LogNorm) == (spread > 100)
    figure.draw_without_rendering()
    # A tick of the bar is at its place times the power of ten of its words, as the cells are.
    powers = {"nm": 1e-9, "µm": 1e-6, "mm": 1e-3, "$10^{-9}$": 1e-9, "$10^{-6}$": 1e-6}
    inside = re.search(r"\((.*)\)", bar.get_ylabel())
    factor = powers.get(inside[1].strip(), 1.0) if inside else 1.0
    written = sorted(float(text.get_text()) for text in panel.texts)
    np.testing.assert_allclose(written, sorted(values.ravel() / factor), rtol=6e-3)  # three digits
    formatter = bar.yaxis.get_major_formatter()
    if isinstance(formatter, Ticks):
        low, high = bar.yaxis.get_view_interval()
        places = [place for place in bar.yaxis.get_majorticklocs() if low <= place <= high]
        shown = [float(text) * factor for text in formatter.format_ticks(places)]
        np.testing.assert_allclose(shown, places)
    else:  # powers of ten of the unit itself
        assert factor == 1.0
    assert not list(faults(figure, is_si=unit == "m"))


def test_warnings_stand_below_a_picture_and_stay_on_it():
    long = (
        "time.step = 0.5 is long beside a ramp of 0.5 and the relaxation time 1: the force at the end of the "
    )
    said = f"{long}ramp may be 0.05 of itself too small; use time.step: 0.1, or adaptive"
    said += "\nCOARSE: $3 points\nmore"
    for data in (
        sweep({"layer.thickness": [0.1, 0.2]}, warnings=said),
        sweep({"layer.thickness": [0.1, 0.2]}, warnings=said).isel(thickness=0),
    ):
        figure = curves_figure(data)
        below = figure.get_supxlabel().replace("\n", " ")
        assert "warning: time.step = 0.5 is long beside" in below
        assert "use time.step: 0.1, or adaptive" in below
        assert "2 more warnings" in below
        figure.draw_without_rendering()
        assert not list(faults(figure, is_si=False))


def test_a_single_case_has_its_warnings_too():
    data = case(2).assign(contact_area=("time", [0.0, 1.0])).assign_coords(time=("time", [0.0, 1.0]))
    figure = curves_figure(data.assign_attrs(warnings="COARSE"), y=["contact_area"])
    assert "warning: COARSE" in figure.get_supxlabel()


def test_each_frequency_has_curves_of_its_own_and_distributions_are_refused_by_name():
    asked = {
        "stiffness": {"frequencies": [0.0, 1.0, np.inf]},
        "histograms": {"gap": {"max": 0.1, "bins": 4}},
    }
    asked["stiffness"]["every"] = 2  # NaN in the other rows
    data = gfmdlayer.run(GIVEN, output=asked, time={"end": 1.0, "step": 0.25})
    with labelled("symbols"):
        figure = curves_figure(data, y=["storage_stiffness"])
    for i, axes in enumerate(figure.axes):
        assert axes.get_ylabel().startswith(f"storage stiffness {i}")
        known = data["storage_stiffness"].isel(frequency=i).dropna("time").to_numpy()
        drawn = axes.lines[0].get_ydata()
        assert known.size == 3  # of five rows
        np.testing.assert_allclose(drawn / np.ptp(drawn), known / np.ptp(known), rtol=1e-12)
    assert len(figure.axes) == 3
    assert "storage_stiffness_1: frequency 1" in figure.get_supxlabel()
    with pytest.raises(ResultsError, match="gap_histogram has values along gap_bin, which no curve has"):
        curves_figure(data, y=["gap_histogram"])


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_report_of_a_snapshot_without_contact_is_silent(tmp_path):
    path = {"kind": "approach_retract", "depth": 0.01, "approach_speed": 0.02, "retract_speed": 0.2}
    law = {"law": "coulomb", "coefficient": 0.3}
    given = {"name": "left", "grid": {"points": 64}, "trajectory": path, "interface": law}
    given |= {"time": {"step": 0.05}, "output": {"snapshots": [0.55]}}
    data = gfmdlayer.run(given, out=tmp_path)
    assert np.isnan(data["slip_velocity_x"]).all()
    assert main(["report", str(tmp_path)]) == 0
