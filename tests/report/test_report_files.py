"""Files of the report are whole or absent, and nobody else's are written through."""

from pathlib import Path

import pytest

from rpojax.errors import OutputError
from rpojax.report.atomic_output import write_atomically


def test_a_file_is_replaced_whole_and_nothing_is_left_beside_it(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "report.json"
    for content in (b"first", b"second"):
        assert write_atomically(path, content) == path
        assert path.read_bytes() == content
    assert list(path.parent.iterdir()) == [path]


def test_a_link_in_place_of_the_partial_file_is_not_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other"
    other.write_bytes(b"precious")
    (tmp_path / ".taken.partial").symlink_to(other)
    monkeypatch.setattr("rpojax.campaign.storage.atomic_files.partial_name", lambda name: ".taken.partial")
    with pytest.raises(OutputError, match="expected a file that can be written"):
        write_atomically(tmp_path / "report.json", b"new")
    assert other.read_bytes() == b"precious"


def test_a_name_as_long_as_the_system_allows_can_be_written(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 250 + ".json")
    assert write_atomically(path, b"whole").read_bytes() == b"whole"
