"""The picture of the body: its layers, and the relaxation of their moduli."""

import numpy as np
import pytest

from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.figures.body_plot import body_figure
from gfmdlayer.results.names import ResultsError

LAYERS = [{"thickness": 0.01, "poisson": 0.4, "material": {"G0": 4.0, "Ginf": 20.0}}, {"thickness": 1.0}]


def words(config):
    """Texts of the section of the body."""
    return [text.get_text() for text in body_figure(config).axes[0].texts]


def test_layers_and_base_are_named_with_their_thickness():
    config = Config.model_validate(
        {"name": "x", "layers": LAYERS, "units": {"length": "mm", "stress": "MPa", "time": "s"}}
    )
    assert words(config) == [
        r"layer 1: $d$ = 10 µm, $\nu$ = 0.4",
        r"layer 2: $d$ = 1 mm, $\nu$ = 0.5",
        r"halfspace, $\nu$ = 0.5",
    ]
    for modulus, base in ((np.inf, "rigid base"), (0.0, "free")):
        assert words(config.with_values({"halfspace.shear_modulus": modulus}))[-1] == base
    assert body_figure(config).axes[1].get_ylabel() == "$G$ (MPa)"


def test_moduli_relax_from_the_glassy_to_the_relaxed_one():
    config = Config.model_validate({"name": "x", "layers": LAYERS, "time": {"end": 1e3, "step": 1.0}})
    lines = body_figure(config).axes[1].get_lines()
    first, second, base = (np.asarray(line.get_ydata()) for line in lines)
    assert first[[0, -1]] == pytest.approx([20.0, 4.0], rel=2e-3)  # exp(-t/tau) at 1e-3 tau
    assert second[[0, -1]] == pytest.approx([10.0, 1.0], rel=2e-3)
    assert (base == 1.0).all()


def test_a_configuration_is_drawn_before_it_is_run(tmp_path):
    path = tmp_path / "stack.yaml"
    path.write_text("name: stack\nlayers: [{thickness: 0.1}, {thickness: 0.3}]\n")
    assert main(["plot", str(path), "--kind", "body"]) == 0
    assert (tmp_path / "stack-body.png").stat().st_size > 0
    path.write_text(path.read_text() + "sweep: {layers.0.thickness: [0.1, 0.2]}\n")
    assert main(["plot", str(path), "--kind", "body"]) == 2


def test_a_sweep_over_the_body_has_no_single_picture():
    config = Config.model_validate({"name": "x", "sweep": {"layer.thickness": [0.1, 0.2]}})
    with pytest.raises(ResultsError, match="differs between the cases"):
        body_figure(config)
