"""One configuration, many cases.

A sweep is a product of values and of lists of combinations (`gfmdlayer.config.sweeps`), the last key running
fastest; without one there is a single case.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass

from gfmdlayer.config import Config
from gfmdlayer.config.sweeps import as_label, combinations

_ROWS = 200  # of adaptive steps in a sweep, where no output times are asked for


@dataclass(frozen=True)
class Case:
    """One simulation of a sweep.

    Attributes
    ----------
    index : int
        Its number, that of its file.
    config : Config
        What is simulated; its sweep is empty.
    values : dict
        The swept keys, dotted, and their values in this case.
    """

    index: int
    config: Config
    values: dict[str, object]

    @property
    def kind(self) -> Hashable:
        """Cases of one kind use the same compiled kernels and planned transforms, and cost alike."""
        solver, time, trajectory, kept = (
            self.config.solver, self.config.time, self.config.trajectory, self.config.output.histograms,
        )  # fmt: skip
        numerics = solver.method, solver.inertia, time.integrator, time.step == "adaptive"
        histograms = kept.pressure is not None or kept.gap is not None
        return self.config.grid.points, *numerics, trajectory.control, trajectory.moves, histograms


def cases(config: Config) -> list[Case]:
    """Return the cases of a configuration, the last swept key fastest.

    Where steps are adaptive and no output times are asked for, the cases of a sweep land on a spacing of
    end/200, so that their curves share a time axis.

    Raises
    ------
    ConfigError
        Where a combination of values is not possible.
    """
    found = []
    for index, values in enumerate(combinations(config.sweep)):
        case = config.with_values(values)
        if config.sweep and case.time.step == "adaptive" and case.output.times is None:
            case = case.with_values({"output.times": case.time.end / _ROWS})
        found.append(Case(index, case, values))
    return found


def input_errors(config: Config) -> Iterable[tuple[str, str]]:
    """Look at the numbers and files of the cases, for `config.load`; light where there are none."""
    doubtful = [case.config for case in cases(config) if not case.config.plainly_possible]
    if not doubtful:
        return ()
    from gfmdlayer import inputs

    return inputs.input_errors(doubtful)


def notes(configs: Iterable[Config]) -> list[str]:
    """Return the changes made to the measured surfaces of the cases, each once.

    Raises
    ------
    TableError
        If a file cannot be used.
    """
    surfaces = dict.fromkeys((config.grid.cell, config.punch) for config in configs)
    return list(dict.fromkeys(note for cell, punch in surfaces for note in punch.notes(cell)))


def label(values: dict[str, object]) -> str:
    """Write swept values for people: ``thickness = 0.1, Ginf = 10``."""
    short = [key.rpartition(".")[2] for key in values]
    names = [last if short.count(last) == 1 else key for key, last in zip(values, short, strict=True)]
    texts = [as_label(key, value) for key, value in values.items()]
    return ", ".join(f"{name} = {text}" for name, text in zip(names, texts, strict=True))
