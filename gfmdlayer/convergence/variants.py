"""The variations of a case: one numerical choice at a time, on grids coarser than its own.

source      runs besides the case                     expected order
points      n 3/8, n/2, n 5/8: not all nested         counted areas 1, interpolated ones 3/2, others 2
step        x 2, x 1, x 1/2 on n/2                    2; backward Euler 1
tolerance   of adaptive steps, x 10, x 1, x 1/10      2/3
solver      x 1/10 on n/2; modes of a stack merge     1
            to its tolerance too
law ...     `tolerance` of a law, x 10, x 1/10        1
period      of an isolated contact, x 5/4             1
images      of a punch in a periodic cell: without    none: outside of the sum
            them, on n 3/8

Nested grids share the summits of a rough surface and the phases of edges: depths on 64 x 64 and 128 x 128
points agreed within 5e-5, with an error of 2e-3. On n/2 the errors of the other sources scale as those on n.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gfmdlayer.body.continuous import ContinuousLaw
from gfmdlayer.body.materials import Law
from gfmdlayer.config import Config, ConfigError
from gfmdlayer.punch.shape import Analytic
from gfmdlayer.study.cases import Cases, errors_of
from gfmdlayer.validation.problems import dotted_key
from gfmdlayer.validation.sections import sections_in

COARSER = (8 / 3, 2.0, 1.6)  # spacings of the other grids, in spacings of the case
FINER = (3 / 4, 1 / 2)  # where the coarser ones are refused or fail
CHEAP = 2.0  # spacing of the grid on which the other sources are varied
WIDER = 1.25  # period of an isolated contact
FEWEST = 8  # points along an axis
LOOSEST, FINEST = 0.3, 1e-12  # tolerances

COUNTED = frozenset(
    {"contact_area", "area", "stick_area", "attractive_area", "attracted_area", "yielded_area"}
)
EDGES = frozenset({"contact_area_interpolated", "area_interpolated", "contact_radius"})

Values = dict[str, Any]


@dataclass
class Source:
    """A numerical choice, and its variations: size -> swept keys and their values."""

    name: str
    key: str  # of the configuration
    ladder: dict[float, Values] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)  # why a variation is no case
    summed: bool = True  # whether its error is a part of the sum


def expected_order(source: str, column: str, config: Config) -> float:
    """Return the order in which the error of a column falls."""
    match source:
        case "points":
            return 1.0 if column in COUNTED else 1.5 if column in EDGES else 2.0
        case "step":
            return 1.0 if config.time.integrator == "backward_euler" else 2.0
        case "tolerance":
            return 2 / 3
    return 1.0


class Variations:
    """The sources of a case, as rows of swept keys; all rows have the same keys.

    Parameters
    ----------
    config : Config
        The case.
    times : sequence of float
        Times at which the runs are compared; adaptive steps land on them.
    """

    def __init__(self, config: Config, times: Sequence[float]) -> None:
        self.config, self._gridded = config, config.grid.geometry != "axisymmetric"
        self._adaptive = config.time.step == "adaptive"
        self._laws = [
            f"{dotted_key(at)}.tolerance" for at, law in sections_in(config)
            if isinstance(law, Law) and isinstance(law, ContinuousLaw)
        ]  # fmt: skip
        self.base: Values = {
            "grid.points": _plain(config.grid.points),
            "grid.period": _plain(config.grid.period),
        }
        if self._gridded:
            self.base["solver.tolerance"] = config.solver.tolerance
            self.base["grid.boundary"] = _plain(config.grid.boundary or ("periodic",))
        if config.time.tolerance is not None:
            self.base["time.tolerance"] = config.time.tolerance
        if not isinstance(config.time.step, str):
            self.base["time.step"] = config.time.step
        if self._adaptive:
            self.base["output.times"] = list(times)
        for key in self._laws:
            self.base[key] = self._value(key)
        self.sources = list(self._sources(CHEAP))

    def _value(self, key: str) -> float:
        at: Any = self.config
        for part in key.split("."):
            at = at[int(part)] if part.isdigit() else getattr(at, part)
        return float(at)

    @property
    def rows(self) -> list[Values]:
        """All variations, each once, the case itself first."""
        every = [self.base, *(values for source in self.sources for values in source.ladder.values())]
        return [values for i, values in enumerate(every) if values not in every[:i]]

    def without(self, failed: Sequence[Values]) -> bool:
        """Take out variations that failed, and put others in the place of coarse grids; whether any did."""
        changed = False
        for source in self.sources:
            left = {size: values for size, values in source.ladder.items() if values not in failed}
            if len(left) == len(source.ladder):
                continue
            source.ladder = left
            if source.name == "points" and len(left) < 3:
                changed |= self._add(source, FINER, self.points)
            elif source.name != "points" and 1.0 not in left and self.base not in failed:
                changed = True
                again = next(each for each in self._sources(1.0) if each.name == source.name)
                source.ladder, source.refused = again.ladder, again.refused
        return changed

    def spacing(self, values: Values) -> float:
        """Return the spacing of a variation in spacings of the case."""
        (n, *_), (m, *_) = _every(self.base["grid.points"]), _every(values["grid.points"])
        (L, *_), (other, *_) = _every(self.base["grid.period"]), _every(values["grid.period"])
        return float(n / m * other / L)

    def points(self, size: float) -> Values:
        """Return the case on a grid whose spacing is larger by a factor, about."""
        points = [near(n, size) for n in _every(self.base["grid.points"])]
        return self.base | {"grid.points": _plain(points)}

    def _sources(self, cheap: float) -> Iterator[Source]:
        """Yield the sources; those of other choices than the points on a coarser grid, if it is a case."""
        small = self.base
        if self._gridded:
            points = Source("points", "grid.points", {1.0: self.base})
            self._add(points, COARSER, self.points)
            if len(points.ladder) < 3:
                self._add(points, FINER, self.points)
            yield points
            if cheap != 1 and not self._refusal(self.points(cheap)):
                small = self.points(cheap)
        yield from self._of_time(small)
        if self._gridded:
            yield self._tolerance("solver", "solver.tolerance", (1.0, 0.1), small)
        for key in self._laws:
            yield self._tolerance(f"law {key.removesuffix('.tolerance')}", key, (10.0, 1.0, 0.1), small)
        if self.config.grid.isolated:
            period = Source("period", "grid.period", {1.0: self.base})
            self._add(period, (1 / WIDER,), self._wider)
            yield period
        elif self._gridded and self._alone:
            coarse = self.points(COARSER[0])
            images = Source("images", "grid.boundary", {1.0: coarse}, summed=False)
            self._add(images, (0.0,), lambda _: coarse | {"grid.boundary": "isolated"})
            if len(images.ladder) > 1:
                yield images

    @property
    def _alone(self) -> bool:
        """Whether the cell holds a single punch whose images are not meant."""
        return isinstance(self.config.punch, Analytic) and len(self.config.grid.points) == 2

    def _of_time(self, small: Values) -> Iterator[Source]:
        if "time.tolerance" in self.base:
            yield self._tolerance("tolerance", "time.tolerance", (10.0, 1.0, 0.1), small)
        elif "time.step" in self.base and self._gridded:
            step = Source("step", "time.step", {1.0: small})
            self._add(step, (2.0, 0.5), lambda size: small | {"time.step": self.base["time.step"] * size})
            if self.base["time.step"] < self.config.time.end / 2:
                yield step

    def _tolerance(self, name: str, key: str, sizes: Sequence[float], small: Values) -> Source:
        source, value = Source(name, key, {1.0: small}), self.base[key]
        allowed = [size for size in sizes if size != 1 and FINEST <= value * size < LOOSEST]
        self._add(source, allowed, lambda size: small | {key: float(f"{value * size:.12g}")})
        return source

    def _wider(self, size: float) -> Values:
        points, every = self.points(size)["grid.points"], _every(self.base["grid.points"])
        alone = self.config.grid.without_images.isolated
        each = zip(_every(points), every, alone, strict=True)
        wider = self.base | {"grid.points": _plain([m if free else n for m, n, free in each])}
        pairs = zip(*(_every(each["grid.points"]) for each in (wider, self.base)), strict=True)
        lengths = _every(self.base["grid.period"])
        period = [L * m / n for L, (m, n) in zip(lengths, pairs, strict=True)]
        return wider | {"grid.period": _plain(period)}

    def _add(self, source: Source, sizes: Sequence[float], varied: Callable[[float], Values]) -> bool:
        """Add the variations that are cases; keep the reasons of the others."""
        added = False
        for size in sizes:
            values = varied(size)
            if values in source.ladder.values():
                continue
            if reason := self._refusal(values):
                source.refused.append(reason)
                continue
            by_points = source.name == "points"
            source.ladder[self.spacing(values) if by_points else float(size)] = values
            added = True
        return added

    def _refusal(self, values: Values) -> str:
        """Return why a variation is no case; empty for one."""
        try:
            varied = self.config.with_values(
                {key: values[key] for key in values if values[key] != self.base[key]}
            )
            problems = [f"{key}: {message}" for key, message in errors_of(Cases(varied))]
        except ConfigError as error:
            problems = list(error.problems)
        return problems[0] if problems else ""


def near(n: int, size: float) -> int:
    """Return points close to n/size, with factors 2, 3, 5 for the FFTs and the parity of n for symmetry."""
    wanted = n / size
    lowest, highest = max(FEWEST, math.floor(0.96 * wanted)), math.ceil(1.04 * wanted)
    among = sorted(range(lowest, highest + 1), key=lambda m: abs(m - wanted))
    alike = [m for m in among if (m - n) % 2 == 0] or [max(FEWEST, round(wanted))]
    return next(filter(is_smooth, alike), alike[0])


def is_smooth(m: int) -> bool:
    """Whether a number has no other prime factors than 2, 3 and 5."""
    for factor in (2, 3, 5):
        while m % factor == 0:
            m //= factor
    return m == 1


def _every(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def _plain(values: Sequence[Any]) -> Any:
    return values[0] if len(values) == 1 else list(values)


def corners(cases: Sequence[Mapping[str, object]]) -> list[int]:
    """Return the places of the corners and of the middle of a sweep: of each key the first and last value.

    Of a list of combinations these are the first, the last and the one between.
    """
    values = {
        key: sorted({_shown(case[key]): i for i, case in enumerate(cases)}.items(), key=lambda e: e[1])
        for key in cases[0]
    }
    ends = {key: {texts[0][0], texts[-1][0]} for key, texts in values.items()}
    found = [i for i, case in enumerate(cases) if all(_shown(case[key]) in ends[key] for key in case)]
    return sorted({0, *found, len(cases) // 2, len(cases) - 1})


def _shown(value: object) -> str:
    return repr(value)
