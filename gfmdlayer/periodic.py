"""The model of a punch on a periodic surface: columns, estimated cost, checks and preparation of a case.

It imports the numerics when they are first needed, since `gfmdlayer check` answers without them. The parts of
the case and its time loop are in `gfmdlayer/simulation.py`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.body.continuous import ContinuousLaw
from gfmdlayer.config import Config
from gfmdlayer.footprint import estimate, keep_pair_seconds
from gfmdlayer.model import ConvergenceError, Footprint, Model, compile_by, fault_of_the_body
from gfmdlayer.observables import Column, columns, costs
from gfmdlayer.validation.sections import files_named

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray
    from gfmdlayer.body.solid import Place
    from gfmdlayer.grid.grid import Grid
    from gfmdlayer.grid.ranks import Ranks
    from gfmdlayer.interface.law import Interaction
    from gfmdlayer.model import Progress, Resume
    from gfmdlayer.results.journal import Recorder
    from gfmdlayer.simulation import Case

# The keys that may name the file of a prescribed quantity.
_FILES = (
    ("trajectory.file", "drive"), ("trajectory.velocity_file", "velocity"),
    ("trajectory.tangential", "tangential"), ("interface", "friction"), ("temperature.file", "temperature"),
    ("interface", "interface"),
)  # fmt: skip
_COARSE = 64  # points along an axis, of an estimate


class PeriodicContact(Model):
    """The model of a case with grid.geometry: periodic, of either boundary."""

    def __init__(
        self, config: Config, wisdom: str | None = None, threads: int = 1, ranks: Ranks | None = None
    ) -> None:
        super().__init__(config)
        self._wisdom, self._threads, self._ranks = wisdom, threads, ranks

    @cached_property
    def case(self) -> Case:
        """The parts of the simulation."""
        given = self.config, self._wisdom, self._threads, self._ranks
        if self.config.friction:
            from gfmdlayer.frictional import FrictionalCase

            return FrictionalCase(*given, programme=self.programme)
        from gfmdlayer.simulation import Case

        return Case(*given, programme=self.programme)

    @property
    def grid(self) -> Grid:
        """The periodic grid; of several ranks, this process holds a part of it."""
        return self.case.grid

    @property
    def wisdom(self) -> str:
        """FFTW's wisdom after the run."""
        return self.case.transforms.wisdom

    @property
    def coordinates(self) -> dict[str, FloatArray]:
        """Coordinates of the whole snapshots by name: x, and y of a surface in two directions."""
        from gfmdlayer.grid.grid import Grid

        grid = Grid(self.config.grid.points, self.config.grid.period)
        return dict(zip("xy", grid.coordinates, strict=False))

    @property
    def places(self) -> Sequence[Place]:
        """Depths and layers of the fields below the surface."""
        config = self.config
        return config.output.inside.places(config.solid, config.grid.period) if config.output.inside else ()

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns of a row, in their order."""
        return columns(self.config)

    @property
    def attributes(self) -> dict[str, str | float]:
        """The period, and the frame of coordinates under a moving punch."""
        found: dict[str, str | float] = {"L": self.config.grid.period[0]}
        if (body := self.case.isolated if self.config.grid.isolated else None) is not None:
            found |= {"reach": body.reach, "fit_error": body.error}
        if self.config.trajectory.moves:
            found["frame"] = "of the punch: x is the distance from its middle, which is at position(time)"
        return found

    @property
    def footprint(self) -> Footprint:
        """Estimated steps, FFT pairs, memory and disk."""
        width = sum(column.size for column in self.columns)
        return estimate(self.programme, width, costs(self.config))

    def methods(self) -> Iterator[str]:
        """Yield the contact solver and why it is taken, and the series that replace continuous laws."""
        method, reason = self.config.contact_solver
        yield f"solver     {method}: {reason}"
        if (body := self.case.isolated if self.config.grid.isolated else None) is not None:
            yield (
                f"isolated   contacts up to {body.reach:g} periods wide; the response is within "
                f"{body.error:.1e} of the one without images"
            )
        if not any(isinstance(law, ContinuousLaw) for law in self.config.laws):
            return
        for law, series in zip(self.config.laws, self.case.series, strict=True):
            if isinstance(law, ContinuousLaw):
                yield (
                    f"law        {law.model} by {len(series.material.maxwell_branches)} branches: "
                    f"error at most {series.error_in_time:.1e} of G(t), {series.error_in_frequency:.1e} of "
                    f"G(omega), t and 1/omega from {series.shortest:.3g} to {series.longest:.3g}"
                )

    def problems(self) -> Iterator[tuple[str, str]]:
        """Yield files that cannot be used, negative loads without attraction, and impossible depths."""
        import numpy as np

        from gfmdlayer.files.tables import TableError
        from gfmdlayer.grid.grid import Grid
        from gfmdlayer.time_functions import Table

        config = self.config
        given, names = config.trajectory, files_named(config)
        if message := fault_of_the_body(self, Grid(config.grid.points, config.grid.period)):
            yield "body.file" if "body.file" in names else "body", message
            return
        key = next((name for name in names if name.startswith("punch.")), "punch")
        try:
            heights = self.case.punch
            if config.grid.isolated:
                try:
                    assert self.case.reach is not None
                    if message := self.case.reach.refusal(np.where(heights > 0, 0.0, 1.0)):
                        yield key, f"touches in several places at once: {message}"
                        return
                except ValueError as error:
                    yield "grid.boundary", str(error)
                    return
            for key, quantity in _FILES:  # noqa: B007 - of the one that fails
                getattr(self.programme, quantity)
        except TableError as error:
            of_key = {name: str(path) for name, path in names.items() if name.startswith(key)}
            blamed = (name for name, path in of_key.items() if path in str(error))
            yield next(blamed, key).replace("[", ".").replace("]", ""), str(error)
            return
        except MemoryError:
            message = f"got {math.prod(config.grid.points):,}, more points than this machine's memory holds"
            yield "grid.points", f"{message}; must be fewer"
            return
        drive, velocity = self.programme.drive, self.programme.velocity
        if config.time.steady is not None and velocity is not None and velocity(math.inf) == 0:
            message = f"{given.velocity_file}: ends at rest; must end with a velocity, or remove time.steady"
            yield "trajectory.velocity_file", message
        values = drive.values if isinstance(drive, Table) else np.array([drive(math.inf)])
        key_of_drive = f"trajectory.{given.control}" if given.file is None else "trajectory.file"
        if message := weak(self.programme.interface, config.hardness):
            yield "interface", message
            return
        if config.grid.isolated and (message := self._too_wide()):
            yield key_of_drive, message
        if given.control != "depth":
            yield from ((key_of_drive, message) for message in self._impossible_loads(values))
            return
        if config.grid.isolated:
            return
        deepest, height = float(values.max()), self.case.grid.ranks.mean(heights)
        if message := too_deep(deepest, height, config.solid.mean_stiffness):
            yield key_of_drive, message

    def _impossible_loads(self, values: FloatArray) -> Iterator[str]:
        """Yield why there is no equilibrium under some of the mean pressures."""
        config, law = self.config, self.programme.interface
        control, file = config.trajectory.control, config.trajectory.file
        if (values < 0).any() and not config.interfaces:
            yield f"{file}: holds a negative {control}; must be >= 0, there is no adhesion"
        pull, found = law.traction_in_contact if law.attracts else 0.0, float(values.max())
        if config.hardness is not None and (most := config.hardness - pull) <= found:
            unit = math.prod(config.grid.period) if control == "force" else 1.0
            holds = "got" if file is None else f"{file}: holds the {control}"
            limit = f"{unit * most:.6g}, the hardness over the whole cell"
            limit += ", less the attraction" * (pull > 0)
            yield f"{holds} {unit * found:.6g}; must be below {limit}: more has no equilibrium"

    def _too_wide(self) -> str:
        """Return why an isolated contact grows beyond its reach, or "".

        The contact is elastic, without attraction, on a coarse grid, at the largest depth or force. It must
        be too wide by more than a tenth, a spacing of the grid at either edge, both glassy and relaxed.
        Between these two is a body of which one material relaxes; of others nothing is known beforehand.
        """
        import numpy as np

        from gfmdlayer.body.isolated import period_for
        from gfmdlayer.contact.loading import Loading
        from gfmdlayer.contact.nested.solver import NestedGradient
        from gfmdlayer.contact.reach import Reach
        from gfmdlayer.grid.grid import Grid
        from gfmdlayer.grid.transforms import Transforms
        from gfmdlayer.time_functions import Constant

        config, case, drive = self.config, self.case, self.programme.drive
        body, fine = case.isolated, case.grid
        times = [*(time for time in drive.breakpoints if time < config.time.end), config.time.end]
        most = max(map(drive, times))
        relaxing = sum(bool(series.material.maxwell_branches) for series in case.series)
        if body is None or not fine.is_whole or not most > 0 or relaxing > 1:
            return ""
        each = [max(1, n // _COARSE) if n % max(1, n // _COARSE) == 0 else 1 for n in fine.shape]
        coarse = Grid(tuple(n // k for n, k in zip(fine.shape, each, strict=True)), fine.period)
        heights = np.ravel(case.punch.reshape(fine.shape)[tuple(slice(None, None, k) for k in each)])
        loading = Loading(heights, Constant(most), by_depth=config.trajectory.control == "depth")
        solver, spectrum = NestedGradient(Transforms(coarse.shape), coarse), body.spectrum(coarse.waves)
        widths = []
        for stiffness in (spectrum.glassy, spectrum.relaxed):
            kappa = np.ravel(stiffness)
            nothing = np.zeros(kappa.shape, dtype=np.complex128)
            found = solver.solve(loading.problem(kappa, nothing, 0.0), np.zeros(heights.size), 1e-3)
            widths.append(Reach(coarse, body).width(found.pressure) if found.converged else 0.0)
        if (width := min(widths)) <= 1.1 * body.reach:
            return ""
        given = most * (math.prod(fine.period) if config.trajectory.control == "force" else 1.0)
        contact = f"got {given:.6g}, at which the contact is some {width:.2g} periods wide"
        return f"{contact}; must be at most {body.reach:g} periods wide{period_for(body, width)}"

    def warm_up(self, folder: Path | None = None, results: Path | None = None, *, plan: bool = True) -> str:
        """Plan the transforms, keep the seconds of an FFT pair beside the plans, and compile the kernels."""
        from gfmdlayer.files.cache import user_cache
        from gfmdlayer.grid.wisdom import planned

        wisdom = ""
        if plan:
            points, folder = self.config.grid.points, folder or user_cache()
            wisdom = planned(points, folder, self._threads, results)
            keep_pair_seconds(points, wisdom, folder, self._threads)
        compile_by(self._compile)
        return wisdom

    def _compile(self) -> None:
        """Compile the kernels of the case by a small one; to measure its plans would take longer than it."""
        from gfmdlayer.grid.fftw import forget_wisdom
        from gfmdlayer.grid.transforms import Transforms
        from gfmdlayer.results.journal import Recording

        config = smallest_equivalent_case(self.config)
        small = type(self.case)(config, transforms=Transforms(config.grid.points, time_limit=0.0))
        try:
            small.solver.compile()
            with suppress(ConvergenceError):  # of lengths that do not go together; the kernels are compiled
                small.run(Recording())
        finally:
            forget_wisdom()  # the cases make better plans

    def run(self, recorder: Recorder, progress: Progress = None, resume: Resume = None) -> list[str]:
        """Run the time loop."""
        return self.case.run(recorder, progress, resume)


def weak(law: Interaction, hardness: float | None) -> str:
    """Return why surfaces of a hardness do not bear the attraction in contact by themselves, or ""."""
    pull = law.traction_in_contact if law.attracts else 0.0
    if hardness is None or hardness > pull:
        return ""
    exceeds = "which the attraction in contact exceeds"
    return f"got the hardness {hardness:.6g}, {exceeds}; must be above {pull:.6g}"


def too_deep(depth: float, mean_height: float, mean_stiffness: float) -> str:
    """Return why a punch cannot reach a depth, or "": the mean displacement of most bodies is zero."""
    if mean_stiffness > 0 or depth < mean_height:
        return ""
    found = f"got {depth:.6g} with this punch and a body whose mean height cannot change"
    return f"{found}; must be below the mean height of the punch, {mean_height:.6g}"


def smallest_equivalent_case(config: Config) -> Config:
    """Return a case of the same kind: a short ramp and hold, on the smallest grid that has windows."""
    control, step, output = config.trajectory.control, config.time.step, config.output
    peak = 0.01 if control == "depth" or config.hardness is None else min(0.01, config.hardness / 2)
    ramp_time = 1.0 if isinstance(step, str) else 2 * step
    moves = {"velocity": 1.0} if config.trajectory.moves else {}
    times = {"times": ramp_time} if isinstance(step, str) else {}
    loose = {"time.tolerance": 1e-3} if isinstance(step, str) else {}
    references = [law.shift.reference for law in config.laws if law.shift is not None]
    at_reference = {"temperature": {"value": max(references)}} if references else {}
    return config.with_values(
        at_reference
        | {
            "grid": {"points": 256},
            "punch": {"shape": "parabola"},
            **({} if config.friction else {"solver.method": config.contact_solver.method}),
            "trajectory": {"control": control, control: peak, "ramp_time": ramp_time, **moves},
            "time.end": 3 * ramp_time,
            **loose,
            "output": output.model_dump(include={"patches", "histograms"}, exclude_none=True) | times,
        }
    )
