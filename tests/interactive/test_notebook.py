"""What editors complete, and a notebook and a script that run from their first line to their last."""

import json
import os
import subprocess
import sys
from inspect import Parameter, signature

import jedi
import matplotlib as mpl
import numpy as np
import pytest

import gfmdlayer
from tests.interactive import typed

CALLED = {
    name: called
    for name in gfmdlayer.__all__
    if not (isinstance(called := getattr(gfmdlayer, name), type) and issubclass(called, Exception))
}


@pytest.mark.parametrize("name", CALLED)
def test_the_tab_key_offers_each_keyword_of_a_call(name):
    kinds = (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
    wanted = {f"{each.name}=" for each in signature(CALLED[name]).parameters.values() if each.kind in kinds}
    cell = jedi.Interpreter(f"gfmdlayer.{name}(", [{"gfmdlayer": gfmdlayer}])
    assert wanted <= {each.name for each in cell.complete()}


def test_the_tab_key_offers_public_names_alone():
    offered = {each.name for each in jedi.Interpreter("gfmdlayer.", [{"gfmdlayer": gfmdlayer}]).complete()}
    assert {name for name in offered if not name.startswith("_")} == set(gfmdlayer.__all__)


CELLS = """
%matplotlib inline
import numpy as np
import gfmdlayer
---
body = gfmdlayer.bonded_layer(0.2, gfmdlayer.Zener(G0=1.0, Ginf=10.0, tau=1.0))
ball = gfmdlayer.Sphere(radius=2.0)
---
contact = gfmdlayer.solve(body, ball, force=[1e-3, 2e-3], points=(32, 32))
contact.plot()
---
x = np.arange(128) / 128 - 0.5
loss = gfmdlayer.run({"grid": {"points": 128}, "time": {"end": 2.0}}, punch=-(x**2) / 2, body=body)
loss
---
gfmdlayer.plot(loss)
---
short = {"name": "screening", "grid": {"points": 128}, "time": {"end": 1.0}}
sweep = gfmdlayer.run(short, sweep={"layer.thickness": [0.05, 0.2]}, out="screening")
gfmdlayer.plot(sweep, x="time", y="contact_area", log=["x"])
---
gfmdlayer.open_results("screening").contact_area.max().item()
---
t = np.linspace(0.0, 2.0, 40)
curve = gfmdlayer.indent(gfmdlayer.halfspace(2.0), ball, t, depth=0.01 * t)
curve.plot()
---
noise = np.random.default_rng(1).normal(0.0, 1e-5, t.size)
measured = gfmdlayer.ForceCurve("ball", t, 0.01 * t, curve.force.interp(time=t).values + noise)
half = {"thickness": np.inf, "material": {"model": "elastic"}}
model = {"punch": {"shape": "sphere", "radius": 2.0}, "layer": half}
fit = gfmdlayer.fit_indentation(measured, model, "layer.material.G")
fit.plot()
---
print(fit.best_values["layer.material.G"])
"""


def test_a_notebook_runs_from_its_first_cell_to_its_last_without_a_warning(tmp_path):
    cells = [
        {"cell_type": "code", "id": str(place), "source": text.strip(), "metadata": {}, "outputs": [],
         "execution_count": None}
        for place, text in enumerate(CELLS.split("---"))
    ]  # fmt: skip
    notebook = {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    (tmp_path / "first.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    execute = ["nbconvert", "--to", "notebook", "--execute", "--output", "run.ipynb", "first.ipynb"]
    home = os.environ | {"HOME": str(tmp_path), "PYTHONWARNINGS": "default"}
    home |= {"MPLCONFIGDIR": mpl.get_cachedir()}  # with the list of fonts, which takes seconds to make
    command = [sys.executable, "-m", *execute]
    done = subprocess.run(command, cwd=tmp_path, env=home, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    outputs = [
        output
        for cell in json.loads((tmp_path / "run.ipynb").read_text(encoding="utf-8"))["cells"]
        for output in cell["outputs"]
    ]
    told = "".join("".join(output["text"]) for output in outputs if output["output_type"] == "stream")
    pictures = [output for output in outputs if "image/png" in output.get("data", {})]
    assert len(pictures) == 5
    *said, modulus = told.splitlines()
    assert np.isclose(float(modulus), 2.0, rtol=0.01)
    # Nothing else is said, but on a machine without these kernels.
    assert all(line.startswith("gfmdlayer: compiling kernels, once per machine") for line in said)


def test_the_script_that_mypy_reads_runs(tmp_path, capsys):
    typed.main(tmp_path)
    told = capsys.readouterr().out.splitlines()
    assert float(told[1]) == pytest.approx(2.0, rel=1e-3)
    assert told[2].startswith("layer.thickness: got -1")
    assert (tmp_path / "loop.png").exists()
