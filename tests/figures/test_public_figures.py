"""The functions of `gfmdlayer.figures` that users call."""

import subprocess
import sys
import warnings

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer import figures


@pytest.mark.parametrize("name", figures.__all__)
def test_a_public_function_of_figures_is_documented(name):
    words = getattr(figures, name).__doc__
    assert all(f"{part}\n    ---" in words for part in ("Parameters", "Returns"))


def test_figures_draw_the_data_of_a_run():
    from gfmdlayer.figures import curves_figure, snapshots_figure, waterfall_figure

    keys = {"grid": {"points": 64}, "time": {"end": 1.0, "step": 0.5}, "output": {"snapshots": [0.5, 1.0]}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data = gfmdlayer.run(keys)
    (line,) = curves_figure(data).axes[0].lines
    np.testing.assert_array_equal(line.get_ydata(), data.contact_area_interpolated)
    assert len(snapshots_figure(data).axes) == len(snapshots_figure({"a": data}).axes)
    assert waterfall_figure(data).axes[0].lines


def test_importing_figures_imports_no_matplotlib():
    code = "import sys, gfmdlayer.figures; sys.exit('matplotlib' in sys.modules or 'numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
