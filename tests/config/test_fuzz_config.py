"""Any file at all, given to the command line: it is run, or refused with named errors and exit status 2.

Damaged configurations are trials of `scripts/soak.py` (`tests/scripts/test_soak.py`).

With --hypothesis-profile=long (see `conftest`) these take ten thousand examples, runs a third of them.
"""

import contextlib
import io
import shutil

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from gfmdlayer import cli
from gfmdlayer.config import Config
from gfmdlayer.config.sweeps import leaves
from gfmdlayer.punch.shapes import SHAPES

anything = settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)


@pytest.fixture
def folder(tmp_path_factory, monkeypatch):
    """A folder from which the command line is used; results go there."""
    path = tmp_path_factory.mktemp("fuzz")
    monkeypatch.chdir(path)
    return path


def gfmdlayer(*arguments):
    """Exit status and error output of the command line; whatever it raises goes through."""
    # The streams encode as a terminal's do.
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    err = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="backslashreplace")
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = cli.main(arguments)
    err.flush()
    return status, err.buffer.getvalue().decode()


def accepted_or_refused(path, content):
    """Check what the command line makes of a file; return whether it takes it."""
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "surrogatepass"))
    status, errors = gfmdlayer("check", path.name)
    if status == 0:
        assert all(line.startswith("warning") for line in errors.splitlines())
    else:
        assert status == 2
        assert errors
        for line in errors.splitlines():
            assert line.startswith(f"gfmdlayer: {path.name}:")
    return status == 0


# --- text, and YAML that looks like a configuration ---

ODD_NUMBERS = """
    -0 0.0 1e-300 1e300 5e-324 -1e-9 0.5 0.49999999 1e400 1e-400 .inf -.inf .nan 0x1F 0o17 1_000 1:30 1e15
    123456789012345678901234567890 1e-3 +2 8. .5
"""
ODD_WORDS = """
    null ~ true no yes << = | > % @ ` !!int !!binary &a *a !!python/object:os.system 2001-01-01 ''
    "\\0" "\\ud800" "\\U0001F600" "a\\nb" adaptive zener prony depth load table ramp_hold parabola sphere cone
    array self_affine profile topography fire active_set exponential backward_euler log linear x y
"""
NUMBERS = st.one_of(
    st.integers(-3, 40).map(str),
    st.floats().map(lambda x: repr(x).replace("inf", ".inf").replace("nan", ".nan")),
    st.sampled_from(ODD_NUMBERS.split()),
    st.integers(400, 6000).map(lambda digits: "9" * digits),
)
WORDS = st.sampled_from([*ODD_WORDS.split(), "\t"])
SCALARS = st.one_of(NUMBERS, WORDS, st.text(max_size=8).map(lambda text: "'" + text.replace("'", "''") + "'"))
KEYS = sorted(
    {part for key in leaves(Config(name="all")) for part in key.split(".")}
    | {key for shape in SHAPES.values() for key in shape.model_fields}
    | {"name", "sweep", "branches", "pressure", "gap", "bins", "scale", "min", "max", "G"}
)
DOTTED = leaves(Config(name="all"))


def misspelt(key):
    places = st.integers(0, len(key) - 1)
    return st.one_of(
        places.map(lambda i: key[:i] + key[i + 1 :]), places.map(lambda i: key[: i + 1] + key[i:]),
        st.just(key.upper()), st.just(f"'{key}\\0'"),
    )  # fmt: skip


def flow(values, keys):
    lists = st.lists(values, max_size=4).map(lambda items: f"[{', '.join(items)}]")
    pairs = st.lists(st.tuples(keys, values), max_size=5)
    return st.one_of(lists, pairs.map(lambda items: "{" + ", ".join(f"{k}: {v}" for k, v in items) + "}"))


names = st.one_of(st.sampled_from(KEYS), st.sampled_from(KEYS).flatmap(misspelt))
trees = st.recursive(SCALARS, lambda values: flow(values, names), max_leaves=12)


@st.composite
def structures(draw):
    """Draw known sections with known or misspelt keys, and values of any kind."""
    lines = [draw(st.sampled_from(["name: x", "name: x", "name: ../x", "nmae: x", "name: [x]"]))]
    sections = {}
    for dotted in draw(st.lists(st.sampled_from(DOTTED), max_size=6)):
        section, _, key = dotted.partition(".")
        sections.setdefault(section, []).append(f"{key.rpartition('.')[2]}: {draw(trees)}")
    for section, entries in sections.items():
        lines.append(f"{section}: {{{', '.join(entries)}}}")
    if draw(st.booleans()):
        shape = draw(st.sampled_from(list(SHAPES.values())))
        keys = [key for key in shape.model_fields if key != "shape" and draw(st.booleans())]
        entries = [
            f"shape: {shape.model_fields['shape'].default}",
            *(f"{key}: {draw(trees)}" for key in keys),
        ]
        lines.append(f"punch: {{{', '.join(entries)}}}")
    if draw(st.booleans()):
        swept = st.one_of(st.sampled_from(DOTTED), st.sampled_from(DOTTED).flatmap(misspelt), names)
        values = st.lists(SCALARS, max_size=4).map(lambda items: f"[{', '.join(items)}]")
        pairs = draw(st.lists(st.tuples(swept, st.one_of(values, trees)), max_size=3))
        lines.append("sweep: {" + ", ".join(f"{key}: {value}" for key, value in pairs) + "}")
    return "\n".join(lines) + "\n"


@anything
@given(content=st.one_of(st.binary(max_size=200), st.text(), trees))
def test_any_bytes_are_accepted_or_refused(folder, content):
    accepted_or_refused(folder / "case.yaml", content)


@anything
@given(content=structures())
@example("name: x\ntime: {end: 1e300, step: 1e-300, integrator: backward_euler}\n")
@example("name: x\ntime: {end: 1e300, step: 1e-300}\n")
@example("name: x\ngrid: {points: 1000000000000000000000000000000}\n")
@example("name: x\ngrid: {points: 1000000000000000}\npunch: {shape: sphere, radius: 1}\n")
@example("name: x\ngrid: {points: " + "9" * 400 + "}\n")
@example("name: x\ngrid: {period: 1e200}\n")
@example("name: x\npunch: {shape: array, element: {shape: cone, slope: 1}, counts: " + "9" * 400 + "}\n")
@example("name: x\npunch: {shape: profile, file: 'a\\0b'}\n")
@example('name: x\npunch: {shape: profile, file: "a\\0b"}\n')
@example("name: x\npunch: {shape: profile, file: " + "a" * 5000 + "}\n")
@example("{{a}}: 1")
def test_what_looks_like_a_configuration_is_accepted_or_refused(folder, content):
    accepted_or_refused(folder / "case.yaml", content)


@anything
@given(
    override=st.one_of(st.text(), trees.map("sweep.layer.thickness={}".format), trees.map("punch={}".format))
)
def test_any_override_is_taken_or_refused(folder, override):
    (folder / "case.yaml").write_text("name: x\n")
    status, errors = gfmdlayer("check", "case.yaml", f"--set={override}")
    assert status in (0, 2)
    for line in errors.splitlines():
        assert line.startswith(("gfmdlayer: case.yaml:", "gfmdlayer: --set") if status else "warning")


@pytest.mark.parametrize(
    "content",
    [
        "a: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b]\nd: [*c, *c]\n",
        "name: x\nlayer: &l {thickness: 1, self: *l}\n",
        "[" * 2000,
        "[" * 1_000_000,
        "{a: " * 3000 + "1" + "}" * 3000,
        "name: x\n" + "- " * 3000 + "x\n",
        "? " * 3000,
        "name: x\nname: x\n",
        "--- \nname: x\n---\nname: y\n",
        "\ufeff",
        "name: x\r\rlayer:\r  thickness: 1\r",
        "name: x\nlayer:\n\tthickness: 1\n",
        "!!set {name}\n",
        "%TAG ! tag:x,2000:\n---\nname: x\n",
    ],
    ids=lambda text: text[:12],
)
def test_texts_that_are_hard_to_read_are_refused_or_taken(folder, content):
    accepted_or_refused(folder / "case.yaml", content)


# --- files that a configuration names ---

ROWS = st.lists(st.lists(st.one_of(NUMBERS, st.just("x")), max_size=3).map(" ".join)).map("\n".join)
FILES = st.one_of(
    st.binary(max_size=100),
    ROWS.map(str.encode),
    st.binary(max_size=60).map(lambda rest: b"\x93NUMPY\x01\x00" + rest),
)


def npy(value):
    stream = io.BytesIO()
    np.save(stream, np.asarray(value))
    return stream.getvalue()


@anything
@given(
    content=FILES,
    use=st.sampled_from(
        [
            "trajectory: {kind: table, file: FILE}",
            "trajectory: {kind: table, control: load, file: FILE}",
            "punch: {shape: profile, file: FILE}",
            "punch: {shape: topography, file: FILE}",
            "punch: {shape: topography, file: FILE, fill: membrane, detrend: plane, resample: fourier}",
        ]
    ),
    suffix=st.sampled_from([".txt", ".npy", ".csv", ".xyz", ".asc", ".h5", ".nc", ".x3p", ""]),
)
@example(b"0 0\n1 1e308\n", "trajectory: {kind: table, file: FILE}", ".txt")
@example(b"0 1e308\n" * 8, "punch: {shape: profile, file: FILE}", ".txt")
@example(npy([1.0, 2.0]), "punch: {shape: profile, file: FILE}", ".npy")
@example(npy(["a"] * 8), "punch: {shape: profile, file: FILE}", ".npy")
@example(npy([1j] * 8), "punch: {shape: profile, file: FILE}", ".npy")
@example(npy([1e308, -1e308] * 4), "punch: {shape: profile, file: FILE}", ".npy")
@example(npy([np.nan] * 8), "punch: {shape: topography, file: FILE, fill: membrane}", ".npy")
@example(npy(1.0), "punch: {shape: topography, file: FILE}", ".npy")
@example(npy(np.zeros((0, 3))), "punch: {shape: topography, file: FILE}", ".npy")
def test_files_of_any_content_are_accepted_or_refused(folder, content, use, suffix):
    (folder / f"data{suffix}").write_bytes(content)
    config = f"name: x\ngrid: {{points: 8}}\n{use.replace('FILE', f'data{suffix}')}\n"
    accepted_or_refused(folder / "case.yaml", config)


# --- what is taken, run ---

SMALL = "name: x\ngrid: {points: 16}\ntime: {end: 0.2, step: 0.1}\n"


@st.composite
def small(draw):
    """Draw a configuration that is mostly sound, and quickly run where it is."""
    section, *keys = draw(
        st.sampled_from([key.split(".") for key in DOTTED if key.partition(".")[0] not in ("grid", "time")])
    )
    inner = f"{keys[-1]}: {draw(SCALARS)}"
    for key in reversed(keys[:-1]):
        inner = f"{key}: {{{inner}}}"
    return f"{SMALL}{section}: {{{inner}}}\n"


@settings(anything, max_examples=settings.default.max_examples // 3)  # each is a run
@given(content=small())
def test_what_check_takes_is_run(folder, content):
    if not accepted_or_refused(folder / "case.yaml", content):
        return
    shutil.rmtree(folder / "results", ignore_errors=True)
    status, errors = gfmdlayer("run", "case.yaml", "--out", "results")
    assert status == 0, errors
