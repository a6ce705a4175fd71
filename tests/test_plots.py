"""Figures: labelled by symbols, one curve a case, written in the format asked for."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from gfmdlayer.results.plot_style import colours, value_labels
from gfmdlayer.results.plots import curves_figure, plot_results
from gfmdlayer.results.reader import case_path, open_case, open_results
from gfmdlayer.results.schema import ResultsError
from gfmdlayer.results.snapshot_plots import snapshots_figure
from gfmdlayer.results.sweep_file import CaseRecord, collect
from gfmdlayer.results.writer import CaseWriter

X = np.linspace(-0.5, 0.5, 64, endpoint=False)
THICKNESSES = [0, 1 / 32, 1 / 16, float("inf")]


def write_case(path: Path, *, snapshots: bool = True, about: Mapping[str, float] | None = None) -> None:
    with CaseWriter(path, {"x": X}, {"name": "demo", **({"tau": 2.0} if about is None else about)}) as case:
        for time in (0.0, 1.0, 4.0):
            case.row(time=time, contact_area=0.1 * time, mean_pressure=0.2 * time)
            if snapshots and time > 0:
                case.snapshot(time, -np.maximum(0, 0.01 - X**2), np.maximum(0, 0.01 - X**2))


def write_sweep(folder: Path, swept: Mapping[str, Sequence[object]]) -> None:
    records = []
    for index, values in enumerate(itertools.product(*swept.values())):
        write_case(case_path(folder, index))
        records.append(CaseRecord(index, case_path(folder, index), dict(zip(swept, values, strict=True))))
    collect(folder, records, list(swept))


def test_curves_are_labelled_by_symbols(tmp_path: Path) -> None:
    write_sweep(tmp_path, {"layer.thickness": THICKNESSES})
    with open_results(tmp_path) as data:
        figure = curves_figure(data)
    area, pressure = figure.axes
    assert (area.get_xlabel(), area.get_ylabel()) == (r"$t/\tau$", r"$\tilde{a}$")
    assert (pressure.get_xlabel(), pressure.get_ylabel()) == (r"$t/\tau$", r"$\tilde{p}$")
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["(a)", "(b)"]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["$d$ = 0", "$d$ = 1/32", "$d$ = 1/16", r"$d$ = $\infty$"]
    for axes, scale in ((area, 0.1), (pressure, 0.2)):
        assert len(axes.lines) == 4
        np.testing.assert_array_equal(axes.lines[0].get_xdata(), [0.0, 0.5, 2.0])
        np.testing.assert_array_equal(axes.lines[0].get_ydata(), scale * np.array([0.0, 1.0, 4.0]))


def test_two_keys_are_told_by_colour_and_line_style(tmp_path: Path) -> None:
    write_sweep(tmp_path, {"layer.thickness": [0.1, 0.2], "halfspace.shear_modulus": [0.1, 10.0, 1e5]})
    with open_results(tmp_path) as data:
        figure = curves_figure(data, columns=1)
    lines = figure.axes[0].lines
    assert [line.get_color() for line in lines] == [c for c in colours(2) for _ in range(3)]
    assert [line.get_linestyle() for line in lines[:3]] == [line.get_linestyle() for line in lines[3:]]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    bulk = [r"$G_\mathrm{bulk}$ = 0.1", r"$G_\mathrm{bulk}$ = 10", r"$G_\mathrm{bulk}$ = $10^{5}$"]
    assert labels == ["$d$ = 0.1", "$d$ = 0.2", *bulk]


def test_three_keys_are_refused(tmp_path: Path) -> None:
    write_sweep(tmp_path, {"a.b": [1, 2], "a.c": [1, 2], "a.d": [1]})
    with pytest.raises(ResultsError, match=r"3 keys \(b, c, d\): at most 2"):
        plot_results(tmp_path)
    assert list(tmp_path.glob("*.png")) == []


def test_list_of_combinations_names_every_value_in_the_order_swept(tmp_path: Path) -> None:
    keys = ["layer.thickness", "layer.material.Ginf"]
    pairs = [(0.1, 10.0), (0.2, 5.0)]
    for index in range(2):
        write_case(case_path(tmp_path, index))
    records = [
        CaseRecord(i, case_path(tmp_path, i), dict(zip(keys, p, strict=True))) for i, p in enumerate(pairs)
    ]
    collect(tmp_path, records, keys)
    with open_results(tmp_path) as data:
        labels = [text.get_text() for text in curves_figure(data).legends[0].get_texts()]
    assert labels == [r"$d$ = 0.1, $G_\infty$ = 10", r"$d$ = 0.2, $G_\infty$ = 5"]


def test_time_is_not_scaled_without_a_common_relaxation_time(tmp_path: Path) -> None:
    write_case(tmp_path / "0000.h5", about={})
    with open_case(tmp_path / "0000.h5") as data:
        figure = curves_figure(data)
    assert figure.axes[0].get_xlabel() == "$t$"
    assert figure.axes[0].get_xlim() == (0.0, 4.0)
    assert figure.legends == []


def test_pictures_are_named_after_the_results(tmp_path: Path) -> None:
    write_sweep(tmp_path, {"layer.thickness": THICKNESSES})
    assert plot_results(tmp_path) == tmp_path / "demo.png"
    assert {path.name for path in tmp_path.glob("*.png")} == {"demo.png", "demo-snapshots.png"}


@pytest.mark.parametrize(("suffix", "start"), [("pdf", b"%PDF"), ("svg", b"<?xml"), ("png", b"\x89PNG")])
def test_suffix_chooses_the_format(tmp_path: Path, suffix: str, start: bytes) -> None:
    write_case(case_path(tmp_path, 0), snapshots=False)
    picture = plot_results(tmp_path, tmp_path / f"figure.{suffix}")
    assert picture.read_bytes().startswith(start)
    assert not (tmp_path / f"figure-snapshots.{suffix}").exists()


def test_pictures_that_cannot_be_written_are_refused(tmp_path: Path) -> None:
    write_case(case_path(tmp_path, 0))
    with pytest.raises(ResultsError, match=r"'\.bmp'; use \.png, \.pdf, \.svg"):
        plot_results(tmp_path, tmp_path / "figure.bmp")
    with pytest.raises(ResultsError, match="cannot be written"):
        plot_results(tmp_path, tmp_path / "nowhere" / "figure.png")
    with pytest.raises(ResultsError, match="no such folder"):
        plot_results(tmp_path / "nowhere")


def test_snapshots_show_the_contact_zoomed(tmp_path: Path) -> None:
    write_case(tmp_path / "0000.h5")
    with open_case(tmp_path / "0000.h5") as data:
        figure = snapshots_figure({"$d$ = 0": data})
    surface, pressure = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == ["$u$", "$p$"]
    assert surface.get_title(loc="left") == "$d$ = 0"
    assert len(surface.lines) == len(pressure.lines) == 2
    # The contact is |x| < 0.1; half its width on either side and a few cells make less than 0.3.
    assert -0.3 < surface.get_xlim()[0] < -0.1
    assert 0.1 < surface.get_xlim()[1] < 0.3
    assert [t.get_text() for t in figure.legends[0].get_texts()] == [r"$t/\tau$ = 0.5", r"$t/\tau$ = 2"]


def test_snapshots_of_a_surface_are_maps(tmp_path: Path) -> None:
    field = np.maximum(0, 0.04 - X[:, None] ** 2 - (X[None, ::2]) ** 2)
    with CaseWriter(tmp_path / "0000.h5", {"x": X, "y": X[::2]}, {"tau": 1.0}) as case:
        case.snapshot(1.0, -field, field)
    with open_case(tmp_path / "0000.h5") as data:
        figure = snapshots_figure({"": data})
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("$x$", "$y$")
    (mesh,) = figure.axes[0].collections
    np.testing.assert_array_equal(np.asarray(mesh.get_array()), field.T)


def test_one_case_of_a_sweep_can_be_chosen(tmp_path: Path) -> None:
    write_sweep(tmp_path, {"layer.thickness": THICKNESSES})
    plot_results(tmp_path, case=3)
    with pytest.raises(ResultsError, match="no complete case 0007"):
        plot_results(tmp_path, case=7)


@pytest.mark.parametrize(
    ("values", "labels"),
    [
        ([0, 0.03125, float("inf")], ["0", "1/32", r"$\infty$"]),
        ([0.25, 0.5], ["0.25", "0.5"]),
        ([0.05, 0.03125], ["0.05", "0.03125"]),
        ([1 / 3, 2 / 3], ["1/3", "2/3"]),
        ([16384, 65536], ["16384", "65536"]),
        ([1e-3, 1e5, 2.5e6], ["0.001", "$10^{5}$", r"$2.5\times 10^{6}$"]),
        (["fire", "active_set"], ["fire", "active_set"]),
    ],
)
def test_values_are_written_as_a_reader_would(values: list[object], labels: list[str]) -> None:
    assert value_labels(values) == labels


def test_colours_lighten_when_printed_grey() -> None:
    grey = [np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) for colour in colours(6)]
    # Six steps over a range of 0.6, none less than half the mean step; the lightest is dark enough on white.
    assert np.diff(grey).min() > 0.05
    assert grey[-1] < 0.75


def test_settings_of_matplotlib_are_left_as_they_were(tmp_path: Path) -> None:
    write_case(case_path(tmp_path, 0))
    before = dict(mpl.rcParams)
    plot_results(tmp_path)
    assert dict(mpl.rcParams) == before
