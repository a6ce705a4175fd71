"""`gfmdlayer report`: write a page for the browser: curves, surfaces, cases, configuration, provenance."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.cli.terminal import COMPLETE, arguments, note_incomplete

if TYPE_CHECKING:
    from gfmdlayer.execution.folder import Folder
    from gfmdlayer.figures.report.cases import Listed

EXAMPLE = "gfmdlayer report results/figure2-quick"


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the verb."""
    arguments(parser, "path DIR  results folder, or the file of one case")
    arguments(parser, "--out FILE  the page, .html (default: DIR/report.html)")


def report(options: argparse.Namespace) -> int:
    """Write the page of results."""
    from gfmdlayer.execution.folder import Folder
    from gfmdlayer.figures.report.cases import Listed
    from gfmdlayer.figures.report.page import write_report
    from gfmdlayer.results.reader import open_case

    path = Path(options.path)
    if path.is_file():
        out = path.with_name(f"{path.stem}-report.html")
        open_case(path).close()  # refuses a file that is no case
        number = int(path.stem) if path.stem.isdecimal() else 0
        cases, title, config = [Listed(number, path, {})], path.stem, ""
    else:
        out, folder = path / "report.html", Folder(path)
        cases, title = _listed(folder), path.resolve().name
        config = folder.config.read_text(encoding="utf-8", errors="replace")
    print(write_report(cases, Path(options.out or out), title, config))
    note_incomplete(path)
    return COMPLETE


def _listed(folder: Folder) -> list[Listed]:
    """Return all cases of a folder, with the state of each."""
    from gfmdlayer.config.sweeps import combinations
    from gfmdlayer.execution.status import overview
    from gfmdlayer.figures.report.cases import Listed
    from gfmdlayer.results.stored import must_agree

    numbers, seen = folder.case_numbers(), overview(folder)
    states = dict.fromkeys(folder.numbers()["failed"], ("failed", ""))
    states |= {record.index: ("failed", record.reason) for record in seen.failures}
    states |= dict.fromkeys(folder.numbers()["h5"], ("complete", ""))
    for case in seen.running:
        states[case.index] = "running", f"at time {case.simulated_time:g} of {case.end:g}"
    values = list(combinations(folder.stored_sweep()))
    must_agree(folder.config, numbers, len(values))
    return [
        Listed(number, folder.case(number), swept, *states.get(number, ("waiting", "")))
        for number, swept in zip(numbers, values, strict=True)
    ]
