"""Configurations to start from: they explain every key, load, and run as they are."""

from pathlib import Path

import pytest

from gfmdlayer.cli import main
from gfmdlayer.cli.editing import TEMPLATES, commented
from gfmdlayer.config import load
from gfmdlayer.study.run import run_study
from gfmdlayer.study.workers import assemble


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_the_command_line_offers_all_of_them(capsys):
    with pytest.raises(SystemExit):
        main(["new", "--help"])
    assert ",".join(TEMPLATES) in "".join(capsys.readouterr().out.split())


# A sweep over temperatures, which a task of the gallery runs in a small form.
LONG = pytest.param("master-curve", marks=pytest.mark.slow)


@pytest.mark.parametrize("like", [LONG if each == "master-curve" else each for each in TEMPLATES])
def test_each_runs_as_it_is_written(like):
    assert main(["new", "--like", like]) == 0
    with assemble() as pool:
        assert run_study(load(f"{like}.yaml"), "out", pool).collected


@pytest.mark.parametrize("like", TEMPLATES)
def test_each_says_of_every_key_what_it_is_in_lines_that_fit(like):
    lines = commented("name", like).splitlines()
    assert max(map(len, lines)) <= 110
    keys = [line for line in lines if line.strip(" #").partition("  ")[0].endswith(":") or ": " in line]
    body = keys[keys.index(next(line for line in keys if line.startswith("name:"))) :]
    bare = {line.strip() for line in body if "  # " not in line and not line.strip().startswith("- ")}
    # The values of a sweep, or the sweep that is offered, need no words.
    assert all("sweep:" in line or "." in line.partition(":")[0] for line in bare)


@pytest.mark.parametrize("like", TEMPLATES)
def test_what_is_commented_out_has_no_default(like):
    """So that the file shows every value of the computation, and no other."""
    Path("case.yaml").write_text(commented("case", like))
    config = load("case.yaml")
    assert load_text(config.dump()) == config
    written = Path("case.yaml").read_text()
    for key in ("# depth:", "# load:"):
        given = config.trajectory.depth if "depth" in key else config.trajectory.load
        assert (key in written) == (given is None)


def load_text(content):
    Path("again.yaml").write_text(content)
    return load("again.yaml")


def test_the_file_names_the_results(capsys):
    assert main(["new", "first.yaml"]) == 0
    assert load("first.yaml").name == "first"
    assert main(["new", "not a name.yaml"]) == 2
    assert (
        "not a name.yaml: name: got the text 'not a name'; must be text of at most" in capsys.readouterr().err
    )
    assert not Path("not a name.yaml").exists()


def test_nothing_is_overwritten_unless_asked(capsys):
    Path("mine.yaml").write_text("mine")
    assert main(["new", "mine.yaml"]) == 2
    assert "mine.yaml: exists" in capsys.readouterr().err
    assert Path("mine.yaml").read_text() == "mine"
    assert main(["new", "mine.yaml", "--force"]) == 0
    assert load("mine.yaml").name == "mine"
    assert main(["new", "absent/mine.yaml"]) == 2
    assert "absent/mine.yaml: cannot be written (No such file or directory)" in capsys.readouterr().err
