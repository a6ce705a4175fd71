"""HDF5 files that are read: beside other programs, without locks, and nothing of other files.

HDF5 keeps one record of a file for all who open it in a process by the same driver, and refuses another
choice of locks: "file locking flag values don't match". So files are read by the driver of C streams here,
which h5py and xarray take only where it is asked for: they may open the same file as they like, before,
within and after. Without locks no program waits for another, and a file system may have none.

Links, external storage and virtual datasets of HDF5 take data from other files, whose names the author of a
file chooses. They are refused: a file that somebody sends shows nothing but its own contents.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfmdlayer.files.locks import regular

if TYPE_CHECKING:
    import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"
READING: dict[str, Any] = {"driver": "stdio", "locking": False}  # options of h5py.File


def is_hdf5(path: str | Path) -> bool:
    """Whether a file begins as HDF5 does; False for anything that is no regular file."""
    if not Path(path).is_file():
        return False
    with open(path, "rb", opener=regular) as file:
        return file.read(len(SIGNATURE)) == SIGNATURE


def open_hdf5(path: str | Path) -> h5py.File:
    """Open a file for reading; an OSError names one that is missing or no regular file."""
    import h5py

    open(path, "rb", opener=regular).close()  # no pipe is waited for
    return h5py.File(path, **READING)


def other_file(group: h5py.Group, *, deep: bool = False) -> str:
    """Return which member of a group has its data in another file, empty if none; `deep`: of all groups."""
    from h5py import h5d, h5l, h5o

    own = h5o.get_info(group.id).fileno

    found = ""

    def look(name: bytes, info: Any) -> bool | None:
        nonlocal found
        shown = name.decode(errors="replace")
        if info.type not in (h5l.TYPE_HARD, h5l.TYPE_SOFT):
            found = f"{shown} is a link to another file"
            if info.type == h5l.TYPE_EXTERNAL:
                found += f", {group.id.links.get_val(name)[0].decode(errors='replace')}"
            return True
        try:
            member = h5o.open(group.id, name)
        except KeyError:
            return None  # a link to nothing
        if h5o.get_info(member).fileno != own:
            found = f"{shown} is a link to another file"
        elif isinstance(member, h5d.DatasetID):
            stored = member.get_create_plist()
            if stored.get_layout() == h5d.VIRTUAL or stored.get_external_count():
                found = f"{shown} is stored in another file"
        return bool(found) or None  # True ends the search

    links = group.id.links
    (links.visit if deep else links.iterate)(look, info=True)
    return found


def refuse_other_files(path: Path, group: h5py.Group) -> None:
    """Refuse a group of a user's file, not those in it, with data in other files, which enter no digest."""
    from gfmdlayer.files.tables import TableError  # numpy

    if member := other_file(group):
        raise TableError(f"{path}: {member}; must be in the file itself")


def open_group(path: Path, file: h5py.File, name: str) -> h5py.Group:
    """Return a group of a user's file, refusing other files on the way to it and in it."""
    import h5py

    from gfmdlayer.files.tables import TableError

    group: h5py.Group = file
    refuse_other_files(path, group)
    for part in filter(None, name.split("/")):
        if group.get(part, getclass=True) is not h5py.Group:
            raise TableError(f"{path}: has no group {name!r}")
        group = group[part]
        refuse_other_files(path, group)
    return group
