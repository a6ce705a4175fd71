"""The file of an unfinished case: its state, where its journal stands, and by what it was made.

An uncompressed .npz, written whole (`files.whole`): under its name there is always one whole state, the last
or the one before. Each array in it carries a checksum.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfmdlayer.files.whole import unfinished

_ABOUT = "about"


class CheckpointError(Exception):
    """A state from which a case cannot go on; the message says why."""


@dataclass(frozen=True)
class Checkpoint:
    """A state of a case.

    Attributes
    ----------
    made_by : dict
        What the bits depend on, but the state: input, versions, processor.
    about : dict
        What else is to be known, as plain data.
    state : dict of arrays
        The memory of the run.
    """

    made_by: Mapping[str, str]
    about: Mapping[str, Any]
    state: Mapping[str, NDArray[Any]]

    def write(self, path: Path) -> None:
        """Write it whole or not at all.

        Raises
        ------
        OSError
            Where the disk refuses; what was there before is still there.
        """
        about = json.dumps({"made_by": self.made_by, "names": sorted(self.state), **self.about})
        with unfinished(path) as part, part.open("xb") as file:
            np.savez(file, **{_ABOUT: np.array(about)}, **self.state)  # type: ignore[arg-type]


def read_checkpoint(path: Path, made_by: Mapping[str, str]) -> Checkpoint:
    """Read a state that has been made by the same.

    Raises
    ------
    CheckpointError
        Where it is damaged, or was made by something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            state = dict(file)
        about = json.loads(str(state.pop(_ABOUT)))
        others: dict[str, str] = about.pop("made_by")
        if about.pop("names") != sorted(state):  # the archive's own list of them is under no checksum
            raise ValueError("not all of it is there")  # noqa: TRY301
    except Exception as error:  # a damaged file can fail anywhere, with any exception
        raise CheckpointError(f"it cannot be read: {type(error).__name__}: {error}") from None
    changed = [
        f"{key} {others.get(key, '(none)')} -> {made_by.get(key, '(none)')}"
        for key in sorted({*others, *made_by})
        if others.get(key) != made_by.get(key)
    ]
    if changed:
        raise CheckpointError(f"it would not give the same bits: {'; '.join(changed)}")
    return Checkpoint(made_by, about, state)
