"""HDF5 files of users: their contents must be their own, which alone enter the digest of a case."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gfmdlayer.files.tables import TableError

if TYPE_CHECKING:
    import h5py


def refuse_other_files(path: Path, group: h5py.Group) -> None:
    """Refuse a group with links to other files, or data that are stored in them; not the groups in it."""
    import h5py

    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise TableError(f"{path}: {name} is a link to {link.filename}; must be in the file itself")
        kind = group.get(name, getclass=True)
        if kind is h5py.Dataset and (group[name].external or group[name].is_virtual):
            raise TableError(f"{path}: {name} is stored in another file; must be in the file itself")


def open_group(path: Path, file: h5py.File, name: str) -> h5py.Group:
    """Return a group of a file, refusing other files on the way to it and in it."""
    import h5py

    group: h5py.Group = file
    refuse_other_files(path, group)
    for part in filter(None, name.split("/")):
        if group.get(part, getclass=True) is not h5py.Group:
            raise TableError(f"{path}: has no group {name!r}")
        group = group[part]
        refuse_other_files(path, group)
    return group
