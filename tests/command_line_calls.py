"""Outcome of a command line, and its stderr without the lines of a slow machine."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Outcome:
    """What a command left: exit status and both streams."""

    status: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        return json.loads(self.out)


Call = Callable[..., Outcome]


def without_signs_of_life(err: str) -> str:
    """What a process printed on stderr but for the lines that appear when a machine is slow."""
    return "".join(line for line in err.splitlines(keepends=True) if not line.rstrip().endswith("s so far"))
