"""Text of files that are not trusted: UTF-8, with or without a byte order mark, or a line that says what it looks like.

PowerShell writes UTF-16 where another shell writes UTF-8, and older editors write the code page of their country.
"""

import codecs
from pathlib import Path

from rpojax.errors import RpojaxError
from rpojax.untrusted.file_reading import FileError, FileKind, read_bytes

_MARKS = (
    (codecs.BOM_UTF32_LE, "UTF-32"),
    (codecs.BOM_UTF32_BE, "UTF-32"),
    (codecs.BOM_UTF16_LE, "UTF-16"),
    (codecs.BOM_UTF16_BE, "UTF-16"),
)
"""Byte order marks, of which the first one that fits counts."""
_SAMPLE = 4096
"""Bytes at the beginning that show an encoding without a mark."""


class EncodingError(RpojaxError):
    """A file has no text in UTF-8.

    Attributes:
        found: what it looks like, such as `no text in UTF-8 (looks like UTF-16)`
    """

    def __init__(self, found: str) -> None:
        super().__init__(f"found {found}, expected UTF-8")
        self.found = found


def read_text(path: Path, kind: FileKind) -> str:
    """Text of a regular file of a kind, in UTF-8 with or without a byte order mark.

    Raises:
        FileError: it is missing, unreadable, too large, no regular file, or no text in UTF-8.
    """
    try:
        return decode_text(read_bytes(path, kind))
    except EncodingError as error:
        raise FileError(path, error.found, f"{kind.words} in UTF-8") from None


def decode_text(content: bytes) -> str:
    """Text in UTF-8 without its byte order mark.

    Raises:
        EncodingError: it is none; says which encoding it looks like.
    """
    form = _wide_form(content)
    if form is not None:
        raise EncodingError(f"no text in UTF-8 (looks like {form})")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{content[error.start]:02X} in line {line}"
        likely = ", as in Latin-1 or Windows-1252" if b"\0" not in content else ", as in a binary file"
        raise EncodingError(f"no text in UTF-8 ({byte}{likely})") from None
    if "\0" in text:
        raise EncodingError("no text in UTF-8 (it has zero bytes, as in a binary file)")
    return text


def _wide_form(content: bytes) -> str | None:
    """UTF-16 or UTF-32 if the content has the mark of one, or the zero bytes that Latin letters have in one."""
    for mark, form in _MARKS:
        if content.startswith(mark):
            return form
    sample = content[:_SAMPLE]
    zeros = [sample[start::4].count(0) for start in range(4)]
    most = max(1, len(sample) // 4)
    zero, other = [count > 0.7 * most for count in zeros], [count < 0.1 * most for count in zeros]
    for pattern, form in (("0111", "UTF-32"), ("1110", "UTF-32"), ("0101", "UTF-16"), ("1010", "UTF-16")):
        if len(sample) >= 4 and all((zero if bit == "1" else other)[place] for place, bit in enumerate(pattern)):
            return form
    return None
