"""Figures: labelled by symbols, one curve a case, written in the format asked for."""

import itertools
import os

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb, to_rgba
from PIL import Image
from xarray import Dataset

import gfmdlayer
from gfmdlayer.figures import movies
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.labels import labelled, mathtext, value_labels
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.figures.plot_style import CONTACT, PAPER, SCREEN, colours
from gfmdlayer.figures.plots import plot_results
from gfmdlayer.figures.snapshots import OVERLAP, Inset, snapshots_figure, waterfall_figure
from gfmdlayer.results.gathering import CaseRecord, Swept, collect
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import case_path, open_case, open_results
from tests.recordings import case_file, named

X = np.linspace(-0.5, 0.5, 64, endpoint=False)
THICKNESSES = [0, 1 / 32, 1 / 16, float("inf")]


@pytest.fixture(autouse=True)
def symbols():
    """Axes by their symbols alone; words before them have tests of their own."""
    with labelled("symbols"):
        yield


def write_case(path, *, snapshots=True, about=None):
    with case_file(path, {"x": X}, {"name": "demo", **({"tau": 2.0} if about is None else about)}) as case:
        for time in (0.0, 1.0, 4.0):
            case.row(time=time, contact_area_interpolated=0.1 * time, mean_pressure=0.2 * time)
            if snapshots and time > 0:
                pressed = np.maximum(0, 0.01 - X**2)
                case.snapshot(time, named(-pressed, time * pressed, np.maximum(0, X**2 - 0.01)))


@pytest.fixture(scope="module")
def thicknesses(tmp_path_factory):
    """Folder of a sweep over the thickness."""
    folder = tmp_path_factory.mktemp("results")
    write_sweep(folder, {"layer.thickness": THICKNESSES})
    return folder


def write_sweep(folder, swept):
    records = []
    for index, values in enumerate(itertools.product(*swept.values())):
        write_case(case_path(folder, index))
        records.append(CaseRecord(index, case_path(folder, index), dict(zip(swept, values, strict=True))))
    collect(folder, records, Swept(list(swept)))


@pytest.mark.parametrize("columns", [1, 2])
def test_a_punch_that_moves_has_a_panel_of_its_friction(tmp_path, columns):
    friction = [np.nan, -0.1, 0.3]
    with case_file(case_path(tmp_path, 0), {"x": X}, {"name": "demo", "tau": 2.0}) as case:
        for time, each in enumerate(friction):
            more = {"contact_area_interpolated": 0.1 + 0.01 * time, "mean_pressure": 0.2 + 0.01 * time}
            case.row(time=float(time), friction=each, **more)
    with open_case(case_path(tmp_path, 0)) as data:
        figure = curves_figure(data, columns)
    area, _, drawn = figure.axes
    assert (drawn.get_ylabel(), drawn.get_xlabel()) == (r"$\mu$", r"$t/\tau$")
    assert drawn.get_title(loc="left") == "(c)"
    np.testing.assert_array_equal(drawn.lines[0].get_ydata(), friction)
    assert drawn.get_ylim()[0] < -0.1
    assert area.get_ylim()[0] == 0
    assert bool(area.get_xlabel()) == (columns == 2)  # in one column the lowest panel has it


def test_curves_are_labelled_by_symbols(thicknesses):
    with open_results(thicknesses) as data:
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


@pytest.mark.parametrize(
    ("plain", "written"),
    [
        *(("d", "d"), ("G_0", "G_0"), ("g'", "g'"), ("tau", r"\tau"), ("dt", r"\Delta t")),
        *(("G_inf", r"G_\infty"), ("nu_bulk", r"\nu_\mathrm{bulk}"), ("lambda_s", r"\lambda_s")),
    ],
)
def test_symbols_of_the_files_become_mathtext(plain, written):
    assert mathtext(plain) == written


def test_two_keys_differ_by_colour_and_line_style(tmp_path):
    write_sweep(tmp_path, {"layer.thickness": [0.1, 0.2], "halfspace.shear_modulus": [0.1, 10.0, 1e5]})
    with open_results(tmp_path) as data:
        figure = curves_figure(data, columns=1)
    lines = figure.axes[0].lines
    assert [line.get_color() for line in lines] == [c for c in colours(2) for _ in range(3)]
    assert [line.get_linestyle() for line in lines[:3]] == [line.get_linestyle() for line in lines[3:]]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    bulk = [r"$G_\mathrm{bulk}$ = 0.1", r"$G_\mathrm{bulk}$ = 10", r"$G_\mathrm{bulk}$ = $10^{5}$"]
    assert labels == ["$d$ = 0.1", "$d$ = 0.2", *bulk]


def test_time_is_not_scaled_without_a_common_relaxation_time(tmp_path):
    write_case(tmp_path / "0000.h5", about={})
    with open_case(tmp_path / "0000.h5") as data:
        figure = curves_figure(data)
    assert figure.axes[0].get_xlabel() == "$t$"
    assert figure.axes[0].get_xlim() == (0.0, 4.0)
    assert figure.legends == []


def test_pictures_are_named_after_the_results_and_matplotlib_is_left_as_it_was(thicknesses):
    before = dict(mpl.rcParams)
    assert plot_results(thicknesses, case=3) == [thicknesses / "demo.png", thicknesses / "demo-snapshots.png"]
    one = case_path(thicknesses, 2)
    assert plot_results(one, kind="curves") == [one.with_suffix(".png")]
    assert plot_results(one, kind="waterfall") == [one.with_name("0002-waterfall.png")]
    written = {path.name: path.read_bytes() for path in thicknesses.rglob("*.png")}
    assert written.keys() == {"demo.png", "demo-snapshots.png", "0002.png", "0002-waterfall.png"}
    assert all(content.startswith(b"\x89PNG") for content in written.values())
    assert dict(mpl.rcParams) == before
    with pytest.raises(ResultsError, match="there is no case 7; must be from 0 to"):
        plot_results(thicknesses, case=7)


@pytest.mark.parametrize(("suffix", "start"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_suffix_chooses_the_format(tmp_path, suffix, start):
    write_case(case_path(tmp_path, 0), snapshots=False)
    (picture,) = plot_results(tmp_path, tmp_path / f"figure.{suffix}")
    assert picture.read_bytes().startswith(start)
    assert not (tmp_path / f"figure-snapshots.{suffix}").exists()


def test_pictures_that_cannot_be_written_are_refused(thicknesses):
    with pytest.raises(ResultsError, match=r"'\.bmp'; use \.png, \.pdf, \.svg"):
        plot_results(thicknesses, thicknesses / "figure.bmp")
    with pytest.raises(ResultsError, match="cannot be written"):
        plot_results(case_path(thicknesses, 0), thicknesses / "sweep.h5" / "figure.png", kind="waterfall")
    with pytest.raises(ResultsError, match="no such folder"):
        plot_results(thicknesses / "nowhere")


def test_snapshots_show_the_contact_zoomed(thicknesses):
    with open_case(case_path(thicknesses, 0)) as data:
        figure = snapshots_figure({"$d$ = 0": data})
    surface, pressure = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == ["$u$", "$p$"]
    assert surface.get_title(loc="left") == "$d$ = 0"
    assert len(surface.lines) == 2 * len(pressure.lines) == 4  # the contact of each below its surface
    # The contact is |x| < 0.1; half its width on either side and a few cells make less than 0.3.
    assert -0.3 < surface.get_xlim()[0] < -0.1
    assert 0.1 < surface.get_xlim()[1] < 0.3
    assert [t.get_text() for t in figure.legends[0].get_texts()] == [
        r"$t/\tau$ = 0.5",
        r"$t/\tau$ = 2",
        "contact",
    ]


def test_snapshots_of_a_surface_are_maps(tmp_path):
    field = np.maximum(0, 0.04 - X[:, None] ** 2 - (X[None, ::2]) ** 2)
    with case_file(tmp_path / "0000.h5", {"x": X, "y": X[::2]}, {"tau": 1.0}) as case:
        case.snapshot(1.0, named(-field, field))
    with open_case(tmp_path / "0000.h5") as data:
        figure = snapshots_figure({"": data})
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == ("$x$", "$y$")
    (image,) = figure.axes[0].images
    np.testing.assert_array_equal(np.asarray(image.get_array()), field.T)


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
        # rounded as far as they stay apart
        ([2e-4, 0.000632455532034, 2e-3], ["0.0002", "0.000632", "0.002"]),
        ([1.2345678, 1.2349], ["1.2346", "1.2349"]),
        ([1234.5678, 2.34567], ["1234.57", "2.35"]),
        ([0.03127], ["0.03127"]),
        # mappings in short
        (["shape=parabola, radius=0.25"], ["parabola $R$ = 0.25"]),
        (
            ["model=zener, G0=1.0, Ginf=10.0, tau=1.0", "model=zener, G0=1.0, Ginf=2.0, tau=1.0"],
            [r"zener $G_\infty$ = 10", r"zener $G_\infty$ = 2"],
        ),
        (["shape=wedge, slope=0.1", "none"], ["wedge slope = 0.1", "none"]),
        (
            ["model=prony, G0=1.0, branches=[G=1.0, tau=0.1, G=2.0, tau=1.0, G=3.0, tau=10.0]"],
            ["prony $G_0$ = 1, branches = [G=1.0, tau=0.1, G=2.0,…"],
        ),
    ],
)
def test_values_are_written_as_a_reader_would(values, labels):
    assert value_labels(values) == labels


def test_colours_lighten_when_printed_grey():
    grey = [np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) for colour in colours(6)]
    # Six steps over a range of 0.6, none less than half the mean step; the lightest is dark enough on white.
    assert np.diff(grey).min() > 0.05
    assert grey[-1] < 0.75


def test_logarithmic_time_begins_after_zero(thicknesses):
    with open_case(case_path(thicknesses, 0)) as data:
        figure = curves_figure(data, log_time=True)
    for axes in figure.axes:
        assert axes.get_xscale() == "log"
        assert axes.get_xlim() == (0.5, 2.0)
        np.testing.assert_array_equal(axes.lines[0].get_xdata(), [0.5, 2.0])


def test_the_symbols_of_curves_and_their_scales_are_explained(thicknesses):
    with open_results(thicknesses) as data:
        words = curves_figure(data).get_supxlabel()
    assert r"$\tilde{a}$: relative contact area;" in words
    assert r"$\tilde{p}$: mean pressure over the cell $\bar{p}/(2G_0)$" in words
    assert r"$t$: time" in words
    assert r"$\tau$: relaxation time" in words
    assert r"$G_0$: relaxed shear modulus" in words  # of the mean pressure
    assert r"$d$: thickness of the layer" in words  # of the legend
    assert r"$L$" not in words  # nothing is divided by it


@pytest.mark.parametrize(("longest", "scale"), [(50.0, "linear"), (70.0, "log")])
def test_time_is_logarithmic_where_short_cases_would_be_upright_lines(longest, scale):
    time = np.array([[0.0, 1.0, 2.0], [0.0, 1.0, longest]])
    data = Dataset(
        {"contact_area": (("thickness", "row"), 0.1 * np.ones_like(time), {"units": "1"})},
        {
            "time": (("thickness", "row"), time, {"units": "s"}),
            "thickness": ("thickness", [1.0, 2.0], {"key": "layer.thickness", "units": "m"}),
            "case": ("thickness", [0, 1]),
        },
        {"swept": "layer.thickness"},
    )
    assert curves_figure(data, y=["contact_area"]).axes[0].get_xscale() == scale
    assert curves_figure(data, y=["contact_area"], log=()).axes[0].get_xscale() == "linear"


@pytest.mark.parametrize(("middle", "scale"), [(7.0, "linear"), (6.0, "log")])
def test_time_is_logarithmic_where_most_rows_of_a_case_lie_at_its_beginning(middle, scale):
    """As of a seal, whose leak falls over decades: half of its rows are in the first fifteenth."""
    data = Dataset(
        {"contact_area": ("time", [0.0, 0.1, 0.2], {"units": "1"})},
        {"time": ("time", [0.0, middle, 100.0], {"units": "s"})},
    )
    assert curves_figure(data, y=["contact_area"]).axes[0].get_xscale() == scale
    assert curves_figure(data, y=["contact_area"], log=()).axes[0].get_xscale() == "linear"


def test_inset_shows_punch_and_surface_and_where_on_the_curve(thicknesses):
    with open_results(thicknesses) as data, open_case(case_path(thicknesses, 2)) as case:
        case.coords["case"] = 2
        figure = curves_figure(data, inset=Inset.of(case, [4.0, 1.0]))
    area = figure.axes[0]
    dots = [(*line.get_xdata(), *line.get_ydata()) for line in area.lines if line.get_marker() == "o"]
    assert dots == [(2.0, 0.4), (0.5, 0.1)]  # t/tau with tau = 2, and the area 0.1 t
    (inset,) = area.child_axes
    assert len(inset.lines) == 4
    assert (inset.get_xlabel(), inset.get_ylabel()) == ("$x$", "$u$")  # words would reach beyond the panel
    assert "$u$: " in figure.get_supxlabel()
    surface, punch = (line.get_ydata() for line in inset.lines[:2])
    np.testing.assert_array_equal(surface, -np.maximum(0, 0.01 - X**2))
    np.testing.assert_allclose(punch, X**2 - 0.01, atol=1e-17)


def test_inset_keeps_clear_of_the_curves(thicknesses):
    with open_case(case_path(thicknesses, 0)) as data:
        figure = curves_figure(data, inset=Inset.of(data, [1.0]))
        (inset,) = figure.axes[0].child_axes
        with pytest.raises(ResultsError, match="no snapshot at time 3; there are 1, 4"):
            Inset.of(data, [3.0])
    # The curve is the diagonal of the panel: a corner beside it is free.
    box = inset.get_position()
    panel = figure.axes[0].get_position()
    left, bottom = (box.x0 - panel.x0) / panel.width, (box.y1 - panel.y0) / panel.height
    assert left > bottom


def test_waterfall_has_a_profile_for_each_time(thicknesses):
    with open_case(case_path(thicknesses, 0)) as data:
        (axes,) = waterfall_figure(data, "$d$ = 0").axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["0.5", "2"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$x$", r"$t/\tau$")
    early, late = (np.asarray(line.get_ydata()) for line in axes.lines[:2])
    # The highest pressure, that of t = 4, is drawn OVERLAP high; that of t = 1 is a quarter of it.
    assert late.max() == 1 + OVERLAP
    np.testing.assert_allclose(early, (late - 1) / 4, atol=1e-14)
    assert axes.texts[0].get_text() == "$p$ = 0.02"


def test_map_has_a_colour_for_each_pair_of_values(tmp_path):
    write_sweep(tmp_path, {"layer.thickness": [0, 0.5, float("inf")], "halfspace.shear_modulus": [1, 2]})
    with open_results(tmp_path) as data:
        data["contact_area_interpolated"][2, 1] = np.nan
        figure = map_figure(data, time=0.9)
    area, pressure = figure.axes[:2]
    expected = np.full((2, 3), 0.1)
    expected[1, 2] = np.nan
    np.testing.assert_array_equal(np.ma.filled(area.collections[0].get_array(), np.nan), expected)
    assert [label.get_text() for label in area.get_xticklabels()] == ["0", "0.5", r"$\infty$"]
    assert (area.get_xlabel(), area.get_ylabel()) == ("$d$", r"$G_\mathrm{bulk}$")
    assert area.get_title(loc="left") == r"(a)  $t/\tau$ = 0.5"
    assert {text.get_text() for text in pressure.texts} == {"0.200"}
    assert len(area.texts) == 5


def test_map_needs_two_keys(thicknesses):
    with pytest.raises(ResultsError, match=r"2 keys, this is one over 1 \(thickness\)"):
        plot_results(thicknesses, kind="map")


def test_case_in_two_dimensions_is_maps_and_a_cut_through_the_highest_pressure(tmp_path):
    y = X[::2]
    pressure = np.maximum(0, 0.04 - X[:, None] ** 2 - (y - 0.25) ** 2)
    gap = np.maximum(0, X[:, None] ** 2 + (y - 0.25) ** 2 - 0.04)
    with case_file(tmp_path / "0000.h5", {"x": X, "y": y}, {"tau": 1.0}) as case:
        case.snapshot(1.0, named(-pressure, pressure, gap))
        case.snapshot(2.0, named(-2 * pressure, 3 * pressure, gap))
    with open_case(tmp_path / "0000.h5") as data:
        figure = snapshots_figure({"": data})
    panels = np.reshape([axes for axes in figure.axes if axes.get_label() != "<colorbar>"], (4, 2))
    for column, factor in zip(panels.T, (1, 3), strict=True):
        np.testing.assert_array_equal(column[0].images[0].get_array(), factor * pressure.T)
        seen = np.ma.filled(column[1].images[0].get_array(), np.nan)
        np.testing.assert_array_equal(seen, np.where(pressure > 0, -1.0, gap).T)
        row = int(np.argmin(np.abs(y - 0.25)))
        surface, punch, _ = (line.get_ydata() for line in column[2].lines)
        np.testing.assert_array_equal(punch - surface, gap[:, row])
        np.testing.assert_array_equal(column[3].lines[0].get_ydata(), factor * pressure[:, row])
        assert column[0].lines[0].get_ydata()[0] == y[row]
    assert [axes.get_title(loc="right") for axes in panels[0]] == [r"$t/\tau$ = 1", r"$t/\tau$ = 2"]


@pytest.mark.parametrize("columns", [1, 2])
def test_screen_is_the_same_figure_larger(thicknesses, columns):
    with open_results(thicknesses) as data:
        paper, screen = (curves_figure(data, columns, style=style) for style in (PAPER, SCREEN))
    small, large = paper.get_size_inches(), screen.get_size_inches()
    assert large[0] == pytest.approx(SCREEN.scale * small[0])
    assert large[1] == pytest.approx(
        SCREEN.scale * small[1], rel=0.05
    )  # lines of notes have heights of their own
    for small, large in zip(paper.axes, screen.axes, strict=True):
        assert large.xaxis.label.get_size() > 1.5 * small.xaxis.label.get_size()
        assert large.lines[0].get_linewidth() > 1.5 * small.lines[0].get_linewidth()
        assert [line.get_color() for line in large.lines] == [line.get_color() for line in small.lines]


@pytest.fixture
def coarse(monkeypatch):
    """Movies of few dots, which are drawn sooner."""
    monkeypatch.setattr(movies, "FRAME_DPI", 20)


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("shape", [(64,), (64, 32)])
def test_movie_shows_each_snapshot(tmp_path, monkeypatch, shape):
    fields = np.random.default_rng(1).random((3, 3, *shape))
    axes = {"x": X, "y": X[::2]} if len(shape) == 2 else {"x": X}
    with case_file(case_path(tmp_path, 0), axes, {"name": "demo", "tau": 2.0}) as case:
        for time, three in enumerate(fields):
            case.row(time=float(time), contact_area_interpolated=0.1, mean_pressure=0.2)
            case.snapshot(float(time), named(*three))
    if len(shape) == 2:
        monkeypatch.setattr("shutil.which", lambda _: None)
        assert plot_results(tmp_path, kind="movie") == [tmp_path / "demo.gif"]  # without ffmpeg
        with Image.open(tmp_path / "demo.gif") as written:
            assert written.n_frames == 3
    with open_case(case_path(tmp_path, 0)) as data:
        figure, show = movies.animated(data, "case")
        show(2)
        assert figure.axes[0].get_title(loc="left") == r"case    $t/\tau$ = 1"
        shown = fields[2, [2, 1]] if len(shape) == 2 else fields[2, :2]  # of a surface the gap
        for axes_, field in zip(figure.axes, shown, strict=False):
            drawn = axes_.images[0].get_array().T if len(shape) == 2 else axes_.lines[0].get_ydata()
            np.testing.assert_array_equal(drawn, field)


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize("reads", ["", "cat > /dev/null; "])
def test_movie_that_ffmpeg_cannot_write_is_an_error(thicknesses, tmp_path, monkeypatch, reads):
    # As an ffmpeg without H.264, which ends at once, and one with a full disk, which ends after its input.
    ffmpeg, written = tmp_path / "ffmpeg", tmp_path / "movie.mp4"
    written.write_text("an earlier one")
    begins = 'for last; do :; done; echo some > "$last"'
    ffmpeg.write_text(f"#!/bin/sh\n{reads}{begins}; echo no such encoder >&2; exit 3\n")
    ffmpeg.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    with pytest.raises(ResultsError, match=r"movie\.mp4: ffmpeg could not write it .*3.*no such encoder"):
        plot_results(thicknesses, written, kind="movie")
    assert written.read_text() == "an earlier one"
    assert list(tmp_path.glob("*.part*")) == []


def test_movie_formats_that_cannot_be_written_are_refused(thicknesses, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(ResultsError, match="needs ffmpeg, which is not found"):
        plot_results(thicknesses, thicknesses / "demo.mp4", kind="movie")
    with pytest.raises(ResultsError, match=r"'\.png'; use \.mp4, \.gif"):
        plot_results(thicknesses, thicknesses / "demo.png", kind="movie")
    monkeypatch.setattr("shutil.which", lambda _: "/somewhere/ffmpeg")
    assert movies.default_suffix() == ".mp4"


def test_pictures_of_snapshots_need_snapshots(tmp_path):
    write_case(case_path(tmp_path, 0), snapshots=False)
    for kind in ("snapshots", "waterfall", "movie"):
        with pytest.raises(ResultsError, match=r"no snapshots; set output\.snapshots"):
            plot_results(tmp_path, kind=kind)
    assert list(tmp_path.glob("*.*")) == []


def test_the_contact_area_is_drawn_without_steps_unless_the_counted_one_is_asked_for(tmp_path):
    counted, between = [0.0, 0.25, 0.25], [0.0, 0.24, 0.26]
    with case_file(case_path(tmp_path, 0), {"x": X}, {"name": "demo"}) as case:
        for i, (whole, part) in enumerate(zip(counted, between, strict=True)):
            case.row(time=float(i), contact_area=whole, contact_area_interpolated=part, mean_pressure=0.2)
    with open_case(case_path(tmp_path, 0)) as data:
        drawn, asked = curves_figure(data).axes[0], curves_figure(data, y=["contact_area"]).axes[0]
    np.testing.assert_array_equal(drawn.lines[0].get_ydata(), between)
    np.testing.assert_array_equal(asked.lines[0].get_ydata(), counted)
    assert drawn.get_ylabel() == asked.get_ylabel() == r"$\tilde{a}$"


def test_a_gap_that_is_not_known_has_no_colour_of_contact():
    """Of an isolated contact it is known within reach of the points in contact."""
    found = gfmdlayer.solve(
        gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=1.0), depth=0.002, period=0.2,
        points=(32, 32), isolated=True,
    )  # fmt: skip
    figure = found.plot()
    (mesh,) = (
        axes.images[0] for axes in figure.axes if axes.images and axes.images[0].get_cmap().name == "Blues"
    )
    colours, values = mesh.to_rgba(mesh.get_array()), np.asarray(found.gap.transpose("y", "x"))
    contact = np.array(to_rgba(CONTACT))
    assert np.isnan(values).any()
    assert ((np.abs(colours - contact) < 1e-9).all(axis=-1) == (values == 0)).all()
    assert (colours[np.isnan(values), 3] == 0).all()  # the white behind
