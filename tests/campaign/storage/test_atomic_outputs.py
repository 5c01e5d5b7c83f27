"""Output files are written whole or not at all, and never through a link."""

from pathlib import Path

import pytest

from rpojax.campaign.storage.atomic_outputs import write_atomically
from rpojax.errors import OutputError


def test_file_is_replaced_and_no_partial_file_remains(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "report.json"
    for content in (b"first", b"second"):
        assert write_atomically(path, content) == path
        assert path.read_bytes() == content
    assert list(path.parent.iterdir()) == [path]


def test_link_in_place_of_the_partial_file_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other"
    other.write_bytes(b"precious")
    (tmp_path / ".taken.partial").symlink_to(other)
    monkeypatch.setattr("rpojax.campaign.storage.atomic_files.partial_name", lambda name: ".taken.partial")
    with pytest.raises(OutputError, match="expected a file that can be written"):
        write_atomically(tmp_path / "report.json", b"new")
    assert other.read_bytes() == b"precious"


def test_longest_file_name_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 250 + ".json")
    assert write_atomically(path, b"whole").read_bytes() == b"whole"
