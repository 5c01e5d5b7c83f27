"""Distribution of test groups over the workers of pytest-xdist: one worker per folder, longest folders first."""

from typing import Any

import pytest
from xdist.scheduler import LoadScopeScheduling

GROUPS_LONGEST_FIRST = (
    *("campaign", "simulation", "vision", "cli", "gradient", "analysis", "test_notebooks.py", "training"),
    *("validation", "interop", "report", "flight", "physics"),
)
"""Groups by decreasing duration; groups that are not listed come last."""

CAMPAIGN_FOLDERS = ("campaign", "dispersions", "benchmark")
"""Folders whose tests share compiled programs, and so form one group."""


def group_of(nodeid: str) -> str:
    """Group of a test: its folder below `tests`, or its file if that is directly in `tests`."""
    parts = nodeid.split("::")[0].split("/")
    name = parts[1] if len(parts) > 1 else parts[0]
    return "campaign" if name in CAMPAIGN_FOLDERS else name


def sort_longest_group_first(items: list[pytest.Item]) -> None:
    """Sorts tests into the order in which they are distributed."""
    ranks = {name: rank for rank, name in enumerate(GROUPS_LONGEST_FIRST)}
    items.sort(key=lambda item: ranks.get(group_of(item.nodeid), len(ranks)))


class GroupScheduling(LoadScopeScheduling):
    """Assigns each group to one worker, so that no program of it is traced or compiled twice."""

    def __init__(self, config: pytest.Config, log: Any = None) -> None:
        super().__init__(config, log)
        config.option.loadscopereorder = False

    def _split_scope(self, nodeid: str) -> str:
        return group_of(nodeid)
