"""A results folder: what lies where, whose it is, and when it may be written.

    DIR/config.yaml        the configuration with every default written out; its first line marks the folder
    DIR/cases/NNNN.h5      a complete case
    DIR/cases/NNNN.xdmf    what ParaView opens of a surface in two dimensions
    DIR/cases/NNNN.failed  why a case failed (JSON)
    DIR/cases/NNNN.running how far a case is (JSON)
    DIR/cases/NNNN.checkpoint, .journal0, .journal1  from where a case goes on that is not complete
    DIR/cases/NNNN.*.aside a damaged case or an unusable checkpoint, left to the user
    DIR/cases/stop         asks every process of the run to stop; stop-3-of-16 that of a shard
    DIR/sweep.h5           all cases, labelled

Small files are written under another name and renamed, so that a reader never sees half of one.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gfmdlayer.config import Config, ConfigError, load, sweeps, text
from gfmdlayer.execution import locks
from gfmdlayer.execution.shards import Shard

MARK = "# Results of gfmdlayer: their configuration, every default written out.\n"
PARTIAL = ".part"
PROBED = 1 << 16  # bytes
ASIDE = ".aside"
RESUMABLE = ("*.checkpoint", "*.journal?")
WAYS_OUT = "choose another folder with --out, or --restart to start over"


class FolderError(Exception):
    """A folder cannot be used for these results; the message says why and what to do."""


@dataclass(frozen=True)
class Folder:
    """The results folder at `path`, for a run of everything or of a shard."""

    path: Path
    shard: Shard | None = None

    @property
    def config(self) -> Path:
        """The configuration of the results."""
        return self.path / "config.yaml"

    @property
    def cases(self) -> Path:
        """Where the cases are."""
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
        """Return the file of a case; `kind` is h5, failed, running, checkpoint, journal0 or journal1."""
        return self.cases / f"{index:04d}.{kind}"

    def set_aside(self, path: Path) -> None:
        """Give a file that cannot be used another name, if it is there."""
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
        """Return the sweep of the results, whatever has become of the files that their configuration names.

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
        """Refuse what is not a results folder.

        Raises
        ------
        FolderError
            Where it is not one.
        """
        if not self.path.is_dir():
            raise FolderError(f"{self.path}: no such folder")
        if not self.is_results():
            raise FolderError(f"{self.path}: not a results folder of gfmdlayer")

    @contextmanager
    def claimed(
        self, config: Config, restart: bool = False, own: Collection[int] | None = None
    ) -> Iterator[None]:
        """Hold the folder, or a shard's part of it, for a run of `config`.

        Parameters
        ----------
        config : Config
            What will be run.
        restart : bool
            Remove earlier results of gfmdlayer in this folder first; nothing else is touched.
        own : collection of int, optional
            The cases of the shard.

        Raises
        ------
        FolderError
            Where the folder holds something else or results of another configuration, is in use, or cannot be
            written.
        """
        with self._refusing():
            self._refuse_strangers()
        if self.is_results() and not restart:
            self._refuse_another(config)
        with ExitStack() as claim:
            with self._refusing():
                self.cases.mkdir(parents=True, exist_ok=True)
                with locks.turn(self.cases / ".admission"):
                    alone = claim.enter_context(locks.held(self.cases, self.shard))
                    self._probe()
                    self._make_ready(config, restart, None if alone else own)
            try:
                yield
            finally:
                with suppress(OSError):
                    self.stop.unlink(missing_ok=True)

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        """Turn what the file system refuses into a word to the user."""
        try:
            yield
        except locks.HeldError as error:
            raise FolderError(f"{self.path}: {error}; wait for it to end") from None
        except OSError as error:
            raise FolderError(
                f"{self.path}: cannot be written ({error.strerror}: {error.filename}); "
                "choose another with --out"
            ) from None

    def _probe(self) -> None:
        """Write as much as a small file takes: a full disk still lets empty ones be made."""
        path = self.cases / f"probe{PARTIAL}"
        try:
            with path.open("wb") as file:
                file.write(bytes(PROBED))
                file.flush()
                os.fsync(file.fileno())
        finally:
            path.unlink(missing_ok=True)

    def _make_ready(self, config: Config, restart: bool, own: Collection[int] | None) -> None:
        if restart:
            self._remove_results()
        self._remove_remains(own)
        if not self.is_results():
            write_whole(self.config, f"{MARK}# Cases: {sweeps.count(config.sweep)}\n{config.dump()}")
        elif not restart:
            self._refuse_another(config)  # another shard may have come first

    def _refuse_strangers(self) -> None:
        if self.path.exists() and not self.path.is_dir():
            raise FolderError(f"{self.path}: is a file, not a folder; choose another with --out")
        ours = {"cases", self.config.name + PARTIAL}  # what a run leaves that ended in its first instant
        found = {entry.name for entry in self.path.iterdir()} if self.path.is_dir() else set()
        if found - ours and not self.is_results():
            raise FolderError(
                f"{self.path}: is not empty and not a results folder of gfmdlayer; choose another with --out"
            )

    def _refuse_another(self, config: Config) -> None:
        try:
            difference = changed_keys(self.stored_config(), config)
        except FolderError as error:
            raise FolderError(
                f"{error}; choose another folder with --out, or --restart to start over"
            ) from None
        if difference:
            raise FolderError(
                f"{self.path}: holds results of another configuration ({'; '.join(difference)}); {WAYS_OUT}"
            )

    def _remove_results(self) -> None:
        for path in (self.sweep, *self.cases.glob("*.h5"), *self.cases.glob("*.xdmf"), self.config):
            path.unlink(missing_ok=True)
        for pattern in ("*.failed", *RESUMABLE, f"*{ASIDE}"):
            for path in self.cases.glob(pattern):
                path.unlink(missing_ok=True)

    def _remove_remains(self, own: Collection[int] | None) -> None:
        """Remove what killed runs left: of all cases, or of one's own where others are at work."""
        remains = [
            *self.cases.glob("*.running"),
            *self.cases.glob(f"*{PARTIAL}"),
            *self._of_complete_cases(),
        ]
        if own is None:
            stops = (self.cases / "stop", *self.cases.glob("stop-*-of-*"))
            remains += [*stops, *self.path.glob(f"*{PARTIAL}")]
        else:
            remains = [path for path in remains if _case_number(path) in own] + [self.stop]
        for path in remains:
            path.unlink(missing_ok=True)

    def _of_complete_cases(self) -> Iterator[Path]:
        """Find checkpoints that were to be removed when the run was killed."""
        for pattern in RESUMABLE:
            for path in self.cases.glob(pattern):
                if path.with_suffix(".h5").exists():
                    yield path


def _case_number(path: Path) -> int | None:
    number = path.name.partition(".")[0]
    return int(number) if number.isdigit() else None


def write_whole(path: Path, text: str, to_disk: bool = True) -> None:
    """Write a small file that readers see whole or not at all; `to_disk` also waits for the disk."""
    partial = path.with_name(path.name + PARTIAL)
    with partial.open("w", encoding="utf-8") as file:
        file.write(text)
        if to_disk:
            file.flush()
            os.fsync(file.fileno())
    partial.replace(path)


def read_json(path: Path) -> dict[str, Any] | None:
    """Read a small JSON file; None where it has gone or is not one."""
    with suppress(OSError, ValueError):
        content = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(content, dict):
            return content
    return None


def changed_keys(before: Config, after: Config) -> list[str]:
    """Say which keys (but the name) differ between two configurations, as ``key: before -> after``."""
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
