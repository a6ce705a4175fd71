"""Files of measured surfaces in random dialects, with known heights: `make(seed, folder)`.

Orientation, units, sizes, holes, headers, separators, decimal marks, encodings, orders of rows, and formats
differ. The truth has the heights that are written, to the last digit.
"""

from typing import NamedTuple

import numpy as np
import xarray as xr

from gfmdlayer.grid.grid import Grid
from gfmdlayer.punch.scan import Keys

METRES = {"m": 1, "mm": 1e-3, "µm": 1e-6, "um": 1e-6, "nm": 1e-9, "Å": 1e-10}
WIDTH = {
    "en": ("Width", "Height", "Value units"), "de": ("Breite", "Höhe", "Einheiten"),
    "fr": ("Largeur", "Hauteur", "Unités"), "it": ("Larghezza", "Altezza", "unità valore"),
}  # fmt: skip


class Dialect(NamedTuple):
    """A file and what it means."""

    file: object
    heights: np.ndarray  # in the configuration's unit; NaN where there is a hole
    grid: Grid
    length: str | None  # unit of the configuration
    keys: Keys  # which settle all that the file leaves open
    open: Keys  # without one of them, if the file needs one; a refusal must follow
    kind: str


def make(seed, folder):
    """Write the file of a seed; return what it means."""
    random = Random(seed)
    kind = random.pick("matrix", "matrix", "matrix", "points", "points", "line", "labelled", "labelled")
    surface = Surface(random, 1 if kind == "line" else 2)
    return globals()[f"_{kind}"](random, surface, folder)


class Random:
    """Choices of a seed."""

    def __init__(self, seed):
        self.generator = np.random.default_rng(seed)

    def pick(self, *choices):
        return choices[self.generator.integers(len(choices))]

    def chance(self, part):
        return bool(self.generator.random() < part)


class Surface:
    """Heights and lengths in SI, the units of the file and of the configuration."""

    def __init__(self, random, axes):
        g = random.generator
        self.random = random
        self.points = tuple(int(n) for n in g.permutation(np.arange(4, 13))[:axes])
        self.unit, self.across = random.pick(*METRES), random.pick(*METRES)
        self.length = random.pick("um", "um", "mm", "nm", "m")
        self.in_file = tuple(float(f"{x:.3g}") for x in g.uniform(2, 30, axes))  # lengths in `across`
        self.heights = g.normal(size=self.points) * 10.0 ** g.integers(-1, 3)
        self.holes = np.zeros(self.points, bool)
        if random.chance(0.35):
            self.holes = g.random(self.points) < 0.15
        self.decimal = random.pick(".", ".", ",")

    @property
    def period(self):
        ratio = METRES[self.across] / METRES[self.length]
        return tuple(x * ratio for x in self.in_file)

    @property
    def grid(self):
        return Grid(self.points, self.period)

    @property
    def spacing(self):
        return [x / n for x, n in zip(self.in_file, self.points, strict=True)]

    def text(self, number, style):
        written = f"{number:{style}}"
        return written.replace(".", self.decimal), float(written)

    def true(self, written):
        return written * (METRES[self.unit] / METRES[self.length])


def _styled(random):
    return random.pick(".6g", ".5e", ".4f", ".5f")


def _hole(random, by_space):
    return random.pick("NaN", "nan", "Bad", "--", "***", "n/a", "-9999", *(() if by_space else ("",)))


def _encoded(random, text, file):
    encoding = random.pick("utf-8", "utf-8", "utf-8-sig", "utf-16", "cp1252")
    try:
        data = random.pick("\n", "\n", "\r\n").join(text).encode(encoding)
    except UnicodeEncodeError:
        data = "\n".join(text).encode()
    file.write_bytes(data)


def _separator(random, decimal):
    return random.pick(*(("\t", ";", " ", "  ", "\t ") if decimal == "," else ("\t", ";", " ", "  ", ",")))


def _finish(surface, keys, heights, mark, holes, file, kind, unsettled=()):
    """Return the dialect; each key of `unsettled` is needed."""
    if unsettled == ("NODATA",):  # which the header says
        mark, unsettled = "", ()
    if mark == "-9999" and holes.any():
        keys, unsettled = keys._replace(hole=-9999.0), (*unsettled, "hole")
    open_ = keys
    if unsettled:
        name = unsettled[surface.random.generator.integers(len(unsettled))]
        open_ = keys._replace(**{name: None})
    truth = np.where(holes, np.nan, surface.true(heights))
    return Dialect(file, truth, surface.grid, surface.length, keys, open_, kind)


def _matrix(random, surface, folder):
    style, separator = _styled(random), _separator(random, surface.decimal)
    by_space = not separator.strip(" ")
    mark = _hole(random, by_space)
    transpose = random.chance(0.2)
    cells = [[surface.text(h, style) for h in column] for column in surface.heights]
    written = np.array([[value for _, value in column] for column in cells])
    shown = [
        [mark if hole else text for (text, _), hole in zip(*column, strict=True)]
        for column in zip(cells, surface.holes, strict=True)
    ]
    rows = shown if transpose else list(map(list, zip(*shown, strict=True)))  # lines are y
    lines = [separator.join(row) for row in rows]
    header, keys, unsettled = _header(random, surface, transpose)
    if header and random.chance(0.3):
        header.append("")
    file = folder / f"scan{random.pick('.txt', '.asc', '.csv', '.dat', '.xyz', '')}"
    _encoded(random, [*header, *lines, ""], file)
    return _finish(
        surface, keys._replace(transpose=transpose), written, mark, surface.holes, file, "matrix", unsettled
    )


def _header(random, surface, transpose):
    """Return lines of a header, the keys for what they leave open, and which of these are needed."""
    # A file whose rows are x calls the direction of its rows width.
    (lx, ly), (nx, ny), (dx, dy) = (
        pair[::-1] if transpose else pair for pair in (surface.in_file, surface.points, surface.spacing)
    )
    across, unit = surface.across, surface.unit
    comment = random.pick("# ", "% ", "#", "")
    mark = random.pick(".", ".", surface.decimal)

    def number(x):
        return f"{x:.10g}".replace(".", mark)

    style = random.pick("none", "gwyddion", "gwyddion", "spip", "conversion", "brackets", "esri", "no values")
    if style == "none":
        unit_key = METRES[unit] / METRES[surface.length] if random.chance(0.5) else unit
        return [], Keys(unit=unit_key), ()
    if style in {"gwyddion", "no values"}:
        width, height, values = WIDTH[random.pick(*WIDTH)]
        lines = [
            f"{comment}Channel: Z",
            f"{comment}{width}: {number(lx)} {across}",
            f"{comment}{height}: {number(ly)} {across}",
        ]
        if style == "gwyddion":
            return [*lines, f"{comment}{values}: {unit}"], Keys(), ()
        return lines, Keys(unit=unit), ("unit",)
    if style == "spip":
        lines = [f"x-pixels = {nx}", f"y-pixels = {ny}", f"x-length = {number(lx)}"]
        lines += [f"y-length = {number(ly)}", f"x-unit = {across}", f"y-unit = {across}", f"z-unit = {unit}"]
        return [f"# {line}" for line in lines], Keys(), ()
    if style == "conversion":
        lines = [f"h={ny} w={nx}", f"x step = {dx:.10g} {across}", f"y step = {dy:.10g} {across}"]
        return [*lines, "data unit=rad", f"height conversion factor (-> {unit})=1.0"], Keys(), ()
    if style == "brackets":
        equals = random.pick(":", "=", ";")
        lines = [f"Operator{equals} Müller", f"Width [{across}]{equals} {number(lx)}"]
        lines += [f"Height [{across}]{equals} {number(ly)}", f"Z unit{equals} {unit}"]
        return [f"{comment}{line}" for line in lines], Keys(), ()
    corner = ["xllcorner 0.0", "yllcorner 0.0"]
    return [f"ncols {nx}", f"nrows {ny}", *corner, "NODATA_value -9999"], Keys(unit=unit), ("NODATA",)


def _points(random, surface, folder):
    style, separator = random.pick(".8g", ".7e"), _separator(random, surface.decimal)
    by_space = not separator.strip(" ")
    mark = _hole(random, by_space)
    start = random.generator.uniform(-3, 3, 2)
    position = [a + d * np.arange(n) for a, d, n in zip(start, surface.spacing, surface.points, strict=True)]
    x, y = (each.ravel() for each in np.meshgrid(*position, indexing="ij"))
    written = np.array([surface.text(h, style)[1] for h in surface.heights.ravel()])
    holes = surface.holes.ravel()
    z = [
        mark if hole else surface.text(h, style)[0]
        for h, hole in zip(surface.heights.ravel(), holes, strict=True)
    ]
    columns = {
        "x": [surface.text(a, ".8g")[0] for a in x],
        "y": [surface.text(a, ".8g")[0] for a in y],
        "z": z,
    }
    order = random.pick(None, None, "x", "y", "random")
    rows = np.arange(x.size)
    if order == "x":
        rows = np.lexsort((x, y))
    elif order == "y":
        rows = np.lexsort((-x, -y))
    elif order == "random":
        rows = random.generator.permutation(x.size)
    headed = random.chance(0.7)
    names, keys, unsettled = ["x", "y", "z"], Keys(), ()
    lines = []
    if headed:
        names = [str(name) for name in random.generator.permutation(names)]
        glue = "_" if by_space else " "
        say = random.pick("[", "(", "row", "none")
        words = {
            "x": random.pick("x", "X"),
            "y": random.pick("y", "Y"),
            "z": random.pick("z", "Z", "height", "Höhe"),
        }
        units = {"x": surface.across, "y": surface.across, "z": surface.unit}
        close = {"[": "]", "(": ")"}.get(say, "")
        lines = [
            separator.join(f"{words[n]}{glue}{say}{units[n]}{close}" if close else words[n] for n in names)
        ]
        if say == "row":
            lines.append(separator.join(units[n] for n in names))
        if random.chance(0.2):
            lines[:0] = ["Messung 3", ""]
    if not headed or say == "none":
        surface.unit = surface.across  # numbers without units are all in one
        keys = Keys(unit=surface.across)
    lines += [separator.join(columns[name][row] for name in names) for row in rows]
    file = folder / f"points{random.pick('.txt', '.asc', '.csv', '.xyz')}"
    _encoded(random, [*lines, ""], file)
    written, holes = written.reshape(surface.points), surface.holes
    return _finish(surface, keys, written, mark, holes, file, "points", unsettled)


def _line(random, surface, folder):
    style, separator = random.pick(".8g", ".7e"), _separator(random, surface.decimal)
    (n,), (length,) = surface.points, surface.in_file
    grid = np.arange(n) * (length / n)
    x = grid + random.pick(0.0, random.generator.uniform(-5, 5))
    names = ["x", "z"]
    flip = random.chance(0.3)
    headed = random.chance(0.6)
    rows = [
        (surface.text(a, ".12g")[0], surface.text(h, style)) for a, h in zip(x, surface.heights, strict=True)
    ]
    written = np.array([h for _, (_, h) in rows])
    table = [{"x": a, "z": h} for a, (h, _) in rows]
    if flip:
        table.reverse()
    keys, lines = Keys(unit=surface.across), []
    if headed:
        names = [str(name) for name in random.generator.permutation(names)]
        units = {"x": surface.across, "z": surface.unit}
        lines = [separator.join(f"{name}[{units[name]}]" for name in names)]
        keys = Keys()
    else:
        surface.unit = surface.across
    lines += [separator.join(row[name] for name in names) for row in table]
    file = folder / f"line{random.pick('.txt', '.asc', '.csv', '.prf')}"
    _encoded(random, [*lines, ""], file)
    return _finish(surface, keys, written, "", np.zeros(n, bool), file, "line")


def _labelled(random, surface, folder):
    heights = np.where(surface.holes, np.nan, surface.heights)
    x, y = (d * np.arange(n) + 1.0 for d, n in zip(surface.spacing, surface.points, strict=True))
    data = xr.Dataset({"height": (("x", "y"), heights)}, {"x": x, "y": y})
    said = random.pick("all", "all", "no values", "none")
    for name in "xy":
        if said != "none":
            data[name].attrs[random.pick("units", "unit")] = surface.across
    keys, unsettled = Keys(), ()
    if said == "all":
        data.height.attrs[random.pick("units", "unit")] = surface.unit
    elif said == "no values":
        keys, unsettled = Keys(unit=surface.unit), ("unit",)
    else:
        surface.unit = surface.across
        keys = Keys(unit=surface.unit)
    if random.chance(0.5):
        data = data.transpose("y", "x")
    if random.chance(0.3):
        data = data.isel(y=slice(None, None, -1))
    engine = random.pick("h5netcdf", "scipy")
    file = folder / f"grid{random.pick('.nc', '.h5', '.hdf5', '.dat')}"
    data.to_netcdf(file, engine=engine)
    return _finish(surface, keys, surface.heights, "", surface.holes, file, "labelled", unsettled)
