"""A short flight with a burn, observed for bags and for the viewer at once, and a made-up run."""

import dataclasses
from typing import Any

import jax
import numpy as np
import pytest
from empty_campaign_folders import empty_campaign
from synthetic_run import synthetic_run as make_synthetic_run

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import run_replay
from rpojax.interop.rerun_viewer import viewer_channels
from rpojax.interop.rerun_viewer.viewer_channels import ViewerChannels
from rpojax.interop.ros2 import message_values
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun, TickObserver
from rpojax.scenario import scenario_file

SEED, RUN = 5, 3
SHORT = ("duration_s=180", "rates.formation_period_s=115")
"""Long enough for the second decision, the first with the target in sight, and its burn."""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign folder in which no block is done."""
    file = scenario_file.load("inspection", SHORT)
    return empty_campaign(tmp_path_factory.mktemp("interop") / "runs", file, SEED, 4, 0, 1)


@pytest.fixture(scope="session")
def observe_both() -> TickObserver:
    """What messages and the viewer say of a tick, so that one program is compiled for both."""

    def observe(*tick: Any) -> tuple[RosTickValues, dict]:
        return message_values.observe_tick(*tick), viewer_channels.observe_tick(*tick)

    return observe


@pytest.fixture(scope="session")
def both(folder: Campaign, observe_both: TickObserver) -> ReplayedRun[tuple[RosTickValues, ViewerChannels]]:
    """One of its runs, flown again."""
    return run_replay.replay(folder, RUN, observe_both)


@pytest.fixture(scope="session")
def flight(both: ReplayedRun) -> ReplayedRun[RosTickValues]:
    """That run with everything that messages say."""
    return dataclasses.replace(both, values=both.values[0])


@pytest.fixture(scope="session")
def shown(both: ReplayedRun) -> ReplayedRun[ViewerChannels]:
    """That run with everything that the viewer shows."""
    return dataclasses.replace(both, values=both.values[1])


@pytest.fixture(scope="session")
def around_burn(flight: ReplayedRun[RosTickValues]) -> ReplayedRun[RosTickValues]:
    """The part of it with the decision and the burn."""
    values, poses = jax.tree.map(lambda each: each[112:180:4], (flight.values, flight.poses))
    return dataclasses.replace(flight, values=values, poses=poses)


@pytest.fixture(scope="session")
def shots(around_burn: ReplayedRun) -> np.ndarray:
    """A picture of noise for every tick of that part; the camera of the flight takes none."""
    return np.random.default_rng(1).integers(0, 256, (around_burn.ticks, 6, 8, 3), dtype=np.uint8)


@pytest.fixture
def synthetic_run() -> ReplayedRun[ViewerChannels]:
    """A made-up run through the geometric camera."""
    return make_synthetic_run()
