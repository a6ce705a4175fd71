"""One rule for every `--out` of a file: a folder takes it under its default name."""

import os
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.cli import main

RUN = {
    "name": "seal",
    "grid": {"points": [16, 16]},
    "time": {"end": 0.2, "step": 0.1},
    "trajectory": {"ramp_time": 0.1, "depth": 0.03},
    "output": {"snapshots": [0.1, 0.2]},
}
FIT = ["fit-indentation", "gel.csv", "--model", "model.yml"]
# command -> the files that it writes in a folder by default, and with --out NAME
COMMANDS = {
    ("plot", "seal"): ("seal.png", "NAME.png"),
    ("plot", "seal", "--kind", "body"): ("body.png", "NAME.png"),
    ("plot", "seal", "--movie"): ("seal.gif", "NAME.gif"),
    ("report", "seal"): ("report.html", "NAME.html"),
    ("leak", "seal"): ("seal-leak.png", "NAME.png"),
    ("fit-material", "curve.csv"): ("curve.yaml", "NAME/curve.yaml"),
    tuple(FIT): ("gel-fit.yaml", "NAME.yaml"),
}


@pytest.fixture(autouse=True, scope="module")
def inputs(tmp_path_factory):
    """Work in a folder with results and measured curves."""
    before, folder = Path.cwd(), tmp_path_factory.mktemp("out")
    os.chdir(folder)
    gfmdlayer.run(RUN, out="seal").close()
    time = np.linspace(0.0, 2.0, 21)
    depth = np.minimum(time, 1.0) * 0.1
    rows = np.column_stack((time, depth, depth**1.5))
    np.savetxt("gel.csv", rows, delimiter=",", header="time,depth,force", comments="")
    Path("model.yml").write_text(
        "layer: {thickness: .inf, material: {model: elastic, G: 1}}\n"
        "punch: {shape: parabola, radius: 5}\nfree: [layer.material.G]\n"
    )
    t = np.geomspace(0.01, 100, 30)
    np.savetxt(
        "curve.csv", np.column_stack((t, 1 + 4 * np.exp(-t))), header="t,G", delimiter=",", comments=""
    )
    yield
    os.chdir(before)


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_a_folder_takes_the_default_name_and_a_name_its_ending(command, tmp_path, monkeypatch):
    if "--movie" in command:
        monkeypatch.setattr("shutil.which", lambda _: None)  # no ffmpeg
    default, named = COMMANDS[command]
    (folder := tmp_path / "outd").mkdir()
    new = tmp_path / "new" / "deep"
    assert main([*command, "--out", str(folder)]) == 0
    assert main([*command, "--out", f"{new}/"]) == 0
    assert main([*command, "--out", str(tmp_path / "NAME")]) == 0
    assert (folder / default).is_file()
    assert (new / default).is_file()
    assert (tmp_path / named).is_file()
    assert {path.name.partition(".")[0] for path in tmp_path.iterdir()} <= {
        "outd",
        "new",
        "NAME",
        "NAME-snapshots",
    }


def test_the_working_folder_is_a_folder(capsys):
    assert main([*FIT, "--out", "."]) == 0
    assert Path("gel-fit.yaml").is_file()
    assert main([*FIT, "--out", "."]) == 2
    assert "gel-fit.yaml: exists" in capsys.readouterr().err
    assert main([*FIT, "--out", "gel.csv"]) == 2
    assert "gel.csv: cannot be written: is another file" in capsys.readouterr().err


def test_a_new_configuration_too(tmp_path):
    assert main(["new", str(tmp_path)]) == 0
    assert main(["new", str(tmp_path / "first")]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"indentation.yaml", "first.yaml"}


@pytest.mark.usefixtures("undrawn")
def test_the_flow_of_a_leak_too(tmp_path):
    assert main(["leak", "seal", "--out", str(tmp_path), "--fields", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"seal-leak.png", "seal-leak.h5"}
