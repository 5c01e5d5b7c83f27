"""Shard of a campaign for one job of an array: every n-th block."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from rpojax.errors import RpojaxError


@dataclass(frozen=True)
class Shard:
    """Shard `number` of `count`, from 1: the blocks b with b % count == number - 1."""

    number: int
    count: int

    @classmethod
    def parse(cls, text: str) -> "Shard":
        """Shard from text such as `2/8`.

        Raises:
            RpojaxError: the text has another form, or there is no such shard.
        """
        found = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text)
        if not found or not 1 <= int(found[1]) <= int(found[2]):
            raise RpojaxError.of_argument("shard", f"found {text!r}, expected i/n with i from 1 to n, such as 2/8")
        return cls(int(found[1]), int(found[2]))

    def select(self, blocks: Sequence[int]) -> list[int]:
        """The blocks that belong to this shard."""
        return [block for block in blocks if block % self.count == self.number - 1]


ALL_BLOCKS = Shard(1, 1)
"""The only shard of a campaign that is not divided."""
