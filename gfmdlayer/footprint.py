"""Steps, FFT pairs, memory and disk of a periodic case, estimated from its configuration before it runs.

The unit of work is the FFT pair, one forward and one backward transform of the grid, since nearly all of the
time goes there. The solver declares the pairs of a step and the fields in memory (`contact.solvers`).
"""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from gfmdlayer.body.solid import DEPTH_PAIRS
from gfmdlayer.config.layers import thicknesses
from gfmdlayer.contact.solvers import ATTRACTED, FRICTIONAL, SOLVERS
from gfmdlayer.files.whole import write_text
from gfmdlayer.history.time_points import number_of_steps
from gfmdlayer.model import PROGRAM, Footprint
from gfmdlayer.programme import Programme

if TYPE_CHECKING:
    from gfmdlayer.grid.transforms import Transforms


# Adaptive steps at a tolerance of 1e-4: the first ones, those of each stretch between breakpoints, those in
# which a branch relaxes, those for each doubling of a stretch beyond LONG relaxation times, in which the
# punch moves or the surface creeps; and the power of the tolerance. Measured on ramps and tables of 5 to 400
# rows, tolerances from 1e-3 to 1e-5, relaxation times from 1e-3 to 100 ramps.
FIRST_STEPS, STRETCH_STEPS, RELAXING_STEPS, DOUBLING_STEPS, LONG = 4, 2, 5, 6, 3
ADAPTIVE_POWER = -1 / 3
ADAPTIVE = 2  # pairs of an adaptive step, with rejected attempts, over those of a short fixed one
AT_TURN = 2  # further steps, in pairs, for a fixed step after a breakpoint; measured on random tables
SURFACE = 1.3  # pairs of a step on a surface over those on a line
SLIDING = 4  # contact problems of a step under a moving punch; measured on the sliding parabola
# Adaptive steps under a moving punch over those under a resting one, up to FAST periods in a relaxation time.
SLIDING_STEPS, FAST = 2, 10
# Adaptive steps for each range of an interface that the punch moves, from NEAR ranges above the surface on,
# and for each stretch under a load. Measured on adhesive cylinders and films.
SEPARATING_STEPS, NEAR, HOLDING_STEPS = 6, 3, 15
# Steady sliding begins after this many passages of the period, or times in which a free surface relaxes.
SETTLING = 3
# Thickness over the period below which contact is harder to find: the pairs grow with its root; the limit.
THIN, THINNEST = 0.05, 1 / 9
STEP_SECONDS = 3e-4  # of a step beside its pairs, measured at 2^8 points
REAL = 8  # bytes
ISOLATED_FIELDS = 9  # of the modes of an isolated contact, while they are made; measured at 1024 x 1024
TRACTION_FIELDS = 12  # of a mode under tractions in all directions, an axis
BRANCH_FIELDS = 5  # real fields of a branch of the material; measured as those of the solvers
INSIDE_FIELDS = 40  # of the fields below the surface at a depth
FELT, MODE_BYTES = 27.0, 150  # q d up to which a layer is felt; bytes of a mode that is not merged, at a wave
ROWS = 512  # in a block of the file
HEADER = 10e3  # bytes of the file beside its arrays: attributes, names


def estimate(programme: Programme, width: int, observed: tuple[float, float] = (0.0, 0.0)) -> Footprint:
    """Estimate the cost of a case whose rows have `width` numbers.

    `observed` are the FFT pairs of a row, and the bytes that its observables need.
    """
    config = programme.config
    size = math.prod(config.grid.points)
    steps, turns = count_steps(programme)
    frictional = ATTRACTED if config.interfaces else FRICTIONAL
    solver = frictional if config.friction else SOLVERS[config.contact_solver.method]
    pairs = (steps + AT_TURN * turns) * solver.pairs_per_step(size, config.solver.model_dump())
    pairs *= SLIDING if config.trajectory.moves and not config.friction else 1
    pairs *= ADAPTIVE if config.time.step == "adaptive" else 1
    pairs *= SURFACE if len(config.grid.points) == 2 else 1
    pairs *= solver.rough if config.punch.rough else 1
    uppermost = next(iter(config.solid.thicknesses), math.inf)
    if 0 < (thin := uppermost / max(config.grid.period) / THIN) < 1:
        pairs *= max(thin, THINNEST) ** -0.5
    pairs += observed[0] * (steps + 1)
    branches = len(config.solid.roughly(config.time.end)[0][1])
    rows, output = math.ceil((steps + 1) / ROWS) * ROWS, config.output
    snapshots = steps + 1 if output.snapshots == "every" else len(output.snapshots)
    modes = BRANCH_FIELDS * branches + (ISOLATED_FIELDS if config.grid.isolated else 0)
    fields = 3 + bool(config.interfaces) + (config.hardness is not None) + 2 * config.two_bodies
    if config.friction:
        fields += 2 * len(config.grid.points)
        every = sum(len(branches) for _, branches in config.solid.roughly(config.time.end))
        modes += TRACTION_FIELDS * len(config.grid.points) * (1 + every)
    fields *= size * snapshots
    inside = _inside(programme, snapshots)
    return Footprint(
        steps=steps,
        pairs=pairs + inside.pairs,
        work=size * (pairs + inside.pairs),
        memory=PROGRAM + (solver.fields + modes) * REAL * size + observed[1] + inside.memory,
        storage=HEADER + REAL * (width * rows + sum(config.grid.points) + fields) + inside.storage,
        seconds=STEP_SECONDS * steps,
    )


class _Cost(NamedTuple):
    pairs: float = 0.0
    memory: float = 0.0  # bytes
    storage: float = 0.0  # bytes


def _inside(programme: Programme, snapshots: int) -> _Cost:
    """Estimate what the fields below the surface add, in all of these snapshots or some of them."""
    config, asked = programme.config, programme.config.output.inside
    if asked is None:
        return _Cost()
    size, axes = math.prod(config.grid.points), len(config.grid.points)
    places = len(asked.places(config.solid, config.grid.period))
    layers = thicknesses(config.solid)
    springs = [1, *(2 if i == 0 or math.isinf(d) else 4 for i, d in enumerate(layers) if len(layers) > 1)]
    branches = [len(each) for _, each in config.solid.roughly(config.time.end)]
    snapshots = snapshots if asked.times is None else min(snapshots, len(asked.times))
    each = 4 * places * (7 if axes == 1 else 10) * size  # displacements, stresses and von Mises stress
    kept = 2 * REAL * sum(springs) * size if any(branches) and len(layers) > 1 else 0
    # Modes that are not merged, and their part in the springs, at the waves that feel the lower face of the
    # uppermost layer; each magnitude of two components belongs to some eight waves.
    reach = FELT / (2 * math.pi * layers[0])
    waves = math.prod(reach * length for length in config.grid.period) * (math.pi / 2 if axes == 2 else 1)
    waves = min(waves, size / 2) if len(layers) > 1 or math.isfinite(layers[0]) else 0.0
    modes = sum(springs) * max(branches, default=0)
    memory = waves * modes * (MODE_BYTES + 2 * REAL * sum(springs) / (8 if axes == 2 else 1))
    memory += each + (INSIDE_FIELDS + 6 * sum(springs)) * REAL * size + kept
    return _Cost(DEPTH_PAIRS * places * snapshots, memory, snapshots * (each + kept))


def count_steps(programme: Programme) -> tuple[int, int]:
    """Count the steps, fixed ones exactly, adaptive ones by the relaxation between breakpoints.

    Also count the fixed steps that follow a breakpoint.
    """
    config, planned, separating = programme.config, programme.landings, 0.0
    given, drive = config.trajectory, programme.drive
    if config.interfaces:
        separating = HOLDING_STEPS * len(drive.breakpoints)
        if given.control == "depth":
            reach = programme.interface.range
            nearest = [max(drive(time) / reach, -NEAR) for time in (0.0, *drive.breakpoints)]
            separating = SEPARATING_STEPS * sum(abs(after - before) for before, after in pairwise(nearest))
    settled = max(programme.breakpoints, default=0.0) + _settling(programme)
    last = next((stop for stop in planned if stop.time >= settled), planned[-1])
    planned = [*planned[: planned.index(last)], replace(last, time=min(settled, last.time))]
    if config.time.step != "adaptive":
        return number_of_steps(planned), sum(stop.breakpoint for stop in planned)
    relaxed, branches = config.solid.roughly(config.time.end)[0]
    times, spent = _relaxation(relaxed, branches)
    finer = ((config.time.tolerance or 1e-4) / 1e-4) ** ADAPTIVE_POWER
    slowest = max((tau for _, tau in branches), default=0.0)
    crossed = abs(given.velocity or 0.0) * slowest / max(config.grid.period)
    steps, begin, landings = FIRST_STEPS + finer * separating, 0.0, 0
    finer *= SLIDING_STEPS if given.moves and crossed < FAST else 1
    for stop in planned[1:]:
        if stop.breakpoint or stop is planned[-1]:
            free = finer * spent[min(bisect_left(times, stop.time - begin), len(times) - 1)]
            steps += math.hypot(STRETCH_STEPS + free, landings)
            begin, landings = stop.time, 0
        else:
            landings += 1
    return round(steps), 0


def _settling(programme: Programme) -> float:
    """Time from the last breakpoint to the steady state that ends the run of a moving punch."""
    config = programme.config
    velocity = config.trajectory.velocity
    if config.time.steady is None or not velocity:
        return math.inf
    relaxed, branches = config.solid.roughly(config.time.end)[0]
    glassy = relaxed + sum(modulus for modulus, _ in branches)
    slowest = max((tau for _, tau in branches), default=0.0)
    creep = slowest * glassy / relaxed if relaxed > 0 else math.inf
    return SETTLING * max(max(config.grid.period) / abs(velocity), creep)


@lru_cache(maxsize=8)
def _relaxation(relaxed: float, branches: tuple[tuple[float, float], ...]) -> tuple[list[float], list[float]]:
    """Return times after a breakpoint, and the steps up to them at a tolerance of 1e-4.

    The error of a step is proportional to its third power and to the third derivative of the relaxing
    modulus: over a time t there are int_0^t (sum_k G_k exp(-s/tau_k)/tau_k^3)^(1/3) ds steps, up to a factor.
    """
    times, spent = [0.0], [0.0]
    if not any(modulus for modulus, _ in branches):
        return times, spent
    glassy = relaxed + sum(modulus for modulus, _ in branches)
    shortest, longest = (limit(tau for _, tau in branches) for limit in (min, max))
    time, rate = 0.01 * shortest, sum(modulus / tau**3 for modulus, tau in branches) ** (1 / 3)
    while times[-1] < 1000 * longest:
        after = sum(modulus / tau**3 * math.exp(-time / tau) for modulus, tau in branches) ** (1 / 3)
        relaxing = (time - times[-1]) * (rate + after) / 2 / glassy ** (1 / 3)
        moving = math.log2(time / max(times[-1], LONG * longest)) if time > LONG * longest else 0.0
        spent.append(spent[-1] + RELAXING_STEPS * relaxing + DOUBLING_STEPS * moving)
        times.append(time)
        time, rate = time * 1.1, after
    return times, spent


# Seconds of an FFT pair on this machine: measured once for each size and kept beside FFTW's wisdom.
#
#     pair-16384.seconds     with the plans of a run
#     pair-16384.hasty       before any run, with a plan that takes no time to make
#
# Reading a kept number imports no numerics.

LARGEST = 1 << 20  # points of a pair that is measured without a plan for it
_REPEATS, _BATCH = 5, 1e-3  # batches of pairs, and the seconds of one


def pair_seconds(shape: tuple[int, ...], folder: Path) -> float:
    """Return the seconds of a pair of transforms: kept, or measured with a hasty plan on a line."""
    for kind in ("seconds", "hasty"):
        with suppress(OSError, ValueError):
            return float(_kept(shape, folder, kind).read_text(encoding="ascii"))
    from gfmdlayer.grid.fftw import forget_wisdom
    from gfmdlayer.grid.transforms import Transforms

    size = math.prod(shape)
    hasty = Transforms((min(size, LARGEST),), time_limit=0.0)
    found = _measured(hasty) * max(1.0, size * math.log(size) / (LARGEST * math.log(LARGEST)))
    forget_wisdom()  # a run in this process makes better plans
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        write_text(_kept(shape, folder, "hasty"), repr(found))
    return found


def keep_pair_seconds(shape: tuple[int, ...], wisdom: str, folder: Path, threads: int = 1) -> None:
    """Measure a pair with the plans of a run, and keep it in a folder where that is not done yet."""
    from gfmdlayer.grid.transforms import Transforms

    if not (path := _kept(shape, folder)).exists():
        with suppress(OSError):
            write_text(path, repr(_measured(Transforms(shape, wisdom, threads=threads))), replace=False)


def _kept(shape: tuple[int, ...], folder: Path, kind: str = "seconds") -> Path:
    return folder / f"pair-{'x'.join(map(str, shape))}.{kind}"


def _measured(transforms: Transforms) -> float:
    """Return the shortest time of a pair among some batches: other work on the machine only adds to it."""
    field, spectrum = transforms.empty_field(), transforms.empty_spectrum()
    field[:], number, best = 0.0, 1, math.inf
    for _ in range(_REPEATS):
        begun = time.perf_counter()
        for _ in range(number):
            transforms.transform(field, spectrum)
            transforms.transform_back(spectrum, field)
        each = (time.perf_counter() - begun) / number
        best, number = min(best, each), max(1, round(_BATCH / max(each, 1e-9)))
    return best
