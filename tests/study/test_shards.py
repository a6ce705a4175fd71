"""One sweep in several runs over one folder: every case once, and no run disturbs another."""

import errno
import fcntl
import json
import signal
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gfmdlayer.cli import main
from gfmdlayer.config import Config, load
from gfmdlayer.study.cost import estimate
from gfmdlayer.study.folder import Folder, FolderError
from gfmdlayer.study.growth import claimed, held
from gfmdlayer.study.run import RunOptions, run_study
from gfmdlayer.study.cases import Shard, SweepCase, cases
from gfmdlayer.study.workers import assemble
from gfmdlayer.files.locks import read_json
from gfmdlayer.results.reader import open_results
from tests.studies import TINY
from tests.waiting import SLOWLY, until

SWEEP = "sweep: {layer.thickness: [0.02, 0.1, .inf], halfspace.shear_modulus: [1, 2]}\n"
# The first case of each of two shards takes long enough to be caught at work.
LONG = "sweep: {time.end: [20, 19, 0.03, 0.04]}\n"
ENDS = ("running", "h5.host-12-0badcafe.part", "checkpoint.host-12-0badcafe.part")


@pytest.fixture(autouse=True)
def configuration():
    Path("tiny.yaml").write_text(TINY + SWEEP)


def run(shard=None, out="out", *overrides):
    with assemble() as pool:
        assert pool is not None
        return run_study(load(Path("tiny.yaml"), overrides), out, pool, RunOptions(shard=shard))


@contextmanager
def at_work(shard, case, out="out"):
    """Run a shard, or everything, in another process; begins when it is at a case."""
    arguments = ["run", "tiny.yaml", "--out", out, *(["--shard", shard] if shard else [])]
    command = [sys.executable, SLOWLY, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        status = Path(f"{out}/cases/{case:04d}.running")
        until(lambda: (read_json(status) or {}).get("pid") == process.pid, process)
        try:
            yield process
        finally:
            process.kill()


def of_length(*steps):
    """Return cases with these numbers of steps, hence of work."""
    return [
        SweepCase(index, Config(name="x").with_values({"time.end": number * 0.01, "time.step": 0.01}), {})
        for index, number in enumerate(steps)
    ]


@settings(max_examples=30, deadline=None)
@given(steps=st.lists(st.integers(1, 500), min_size=1, max_size=12), count=st.integers(1, 6))
def test_shards_cover_the_sweep_once_and_share_the_work(steps, count):
    every = of_length(*steps)
    shares = [
        [every[place] for place in Shard(number, count).places(every)] for number in range(1, count + 1)
    ]
    assert sorted(case.index for share in shares for case in share) == list(range(len(every)))
    work = [sum(estimate(case.config).work for case in share) for share in shares]
    # The shard with the last case had least work before: the spread is at most one case (and rounding).
    longest = max(estimate(case.config).work for case in every)
    assert max(work) - min(work) <= longest + len(every)


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


def test_the_last_shard_collects_and_the_bits_are_those_of_one_run(bits):
    assert run(out="whole").collected
    summaries = [run(Shard(number, 3)) for number in (2, 3, 1)]
    assert [summary.collected for summary in summaries] == [False, False, True]
    assert [summary.count("complete") for summary in summaries] == [2, 2, 2]
    assert bits("out") == bits("whole")


def test_more_shards_than_cases_do_no_harm():
    collected = [run(Shard(number, 9)).collected for number in range(1, 10)]
    # Six cases in nine shards: it is collected as soon as the sixth is there, and by the later shards again.
    assert collected == [False] * 5 + [True] * 4


def test_a_case_that_failed_in_one_shard_is_named_in_what_another_collects():
    Path("tiny.yaml").write_text(
        TINY + "solver: {method: fire}\nsweep: {solver.max_iterations: [1, 20000]}\n"
    )
    failing = next(n for n in (1, 2) if share(n, 2) == [0])
    assert not run(Shard(failing, 2)).collected
    assert run(Shard(3 - failing, 2)).collected
    with open_results("out") as results:
        assert "0000: ConvergenceError" in results.attrs["failed"]


def share(number, count):
    """Return the numbers of a shard's cases."""
    return Shard(number, count).places(cases(load(Path("tiny.yaml"))))


def test_a_run_keeps_out_those_that_would_compute_the_same_cases_and_no_others():
    config = load(Path("tiny.yaml"))
    with claimed(Folder(Path("out"), Shard(1, 2)), config, own=[0]):
        with pytest.raises(FolderError, match="another run of shard 1/2 is writing here"):
            run(Shard(1, 2))
        with pytest.raises(FolderError, match="a sweep split in 2 and not in 3"):
            run(Shard(1, 3))
        with pytest.raises(FolderError, match="another run is writing here"):
            run()
        assert run(Shard(2, 2)).count("complete") == 3
    with claimed(Folder(Path("out")), config):
        with pytest.raises(FolderError, match="another run of all the cases"):
            run(Shard(2, 2))
        with pytest.raises(FolderError, match="another run is writing here"):
            run()


def test_a_shard_removes_its_own_leftovers_and_those_of_no_live_run():
    own, other = (share(number, 2)[0] for number in (1, 2))
    with claimed(Folder(Path("out"), Shard(2, 2)), load(Path("tiny.yaml")), own=[other]):
        left, live = ([Path(f"out/cases/{i:04d}.{end}") for end in ENDS] for i in (own, other))
        for path in (*left, *live):
            path.write_text("{}")
        assert run(Shard(1, 2)).count("complete") == 3
        assert not any(path.exists() for path in left)
        assert all(path.exists() for path in live)


def test_a_shard_is_stopped_or_killed_alone_and_let_in_again_at_once():
    Path("tiny.yaml").write_text(TINY + LONG)
    own, other = (share(number, 2)[0] for number in (1, 2))
    with at_work("2/2", other) as alive:
        with at_work("1/2", own) as process:
            process.kill()
            process.wait()
        with at_work("1/2", own) as process:
            process.send_signal(signal.SIGTERM)
            _, errors = process.communicate(timeout=300)
        assert process.returncode == 75, errors
        assert alive.poll() is None
        assert json.loads(Path(f"out/cases/{other:04d}.running").read_text())["pid"] == alive.pid
        assert not list(Path("out/cases").glob("stop*"))


def test_shards_that_begin_at_the_same_instant_agree():
    command = [sys.executable, "-m", "gfmdlayer", "run", "tiny.yaml", "--out", "out", "--shard"]
    started = [
        subprocess.Popen([*command, f"{n}/2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for n in (1, 2)
    ]
    told = [process.communicate(timeout=120) for process in started]
    assert [process.returncode for process in started] == [0, 0], told
    assert any("complete: out/sweep.h5" in output for output, _ in told)
    assert sorted(path.name for path in Path("out/cases").glob("*.h5")) == [f"{i:04d}.h5" for i in range(6)]
    assert not list(Path("out").rglob("*.part"))


def test_an_exclusive_lock_is_waited_for_and_leaves_no_file(tmp_path):
    path = tmp_path / "turn"
    script = f"""
import time
from pathlib import Path
from gfmdlayer.files.locks import exclusive
count = Path({str(tmp_path / "count")!r})
for _ in range(50):
    with exclusive(Path({str(path)!r})):
        number = int(count.read_text())
        time.sleep(0.0005)
        count.write_text(str(number + 1))
"""
    (tmp_path / "count").write_text("0")
    workers = [subprocess.Popen([sys.executable, "-c", script]) for _ in range(3)]
    assert [worker.wait(timeout=300) for worker in workers] == [0, 0, 0]
    assert (tmp_path / "count").read_text() == "150"  # no two counted at once
    assert not path.exists()


def test_a_file_system_without_locks_lets_every_run_in(tmp_path, monkeypatch):
    def flock(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    one, two = (Folder(tmp_path, Shard(number, 2)) for number in (1, 2))
    one.cases.mkdir()
    with held(one) as alone, held(two) as also:
        assert not alone
        assert not also
    assert one.stop.name == "stop-1-of-2"
