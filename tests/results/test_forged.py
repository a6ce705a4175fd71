"""Results of somebody else: opened, drawn and reported, they run no code and show nothing of other files."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.cli import main
from gfmdlayer.files.tables import TableError
from gfmdlayer.results.names import ResultsError
from gfmdlayer.results.reader import is_complete, stored_config
from tests.body.test_own_body import CODE

CONF = {
    "name": "bed",
    "grid": {"points": [16, 16]},
    "time": {"end": 0.2, "step": 0.1},
    "trajectory": {"ramp_time": 0.1, "depth": 0.03},
    "output": {"snapshots": [0.1, 0.2]},
}
SECRET = b"the secret of another file" * 1000
HTML = "<img src=x onerror=alert(1)>"
FOREIGN = r"is a link to another file|is stored in another file"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Return a folder with a sweep whose body is code, which writes a file `ran` when it runs."""
    folder = tmp_path_factory.mktemp("forged")
    code = f"from pathlib import Path\nPath({str(folder / 'ran')!r}).touch()\n"
    head, future, rest = CODE["winkler.py"].partition("from __future__ import annotations\n")
    (folder / "winkler.py").write_text(head + future + code + rest)
    body = {"file": str(folder / "winkler.py"), "k": 2.0}
    gfmdlayer.run(CONF, body=body, out=folder / "out", sweep={"trajectory.depth": [0.02, 0.03]}).close()
    assert (folder / "ran").exists()
    return folder


def fresh(*arguments):
    """Run the command line in a process that has run no code before."""
    script = "import sys; from gfmdlayer.cli import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)], capture_output=True, text=True, check=False
    )


# Pictures are built, which reads the results, but not drawn.
READING = """
import sys, warnings
from pathlib import Path
from matplotlib.figure import Figure
from gfmdlayer import inside, leakage, open_case, open_results
from gfmdlayer.cli import main
from gfmdlayer.config import ConfigError

drawn = Figure.savefig
Figure.savefig = lambda figure, file, **settings: (
    Path(file).touch() if isinstance(file, (str, Path)) else drawn(figure, file, **settings)
)
folder, case, out = sys.argv[1:]
with open_results(folder) as sweep, open_case(case) as one:
    sweep.load(), one.load()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert "lift" not in leakage(one, viscosity=1.0, pressure_drop=1e-3)
    assert any("lift is left out" in str(each.message) and "trust=True" in str(each.message) for each in said)
    try:
        inside(one, [0.01])
    except ConfigError as error:
        assert "is code, which is not run" in str(error), error
    else:
        raise AssertionError("the body was read")
kinds = ["curves", "loop", "snapshots", "waterfall", "movie"]
for path in (folder, case):
    of_kinds = [["plot", "--kind", each] for each in kinds[:4]]
    for command in (["plot"], ["report"]) if path == case else (*of_kinds, ["plot", "--movie"], ["report"]):
        assert main([command[0], path, *command[1:], "--out", out + "/"]) == 0, command
    assert main(["leak", path, "--viscosity", "1", "--pressure-drop", "1e-3", "--out", out + "/"]) == 0
assert main(["plot", folder, "--kind", "map", "--x", "depth", "--y", "depth", "--out", out + "/"]) in (0, 2)
assert main(["status", folder]) == 0
"""


def test_nothing_that_reads_results_runs_their_code(results, tmp_path):
    (results / "ran").unlink(missing_ok=True)
    mailed = shutil.copy(results / "out/cases/0001.h5", tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", READING, str(results / "out"), mailed, str(tmp_path / "pictures")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert not (results / "ran").exists()


@pytest.mark.parametrize(
    "path",
    [
        "out",
        pytest.param("out/cases/0000.h5", marks=pytest.mark.slow),
        pytest.param("out/config.yaml", marks=pytest.mark.slow),
    ],
)
def test_the_body_of_results_is_run_only_where_the_user_trusts_it(results, path, tmp_path):
    (results / "ran").unlink(missing_ok=True)
    asked = fresh("plot", results / path, "--kind", "body", "--out", tmp_path / "body.png")
    assert asked.returncode == 2
    assert re.search(r"body.file: .*winkler.py is code, which is not run .*--trust", asked.stderr), (
        asked.stderr
    )
    assert not (results / "ran").exists()
    given = fresh("plot", results / path, "--kind", "body", "--out", tmp_path / "body.png", "--trust")
    assert given.returncode == 0, given.stderr
    assert (results / "ran").exists()


def test_a_case_runs_again_only_where_the_user_trusts_its_code(results, tmp_path):
    (results / "ran").unlink(missing_ok=True)
    case = results / "out/cases/0000.h5"
    for verb in ("check", "run"):
        asked = fresh(verb, case, "--out", tmp_path / "again")
        assert (asked.returncode, "--trust" in asked.stderr) == (2, True)
        assert not (results / "ran").exists()
    given = fresh("run", case, "--out", tmp_path / "again", "--trust")
    assert given.returncode == 0, given.stderr


def test_a_run_compares_folders_without_running_the_code_of_others(results, tmp_path):
    """Its own configuration names the code: the folder is compared; another's is refused."""
    own = tmp_path / "own.yaml"
    stored = (results / "out/config.yaml").read_text().partition("\n")[2]
    own.write_text(stored)
    assert fresh("run", own, "--out", results / "out").returncode == 0
    (results / "ran").unlink(missing_ok=True)
    plain = tmp_path / "plain.yaml"
    plain.write_text("name: bed\ngrid: {points: 16}\n")
    other = fresh("run", plain, "--out", results / "out")
    assert (other.returncode, "which is not run" in other.stderr) == (2, True), other.stderr
    assert not (results / "ran").exists()


# Data of other files.


def foreign(h5, name, kind, secret):
    """Replace a variable by one that has its data in another file."""
    shape, dtype = h5[name].shape, h5[name].dtype
    del h5[name]
    if kind == "external storage":
        size = int(np.prod(shape)) * dtype.itemsize
        h5.create_dataset(name, shape, dtype, external=[(str(secret), 0, size)])
    elif kind == "external link":
        h5[name] = h5py.ExternalLink(f"{secret}.h5", "/secret")
    elif kind == "soft link through an external one":
        h5["there"] = h5py.ExternalLink(f"{secret}.h5", "/")
        h5[name] = h5py.SoftLink("/there/secret")
    else:
        layout = h5py.VirtualLayout(shape, dtype)
        layout[...] = h5py.VirtualSource(f"{secret}.h5", "secret", shape, dtype)
        h5.create_virtual_dataset(name, layout)


KINDS = ["external storage", "external link", "soft link through an external one", "virtual dataset"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("deep", [False, True], ids=["variable", "in a group"])
def test_data_of_other_files_are_refused(results, tmp_path, kind, deep, capsys):
    secret = tmp_path / "secret"
    secret.write_bytes(SECRET)
    folder = Path(shutil.copytree(results / "out", tmp_path / "forged"))
    case = folder / "cases/0000.h5"
    with h5py.File(case, "r+") as h5:
        with h5py.File(f"{secret}.h5", "w") as other:
            shape = h5["pressure"].shape
            size = int(np.prod(shape))
            other["secret"] = np.frombuffer(SECRET[: 8 * size].ljust(8 * size, b"x")).reshape(shape)
        if deep:
            h5["group/pressure"] = h5["pressure"]
        foreign(h5["group"] if deep else h5, "pressure", kind, secret)
    assert not is_complete(case)
    with pytest.raises(ResultsError, match=rf"0000\.h5: .*({FOREIGN})"):
        gfmdlayer.open_case(case)
    with pytest.raises(gfmdlayer.ConfigError, match=FOREIGN):
        stored_config(case)
    for command in (["plot"], ["plot", "--kind", "body"], ["report"], ["leak"], ["run"], ["check"]):
        assert main([*command, str(case)]) == 2, command
        assert re.search(FOREIGN, capsys.readouterr().err), command
    assert [path.name for path in folder.rglob("*") if path.suffix in {".png", ".html"}] == []
    # In a sweep the case is left out.
    with gfmdlayer.open_results(folder) as sweep, pytest.raises(ResultsError, match=FOREIGN):
        sweep.pressure.isel(depth=0).load()
    assert main(["report", str(folder)]) == 0
    assert '"state":"damaged"' in (folder / "report.html").read_text()


@pytest.mark.parametrize("kind", KINDS)
def test_a_collected_sweep_too(results, tmp_path, kind):
    folder = Path(shutil.copytree(results / "out", tmp_path / "forged"))
    (tmp_path / "secret").write_bytes(SECRET)
    with h5py.File(tmp_path / "secret.h5", "w") as other, h5py.File(folder / "sweep.h5", "r+") as h5:
        other["secret"] = np.zeros(h5["force"].shape)
        foreign(h5, "force", kind, tmp_path / "secret")
    with pytest.raises(ResultsError, match=FOREIGN):
        gfmdlayer.open_results(folder)
    assert main(["plot", str(folder)]) == 2


@pytest.mark.parametrize("kind", KINDS)
def test_files_of_users_too(tmp_path, kind):
    """A topography must be in the file that enters the digest."""
    from gfmdlayer.punch.scan_files import read_scan

    (tmp_path / "secret").write_bytes(SECRET)
    with h5py.File(tmp_path / "secret.h5", "w") as other, h5py.File(tmp_path / "scan.h5", "w") as h5:
        other["secret"] = h5["heights"] = np.zeros((8, 8))
        foreign(h5, "heights", kind, tmp_path / "secret")
    with pytest.raises(TableError, match=FOREIGN):
        read_scan(tmp_path / "scan.h5", 2)


# Names that are HTML.


def test_names_in_files_are_text_on_the_page(results, tmp_path):
    """The program of the page writes labels as HTML: nothing in a file may become a tag there."""
    case = Path(shutil.copy(results / "out/cases/0000.h5", tmp_path / "0000.h5"))
    with h5py.File(case, "r+") as h5:
        h5.attrs[HTML] = 1.0
        h5.attrs["name"] = h5.attrs["warnings"] = h5.attrs["hostname"] = h5.attrs["control"] = HTML
        for name in ("force", "time", "pressure", "x"):
            h5[name].attrs["long_name"] = h5[name].attrs["units"] = f"{HTML} $\\mathrm{{{HTML}}}$"
        h5.attrs["config"] = f"{h5.attrs['config']}\n# </script>{HTML}\n"
    assert main(["report", str(case)]) == 0
    page = (tmp_path / "0000-report.html").read_text(encoding="utf-8")
    own = page.replace(re.search(r"<script>/\*\*.*?</script>", page, re.S)[0], "") if "/**" in page else page
    assert HTML not in own
    assert "</script>" + HTML not in page
    data = re.search(r'<script[^>]*id="data"[^>]*>(.*?)</script>', page, re.S)[1]
    assert "<" not in data
    labels = re.findall(r'"(?:label|symbol)":"(.*?)(?<!\\)"', data)
    assert labels
    assert not any("\\u003cimg" in label for label in labels)
    program = "".join(
        (Path(gfmdlayer.__file__).parent / "figures/report").joinpath(each).read_text()
        for each in ("tables.js",)
    )
    assert "head: words(" not in program
