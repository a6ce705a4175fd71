"""What the tests ask of recordings; case files of rows and snapshots that a test makes up."""

from contextlib import contextmanager

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
