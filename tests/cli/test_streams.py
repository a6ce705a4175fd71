"""Closed streams, odd names of folders, and damaged files do not hide the state of results."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import gfmdlayer
from gfmdlayer.cli import main

RUN = {
    "name": "tiny",
    "grid": {"points": 32},
    "time": {"end": 0.2, "step": 0.1},
    "trajectory": {"ramp_time": 0.1, "depth": 0.02},
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    out = tmp_path_factory.mktemp("streams") / "out"
    gfmdlayer.run(RUN, out=out, sweep={"layer.thickness": [0.1, 0.2]}).close()
    return out


@pytest.mark.parametrize("closed", [">&-", pytest.param("2>&-", marks=pytest.mark.slow), "<&- >&- 2>&-"])
@pytest.mark.parametrize(("command", "status"), [("status", 0), ("report", 0), ("status none/", 2)])
def test_the_status_does_not_depend_on_open_streams(results, command, status, closed):
    """Nor is anything printed into a file that got the number of a closed stream."""
    script = "import sys; from gfmdlayer.cli import main; sys.exit(main(sys.argv[1:]))"
    line = f'"{sys.executable}" -c "{script}" {command}{results} {closed}'.replace("status/", "status /")
    line = line if command.endswith("/") else line.replace(command, f"{command} ", 1)
    before = {path: path.read_bytes() for path in results.rglob("*.h5")}
    done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    assert {path: path.read_bytes() for path in results.rglob("*.h5")} == before


def test_a_folder_may_have_any_name(results, tmp_path, capfd):
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/r\xe9sultats"))
    results.rename(odd)
    try:
        for command in (["report"], ["plot"], ["status"]):
            assert main([*command, str(odd)]) == 0, command
            assert main([*command[:1], str(odd / "cases/0000.h5")]) == (2 if command == ["status"] else 0)
        assert "<title>r\ufffdsultats" in (odd / "report.html").read_text(encoding="utf-8")
    finally:
        odd.rename(results)
    capfd.readouterr()


def test_a_damaged_case_is_named_everywhere(tmp_path, capsys):
    out, config = tmp_path / "out", RUN | {"output": {"snapshots": [0.2]}}
    gfmdlayer.run(config, out=out, sweep={"layer.thickness": [0.1, 0.2]}).close()
    case = out / "cases/0001.h5"
    contents = bytearray(case.read_bytes())
    contents[len(contents) // 2] ^= 1
    case.write_bytes(contents)
    assert main(["status", str(out)]) == 0
    counts, *lines = capsys.readouterr().out.splitlines()
    assert counts == "2 cases: 1 complete, 0 running, 0 failed, 0 waiting, 1 damaged"
    damaged = "  0001 damaged: holds other bytes than were written"
    assert [line.startswith(damaged) for line in lines].count(True) == 1
    for command in (["plot"], ["report"], ["leak"]):
        assert main([*command, str(case)]) == 2, command
        assert f"{case}: is damaged: it holds other bytes than were written" in capsys.readouterr().err
    case.write_bytes(b"\x89HDF\r\n\x1a\n")
    with gfmdlayer.open_results(out) as sweep, pytest.raises(OSError, match=r"0001\.h5: "):
        sweep.pressure.isel(thickness=1).load()
