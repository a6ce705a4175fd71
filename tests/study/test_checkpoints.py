"""Checkpoints and recordings: resumed where that gives the same bits, refused with a reason elsewhere."""

import json
import re
import time
import tracemalloc
from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from gfmdlayer import observables
from gfmdlayer.config import Config
from gfmdlayer.files.whole import seal
from gfmdlayer.observables import OBSERVABLES, Column
from gfmdlayer.results import checkpoint, provenance, recording
from gfmdlayer.results.case_file import case_contents, write_case
from gfmdlayer.results.checkpoint import CheckpointError, read_about, read_checkpoint, write_checkpoint
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import attributes
from gfmdlayer.results.recording import FEWEST, HELD, Recording
from gfmdlayer.resumable import CompositeState
from gfmdlayer.study import case_run, claims
from gfmdlayer.study.cases import Cases, SweepCase
from gfmdlayer.study.folder import Folder
from gfmdlayer.study.growth import opened
from gfmdlayer.study.interrupts import Stopped

MADE_BY = {"format": "1", "digest": "abc", "numpy_version": "2.4"}
STATE = {"solver.age": np.arange(3), "steps.time": np.asarray(0.25)}
CONFIG = Config(name="tiny").with_values({
    "grid.points": 32, "time.end": 1.0, "time.step": 0.1, "time.integrator": "backward_euler",
    "output.snapshots": [0.2, 0.8], "output.histograms": {"gap": {"max": 0.1, "bins": 3}},
    "output.patches": True,
})  # fmt: skip
CASE = SweepCase(7, CONFIG, {})


def record(into, steps):
    for step in steps:
        into.row(time=step / 3, transforms=step, gap_histogram=np.array([step, 1 / 3]))
        if step % 3 == 0:
            names = ("displacement", "pressure", "gap")
            fields = {n: np.full((4, 2), step / part) for n, part in zip(names, (7, 9, 11), strict=True)}
            below = {"stress_zz": np.full((3, 4, 2), step, np.float32)} if step % 2 == 0 else {}
            into.snapshot(step / 3, fields | below)


def content(found):
    columns = {name: found[name].tolist() for name in found.widths}
    fields = {
        name: [None if each is None else each.tobytes() for each in every]
        for name, every in found.fields.items()
    }
    return columns, found.times, fields


def expected(*parts):
    found = Recording()
    for part in parts:
        record(found, part)
    return content(found)


def resumed(path, kept, held=HELD):
    """Return a recording that goes on from what has been through a checkpoint."""
    about, arrays = kept
    found = Recording(path, held=held)
    found.go_on(json.loads(json.dumps(about)), arrays)
    return found


@pytest.fixture(autouse=True)
def snapshots_are_closed(monkeypatch):
    """Files of recordings, which here nobody closes."""
    with ExitStack() as files:
        opened = recording._opened
        monkeypatch.setattr(recording, "_opened", lambda *at: files.enter_context(opened(*at)))
        yield


@pytest.fixture
def folder(tmp_path):
    found = Folder(tmp_path)
    found.cases.mkdir()
    return found


@pytest.mark.parametrize("held", [0, 1000, HELD])
@pytest.mark.parametrize("rows", [20, 3 * FEWEST])
def test_a_recording_goes_on_from_what_a_checkpoint_has_kept(tmp_path, held, rows):
    one = Recording(tmp_path / "0", held=held)
    record(one, range(rows))
    about, arrays = one.kept()
    kept = about, {name: values.copy() for name, values in arrays.items()}
    record(one, range(rows, 2 * rows))  # after the checkpoint
    assert content(one) == expected(range(2 * rows))
    one.kept()
    one.close()
    again = resumed(tmp_path / "0", kept, held)
    assert content(again) == expected(range(rows))
    record(again, range(3 * rows, 4 * rows))  # over them
    third = resumed(tmp_path / "0", again.kept())
    assert content(third) == content(again) == expected(range(rows), range(3 * rows, 4 * rows))


def test_snapshots_go_to_the_disk_where_memory_may_not_hold_them(tmp_path):
    large = {name: np.full((64, 64), 1.0) for name in ("displacement", "pressure", "gap")}
    size = sum(field.nbytes for field in large.values())
    one = Recording(tmp_path / "0", held=2 * size)
    for instant in range(50):
        one.snapshot(float(instant), large)
    assert (tmp_path / "0").stat().st_size >= 48 * size
    tracemalloc.start()
    two = Recording(tmp_path / "1", held=2 * size)
    for instant in range(50):
        two.snapshot(float(instant), {name: field.copy() for name, field in large.items()})
    assert tracemalloc.get_traced_memory()[1] < 5 * size
    tracemalloc.stop()


def test_rows_are_in_memory_once(tmp_path):
    """Also while they are written to a checkpoint and to the file of the case."""
    names, rows = [f"c{i}" for i in range(20)], 50_000
    columns = [Column(name, name) for name in ("time", *names)]
    tracemalloc.start()
    one = Recording(tmp_path / "0")
    for i in range(rows):
        one.row(time=float(i), **dict.fromkeys(names, 0.5))
    about, arrays = one.kept()
    write_checkpoint(tmp_path / "c", MADE_BY, about, arrays)
    write_case(tmp_path / "0.h5", case_contents(one, {"x": np.arange(8.0)}, columns=columns))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2.2 * rows * 21 * 8  # of the last block, half may be empty


def test_a_recording_without_snapshots_has_no_file(tmp_path):
    one = Recording(tmp_path / "0")
    one.row(time=0.0)
    assert content(resumed(tmp_path / "0", one.kept())) == ({"time": [0.0]}, [], {})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("harm", ["gone", "truncated", "changed"])
def test_damaged_snapshots_are_refused(tmp_path, harm):
    one = Recording(tmp_path / "0")
    record(one, range(20))
    kept = one.kept()
    content = bytearray((tmp_path / "0").read_bytes())
    if harm == "gone":
        (tmp_path / "0").unlink()
    else:
        content[-1] ^= 1
        (tmp_path / "0").write_bytes(content[:-1] if harm == "truncated" else content)
    with pytest.raises(ValueError, match="which belongs to it"):
        resumed(tmp_path / "0", kept)
    if harm != "gone":  # also between the last checkpoint and the end of the run
        with pytest.raises(ResultsError, match="is damaged"):
            _ = one.fields


def test_snapshots_that_cannot_be_written_stay(tmp_path):
    one = Recording(tmp_path / "missing" / "0", held=1500)
    record(one, range(9))
    with pytest.raises(OSError, match="No such file"):
        one.kept()
    assert content(one) == expected(range(9))
    with pytest.raises(ResultsError, match=r"missing/0: cannot be written: No such file"):
        record(one, range(9, 30))


def test_a_checkpoint_is_read_as_it_was_written(tmp_path):
    write_checkpoint(tmp_path / "c", MADE_BY, {"time": 0.25}, STATE)
    read = read_checkpoint(tmp_path / "c", MADE_BY)
    assert read.about == {"time": 0.25}
    assert {name: (array.dtype, array.tolist()) for name, array in read.state.items()} == {
        name: (array.dtype, array.tolist()) for name, array in STATE.items()
    }
    assert list(tmp_path.iterdir()) == [tmp_path / "c"]


def test_a_checkpoint_of_other_origin_is_refused(tmp_path):
    write_checkpoint(tmp_path / "c", MADE_BY, {}, STATE)
    changed = {"format": "2", "digest": "abd", "numpy_version": "2.5", "processor": "other", "ranks": "2"}
    reasons = (
        "digest abc -> abd; format 1 -> 2; numpy_version 2.4 -> 2.5; processor (none) -> other; "
        "ranks (none) -> 2"
    )
    with pytest.raises(CheckpointError, match=f"would not give the same bits: {re.escape(reasons)}$"):
        read_checkpoint(tmp_path / "c", MADE_BY | changed)


def test_a_checkpoint_that_is_cut_off_or_changed_anywhere_is_refused(tmp_path):
    write_checkpoint(tmp_path / "c", MADE_BY, {}, STATE)
    content = (tmp_path / "c").read_bytes()
    for place in range(len(content)):
        changed = content[:place] + bytes([content[place] ^ 255]) + content[place + 1 :]
        for harmed in (content[:place], changed):
            (tmp_path / "bad").write_bytes(harmed)
            with pytest.raises(CheckpointError, match="it is damaged"):
                read_checkpoint(tmp_path / "bad", MADE_BY)


@pytest.mark.parametrize("about", ["[]", "{}", '{"made_by": null}', '{"made_by": {}}', "no JSON"])
def test_a_sealed_file_that_no_run_wrote_is_no_checkpoint(tmp_path, about):
    with (tmp_path / "c").open("w+b") as file:
        file.write(about.encode() + b"\n")
        seal(file)
    assert read_about(tmp_path / "c") in (None, {"made_by": {}})
    with pytest.raises(CheckpointError):
        read_checkpoint(tmp_path / "c", MADE_BY)


def test_a_checkpoint_of_version_0_2_is_named_as_one(tmp_path):
    with (tmp_path / "c").open("wb") as file:
        np.savez(file, about=np.array("{}"))
    with pytest.raises(CheckpointError, match="an earlier version of gfmdlayer wrote it"):
        read_checkpoint(tmp_path / "c", MADE_BY)


def run(folder, every=0.0):
    case = replace(CASE, config=CASE.config.model_copy())  # a run knows no columns of another one
    return case_run.run_case(case, folder, checkpoint_every=every).state


@pytest.fixture
def stop_after(monkeypatch):
    """Have the next run stop after so many steps, as a signal does; never, for 0."""
    advance = claims.Claim.advance

    def stop_after(steps):
        calls = iter(range(steps + 1))  # the first call comes before the first step

        def told(self, time):
            advance(self, time)
            if next(calls, None) == steps and steps:
                raise Stopped

        monkeypatch.setattr(claims.Claim, "advance", told)

    return stop_after


def test_a_case_stopped_twice_has_the_bits_of_one_that_was_not(folder, tmp_path, stop_after, capsys, bits):
    whole = Folder(tmp_path / "whole")
    whole.cases.mkdir(parents=True)
    assert run(whole) == "complete"
    for steps in (4, 3):
        stop_after(steps)
        assert run(folder, every=np.inf) == "stopped"
        assert not folder.case(7).exists()
    stop_after(0)
    assert run(folder) == "complete"
    assert bits(folder.case(7)) == bits(whole.case(7))
    told = capsys.readouterr().err
    assert "case 0007 goes on from time 0.3" in told
    assert "case 0007 goes on from time 0.6" in told
    assert sorted(path.name for path in folder.cases.iterdir()) == ["0007.h5"]


def test_time_and_start_of_all_parts_are_in_the_file(folder, stop_after, monkeypatch):
    from gfmdlayer.results import provenance

    monkeypatch.setattr(provenance, "now", lambda: "2026-01-01T00:00:00+00:00")
    stop_after(4)
    begun = time.monotonic()
    run(folder)
    first = time.monotonic() - begun
    monkeypatch.undo()
    time.sleep(0.2)  # which is nobody's
    begun = time.monotonic()
    assert run(folder) == "complete"
    second = time.monotonic() - begun
    known = attributes(folder.case(7))
    assert known["started"] == "2026-01-01T00:00:00+00:00"
    assert str(known["finished"]) > "2026-01-01T00:00:00+00:00"
    assert 0 < float(str(known["wall_seconds"])) <= first + second


def test_another_version_is_told_and_the_case_begins_anew(folder, stop_after, monkeypatch, capsys):
    stop_after(4)
    run(folder)
    stop_after(0)
    made_by = provenance.made_by
    monkeypatch.setattr(provenance, "made_by", lambda digest: made_by(digest) | {"git_commit": "other"})
    assert run(folder) == "complete"
    told = capsys.readouterr().err
    assert "case 0007 begins anew, its checkpoint is set aside: it would not give the same bits" in told
    assert "git_commit " in told
    assert folder.case(7, "checkpoint.aside").exists()
    assert "goes on" not in told


def test_a_checkpoint_with_a_journal_is_told_and_the_case_begins_anew(folder, stop_after, capsys, bits):
    assert run(folder) == "complete"
    whole = bits(folder.case(7))
    folder.case(7).unlink()
    stop_after(4)
    run(folder)
    stop_after(0)
    path, journal = folder.case(7, "checkpoint"), folder.case(7, "journal")
    about = read_about(path)
    assert about is not None
    kept, made_by = read_checkpoint(path, about["made_by"]), about["made_by"] | {"format": "5"}
    state = {name: each for name, each in kept.state.items() if not name.startswith("recording.")}
    old = {name: kept.about[name] for name in ("started", "elapsed", "time")}
    write_checkpoint(path, made_by, old | {"journal": [["time"], 128, 5]}, state)
    folder.case(7, "snapshots").rename(journal)
    assert run(folder) == "complete"
    reason = "begins anew, its checkpoint is set aside: it would not give the same bits: format 5 -> 9"
    assert reason in capsys.readouterr().err
    assert bits(folder.case(7)) == whole
    left = {path.name for path in folder.cases.iterdir()}
    assert left == {"0007.h5", "0007.checkpoint.aside", "0007.journal.aside"}


@pytest.mark.parametrize("change", ["fewer", "more"])
def test_a_checkpoint_with_other_columns_is_told_and_the_case_begins_anew(
    folder, stop_after, monkeypatch, capsys, change
):
    # Not an entry taken away: put back, it would stand last, behind those that read its columns.
    fewer = {name: each for name, each in OBSERVABLES.items() if name != "energy"}
    if change == "fewer":
        stop_after(4)
        run(folder)
        monkeypatch.setattr(observables, "OBSERVABLES", fewer)
    else:
        with monkeypatch.context() as before:
            before.setattr(observables, "OBSERVABLES", fewer)
            stop_after(4)
            run(folder)
    stop_after(0)
    assert run(folder) == "complete"
    told = capsys.readouterr().err
    assert "its rows have other columns, see dissipated, energy_residual, stored, work" in told


def test_a_checkpoint_with_measured_plans_is_told_and_the_case_begins_anew(folder, stop_after, capsys):
    stop_after(4)
    run(folder)
    stop_after(0)
    path = folder.case(7, "checkpoint")
    about = read_about(path)
    assert about is not None
    kept = read_checkpoint(path, about["made_by"])
    plans = {"transforms.plans": np.asarray("(of FFTW)"), "transforms.wisdom": np.asarray("(fftw)")}
    write_checkpoint(path, about["made_by"] | {"format": "5"}, kept.about, {**kept.state, **plans})
    assert run(folder) == "complete"
    assert "it would not give the same bits: format 5 -> 9" in capsys.readouterr().err


def test_checkpoints_come_at_the_interval_and_cost_little(folder, monkeypatch):
    written = []
    clock = iter(i / 8 for i in range(10**6))

    def write(*_):
        written.append(next(clock))

    monkeypatch.setattr(checkpoint, "write_checkpoint", write)
    monkeypatch.setattr(case_run.time, "monotonic", lambda: next(clock))
    kept = case_run.Checkpoints(folder, 7, "abc", 1.0, lambda _: None)
    kept.recording([])
    kept.resume(CompositeState())
    for step in range(1000):
        kept.advance(step)
    # Each look at the clock takes 1/8, and a checkpoint some of them: no more than 2 % of the time.
    assert len(written) > 2
    assert np.diff(written).min() >= 0.25 / 0.02


def test_restart_and_completion_leave_no_checkpoint(folder, stop_after):
    with opened(folder, Cases(CONFIG)):
        stop_after(4)
        run(folder)
        folder.set_aside(folder.case(7, "checkpoint"))
        run(folder)
    folder.case(7, "h5.aside").write_text("damaged")
    with opened(folder, Cases(CONFIG), restart=True):
        assert sorted(path.name for path in folder.cases.iterdir()) == [".lock"]


def test_a_checkpoint_that_outlived_its_case_is_removed(folder, stop_after):
    with opened(folder, Cases(CONFIG)):
        stop_after(4)
        run(folder)
        state = folder.case(7, "checkpoint").read_bytes()
        stop_after(0)
        run(folder)
    folder.case(7, "checkpoint").write_bytes(state)  # as if the run had been killed before it removed it
    folder.case(8, "checkpoint").write_bytes(state)  # of a case that is not complete
    with opened(folder, Cases(CONFIG)):
        assert {path.name for path in folder.cases.iterdir()} == {".lock", "0007.h5", "0008.checkpoint"}
