"""What the tests ask of recordings: rows, bits, runs in parts; case files of made-up rows and snapshots."""

import io
from contextlib import contextmanager

import numpy as np

from gfmdlayer.results.case_file import case_contents, write_case
from gfmdlayer.results.recording import Recording

FIELDS = ("displacement", "pressure", "gap", "traction", "imprint")


class Kept(Recording):
    """A recording in memory that shows its rows and snapshots one by one."""

    @property
    def rows(self):
        """Each row as a dict."""
        columns = {name: self[name].tolist() for name in self.widths} if self.count else {}
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]

    @property
    def snapshots(self):
        """Time, displacement and pressure of each snapshot."""
        return list(zip(self.times, *(self.fields.get(name, []) for name in FIELDS[:2]), strict=True))

    @property
    def gaps(self):
        """The gap of each snapshot."""
        return self.fields.get("gap", [])


def named(*fields):
    """Return fields of a snapshot by their names."""
    return dict(zip(FIELDS, fields, strict=False))


@contextmanager
def case_file(path, *about, **more):
    """Write the file of a case of what the block records; arguments like those of `case_contents`."""
    recording = Recording()
    yield recording
    write_case(path, case_contents(recording, *about, **more))


def bits_of(recording):
    """Return the bits of all that a recording holds."""
    columns = {name: recording[name].tobytes() for name in recording.widths}
    fields = {name: [each.tobytes() for each in every] for name, every in recording.fields.items()}
    return columns, recording.times, fields, repr(recording.noted)


class Stop(Exception):  # noqa: N818 - asked for
    """Ends a part of a run."""


class InParts:
    """A run with stops after these numbers of calls of its `progress`; its state goes through a file.

    `run` runs the same case anew, with recorder, progress and resume like `gfmdlayer.simulate`.
    """

    def __init__(self, run, lengths):
        self._lengths, self._left, self._kept = lengths, 0, None
        self.recording, self.parts = Recording(), 0
        while not self._ended(run):
            self.parts += 1

    def _ended(self, run):
        self._left = next(self._lengths)
        try:
            run(self.recording, self._advance, resume=self._resume)
        except Stop:
            return False
        return True

    def _resume(self, memory):
        self._memory = memory
        if self._kept is not None:
            memory.restore(self._kept)

    def _advance(self, _time):
        self._left -= 1
        if self._left == 0:
            self._kept = through_a_file(self._memory.state())
            raise Stop


def through_a_file(state):
    """Write a state to a file, and return what is read from it."""
    file = io.BytesIO()
    np.savez(file, **state)
    file.seek(0)
    with np.load(file) as loaded:
        return dict(loaded)
