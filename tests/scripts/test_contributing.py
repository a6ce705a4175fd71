"""The examples of CONTRIBUTING.md work: each file and its line in a table, in a copy of the package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import gfmdlayer
from gfmdlayer import open_case

pytestmark = pytest.mark.slow
PAGE = Path(__file__).parents[2] / "CONTRIBUTING.md"
FILE = re.compile(r"^```python\n(# (gfmdlayer/\S+\.py)\n.*?)^```$", re.DOTALL | re.MULTILINE)
TABLE = re.compile(r"`([A-Z]+)`[^`]*`(gfmdlayer/\S+\.py)`|`(gfmdlayer/\S+\.py)`[^`]*`([A-Z]+)`")
LINE = re.compile(r"(`|^```python\n    )(\"\w[^`]*?,)\n?(`|```$)", re.DOTALL | re.MULTILINE)

STEPS = "time: {end: 1.0, step: 0.25}"
GRID = "grid: {points: 64}"
CASES = {
    "a punch shape": f"{GRID}\npunch: {{shape: frustum, flat: 0.2, slope: 100.0}}\n{STEPS}",
    "a material law": f"""{GRID}
layer: {{thickness: .inf, material: {{model: rouse, G0: 1.0, G: 2.0, tau: 1.0, modes: 2}}}}
punch: {{shape: flat, width: 0.25, edge_radius: 1.0e-6}}
trajectory: {{depth: 0.01, ramp_time: 0.5}}
time: {{end: 2.0, step: 0.125}}
solver: {{tolerance: 1.0e-9}}""",
    "a body": f"{GRID}\nbody: {{kind: winkler, k: 5.0}}\noutput: {{snapshots: [1.0]}}\n{STEPS}",
    "an interface law": f"{GRID}\ninterface: {{law: two_ranges, work: 1.0e-3, range: 0.05, far: 1}}\n{STEPS}",
    "a solver": f"{GRID}\nsolver: {{method: projected_gradient}}\n{STEPS}",
    "a geometry": f"grid: {{geometry: spring}}\nlayer: {{material: {{model: elastic, G: 3.0}}}}\n{STEPS}",
    "an observable": f"{GRID}\noutput: {{snapshots: [1.0]}}\n{STEPS}",
}
SCRIPT = "import sys; from gfmdlayer.cli import main; print([main(['run', each]) for each in sys.argv[1:]])"


def sections() -> dict[str, str]:
    """Return the sections "a ..." of the page by title."""
    parts = re.split(r"^### (.*)\n", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return dict(zip(parts[::2], parts[1::2], strict=True))


def add(section: str, copy: Path) -> None:
    """Write the file of a section into a copy of the package, and its line into the table."""
    code = FILE.search(section)
    assert code is not None
    (copy / code[2]).write_text(code[1], encoding="utf-8")
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
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[str, xr.Dataset]:
    """Return the results of a small case for each section, computed by one copy with all examples in it."""
    folder = tmp_path_factory.mktemp("contributor")
    copy = folder / "copy"
    shutil.copytree(Path(gfmdlayer.__file__).parent, copy / "gfmdlayer")  # with the compiled kernels
    every = sections()
    for title, values in CASES.items():
        add(every[title], copy)
        name = title.replace(" ", "-")
        (folder / f"{name}.yaml").write_text(f"name: {name}\n{values}\n")
    names = [path.name for path in sorted(folder.glob("*.yaml"))]
    ran = subprocess.run(
        [sys.executable, "-c", SCRIPT, *names],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stdout.split("\n")[-2:-1] == [str([0] * len(CASES))], ran.stdout + ran.stderr
    found = {title: folder / "results" / title.replace(" ", "-") / "cases/0000.h5" for title in CASES}
    return {title: open_case(path).load() for title, path in found.items()}


def test_the_examples_have_the_style_of_the_package(tmp_path: Path) -> None:
    for code, path in FILE.findall(PAGE.read_text(encoding="utf-8")):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(code, encoding="utf-8")
    for check in (["check"], ["format", "--check"]):
        command = [sys.executable, "-m", "ruff", *check, "--config", str(PAGE.with_name("pyproject.toml"))]
        found = subprocess.run([*command, str(tmp_path)], capture_output=True, text=True, check=False)
        assert found.returncode == 0, found.stdout


def test_a_frustum_touches_with_its_flat_end(results: dict[str, xr.Dataset]) -> None:
    assert results["a punch shape"]["contact_area"][-1] == 25 / 64  # |x| <= 0.2


def test_the_pressure_under_a_flat_punch_follows_the_modulus_of_a_rouse_chain(
    results: dict[str, xr.Dataset],
) -> None:
    """The contact does not change, so the pressure is the mean of G(t - s) over the ramp, 0 <= s <= 1/2."""
    law = results["a material law"].sel(time=slice(0.5, None))
    t, pressure = law["time"].to_numpy(), law["mean_pressure"].to_numpy()
    slow, fast = (4 * tau * (np.exp(-(t - 0.5) / tau) - np.exp(-t / tau)) for tau in (1.0, 0.25))
    modulus = 1 + slow + fast
    np.testing.assert_allclose(pressure / pressure[-1], modulus / modulus[-1], rtol=1e-7)


def test_each_point_of_a_winkler_bed_carries_its_own_overlap(results: dict[str, xr.Dataset]) -> None:
    """In contact from t0 on a point moves at v, and p = k v (t - t0) + k v tau (1 - exp(-(t - t0)/tau))."""
    last = results["a body"].isel(snapshot=-1)
    speed, x = 0.01, last["x"].to_numpy()
    since = np.maximum(1 - x**2 / (2 * 0.25) / speed, 0.0)
    exact = 5 * speed * (since + 1 - np.exp(-since))
    # A point is touched within a step of 1/4: it is wrong by less than k v dt^2/tau.
    np.testing.assert_allclose(last["pressure"], exact, rtol=0, atol=5 * speed * 0.25**2)
    assert exact.max() > 10 * 5 * speed * 0.25**2


def test_a_sum_of_two_ranges_attracts(results: dict[str, xr.Dataset]) -> None:
    assert float(results["an interface law"]["largest_tension"].max()) > 0


def test_projected_gradients_solve_each_step(results: dict[str, xr.Dataset]) -> None:
    assert float(results["a solver"]["residual"].max()) <= 1e-6


def test_the_column_of_an_observable_is_in_each_file(results: dict[str, xr.Dataset]) -> None:
    found = results["an observable"]
    pressure = found["pressure"].isel(snapshot=-1)
    assert float(found["rms_pressure"][-1]) == pytest.approx(float((pressure**2).mean()) ** 0.5, rel=1e-12)


def test_a_spring_is_a_geometry(results: dict[str, xr.Dataset]) -> None:
    found = results["a geometry"]
    np.testing.assert_allclose(found["force"], 3.0 * found["depth"], rtol=1e-15)
    assert found["depth"][-1] == 0.01
