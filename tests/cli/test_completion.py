"""Completion on a command line, as a shell does it."""

import shlex
import subprocess
from pathlib import Path

import pytest

from gfmdlayer.cli import VERBS, main


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_a_script_with_every_verb(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for verb in VERBS:
        assert verb.name in script


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        (["che"], {"check"}),
        (["run", "--j"], {"--jobs"}),
        (["plot", "--style", ""], {"paper", "screen"}),
        (["completion", "z"], {"zsh"}),
        (["run", "figu"], {"figure.yaml"}),
        (["status", "res"], {"results"}),
    ],
)
def test_bash_completes(words, completed, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("figure.yaml").touch()
    Path("results").mkdir()
    main(["completion", "bash"])
    Path("script").write_text(capsys.readouterr().out)
    ask = f"""
source ./script
COMP_WORDS=(gfmdlayer {shlex.join(words)}); COMP_CWORD={len(words)}
_shtab_gfmdlayer
printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    shown = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    assert set(shown.stdout.split()) == completed
