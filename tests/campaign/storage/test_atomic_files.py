"""Files are whole or absent, stay inside their folder, and leftovers of dead writers go."""

import errno
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rpojax.campaign.storage import atomic_files, safe_paths, stale_files
from rpojax.errors import ResultError, UnfinishedError


def test_a_file_is_replaced_as_a_whole_and_leaves_nothing_beside_it(tmp_path: Path) -> None:
    for content in (b"old", b"new"):
        atomic_files.write(tmp_path / "some", content, sync=True)
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("some", b"new")]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_a_disk_that_fails_is_one_line_and_the_old_file_stays(
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


def dead_process() -> int:
    """Number of a process that is no more."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_only_partial_files_whose_writers_are_gone_are_swept(tmp_path: Path) -> None:
    here, elsewhere, dead = atomic_files.machine_id(), "0" * 8, dead_process()
    names = {
        "of the dead": f".a.{here}-{dead}-0.partial",
        "of the living": f".b.{here}-{os.getpid()}-0.partial",
        "of another machine": f".c.{elsewhere}-{dead}-0.partial",
        "of another machine, long ago": f".d.{elsewhere}-1-0.partial",
        "of another tool, long ago": "e.partial",
        "no partial file": "f",
    }
    folder = tmp_path / "deep" / "down"
    folder.mkdir(parents=True)
    for name in names.values():
        (folder / name).touch()
    for name in ("of another machine, long ago", "of another tool, long ago", "no partial file"):
        os.utime(folder / names[name], times=(time.time() - 3600.0,) * 2)
    stale_files.remove_stale_files(tmp_path)
    left = {name for name, file in names.items() if (folder / file).exists()}
    assert left == {"of the living", "of another machine", "of another tool, long ago", "no partial file"}


def test_a_path_through_a_link_is_refused_and_one_without_is_not(tmp_path: Path) -> None:
    root, outside = tmp_path / "root", tmp_path / "outside"
    (root / "inside").mkdir(parents=True)
    outside.mkdir()
    (root / "link").symlink_to(outside)
    safe_paths.check_no_links(root, root / "inside" / "file")
    with pytest.raises(ResultError, match="link: found a link that leads elsewhere"):
        safe_paths.check_no_links(root, root / "link" / "file")


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '"\ud800', "9" * 5000])
def test_what_is_no_json_is_one_error_of_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "some.json"
    path.write_text(text, errors="surrogatepass")
    with pytest.raises(ResultError, match=r"some\.json: found no readable some\.json") as caught:
        atomic_files.read_json(path, "a test", 1_000_000)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "some.json").write_text(" " * 101)
    with pytest.raises(ResultError, match="found more than 100 bytes"):
        atomic_files.read_json(tmp_path / "some.json", "a test", 100)
