"""Parsing of TOML that is not trusted, in a time that is bounded by its size.

The time of a TOML parser grows with the square of the parts of a dotted key, and steeply with the number of keys; both
are counted before it begins.
"""

import re
import tomllib
import unicodedata
from typing import Any, Final

from rpojax.untrusted.structure_limits import StructureError, check_structure

MOST_KEYS: Final = 20_000
"""Most keys, counted by their equality signs."""
MOST_KEY_PARTS: Final = 32
"""Most parts of a dotted key."""
MOST_TABLES: Final = 5_000
"""Most lines with the head of a table."""
MOST_ITEMS: Final = 1_200_000
"""Most items of lists, counted by commas and brackets."""

_OPAQUE: Final = re.compile(
    r"#[^\n]*"
    r'|"""(?:[^"\\]|\\.|"(?!""))*"""'
    r"|'''(?:[^']|'(?!''))*'''"
    r'|"(?:[^"\\\n]|\\.)*"'
    r"|'[^'\n]*'",
    re.DOTALL,
)
"""Comments and texts, in which no character is part of the structure."""
_ENDS: Final = re.compile(r"[\n,={}]")
_PLACE: Final = re.compile(r"\(at line (\d+), column (\d+)\)")
_HEADS: Final = re.compile(r"^[ \t]*\[[^,\n]*$", re.MULTILINE)


def parse_toml(text: str) -> dict[str, Any]:
    """Tables of a text in TOML.

    Raises:
        StructureError: it is no TOML, or beyond the limits on structure.
    """
    _check_counts(text)
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise StructureError("found TOML that is too deep, expected a few levels") from None
    except ValueError as error:
        found = f"{error!s:.200}{_character_at(str(error), text)}"
        raise StructureError(f"found {found}, expected a valid TOML file") from None
    check_structure(content, finite=False)  # the schema names the key of a number that is not finite
    return content


def _character_at(message: str, text: str) -> str:
    """The character at the place of an error if it is beyond ASCII, as typographic quotes and spaces are."""
    place = _PLACE.search(message)
    if place is None:
        return ""
    line = text.split("\n")[int(place[1]) - 1 : int(place[1])]
    character = "".join(line)[int(place[2]) - 1 : int(place[2])]
    if not character or character.isascii():
        return ""
    return f", the character U+{ord(character):04X} ({unicodedata.name(character, 'without a name')})"


def _check_counts(text: str) -> None:
    bare = _OPAQUE.sub('""', text)
    parts = max((piece.count(".") for piece in _ENDS.split(bare)), default=0) + 1
    counts = (
        (bare.count("="), MOST_KEYS, "keys"),
        (parts, MOST_KEY_PARTS, "parts of a key"),
        (len(_HEADS.findall(bare)), MOST_TABLES, "tables"),
        (bare.count(",") + bare.count("["), MOST_ITEMS, "items of lists"),
    )
    for found, most, what in counts:
        if found > most:
            raise StructureError(f"found {found} {what}, expected at most {most}")
