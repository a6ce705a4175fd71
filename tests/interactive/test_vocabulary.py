"""The table of words in the docs, against the signatures of what users call."""

import re
from inspect import signature
from pathlib import Path

import numpy as np
import pytest

import gfmdlayer
from gfmdlayer.config import Config
from gfmdlayer.config.sweeps import leaves
from gfmdlayer.fitting.result import IndentationFit

PAGE = Path(__file__).parents[2] / "docs/reference/vocabulary.md"
ROWS = [
    [cell.strip() for cell in line.strip().strip("|").split("|")]
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| `")
]
CALLED = {
    name: called
    for name in gfmdlayer.__all__
    if not (isinstance(called := getattr(gfmdlayer, name), type) and issubclass(called, Exception))
} | {"IndentationFit.plot": IndentationFit.plot}
HALF, BALL = gfmdlayer.halfspace(1.0), gfmdlayer.Parabola(radius=1.0)
RAMP = {"time": [0.0, 1.0], "depth": [0.0, 0.01]}


def words(cell):
    return re.findall(r"`(\w+)`", cell)


def names(called):
    return signature(called).parameters


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_who_takes_a_word_has_it_in_its_signature(row):
    for name in row[2].split(", "):
        assert set(words(row[0])) <= set(names(CALLED[name])), name


def test_no_signature_and_no_key_has_another_word_for_a_thing():
    known = {name: set(names(called)) for name, called in CALLED.items()}
    known["configuration"] = {key.rpartition(".")[2] for key in leaves(Config(name="a"))}
    others = {word for row in ROWS for word in (*words(row[3]), *filter(None, row[4].split(", ")))} - {"path"}
    assert {name: found for name, own in known.items() if (found := own & others)} == {}
    assert "path" not in names(IndentationFit.plot)


def test_the_table_has_every_former_name():
    told = {each: words(row[0]) for row in ROWS for each in re.findall(r"`(\w+)` of ([\w.]+)", row[3])}
    known = {
        (old, name): [new]
        for name, called in CALLED.items()
        for old, new in getattr(vars(called).get("__init__", called), "former", {}).items()
    }
    assert {key: value[:1] for key, value in told.items()} == known


@pytest.mark.parametrize(
    ("call", "old", "new"),
    [
        (lambda **keys: gfmdlayer.indent(HALF, **RAMP, **keys), {"indenter": BALL}, {"punch": BALL}),
        (
            lambda **keys: gfmdlayer.indent(HALF, BALL, **RAMP, **keys),
            {"work_of_adhesion": 1e-4},
            {"work": 1e-4},
        ),
    ],
)
def test_a_former_name_works_and_is_told(call, old, new):
    expected = call(**new).force
    with pytest.warns(
        FutureWarning, match=f"indent: {next(iter(old))} is called {next(iter(new))} now"
    ) as told:
        assert np.array_equal(call(**old).force, expected)
    assert told[0].filename == __file__
    with pytest.raises(gfmdlayer.ConfigError, match="is the former name of"):
        call(**old, **new)


def test_a_former_name_of_a_body_works_and_is_told():
    with pytest.warns(FutureWarning, match="is called halfspace"):
        body = gfmdlayer.bonded_layer(0.1, 1.0, base=2.0, base_poisson=0.3)
    assert body == gfmdlayer.bonded_layer(0.1, 1.0, halfspace=2.0, halfspace_poisson=0.3)
    base = gfmdlayer.Halfspace(shear_modulus=2.0)
    with pytest.warns(FutureWarning, match="base is called halfspace now"):
        stack = gfmdlayer.LayerStack([gfmdlayer.Layer()], base=base)
    assert stack == gfmdlayer.LayerStack([gfmdlayer.Layer()], halfspace=base)


# --- every entry takes objects and keys ---

STACK = gfmdlayer.LayerStack(
    [gfmdlayer.Layer(0.1, 0.4, gfmdlayer.Zener()), gfmdlayer.Layer(0.2, 0.5)], rigid=True
)
ELASTIC = {"model": "elastic"}
BODIES = {
    "halfspace": (gfmdlayer.halfspace(2.0, poisson=0.3),
                  {"layer": {"thickness": np.inf, "poisson": 0.3, "material": ELASTIC | {"G": 2.0}}}),
    "young": (gfmdlayer.halfspace(young=5.2, poisson=0.3),
              {"layer": {"thickness": np.inf, "poisson": 0.3, "material": ELASTIC | {"young": 5.2}}}),
    "layer": (gfmdlayer.bonded_layer(0.1, gfmdlayer.Zener(), poisson=0.4, halfspace=3.0),
              {"layer": {"thickness": 0.1, "poisson": 0.4}, "halfspace": {"shear_modulus": 3.0}}),
    "stack": (STACK, {"layers": [{"thickness": 0.1, "poisson": 0.4}, {"thickness": 0.2, "poisson": 0.5}],
                      "halfspace": {"shear_modulus": np.inf}}),
}  # fmt: skip


@pytest.mark.parametrize("name", BODIES)
def test_a_body_is_an_object_or_its_keys_everywhere(name):
    body, keys = BODIES[name]
    short = {"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 128}}
    assert gfmdlayer.Config(name="a", body=body).solid == gfmdlayer.Config(name="a", **keys).solid
    for first, second in (
        (gfmdlayer.run(short, body=body), gfmdlayer.run(short | keys)),
        (gfmdlayer.run(short | {"body": body}), gfmdlayer.run(short | keys)),
        (
            gfmdlayer.solve(body, BALL, depth=0.01, points=128),
            gfmdlayer.solve(keys, BALL, depth=0.01, points=128),
        ),
        (gfmdlayer.indent(body, BALL, **RAMP), gfmdlayer.indent(keys, {"radius": 1.0}, **RAMP)),
    ):
        assert np.array_equal(first.force, second.force)


def test_a_pair_is_a_body_with_a_counterbody():
    short = {"time": {"end": 1.0, "step": 0.5}, "grid": {"points": 128}}
    pair = gfmdlayer.Pair(gfmdlayer.halfspace(1.0), gfmdlayer.halfspace(1.0))
    found = gfmdlayer.run(short, body=pair)
    assert found.force.values == pytest.approx(
        gfmdlayer.run(short, body=gfmdlayer.halfspace(0.5)).force.values, rel=1e-6
    )


def test_indent_converts_a_law_as_run_does():
    """The reference is the series that `run` takes over the same times."""
    law = gfmdlayer.PowerLaw(G=1.0, tau=1.0, exponent=0.3)
    found = gfmdlayer.indent(gfmdlayer.halfspace(law), BALL, **RAMP)
    series = law.prony(1e-4, 1.0).material
    expected = gfmdlayer.indent(gfmdlayer.halfspace(series), BALL, **RAMP)
    assert float(found.force[-1]) == pytest.approx(float(expected.force[-1]), rel=1e-9)


# --- signatures and help ---


def test_signatures_have_names_in_place_of_keys():
    """`run` takes the dotted keys of a configuration, `Case` its parts."""
    for name, called in CALLED.items():
        if name not in ("run", "converge", "Case"):
            kinds = {each.kind for each in names(called).values()}
            assert not kinds & {4, 2}, name  # VAR_KEYWORD, VAR_POSITIONAL
    shown = str(signature(gfmdlayer.Zener))
    assert shown.startswith("(G0: float = 1.0, Ginf: float = 10.0, tau: float = 1.0, *,")
    assert str(signature(gfmdlayer.Sphere)) == "(*, radius: float)"


def test_help_of_the_package_is_a_screen_of_names_by_task(capsys):
    import pydoc

    text = pydoc.render_doc(gfmdlayer)
    assert text.count("\n") < 80
    missing = [name for name in gfmdlayer.__all__ if not re.search(rf"\b{name}\b", text)]
    assert not missing
    assert dir(gfmdlayer) == sorted(gfmdlayer.__all__)
    assert capsys.readouterr().out == ""
