"""Damaged configurations, given to `gfmdlayer check`: taken, or refused with named errors and status 2."""

from __future__ import annotations

import contextlib
import io
import traceback
from pathlib import Path
from typing import Any

import numpy as np
from trials.configurations import DEFAULT, Draw, choose, draw, dump, parse
from trials.outcomes import Hangs, Outcome, limited

from gfmdlayer import cli

SHIPPED = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
LONGEST = 10.0  # seconds of the processor
ODD_WORDS = r"""
    0 -0.0 -1 1e-300 5e-324 1e300 1e400 1e-400 .inf -.inf .nan nan inf 0x1F 0o17 1_000 1:30 true null ~ no
    '' "" 1e15 3 0.5 8. .5 +2 99999999999999999999999 [] {} [1] [1,2,3] [[]] [null] [.nan,1] [-1,-1] [1e9,1e9]
    'τ' "\0" "\ud800" 😀 !!python/object:os.system !!binary !!int !!timestamp 2001-01-01 << *a &a @x %y
    adaptive zener prony load parabola table adhesion /dev/zero /dev/null . .. ~/x ../../x nowhere.txt
"""
ODD_RANGES = (
    "{a: 1}",
    "{from: 1, to: 0, steps: 3}",
    "{from: .nan, to: 1, steps: 2}",
    "{from: 1, to: 2, steps: 1e9}",
)
ODD = (*ODD_WORDS.split(), *ODD_RANGES, "\u202e", "\ufeff")


def trial(seed: int, index: int, folder: Path) -> Outcome:
    """Damage a shipped or a drawn configuration, and check it."""
    rng = np.random.default_rng((seed, index))
    path = folder / "case.yaml"
    for source in SHIPPED[0].parent.iterdir():  # tables that they name
        if source.suffix in {".txt", ".csv", ".yml"} and not (folder / source.name).exists():
            (folder / source.name).write_bytes(source.read_bytes())
    path.write_bytes(damaged(rng, int(rng.integers(2**31))))
    with contextlib.chdir(folder):
        return checked(path)


def checked(path: Path) -> Outcome:
    """Check a file, as the command line does."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    err = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="backslashreplace")
    try:
        with limited(LONGEST), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            status = cli.main(["check", path.name])
    except Hangs:
        return Outcome("hangs", f"over {LONGEST:.0f} s")
    except (Exception, SystemExit) as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return Outcome(type(error).__name__, f"{error} ({where.filename.rpartition('/')[2]}:{where.lineno})")
    err.flush()
    said = err.buffer.getvalue().decode()  # type: ignore[attr-defined]
    if status == 0:
        odd = [line for line in said.splitlines() if not line.startswith("warning")]
        return Outcome("taken") if not odd else Outcome("unclear message", odd[0])
    if status != 2:
        return Outcome(f"status {status}", said)
    lines = said.splitlines()
    named = lines and all(line.startswith(f"gfmdlayer: {path.name}:") and len(line) < 5000 for line in lines)
    return Outcome("refused") if named else Outcome("unclear message", said[:500])


def damaged(rng: Draw, seed: int) -> bytes:
    """Return the text of a configuration with one to four damages."""
    if rng.random() < 0.5:
        text = choose(rng, *SHIPPED).read_text(encoding="utf-8")
    else:
        text = dump(draw(seed, 0, (DEFAULT,)).config)
    for _ in range(rng.integers(1, 5)):
        text = choose(rng, *DAMAGES)(rng, text)
    content = text.encode("utf-8", "surrogatepass")
    if rng.random() < 0.05 and content:  # a flipped bit, a foreign encoding
        flipped = bytearray(content)
        flipped[rng.integers(len(content))] ^= 1 << rng.integers(8)
        content = choose(
            rng, bytes(flipped), text.encode("utf-16", "replace"), text.encode("latin-1", "replace")
        )
    return content


def _tree(text: str) -> dict[str, Any] | None:
    with contextlib.suppress(Exception):
        tree = parse(text)
        return tree if isinstance(tree, dict) and tree else None
    return None


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """Return every container with every key or index in it."""
    found: list[tuple[Any, Any]] = []
    pending, seen = [tree], set()
    while pending:
        one = pending.pop()
        if id(one) in seen:  # an anchor
            continue
        seen.add(id(one))
        items = list(one.items() if isinstance(one, dict) else enumerate(one))
        found += [(one, key) for key, _ in items]
        pending += [value for _, value in items if isinstance(value, dict | list)]
    return found


def _at_a_key(change: Any) -> Any:
    """Make a damage of the text from one of the parsed configuration."""

    def damage(rng: Draw, text: str) -> str:
        tree = _tree(text)
        if tree is None:
            return text
        places = _places(tree)
        container, key = places[rng.integers(len(places))]
        change(rng, container, key)
        with contextlib.suppress(Exception):
            return dump(tree)
        return text

    return damage


def _rename(rng: Draw, container: Any, key: Any) -> None:
    if isinstance(container, dict):
        name = str(key)
        at = int(rng.integers(len(name) + 1))
        renamed = choose(
            rng, name.upper(), name[:at] + name[at + 1 :], name[:at] + "\u00e9" + name[at:], "", 7, None
        )
        container[renamed] = container.pop(key)


def _remove(_: Draw, container: Any, key: Any) -> None:
    del container[key]


def _odd_value(rng: Draw, container: Any, key: Any) -> None:
    with contextlib.suppress(Exception):  # odd values may be no YAML
        container[key] = parse(choose(rng, *ODD))


def _other_number(rng: Draw, container: Any, key: Any) -> None:
    value = container[key]
    if isinstance(value, int | float) and not isinstance(value, bool):
        container[key] = choose(
            rng, -value, 0 * value, value * 1e12, value * 1e-12, str(value), [value], value + 1
        )
    elif isinstance(value, list):
        container[key] = choose(rng, value * 2, value[:-1], value[::-1], [value], [*value, value])


def _nest(rng: Draw, container: Any, key: Any) -> None:
    for _ in range(rng.choice([1, 3, 60])):
        container[key] = choose(rng, [container[key]], {"a": container[key]}, {str(key): container[key]})


def _foreign(rng: Draw, container: Any, key: Any) -> None:
    """Put the value of another place of another configuration here."""
    other = _tree(choose(rng, *SHIPPED).read_text(encoding="utf-8"))
    places = _places(other)
    there, name = places[rng.integers(len(places))]
    container[key] = there[name]
    if isinstance(container, dict):
        container[name] = there[name]


def _odd_text(rng: Draw, text: str) -> str:
    """Put a scrap anywhere, or in place of what follows a colon."""
    scrap = choose(
        rng, *ODD, "\t", "&a ", "*a", "\x00", "\u2028", "\ud800", ": ", "- ", "#", "{", "]", "'", '"', "? "
    )
    if rng.random() < 0.5:
        at = int(rng.integers(len(text) + 1))
        return text[:at] + scrap + text[at:]
    lines = text.splitlines(keepends=True) or [""]
    i = int(rng.integers(len(lines)))
    lines[i] = lines[i].partition(":")[0] + f": {scrap}\n"
    return "".join(lines)


def _lines(rng: Draw, text: str) -> str:
    """Lose, double, swap or indent a line, or cut the text."""
    lines = text.splitlines(keepends=True) or [""]
    i, j = (int(rng.integers(len(lines))) for _ in range(2))
    match choose(rng, "lose", "double", "swap", "indent", "cut"):
        case "lose":
            del lines[i]
        case "double":
            lines.insert(j, lines[i])
        case "swap":
            lines[i], lines[j] = lines[j], lines[i]
        case "indent":
            lines[i] = choose(rng, " ", "   ", "\t", "") + lines[i].lstrip()
        case _:
            return text[: rng.integers(len(text) + 1)]
    return "".join(lines)


def _deep(rng: Draw, text: str) -> str:
    depth = int(rng.choice([10, 100, 300, 1000], p=[0.4, 0.4, 0.19, 0.01]))
    value = choose(
        rng, "[" * depth, "[" * depth + "]" * depth, "{a: " * depth + "1" + "}" * depth, "9" * depth
    )
    key = choose(rng, "layer", "sweep", "punch", "x", "name", "output")
    return f"{text}\n{key}: {value}\n"


def _anchors(rng: Draw, text: str) -> str:
    return text + choose(
        rng,
        "\na: &a [x, x]\nb: &b [*a, *a]\nc: &c [*b, *b, *b, *b]\nsweep: {layer.thickness: *c}\n",
        "\nlayer: &l {thickness: 1, self: *l}\n",
        "\nlayer: {<<: {thickness: 2}, poisson: 0.5}\n",
        "\n<<: *nothing\n",
        "\n---\nname: second\n",
        "\nsweep: {layer.thickness: {from: 0.1, to: 1, steps: 3}, grid.points: [8, 8], name: [a, b]}\n",
        "\nsweep: [{layer.thickness: 0.1}, {layer.thickness: 0.1}]\n",
        "\nsweep: {samples: {layer.thickness: [1]}}\n",
    )  # fmt: skip


DAMAGES = (
    *(
        _at_a_key(change)
        for change in (_rename, _remove, _odd_value, _odd_value, _other_number, _nest, _foreign)
    ),
    _odd_text,
    _lines,
    _deep,
    _anchors,
)
