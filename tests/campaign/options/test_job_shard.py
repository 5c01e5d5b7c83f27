"""Shards of a campaign."""

import pytest

from rpojax.campaign.options.campaign_options import Shard
from rpojax.errors import RpojaxError


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/0", "-1/2", "1/2/3", ""])
def test_invalid_shards_are_refused(text: str) -> None:
    with pytest.raises(RpojaxError, match=r"shard: found .*expected i/n"):
        Shard.parse(text)


def test_shards_partition_the_blocks() -> None:
    parts = [Shard.parse(f"{number}/3").select(range(10)) for number in (1, 2, 3)]
    assert parts[0] == [0, 3, 6, 9]
    assert sorted(block for part in parts for block in part) == list(range(10))
