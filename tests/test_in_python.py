"""NUMBA_DISABLE_JIT=1 leaves all kernels to Python: the same results, slowly, for debuggers and coverage."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from tests import test_house

LINE = {
    "grid": {"points": 32},
    "time": {"end": 0.3, "step": 0.1},
    "trajectory": {"ramp_time": 0.2, "depth": 0.02},
}
SURFACE = {**LINE, "grid": {"points": [16, 16]}}
MOVING = {"trajectory": {"ramp_time": 0.2, "depth": 0.02, "velocity": 0.3}}
ADAPTIVE = {"time": {"end": 0.3, "step": "adaptive"}}
LAYER = {"thickness": 0.1, "material": {"model": "zener", "G0": 1, "Ginf": 5, "tau": 1}}
TANGENTIAL = {"displacement": 0.01, "start": 0.2, "ramp_time": 0.1}
CASES = {
    "line": LINE,
    "windows": LINE | {"grid": {"points": 256}},
    "adaptive": LINE | ADAPTIVE,
    "load": LINE | {"trajectory": {"control": "load", "load": 0.01, "ramp_time": 0.2}},
    "layers": LINE | {"layers": [LAYER, LAYER | {"poisson": 0.3}]},
    "surface": SURFACE | {"output": {"patches": True, "snapshots": [0.3]}},
    "nested gradients": SURFACE | {"solver": {"method": "nested_gradient"}},
    "fire": LINE | {"solver": {"method": "fire"}},
    "adhesion": LINE | {"interface": {"law": "exponential", "work": 1e-3, "range": 0.02}},
    "hardness": LINE | {"interface": {"law": "hard_wall", "hardness": 0.5}},
    "friction": LINE
    | {
        "interface": {"law": "coulomb", "coefficient": 0.3},
        "trajectory": {**LINE["trajectory"], "tangential": TANGENTIAL},
    },
    "moving": LINE | MOVING,
    "moving, adaptive": LINE | MOVING | ADAPTIVE,
    "isolated": {**LINE, "grid": {"points": [16, 16], "boundary": "isolated"}},
    "axisymmetric": {**LINE, "grid": {"geometry": "axisymmetric"}},
}
SCRIPT = """
import json, sys, warnings
import numpy as np
import gfmdlayer
from gfmdlayer.grid import transforms

warnings.simplefilter("ignore", UserWarning)  # coarse, on purpose
found = {}
for name, keys in json.load(sys.stdin).items():
    found[name] = gfmdlayer.run(keys).force.values.tolist()
transforms.BY_BLOCKS = 0
by_blocks, field = transforms.Transforms((24, 40)), np.random.default_rng(0).random((24, 40))
spectrum = by_blocks.forward(field)
assert np.allclose(spectrum, np.fft.rfft2(field).ravel(), rtol=0, atol=1e-12)
assert np.allclose(by_blocks.backward(spectrum), field.size * field.ravel(), rtol=1e-12)
json.dump(found, sys.stdout)
"""


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_python_runs_the_kernels_with_the_same_results():
    """Residuals of 1e-6 of both solutions: the forces agree within ten of them."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        input=json.dumps(CASES),
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for name, forces in json.loads(done.stdout).items():
        compiled = gfmdlayer.run(CASES[name]).force.values
        assert compiled.max() > 0, name
        np.testing.assert_allclose(forces, compiled, rtol=0, atol=1e-5 * compiled.max(), err_msg=name)


def test_every_intrinsic_has_its_effect_in_python_too():
    makes = re.compile(r"^from numba\S* import .*\b(intrinsic|overload)\b", re.MULTILINE)
    found = [path.name for path in test_house.FILES if makes.search(Path(path).read_text(encoding="utf-8"))]
    assert found == ["kernels.py"]
