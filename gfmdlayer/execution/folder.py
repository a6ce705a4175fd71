"""The results folder: its files, its stored configuration.

    DIR/config.yaml        the configuration with every default written out; its first line marks the folder
    DIR/cases/NNNN.h5      a complete case
    DIR/cases/NNNN.xdmf    description of a surface in two dimensions for ParaView
    DIR/cases/NNNN.failed  why a case failed (JSON)
    DIR/cases/NNNN.running progress of a case (JSON)
    DIR/cases/NNNN.checkpoint, .journal0  state of an unfinished case
    DIR/cases/NNNN.*.aside a damaged case or an unusable checkpoint, left to the user
    DIR/cases/stop         asks every process of the run to stop; stop-3-of-16 those of a shard
    DIR/inputs             punch and history of a run from Python that were arrays
    DIR/sweep.h5           all cases, labelled

Every file is written whole (`gfmdlayer.files.whole`), so that a reader never sees half of one.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gfmdlayer.config import Config, ConfigError, load, text
from gfmdlayer.execution.sweep import Shard

MARK = "# Results of gfmdlayer: their configuration, every default written out.\n"
ASIDE = ".aside"
WAYS_OUT = "choose another folder with --out, or --restart to start over"


class FolderError(Exception):
    """A folder cannot be used for these results; the message says why and what to do."""


@dataclass(frozen=True)
class Folder:
    """The results folder at `path`, used by a run of all cases or of a shard."""

    path: Path
    shard: Shard | None = None

    @property
    def config(self) -> Path:
        """The configuration of the results."""
        return self.path / "config.yaml"

    @property
    def cases(self) -> Path:
        """The folder of the cases' files."""
        return self.path / "cases"

    @property
    def sweep(self) -> Path:
        """All cases in one file."""
        return self.path / "sweep.h5"

    @property
    def stop(self) -> Path:
        """A file that asks every process of the run to stop, whatever host it is on."""
        own = "" if self.shard is None else f"-{self.shard.number}-of-{self.shard.count}"
        return self.cases / f"stop{own}"

    def case(self, index: int, kind: str = "h5") -> Path:
        """Return the file of a case; `kind` is h5, failed, running, checkpoint or journal0."""
        return self.cases / f"{index:04d}.{kind}"

    def numbers(self) -> Mapping[str, set[int]]:
        """Return the numbers of the cases that have a file, by its kind, from one listing of the folder."""
        found: defaultdict[str, set[int]] = defaultdict(set)
        with suppress(FileNotFoundError), os.scandir(self.cases) as entries:
            for entry in entries:
                number, _, kind = entry.name.partition(".")
                if number.isdecimal() and entry.name == f"{int(number):04d}.{kind}":
                    found[kind].add(int(number))
        return found

    def set_aside(self, path: Path) -> None:
        """Rename a file that cannot be used, if it exists; it is left to the user."""
        with suppress(FileNotFoundError):
            path.replace(path.with_name(path.name + ASIDE))

    def is_results(self) -> bool:
        """Whether the folder was made by gfmdlayer."""
        try:
            with self.config.open(encoding="utf-8") as file:
                return file.readline() == MARK
        except (OSError, UnicodeDecodeError):
            return False

    def stored_config(self) -> Config:
        """Return the configuration of the results.

        Raises
        ------
        FolderError
            Where this is not a results folder, or its configuration cannot be read.
        """
        self.must_hold_results()
        try:
            return load(self.config)
        except ConfigError as error:
            reasons = "; ".join(error.problems)
            raise FolderError(f"{self.path}: its configuration cannot be read: {reasons}") from None

    def stored_sweep(self) -> dict[str, list[Any]]:
        """Return the sweep of the results; works without the input files that their configuration names.

        Raises
        ------
        FolderError
            Where this is not a results folder, or its configuration cannot be read.
        """
        self.must_hold_results()
        document = text.read(self.config.read_text(encoding="utf-8"), str(self.config))
        if not isinstance(document.data, dict):
            raise FolderError(f"{self.config}: cannot be read; must be as the run wrote it")
        return dict(document.data.get("sweep") or {})

    def must_hold_results(self) -> None:
        """Refuse a folder that does not hold results.

        Raises
        ------
        FolderError
            Where it is not one.
        """
        if not self.path.is_dir():
            raise FolderError(f"{self.path}: no such folder")
        if not self.is_results():
            raise FolderError(f"{self.path}: not a results folder of gfmdlayer")


def read_json(path: Path) -> dict[str, Any] | None:
    """Read a small JSON file; None where there is none or it cannot be read."""
    with suppress(OSError, ValueError):
        content = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(content, dict):
            return content
    return None


def changed_keys(before: Config, after: Config) -> list[str]:
    """Compare two configurations.

    Parameters
    ----------
    before, after : Config
        The configurations.

    Returns
    -------
    list of str
        The keys that differ, but the name, as ``key: before -> after``.
    """
    old, new = _flat(before.model_dump()), _flat(after.model_dump())
    absent = "(absent)"
    return [
        f"{key}: {old.get(key, absent)} -> {new.get(key, absent)}"
        for key in dict.fromkeys((*old, *new))
        if key != "name" and old.get(key, absent) != new.get(key, absent)
    ]


def _flat(tree: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = value
    return flat
