"""Interface of executors, which have the blocks of a campaign simulated in this process, in others or on a cluster.

A block depends only on the campaign folder and its number, and its results are written into that folder. So an executor
only distributes block numbers, notices workers that die, and has their blocks repeated.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.scenario.plugins import plugin_registry

MAX_ATTEMPTS = 3
"""A block is given up after so many workers have died while simulating it."""

ExecutorProgressCallback = Callable[[float, int, bool], None]
"""Called with the runs done, fractions included, the runs failed so far, and whether programs are compiled."""


@runtime_checkable
class Executor(Protocol):
    """Simulates blocks of one campaign."""

    def run_blocks(self, blocks: Sequence[int], on_progress: ExecutorProgressCallback) -> dict[int, str]:
        """Simulates some blocks and stores them in the campaign folder; returns block -> reason for those given up.

        Raises:
            RpojaxError: an error that no repetition can avoid, such as a full disk.
        """
        ...


def check_default_stages(campaign: Campaign) -> None:
    """Refuses replaced stages, which cannot be sent to other processes.

    Raises:
        RpojaxError: a stage of the campaign is replaced.
    """
    plugin = plugin_registry.plugin_of(campaign.file)
    if campaign.file.plugin == plugin_registry.FROM_PYTHON:
        raise RpojaxError("metrics: found some from Python, expected a plugin file with other processes as workers")
    of_plugin = plugin is not None and plugin.stages is not None
    if (stages := campaign.configuration.stages) and not of_plugin:
        raise RpojaxError(f"stages: found {sorted(stages)} replaced, expected none with other processes as workers")
