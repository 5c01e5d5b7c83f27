"""Text of a user as it is printed: control and direction characters escaped, in one line of limited length."""

import unicodedata
from typing import Final

LONGEST_LINE: Final = 400
"""Most characters of a message."""
_LONGEST_VALUE: Final = 160
_ELLIPSIS: Final = "..."
_ESCAPED: Final = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})
"""Unicode categories that a terminal would act on, hide, or could not encode."""


def printable(text: str, longest: int = LONGEST_LINE) -> str:
    """The text in one line: white space as single spaces, what a terminal acts on as escapes, cut with an ellipsis."""
    return cut(escape(" ".join(cut(text, 16 * longest).split())), longest)


def escape(text: str) -> str:
    """The text with every control, direction, separator and surrogate character as its Python escape."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(_escape(letter) if unicodedata.category(letter) in _ESCAPED else letter for letter in text)


def escape_lines(text: str) -> str:
    """As `escape`, but line ends, tabulators and returns remain."""
    return text if text.isascii() and text.isprintable() else "".join(map(_escape_in_lines, text))


def cut(text: str, longest: int) -> str:
    """The text with an ellipsis for its middle if it exceeds `longest` characters: the end says what is expected."""
    end = longest // 2
    return text if len(text) <= longest else text[: longest - end - len(_ELLIPSIS)] + _ELLIPSIS + text[-end:]


def shown_value(value: object) -> str:
    """A value as Python writes it, cut where it is long, or what it is if it cannot be written."""
    try:
        return cut(repr(value), _LONGEST_VALUE)
    except (RecursionError, ValueError):
        return f"a {type(value).__name__} that is too deep or too long to show"


def _escape_in_lines(letter: str) -> str:
    return letter if letter in "\n\t\r" else escape(letter)


def _escape(letter: str) -> str:
    return (
        letter.encode("unicode_escape", "surrogatepass").decode("ascii")
        if ord(letter) > 0xFF
        else f"\\x{ord(letter):02x}"
    )
