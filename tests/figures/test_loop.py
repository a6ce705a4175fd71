"""Force against depth with its areas, and numbers of whole cases against swept keys."""

import numpy as np
import pytest
from scipy.integrate import trapezoid

import gfmdlayer
from gfmdlayer.figures.curve_plots import curves_figure, loop_figure
from gfmdlayer.figures.labels import value_labels
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.figures.plots import plot_results
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import open_case, open_results

KEYS = {
    "name": "pull", "grid": {"points": 128}, "layer": {"thickness": 0},
    "interface": {"law": "exponential", "work": 2e-3, "range": 1e-2},
    "trajectory": {"kind": "approach_retract", "depth": 0.002, "start": -0.03, "approach_speed": 0.02},
    "time": {"step": 0.1, "integrator": "exponential"},
    "sweep": {"trajectory.retract_speed": [0.013, 0.02], "interface.work": [1e-3, 2e-3]},
}  # fmt: skip


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loop") / "pull"
    gfmdlayer.run(KEYS, out=folder)
    return folder


def texts(figure):
    found = [text for axes in figure.axes for text in (axes.get_title(loc="left"), *_written(axes))]
    return " ".join([*found, *(entry.get_text() for legend in figure.legends for entry in legend.texts)])


def _written(axes):
    return [text.get_text() for text in axes.texts]


def shown(value):
    return f"= {value_labels([float(f'{value:.3g}')])[0]}"


def test_a_loop_shows_the_whole_curve_of_each_case_with_its_area(results):
    sweep = open_results(results).sel(work=2e-3)
    figure = loop_figure(results, sweep)
    curves = figure.axes[0].lines[:2]
    for number, curve in zip((1, 3), curves, strict=True):
        case = open_case(results / "cases" / f"{number:04d}.h5")
        np.testing.assert_array_equal(curve.get_xdata(), case.depth)
        np.testing.assert_array_equal(curve.get_ydata(), case.force)
        assert shown(case.attrs["work_of_separation"]) in texts(figure)
    assert r"$W_\mathrm{sep}$: work of separation per area" in figure.get_supxlabel()


def test_curves_over_depth_and_time_have_all_rows_of_each_case(results):
    """Approach and retraction, though the cases end at other times and share few of them."""
    sweep = open_results(results)
    cases = [open_case(results / "cases" / f"{number:04d}.h5") for number in range(4)]
    for x in ("depth", "time"):
        axes = curves_figure(sweep, x=x, y=["force"]).axes[0]
        for case, curve in zip(cases, axes.lines, strict=True):
            np.testing.assert_array_equal(curve.get_xdata(), case[x])
            np.testing.assert_array_equal(curve.get_ydata(), case.force)
    assert axes.get_xlim() == (0.0, max(float(case.time[-1]) for case in cases))
    depth = np.concatenate([np.sign(np.diff(case.depth)) for case in cases])
    assert {-1, 1} <= {*depth}


def test_columns_against_a_key_are_taken_from_the_rows_of_each_case(results):
    sweep = open_results(results).sel(work=1e-3)
    cases = [open_case(results / "cases" / f"{number:04d}.h5") for number in (0, 2)]
    middle = float(cases[1].time[-1]) + 0.4  # behind the end of the second
    first = cases[0].depth[np.argmin(np.abs(cases[0].time.to_numpy() - middle))]
    expected = {
        "end": [float(case.depth[-1]) for case in cases],
        "max": [float(case.depth.max()) for case in cases],
        middle: [float(first), np.nan],
    }
    for time, wanted in expected.items():
        figure = curves_figure(sweep, x="retract_speed", y=["depth"], time=time)
        np.testing.assert_array_equal(figure.axes[0].lines[0].get_ydata(), wanted)
        assert ("1 case ended before" in figure.get_supxlabel() + texts(figure)) == bool(np.isnan(wanted[1]))


def test_the_legend_of_a_loop_over_two_keys_has_the_looks_of_its_curves(results):
    sweep = open_results(results)
    loop, curves = loop_figure(results, sweep), curves_figure(sweep)
    looks = [
        [
            (entry.get_label(), entry.get_color(), entry.get_linestyle())
            for entry in figure.legends[0].get_lines()
        ]
        for figure in (loop, curves)
    ]
    assert looks[0] == looks[1]
    speeds = {line.get_color() for line in loop.axes[0].lines[:4]}
    assert speeds == {colour for _, colour, _ in looks[0] if colour != "black"}


def test_a_loop_of_an_isolated_contact_has_the_work_of_its_force(results):
    with open_case(results / "cases" / "0001.h5") as case:
        cell, isolated = loop_figure(results, case), loop_figure(results, case.drop_vars("mean_stress"))
    assert r"\int\,\bar{p}" in cell.axes[0].get_title(loc="left")
    assert r"\int\,F" in isolated.axes[0].get_title(loc="left")


def test_a_loop_leaves_out_the_depths_at_which_the_punch_is_away(results):
    case = open_case(results / "cases" / "0000.h5").load()
    away = case.depth < -0.01
    figure = loop_figure(results, case.assign(force=case.force.where(~away, 0.0)))
    low, high = figure.axes[0].get_xlim()
    # Steps of 0.002: the row beside the contact is drawn too, and 5 % of the range as a margin.
    assert float(case.depth.min()) < -0.013 < low < -0.01
    assert high > float(case.depth.max())


def test_numbers_in_a_map_are_those_of_its_colour_bar(results):
    sweep = open_results(results)
    figure = map_figure(sweep, z=["work_of_separation"])
    written = [float(text.get_text()) for text in figure.axes[0].texts]
    expected = np.ravel(sweep.work_of_separation.transpose("work", "retract_speed")) * 1e6
    np.testing.assert_allclose(written, expected, rtol=5e-3)
    assert "10^{-6}" in figure.axes[1].get_ylabel()


def test_the_loop_of_one_case_has_both_areas(results):
    case = open_case(results / "cases" / "0000.h5")
    written = texts(loop_figure(results / "cases" / "0000.h5", case, y="mean_stress"))
    area = trapezoid(case.mean_stress, case.depth)
    # The column is integrated by parabolas: the trapezoids of some thirty steps are within per cents of it.
    done = float(case.work[-1] - case.work[0])
    assert area == pytest.approx(done, abs=0.05 * float(np.ptp(case.work.to_numpy())))
    assert shown(area) in written
    assert shown(case.attrs["work_of_separation"]) in written


def test_numbers_of_cases_are_drawn_against_swept_keys_and_as_maps(results):
    sweep = open_results(results)
    figure = curves_figure(sweep, x="retract_speed", y=["pull_off_force"])
    drawn = np.array([line.get_ydata() for line in figure.axes[0].lines])
    np.testing.assert_array_equal(drawn, sweep.pull_off_force.transpose("work", "retract_speed"))
    figure = map_figure(sweep, z=["work_of_separation"])
    np.testing.assert_array_equal(figure.axes[0].collections[0].get_array().T, sweep.work_of_separation)
    with pytest.raises(ResultsError, match="pull_off_force is one number of each case; give x a swept key"):
        curves_figure(sweep, y=["pull_off_force"])


def test_pictures_of_loops_lie_with_the_results(results):
    assert plot_results(results, kind="loop") == [results / "pull-loop.png"]
    with pytest.raises(ResultsError, match="a loop has one quantity along y, not 2"):
        plot_results(results, kind="loop", y=["force", "depth"])


def test_the_area_under_tension_begins_where_the_punch_turns(results):
    case = open_case(results / "cases" / "0000.h5").load()
    (area, *_) = loop_figure(results, case.assign(force=0.0 * case.force - 1.0)).axes[0].collections
    assert area.get_paths()[0].get_extents().x1 == float(case.depth.max())


def test_the_loops_of_a_sweep_along_the_surface_have_their_work_in_the_legend(tmp_path):
    shaken = {"tangential": {"kind": "oscillation", "displacement": 0.002, "start": 0.2, "period": 0.8}}
    run = {
        "grid": {"points": 64}, "interface": {"law": "coulomb", "coefficient": 0.4},
        "trajectory": {"control": "load", "load": 0.02, "ramp_time": 0.2, **shaken},
        "time": {"end": 1.0, "step": 0.1}, "sweep": {"trajectory.tangential.displacement": [0.001, 0.002]},
    }  # fmt: skip
    gfmdlayer.run(run, out=tmp_path / "shaken")
    sweep = open_results(tmp_path / "shaken")
    figure = loop_figure(tmp_path / "shaken", sweep, y="friction")
    entries = [entry.get_text() for entry in figure.legends[0].get_texts()]
    for i, entry in enumerate(entries):
        case = open_case(tmp_path / "shaken" / "cases" / f"{i:04}.h5").load()
        work = float(trapezoid(case.tangential_force, case.tangential_displacement))
        digits = f"{float(f'{work:.2e}'.partition('e')[0]):g}"  # three, times a power of ten
        assert digits in entry.rpartition("=")[2]
    assert len(entries) == 2


def test_a_curve_of_one_row_is_drawn(tmp_path):
    run = {
        "grid": {"points": 64}, "interface": {"law": "coulomb", "coefficient": 0.4},
        "trajectory": {"control": "load", "load": 0.02, "velocity": 0.1, "creepage": 0.01},
        "time": {"steady": "at_once"}, "output": {"snapshots": "every"},
    }  # fmt: skip
    gfmdlayer.run(run, out=tmp_path / "once")
    (axes, *_) = loop_figure(tmp_path / "once", open_results(tmp_path / "once"), y="friction").axes
    assert any(line.get_xdata().size == 1 for line in axes.lines)
