"""The checkpoint of an unfinished case: its state, a position in its journal, and its provenance.

An uncompressed .npz, written whole (`files.whole`): under its name there is always one whole state, the last
or the one before. A digest over all of it shows whether it is the one that was written.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.files.locks import no_link, regular
from gfmdlayer.files.whole import unfinished

_ABOUT = "about"


class CheckpointError(Exception):
    """A checkpoint from which a case cannot be resumed; the message says why."""


@dataclass(frozen=True)
class Checkpoint:
    """The state of a case at the end of a step.

    Attributes
    ----------
    made_by : mapping
        All else on which the bits of later results depend: input, versions, processor.
    about : mapping
        Plain data, as JSON has it, about the run so far: its time, the position in the journal.
    state : mapping of arrays
        The resumable state of the simulation.
    """

    made_by: Mapping[str, str]
    about: Mapping[str, Any]
    state: Mapping[str, NDArray[Any]]

    def write(self, path: Path) -> None:
        """Write the checkpoint as a whole or not at all.

        Raises
        ------
        OSError
            If it cannot be written; the checkpoint before is then still there.
        """
        state = {name: np.asarray(values) for name, values in self.state.items()}
        plain = {**self.about, "made_by": dict(self.made_by)}
        about = json.dumps({**plain, "digest": _digest(plain, state)})
        with unfinished(path) as part, open(part, "xb", opener=no_link) as file:
            np.savez(file, **{_ABOUT: np.array(about)}, **state)  # type: ignore[arg-type]


def read_about(path: Path) -> dict[str, Any] | None:
    """Return the plain data of a checkpoint, and `made_by`; None where they cannot be read."""
    try:
        with open(path, "rb", opener=regular) as stream, np.load(stream, allow_pickle=False) as file:
            about: dict[str, Any] = json.loads(str(file[_ABOUT]))
            return about if isinstance(about["made_by"], dict) else None
    except Exception:  # a damaged file can fail anywhere, with any exception
        return None


def read_checkpoint(path: Path, made_by: Mapping[str, str]) -> Checkpoint:
    """Read a checkpoint.

    Parameters
    ----------
    path : Path
        Its file.
    made_by : mapping
        Input, versions and processor of this run, to which those of the checkpoint must be equal.

    Raises
    ------
    CheckpointError
        If it is damaged, or was made from another input, by other versions or on another processor.
    """
    try:
        with open(path, "rb", opener=regular) as stream, np.load(stream, allow_pickle=False) as file:
            state = dict(file)
        about = json.loads(str(state.pop(_ABOUT)))
        digest = about.pop("digest", "")
        others: dict[str, str] = dict(about["made_by"])
    except Exception as error:  # a damaged file can fail anywhere, with any exception
        raise CheckpointError(f"it cannot be read: {type(error).__name__}: {error}") from None
    changed = [
        f"{key} {others.get(key, '(none)')} -> {made_by.get(key, '(none)')}"
        for key in sorted({*others, *made_by})
        if others.get(key) != made_by.get(key)
    ]
    if changed:
        raise CheckpointError(f"it would not give the same bits: {'; '.join(changed)}")
    if digest != _digest(about, state):
        raise CheckpointError("it cannot be read: other arrays are in it than were written")
    del about["made_by"]
    return Checkpoint(made_by, about, state)


def _digest(about: Mapping[str, Any], state: Mapping[str, NDArray[Any]]) -> str:
    """Return a hash of all that a checkpoint holds."""
    found = hashlib.blake2b(json.dumps(about, sort_keys=True).encode(), digest_size=16)
    for name, values in sorted(state.items()):
        found.update(json.dumps([name, values.dtype.str, values.shape]).encode())
        found.update(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
    return found.hexdigest()
