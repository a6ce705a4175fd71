"""Several runs over one folder: every case once, and no run disturbs another."""

import errno
import fcntl
import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer.cli import main
from gfmdlayer.config import load
from gfmdlayer.files.locks import read_json
from gfmdlayer.results.reader import open_results
from gfmdlayer.study import cases, claims
from gfmdlayer.study import run as running_study
from gfmdlayer.study.cases import Cases, Shard
from gfmdlayer.study.claims import Claim, Taken, locked
from gfmdlayer.study.folder import Folder, FolderError, name_of_run
from gfmdlayer.study.growth import opened
from gfmdlayer.study.run import RunOptions, run_study
from gfmdlayer.study.workers import assemble
from tests.studies import TINY
from tests.waiting import SLOWLY, until

SWEEP = "sweep: {layer.thickness: [0.02, 0.1, .inf], halfspace.shear_modulus: [1, 2]}\n"
# The first two cases take long enough to be caught at work.
LONG = "sweep: {time.end: [20, 19, 0.03, 0.04]}\n"


@pytest.fixture(autouse=True)
def configuration():
    Path("tiny.yaml").write_text(TINY + SWEEP)


def run(shard=None, out="out", *overrides, **options):
    with assemble() as pool:
        assert pool is not None
        config = load(Path("tiny.yaml"), overrides)
        return run_study(config, out, pool, RunOptions(shard=shard, **options))


@contextmanager
def at_work(case, *arguments, out="out"):
    """Run the study in another process; begins when it is at a case."""
    command = [sys.executable, SLOWLY, "run", "tiny.yaml", "--out", out, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        status = Path(f"{out}/cases/{case:04d}.running")
        until(lambda: (read_json(status) or {}).get("pid") == process.pid, process)
        try:
            yield process
        finally:
            process.kill()


def order(number, count, total):
    """Return the places of all cases in the order in which a run takes them."""
    shard = Shard(number, count)
    return [place for block in shard.blocks(total) for place in shard.order(block)]


@settings(max_examples=60, deadline=None)
@given(total=st.integers(1, 40), count=st.integers(1, 9), block=st.integers(1, 50), data=st.data())
def test_each_run_takes_all_cases_and_begins_where_no_other_does(total, count, block, data):
    number = data.draw(st.integers(1, count))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cases, "BLOCK", block)
        assert sorted(order(number, count, total)) == list(range(total))
        blocks = -(-total // block)
        begun = {order(each, count, total)[0] for each in range(1, count + 1)}
        # Different blocks, or different cases of one; fewer only where there are fewer cases.
        assert len(begun) >= min(count, blocks if count <= blocks else min(total % block or block, blocks))
        assert order(1, 1, total) == list(range(total))


@pytest.mark.parametrize("text", ["", "3", "0/4", "5/4", "1/0", "-1/4", "1/4/2", "a/b", "1.0/2", "²/3"])
def test_anything_but_a_shard_is_refused(text, capsys):
    with pytest.raises(ValueError, match="must be I/N"):
        Shard.parse(text)
    with pytest.raises(SystemExit) as caught:
        main(["run", "tiny.yaml", f"--shard={text}"])
    assert caught.value.code == 2
    assert "must be I/N, two whole numbers with 1 <= I <= N" in capsys.readouterr().err
    assert not Path("results").exists()


def test_a_shard_cannot_restart_the_sweep(capsys):
    assert main(["run", "tiny.yaml", "--shard", "1/2", "--restart"]) == 2
    assert "--shard and --restart cannot be combined" in capsys.readouterr().err


def test_a_run_that_starts_elsewhere_computes_all_and_the_bits_are_the_same(bits):
    assert run(out="whole").collected
    summary = run(Shard(2, 3))
    assert (summary.collected, summary.count("complete")) == (True, 6)
    assert bits("out") == bits("whole")


@contextmanager
def claimed_by(index, out="out", **changed):
    """Let another process claim a case: this one, as far as it knows."""
    folder = Folder(Path(out), name_of_run())
    with Claim(folder, index, 1.0):
        path = folder.case(index, "running")
        path.write_text(json.dumps((read_json(path) or {}) | {"token": "of another"} | changed))
        yield path
        path.unlink(missing_ok=True)


def test_a_case_that_another_run_computes_is_left_to_it():
    """Nobody collects before it is there; then the next run does, and computes nothing else."""
    Path("out/cases").mkdir(parents=True)
    with opened(Folder(Path("out")), Cases(load(Path("tiny.yaml")))), claimed_by(3):
        summary = run()
        assert (summary.count("complete"), summary.count("elsewhere"), summary.collected) == (5, 1, False)
        assert not Path("out/cases/0003.h5").exists()
    before = {path: path.stat().st_mtime_ns for path in Path("out/cases").glob("*.h5")}
    assert run().collected
    assert (
        before.items() <= {path: path.stat().st_mtime_ns for path in Path("out/cases").glob("*.h5")}.items()
    )


@pytest.fixture
def after(monkeypatch):
    """Do something when this run has computed a case, before its next one."""

    def arrange(index, act):
        run_case = running_study.run_case

        def then(case, **named):
            outcome = run_case(case, **named)
            if case.index == index:
                act()
            return outcome

        monkeypatch.setattr(running_study, "run_case", then)

    return arrange


def test_a_case_that_another_run_gives_back_is_computed(after):
    Path("out/cases").mkdir(parents=True)
    with opened(Folder(Path("out")), Cases(load(Path("tiny.yaml")))), claimed_by(0) as path:
        after(4, path.unlink)
        assert run().count("complete") == 6


def test_two_runs_that_begin_at_the_same_instant_compute_each_case_once():
    command = [sys.executable, "-m", "gfmdlayer", "run", "tiny.yaml", "--out", "out", "--jobs", "2"]
    started = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in "ab"
    ]
    told = [process.communicate(timeout=300) for process in started]
    assert [process.returncode for process in started] == [0, 0], told
    computed = [line for _, log in told for line in log.splitlines() if " complete in " in line]
    assert len(computed) == 6, told
    assert any("complete: out/sweep.h5" in output for output, _ in told)
    assert sorted(path.name for path in Path("out/cases").iterdir()) == [
        ".lock", *(f"{i:04d}.h5" for i in range(6))
    ]  # fmt: skip


def test_the_case_of_a_killed_process_is_taken_over_and_goes_on_from_its_checkpoint(bits):
    Path("tiny.yaml").write_text(TINY + "sweep: {time.end: [3, 0.03, 0.04]}\n")
    run(out="whole")
    with at_work(0, "--checkpoint-every", "0") as process:
        until(Path("out/cases/0000.checkpoint").exists, process)
        with locked(Folder(Path("out"))) as lock:  # another run is there
            assert not lock.is_alone()
            process.kill()
            process.wait()
            assert run().count("complete") == 3
    assert bits("out") == bits("whole")


@pytest.mark.parametrize("links", [True, False])
def test_a_dead_claim_is_taken_over_once(tmp_path, monkeypatch, links):
    """Of another host by its silence alone, which is counted from the date of the file."""
    if not links:
        monkeypatch.setattr(os, "link", lambda *_: (_ for _ in ()).throw(OSError(errno.EPERM, "none")))
    folder = Folder(tmp_path)
    folder.cases.mkdir()
    with claimed_by(0, tmp_path, host="elsewhere", updated=0.0) as path:
        with pytest.raises(Taken), Claim(folder, 0, 1.0):
            pass
        os.utime(path, (time.time() - 1.1 * claims.SILENCE,) * 2)
        got = []

        def take():
            try:
                with Claim(folder, 0, 1.0) as claim:
                    tried.wait()
                    claim.confirm()
                    got.append(claim)
                    confirmed.wait()
            except Taken:
                pass

        tried, confirmed = threading.Event(), threading.Event()
        takers = [threading.Thread(target=take) for _ in range(8)]
        for taker in takers:
            taker.start()
        time.sleep(20 * claims.SETTLED)
        tried.set()
        until(lambda: got)
        time.sleep(claims.SETTLED)
        confirmed.set()
        for taker in takers:
            taker.join()
        assert len(got) == 1


def test_the_file_of_a_claim_serves_the_next_one(tmp_path):
    folder = Folder(tmp_path, name_of_run())
    folder.cases.mkdir()
    files, tokens = set(), set()
    for index in range(3):
        with Claim(folder, index, 1.0, "x" * (9 - index)):
            (path,) = folder.cases.iterdir()
            assert path.name == f"000{index}.running"
            files.add(folder.case(index, "running").stat().st_ino)
            tokens.add(claims.read_claim(folder.case(index, "running")).token)
    assert (len(files), len(tokens)) == (1, 3)
    assert folder.leftovers() == [*folder.cases.iterdir()]  # of a killed run
    folder.end_run()
    assert not [*folder.cases.iterdir()]
    with Claim(folder, 3, 1.0):  # of a run that goes on
        assert claims.read_claim(folder.case(3, "running")).alive(0.0)


def test_a_file_that_has_taken_the_place_of_a_former_claim_is_left_alone(tmp_path):
    folder, other = Folder(tmp_path, name_of_run()), tmp_path / "other"
    folder.cases.mkdir()
    other.write_text("of the user")
    for put in (os.link, os.symlink):
        with Claim(folder, 0, 1.0):
            pass
        (spare,) = folder.cases.iterdir()
        spare.unlink()
        put(other, spare)
        with Claim(folder, 1, 1.0):
            assert claims.read_claim(folder.case(1, "running")).alive(0.0)
        spare.unlink(missing_ok=True)
        folder.end_run()
    assert other.read_text() == "of the user"


def test_a_suspended_process_gives_up_the_case_that_another_has_taken_over(tmp_path):
    folder = Folder(tmp_path)
    folder.cases.mkdir()
    with Claim(folder, 0, 1.0) as claim, claimed_by_file(folder.case(0, "running")) as other:
        claim._written = -float("inf")  # a second later
        with pytest.raises(Taken):
            claim.advance(0.5)
        with pytest.raises(Taken):
            claim.confirm()
    assert read_json(folder.case(0, "running")) == other


@contextmanager
def claimed_by_file(path):
    other = (read_json(path) or {}) | {"token": "of another"}
    path.write_text(json.dumps(other))
    yield other


def test_a_long_step_renews_the_claim(tmp_path):
    folder = Folder(tmp_path)
    folder.cases.mkdir()
    with Claim(folder, 0, 1.0) as claim:
        path = folder.case(0, "running")
        os.utime(path, (0.0, 0.0))
        claim.renew()
        assert path.stat().st_mtime > time.time() - claims.SILENCE


def test_a_configuration_is_changed_by_a_run_that_is_alone():
    run()
    with opened(Folder(Path("out")), Cases(load(Path("tiny.yaml")))):
        with pytest.raises(FolderError, match="another run is writing here, of another configuration"):
            run(None, "out", "sweep.layer.thickness=[0.02, 0.3]")
        with pytest.raises(FolderError, match="another run is writing here"):
            run(restart=True)
        assert main(["clean", "out", "--yes"]) == 2
        assert run().count("complete") == 6
    assert run(None, "out", "sweep.layer.thickness=[0.02, 0.3]").count("complete") == 4


def test_a_run_beside_others_removes_no_files():
    ends = ("running", "h5.host-12-0badcafe.part", "checkpoint.host-12-0badcafe.part")
    config = Cases(load(Path("tiny.yaml")))
    with opened(Folder(Path("out")), config):
        left = [Path(f"out/cases/0009.{end}") for end in ends]
        for path in left:
            path.write_text("{}")
            os.utime(path, (0.0, 0.0))
        assert run().count("complete") == 6
        assert all(path.exists() for path in left)
    run()
    assert not any(path.exists() for path in left)


def test_a_run_is_stopped_or_killed_alone():
    Path("tiny.yaml").write_text(TINY + LONG)
    with at_work(1, "--shard", "2/2") as alive:
        with at_work(0, "--shard", "1/2") as process:
            process.kill()
            process.wait()
        with at_work(0, "--shard", "1/2") as process:
            process.send_signal(signal.SIGTERM)
            _, errors = process.communicate(timeout=300)
        assert process.returncode == 75, errors
        assert alive.poll() is None
        assert json.loads(Path("out/cases/0001.running").read_text())["pid"] == alive.pid
        assert not list(Path("out/cases").glob("stop*"))


def test_a_case_that_fails_in_one_run_is_not_tried_by_another_at_work(after):
    Path("out/cases").mkdir(parents=True)
    with opened(Folder(Path("out")), Cases(load(Path("tiny.yaml")))), claimed_by(0) as path:

        def fail():
            Path("out/cases/0000.failed").write_text(json.dumps({"reason": "elsewhere", "values": {}}))
            path.unlink()

        after(4, fail)
        summary = run()
    assert [outcome.reason for outcome in summary.failures] == ["elsewhere"]
    with open_results("out") as results:
        assert "0000: elsewhere" in results.attrs["failed"]


def test_a_file_system_without_locks_keeps_runs_apart_by_their_claims(tmp_path, monkeypatch):
    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    folder = Folder(tmp_path)
    folder.cases.mkdir()
    with locked(folder) as first:
        assert first.is_alone()
        with Claim(folder, 0, 1.0), locked(folder) as second:
            assert not second.is_alone()
