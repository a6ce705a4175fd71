"""The examples of reference/additions.md work: each file and its line in a table, in a copy of the package.

What is added is run, checked, swept, offered by the schema and the templates, listed and drawn.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import open_case

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/reference/additions.md"
FILE = re.compile(r"^```python\n(# (gfmdlayer/\S+\.py)\n.*?)^```$", re.DOTALL | re.MULTILINE)
TABLE = re.compile(r"`([A-Z]+)`[^`]*`(gfmdlayer/\S+\.py)`|`(gfmdlayer/\S+\.py)`[^`]*`([A-Z]+)`")
LINE = re.compile(r"(`|^```python\n    )(\"\w[^`]*?,)\n?(`|```$)", re.DOTALL | re.MULTILINE)

STEPS = "time: {end: 1.0, step: 0.25}"
GRID = "grid: {points: 64}"
CASES = {
    "a punch shape": f"""{GRID}
layer: {{thickness: .inf}}
output: {{snapshots: [1.0]}}
sweep:
  punch:
    - {{shape: wedge, slope: 0.1}}
    - {{shape: frustum, flat: 1.0e-9, slope: 0.1}}
    - {{shape: frustum, flat: 0.125, slope: 50}}
    - {{shape: array, counts: 2, element: {{shape: frustum, flat: 0.0625, slope: 50}}}}
{STEPS}""",
    "a material law": f"""{GRID}
layer: {{thickness: .inf, material: {{model: rouse, G0: 1.0, G: 2.0, tau: 1.0, modes: 2}}}}
punch: {{shape: flat, width: 0.25, edge_radius: 1.0e-6}}
trajectory: {{depth: 0.01, ramp_time: 0.5}}
time: {{end: 2.0, step: 0.125}}
solver: {{tolerance: 1.0e-9}}""",
    "a body": f"{GRID}\nbody: {{kind: winkler, k: 5.0}}\noutput: {{snapshots: [1.0]}}\n{STEPS}",
    "a contact": f"""{GRID}
body: {{kind: winkler, k: 5.0}}
trajectory: {{depth: 0.01, ramp_time: 1.0}}
time: {{end: 4.0, step: adaptive, tolerance: 1.0e-5}}
output: {{snapshots: [1.0, 4.0]}}""",
    "an interface law": f"{GRID}\ninterface: {{law: two_ranges, work: 1.0e-3, range: 0.05, far: 1}}\n{STEPS}",
    "a solver": f"grid: {{points: 32}}\nsolver: {{method: projected_gradient}}\n{STEPS}",
    "a geometry": f"grid: {{geometry: spring}}\nsweep: {{layer.material.G0: [1.0, 3.0]}}\n{STEPS}",
    "an observable": f"{GRID}\noutput: {{snapshots: [1.0]}}\n{STEPS}",
}
# What an example refuses besides: method, line of a configuration, and the message with its place.
REFUSALS = {
    "a punch shape": (
        """
    def misfit(self, extent):
        from gfmdlayer.validation.problems import Mistake

        if self.flat >= extent.length / 2:
            return Mistake(("flat",), f"got {self.flat!r}; must be below half {extent.words}")
""",
        "punch: {shape: frustum, slope: 1, flat: 0.5}",
        ":2:41: punch.flat: got 0.5; must be below half the period in x, 1.0",
    ),
    "a material law": (
        """
    def problems(self):
        from gfmdlayer.validation.problems import Mistake

        if self.G < self.G0:
            yield Mistake(("G",), f"got {self.G!r}; must be a number >= G0", ("G0",))
""",
        "layer: {material: {model: rouse, G0: 2.0, G: 1.0, tau: 1.0}}",
        ":2:46: layer.material.G: got 1.0; must be a number >= G0",
    ),
    "a body": ("", "body: {kind: winkle, k: 1}", ":2:14: body.kind: got the text 'winkle'; must be one of "),
    "a geometry": (
        """
    def problems(self):
        if self.config.trajectory.control == "load":
            yield "trajectory.control", "got 'load'; must be depth or force"
""",
        "grid: {geometry: spring}\ntrajectory: {control: load, load: 1.0}",
        ":3:23: trajectory.control: got 'load'; must be depth or force",
    ),
}
SCRIPT = "import sys; from gfmdlayer.cli import main; print([main(each.split()) for each in sys.argv[1:]])"
VERBS = (
    "check a-geometry.yaml", "check a-contact.yaml",
    "status results/a-geometry", "plot results/a-geometry --y force --out a.png",
)  # fmt: skip


def sections():
    """Return the sections "a ..." of the page by title."""
    parts = re.split(r"^## (.*)\n", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def add(section, copy, method=""):
    """Write the file of a section, with a further method, into a copy of the package, and its line."""
    code = FILE.search(section)
    assert code is not None
    (copy / code[2]).write_text(code[1] + method, encoding="utf-8")
    rest = section[code.end() :]
    table, line = TABLE.search(rest), LINE.search(rest)
    assert table is not None
    assert line is not None
    name, path = table[1] or table[4], copy / (table[2] or table[3])
    text = path.read_text(encoding="utf-8")
    table_of = rf"^({name}\b[^\n]*[({{][^\n]*\n.*?)^([)}}])"
    entry, count = re.subn(table_of, rf"\1    {line[2]}\n\2", text, flags=re.MULTILINE | re.DOTALL)
    assert count == 1
    module, made = code[2].removesuffix(".py").replace("/", "."), re.search(r"^class (\w+)", code[1], re.M)
    assert made is not None
    if f"{module}:{made[1]}" not in entry:  # a table of classes, with their import
        entry = entry.replace("\nfrom gfmd", f"\nfrom {module} import {made[1]}\nfrom gfmd", 1)
    path.write_text(entry, encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder where one copy with all examples in it ran a small study for each section."""
    folder = tmp_path_factory.mktemp("contributor")
    copy = folder / "copy"
    shutil.copytree(Path(gfmdlayer.__file__).parent, copy / "gfmdlayer")  # with the compiled kernels
    every = sections()
    for title, values in CASES.items():
        method, refused, _ = REFUSALS.get(title, ("", "", ""))
        add(every[title], copy, method)
        name = title.replace(" ", "-")
        (folder / f"{name}.bad").write_text(f"name: {name}\n{refused}\n")
        (folder / f"{name}.yaml").write_text(f"name: {name}\n{values}\n")
    commands = [f"run {path.name}" for path in sorted(folder.glob("*.yaml"))]
    commands += [*VERBS, "new", "schema"]
    ends = [0] * len(commands) + [2] * len(REFUSALS)
    commands += [f"check {title.replace(' ', '-')}.bad" for title in REFUSALS]
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT, *commands], cwd=folder, env=os.environ | {"PYTHONPATH": str(copy)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ran.stdout.split("\n")[-2:-1] == [str(ends)], ran.stdout + ran.stderr
    (folder / "said").write_text(ran.stdout + ran.stderr)
    return folder


def case(folder, title, number=0):
    """Return a case of the study of a section."""
    return open_case(folder / "results" / title.replace(" ", "-") / f"cases/{number:04d}.h5").load()


def test_the_examples_have_the_style_of_the_package(tmp_path):
    for code, path in FILE.findall(PAGE.read_text(encoding="utf-8")):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(code, encoding="utf-8")
    for check in (["check"], ["format", "--check"]):
        command = [sys.executable, "-m", "ruff", *check, "--config", str(ROOT / "pyproject.toml")]
        found = subprocess.run([*command, str(tmp_path)], capture_output=True, text=True, check=False)
        assert found.returncode == 0, found.stdout


def test_a_frustum_is_a_wedge_or_a_flat_punch_and_an_element_of_an_array(folder):
    wedge, tip, top, two = (case(folder, "a punch shape", number) for number in range(4))
    # Without a flat end it is a wedge; the solver's tolerance is 1e-6.
    np.testing.assert_allclose(tip["mean_pressure"], wedge["mean_pressure"], rtol=1e-5, atol=1e-9)
    # With steep sides it touches with all of its end and nothing else; half as wide and twice as many.
    assert top["contact_area"][-1] == 17 / 64
    assert two["contact_area"][-1] == 18 / 64
    heights = (top["gap"] + top["displacement"])[-1] + top["depth"][-1]
    # The gap is zero in contact, where the displacement meets the punch to the solver's tolerance.
    within = 1e-6 * float(top["depth"][-1])
    np.testing.assert_allclose(heights, 50 * np.maximum(np.abs(top["x"]) - 0.125, 0), atol=within)


@pytest.mark.parametrize("title", REFUSALS)
def test_what_an_addition_refuses_is_named_with_its_place(folder, title):
    assert f"{title.replace(' ', '-')}.bad{REFUSALS[title][2]}" in (folder / "said").read_text()


def test_templates_and_the_schema_offer_what_is_added(folder):
    template = (folder / "indentation.yaml").read_text()
    assert ", frustum" in template
    assert ", rouse" in template
    said = (folder / "said").read_text()
    assert all(f'"const": "{name}"' in said for name in ("frustum", "rouse", "winkler", "two_ranges"))


def test_the_pressure_under_a_flat_punch_follows_the_modulus_of_a_rouse_chain(folder):
    """The contact does not change, so the pressure is the mean of G(t - s) over the ramp, 0 <= s <= 1/2."""
    law = case(folder, "a material law").sel(time=slice(0.5, None))
    t, pressure = law["time"].to_numpy(), law["mean_pressure"].to_numpy()
    slow, fast = (4 * tau * (np.exp(-(t - 0.5) / tau) - np.exp(-t / tau)) for tau in (1.0, 0.25))
    modulus = 1 + slow + fast
    np.testing.assert_allclose(pressure / pressure[-1], modulus / modulus[-1], rtol=1e-7)


def test_each_point_of_a_winkler_bed_carries_its_own_overlap(folder):
    """In contact from t0 on a point moves at v, and p = k v (t - t0) + k v tau (1 - exp(-(t - t0)/tau))."""
    last = case(folder, "a body").isel(snapshot=-1)
    speed, x = 0.01, last["x"].to_numpy()
    since = np.maximum(1 - x**2 / (2 * 0.25) / speed, 0.0)
    exact = 5 * speed * (since + 1 - np.exp(-since))
    # A point is touched within a step of 1/4: it is wrong by less than k v dt^2/tau.
    np.testing.assert_allclose(last["pressure"], exact, rtol=0, atol=5 * speed * 0.25**2)
    assert exact.max() > 10 * 5 * speed * 0.25**2


def test_a_bed_of_asperities_is_solved_point_by_point_by_the_same_loop(folder):
    """As above up to the end of the ramp; then p = k d (1 + the last term exp(-(t - 1)/tau))."""
    bed = case(folder, "a contact")
    assert not bed["transforms"].any()  # no solver: the contact of the example
    speed, x = 0.01, bed["x"].to_numpy()
    since = np.maximum(1 - x**2 / (2 * 0.25) / speed, 0.0)
    for time in (1.0, 4.0):
        exact = 5 * speed * (since + (1 - np.exp(-since)) * np.exp(1 - time))
        found = bed["pressure"].sel(snapshot=time)
        # Within the tolerance of the mean pressure, times what one of the points has of the mean.
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-5 * exact.max() * 10)
    assert np.abs(bed["energy_residual"]).max() < 1e-3 * bed["work"].max()


def test_a_contact_without_a_solver_is_estimated_without_transforms(folder):
    said = (folder / "said").read_text()
    assert "contact    asperities, without a solver" in said
    assert "FFT pairs" not in said  # nor has the spring of a geometry, the other one that is checked


def test_a_sum_of_two_ranges_attracts(folder):
    assert float(case(folder, "an interface law")["largest_tension"].max()) > 0


def test_projected_gradients_solve_each_step(folder):
    assert float(case(folder, "a solver")["residual"].max()) <= 1e-6


def test_the_column_of_an_observable_is_in_each_file(folder):
    found = case(folder, "an observable")
    pressure = found["pressure"].isel(snapshot=-1)
    assert float(found["rms_pressure"][-1]) == pytest.approx(float((pressure**2).mean()) ** 0.5, rel=1e-12)


def test_a_spring_is_a_geometry_that_is_swept_listed_and_drawn(folder):
    found = gfmdlayer.open_results(folder / "results/a-geometry")
    np.testing.assert_allclose(found["force"], found["depth"] * found["G0"], rtol=1e-15)
    assert (found["depth"].isel(time=-1) == 0.01).all()
    assert "2 cases: 2 complete" in (folder / "said").read_text()
    assert (folder / "a.png").exists()
