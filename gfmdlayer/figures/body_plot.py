"""The body of a case: its layers with their thicknesses, and the relaxation of their shear moduli.

Layers that are thin beside the others are drawn thicker than to scale.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gfmdlayer.body.bodies import code_refused
from gfmdlayer.body.layers import Layers
from gfmdlayer.body.wavevectors import Wavevectors
from gfmdlayer.config import Config, load
from gfmdlayer.config.sweeps import combinations
from gfmdlayer.drives import Drives
from gfmdlayer.figures.labels import Quantity, finish, name_axes
from gfmdlayer.figures.plot_style import PAPER, Style, colours, new_figure, styled
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import case_path, stored_config
from gfmdlayer.results.stored import case_numbers, document, is_stored, must_agree

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from gfmdlayer.body.materials import Law

LEAST_HEIGHT = 0.12  # of a layer, relative to that of all: its label fits
BASE_HEIGHT = 0.25  # of the halfspace
DECADES = 6  # of time up to the end of the run
_STIFFNESS = "pressure / length"
CLEAREST, PALEST = 0.55, 0.2  # opacity of the stiffest and of the softest layer


class Block(NamedTuple):
    """A layer or halfspace in the picture, of finite stiffness."""

    label: str
    thickness: float
    law: Law | None  # None: an elastic halfspace
    modulus: float  # of the relaxed material, in the units of the configuration


def config_of(path: Path, case: int | None, *, trust: bool = False) -> tuple[Config, str]:
    """Return the configuration of a YAML file or of a case, by default the first of a folder; and a title.

    Code that results name is run only with `trust`.
    """
    if path.suffix in {".yaml", ".yml"}:
        with code_refused(not trust and is_stored(path)):
            return load(path), ""
    if path.is_file():
        return stored_config(path, trust=trust), ""
    file, number = case_path(path, case or 0), len(list(path.glob("cases/*.h5")))
    config = path / "config.yaml"
    if not file.exists() and config.exists():  # not complete: a body needs no results
        numbers, swept = case_numbers(config), combinations(document(config).get("sweep") or {})
        must_agree(config, numbers, len(swept))
        values = dict(zip(numbers, swept, strict=True))
        if (case or 0) not in values:
            raise ResultsError(f"{path}: there is no case {case}; must be from 0 to {max(values)}")
        with code_refused(not trust):
            return load(config).with_values(values[case or 0]), ""
    title = f"case {case or 0:04d}, {'the first ' * (case is None)}of {number}" if number > 1 else ""
    return stored_config(file, trust=trust), title


def body_figure(config: Config, style: Style = PAPER, title: str = "") -> Figure:
    """Draw the layers and the relaxation of their moduli; ResultsError for a sweep over the body."""
    if any(key.split(".")[0] in {"body", "layer", "layers", "halfspace"} for key in config.sweep):
        raise ResultsError(f"{config.name}: the body differs between the cases; draw a case of the results")
    body = config.solid
    if not isinstance(body, Layers):
        return _response_figure(config, style, title)
    blocks = _blocks(body)
    shades = colours(len(blocks))
    with styled(style):
        figure = new_figure(2, 62.0, style)
        section, moduli = figure.subplots(1, 2, width_ratios=(1, 1.2))
        _draw_section(section, config, body, blocks, shades)
        times = np.geomspace(config.time.end * 10.0**-DECADES, config.time.end, 121)
        for block, shade in zip(blocks, shades, strict=True):
            values = np.full(times.size, block.modulus)
            if block.law is not None:
                values = block.law.relaxation_modulus(times)
            moduli.loglog(times, values, color=shade, label=block.label)
        name_axes(moduli, _quantity(config, "$t$", "time"), _quantity(config, "$G$", "pressure"))
        moduli.set_xlim(times[0], times[-1])
        moduli.legend()
        section.set_title(title, loc="left")
        symbols = ["$d$: thickness", r"$\nu$: Poisson's ratio", "$G$: relaxation modulus", "$t$: time"]
        finish(figure, symbols + _as_configured(config))
    return figure


def _response_figure(config: Config, style: Style, title: str) -> Figure:
    """Draw the stiffness of a body against the wavenumber, along x and along y, and how it relaxes."""
    body = config.solid.with_series([each.material for each in Drives(config).series()], 0.0)
    cell = list(zip(config.grid.points, config.grid.period, strict=True))
    q = math.pi * np.geomspace(2 / max(config.grid.period), max(n / length for n, length in cell), 121)
    along = {"$q_x$": Wavevectors.of_components(q)}
    if len(config.grid.points) == 2:
        along["$q_y$"] = Wavevectors.of_components(0.0, q)
    with styled(style):
        figure = new_figure(2, 62.0, style)
        stiffness, relaxation = figure.subplots(1, 2)
        times = np.geomspace(config.time.end * 10.0**-DECADES, config.time.end, 121)
        for (name, waves), shade in zip(along.items(), colours(len(along)), strict=True):
            spectrum = body.spectrum(waves)
            stiffness.loglog(q, spectrum.relaxed, color=shade, label=f"along {name}")
            stiffness.loglog(q, spectrum.glassy, color=shade, linestyle="--")
            kept = (spectrum.weights[:, 0] * np.exp(-times[:, np.newaxis] / spectrum.times[:, 0])).sum(axis=1)
            relaxation.loglog(times, spectrum.relaxed[0] + kept, color=shade, label=f"along {name}")
        along_y = _quantity(config, "$K$", _STIFFNESS)
        name_axes(stiffness, _quantity(config, "$q$", "1 / length"), along_y)
        stiffness.set_title(f"{title}\nrelaxed, and sudden (dashed)".strip())
        name_axes(relaxation, _quantity(config, "$t$", "time"), along_y)
        relaxation.set_title("at the longest wave")
        relaxation.set_xlim(times[0], times[-1])
        for axes in (stiffness, relaxation):
            axes.legend()
        symbols = ["$K$: stiffness, pressure over displacement", "$q$: wavenumber", "$t$: time"]
        finish(figure, symbols + _as_configured(config))
    return figure


def _blocks(body: Layers) -> list[Block]:
    several, base = len(body.above) > 1, body.base
    blocks = [
        Block(f"layer {i}" if several else "layer", layer.thickness, layer.material, layer.material.unit)
        for i, layer in enumerate(body.above, 1)
        if layer.thickness
    ]
    if blocks and math.isinf(blocks[-1].thickness):
        return blocks
    if base.material is not None:
        return [*blocks, Block("halfspace", math.inf, base.material, base.material.unit)]
    if base.shear_modulus and math.isfinite(base.shear_modulus):
        return [*blocks, Block("halfspace", math.inf, None, base.shear_modulus)]
    return blocks


def _draw_section(axes: Axes, config: Config, body: Layers, blocks: list[Block], shades: list[str]) -> None:
    finite = [block.thickness for block in blocks if math.isfinite(block.thickness)]
    total = sum(finite) or 1.0
    heights = [
        max(block.thickness / total, LEAST_HEIGHT) if math.isfinite(block.thickness) else BASE_HEIGHT
        for block in blocks
    ]
    poissons = [layer.poisson for layer in body.present]
    logarithms = np.log([block.modulus for block in blocks])
    span = float(np.ptp(logarithms)) or 1.0
    top = 0.0
    for i, (block, height) in enumerate(zip(blocks, heights, strict=True)):
        opacity = PALEST + (CLEAREST - PALEST) * float(logarithms[i] - logarithms.min()) / span
        axes.axhspan(top - height, top, color=shades[i], alpha=opacity, linewidth=0)
        axes.axhline(top, color="black", linewidth=0.6)
        written = f"{block.label}: {_quantity(config, '$d$', 'length').equals([block.thickness])[0]}"
        if math.isinf(block.thickness):
            written = block.label
        axes.text(0.5, top - height / 2, rf"{written}, $\nu$ = {poissons[i]:g}", ha="center", va="center")
        top -= height
    if not math.isinf(blocks[-1].thickness):
        rigid = body.base.shear_modulus != 0
        axes.axhline(top, color="black", linewidth=0.6)
        axes.axhspan(top - 0.07, top, fill=False, hatch="////" if rigid else "", linewidth=0)
        axes.text(0.5, top - 0.12, "rigid base" if rigid else "free", ha="center", va="top")
        top -= 0.25
    axes.set(xlim=(0, 1), ylim=(top, 0.06))
    axes.axis("off")


def _as_configured(config: Config) -> list[str]:
    """Note for a configuration that names no units."""
    return [] if config.units else ["numbers in the units of the configuration"]


def _quantity(config: Config, symbol: str, words: str) -> Quantity:
    return Quantity(symbol, "" if config.units is None else config.unit(words))
