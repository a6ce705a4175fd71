"""Pictures of stresses below the surface: sections, interfaces, maps, and the page of a case."""

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.figures import curves_figure
from gfmdlayer.figures.field_plots import inside_figure
from gfmdlayer.figures.labels import labelled
from gfmdlayer.figures.plot_style import highest_row
from gfmdlayer.figures.plots import plot_results
from gfmdlayer.figures.report.page import Listed, payload
from gfmdlayer.results.names import ResultsError

RUN = {
    "layer": {"thickness": 0.03, "poisson": 0.3}, "halfspace": {"shear_modulus": 0.2, "poisson": 0.4},
    "time": {"end": 0.4, "step": 0.2}, "trajectory": {"depth": 0.01, "ramp_time": 0.2},
    "output": {"snapshots": [0.2, 0.4], "inside": {"points": 4, "times": [0.4]}},
}  # fmt: skip


def text_of(axes):
    return " ".join([axes.get_xlabel(), axes.get_ylabel(), axes.get_title(loc="right")])


@pytest.fixture(autouse=True)
def symbols():
    """Axes by their symbols alone; words before them have tests of their own."""
    with labelled("symbols"):
        yield


def test_the_section_of_a_line_has_depth_downward_and_the_interface_at_its_depth():
    figure = inside_figure(gfmdlayer.run(RUN, grid={"points": 128}))
    axes = figure.axes[0]
    low, high = axes.get_ylim()
    assert low > high == 0.0
    assert "z" in text_of(axes)
    assert "0.4" in text_of(axes)  # only the snapshot with fields
    lines = [line.get_ydata() for line in axes.lines]
    assert any(np.allclose(y, 0.03) for y in lines)
    labels = [each.get_ylabel() for each in [*figure.axes, *axes.child_axes]]
    assert any("Mises" in each for each in labels)
    assert [each.get_text() for each in figure.legends[0].get_texts()] == ["contact"]
    assert (
        "shear stress"
        in inside_figure(gfmdlayer.run(RUN, grid={"points": 64}), "largest_shear").get_supxlabel()
    )
    assert "von Mises stress" in figure.get_supxlabel()  # the caption explains the symbol


def test_the_section_of_a_sliding_punch_has_its_largest_stress_at_the_surface():
    more = {"interface": {"law": "coulomb", "coefficient": 0.8}}
    more |= {"trajectory": RUN["trajectory"] | {"velocity": 0.1}}
    data = gfmdlayer.run(RUN | more, grid={"points": 256})
    figure = inside_figure(data, "largest_shear")
    assert "shear stress" in figure.get_supxlabel()
    drawn = gfmdlayer.inside(data, data.z.to_numpy()[[0, 1, 2, 3]]).largest_shear.isel(snapshot=-1)
    assert int(drawn.max("x").argmax("z")) == 0


def test_each_interface_has_curves_of_its_own():
    run = {key: RUN[key] for key in ("halfspace", "time", "trajectory")} | {"layers": [RUN["layer"]] * 2}
    data = gfmdlayer.run(run, grid={"points": 64}, output={"inside": {"points": 2, "every": 2}})
    figure = curves_figure(data, y=["interface_peel"])
    labels = [axes.get_ylabel().partition(" $")[0] for axes in figure.axes]
    assert labels == ["interface peel 0", "interface peel 1"]
    for i, axes in enumerate(figure.axes):
        drawn, known = (
            axes.lines[0].get_ydata(),
            data.interface_peel.isel(interface=i).dropna("time").to_numpy(),
        )
        assert known.size == 2  # of three rows
        np.testing.assert_allclose(drawn / np.ptp(drawn), known / np.ptp(known), rtol=1e-12)


def test_a_surface_has_maps_of_peel_and_shear_at_each_interface():
    data = gfmdlayer.run(RUN, grid={"points": [32, 32]})
    figure = inside_figure(data, "stress_xz")
    images = [axes for axes in figure.axes if axes.images]
    assert len(images) == 2
    fields = gfmdlayer.inside(data, [0.03]).isel(z=0, snapshot=1)
    for axes, name in zip(images, ("stress_zz", "shear_on_plane"), strict=True):
        known = fields[name].transpose("y", "x").to_numpy()
        np.testing.assert_allclose(axes.images[0].get_array(), known, atol=1e-6 * np.abs(known).max())


def test_what_cannot_be_drawn_is_refused(tmp_path):
    data = gfmdlayer.run(RUN, grid={"points": 64})
    with pytest.raises(
        ResultsError, match=r"no field von_mise; must be one of .*; did you mean 'von_mises'\?$"
    ):
        inside_figure(data, "von_mise")
    gfmdlayer.run(RUN, grid={"points": 64}, out=tmp_path / "run", **{"output.inside": None})
    with pytest.raises(ResultsError, match=r"no fields below the surface; set output\.inside"):
        plot_results(tmp_path / "run", kind="inside")


def test_the_page_of_a_case_has_the_section(tmp_path):
    data = gfmdlayer.run(RUN, grid={"points": [32, 32]}, out=tmp_path / "run").load()
    found = payload([Listed(0, tmp_path / "run" / "cases" / "0000.h5", {})])
    surface = found["cases"][0]["surface"]
    assert "Mises" in found["fields"]["von_mises"]
    from base64 import b64decode

    values = np.frombuffer(b64decode(surface["inside"]["von_mises"]), "<f4").reshape(2, data.z.size, 32)
    assert np.isnan(values[0]).all()
    middle = int(data.pressure.isel(snapshot=-1).max("x").argmax("y"))
    known = data.von_mises.isel(snapshot=1, y=middle).to_numpy()
    np.testing.assert_allclose(values[1] / values[1].max(), known / known.max(), rtol=1e-5, atol=1e-6)


def test_a_cut_goes_through_the_middle_of_a_plateau_of_the_pressure():
    """Where surfaces yield many rows have the largest pressure, the hardness."""
    pressure = np.zeros((9, 12))
    pressure[2:7, 3:10] = 0.5 * (1 - 1e-13)
    pressure[3, 3] = 0.5
    assert highest_row(pressure) == 6
    pressure[4, 8] = 0.6
    assert highest_row(pressure) == 8
    assert highest_row(pressure - 1.0) == 8  # an attraction pulls everywhere
