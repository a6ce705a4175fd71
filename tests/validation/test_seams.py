"""A punch shape, a material law and a geometry are added by one new file and one line in a table."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

import gfmdlayer
from gfmdlayer import open_case

FRUSTUM = '''
"""A conical frustum: flat on top, with straight sides."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from gfmdlayer.punch.shape import Analytic, Axes, Extent, distance
from gfmdlayer.validation.fields import Positive
from gfmdlayer.validation.problems import Problem

if TYPE_CHECKING:
    from gfmdlayer.arrays import FloatArray


class Frustum(Analytic):
    """Flat within `radius`, height slope (r - radius) outside."""

    shape: Literal["frustum"] = "frustum"
    """a cone without its tip"""
    radius: Positive
    """radius of the flat top: length"""
    slope: Positive
    """slope of the side"""

    def height(self, axes: Axes) -> FloatArray:
        return self.slope * (distance(axes) - self.radius).clip(min=0)

    def misfit(self, extent: Extent) -> Problem | None:
        if self.radius < extent.length / 2:
            return None
        return Problem(("radius",), f"got {self.radius!r}; must be below half {extent.words}")
'''

DECADES = '''
"""Relaxation by a power of time, as a Prony series of one branch a decade."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from gfmdlayer.body.materials import Material
from gfmdlayer.validation.fields import Positive
from gfmdlayer.validation.problems import Problem


class Decades(Material):
    """G(t) falls from Ginf to G0 about like t^(-exponent) from `shortest` to `longest`."""

    model: Literal["decades"] = "decades"
    """G(t) falls like a power of time"""
    G0: Positive = 1.0
    """relaxed shear modulus"""
    Ginf: Positive = 10.0
    """instantaneous shear modulus"""
    exponent: Positive = 0.5
    """power of time"""
    shortest: Positive = 0.01
    """shortest relaxation time"""
    decades: Positive = 2.0
    """decades of relaxation times"""

    def problems(self) -> Iterator[Problem]:
        if self.Ginf < self.G0:
            yield Problem(("Ginf",), f"got {self.Ginf!r}; must be a number >= G0", ("G0",))

    @property
    def relaxed(self) -> float:
        return self.G0

    @property
    def maxwell_branches(self) -> tuple[tuple[float, float], ...]:
        powers = [10.0**k for k in range(int(self.decades) + 1)]
        weights = [power**-self.exponent for power in powers]
        scale = (self.Ginf - self.G0) / sum(weights)
        return tuple((scale * w, self.shortest * p) for w, p in zip(weights, powers, strict=True))
'''

# Each command line in turn, in one process; the last line says how each ended.
SCRIPT = """
import sys
from gfmdlayer.cli import main
ended = [main(line.split()) for line in sys.argv[1:]]
print(*ended)
"""


def copy_of_the_package(folder: Path) -> Path:
    """Copy the package with its compiled kernels."""
    copy = folder / "copy" / "gfmdlayer"
    shutil.copytree(Path(gfmdlayer.__file__).parent, copy)
    return copy


def run_commands(folder: Path, copy: Path, *commands: str) -> str:
    """Run command lines in turn by a copy of the package; return what they print."""
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT, *commands],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(copy.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stdout + ran.stderr


def newcomer(folder: Path, file: str, content: str, table: str, after: str, *commands: str) -> str:
    """Add a file and a line to a copy of the package, and return what its command lines print.

    Parameters
    ----------
    folder : Path
        Working folder, which gets the copy.
    file, content : str
        Path within the package, and text, of the new file.
    table, after : str
        The file of the table, and the entry that the new one comes after.
    *commands : str
        Arguments of `gfmdlayer`.
    """
    copy = copy_of_the_package(folder)
    (copy / file).write_text(content)
    name = re.search(r"^class (\w+)", content, re.MULTILINE)
    assert name is not None
    entry = f'"gfmdlayer.{file.removesuffix(".py").replace("/", ".")}:{name[1]}",'
    text = (copy / table).read_text()
    assert text.count(after) == 1
    (copy / table).write_text(text.replace(after, f"{after}\n    {entry}"))
    return run_commands(folder, copy, *commands)


def test_a_new_punch_shape_is_checked_offered_and_run(tmp_path: Path) -> None:
    line = "name: x\ngrid: {points: 64}\nlayer: {thickness: .inf}\ntime: {end: 1.0, step: 0.25}\n"
    (tmp_path / "case.yaml").write_text(
        line
        + """\
output: {snapshots: [1.0]}
sweep:
  punch:
    - {shape: wedge, slope: 0.1}
    - {shape: frustum, slope: 0.1, radius: 1.0e-9}
    - {shape: frustum, slope: 50, radius: 0.125}
    - {shape: array, counts: 2, element: {shape: frustum, slope: 50, radius: 0.0625}}
"""
    )
    (tmp_path / "bad.yaml").write_text(line + "punch: {shape: frustum, slope: 1, radius: 0.5}\n")
    said = newcomer(
        *(tmp_path, "punch/frustum.py", FRUSTUM, "punch/shapes.py", '"gfmdlayer.punch.simple_shapes:Flat",'),
        *("run case.yaml --out out", "check bad.yaml", "schema", "new"),
    )
    assert "\n0 2 0 0\n" in said
    assert "bad.yaml:5:43: punch.radius: got 0.5; must be below half the period in x, 1.0" in said
    assert '"const": "frustum"' in said
    assert "wedge, pyramid, flat, frustum, blunted_cone, array" in (tmp_path / "indentation.yaml").read_text()
    wedge, tip, top, two = (open_case(tmp_path / f"out/cases/{i:04d}.h5").load() for i in range(4))
    # Without a top it is a wedge; the solver's tolerance is 1e-6.
    np.testing.assert_allclose(tip["mean_pressure"], wedge["mean_pressure"], rtol=1e-5, atol=1e-9)
    # With steep sides it is a flat punch, which touches all of its top and nothing else.
    assert top["contact_area"][-1] == 17 / 64
    # Half as wide and twice as many.
    assert two["contact_area"][-1] == 18 / 64
    heights = (top["gap"] + top["displacement"])[-1] + top["depth"][-1]
    x = top["x"].to_numpy()
    # The gap is zero in contact, where the displacement meets the punch to the solver's tolerance.
    within = 1e-6 * float(top["depth"][-1])
    np.testing.assert_allclose(heights, 50 * np.maximum(np.abs(x) - 0.125, 0), atol=within)


def test_a_new_material_law_is_checked_and_run(tmp_path: Path) -> None:
    # A flat punch on the material alone: the force follows the depth by G(t), as the contact does not change.
    flat = """\
name: x
grid: {points: 64}
punch: {shape: flat, width: 0.25, edge_radius: 1.0e-6}
trajectory: {depth: 0.01, ramp_time: 0.5}
time: {end: 2.0, step: 0.125}
solver: {tolerance: 1.0e-9}
"""
    law = "model: decades, G0: 2.0, Ginf: 20.0"
    (tmp_path / "case.yaml").write_text(flat + f"layer: {{thickness: .inf, material: {{{law}}}}}\n")
    (tmp_path / "bad.yaml").write_text(flat + f"layer: {{material: {{{law.replace('20.0', '1.0')}}}}}\n")
    said = newcomer(
        *(tmp_path, "body/decades.py", DECADES, "body/laws.py", '"gfmdlayer.body.materials:Prony",'),
        *("run case.yaml --out out", "check bad.yaml", "schema", "new"),
    )
    assert "\n0 2 0 0\n" in said
    assert "bad.yaml:7:51: layer.material.Ginf: got 1.0; must be a number >= G0" in said
    assert "# one of zener, prony, decades, elastic" in (tmp_path / "indentation.yaml").read_text()
    found = open_case(tmp_path / "out/cases/0000.h5").load()
    t, pressure = found["time"].to_numpy(), found["mean_pressure"].to_numpy()
    tau, weights = 0.01 * 10.0 ** np.arange(3), 10.0 ** (-0.5 * np.arange(3))
    moduli = 18 * weights / weights.sum()
    held = t >= 0.5
    # The mean of G(t - s) over the ramp, 0 <= s <= 1/2.
    decay = np.exp(-np.subtract.outer(t[held], [0.5]) / tau) - np.exp(-np.outer(t[held], 1 / tau))
    modulus = 2 + (moduli * tau * decay).sum(axis=1) / 0.5
    np.testing.assert_allclose(pressure[held] / pressure[-1], modulus / modulus[-1], rtol=1e-7)


SPRING = '''
"""One linear spring under a prescribed depth or force: the smallest geometry."""

from __future__ import annotations

import numpy as np

from gfmdlayer.model import Footprint, Model
from gfmdlayer.observables.contact import TIME
from gfmdlayer.observables.observable import Column


class Spring(Model):
    """The force on a spring whose stiffness is the modulus of the uppermost layer."""

    columns = TIME, Column("depth", "depth", "length"), Column("force", "force", "force")
    coordinates = {"x": np.zeros(1)}  # no snapshots: one point does

    @property
    def footprint(self):
        return Footprint(steps=len(self.programme.landings), pairs=0.0, work=1.0, memory=1e6, storage=1e4)

    def problems(self):
        if self.config.trajectory.control == "load":
            yield "trajectory.control", "got 'load'; must be depth or force"

    def run(self, recorder, progress=None, resume=None):
        k, given = self.config.solid.unit, self.config.trajectory.control
        for instant in self.programme.fixed_steps():
            depth = self.programme.drive(instant.time) / (k if given == "force" else 1.0)
            recorder.row(time=instant.time, depth=depth, force=k * depth)
        return []
'''


def test_a_new_geometry_is_one_model_and_one_line(tmp_path: Path) -> None:
    case = "name: x\ngrid: {geometry: spring}\ntime: {end: 1.0, step: 0.25}\n"
    (tmp_path / "case.yaml").write_text(case + "sweep: {layer.material.G0: [1.0, 3.0]}\n")
    (tmp_path / "bad.yaml").write_text(case + "trajectory: {control: load, load: 1.0}\n")
    copy = copy_of_the_package(tmp_path)
    (copy / "spring.py").write_text(SPRING)
    table = copy / "config/geometries.py"
    start = "GEOMETRIES: Mapping[str, Geometry] = {  # the first is the default\n"
    assert start in table.read_text()
    line = '    "periodic": Geometry('
    added = f'    "spring": Geometry("gfmdlayer.spring:Spring"),\n{line}'
    table.write_text(table.read_text().replace(line, added))
    said = run_commands(
        *(tmp_path, copy, "check case.yaml", "run case.yaml --out out", "check bad.yaml", "status out"),
        "plot out --y force --out force.png",
    )
    assert "bad.yaml:4:" in said
    assert "trajectory.control: got 'load'; must be depth or force" in said
    assert "\n0 0 2 0 0\n" in said
    found = gfmdlayer.open_results(tmp_path / "out")
    np.testing.assert_allclose(found["force"], found["depth"] * found["G0"])
    assert (tmp_path / "force.png").exists()
