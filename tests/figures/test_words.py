"""Axes say in words what they show, long words in lines; symbols alone where they are asked for."""

import numpy as np
import pytest
import xarray

from gfmdlayer.cli import main
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.labels import labelled, words_of
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.observables import INDENTATION, known_columns, known_numbers
from gfmdlayer.results.names import VARIABLES, ResultsError, described_key

LONGEST = 50  # letters: two lines of an axis of 44 mm


def case(**columns):
    """One case of a few rows, in the units of the paper."""
    time = ("time", np.linspace(0.0, 1.0, 5), {"units": "time", "long_name": "time"})
    data = {name: ("time", values, known_columns()[name].described) for name, values in columns.items()}
    return xarray.Dataset(data, {"time": time}, {"L": 1.0, "G0": 1.0, "tau": 1.0})


def test_axes_have_words_with_the_symbol_behind_or_the_symbol_alone():
    rising = np.linspace(0.0, 0.2, 5)
    drawn = case(contact_area_interpolated=rising, mean_pressure=rising)
    first, second = curves_figure(drawn).axes
    assert first.get_xlabel() == r"time $t/\tau$"
    assert first.get_ylabel().replace("\n", " ") == r"contact area / nominal area $\tilde{a}$"
    assert second.get_ylabel() == r"mean pressure $\tilde{p}$"
    with labelled("symbols"):
        assert curves_figure(drawn).axes[0].get_ylabel() == r"$\tilde{a}$"


def test_every_column_has_words_that_an_axis_holds():
    columns = [*known_columns().values(), *known_numbers().values(), *INDENTATION, *VARIABLES.values()]
    for column in columns:
        array = xarray.DataArray(0.0, name=column.name, attrs=column.described)
        words = words_of(array)
        assert len(words) <= LONGEST, words
        assert words or column.symbol


def test_a_column_that_does_not_vary_has_a_note_in_place_of_a_panel():
    figure = curves_figure(case(contact_area_interpolated=np.linspace(0, 0.2, 5), friction=np.full(5, 0.3)))
    assert len(figure.axes) == 1
    assert r"constant: $\mu$ = 0.3" in figure.get_supxlabel()


def test_colours_of_a_map_are_logarithmic_where_asked():
    keys = {"layer.thickness": [0.1, 0.2], "punch.radius": [1.0, 2.0]}
    coordinates = {
        key.rpartition(".")[2]: (key.rpartition(".")[2], values, described_key(key, str))
        for key, values in keys.items()
    }
    values = np.array([[1.0, 2.0], [3.0, 4.0]])[..., np.newaxis] * np.ones(2)
    sweep = xarray.Dataset(
        {"force": (("thickness", "radius", "time"), values, {"units": "force", "long_name": "force"})},
        coordinates | {"time": [0.0, 1.0], "case": (("thickness", "radius"), np.arange(4).reshape(2, 2))},
        {"swept": " ".join(keys)},
    )
    mesh = map_figure(sweep, z=["force"], log=["z"]).axes[0].collections[0]
    assert type(mesh.norm).__name__ == "LogNorm"
    assert type(map_figure(sweep, z=["force"]).axes[0].collections[0].norm).__name__ == "Normalize"
    with pytest.raises(ResultsError, match=r"log z: .* has no positive value"):
        map_figure(sweep.assign(force=-sweep["force"]), z=["force"], log=["z"])


def test_columns_are_listed_with_unit_and_meaning(tmp_path, capsys):
    (tmp_path / "a.yaml").write_text("name: a\ngrid: {points: 64}\ntime: {end: 0.1, step: 0.05}\n")
    assert main(["run", str(tmp_path / "a.yaml"), "--out", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    assert main(["plot", str(tmp_path / "out"), "--columns"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert any(
        line.split(maxsplit=2) == ["depth", "length", "indentation depth of the punch"] for line in lines
    )
    assert not list((tmp_path / "out").glob("*.png"))
