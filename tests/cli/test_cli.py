"""The command line: its output, its speed, its exit statuses, and its response to signals."""

import json
import os
import pty
import re
import shlex
import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
import pytest

from gfmdlayer.cli import VERBS, main
from gfmdlayer.files.locks import read_json
from gfmdlayer.study.interrupts import STOP_SIGNALS
from tests.studies import TINY
from tests.waiting import SLOWLY, until

ROOT = Path(__file__).parents[2]
HEAVY = ("numba", "pyfftw", "h5py", "matplotlib", "xarray", "mpi4py", "numpy", "scipy", "rich")
SURFACE = """\
name: surface
grid: {points: [32, 16]}
time: {end: 0.4, step: 0.1}
trajectory: {ramp_time: 0.2}
output: {snapshots: [0.2, 0.4], patches: true, histograms: {pressure: {max: 1.0}, gap: {max: 0.1}}}
"""
TERMINAL = os.environ | {"TERM": "xterm-256color", "COLUMNS": "120"}
SWEEP = TINY + "sweep: {layer.thickness: [0.02, 0.1, .inf]}\n"
LAST_FAILS = TINY + "solver: {method: fire}\nsweep: {solver.max_iterations: [20000, 30000, 1]}\n"
# Where steps take 50 ms, the second case takes 10 s, long enough for a signal to arrive in it.
SECOND_TAKES_LONG = TINY + "sweep: {time.end: [0.03, 2]}\n"


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("tiny.yaml").write_text(SWEEP)


@pytest.fixture(autouse=True, scope="module")
def signals():
    """Undo what `run` does in this process."""
    handlers = {signum: signal.getsignal(signum) for signum in STOP_SIGNALS}
    yield
    for signum, handler in handlers.items():
        signal.signal(signum, handler)


def gfmdlayer(*arguments):
    """Run the command line in this process, which starts no other Python."""
    with (
        redirect_stdout(StringIO()) as output,
        redirect_stderr(StringIO()) as errors,
        mock.patch.dict(os.environ),
    ):
        try:
            status = main(arguments)
        except SystemExit as end:
            status = int(end.code or 0)
    return subprocess.CompletedProcess(arguments, status, output.getvalue(), errors.getvalue())


def interrupted(signum, *arguments):
    """Run the command line and send it a signal while case 1 is at work."""
    command = [sys.executable, SLOWLY, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        steps = lambda: (read_json(Path("out/cases/0001.running")) or {}).get("steps", 0)  # noqa: E731
        until(lambda: Path("out/cases/0000.h5").exists() and steps() > 0, process)
        process.send_signal(signum)
        output, errors = process.communicate(timeout=300)
    return subprocess.CompletedProcess(command, process.returncode, output, errors)


@pytest.mark.parametrize(
    ("arguments", "most"),
    [(["--help"], 40_000), (["run", "--help"], 40_000), (["check", "configs/figure2.yaml"], 600_000)],
)
def test_help_and_check_answer_at_once(arguments, most):
    """In function calls, imports included, of which two million take about a second: as many on any machine.

    Measured: 35 500 (37 400 on Python 3.11.2) and 574 000, in 0.06 and 0.28 s: each key of a section takes
    about 1000. None of the heavy packages is imported.
    """
    script = f"""
import cProfile, io, pstats, sys
with cProfile.Profile() as profile:
    from gfmdlayer.cli import main
    try:
        status = main({arguments!r})
    except SystemExit as end:
        status = end.code
assert not status
print([name for name in {HEAVY!r} if name in sys.modules])
print(pstats.Stats(profile, stream=io.StringIO()).total_calls)
"""
    if most > 40_000:  # the time of an FFT pair is measured when it is asked for first
        subprocess.run([sys.executable, "-c", script], capture_output=True, cwd=ROOT, check=True)
    process = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT, check=True
    )
    *_, heavy, calls = process.stdout.splitlines()
    assert heavy == "[]"
    assert 1_000 < int(calls) < most


def test_help_needs_no_docstrings():
    """There are none under `python -OO`."""
    command = [sys.executable, "-OO", "-m", "gfmdlayer", "--help"]
    assert "check" in subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True).stdout


def test_version_is_that_of_the_distribution():
    assert re.fullmatch(r"gfmdlayer \d+\.\d+\.\d+(\.dev\d+)?\n", gfmdlayer("--version").stdout)


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """A folder with small configurations, where the example of `gfmdlayer --help` was run."""
    folder = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "configs", folder / "configs")
    quick = folder / "configs/figure2-quick.yaml"
    small = quick.read_text().replace("points: 1024", "points: 128").replace("[0.5, 1.0, 2.0, 8.0]", "[8.0]")
    quick.write_text(re.sub(r"thickness: \[.*\]", "thickness: [0, 0.25]", small))
    seal = folder / "configs/seal-quick.yaml"
    small = seal.read_text().replace("128, 128", "32, 32").replace("cutoff: 0.04", "cutoff: 0.16")
    seal.write_text(small.replace("end: 100.0", "end: 0.02").replace(", 1.0, 100.0]", "]"))
    paste(example(), folder)
    return folder


def example(*verb):
    """Return the example in a verb's help."""
    return gfmdlayer(*verb, "--help").stdout.partition("example:\n")[2].splitlines()[0].strip()


def paste(command, folder):
    """Do what a shell does: in this process where it only starts `gfmdlayer` several times."""
    if re.search("[$>]", command):
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        pasted = subprocess.run(
            ["bash", "-c", command],
            capture_output=True, text=True, check=False, cwd=folder, env=os.environ | {"PATH": path},
        )  # fmt: skip
        assert pasted.returncode == 0, pasted.stderr
        return
    for each in command.split("&&"):
        program, *arguments = shlex.split(each)
        assert program == "gfmdlayer"
        with chdir(folder):
            process = gfmdlayer(*arguments)
        assert process.returncode == 0, process.stderr


@pytest.mark.parametrize("verb", [verb.name for verb in VERBS])
def test_the_example_in_each_verbs_help_works_when_pasted(verb, clone):
    command = example(verb)
    assert f"gfmdlayer {verb}" in command
    if verb == "verify":  # which tests/verification runs
        assert command == "gfmdlayer verify --quick"
    else:
        paste(command, clone)


@pytest.mark.parametrize(
    "arguments", [[], ["rum", "tiny.yaml"], ["run"], ["run", "tiny.yaml", "--jobs", "x"]]
)
def test_bad_usage_is_explained(arguments):
    process = gfmdlayer(*arguments)
    assert process.returncode == 2
    assert process.stderr.startswith("usage: gfmdlayer")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "absent.yaml"], "absent.yaml"),
        (["check", "absent.yaml"], "absent.yaml"),
        (["run", "tiny.yaml", "--set", "time.ende=2"], "time.ende"),
        (["run", "tiny.yaml", "--out", "tiny.yaml"], "is a file"),
        (["status", "absent"], "absent: no such folder"),
        (["status", "."], "not a results folder"),
        (["clean", "."], "not a results folder"),
        (["run", "tiny.yaml", "--only-failed"], "results/tiny: no such folder"),
        (["plot", "absent"], "absent: no such folder"),
        (["plot", "tiny.yaml"],
         "tiny.yaml: is a configuration; must be results, such as the folder results/NAME"),
        (["plot", "absent", "--kind", "map", "--log-time"], "--log-time: only with --kind curves"),
        (["plot", "absent", "--movie", "--time", "1"], "--time: only with --kind map"),
        (["plot", "absent", "--fps", "25"], "--fps: only with --kind movie"),
        (["plot", "absent", "--movie", "--fps", "0"], "--fps: got 0; must be a whole number from 1 to 100"),
        (["plot", "absent", "--select", "thickness"], "must be KEY=VALUE, such as thickness=0.1"),
        (["plot", "absent", "--select", "d=1", "d=2"], "--select: d is given twice"),
        (["plot", "absent", "--kind", "map", "--time", "late"], "must be a number, end, max or min"),
    ],
)  # fmt: skip
def test_bad_input_is_refused_in_a_line_without_a_traceback(arguments, message):
    process = gfmdlayer(*arguments)
    assert process.returncode == 2
    assert message in process.stderr
    assert process.stderr.startswith("gfmdlayer: ")
    assert len(process.stderr.splitlines()) == 1
    assert not Path("results").exists()


def test_check_lists_cases_and_work_and_runs_nothing():
    shown = gfmdlayer("check", "tiny.yaml").stdout
    assert "tiny: 3 cases" in shown
    assert "0002  thickness = inf" in shown
    assert re.search(r"steps +9\n", shown)
    assert [path.name for path in Path().iterdir()] == ["tiny.yaml"]


def test_run_status_and_plot_follow_each_other():
    process = gfmdlayer("run", "tiny.yaml")
    assert (process.returncode, process.stdout) == (0, "complete: results/tiny/sweep.h5\n")
    shown = gfmdlayer("status", "results/tiny").stdout
    first, *warnings = shown.splitlines()
    assert first == "3 cases: 3 complete, 0 running, 0 failed, 0 waiting"
    assert all(line.startswith(("warning: ", "accuracy, the worst: ")) for line in warnings)
    process = gfmdlayer("plot", "results/tiny", "--out", "tiny.png")
    assert process.returncode == 0, process.stderr
    assert Path("tiny.png").read_bytes().startswith(b"\x89PNG")


def test_a_surface_in_two_dimensions_is_described_for_paraview_drawn_and_removed_by_restart():
    Path("surface.yaml").write_text(SURFACE)
    assert gfmdlayer("run", "surface.yaml").returncode == 0
    described = Path("results/surface/cases/0000.xdmf")
    assert "0000.h5:/gap" in described.read_text()
    process = gfmdlayer("plot", "results/surface/cases/0000.h5", "--kind", "snapshots", "--out", "maps.svg")
    assert (process.returncode, process.stdout) == (0, "maps.svg\n"), process.stderr
    process = gfmdlayer("plot", "results/surface", "--movie", "--out", "surface.gif")
    assert (process.returncode, process.stdout) == (0, "surface.gif\n"), process.stderr
    process = gfmdlayer("run", "surface.yaml", "--restart", "--set", "output.snapshots=[]")
    assert process.returncode == 0
    assert not described.exists()


def test_processes_give_the_bits_of_one_and_a_failing_case_makes_the_status_1(bits):
    Path("tiny.yaml").write_text(LAST_FAILS)
    for jobs in ("1", "2"):
        process = gfmdlayer("run", "tiny.yaml", "--out", jobs, "--jobs", jobs)
        assert process.returncode == 1
        assert "1 of 3 cases failed" in process.stdout
        assert "0002: ConvergenceError" in process.stdout
        shown = gfmdlayer("status", jobs).stdout
        assert "2 complete, 0 running, 1 failed, 0 waiting" in shown
        assert "0002 failed: ConvergenceError" in shown
    assert bits("1") == bits("2")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Results of the sweep with the long case, run without a signal."""
    folder = tmp_path_factory.mktemp("undisturbed")
    (folder / "tiny.yaml").write_text(SECOND_TAKES_LONG)
    assert gfmdlayer("run", str(folder / "tiny.yaml"), "--out", str(folder / "out")).returncode == 0
    return folder / "out"


@pytest.mark.parametrize(
    ("signum", "jobs"),
    [
        pytest.param(signal.SIGHUP, "2", marks=pytest.mark.slow),
        (signal.SIGINT, "1"),
        (signal.SIGTERM, "2"),
        (signal.SIGUSR1, "1"),
        pytest.param(signal.SIGUSR2, "2", marks=pytest.mark.slow),
        pytest.param(signal.SIGXCPU, "1", marks=pytest.mark.slow),
    ],
)
def test_a_signal_stops_a_run_that_the_same_command_resumes(signum, jobs, undisturbed, bits, capfd):
    Path("tiny.yaml").write_text(SECOND_TAKES_LONG)
    command = ("run", "tiny.yaml", "--out", "out", "--jobs", jobs)
    process = interrupted(signum, *command)
    assert process.returncode == 75, process.stderr
    assert "Traceback" not in process.stderr
    left = {path.name for path in Path("out/cases").iterdir()}
    assert left == {".lock", "0000.h5", "0001.checkpoint"}  # which has no snapshots
    assert "1 complete, 0 running, 0 failed, 1 waiting" in gfmdlayer("status", "out").stdout
    before = Path("out/cases/0000.h5").read_bytes()
    process = gfmdlayer(*command)
    assert process.returncode == 0, process.stderr
    assert "1 complete already" in process.stderr
    assert "case 0001 goes on from time" in process.stderr + capfd.readouterr().err  # of a worker
    assert Path("out/cases/0000.h5").read_bytes() == before
    assert {path.name for path in Path("out/cases").iterdir()} == {".lock", "0000.h5", "0001.h5"}
    assert bits("out") == bits(undisturbed)


@pytest.fixture(scope="module")
def complete(tmp_path_factory):
    """Results of the tiny sweep."""
    folder = tmp_path_factory.mktemp("complete")
    (folder / "tiny.yaml").write_text(SWEEP)
    assert gfmdlayer("run", str(folder / "tiny.yaml"), "--out", str(folder / "out")).returncode == 0
    return folder / "out"


def test_a_case_runs_again_from_its_file(complete, bits):
    process = gfmdlayer("run", str(complete / "cases/0001.h5"))
    assert (process.returncode, process.stdout) == (0, "complete: results/tiny-0001/sweep.h5\n")
    swept, alone = bits(complete / "cases/0001.h5"), bits("results/tiny-0001/cases/0000.h5")
    assert {name: each for name, each in swept.items() if name != "thickness"} == alone  # the swept value


@pytest.mark.parametrize(("name", "reason"), [
    ("sweep.h5", "sweep.h5: holds no configuration; must be YAML, or the file of a case"),
    ("half.h5", "half.h5: not a complete result file"),
])  # fmt: skip
def test_a_file_without_a_configuration_is_refused(name, reason, complete):
    shutil.copy(complete / "sweep.h5", "sweep.h5")
    Path("half.h5").write_bytes((complete / "cases/0000.h5").read_bytes()[:5000])
    process = gfmdlayer("run", name)
    assert (process.returncode, process.stderr) == (2, f"gfmdlayer: {reason}\n")


@pytest.mark.parametrize("seconds", ["-1", "nan", "often"])
def test_an_impossible_interval_is_refused(seconds):
    process = gfmdlayer("run", "tiny.yaml", "--checkpoint-every", seconds)
    assert process.returncode == 2
    assert f"got {seconds}; must be a number of seconds >= 0, or inf" in process.stderr


def test_status_needs_no_file_but_the_results():
    Path("path.txt").write_text("0 0\n1 0.001\n")
    table = SWEEP.replace("{ramp_time: 0.03}", "{kind: table, file: path.txt}")
    Path("tiny.yaml").write_text(table)
    assert gfmdlayer("run", "tiny.yaml", "--out", "out").returncode == 0
    Path("path.txt").unlink()
    assert "3 complete, 0 running, 0 failed, 0 waiting" in gfmdlayer("status", "out").stdout


def test_a_killed_worker_costs_its_case_and_no_other():
    """The first process takes the longest case, and another one the next."""
    Path("tiny.yaml").write_text(SECOND_TAKES_LONG.replace("2]", "2, 1.9, 0.05, 0.06]"))
    command = [sys.executable, SLOWLY, "run", "tiny.yaml", "--out", "out", "--jobs", "2"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    begun = Path("out/cases/0002.running")
    until(begun.exists, process)
    worker = json.loads(begun.read_text())["pid"]
    assert worker != process.pid
    os.kill(worker, signal.SIGKILL)
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 1
    assert "1 of 5 cases failed" in output
    assert [path.name for path in Path("out/cases").glob("*.failed")] == ["0002.failed"]
    assert "4 complete, 0 running, 1 failed, 0 waiting" in gfmdlayer("status", "out").stdout


def test_workers_do_not_outlive_a_killed_run():
    Path("tiny.yaml").write_text(SECOND_TAKES_LONG)
    interrupted(signal.SIGKILL, "run", "tiny.yaml", "--out", "out", "--jobs", "2")
    until(lambda: "0 running" in gfmdlayer("status", "out").stdout)
    assert gfmdlayer("run", "tiny.yaml", "--out", "out").returncode == 0


def read_terminal(keyboard):
    """Read what a closed terminal still holds; the system ends it with an error where there is no more."""
    found = b""
    with suppress(OSError):
        while part := os.read(keyboard, 65536):
            found += part
    os.close(keyboard)
    return found.decode()


def test_a_terminal_shows_cases_at_work_and_a_log_does_not_load_what_draws_them():
    """Nor what only reading and figures need: xarray takes half a second and 40 MB of each process."""
    names = ("rich", "xarray", "pandas", "matplotlib", "mpi4py")
    script = "import sys; from gfmdlayer.cli import main; assert main(sys.argv[1:]) == 0; "
    script += f"print([name for name in {names} if name in sys.modules])"
    command = [sys.executable, "-c", script, "run", "tiny.yaml", "--out"]
    without = {name: value for name, value in os.environ.items() if not name.startswith(("PMI", "OMPI"))}
    process = subprocess.run([*command, "log"], capture_output=True, text=True, check=True, env=without)
    assert process.stdout.splitlines()[-1] == "[]"
    keyboard, screen = pty.openpty()
    with ThreadPoolExecutor() as reader:
        shown = reader.submit(read_terminal, keyboard)  # an unread terminal fills up
        process = subprocess.run(
            [*command, "bar"], stdout=subprocess.PIPE, stderr=screen, text=True, check=False, env=TERMINAL
        )
        os.close(screen)
    assert process.returncode == 0
    assert "rich" in process.stdout.splitlines()[-1]
    assert "100%" in shown.result()
    assert "3 of 3 complete" in shown.result()
    assert re.search(r"3 cases ended in .* s; slowest 000\d in \d", shown.result())


def test_a_reader_that_leaves_is_no_error():
    command = f"{shlex.quote(sys.executable)} -m gfmdlayer check tiny.yaml; echo $? >&2"
    process = subprocess.run(
        ["bash", "-c", f"({command}) | true"], capture_output=True, text=True, check=True
    )
    assert process.stderr == "0\n"


def test_changes_to_a_measured_surface_are_reported_by_check_by_the_log_and_by_the_file():
    heights = np.cos(2 * np.pi * np.arange(32) / 32) + 0.1 * np.arange(32)
    heights[5] = np.nan
    np.save("measured.npy", heights)
    punch = "punch: {shape: topography, file: measured.npy, unit: 0.1, detrend: plane"
    Path("refused.yaml").write_text(SWEEP + punch + "}\n")
    refused = gfmdlayer("check", "refused.yaml")
    assert refused.returncode == 2
    assert "refused.yaml:6:34: punch.file:" in refused.stderr
    assert "1 of 32 points have no height, the first at index [5]" in refused.stderr
    assert "Traceback" not in refused.stderr

    Path("rough.yaml").write_text(SWEEP + punch + ", fill: membrane, taper: 0.2}\n")
    checked, ran = gfmdlayer("check", "rough.yaml"), gfmdlayer("run", "rough.yaml", "--out", "out")
    assert (checked.returncode, ran.returncode) == (0, 0)
    done = [
        "1 of 32 points have no height; a membrane between their neighbours fills them in",
        "the plane of least squares was subtracted; rms height from",
        "heights fade out over 0.2 of the cell; rms height from",
    ]
    with h5py.File("out/cases/0001.h5") as file:
        kept = str(file.attrs["warnings"])
    for text in done:
        assert f"warning: {Path('measured.npy').absolute()}: {text}" in checked.stdout
        assert ran.stderr.count(text) == 1
        assert text in kept


def test_threads_are_logged():
    ran = gfmdlayer("run", "tiny.yaml", "--out", "out", "--threads", "2")
    assert ran.returncode == 0
    assert "1 process, 2 threads each" in ran.stderr
