"""A file has its final name when it is complete, and only then."""

import os

import pytest

from gfmdlayer.files.whole import is_unfinished, unfinished, unfinished_path, write_text


@pytest.mark.parametrize("durable", [True, False])
def test_a_file_replaces_an_earlier_one_when_it_is_complete(tmp_path, durable):
    path = tmp_path / "config.yaml"
    path.write_text("earlier")
    with unfinished(path, durable=durable) as part:
        part.write_text("later")
        assert path.read_text() == "earlier"
        assert is_unfinished(part.name)
    assert path.read_text() == "later"
    assert list(tmp_path.iterdir()) == [path]


def test_an_error_leaves_the_earlier_file_and_nothing_else(tmp_path):
    path = tmp_path / "case.h5"
    path.write_text("earlier")

    def interrupted():
        with unfinished(path) as part:
            part.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("links", [True, False])
def test_the_first_file_stays_where_none_is_to_be_replaced(tmp_path, monkeypatch, links):
    def link(*_):
        raise PermissionError("no hard links on this file system")

    if not links:
        monkeypatch.setattr(os, "link", link)
    path = tmp_path / "some.file"
    write_text(path, "first", replace=False)
    with pytest.raises(FileExistsError):
        write_text(path, "second", replace=False)
    assert path.read_text() == "first"
    assert list(tmp_path.iterdir()) == [path]


def test_unfinished_names_are_unique_and_recognised(tmp_path):
    names = {unfinished_path(tmp_path / "a.mp4", ".mp4").name for _ in range(20)}
    assert len(names) == 20
    assert all(is_unfinished(name) and name.endswith(".mp4") for name in names)
    for name in ("notes.part", "a.part", "config.yaml", "0000.h5", "a-1-2.part"):
        assert not is_unfinished(name)
