"""Which tests a worker does in one go, and which come first: those that share compiled programs, the longest ones."""

from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

GROUPS_LONGEST_FIRST = (
    *("campaign", "simulation", "vision", "cli", "gradient", "analysis", "test_notebooks.py", "training"),
    *("validation", "interop", "report", "flight", "physics"),
)
"""Folders and files of this folder by falling time, as far as it counts; whatever is not here comes last."""


CAMPAIGN_FOLDERS = ("campaign", "dispersions", "benchmark")
"""Folders whose tests use the same programs."""


def group_of(nodeid: str) -> str:
    """The folder below this one that a test is in, or its file where it is in none."""
    words = nodeid.split("::")[0].split("/")
    place = words[1] if len(words) > 1 else words[0]
    return "campaign" if place in CAMPAIGN_FOLDERS else place


def sort_longest_group_first(items: list[pytest.Item]) -> None:
    """Puts the tests in the order in which they are handed out."""
    places = {name: place for place, name in enumerate(GROUPS_LONGEST_FIRST)}
    items.sort(key=lambda item: places.get(group_of(item.nodeid), len(places)))


class GroupScheduling(LoadScopeScheduling):
    """One worker does all the tests of a folder, so that none is compiled or traced twice."""

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        config.option.loadscopereorder = False

    def _split_scope(self, nodeid: str) -> str:
        return group_of(nodeid)
