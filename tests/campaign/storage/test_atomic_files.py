"""Atomic writing of files, and reading of JSON."""

import errno
import json
import os
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from rpojax.campaign.storage import atomic_files
from rpojax.errors import ResultError, UnfinishedError
from rpojax.untrusted.file_reading import FileKind


def test_file_is_replaced_as_a_whole_and_no_partial_file_remains(tmp_path: Path) -> None:
    for content in (b"old", b"new"):
        atomic_files.write(tmp_path / "some", content, sync=True)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("some", b"new")]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_disk_error_is_one_line_and_the_old_file_remains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    path = tmp_path / "some"
    atomic_files.write(path, b"old")

    def fail(_: int) -> None:
        raise OSError(code, os.strerror(code))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", fail)
        with pytest.raises(UnfinishedError, match=f"{path}: found {os.strerror(code).lower()}, expected .*kept$"):
            atomic_files.write(path, b"new", sync=True)
    assert [(left.name, left.read_bytes()) for left in tmp_path.iterdir()] == [("some", b"old")]


def test_flushing_names_the_file_that_the_disk_refuses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [tmp_path / name for name in ("a", "b")]
    for path in paths:
        atomic_files.write(path, b"some")
    atomic_files.flush(paths)
    with pytest.raises(UnfinishedError, match=r"missing: found no such file or directory"):
        atomic_files.flush([paths[0], tmp_path / "missing"])

    for is_refused in (stat.S_ISREG, stat.S_ISDIR):

        def fail(handle: int, is_refused: Callable[[int], bool] = is_refused) -> None:
            if is_refused(os.fstat(handle).st_mode):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        monkeypatch.setattr(os, "fsync", fail)
        with pytest.raises(UnfinishedError, match=r"found no space left on device, expected room for the results"):
            atomic_files.flush(paths)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '"\ud800', "9" * 5000])
def test_invalid_json_is_an_error_of_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "some.json"
    path.write_text(text, errors="surrogatepass")
    with pytest.raises(ResultError, match=r"some\.json: found no readable some\.json") as caught:
        atomic_files.read_json(path, "a test", FileKind.PROGRESS)
    assert "\n" not in str(caught.value)


def test_too_large_file_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "some.json").write_text(" " * (FileKind.MANIFEST.most_bytes + 1))
    with pytest.raises(ResultError, match="more than 1000000 bytes"):
        atomic_files.read_json(tmp_path / "some.json", "a test", FileKind.MANIFEST)


def test_json_is_replaced_as_a_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "some.json"
    atomic_files.write_json(path, {"a": 1})
    with pytest.raises(ValueError, match="not JSON compliant"):
        atomic_files.write_json(path, {"a": 2, "b": float("nan")})
    assert json.loads(path.read_text()) == {"a": 1}
