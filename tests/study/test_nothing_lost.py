"""Nothing is lost or taken for lost: file systems without locks, files that vanish, pipes, changed tables."""

import fcntl
import os
import threading
from pathlib import Path

import numpy as np
import pytest

from gfmdlayer.case.case import Case
from gfmdlayer.cli import main
from gfmdlayer.config import Config
from gfmdlayer.results.reader import attributes, is_complete, open_case, open_results
from gfmdlayer.study import run as running
from gfmdlayer.study.case_run import warm_up
from gfmdlayer.study.cases import cases
from gfmdlayer.study.folder import FolderError

SMALL = {"grid.points": 32, "time.end": 0.3, "time.step": 0.1, "output.snapshots": [0.3]}
SWEEP = {"layer.thickness": [0.02, 0.1, 0.3]}


def small(sweep=None, **values):
    given = Config(name="small").with_values(SMALL | {k.replace("__", "."): v for k, v in values.items()})
    return Config.model_validate(given.model_dump(exclude_unset=True) | {"sweep": sweep or {}})


def test_reading_does_not_depend_on_locks(run_here):
    """HDF5 calls flock in C: files that another program has locked show whether it does."""
    run_here(small(SWEEP))
    paths = [Path("out/sweep.h5"), *Path("out/cases").glob("*.h5")]
    files = [path.open("rb") for path in paths]
    for file in files:
        fcntl.flock(file, fcntl.LOCK_EX)
    try:
        assert all(is_complete(path) for path in paths[1:])
        assert attributes(paths[0])["failed"] == ""
        with open_case(paths[1]) as case:
            assert np.isfinite(case["pressure"].to_numpy()).all()
        with open_results("out") as sweep:
            assert np.isfinite(sweep["mean_pressure"].to_numpy()).all()
            assert np.isfinite(sweep["pressure"].to_numpy()).all()
    finally:
        for file in files:
            file.close()


def test_results_beside_the_plans_of_an_earlier_version_open_and_go_on(run_here, bits):
    run_here(small(SWEEP))
    whole = bits("out")
    plans = Path("out/wisdom/fftw-3.3.10-znver3-32-and-parts.wisdom")
    plans.parent.mkdir()
    plans.write_text("(fftw-3.3.10 fftw_wisdom)")
    Path("out/cases/0001.h5").unlink()
    summary, _ = run_here(small(SWEEP))
    assert summary.count("complete") == 3
    assert bits("out") == whole
    with open_results("out") as sweep:
        assert np.isfinite(sweep["mean_pressure"].to_numpy()).all()
    run_here(small(SWEEP), restart=True)
    assert bits("out") == whole


def test_kernels_that_cannot_be_compiled_before_are_told(monkeypatch):
    def fail(*_):
        raise FloatingPointError("lengths that do not go together")

    monkeypatch.setattr(Case, "run", fail)
    assert warm_up(cases(small(SWEEP))) == [
        "the cases compile their kernels themselves: FloatingPointError: lengths that do not go together"
    ]


def test_a_configuration_through_a_pipe_is_read_from_its_beginning(capsys):
    os.mkfifo("pipe")
    text = "name: piped\n" + "# a long comment\n" * 1000 + "grid: {points: 64}\n"
    assert len(text) > 3 * 4096
    writer = threading.Thread(target=Path("pipe").write_text, args=[text])
    writer.start()
    assert main(["check", "pipe"]) == 0
    writer.join(timeout=120)
    assert not writer.is_alive()
    assert capsys.readouterr().out.startswith("piped: 1 case\n")


def table(value):
    return f"0 0\n0.3 {value}\n"


TABLES = {
    "trajectory.file": {"trajectory": {"kind": "table", "file": "table.txt"}},
    "trajectory.velocity_file": {"trajectory.velocity_file": "table.txt"},
}


def test_a_damaged_copy_of_a_table_is_replaced(run_here, bits):
    Path("table.txt").write_text(table(0.002))
    config = small(SWEEP, **TABLES["trajectory.file"])
    run_here(config)
    whole, (copy,) = bits("out"), Path("out/inputs").iterdir()
    copy.write_text(table(0.008))
    Path("out/cases/0001.h5").unlink()
    run_here(config)
    assert copy.read_text() == table(0.002)
    assert bits("out") == whole


@pytest.mark.parametrize("key", TABLES)
def test_a_table_that_changes_while_a_sweep_runs_is_read_once(key, run_here, bits, monkeypatch):
    Path("table.txt").write_text(table(0.002))
    config = small(SWEEP, **TABLES[key])
    run_here(config, "undisturbed")
    run_case = running.run_case

    def changing(*arguments, **options):
        outcome = run_case(*arguments, **options)
        Path("table.txt").write_text(table(0.004))
        return outcome

    with monkeypatch.context() as changes:
        changes.setattr(running, "run_case", changing)
        summary, _ = run_here(config)
    assert summary.count("complete") == 3
    assert bits("out") == bits("undisturbed")
    # What was computed from the table before is not mixed with what would be computed from it now,
    # not even where no case is complete.
    for case in Path("out/cases").glob("*.h5"):
        case.unlink()
    with pytest.raises(FolderError, match=r"table\.txt: has changed since the results in out were begun"):
        run_here(config)
    assert run_here(config, restart=True)[0].count("complete") == 3
    assert bits("out") != bits("undisturbed")


def test_all_files_are_on_the_disk_before_the_sweep_file_has_its_name(run_here, monkeypatch):
    """Of short cases too, whose processes do not wait for it."""
    synchronised, fsync = [], os.fsync

    def noted(descriptor):
        synchronised.append(Path(f"/proc/self/fd/{descriptor}").readlink().name.partition(".")[0])
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", noted)
    run_here(small(SWEEP, output__snapshots=[]))
    assert {"0000", "0001", "0002", "cases"} < set(synchronised[: synchronised.index("sweep")])
    # Also those that an earlier run has left, which was killed.
    for lost in ("cases/0002.h5", "sweep.h5"):
        Path("out", lost).unlink()
    synchronised.clear()
    run_here(small(SWEEP, output__snapshots=[]))
    assert {"0000", "0001", "0002", "cases"} < set(synchronised[: synchronised.index("sweep")])


def test_what_a_power_cut_leaves_of_short_cases_is_computed_again(run_here, bits):
    """A file has its name before its bytes are on the disk: it may be empty, cut short, or have holes."""
    run_here(small(SWEEP, output__snapshots=[]))
    whole = [bits(f"out/cases/{number:04d}.h5") for number in range(3)]
    holes = slice(-1 << 12, None), slice(3 << 12, None)  # with the seal
    for number, harm in enumerate((1 << 12, *holes)):
        path = Path(f"out/cases/{number:04d}.h5")
        contents = bytearray(path.read_bytes())
        if isinstance(harm, slice):
            contents[harm] = bytes(len(contents[harm]))
        path.write_bytes(contents[:harm] if isinstance(harm, int) else contents)
    Path("out/sweep.h5").unlink()
    summary, log = run_here(small(SWEEP, output__snapshots=[]))
    assert summary.count("complete") == 3
    assert log.count("is damaged: set aside") == 3
    assert [bits(f"out/cases/{number:04d}.h5") for number in range(3)] == whole
