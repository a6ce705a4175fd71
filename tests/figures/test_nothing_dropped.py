"""Figures show all that was asked, or say what they leave out: keys, cases, snapshots, columns and units."""

import itertools
import math
import re

import numpy as np
import pytest
import xarray
from matplotlib.colors import LogNorm, to_hex
from PIL import Image

from gfmdlayer.figures.curve_family import Scale, family
from gfmdlayer.figures.curve_plots import curves_figure
from gfmdlayer.figures.labels import labelled, quantity, value_labels
from gfmdlayer.figures.map_plots import map_figure
from gfmdlayer.figures.movies import animated, write_movie
from gfmdlayer.figures.plot_style import CONTACT
from gfmdlayer.figures.plots import plot_results
from gfmdlayer.figures.selection import notes, select, swept
from gfmdlayer.figures.snapshots import snapshots_figure
from gfmdlayer.results.names import ResultsError, described_key
from tests.recordings import case_file, named

TIMES = np.linspace(0.0, 4.0, 5)
EIGHT = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0]


@pytest.fixture(autouse=True)
def symbols():
    """Axes by their symbols alone; words before them have tests of their own."""
    with labelled("symbols"):
        yield


def sweep(keys, *, listed=False, failed=(), **attributes):
    """A sweep as the reader opens it; the columns are the number of the case times one, two, ... times t."""
    names = {key: key.rpartition(".")[2] for key in keys}
    sizes = [len(values) for values in keys.values()]
    shape = tuple(sizes[:1] if listed else sizes)
    dims = ("case",) if listed else tuple(names.values())
    numbers = np.arange(math.prod(shape)).reshape(shape)
    fields = np.where(np.isin(numbers, failed), np.nan, numbers)[..., np.newaxis] * TIMES
    coordinates = {"time": ("time", TIMES, {"units": "time"}), "case": (dims, numbers)}
    for key, name in names.items():
        coordinates[name] = ("case" if listed else name, list(keys[key]), described_key(key, str))
    units = {"contact_area": "1", "mean_pressure": "1", "depth": "length", "force": "force / length"}
    columns = {
        f"{name}_over_time" if name in names.values() else name: (
            (*dims, "time"),
            (i + 1) * fields,
            {"units": unit},
        )
        for i, (name, unit) in enumerate(units.items())
    }
    lost = "\n".join(f"{number:04d}: did not converge" for number in failed)
    return xarray.Dataset(
        columns, coordinates, {"swept": " ".join(keys), "failed": lost, "notes": "", **attributes}
    )


def case(count, *, surface=False, **attributes):
    """A case with snapshots at t = 1, 2, ..., whose pressure grows with time up to the last but one."""
    x = np.linspace(-0.5, 0.5, 32, endpoint=False)
    r2 = x**2 if not surface else x[:, None] ** 2 + x**2
    strength = np.arange(1.0, count + 1)
    strength[-1] = 0.5
    pressure = np.multiply.outer(strength, np.maximum(0, 0.04 - r2))
    dims = ("snapshot", "x", "y")[: pressure.ndim]
    fields = {
        "pressure": (pressure, "pressure"),
        "displacement": (-pressure, "length"),
        "gap": (np.broadcast_to(np.maximum(0, r2 - 0.04), pressure.shape), "length"),
    }
    coordinates = {name: (name, x, {"units": "length"}) for name in dims[1:]}
    coordinates["snapshot"] = ("snapshot", np.arange(1.0, count + 1), {"units": "time"})
    variables = {name: (dims, values, {"units": unit}) for name, (values, unit) in fields.items()}
    return xarray.Dataset(variables, coordinates, attributes)


def said(figure):
    """The notes below a figure, without the explanations of its symbols."""
    parts = figure.get_supxlabel().replace("\n", "; ").split("; ")
    return "; ".join(part for part in parts if not re.match(r"\$[^$]*\$: ", part))


def legend(figure):
    return [text.get_text() for each in figure.legends for text in each.get_texts()]


def bars(figure):
    return [axes for axes in figure.axes if axes.get_label() == "<colorbar>"]


@pytest.mark.parametrize(
    ("wanted", "values", "asked"),
    [
        (0.1, [0.1], None),
        ("0.11", [0.1], "0.11"),
        ("1/32", [0.03125], None),
        ("inf", [math.inf], None),
        ("0.02:0.5", [0.03125, 0.1, 0.25], None),
        (":0.1", [0.0, 0.03125, 0.1], None),
        ((0.2, math.inf), [0.25, math.inf], None),
    ],
)
def test_a_value_selects_the_nearest_and_a_range_all_in_it(wanted, values, asked):
    whole = sweep({"layer.thickness": [0.0, 0.03125, 0.1, 0.25, math.inf]})
    for key in ("thickness", "layer.thickness"):
        part = select(whole, {key: wanted})
        assert np.atleast_1d(part["thickness"]).tolist() == values
        assert part["thickness"].attrs.get("asked") == asked
    (said,) = notes(part)
    assert f"of {whole.sizes['thickness']} values" in said
    assert ("nearest to 0.11" in said) == (asked is not None)
    assert notes(whole) == []
    assert "among" not in whole["thickness"].attrs


def test_a_list_of_cases_is_selected_by_any_of_its_keys():
    whole = sweep({"layer.thickness": [0.1, 0.2, 0.2], "punch.radius": [1.0, 2.0, 3.0]}, listed=True)
    part = select(whole, {"thickness": 0.19, "radius": "2:"})
    assert part["case"].values.tolist() == [1, 2]
    assert notes(part) == ["$d$ = 0.2, nearest to 0.19", "2 of 3 cases"]
    assert legend(curves_figure(part)) == ["$d$ = 0.2, $R$ = 2", "$d$ = 0.2, $R$ = 3"]


def test_text_is_selected_as_it_is_written_or_by_a_part():
    shapes = ["shape=parabola, radius=0.25", "shape=parabola, radius=0.5", "shape=wedge, slope=0.2"]
    whole = sweep({"punch": shapes})
    assert select(whole, {"punch": "wedge"})["case"].item() == 2
    assert select(whole, {"punch": "parabola R = 0.5"})["case"].item() == 1
    assert select(whole, {"punch": "parabola"})["case"].values.tolist() == [0, 1]
    with pytest.raises(ResultsError, match=r"no value 'cone'; must be one of parabola R = 0.25 \| parabola"):
        select(whole, {"punch": "cone"})


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({"thicknes": 1}, r"thicknes is not swept; must be one of thickness; did you mean 'thickness'\?"),
        ({"thickness": "thin"}, r"got 'thin'; must be a number, or a range such as 0.1:0.5"),
        ({"thickness": "0.5:0.1"}, "must be a number, or a range"),
        ({"thickness": "nan"}, "must be a number, or a range"),
        ({"thickness": "3:4"}, r"no value from 3 to 4; it has 0.1, 0.2"),
        ({"thickness": "inf"}, r"no value inf; it has 0.1, 0.2"),
        ({"thickness": 0.1, "layer.thickness": 0.1}, "selected twice"),
    ],
)
def test_selections_that_mean_nothing_are_refused(wanted, message):
    with pytest.raises(ResultsError, match=message):
        select(sweep({"layer.thickness": [0.1, 0.2]}), wanted)


def test_a_third_key_is_held_at_a_value_that_is_said():
    whole = sweep(
        {"layer.thickness": EIGHT, "halfspace.shear_modulus": [1, 10], "layer.poisson": [0.3, 0.4, 0.5]}
    )
    figure = curves_figure(whole)
    (bar,) = bars(figure)
    assert said(figure) == r"fixed: $\nu$ = 0.4 (of 3 values)"
    assert legend(figure) == [r"$G_\mathrm{bulk}$ = 1", r"$G_\mathrm{bulk}$ = 10"]
    assert (bar.get_ylabel(), bar.get_yscale()) == ("$d$", "log")
    for axes, factor in zip(figure.axes, (1, 2), strict=False):
        drawn = {line.get_ydata()[-1] for line in axes.lines}
        assert drawn == {4.0 * factor * number for number in whole["case"].sel(poisson=0.4).values.ravel()}
    held = curves_figure(select(whole, {"poisson": 0.5, "shear_modulus": 2}))
    assert (
        said(held) == r"fixed: $G_\mathrm{bulk}$ = 1 (of 2 values, nearest to 2), $\nu$ = 0.5 (of 3 values)"
    )
    assert len(held.axes[0].lines) == 8


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        ([1, 2, 4, 8, 16, 32, 64], "log"),
        ([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7], "linear"),
        ([-2, -1, 0, 1, 2, 3, 4], "linear"),
        ([0, 0.001, 0.01, 0.1, 1, 10, 100], "order"),
        ([1, 2, 3, 4, 5, 6, math.inf], "order"),
        (["a", "b", "c"], "order"),
        ([5.0], "linear"),
    ],
)
def test_the_spread_of_values_chooses_the_scale(values, kind):
    scale = Scale.of(values)
    assert scale.kind == kind
    if kind == "order":
        assert scale.positions.tolist() == list(range(len(values)))
        assert [scale.labels[i] for i in scale.ticks] == value_labels(values)


def test_line_styles_go_to_the_key_of_fewer_values():
    drawn = family(sweep({"layer.poisson": [0.3, 0.4], "layer.thickness": EIGHT}))
    assert drawn.bar is not None
    assert drawn.bar.scale.quantity.label == "$d$"
    assert [title for title, _, _ in drawn.legend] == [r"$\nu$ = 0.3", r"$\nu$ = 0.4"]
    assert len({(curve.colour, str(curve.dashes)) for curve in drawn.curves}) == 16
    both = curves_figure(sweep({"layer.thickness": EIGHT, "punch.radius": EIGHT}))
    assert said(both) == "6 of 8 values of $R$"
    assert len(legend(both)) == 6


def test_legends_of_text_are_complete():
    names = [f"rule {letter}" for letter in "abcdefghijklmnopqrst"]
    figure = curves_figure(sweep({"solver.method": names}))
    assert legend(figure) == [f"method = {name}" for name in names]
    assert bars(figure) == []


def test_failed_cases_are_gaps_with_names():
    whole = sweep({"layer.thickness": [0.1, 0.2, 0.5, 1.0]}, failed=[1])
    figure = curves_figure(whole)
    assert legend(figure)[1] == "$d$ = 0.2 (failed)"
    assert said(figure) == "1 of 4 cases failed: $d$ = 0.2"
    (line,) = curves_figure(whole, x="thickness").axes[0].lines
    np.testing.assert_array_equal(line.get_ydata(), [0.0, np.nan, 8.0, 12.0])
    many = sweep({"layer.thickness": EIGHT}, failed=[0, 1, 2, 5, 7])
    assert said(curves_figure(many)) == "5 of 8 cases failed: $d$ = 0.01 | $d$ = 0.02 | $d$ = 0.05 and 2 more"
    assert "failed" not in said(curves_figure(select(whole, {"thickness": "0.5:"})))


def test_samples_have_the_colour_of_a_key_and_name_the_others():
    whole = sweep({"layer.thickness": EIGHT, "punch.radius": EIGHT[::-1]}, listed=True, failed=[3])
    figure = curves_figure(whole)
    assert bars(figure)[0].get_ylabel() == "$d$"
    assert said(figure) == "1 of 8 cases failed: $d$ = 0.1, $R$ = 0.2; also varied: $R$"
    dots = map_figure(whole, z=["force"]).axes[0]
    assert (dots.get_xlabel(), dots.get_ylabel(), dots.get_xscale()) == ("$d$", "$R$", "log")
    known, lost = (np.asarray(each.get_offsets()) for each in dots.collections)
    np.testing.assert_array_equal(lost, [[0.1, 0.2]])
    assert len(known) == 7


@pytest.mark.parametrize(
    ("units", "scales", "label", "scale"),
    [
        ("1", {}, r"$\tilde{a}$", 1.0),
        ("length", {"L": 2.0}, r"$\tilde{a}/L$", 2.0),
        ("pressure", {"G0": 3.0}, r"$\tilde{a}/G_0$", 3.0),
        ("length / time", {"L": 2.0, "tau": 4.0}, r"$\tilde{a}\tau/L$", 0.5),
        ("pressure length", {"L": 2.0, "G0": 3.0}, r"$\tilde{a}/(G_0\,L)$", 6.0),
        ("force", {"L": 2.0, "G0": 3.0}, r"$\tilde{a}/(G_0\,L^{2})$", 12.0),
        ("force / length", {"L": 2.0, "G0": 3.0}, r"$\tilde{a}/(G_0\,L)$", 6.0),
        ("length", {"G0": 2.0}, r"$\tilde{a}$", 1.0),
        ("um", {"L": 2.0}, r"$\tilde{a}$ (µm)", 1.0),
        ("N/m^2", {"L": 2.0}, r"$\tilde{a}$ (N/m$^{2}$)", 1.0),
    ],
)
def test_quantities_are_in_the_units_of_the_config_or_in_those_of_the_paper(units, scales, label, scale):
    found = quantity(xarray.DataArray(0.0, name="contact_area", attrs={"units": units}), scales)
    assert (found.label, found.scale) == (label, scale)


@pytest.mark.parametrize(
    ("unit", "factor", "label", "ticks"),
    [
        ("m", 1e-6, r"$\delta$ (µm)", 12.0),
        ("m", 1e-2, r"$\delta$ (m)", 0.12),
        ("mm", 1e-6, r"$\delta$ (nm)", 12.0),
        ("mm/s", 1e-6, r"$\delta$ (nm/s)", 12.0),
        ("m^2", 1e-6, r"$\delta$ (mm$^{2}$)", 12.0),
        ("N/m", 1e-3, r"$\delta$ (mN/m)", 12.0),
        ("s", 1e3, r"$\delta$ ($10^{3}$ s)", 12.0),
        ("psi", 1e-6, r"$\delta$ ($10^{-6}$ psi)", 12.0),
        ("length", 1e-6, r"$\delta$ ($10^{-6}$)", 12.0),
        ("Pa", 1e6, r"$\delta$ (MPa)", 12.0),
    ],
)
def test_powers_of_ten_stand_with_the_unit(unit, factor, label, ticks):
    whole = sweep({"layer.thickness": [0.1, 0.2]})
    whole["depth"] = 3 * factor * whole["depth"] / 3
    whole["depth"].attrs["units"] = unit
    figure = curves_figure(whole, y=["depth"])
    figure.draw_without_rendering()
    (axes,) = figure.axes
    assert axes.get_ylabel() == label
    assert axes.yaxis.get_offset_text().get_text() == ""
    shown = [float(text.get_text().replace("−", "-")) for text in axes.get_yticklabels()]
    np.testing.assert_allclose(shown, axes.get_yticks() * ticks / (12 * factor), rtol=1e-9)


def test_small_changes_of_large_values_have_no_offset():
    whole = sweep({"layer.thickness": [0.1, 0.2]})
    whole["contact_area"] = 0.2 + 1e-6 * whole["contact_area"]
    figure = curves_figure(whole, y=["contact_area"])
    figure.axes[0].set_ylim(0.2, 0.200004)
    figure.draw_without_rendering()
    assert figure.axes[0].yaxis.get_offset_text().get_text() == ""


def test_swept_values_have_their_unit():
    whole = sweep({"layer.thickness": [1e-4, 2e-4, math.inf]})
    whole["thickness"].attrs["units"] = "m"
    assert legend(curves_figure(whole)) == ["$d$ = 100 µm", "$d$ = 200 µm", r"$d$ = $\infty$"]
    fast = sweep({"trajectory.velocity": [1e-8, 1e-2, 100.0]})
    fast["velocity"].attrs["units"] = "mm/s"
    assert legend(curves_figure(fast)) == ["$v$ = 10 pm/s", "$v$ = 10 µm/s", "$v$ = 100 mm/s"]


@pytest.mark.parametrize(
    ("attributes", "drawn"),
    [({}, ["contact_area", "mean_pressure"]), ({"control": "load"}, ["contact_area", "depth"]),
     ({"control": "force"}, ["contact_area", "depth"])],
)  # fmt: skip
def test_the_depth_is_drawn_where_the_load_is_prescribed(attributes, drawn):
    whole = sweep({"layer.thickness": [0.1, 0.2]}, **attributes)
    figure = curves_figure(whole)
    assert [axes.lines[1].get_ydata()[-1] for axes in figure.axes] == [
        whole[name].isel(thickness=1, time=-1).item() for name in drawn
    ]


def test_where_the_control_is_swept_depth_and_pressure_are_drawn():
    figure = curves_figure(sweep({"trajectory.control": ["depth", "load"]}))
    assert [axes.get_ylabel() for axes in figure.axes] == [r"$\tilde{a}$", r"$\delta$", r"$\tilde{p}$"]


def test_any_column_is_drawn_against_any_other():
    whole = sweep({"layer.thickness": [0.1, 0.2, 0.5]}, L=2.0, G0=3.0)
    names = ["force", "contact_area", "mean_pressure", "depth", "force"]
    figure = curves_figure(whole, x="depth", y=names)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["(a)", "(b)", "(c)", "(d)", "(e)"]
    line = figure.axes[0].lines[2]
    np.testing.assert_allclose(line.get_xdata(), 3 * 2 * TIMES / 2.0)
    np.testing.assert_allclose(line.get_ydata(), 4 * 2 * TIMES / 6.0)
    assert (figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()) == (r"$\delta/L$", r"$F/(G_0\,L)$")
    with pytest.raises(
        ResultsError, match=r"no column forc; must be one of time, con.*; did you mean 'force'\?$"
    ):
        curves_figure(whole, y=["forc"])
    with pytest.raises(ResultsError, match="log_time or inset needs time on the x axis, not depth"):
        curves_figure(whole, x="depth", log_time=True)
    with pytest.raises(ResultsError, match="time needs a swept key on the x axis, not depth"):
        curves_figure(whole, x="depth", time=1.0)


@pytest.mark.parametrize(
    ("time", "factor", "when"), [(None, 4, "$t$ = 4"), (1.1, 1, "$t$ = 1"), ("min", 0, "min.")]
)
def test_a_column_is_drawn_against_a_swept_key(time, factor, when):
    whole = sweep({"layer.thickness": [0.5, 0.1, math.inf], "punch.radius": [1, 2]})
    figure = curves_figure(whole, x="layer.thickness", y=["contact_area"], time=time)
    (axes,) = figure.axes
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0.1", "0.5", r"$\infty$"]
    assert [line.get_ydata().tolist() for line in axes.lines] == [
        [2 * factor, 0, 4 * factor],
        [3 * factor, factor, 5 * factor],
    ]
    assert said(figure).startswith(when)
    assert legend(figure) == ["$R$ = 1", "$R$ = 2"]


def test_a_column_of_the_name_of_a_key_and_one_that_cases_lack():
    whole = sweep(
        {"trajectory.depth": [0.1, 0.2]}, notes="depth: NaN in case 0001\npatches: NaN in case 0000"
    )
    figure = curves_figure(whole, y=["depth"])
    assert said(figure) == "depth: NaN in case 0001"
    assert figure.axes[0].get_ylabel() == r"$\delta$"


def test_maps_of_any_column_over_any_two_keys_at_extremes():
    whole = sweep(
        {"layer.thickness": [0.1, 0.2], "punch.radius": [1, 2, 3], "layer.poisson": [0.3, 0.5]}, failed=[11]
    )
    figure = map_figure(whole, "max", x="layer.poisson", y="thickness", z=["force"])
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == (r"$\nu$", "$d$")
    expected = 16 * whole["case"].sel(radius=2).transpose("thickness", "poisson").values
    np.testing.assert_array_equal(axes.collections[0].get_array(), expected)
    assert figure.get_supxlabel().replace("\n", "; ").startswith("fixed: $R$ = 2 (of 3 values); ")
    assert "$d$: thickness of the layer" in figure.get_supxlabel()
    assert axes.get_title(loc="left") == "(a)  max. over $t$"
    with pytest.raises(ResultsError, match="on both axes"):
        map_figure(whole, x="radius", y="punch.radius")
    with pytest.raises(ResultsError, match="radius has only one value"):
        map_figure(select(whole, {"radius": 1}), x="radius")


def test_cells_of_a_map_stand_at_their_numbers():
    whole = sweep({"layer.thickness": [0.1, float("inf")], "punch.radius": [3.0, 1.0, 10.0, 100.0]})
    axes = map_figure(whole, x="radius", z=["force"]).axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    across, up = (np.unique(axes.collections[0].get_coordinates()[..., i]) for i in range(2))
    np.testing.assert_allclose(across[1:-1], np.sqrt([3.0, 30.0, 1000.0]))  # half the way in the logarithm
    np.testing.assert_allclose(up, [-0.5, 0.5, 1.5])  # infinity has a place in the order
    drawn = axes.collections[0].get_array()
    known = whole["force"].isel(time=-1).transpose("thickness", "radius").sortby("radius")
    np.testing.assert_allclose(drawn, known)


def test_colours_of_a_map_are_logarithmic_where_its_values_span_decades():
    whole = sweep({"layer.thickness": [0.1, 0.2], "punch.radius": [1, 2, 3]})
    wide = whole.assign(force=10.0 ** (whole["force"] / 4))
    narrow, logarithmic = (
        map_figure(each, z=["force"]).axes[0].collections[0].norm for each in (whole, wide)
    )
    assert isinstance(logarithmic, LogNorm)
    assert not isinstance(narrow, LogNorm)


@pytest.mark.parametrize(("count", "shown"), [(3, 3), (6, 6), (12, 8)])
def test_maps_of_snapshots_are_complete_or_say_so_with_colours_that_cover_all(count, shown):
    whole = case(count, surface=True, L=2.0, G0=5.0)
    figure = snapshots_figure({"": whole})
    pressures = [axes for axes in figure.axes if axes.images and axes.images[0].get_cmap().name == "magma_r"]
    assert len(pressures) == shown
    assert {axes.images[0].get_clim() for axes in pressures} == {(0.0, whole["pressure"].max().item() / 5)}
    assert (f"8 of {count} snapshots" in said(figure)) == (count > shown)
    assert pressures[0].get_ylabel() == "$y/L$"


def test_a_colour_bar_is_as_high_as_the_map_beside_it():
    figure = snapshots_figure({"": case(1, surface=True)})
    figure.draw_without_rendering()
    beside = [axes for axes in figure.axes if axes.child_axes]
    assert len(beside) == 2
    for axes in beside:
        (bar,) = axes.child_axes
        np.testing.assert_allclose(bar.get_position().intervaly, axes.get_position().intervaly, atol=1e-6)
        assert bar.get_position().x0 > axes.get_position().x1


def test_rows_of_maps_say_how_many_snapshots_they_show():
    figure = snapshots_figure(
        {"one": case(9, surface=True), "two": case(2, surface=True)}, notes=["2 of 7 cases"]
    )
    assert said(figure) == "2 of 7 cases; 4 of 9 snapshots"
    assert sum(bool(axes.images) for axes in figure.axes) == 4 + 2


def test_the_times_asked_for_are_all_drawn_and_no_others(tmp_path):
    whole = case(12, surface=True, L=2.0)
    every = snapshots_figure({"": whole}, every=True)
    assert sum(bool(axes.images) for axes in every.axes) == 2 * 12
    assert "of 12 snapshots" not in said(every)
    two = snapshots_figure({"one": whole, "two": whole}, every=True)
    assert sum(bool(axes.images) for axes in two.axes) == 2 * 12
    with case_file(tmp_path / "0000.h5", {"x": whole["x"].to_numpy()}, {"name": "demo"}) as writer:
        for time in (1.0, 2.0, 4.0):
            writer.snapshot(time, named(*np.zeros((3, 32))))
    (drawn,) = plot_results(tmp_path / "0000.h5", tmp_path / "a.gif", kind="movie", times=[4.0, 1.0])
    with Image.open(drawn) as film:
        assert film.n_frames == 2
    with pytest.raises(ResultsError, match="no snapshot at time 3; there are 1, 2, 4"):
        plot_results(tmp_path / "0000.h5", kind="snapshots", times=[3.0])


def test_a_logarithmic_axis_says_what_has_no_place_on_it():
    whole = sweep({"layer.thickness": [0.1, 0.2]})
    figure = curves_figure(whole, x="depth", y=["force"], log=["x", "y"])
    assert (figure.axes[0].get_xscale(), figure.axes[0].get_yscale()) == ("log", "log")
    assert said(curves_figure(whole, y=["force"], log=["y"])) == (
        "values of force that are not positive are left out"
    )
    assert curves_figure(whole, x="thickness", y=["force"], log=["x"]).axes[0].get_xscale() == "log"
    with pytest.raises(ResultsError, match="log y: depth has no positive value"):
        curves_figure(-whole, y=["depth"], log=["y"])
    with pytest.raises(ResultsError, match=r"log x: .* not positive numbers"):
        curves_figure(sweep({"layer.thickness": [0.1, math.inf]}), x="thickness", log=["x"])


def test_contact_has_its_colour_where_all_of_a_surface_touches_and_is_pulled():
    whole = case(3, surface=True)
    for each in (whole.assign(gap=0 * whole["gap"]), whole.assign(pressure=-whole["pressure"])):
        touched = (each["gap"].isel(snapshot=-1) <= 0).to_numpy().T
        figure, movie_figure = snapshots_figure({"": each}), animated(each)[0]
        assert "contact" in legend(figure)
        assert "contact" in legend(movie_figure)
        for axes in (figure.axes[5], movie_figure.axes[0]):
            (image,) = axes.images
            np.testing.assert_array_equal(image.get_array() < 0, touched)
            assert to_hex(image.get_cmap().get_under()) == CONTACT
    line = case(2)
    contact = [each for each in snapshots_figure({"": line}).axes[0].lines if each.get_label() == "contact"]
    assert {each.get_color() for each in contact} == {CONTACT}
    x = np.asarray(contact[0].get_xdata())
    np.testing.assert_array_equal(np.isfinite(contact[0].get_ydata()), line["gap"][0].sel(x=x) <= 0)


def test_a_time_has_the_same_colour_in_all_profiles():
    late = case(9).isel(snapshot=slice(4, None))
    figure = snapshots_figure({"all": case(9), "late": late})
    (bar,) = bars(figure)
    assert bar.get_ylabel() == "$t$"
    first, second = ([line for line in figure.axes[i].lines if line.get_label() != "contact"] for i in (0, 2))
    assert len(first) == 9
    assert [line.get_color() for line in second] == [line.get_color() for line in first[4:]]
    few = snapshots_figure({"": case(6)})
    assert legend(few) == [*(f"$t$ = {i}" for i in range(1, 7)), "contact"]


def test_frames_of_a_movie_come_at_the_rate_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr("gfmdlayer.figures.movies.FRAME_DPI", 20)
    write_movie(case(3), tmp_path / "film.gif", fps=5)
    with Image.open(tmp_path / "film.gif") as film:
        assert (film.n_frames, film.info["duration"]) == (3, 200)


def test_options_of_another_figure_are_refused(tmp_path):
    with pytest.raises(TypeError, match="unexpected keyword argument 'colour'"):
        plot_results(tmp_path, colour="red")


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_every_number_of_swept_keys_is_drawn(count):
    keys = ["layer.thickness", "punch.radius", "layer.poisson", "layer.material.Ginf"][:count]
    whole = sweep({key: [0.1, 0.2, 0.3] for key in keys})
    figure = curves_figure(whole)
    assert len(figure.axes[0].lines) == 3 ** min(count, 2)
    for key in itertools.islice(swept(whole), 2, None):
        assert f"{value_labels([0.2])[0]} (of 3 values)" in said(figure), key.name
