"""What a page says of its cases in words: warnings, provenance, what it leaves out."""

from __future__ import annotations

from collections.abc import Sequence

from gfmdlayer.figures.report.cases import Contents, Listed
from gfmdlayer.observables.resolution import FEWEST
from gfmdlayer.results.provenance import LIBRARIES

SOFTWARE = ("gfmdlayer_version", "git_commit", "python_version", *(f"{name}_version" for name in LIBRARIES))


def warnings(found: Contents) -> list[str]:
    """Return the doubts about a case: those that its file tells, and those that only a log has told."""
    said = str(found.attributes.get("warnings", "")).splitlines()
    if 0 < (points := int(found.attributes.get("most_contact_points", FEWEST))) < FEWEST:
        said.append(f"coarse: at most {points} point{'s' * (points > 1)} in contact")
    if found.attributes.get("settled") == 0:
        said.append("not steady at the end")
    return said


def provenance(complete: Sequence[Contents]) -> dict[str, str]:
    """Return the values of each attribute of provenance over the cases; times from the first to the last."""
    found: dict[str, str] = {}
    for name in (*SOFTWARE, "hostname"):
        values = dict.fromkeys(str(each.attributes[name]) for each in complete if name in each.attributes)
        if values:
            found[name.replace("_", " ")] = ", ".join(values)
    for name, choose in (("started", min), ("finished", max)):
        if every := [str(each.attributes[name]) for each in complete if name in each.attributes]:
            found[name] = choose(every)
    seconds = [float(each.attributes.get("wall_seconds", 0.0)) for each in complete]
    if seconds:
        found["seconds, all cases"] = f"{sum(seconds):.4g}"
    return found


def notes(cases: Sequence[Listed], complete: Sequence[Contents]) -> dict[str, str]:
    """Return what the page leaves out of curves and of surfaces."""
    drawn = [each for each in complete if each.columns]
    thinned = [each for each in drawn if len(each.columns["time"]) < each.rows]
    found = {"curves": "", "surfaces": ""}
    if len(drawn) < len(complete):
        found["curves"] = f"The page holds the curves of {len(drawn)} of {len(complete)} complete cases. "
    if thinned:
        widest = max(thinned, key=lambda each: each.rows)
        found["curves"] += (
            f"The page holds up to {len(widest.columns['time'])} of {widest.rows} rows of a case."
        )
    have = sum(int(each.attributes.get("snapshots", 0)) > 0 for each in complete)
    held = sum(each.surfaces is not None for each in complete)
    if held < have:
        found["surfaces"] = f"The page holds the surfaces of {held} of {len(cases)} cases."
    return found
