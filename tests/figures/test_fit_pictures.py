"""The pictures of fits and of force maps, dimensionless and in SI: legible texts, units, and data."""

import math
import warnings

import numpy as np
import pytest

from gfmdlayer import ForceCurve, fit_indentation
from gfmdlayer.figures.map_plots import fit_map_figure
from gfmdlayer.figures.plot_style import styled
from gfmdlayer.fitting import material
from gfmdlayer.fitting.laws import fit
from gfmdlayer.fitting.measurement import read
from gfmdlayer.fitting.result import fit_figure
from tests.figures.test_everything import faults, labels

UNITS = {"length": "um", "stress": "kPa", "time": "s"}  # kPa um^2 = nN


def of_a_master_curve(folder, *, si):
    omega = np.geomspace(1e-3, 1e4, 40)
    storage, loss = (1e6 * part for part in (1 + 9 * omega**2 / (1 + omega**2), 9 * omega / (1 + omega**2)))
    head = "f [Hz], G' [Pa], G'' [Pa]" if si else "omega,G',G''"
    rows = "\n".join(f"{a},{b},{c}" for a, b, c in zip(omega, storage, loss, strict=True))
    (folder / "curve.csv").write_text(f"{head}\n{rows}\n")
    return material.fit_figure(fit(read(folder / "curve.csv"), branches=2))


def of_a_relaxation_curve(folder, *, si):
    time = np.geomspace(1e-3, 1e3, 40)
    head = "t [s], G [Pa]" if si else "t,G"
    rows = "\n".join(f"{a},{b}" for a, b in zip(time, 1 + 0.2 * np.exp(-time), strict=True))
    (folder / "curve.csv").write_text(f"{head}\n{rows}\n")
    return material.fit_figure(fit(read(folder / "curve.csv")))


def of_a_force_curve(_folder, *, si):
    time = np.linspace(0.0, 4.0, 41)
    depth = np.interp(time, [0, 1, 4], [0, 0.2, 0.2])
    noise = 0.05 * np.random.default_rng(0).standard_normal(time.size)
    force = 8 / 3 * 5.0**0.5 * depth**1.5 / 0.5 + noise
    model = {
        "layer": {"thickness": math.inf, "material": {"model": "zener", "G0": 1.0, "Ginf": 1.0}},
        "punch": {"shape": "parabola", "radius": 5.0},
    }
    curves = [ForceCurve(name, time, depth, factor * force) for name, factor in (("a", 1.0), ("b", 1.1))]
    return fit_figure(
        fit_indentation(curves, model | ({"units": UNITS} if si else {}), ["layer.material.G0"])
    )


def of_a_map(shape, *, si):
    """A force map of moduli and a thickness, of which one curve failed."""
    import xarray

    dims = ("y", "x") if len(shape) == 2 else ("curve",)
    stress, length = ("Pa", "m") if si else ("pressure", "length")
    values = 2e4 * (1 + np.arange(math.prod(shape)).reshape(shape) / 10)
    values.flat[1] = np.nan
    held = {}
    for name, unit, size in (("G0", stress, 1.0), ("thickness", length, 5e-12)):
        for end, part in (("", 1.0), ("_error", 0.05), ("_low", 0.9), ("_high", 1.1)):
            held[name + end] = (dims, size * part * values, {"units": unit, "long_name": name})
    size = 1e-6 if si else 1.0
    coords = {
        name: (name, size * np.arange(n), {"units": length}) for name, n in zip(dims, shape, strict=True)
    }
    if dims == ("curve",):
        coords = {"curve": ("curve", np.arange(shape[0]), {})}
    attrs = {"fitted": "G0 thickness", "failed": "0001: curve b: CurveError"}
    return fit_map_figure(xarray.Dataset(held, coords, attrs))


DRAWN = {
    "master curve": of_a_master_curve, "relaxation curve": of_a_relaxation_curve,
    "force curve": of_a_force_curve, "map": lambda _, *, si: of_a_map((5, 7), si=si),
    "curves in a row": lambda _, *, si: of_a_map((12,), si=si),
}  # fmt: skip


@pytest.mark.parametrize("si", [False, True])
@pytest.mark.parametrize("kind", DRAWN)
def test_the_picture_of_a_fit_is_legible_and_complete(kind, si, tmp_path):
    with styled(), warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        figure = DRAWN[kind](tmp_path, si=si)
        figure.draw_without_rendering()
        assert [*faults(figure, is_si=si)] == []
    assert not [axes for axes in figure.axes if axes.axison and not axes.has_data()]
    drawn = [axis for axes in figure.axes if axes.lines for axis in (axes.xaxis, axes.yaxis)]
    assert all(len(labels(axis)) >= 2 for axis in drawn if axis.get_label_text())
    if si:
        written = [words for axes in figure.axes for words in (axes.get_xlabel(), axes.get_ylabel()) if words]
        bare = [words for words in written if "(" not in words and words != "curve"]
        assert not bare
