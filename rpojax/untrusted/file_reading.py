"""The one reader of files that a user names or that a folder holds: regular files, without blocking, up to a size."""

import enum
import os
import stat
from pathlib import Path

from rpojax.errors import RpojaxError

_LFS_POINTER = b"version https://git-lfs.github.com/spec/"
"""Beginning of the text that Git has in place of a large file that was not fetched."""


class FileKind(enum.Enum):
    """Kinds of files, with their names and the most bytes of one."""

    SCENARIO = ("a TOML file", 16_000_000)
    CASE_TABLE = ("a CSV file", 64_000_000)
    ORBIT_MESSAGE = ("an OEM, OMM, OPM or element set", 64_000_000)
    PLUGIN = ("a Python file", 1_000_000)
    CAMPAIGN_JSON = ("the JSON of a campaign", 64_000_000)
    MANIFEST = ("a manifest", 1_000_000)
    ARRAY_METADATA = ("the metadata of an array", 1_000_000)
    ARRAY_CHUNK = ("the values of an array", 1_000_000_000)
    REPORT = ("a report", 512_000_000)
    PROGRESS = ("a JSON file", 256_000_000)
    WEIGHTS = ("weights in safetensors", 64 * 1024 * 1024)
    MESH = ("a mesh", 64_000_000)
    PICTURE = ("an image", 256_000_000)
    ANNOTATIONS = ("annotations as in COCO", 64_000_000)
    LANDMARKS = ("a JSON list of places", 1_000_000)

    @property
    def words(self) -> str:
        """What the file is, in words."""
        return self.value[0]

    @property
    def most_bytes(self) -> int:
        """Largest size [bytes]."""
        return self.value[1]


class FileError(RpojaxError):
    """A file cannot be read.

    Attributes:
        found: what was found, such as `a FIFO`
        expected: what was expected
        is_there: whether there is something at the path
    """

    def __init__(self, path: Path, found: str, expected: str, is_there: bool = True) -> None:
        super().__init__(f"{path}: found {found}, expected {expected}")
        self.found = found
        self.expected = expected
        self.is_there = is_there


def read_bytes(path: Path, kind: FileKind) -> bytes:
    """Content of a regular file of a kind.

    Raises:
        FileError: it is missing, unreadable, too large or no regular file.
    """
    content = _read(path, kind, kind.most_bytes + 1)
    if len(content) > kind.most_bytes:
        raise _too_large(path, kind)
    return content


def check_readable(path: Path, kind: FileKind) -> None:
    """Refuses what `read_bytes` would, by the beginning of the file.

    Raises:
        FileError: it is missing, unreadable, too large or no regular file.
    """
    _read(path, kind, len(_LFS_POINTER))


def _read(path: Path, kind: FileKind, count: int) -> bytes:
    """The first bytes of a file, at most `count`."""
    try:
        _check(path, path.stat(), kind)
        # What replaced the file since then must not block.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
        with os.fdopen(handle, "rb") as stream:
            _check(path, os.fstat(stream.fileno()), kind)
            content = stream.read(count)
    except (OSError, ValueError) as error:
        raise _unreadable(path, error, kind) from None
    if content.startswith(_LFS_POINTER):
        raise FileError(
            path, "a pointer of Git LFS in place of the file", f"{kind.words}, as `git lfs pull` fetches it"
        )
    return content


def is_regular(path: Path) -> bool:
    """Whether a path leads to a regular file; false for what cannot be a path."""
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Whether a path leads to a folder; false for what cannot be a path."""
    try:
        return stat.S_ISDIR(path.stat().st_mode)
    except (OSError, ValueError):
        return False


def absolute_path(path: Path) -> Path:
    """The path from the root, links resolved; one that cannot be a path, or whose links go in a circle, as it is."""
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError):
        return path


def reason_of(error: Exception) -> str:
    """Why a file cannot be read, in the words of the system."""
    return (getattr(error, "strerror", None) or str(error) or type(error).__name__).lower()


def _check(path: Path, found: os.stat_result, kind: FileKind) -> None:
    if not stat.S_ISREG(found.st_mode):
        raise FileError(path, _type_name(found.st_mode), f"{kind.words} in a regular file")
    if found.st_size > kind.most_bytes:
        raise _too_large(path, kind)


def _unreadable(path: Path, error: Exception, kind: FileKind) -> FileError:
    is_there = not isinstance(error, FileNotFoundError | NotADirectoryError)
    return FileError(path, reason_of(error), f"{kind.words} that can be read", is_there)


def _too_large(path: Path, kind: FileKind) -> FileError:
    return FileError(path, f"more than {kind.most_bytes} bytes", f"{kind.words} of at most so many")


def _type_name(mode: int) -> str:
    tests = {
        "a folder": stat.S_ISDIR,
        "a FIFO": stat.S_ISFIFO,
        "a socket": stat.S_ISSOCK,
        "a device": lambda mode: stat.S_ISCHR(mode) or stat.S_ISBLK(mode),
    }
    return next((name for name, test in tests.items() if test(mode)), "something else")
