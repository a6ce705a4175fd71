"""Pictures that someone who has not made them can read: labels apart, no line where there is no curve."""

import itertools
import warnings
from functools import cache

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.figures.curve_family import ColourBar
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.labels import Quantity
from gfmdlayer.figures.plot_style import new_figure

WARM = {"law": "wlf", "C1": 4.57, "C2": 113.6, "reference": 25.0}
ROLLING = {
    "units": {"length": "mm", "stress": "MPa", "time": "s"},
    "grid": {"points": 32, "period": 20.0},
    "layer": {"thickness": 2.0, "material": {"G0": 1.0, "Ginf": 3.0, "tau": 0.1, "shift": WARM}},
    "halfspace": {"shear_modulus": float("inf")},
    "punch": {"shape": "parabola", "radius": 10.0},
    "temperature": {"value": 25.0},
    "trajectory": {"control": "load", "load": 0.02, "ramp_time": 0.1, "velocity": 10.0},
    "time": {"end": 0.4, "step": 0.1},
}


@cache
def swept(**sweep):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return gfmdlayer.run(
            ROLLING, sweep={key.replace("__", "."): list(each) for key, each in sweep.items()}
        )


def test_a_temperature_that_only_repeats_the_swept_one_has_no_panel():
    figure = curves_figure(swept(temperature__value=(0.0, 25.0)))
    assert not any("temperature" in axes.get_ylabel() for axes in figure.axes)
    asked = curves_figure(swept(temperature__value=(0.0, 25.0)), y=["temperature"])
    assert any("temperature" in axes.get_ylabel() for axes in asked.axes)


def test_labels_of_neighbouring_panels_do_not_meet():
    figure = curves_figure(swept(trajectory__velocity=(5.0, 10.0)), x="velocity")
    figure.draw_without_rendering()
    boxes = sorted((axes.xaxis.label.get_window_extent() for axes in figure.axes), key=lambda box: box.x0)
    assert len(boxes) == 3
    for left, right in itertools.pairwise(boxes):
        assert left.x1 < right.x0
    assert boxes[-1].x1 <= figure.bbox.x1


@pytest.mark.parametrize("height", [20.0, 40.0, 120.0])
def test_the_numbers_at_a_short_colour_bar_do_not_meet(height):
    figure = new_figure(2, height)
    ColourBar.of([0.0, *np.geomspace(1e-3, 60.0, 20)], Quantity("time")).draw(figure, [figure.subplots()])
    figure.draw_without_rendering()
    bar = figure.axes[-1]
    boxes = [label.get_window_extent() for label in bar.get_yticklabels()]
    assert len(boxes) >= 2
    assert all(low.y1 <= high.y0 for low, high in itertools.pairwise(boxes))


def test_samples_are_points_and_zipped_keys_a_curve():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        zipped, sampled = (
            gfmdlayer.run(
                ROLLING, sweep={"zip": {"layer.thickness": [1.0, 2.0, 3.0], "trajectory.load": loads}}
            )
            for loads in ([0.01, 0.02, 0.03], [0.02, 0.01, 0.03])
        )
    assert curves_figure(zipped, x="thickness", y=["force"]).axes[0].lines
    assert not curves_figure(sampled, x="thickness", y=["force"]).axes[0].lines


def test_friction_over_the_reduced_velocity_has_the_shift_factor_of_each_temperature():
    data = swept(temperature__value=(0.0, 25.0), trajectory__velocity=(5.0, 10.0))
    (axes,) = curves_figure(data, x="reduced_velocity", y=["friction"]).axes
    assert axes.get_xscale() == "log"
    assert "reduced velocity" in axes.get_xlabel()
    for T, line in zip((0.0, 25.0), axes.lines, strict=True):
        factor = 10 ** (-4.57 * (T - 25.0) / (113.6 + T - 25.0))
        np.testing.assert_allclose(line.get_xdata(), factor * np.array([5.0, 10.0]))
        np.testing.assert_allclose(line.get_ydata(), data.friction.sel({"temperature.value": T})[:, -1])
    with pytest.raises(gfmdlayer.ResultsError, match=r"must have a sweep over trajectory.velocity"):
        curves_figure(swept(temperature__value=(0.0, 25.0)), x="reduced_velocity")
