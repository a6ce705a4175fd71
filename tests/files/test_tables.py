"""Tables of numbers in text files."""

import numpy as np
import pytest

from gfmdlayer.files import tables

CONTENTS = [
    "0 0\n1 2\n", "time, depth\n0, 0.1\n1; 2 # a remark\n\n# another\n2\t3\n", "\ufeff0 0\r\n1 2e-300\r\n",
    "0 0\n1 nan\n", "0 0\n1 inf\n", "0 0\n1 1e31\n", "0 0\n0 1\n", "0 0\n1 2 3\n", "0 0 0\n1 2 3\n",
    "0 0\n1 x\n", "t 3\n0 0\n1 2\n", "0 0\n", "# 1 2\n", "", "0 0\n1 1_0\n", "0 0\n1 ٣\n", "0 .1\n1, ,2.\n",
    "0 0x1\n1 2\n",
]  # fmt: skip


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.filterwarnings("error")
def test_a_table_read_at_once_is_that_read_line_by_line(content, tmp_path):
    path = tmp_path / "table.txt"
    path.write_text(content, encoding="utf-8")

    def read():
        found = []
        for read in (
            lambda: tables.read_columns(path, ("time", "x"), increasing=True),
            lambda: tables.read_matrix(path),
        ):
            try:
                found.append(read().tolist())
            except tables.TableError as error:
                found.append(str(error))
        return found

    at_once = read()
    path.write_text(content + "# °C: text beyond ASCII is read line by line\n", encoding="utf-8")
    assert repr(at_once) == repr(read())


def test_a_sound_table_is_read_at_once(tmp_path, monkeypatch):
    """By NumPy's reader: a million rows take a second, and ten by the reader that names lines."""
    path = tmp_path / "table.txt"
    path.write_text("time depth\n" + "".join(f"{i}, {i / 7}\n" for i in range(100)))
    monkeypatch.setattr(tables, "read_lines", lambda _: pytest.fail("read line by line"))
    found = tables.read_columns(path, ("time", "depth"), increasing=True)
    assert np.array_equal(found, [(i, i / 7) for i in range(100)])
