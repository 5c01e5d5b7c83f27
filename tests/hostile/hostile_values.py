"""Values that a user or an attacker may write where a number, a text or a table is expected."""

import json
import os
import socket
from pathlib import Path

from hypothesis import strategies as st

NUMBERS = (
    "0", "-1", "1", "2", "-0.0", "0.5", "1e-320", "5e-324", "1e-200", "1e154", "1e155", "1e200", "1.7e308", "-1e308",
    "nan", "inf", "-inf", "1e400", "1" + "0" * 400, "9" * 4299, "9" * 5000, "9223372036854775808", "0xffffffff", "0b1",
)  # fmt: skip
"""Numbers in TOML."""
TEXTS = (
    "", "x", "none", "true", "../../etc/passwd", "/dev/zero", "a\\u0000b", "\\u202eabc", "\\u2028", "\\u001b[31mred",
    "x" * 300, "y" * 50_000, "{{7*7}}", "<script>", "'; drop", "%s%n", "\\U0001F680", "é" * 100,
)  # fmt: skip
"""Texts in TOML, as they stand between quotes."""
TABLES = (
    "[]", "[[]]", "[[[1]]]", "{}", "{a = 1}", "{a = {b = {c = 1}}}", "[1, 'a', true]", "[{}, {}]", "2026-01-01",
    "2026-01-01T00:00:00Z", "0000-01-01T00:00:00", "07:32:00", "true", "false",
)  # fmt: skip
"""Lists, tables, dates and flags in TOML."""


def nested(depth: int, inner: str = "1") -> str:
    """A value in a number of lists."""
    return "[" * depth + inner + "]" * depth


def toml_values() -> st.SearchStrategy[str]:
    """Values in TOML."""
    return st.one_of(
        st.sampled_from(NUMBERS),
        st.sampled_from(TEXTS).map(lambda text: f'"{text}"'),
        st.sampled_from(TABLES),
        st.sampled_from((3, 30, 70, 400, 3000)).map(nested),
        st.sampled_from((1, 3, 40, 20_000)).map(lambda count: "[" + ", ".join(["1.0"] * count) + "]"),
        st.floats().map(repr),
        st.integers(-(10**20), 10**20).map(str),
        st.text(max_size=20).map(lambda text: json.dumps(text)),
    )


def json_values() -> st.SearchStrategy[str]:
    """Values in JSON, some of which JSON does not know."""
    return st.one_of(
        st.sampled_from(
            ("null", "true", "-1", "0", "NaN", "Infinity", "1e999", "1" + "0" * 400, "9" * 5000, '""', '"\\u0000"')
        ),
        st.sampled_from(('"' + "x" * 200_000 + '"', '"\\u202e"', "[]", "{}", '{"a": 1}', '"../../x"', '"\\ud800"')),
        st.sampled_from((10, 70, 3000, 100_000)).map(nested),
        st.floats(allow_nan=False, allow_infinity=False).map(repr),
        st.integers(-(10**20), 10**20).map(str),
        st.text(max_size=20).map(json.dumps),
    )


def damaged_bytes(content: bytes, draw: st.DrawFn) -> tuple[str, bytes]:
    """A kind of damage, and the content with it."""
    kinds = ("flip", "cut", "empty", "twice", "insert", "remove", "swap", "noise", "zeros", "append")
    kind = draw(st.sampled_from(kinds))
    if not content:
        return "noise", draw(st.binary(max_size=50))
    at = draw(st.integers(0, len(content) - 1))
    length = draw(st.integers(1, 40))
    match kind:
        case "flip":
            byte = content[at] ^ (1 << draw(st.integers(0, 7)))
            return kind, content[:at] + bytes([byte]) + content[at + 1 :]
        case "cut":
            return kind, content[:at]
        case "empty":
            return kind, b""
        case "twice":
            return kind, content + content
        case "insert":
            return kind, content[:at] + draw(st.binary(min_size=1, max_size=length)) + content[at:]
        case "remove":
            return kind, content[:at] + content[at + length :]
        case "swap":
            return kind, content[at:] + content[:at]
        case "noise":
            return kind, draw(st.binary(max_size=300))
        case "zeros":
            return kind, content[:at] + bytes(length) + content[at + length :]
        case _:
            return kind, content + draw(st.binary(min_size=1, max_size=length))


SPECIAL_FILES = ("missing", "folder", "FIFO", "socket", "link loop", "device", "NUL", "long name", "not UTF-8", "link")


def special_path(folder: Path, kind: str, suffix: str = "") -> Path:
    """A path of a kind that is no ordinary file; what it needs is made in a folder."""
    path = folder / f"{kind.replace(' ', '_')}{suffix}"
    match kind:
        case "device":
            return Path("/dev/zero")
        case "NUL":
            return folder / f"a\0b{suffix}"
        case "long name":
            return folder / ("n" * 300 + suffix)
        case "missing":
            return folder / f"nothing{suffix}"
        case "not UTF-8":
            path = Path(os.fsdecode(os.fsencode(folder) + b"/\xff\xfe" + suffix.encode()))
            path.touch()
            return path
    if not os.path.lexists(path):
        make_special(path, kind)
    return path


def make_special(path: Path, kind: str) -> None:
    """Makes a file system entry of a kind at a path."""
    match kind:
        case "folder":
            path.mkdir()
        case "FIFO":
            os.mkfifo(path)
        case "socket":
            with socket.socket(socket.AF_UNIX) as made:
                here = Path.cwd()
                os.chdir(path.parent)  # names of sockets are short
                try:
                    made.bind(path.name)
                finally:
                    os.chdir(here)
        case "link loop":
            path.symlink_to(path.name)
        case _:
            path.symlink_to("/dev/zero")
