"""Pictures of the fluid in a gap, and of columns that only some rows have."""

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.field_plots import flow_figure
from gfmdlayer.results.names import ResultsError

SEAL = {
    "grid": {"points": [32, 32]}, "layer": {"thickness": float("inf")},
    "punch": {"shape": "sinusoid", "amplitude": 0.01, "wavelength": 1.0},
    "trajectory": {"control": "load", "load": 0.02, "ramp_time": 0.1}, "time": {"end": 1.0, "step": 0.1},
    "output": {"snapshots": [0.2, 1.0], "leakage": {"every": 4}},
}  # fmt: skip


def test_each_snapshot_has_a_map_of_the_pressure_and_one_of_the_flow():
    data = gfmdlayer.run(SEAL)
    flow = gfmdlayer.leakage(data, fields=True)
    figure = flow_figure(flow)
    panels = [axes for axes in figure.axes if axes.images]
    assert len(panels) == 4
    for panel, shot in zip(panels, [*range(2), *range(2)], strict=True):
        shown = np.ma.getmaskarray(np.ma.masked_invalid(panel.images[0].get_array()))
        closed = (data.gap[shot] <= 0).to_numpy().T
        assert shown[closed].all()  # contact is left to the black of the panel
        assert not shown.all()
    for panel in panels[2:]:  # streamlines along the drop
        assert panel.collections


def test_a_line_has_no_map_of_the_flow():
    data = gfmdlayer.run(
        {"grid": {"points": 64}, "time": {"end": 1.0, "step": 0.5}, "output": {"snapshots": [1.0]}}
    )
    with pytest.raises(ResultsError, match="a line has none"):
        flow_figure(gfmdlayer.leakage(data, fields=True))


def test_a_column_of_every_nth_row_is_drawn_as_one_line():
    data = gfmdlayer.run(SEAL)
    (line,) = curves_figure(data, y=["flow_xx"]).axes[0].lines
    values = np.asarray(line.get_ydata())
    assert np.isfinite(values).all()
    assert values.size == int(data.flow_xx.notnull().sum()) < data.sizes["time"]
