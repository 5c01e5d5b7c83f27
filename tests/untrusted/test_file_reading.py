"""Only regular files of limited size are read."""

import os
import socket
from pathlib import Path

import pytest

from rpojax.untrusted.file_reading import FileError, FileKind, absolute_path, is_regular, read_bytes


def make(path: Path, kind: str) -> None:
    """Makes something that is no regular file."""
    match kind:
        case "a FIFO":
            os.mkfifo(path)
        case "a folder":
            path.mkdir()
        case "a device":
            path.symlink_to("/dev/zero")
        case "too many levels of symbolic links":
            path.symlink_to(path.name)
        case _:
            with socket.socket(socket.AF_UNIX) as made:
                made.bind(str(path))


@pytest.mark.parametrize(
    "kind", ["a FIFO", "a folder", "a device", "too many levels of symbolic links", "a socket", "no such file"]
)
def test_what_is_no_regular_file_is_refused_without_waiting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    if kind != "no such file":
        make(Path("x"), kind)
    with pytest.raises(FileError) as caught:
        read_bytes(Path("x"), FileKind.SCENARIO)
    assert kind in caught.value.found
    assert caught.value.is_there == (kind != "no such file")
    assert not is_regular(Path("x"))
    assert absolute_path(Path("x")).is_absolute()


def test_a_file_is_read_up_to_its_limit(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"abc")
    assert read_bytes(path, FileKind.MANIFEST) == b"abc"
    with path.open("ab") as stream:
        stream.truncate(FileKind.MANIFEST.most_bytes + 1)
    with pytest.raises(FileError, match="more than 1000000 bytes"):
        read_bytes(path, FileKind.MANIFEST)


@pytest.mark.parametrize("kind", list(FileKind))
def test_a_pointer_of_git_lfs_is_named(tmp_path: Path, kind: FileKind) -> None:
    path = tmp_path / "large"
    path.write_text(f"version https://git-lfs.github.com/spec/v1\noid sha256:{'0' * 64}\nsize 12345\n")
    with pytest.raises(FileError, match="found a pointer of Git LFS in place of the file"):
        read_bytes(path, kind)


def test_what_cannot_be_a_path_is_an_error() -> None:
    with pytest.raises(FileError, match=r"null (byte|character)"):
        read_bytes(Path("a\0b"), FileKind.SCENARIO)
    assert absolute_path(Path("a\0b")) == Path("a\0b")
