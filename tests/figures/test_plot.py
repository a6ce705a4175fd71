"""`gfmdlayer.plot` draws what the package returns, and `.plot()` of a result the same."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

import gfmdlayer
from gfmdlayer import ConfigError, ResultsError

HALF, BALL = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=0.25)
SHORT = {"time": {"end": 1.0, "step": 0.25}, "grid": {"points": 128}, "output": {"snapshots": [0.5, 1.0]}}
DEPTH = np.linspace(0.0, 0.1, 30)
CURVE = gfmdlayer.ForceCurve("a", DEPTH, DEPTH, DEPTH**1.5)


def fit():
    return gfmdlayer.fit_indentation(CURVE, {"body": HALF, "punch": BALL}, "layer.material.G")


def below():
    found = gfmdlayer.solve(HALF, BALL, depth=0.01)
    return found.merge(gfmdlayer.inside(found, [0.01, 0.02, 0.03], body=HALF))


DATA = {
    "line": lambda: gfmdlayer.solve(HALF, BALL, depth=0.01),
    "loads": lambda: gfmdlayer.solve(HALF, BALL, mean_pressure=[0.01, 0.02]),
    "surface": lambda: gfmdlayer.solve(HALF, BALL, force=0.01, points=(32, 32)),
    "isolated": lambda: gfmdlayer.solve(HALF, BALL, depth=0.01, points=(32, 32), isolated=True),
    "indent": lambda: gfmdlayer.indent(HALF, BALL, [0, 1], depth=[0, 0.01]),
    "run": lambda: gfmdlayer.run(SHORT),
    "inside": below,
    "body": lambda: gfmdlayer.bonded_layer(0.1, gfmdlayer.Zener()),
    "configuration": lambda: gfmdlayer.Config(name="a"),
    "fit": fit,
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", DATA)
def test_everything_has_a_picture(name, tmp_path):
    data, picture = DATA[name](), tmp_path / "a.png"
    assert isinstance(gfmdlayer.plot(data, out=picture), Figure)
    assert picture.stat().st_size > 4000
    if name in ("line", "loads", "surface", "isolated", "indent", "fit"):
        assert isinstance(data.plot(tmp_path / "b.png"), Figure)
        assert (tmp_path / "b.png").read_bytes() == picture.read_bytes()


def test_curves_of_the_picture_are_the_data():
    found = gfmdlayer.solve(HALF, BALL, depth=[0.005, 0.01])
    displacement, pressure = gfmdlayer.plot(found).axes[:2]
    for i in range(2):
        part = found.isel(depth=i)
        near = part.x.isin(displacement.lines[0].get_xdata())
        assert any(np.array_equal(line.get_ydata(), part.pressure[near]) for line in pressure.lines)
        assert any(np.array_equal(line.get_ydata(), part.displacement[near]) for line in displacement.lines)


@pytest.mark.filterwarnings("ignore")
def test_the_kinds_of_results_are_those_of_the_command(tmp_path):
    data = gfmdlayer.run(SHORT, out=tmp_path / "results")
    for kind in ("curves", "loop", "snapshots", "waterfall"):
        of_data, of_folder = (gfmdlayer.plot(each, kind) for each in (data.load(), tmp_path / "results"))
        assert [axes.get_ylabel() for axes in of_data.axes] == [axes.get_ylabel() for axes in of_folder.axes]
    data.close()
    with pytest.raises(ResultsError, match="no slip"):
        gfmdlayer.plot(tmp_path / "results", "stick")
    with pytest.raises(ResultsError, match="there is no snapshot"):
        gfmdlayer.plot(gfmdlayer.run(SHORT | {"output": {}}), "snapshots")


def test_data_of_a_contact_keep_the_plots_of_xarray():
    found = gfmdlayer.solve(HALF, BALL, depth=0.01)
    found.plot.scatter(x="x", y="pressure")
    plt.close("all")
    assert type(found.isel(x=slice(0, 10))).__name__ == "ContactData"
    with pytest.raises(ConfigError, match="data: got a dataset of force; must be one of run, solve"):
        gfmdlayer.plot(found[["force"]])
    with pytest.raises(ConfigError, match="got stresses without the contact above them; must have both"):
        gfmdlayer.plot(gfmdlayer.inside(found, [0.01], body=HALF))
