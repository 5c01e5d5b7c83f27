"""A run flown again: which are refused, where it ends, and how far it is from what was recorded."""

import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from empty_campaign_folders import empty_campaign

from rpojax.campaign import single_run
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.interop import run_replay
from rpojax.interop.ros2 import message_values
from rpojax.interop.run_replay import ReplayedRun, TickObserver
from rpojax.runtime.progress import Progress
from rpojax.scenario import scenario_file
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation.closed_loop import State


def test_a_run_that_the_campaign_does_not_have_is_refused(folder: Campaign) -> None:
    with pytest.raises(RpojaxError, match=r"--run-id: found 4, expected a run of this campaign, 0 to 3"):
        run_replay.replay(folder, 4, message_values.observe_tick)


def test_other_trained_files_than_the_campaigns_are_refused(folder: Campaign, tmp_path: Path) -> None:
    described = json.loads((folder.directory / "campaign.json").read_text())
    (tmp_path / "campaign.json").write_text(json.dumps({**described, "scenario_hash": "0" * 64}))
    with pytest.raises(RpojaxError, match="scenario: found another content or trained files"):
        run_replay.replay(Campaign(tmp_path), 3, message_values.observe_tick)


def test_a_run_of_a_campaign_in_single_precision_is_flown_in_double(
    both: ReplayedRun, observe_both: TickObserver, tmp_path: Path
) -> None:
    file = both.file.model_copy(update={"precision": "single"})
    found = run_replay.replay(empty_campaign(tmp_path / "runs", file, both.seed, 4, 0, 1), both.run_id, observe_both)
    assert (
        scenario_file.digest(found.file)
        == json.loads((tmp_path / "runs" / "campaign.json").read_text())["scenario_hash"]
    )
    for name, values in both.poses.items():
        np.testing.assert_array_equal(found.poses[name], values, err_msg=name)


def test_a_run_ends_with_the_tick_at_which_it_failed(
    folder: Campaign, both: ReplayedRun, observe_both: TickObserver, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The same numbers but for the sphere that must not be entered: the same way up to there.
    distance = both.poses["range_m"]
    radius = float(0.5 * (distance[1:].min() + distance[1:].max()))
    entered = 1 + int(np.argmax(distance[1:] < radius))
    dispersed = single_run.initialise_run

    def narrow(*run: Any) -> tuple[Scenario, Params, State]:
        static, chosen, state = dispersed(*run)
        limits = replace(chosen.limits, keep_out=jnp.full_like(chosen.limits.keep_out, radius))
        return static, replace(chosen, limits=limits), state

    monkeypatch.setattr(single_run, "initialise_run", narrow)
    told: list[Progress] = []
    found = run_replay.replay(folder, both.run_id, observe_both, on_progress=told.append)
    assert (found.ticks, found.failed_at_s, [each.total for each in told]) == (entered, entered - 1.0, [1])
    assert (found.params.limits.keep_out, len(found.values[0].time_s)) == (radius, entered)
    np.testing.assert_array_equal(found.poses["r_ST_N"], both.poses["r_ST_N"][:entered])


class Recorded(Campaign):
    """A campaign folder that has recorded one run."""

    recorded: dict[str, Any]

    @property
    def run_ids(self) -> np.ndarray:
        return self.recorded["run_ids"]

    @property
    def traces(self) -> dict[str, np.ndarray]:
        return {"range_m": self.recorded["range_m"]}

    @property
    def failed_at_s(self) -> np.ndarray:
        return self.recorded["failed_at_s"]


@pytest.fixture
def recorded(folder: Campaign, flight: ReplayedRun) -> Recorded:
    """The folder as if it had flown that run, and another one before."""
    made = Recorded(folder.directory)
    flown = flight.poses["range_m"][::10].astype(np.float32)
    made.recorded = {
        "run_ids": np.array([2, 3]),
        "range_m": np.stack([flown + np.float32(5.0), flown]),
        "failed_at_s": np.array([1.0, np.nan]),
    }
    return made


def test_a_flight_is_compared_with_what_the_campaign_recorded(flight: ReplayedRun, recorded: Recorded) -> None:
    assert run_replay.compare_with_campaign(flight, recorded) == run_replay.ReplayAgreement(18, 0.0, True)
    recorded.recorded["range_m"][1, 7] += np.float32(0.5)
    recorded.recorded["failed_at_s"][1] = 90.0
    found = run_replay.compare_with_campaign(flight, recorded)
    assert found
    assert (found.range_difference_m, found.same_end) == (pytest.approx(0.5, rel=1e-5), False)


def test_a_run_that_is_not_flown_yet_cannot_be_compared(flight: ReplayedRun, folder: Campaign) -> None:
    assert run_replay.compare_with_campaign(flight, folder) is None
