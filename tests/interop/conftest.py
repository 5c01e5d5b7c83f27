"""A short run with a burn, replayed once with the values of messages and of the viewer, and a synthetic run."""

import dataclasses
from typing import Any

import jax
import numpy as np
import pytest
from empty_campaign_folders import empty_campaign
from named_loops import name_loop
from synthetic_run import synthetic_run as make_synthetic_run

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import run_replay, spacecraft_states
from rpojax.interop.rerun_viewer import rrd_chunks
from rpojax.interop.rerun_viewer.rrd_chunks import ViewerChannels
from rpojax.interop.ros2 import message_values
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun, TickObserver
from rpojax.interop.spacecraft_states import BothStates
from rpojax.scenario.loading import scenario_loader

SEED, RUN = 5, 3
OVERRIDES = ("duration_s=180", "rates.formation_period_s=115")
"""Long enough for the second burn decision, the first with the target in sight, and its burn."""


@pytest.fixture(scope="session")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign folder in which no block is done."""
    file = name_loop("replay", scenario_loader.load("inspection", OVERRIDES))
    return empty_campaign(tmp_path_factory.mktemp("interop") / "runs", file, SEED, 4, 0, 1)


@pytest.fixture(scope="session")
def observe_both() -> TickObserver:
    """Observer of all kinds of values, so that one function is compiled for all tests."""

    def observe(*tick: Any) -> tuple[RosTickValues, dict, BothStates]:
        return (
            message_values.observe_tick(*tick),
            rrd_chunks.observe_tick(*tick),
            spacecraft_states.observe_tick(*tick),
        )

    return observe


@pytest.fixture(scope="session")
def observed_run(
    campaign: Campaign, observe_both: TickObserver
) -> ReplayedRun[tuple[RosTickValues, ViewerChannels, BothStates]]:
    """Replay of a run of that campaign."""
    return run_replay.replay_servicers(campaign, RUN, observe_both)[0]


@pytest.fixture(scope="session")
def ros_run(observed_run: ReplayedRun) -> ReplayedRun[RosTickValues]:
    """That run with the values of messages."""
    return dataclasses.replace(observed_run, values=observed_run.values[0])


@pytest.fixture(scope="session")
def viewer_run(observed_run: ReplayedRun) -> ReplayedRun[ViewerChannels]:
    """That run with the channels of the viewer."""
    return dataclasses.replace(observed_run, values=observed_run.values[1])


@pytest.fixture(scope="session")
def states_run(observed_run: ReplayedRun) -> ReplayedRun[BothStates]:
    """That run with the states of both spacecraft."""
    return dataclasses.replace(observed_run, values=observed_run.values[2])


@pytest.fixture(scope="session")
def burn_interval(ros_run: ReplayedRun[RosTickValues]) -> ReplayedRun[RosTickValues]:
    """Every fourth tick around the burn decision and the burn."""
    values, poses = jax.tree.map(lambda each: each[112:180:4], (ros_run.values, ros_run.poses))
    return dataclasses.replace(ros_run, values=values, poses=poses)


@pytest.fixture(scope="session")
def noise_images(burn_interval: ReplayedRun) -> np.ndarray:
    """An image of noise for every tick of that interval; the geometric camera of the run takes none."""
    return np.random.default_rng(1).integers(0, 256, (burn_interval.ticks, 6, 8, 3), dtype=np.uint8)


@pytest.fixture
def synthetic_run() -> ReplayedRun[ViewerChannels]:
    """A synthetic run with the geometric camera."""
    return make_synthetic_run()
