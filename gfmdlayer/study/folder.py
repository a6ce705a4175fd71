"""The results folder: its files, its stored configuration; the configuration stored with a case.

    DIR/config.yaml        the configuration with every default written out; its first line marks the folder
    DIR/cases/NNNN.h5      a complete case
    DIR/cases/NNNN.xdmf    description of a surface in two dimensions for ParaView
    DIR/cases/NNNN.failed  why a case failed (JSON)
    DIR/cases/NNNN.ended   why a complete case ended early (JSON)
    DIR/cases/NNNN.running claim of the process that computes a case, with its progress (JSON)
    DIR/cases/NNNN.checkpoint, .snapshots  an unfinished case: its state and its rows; its snapshots
    DIR/cases/NNNN.state   state of a case before its end, for one with a later end
    DIR/cases/NNNN.*.aside a damaged case or an unusable checkpoint, left to the user
    DIR/inputs/            the files that the configuration names, as the cases read them
    DIR/cases/stop-RUN     asks every process of a run to stop, on whatever host
    DIR/cases/.lock        locked while runs share the folder, or one changes it (`gfmdlayer.study.claims`)
    DIR/arrays/            punch and history of a run from Python that were arrays
    DIR/sweep.h5           all cases, labelled
    DIR/warnings.txt       the warnings of complete cases, if there are any
    DIR/accuracy.txt       the worst of what the cases note on their accuracy
    DIR/convergence.h5     estimated errors, from runs in DIR/convergence/ (`gfmdlayer.convergence`)

Every file is written whole (`gfmdlayer.files.whole`), so that a reader never sees half of one.

A number belongs to one case for ever. The head of config.yaml says how many cases the sweep has, and their
numbers where these do not run from 0, because the sweep has grown (`gfmdlayer.study.growth`).
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import socket
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from gfmdlayer.body.bodies import code_refused
from gfmdlayer.config import Config, ConfigError, load
from gfmdlayer.config.reader import Inspection
from gfmdlayer.errors import GfmdlayerError
from gfmdlayer.files.hdf5 import is_hdf5
from gfmdlayer.files.locks import is_gone, open_for_writing, regular, write_new
from gfmdlayer.files.whole import UNFINISHED, is_unfinished, unfinished, write_text
from gfmdlayer.results import stored
from gfmdlayer.results.names import ResultsError
from gfmdlayer.study.cases import input_errors

MARK = stored.MARK
FOREIGN = "is not empty and not a results folder of gfmdlayer: {}; choose another with --out"
NO_CONFIG = "no config.yaml"
ASIDE = ".aside"
Numbers: TypeAlias = Mapping[str, set[int]]  # kind of file -> numbers of the cases that have one
Found = TypeVar("Found")
WAYS_OUT = "choose another folder with --out, or --restart to start over"


class FolderError(GfmdlayerError):
    """A folder cannot be used for these results; the message names the reason and a remedy.

    Examples
    --------
    >>> from pathlib import Path
    >>> _ = Path("notes.txt").write_text("not results")
    >>> try:
    ...     gfmdlayer.run({"grid": {"points": 64}}, out=".")
    ... except gfmdlayer.FolderError as error:
    ...     print(str(error).partition(";")[0])
    .: is not empty and not a results folder of gfmdlayer: no config.yaml
    """


@dataclass(frozen=True)
class Folder:
    """The results folder at `path`, as a run uses it."""

    path: Path
    run: str = ""  # name of the run, which no other run has

    @property
    def config(self) -> Path:
        """The configuration of the results."""
        return self.path / "config.yaml"

    @cached_property
    def cases(self) -> Path:
        """The folder of the cases' files."""
        return self.path / "cases"

    @property
    def sweep(self) -> Path:
        """All cases in one file."""
        return self.path / "sweep.h5"

    @property
    def warnings(self) -> Path:
        """The warnings of the cases as text, for an overview that opens no result file."""
        return self.path / "warnings.txt"

    def add_warnings(self, index: int, lines: Iterable[str]) -> None:
        """Add those of a complete case, until the sweep file is collected, which has those of all."""
        if text := "".join(f"case {index:04d}: {line}\n" for line in dict.fromkeys(lines)):
            with self.warnings.open("a", encoding="utf-8") as file:
                file.write(text)

    @property
    def accuracy(self) -> Path:
        """The worst accuracy of the cases in the sweep file as text, likewise."""
        return self.path / "accuracy.txt"

    @cached_property
    def stop(self) -> Path:
        """A file that asks every process of the run to stop, whatever host it is on."""
        return self.cases / f"stop-{self.run}"

    def case(self, index: int, kind: str = "h5") -> Path:
        """Return the file of a case; `kind` is h5, failed, ended, running, checkpoint or snapshots."""
        return self.cases / f"{index:04d}.{kind}"

    def spare(self, index: int, process: int) -> Path:
        """Return the name of the file that a process of the run keeps between its claims."""
        return self.cases / f"{index:04d}.running.{process}-{self.run}{UNFINISHED}"

    def end_run(self) -> None:
        """Remove the files of the run itself, when none of its processes computes any more."""
        with suppress(OSError):
            self.stop.unlink(missing_ok=True)
        ending = f"-{self.run}{UNFINISHED}"
        for path in _files(self.cases, lambda name: name.endswith(ending)):
            with suppress(OSError):
                path.unlink(missing_ok=True)

    def numbers(self) -> Numbers:
        """Return the numbers of the cases that have a file, by its kind, from one listing of the folder."""
        numbers: defaultdict[str, set[int]] = defaultdict(set)
        with suppress(FileNotFoundError), os.scandir(self.cases) as entries:
            for entry in entries:
                number, _, kind = entry.name.partition(".")
                as_written = len(number) == 4 or (len(number) > 4 and number[0] != "0")
                if as_written and kind and number.isascii() and number.isdecimal():
                    numbers[kind].add(int(number))
        return numbers

    def set_aside(self, path: Path) -> None:
        """Rename a file that cannot be used, if it exists; it is left to the user."""
        with suppress(FileNotFoundError):
            path.replace(path.with_name(path.name + ASIDE))

    def leftovers(self) -> list[Path]:
        """Return the files that dead runs left: unfinished ones, claims, checkpoints of complete cases."""

        def is_left(name: str) -> bool:
            if name.endswith(".h5"):  # there may be a million
                return False
            if _OF_A_RUN.fullmatch(name):
                return True
            state = _matched(_STATE, name)
            ended = state is not None and self.case(int(state[1])).exists()
            return ended or _matched(_OF_A_CASE, name) is not None

        return [*_files(self.path, _IN_FOLDER.fullmatch), *_files(self.cases, is_left)]

    def unfinished(self) -> list[Path]:
        """Return all unfinished files, those of figures too."""
        return [path for place in (self.path, self.cases) for path in _files(place, is_unfinished)]

    def remove_results(self) -> None:
        """Remove the results in a locked folder, known by their exact names, and nothing else."""
        results = _files(self.cases, lambda name: _matched(_RESULT, name))
        inputs = _files(self.path / "inputs", _INPUT.fullmatch)
        for path in (self.sweep, self.warnings, self.accuracy, *results, *inputs, self.config):
            path.unlink(missing_ok=True)

    def set_damaged_aside(self, numbers: Iterable[int]) -> list[str]:
        """Rename files of complete cases that are damaged; return a line on each."""
        lines = []
        for number in numbers:
            if (path := self.case(number)).exists():
                refuse_unreadable(path)
                self.set_aside(path)
                lines.append(f"case {number:04d} is damaged: set aside as {path.name}{ASIDE}, computed again")
        return lines

    def refuse_open_files(self, numbers: Iterable[int]) -> None:
        """Refuse to replace files of cases, or the sweep file, while they are open elsewhere."""
        for path in (self.sweep, *map(self.case, numbers)):
            if path.exists() and open_for_writing(path):
                raise FolderError(f"{path}: is open for writing in another program; close it there first")

    def refuse_foreign(self) -> None:
        """Refuse a folder that holds something else than results."""
        if self.path.exists() and not self.path.is_dir():
            raise FolderError(f"{self.path}: is a file, not a folder; choose another with --out")
        names = {entry.name for entry in self.path.iterdir()} if self.path.is_dir() else set()
        # A run killed in its first instant leaves folders and an unfinished configuration.
        own = [name for name in names if name in _FOLDERS or _OF_ESTIMATES.fullmatch(name)]
        foreign = [name for name in names.difference(own) if not _IN_FOLDER.fullmatch(name)]
        if foreign and not self.is_results():
            raise FolderError(f"{self.path}: {FOREIGN.format(self.lacking)}")

    @property
    def is_there(self) -> bool:
        """Whether nobody has removed the folder during a run."""
        return not is_gone(self.cases)

    @property
    def lacking(self) -> str:
        """The reason why this folder does not hold results."""
        if not self.config.exists():
            return NO_CONFIG
        with suppress(OSError):
            if self.config.stat().st_size == 0:
                return "config.yaml is empty; restore it where this was one"
        return "config.yaml does not begin as a run writes it"

    def is_results(self) -> bool:
        """Whether the folder was made by gfmdlayer; FolderError where this user may not read that."""
        try:
            with open(self.config, "rb", opener=regular) as file:
                return file.readline() == MARK.encode()
        except PermissionError:
            raise FolderError(f"{self.config}: cannot be read; this user must be allowed to") from None
        except OSError:
            return False

    def stored_config(self) -> Config:
        """Return the configuration of the results."""
        try:
            with code_refused():  # but that of the user's own configuration, which was run before
                return self._stored(load)
        except ConfigError as error:
            reasons = "; ".join(error.problems)
            raise FolderError(f"{self.path}: its configuration cannot be read: {reasons}") from None

    def stored_sweep(self) -> dict[str, list[Any]]:
        """Return the sweep of the results; works without the input files that their configuration names."""
        return dict(self._stored(stored.document).get("sweep") or {})

    def case_numbers(self) -> Sequence[int]:
        """Return the numbers of the cases in the order of the sweep, without reading the configuration."""
        return self._stored(stored.case_numbers)

    def _stored(self, read: Callable[[Path], Found]) -> Found:
        self.must_hold_results()
        try:
            return read(self.config)
        except ResultsError as error:
            raise FolderError(str(error)) from None

    def store(self, config: Config, numbers: Sequence[int]) -> None:
        """Write the configuration of the results, with the numbers of its cases."""
        write_text(self.config, stored.head(numbers) + config.dump())

    def keep_input(self, path: Path, changed: bool) -> Path:
        """Copy a file that the configuration names to NAME-PLACE-CONTENTS.SUFFIX, which the cases read.

        FolderError where the file has changed since the results were begun, and the configuration has not.
        """
        try:
            content = path.read_bytes()
            place, hashed = (hashlib.sha256(each).hexdigest()[:16] for each in (bytes(path), content))
            kept = self.path / "inputs" / f"{path.stem}-{place}-{hashed}{path.suffix}"
            same = kept.exists()  # by its name; the copy itself may be damaged
            if same and kept.is_file() and kept.read_bytes() == content:
                return kept
            kept.parent.mkdir(exist_ok=True)
            if not (changed or same) and any(f"-{place}-" in other.name for other in kept.parent.iterdir()):
                begun = f"the results in {self.path} were begun"
                raise FolderError(f"{path}: has changed since {begun}; {WAYS_OUT}")
            with unfinished(kept) as part:
                write_new(part, content)
        except OSError as error:
            raise FolderError(f"{path}: cannot be copied into {self.path} ({error.strerror})") from None
        return kept

    def must_hold_results(self) -> None:
        """Refuse a folder that does not hold results."""
        if not self.path.is_dir():
            raise FolderError(f"{self.path}: no such folder")
        if not self.is_results():
            from gfmdlayer.results.reader import ONLY_ESTIMATES, only_estimates

            if only_estimates(self.path):
                raise FolderError(f"{self.path}: {ONLY_ESTIMATES}")
            raise FolderError(f"{self.path}: not a results folder of gfmdlayer: {self.lacking}")


# Files of dead runs are removed, and results with --restart; records of failures, files set aside for the
# user and other programs' files never are.

# The version before had a journal in place of the snapshots.
_RESULT = re.compile(r"(\d{4,})\.(h5|xdmf|failed|ended|checkpoint|snapshots|journal|state)(\.aside)?")
_INPUT = re.compile(r".+-[0-9a-f]{16}-[0-9a-f]{16}(\.\w+)?")
_OWN = r"\..+-\d+-[0-9a-f]{8}"  # of a process; see `unfinished_path`
_IN_FOLDER = re.compile(rf"(config\.yaml|sweep\.h5|warnings\.txt|accuracy\.txt|convergence\.h5){_OWN}\.part")
_OF_A_CASE = re.compile(rf"(\d{{4,}})\.(running|(h5|xdmf|failed|ended|running|checkpoint|state){_OWN}\.part)")
_STATE = re.compile(r"(\d{4,})\.(checkpoint|snapshots|journal)")
# The last three of the version before, whose shards had locks.
_OF_A_RUN = re.compile(
    rf"stop-.+-\d+-[0-9a-f]{{8}}|probe{_OWN}\.part|stop(-\d+-of-\d+)?|\.lock-\d+-of-\d+|\.turn"
)
_FOLDERS = ("cases", "arrays", "inputs")  # left by a run that was killed in its first instant
_OF_ESTIMATES = re.compile(r"convergence(\.(h5|png|pdf|svg))?")  # of errors, which may come before the run


def _matched(pattern: re.Pattern[str], name: str) -> re.Match[str] | None:
    """Match a name that begins with the number of a case, written as ours are."""
    match = pattern.fullmatch(name)
    return match if match is not None and match[1] == f"{int(match[1]):04d}" else None


def _files(folder: Path, meant: Callable[[str], object]) -> list[Path]:
    """Return the files of a folder whose names are `meant`; other ones cost no memory."""
    with suppress(FileNotFoundError), os.scandir(folder) as entries:
        named = (entry for entry in entries if meant(entry.name))
        return sorted(Path(entry.path) for entry in named if entry.is_file(follow_symlinks=False))
    return []


def refuse_unreadable(path: Path) -> None:
    """Refuse a file that is there and that this user may not read; it is neither missing nor damaged."""
    if path.exists() and not os.access(path, os.R_OK):
        raise FolderError(f"{path}: cannot be read; this user must be allowed to")


def name_of_run() -> str:
    """Return a name that no other run has."""
    return f"{socket.gethostname()}-{os.getpid()}-{secrets.token_hex(4)}"


def is_result(path: str | Path) -> bool:
    """Tell whether a file is one of results, and not a configuration in YAML; a pipe is not, and not read."""
    with suppress(OSError):
        return is_hdf5(path)
    return False


def read_config(
    path: str | Path,
    overrides: Iterable[str] | Mapping[str, object] = (),
    inspect: Inspection | None = input_errors,
    *,
    trust: bool = False,
) -> Config:
    """Read a configuration, from YAML or a case's result file, and check its numbers and input files.

    Code that a result file names is run only with `trust`.
    """
    if is_result(path):
        from gfmdlayer.results.reader import stored_config

        return stored_config(path, overrides, inspect, trust=trust)
    return load(path, overrides, inspect)
