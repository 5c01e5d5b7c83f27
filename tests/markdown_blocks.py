"""Fenced blocks of a page in the order in which a reader meets them."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

_FENCE = re.compile(r"^(```+|:::+)(.*)$")
_NAME = re.compile(r"^#\s+([\w./-]+\.(?:toml|py))$")
_NAME_BEFORE = re.compile(r"^<!-- ([\w./-]+\.(?:toml|py)) -->$")


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Attributes:
        language: empty for shell commands
        text: of the block
        file: name under which the reader is to save it; None for one that is run
        line: of its first line in the page
    """

    language: str
    text: str
    file: str | None
    line: int


def code_blocks(page: str) -> Iterator[Block]:
    """Blocks of a page; directives, which begin with a brace, are no code."""
    lines = page.splitlines()
    index = 0
    while index < len(lines):
        opening = _FENCE.match(lines[index])
        if opening is None or not opening[1].startswith("`"):
            index += 1
            continue
        end = next(place for place in range(index + 1, len(lines)) if lines[place].startswith(opening[1]))
        language, body = opening[2].strip(), lines[index + 1 : end]
        if not language.startswith("{"):
            before = _NAME_BEFORE.match(lines[index - 1]) if index else None
            named = _NAME.match(body[0]) if body else None
            file = before[1] if before else named[1] if named else None
            yield Block(language, "\n".join(body) + "\n", file, index + 2)
        index = end + 1
