"""Every kind of picture of every quick configuration, dimensionless and in SI: texts, colours, curves."""

import json
import re
import runpy
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.figures.plot_style import CONTACT, PAPER, styled
from gfmdlayer.observables import columns
from gfmdlayer.results.names import OVER_TIME
from gfmdlayer.results.reader import open_results

SCRIPT = runpy.run_path(str(Path(__file__).parents[2] / "scripts" / "contact_sheet.py"))
# One of a line over a key, one of a surface in SI; the others are slow.
FEW = ("figure2-quick", "rubber-coating-quick")
NAMES = [(name, "") for name in SCRIPT["NAMES"]] + [(name, "SI ") for name in SCRIPT["ALSO_IN_SI"]]
SLOW = [(name, prefix) for name, prefix in NAMES if prefix or name not in FEW]
DRAWN = [pytest.param(*each, marks=pytest.mark.slow if each in SLOW else ()) for each in NAMES]


def texts(figure):
    """The texts that are seen in a drawn figure."""
    found = [text for text in figure.findobj(Text) if text.get_text().strip() and text.get_visible()]
    ticks = {
        label
        for axis in axes_of(figure)
        for tick in (*axis.majorTicks, *axis.minorTicks)  # also those out of view, which are not drawn
        for label in (tick.label1, tick.label2)
    }
    seen = {label for axis in axes_of(figure) for label in labels(axis)}
    offs = {text for axes in figure.axes if not axes.axison for text in (axes.xaxis.label, axes.yaxis.label)}
    return [text for text in found if (text not in ticks or text in seen) and text not in offs]


def axes_of(figure):
    insets = [each for axes in figure.axes for each in axes.child_axes]
    for axes in {*figure.axes, *insets}:
        yield from (axes.xaxis, axes.yaxis)


def labels(axis):
    """The labels of the ticks that are within the view of an axis."""
    place = axis.get_transform().transform  # the logarithm, or as it is
    low, high = sorted(place(np.asarray(axis.get_view_interval(), float)))
    room = 1e-9 * (high - low)
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    every = [
        tick.label1
        for tick in ticks
        if low - room <= place(np.array([tick.get_loc()]))[0] <= high + room and tick.label1.get_visible()
    ]
    return [label for label in every if label.get_text() and axis.axes.axison]


def faults(figure, *, is_si):
    """What is wrong with a drawn figure."""
    width, height = figure.bbox.size
    shown = texts(figure)
    boxes = np.array([text.get_window_extent().extents for text in shown])
    for text, (x0, y0, x1, y1) in zip(shown, boxes, strict=True):
        if "$$" in text.get_text() or re.search(r"\bnan\b|\bNone\b|\{\}|degrees", text.get_text()):
            yield f"{text.get_text()!r} is no text"
        if x0 < -1 or y0 < -1 or x1 > width + 1 or y1 > height + 1:  # a dot, of antialiasing
            yield f"{text.get_text()!r} is outside of the canvas"
    both = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:]) - np.maximum(
        boxes[:, None, :2], boxes[None, :, :2]
    )
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=-1)
    of = {label: axis for axis in axes_of(figure) for label in labels(axis)}
    for i, j in np.argwhere((both > 0).all(axis=-1)):
        # The boxes have room for letters below the line: ticks of two axes, which meet in a corner, share it.
        axis, other = of.get(shown[i]), of.get(shown[j])
        part = 0.0 if axis is not None and axis is other else 0.3 if axis and other else 0.1
        if i < j and both[i, j].prod() > part * min(areas[i], areas[j]):
            yield f"{shown[i].get_text()!r} and {shown[j].get_text()!r} overlap"
    for axis in axes_of(figure):
        beside = sorted(label.get_window_extent().extents.tolist() for label in labels(axis))
        if axis.axis_name == "x" and any(b[0] - a[2] < 0.2 * (a[3] - a[1]) for a, b in pairwise(beside)):
            yield f"ticks of {axis.get_label_text()!r} run together"
    for axes in figure.axes:
        drawn = [line.get_transform().transform(line.get_xydata()) for line in axes.lines]
        points = np.concatenate([path[np.isfinite(path).all(axis=1)] for path in drawn]) if drawn else []
        if len(points) and not axes.bbox.padded(1.0).count_contains(points):
            yield f"no curve over {axes.get_xlabel()!r} is in view"
    for words in {axis.get_label_text() for axis in axes_of(figure)} if is_si else ():
        if re.search(r"10\^\{-?\d+\}\$ ?\)", words) and words.partition(" ")[0] in OF_A_UNIT:
            yield f"{words!r} has a power of ten and no unit"
        if re.search(r"/L|/G_0|/\\tau", words):
            yield f"{words!r} is divided by a scale, in SI"


OF_A_UNIT = (
    r"$\delta$", "$F$", "$p$", "$u$", "$x$", "$t$", r"$\bar{p}$", "$d$", "$w$", "$v$", "work", "stored",
)  # fmt: skip


def contacts(figure):
    """The colours of lines and maps of contact."""
    lines = {to_hex(line.get_color()) for line in figure.findobj(is_contact)}
    maps = [image.get_cmap() for axes in figure.axes for image in axes.images]
    return lines | {to_hex(colours.get_under()) for colours in maps if colours.name == "Blues"}


def is_contact(artist):
    return artist.get_label() == "contact"


def curves(figure):
    """The number of curves in each panel that has lines; a colour bar has none."""
    panels = [axes.lines for axes in figure.axes if axes.axison and axes.lines]
    drawn = [[np.isfinite(np.asarray(line.get_ydata(), float)).sum() > 1 for line in each] for each in panels]
    return [sum(each) for each in drawn]


# More cases are thinned out, which the picture says.
SHOWN = 32
# Those that every run has, and sizes of the same curves: FEW show them.
USUAL = {column.name for column in columns(Config(name="usual"))}
SIZES = ("one column", "talk", "any")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("everything")


@pytest.mark.parametrize(("name", "prefix"), DRAWN)
def test_every_picture_is_legible_and_complete(name, prefix, folder):
    path = SCRIPT["run"](name, folder)
    found = []
    in_units = "\nunits:" in (path / "config.yaml").read_text()
    complete = len(list((path / "cases").glob("*.h5")))
    with open_results(path) as results:
        over_time = {column for column, each in results.items() if {"time", "row"} & {*each.dims}}
        is_usual = name not in FEW and {column.removesuffix(OVER_TIME) for column in over_time} <= USUAL
    for title, draw, style in SCRIPT["pictures"](path):
        if title.startswith("SI ") != bool(prefix) or (is_usual and "columns" in title):
            continue
        if name not in FEW and (title.endswith(SIZES) or (title.endswith("movie") and style is PAPER)):
            continue
        with styled(style), warnings.catch_warnings():
            warnings.simplefilter("error", UserWarning)  # a layout that collapses, a letter that is missing
            figure = draw()
            figure.draw_without_rendering()
            found += [f"{title}: {each}" for each in faults(figure, is_si=in_units or "SI" in title)]
        if title.endswith(("snapshots", "movie", "cases")):
            assert contacts(figure) <= {CONTACT}
            named = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
            assert bool(contacts(figure)) == ("contact" in named)
        if title.endswith(("one column", "talk")) or "columns" in title:
            assert 1 <= min(curves(figure)) <= max(curves(figure)) <= complete, title
            assert max(curves(figure)) == complete or complete > SHOWN, title
        empty = [axes for axes in figure.axes if axes.axison and not axes.has_data()]
        found += [f"{title}: an empty panel" for _ in empty]
    assert found == []


@pytest.mark.parametrize("name", [*FEW, pytest.param("electroadhesion-quick", marks=pytest.mark.slow)])
def test_a_report_has_labels_with_units_and_the_colour_of_contact(name, folder):
    path = SCRIPT["run"](name, folder)
    assert main(["report", str(path)]) == 0
    page = (path / "report.html").read_text()
    found = re.search(r'id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    data = json.loads(found[1])
    assert data["contact"] == CONTACT
    labels = [*data["fields"].values(), *(each["label"] for each in data["columns"])]
    titles = [title for key in data["keys"] for title in key["titles"]]
    assert not [each for each in [*labels, *titles] if re.search(r"[$\\]|nan|10[⁻⁰-⁹]+\)", each)]
    assert {
        bool(re.search(r"\((µ|n|m|k|M)?(m|Pa)\)", data["fields"][each])) for each in ("x", "pressure")
    } == {"\nunits:" in (path / "config.yaml").read_text()}
