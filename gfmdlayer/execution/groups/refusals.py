"""Cases that several ranks cannot compute together are refused before any work, with the key and why."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from gfmdlayer.config import Config
from gfmdlayer.contact.solvers import SOLVERS
from gfmdlayer.execution.folder import Folder, FolderError
from gfmdlayer.execution.groups.agreement import ending_together
from gfmdlayer.execution.groups.pool import together
from gfmdlayer.execution.sweep import Case, cases, input_errors

if TYPE_CHECKING:
    from gfmdlayer.grid.ranks import Ranks


def input_errors_together(config: Config, ranks_per_case: int) -> Iterable[tuple[str, str]]:
    """Check the cases for several ranks, and by these ranks their numbers and input files.

    Parameters
    ----------
    config : Config
        The configuration.
    ranks_per_case : int
        Ranks of a case.

    Returns
    -------
    iterable of (str, str)
        Keys, and why they are refused, for `config.load`.
    """
    found = [error for case in cases(config) for error in _errors(case.config, ranks_per_case)]
    return list(dict.fromkeys(found)) or together(_input_errors, config)


def refuse_other_ranks(folder: Folder, todo: Sequence[Case], ranks_per_case: int) -> None:
    """Refuse to go on with a case that another number of ranks has begun.

    Raises
    ------
    FolderError
        If there is one; it names the number.
    """
    from gfmdlayer.results.checkpoint import read_about

    for case in todo:
        path = folder.case(case.index, "checkpoint")
        about = read_about(path) if path.exists() else None
        begun = int(about["made_by"].get("ranks", 1)) if about else ranks_per_case
        if begun != ranks_per_case:
            raise FolderError(
                f"{path}: was written by {begun} rank{'s' * (begun > 1)} a case, which alone "
                f"can go on with it; resume with --ranks-per-case {begun}, or --restart to start over"
            )


def _input_errors(ranks: Ranks, config: Config) -> list[tuple[str, str]]:
    with ending_together(ranks):
        return list(input_errors(config, ranks))


def _errors(config: Config, ranks: int) -> Iterator[tuple[str, str]]:
    from gfmdlayer.grid.slabs import refused

    each = f"with {ranks} ranks a case"
    if config.grid.axisymmetric:
        yield "grid.geometry", f"got 'axisymmetric'; must be periodic {each}"
        return
    if reason := refused(config.grid.points, ranks):
        yield "grid.points", f"got {reason}"
    chosen = config.contact_solver.method
    if not SOLVERS[chosen].distributed:
        able = " or ".join(name for name, solver in SOLVERS.items() if solver.distributed)
        yield "solver.method", f"got {chosen!r}; must be {able} {each}"
    if config.interfaces:
        yield "interface", f"attracts; must be the hard wall {each}"
    if config.trajectory.moves:
        yield "trajectory", f"moves the punch along the surface; must leave it {each}"
    if config.output.keep_state:
        yield "output.keep_state", f"got true; must be false {each}"
    if reason := config.punch.whole_only:
        yield "punch", f"{reason}, which needs the whole surface; not possible {each}"
