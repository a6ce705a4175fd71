"""Which cases have which files in a results folder, from one look at the names."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Mapping
from contextlib import suppress

from gfmdlayer.execution.folder import Folder


def numbers(folder: Folder) -> Mapping[str, set[int]]:
    """Return the numbers of the cases that have a file, by the kind of the file: h5, failed, running."""
    found: defaultdict[str, set[int]] = defaultdict(set)
    with suppress(FileNotFoundError), os.scandir(folder.cases) as entries:
        for entry in entries:
            number, _, kind = entry.name.partition(".")
            if number.isdecimal() and entry.name == f"{int(number):04d}.{kind}":
                found[kind].add(int(number))
    return found
