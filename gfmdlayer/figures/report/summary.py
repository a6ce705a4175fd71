"""What a reader of a report looks at first: the doubts about the cases, and a plain table of them.

The table is for mail that refuses HTML: Markdown for the eye, or comma-separated values for other programs.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gfmdlayer.results.provenance import duration

MOST_DOUBTS = 12
FAILED = ("failed", "damaged")


def doubts(cases: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return each warning and reason of failure with its cases; those of most cases first."""
    found: dict[tuple[str, str], list[int]] = {}
    for case in cases:
        if case["state"] in FAILED:
            found.setdefault((case["state"], case["reason"]), []).append(case["number"])
        for line in case.get("warnings", ()):
            found.setdefault(("warning", line), []).append(case["number"])
    every = [{"kind": kind, "text": text, "cases": numbers} for (kind, text), numbers in found.items()]
    return sorted(every, key=lambda each: (each["kind"] == "warning", -len(each["cases"])))[:MOST_DOUBTS]


def looked_at_first(cases: Sequence[Mapping[str, Any]]) -> tuple[int, str] | None:
    """Return the number of the case that a reader should see, and why: lost, open, or most doubtful."""
    lost = next((case for case in cases if case["state"] in FAILED), None)
    if lost is not None:
        return lost["number"], lost["state"]
    open_balance = [case for case in cases if case.get("open") and case.get("balance") is not None]
    if open_balance:
        worst = max(open_balance, key=lambda case: case["balance"])
        return worst["number"], f"largest open energy balance, {worst['balance']:.2g}"
    warned = [case for case in cases if case.get("warnings")]
    if not warned:
        return None
    most = max(warned, key=lambda case: len(case["warnings"]))
    return most["number"], "most warnings" if len(warned) > 1 else "with a warning"


def table(data: Mapping[str, Any]) -> list[list[str]]:
    """Return the table of cases of a page's data, its headings first."""
    keys = [key["key"] for key in data["keys"]]
    heads = ["case", *keys, "status", "steps", "largest residual", "energy balance", "time", "warnings"]
    rows = [heads]
    for case in data["cases"]:
        swept = [_value(key, at) for key, at in zip(data["keys"], case["at"], strict=True)]
        numbers = [_number(case.get(name)) for name in ("residual", "balance")]
        steps = str(case["rows"] - 1) if "rows" in case else ""
        took = duration(float(case["seconds"])) if case.get("seconds") is not None else ""
        said = "; ".join(filter(None, [case["reason"], *case.get("warnings", ())]))
        rows.append([f"{case['number']:04d}", *swept, case["state"], steps, *numbers, took, said])
    return rows


def _value(key: Mapping[str, Any], at: int) -> str:
    if key["values"] is not None:
        return str(key["values"][at])
    title: str = key["titles"][at]
    return title.partition(" = ")[2] or title


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def as_csv(data: Mapping[str, Any]) -> str:
    """Return the table of cases as comma-separated values."""
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(table(data))
    return out.getvalue()


def as_markdown(data: Mapping[str, Any], title: str, worst: str) -> str:
    """Return title, doubts, accuracy, the table of cases and the provenance as Markdown."""
    return "\n".join(_lines(data, title, worst)) + "\n"


def _lines(data: Mapping[str, Any], title: str, worst: str) -> Iterator[str]:
    yield f"# {_cell(title)}"
    yield ""
    states = [case["state"] for case in data["cases"]]
    counts = ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states))
    yield f"{len(states)} case{'s' * (len(states) != 1)}: {counts}."
    yield ""
    for doubt in data["doubts"]:
        numbers = ", ".join(f"{number:04d}" for number in doubt["cases"][:6])
        more = ", ..." * (len(doubt["cases"]) > 6)
        yield f"- **{doubt['kind']}** ({numbers}{more}): {_cell(doubt['text'])}"
    if data["first"] is not None:
        yield f"- Look at case {data['first'][0]:04d} first: {data['first'][1]}."
    if worst:
        yield f"- Worst of all cases: {worst}."
    heads, *rows = table(data)
    yield ""
    yield f"| {' | '.join(heads)} |"
    yield f"|{'---|' * len(heads)}"
    for row in rows:
        yield f"| {' | '.join(map(_cell, row))} |"
    yield ""
    for name, value in data["provenance"].items():
        yield f"- {name}: {_cell(value)}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").replace("<", "&lt;")
