"""Damaged campaign folders: every file of one, damaged, replaced or with changed entries, and restored afterwards."""

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from case_ledger import Case
from hostile_values import damaged_bytes, json_values, make_special
from hypothesis import strategies as st

from rpojax.campaign.status import status
from rpojax.campaign.storage.campaign_folder import Campaign

GROUPS = ("metrics", "drawn", "used", "traces", "phases", "coverage", "surface")


def folder_cases(directory: Path) -> st.SearchStrategy[Case]:
    """Damage to the folder of a campaign, which is read whole or refused and restored afterwards."""
    files = sorted(path for path in directory.rglob("*") if path.is_file())
    expected = results_digest(directory)
    return st.one_of(
        _with_bytes(directory, files, expected),
        _with_entry(directory, files, expected),
        _with_special(directory, files, expected),
        _with_exchange(directory, files, expected),
        _with_foreign_file(directory, expected),
    )


def results_digest(directory: Path) -> str:
    """Digest of everything that a folder tells."""
    found = Campaign(directory)
    found.verify()
    total = hashlib.sha256(repr((status(directory), found.info, found.run_ids, found.history_ids)).encode())
    for name in GROUPS:
        for key, values in sorted(getattr(found, name).items()):
            total.update(key.encode() + np.asarray(values).tobytes())
    for run in found.history_ids:
        for key, values in sorted(found.history(run).items()):
            total.update(key.encode() + values.tobytes())
    total.update(found.completed.tobytes() + found.failed_at_s.tobytes() + repr(found.requirements).encode())
    return total.hexdigest()


def json_fields(content: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Paths of all entries of a JSON document."""
    entries = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in entries:
        yield (*path, key)
        yield from json_fields(value, (*path, key))


def with_field(content: Any, path: tuple[str | int, ...], text: str | None) -> str:
    """JSON of a document with one entry replaced by a text in JSON, or removed."""
    mark = "\u0001replaced\u0001"
    copy = json.loads(json.dumps(content))
    inner = copy
    for key in path[:-1]:
        inner = inner[key]
    if text is None:
        del inner[path[-1]]
        return json.dumps(copy)
    inner[path[-1]] = mark
    return json.dumps(copy).replace(json.dumps(mark), text)


def read_or_refuse(directory: Path, expected: str) -> None:
    """Reads a folder whole; what is not refused must tell what it told before."""
    assert results_digest(directory) == expected, "other results without a word"


@contextmanager
def _restored(path: Path) -> Iterator[None]:
    """Restores a file after the body, whatever is at its path then."""
    before = path.read_bytes() if path.is_file() else None
    try:
        yield
    finally:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        elif os.path.lexists(path):
            path.unlink()
        if before is not None:
            path.write_bytes(before)


def _case(directory: Path, damage: str, path: Path, expected: str, spoil: Callable[[], object]) -> Case:
    place = "/".join(part for part in path.relative_to(directory).parts if not part.isdecimal())

    def act() -> None:
        with _restored(path):
            spoil()
            read_or_refuse(directory, expected)

    return Case("campaign folder", damage, place, act)


@st.composite
def _with_bytes(draw: st.DrawFn, directory: Path, files: list[Path], expected: str) -> Case:
    path = draw(st.sampled_from(files))
    damage, content = damaged_bytes(path.read_bytes(), draw)
    return _case(directory, f"bytes: {damage}", path, expected, lambda: path.write_bytes(content))


@st.composite
def _with_entry(draw: st.DrawFn, directory: Path, files: list[Path], expected: str) -> Case:
    path = draw(st.sampled_from([path for path in files if path.suffix == ".json"]))
    content = json.loads(path.read_text())
    field = draw(st.sampled_from(list(json_fields(content))))
    damage = draw(st.sampled_from(("entry", "entry removed", "depth")))
    text = None if damage == "entry removed" else draw(json_values())
    spoilt = "[" * 100_000 if damage == "depth" else with_field(content, field, text)
    return _case(directory, damage, path, expected, lambda: path.write_text(spoilt, errors="surrogatepass"))


@st.composite
def _with_special(draw: st.DrawFn, directory: Path, files: list[Path], expected: str) -> Case:
    path = draw(st.sampled_from(files))
    kind = draw(st.sampled_from(("FIFO", "socket", "folder", "link loop", "link to a device")))

    def spoil() -> None:
        path.unlink()
        make_special(path, kind)

    return _case(directory, f"file: {kind}", path, expected, spoil)


@st.composite
def _with_exchange(draw: st.DrawFn, directory: Path, files: list[Path], expected: str) -> Case:
    """The content of one file in place of that of another of its kind: chunks, histories, manifests."""
    path = draw(st.sampled_from(files))
    other = draw(st.sampled_from([each for each in files if each.suffix == path.suffix]))
    content = other.read_bytes()
    return _case(directory, "another file's content", path, expected, lambda: path.write_bytes(content))


@st.composite
def _with_foreign_file(draw: st.DrawFn, directory: Path, expected: str) -> Case:
    """A file that does not belong to the folder."""
    names = ("manifest/00000\u0661.json", "manifest/\u0660\u0660\u0660\u0660\u0660\u0661.json", "manifest/-00001.json")
    more = ("results.zarr/histories/\u0661/zarr.json", "requirements/000001.json", "manifest/999999.json", "x")
    path = directory / draw(st.sampled_from((*names, *more)))
    content = draw(st.sampled_from((b"{}", b"", (directory / "manifest" / "000000.json").read_bytes())))

    def spoil() -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)

    return _case(directory, "foreign file", path, expected, spoil)
