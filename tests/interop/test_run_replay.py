"""Replays: refusals, the end at a failure, and the comparison with the record of the campaign."""

import json
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from empty_campaign_folders import empty_campaign
from rosbags.highlevel import AnyReader

from rpojax.campaign import single_run
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.campaign_seal import sealed
from rpojax.cli import main
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.interop import run_replay
from rpojax.interop.ros2 import message_values
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun, TickObserver
from rpojax.runtime.progress import Progress
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.state import State


def test_a_run_that_the_campaign_does_not_have_is_refused(campaign: Campaign) -> None:
    with pytest.raises(RpojaxError, match=r"run_id: found 4, expected a run of this campaign, 0 to 3"):
        run_replay.replay_servicers(campaign, 4, message_values.observe_tick)


def test_a_scenario_with_other_trained_files_is_refused(campaign: Campaign, tmp_path: Path) -> None:
    configuration = json.loads((campaign.directory / "campaign.json").read_text())
    (tmp_path / "campaign.json").write_text(json.dumps(sealed({**configuration, "scenario_hash": "0" * 64})))
    with pytest.raises(RpojaxError, match="scenario: found another content or trained files"):
        run_replay.replay_servicers(Campaign(tmp_path), 3, message_values.observe_tick)


def test_a_replay_is_in_double_precision(observed_run: ReplayedRun, observe_both: TickObserver, tmp_path: Path) -> None:
    file = observed_run.file.model_copy(update={"precision": "single"})
    campaign = empty_campaign(tmp_path / "runs", file, observed_run.seed, 4, 0, 1)
    found = run_replay.replay_servicers(campaign, observed_run.run_id, observe_both)[0]
    assert scenario_digest(found.file) == campaign.configuration.scenario_hash
    for name, values in observed_run.poses.items():
        np.testing.assert_array_equal(found.poses[name], values, err_msg=name)


def test_a_failed_run_ends_with_the_tick_of_its_failure(
    campaign: Campaign, observed_run: ReplayedRun, observe_both: TickObserver, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Only the keep-out radius differs, so the trajectory is the same up to the failure.
    distance = observed_run.poses["range_m"]
    radius = float(0.5 * (distance[1:].min() + distance[1:].max()))
    entered = 1 + int(np.argmax(distance[1:] < radius))
    initialise_run = single_run.initialise_run

    def with_larger_keep_out(*run: Any, **options: Any) -> tuple[Scenario, Params, State]:
        scenario, params, state = initialise_run(*run, **options)
        limits = replace(params.limits, keep_out=jnp.full_like(params.limits.keep_out, radius))
        return scenario, replace(params, limits=limits), state

    monkeypatch.setattr(single_run, "initialise_run", with_larger_keep_out)
    reports: list[Progress] = []
    found = run_replay.replay_servicers(campaign, observed_run.run_id, observe_both, on_progress=reports.append)[0]
    assert (found.ticks, found.failed_at_s, [each.total for each in reports]) == (entered, entered - 1.0, [1])
    assert (found.params.limits.keep_out, len(found.values[0].time_s)) == (radius, entered)
    np.testing.assert_array_equal(found.poses["r_ST_N"], observed_run.poses["r_ST_N"][:entered])


class RecordedCampaign(Campaign):
    """A campaign folder that has recorded one run."""

    recorded: dict[str, Any]

    @property
    def run_ids(self) -> np.ndarray:
        return self.recorded["run_ids"]

    @property
    def traces(self) -> dict[str, np.ndarray]:
        return {"range_m": self.recorded["range_m"]}

    @property
    def frozen_at_s(self) -> np.ndarray:
        return self.recorded["frozen_at_s"]


@pytest.fixture
def recorded(campaign: Campaign, ros_run: ReplayedRun) -> RecordedCampaign:
    """The folder with records of that run and of another one before it."""
    found = RecordedCampaign(campaign.directory)
    distance = ros_run.poses["range_m"][::10].astype(np.float32)
    found.recorded = {
        "run_ids": np.array([2, 3]),
        "range_m": np.stack([distance + np.float32(5.0), distance]),
        "frozen_at_s": np.array([1.0, np.nan]),
    }
    return found


def test_a_replay_is_compared_with_the_record_of_the_campaign(ros_run: ReplayedRun, recorded: RecordedCampaign) -> None:
    assert run_replay.compare_with_campaign(ros_run, recorded) == run_replay.ReplayAgreement(18, 0.0, True)
    recorded.recorded["range_m"][1, 7] += np.float32(0.5)
    recorded.recorded["frozen_at_s"][1] = 90.0
    found = run_replay.compare_with_campaign(ros_run, recorded)
    assert found
    assert (found.range_difference_m, found.same_end) == (pytest.approx(0.5, rel=1e-5), False)


def test_a_run_without_a_record_is_not_compared(ros_run: ReplayedRun, campaign: Campaign) -> None:
    assert run_replay.compare_with_campaign(ros_run, campaign) is None


@pytest.fixture(scope="module")
def team(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign of one run of a team."""
    file = scenario_loader.load("cooperative_far", ["duration_s=20"])
    return run_campaign(file, 1, tmp_path_factory.mktemp("team") / "runs", 5, histories=[0])


@pytest.fixture(scope="module")
def team_runs(team: Campaign) -> tuple[ReplayedRun[RosTickValues], ...]:
    """Replay of that run for each servicer."""
    return run_replay.replay_servicers(team, 0, message_values.observe_tick)


@pytest.mark.slow
def test_a_team_has_a_bag_of_the_messages_of_each_servicer(
    team: Campaign,
    team_runs: tuple[ReplayedRun[RosTickValues], ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(run_replay, "replay_servicers", lambda *_, **__: team_runs)
    out = tmp_path / "bag"
    assert main.main(["export-bag", str(team.directory), "--run-id", "0", "--out", str(out)]) == 0
    assert "20 ticks" in capsys.readouterr().out
    with AnyReader([out]) as reader:
        read = [(each.topic, reader.deserialize(data, each.msgtype)) for each, _, data in reader.messages()]
    for run in team_runs:
        speeds = [message.velocity for topic, message in read if topic == f"/{run.servicer_name}/servicer/wheels/state"]
        np.testing.assert_array_equal(speeds, run.values.wheel_speed)


@pytest.mark.slow
def test_a_team_is_replayed_for_each_servicer(
    team: Campaign, team_runs: tuple[ReplayedRun[RosTickValues], ...]
) -> None:
    assert [run.servicer_name for run in team_runs] == ["first", "second"]
    for number, run in enumerate(team_runs):
        found = run_replay.compare_with_campaign(run, team)
        assert found
        # The campaign stores the range in single precision; another program rounds differently.
        assert (found.range_difference_m < 1e-4, found.same_end) == (True, True)
        recorded = team.history(0, number)["rho_H"]
        replayed = np.stack([run.tick(k).relative.position for k in range(run.ticks)])
        np.testing.assert_allclose(replayed, recorded, atol=1e-3)


def test_a_team_agrees_as_well_as_the_servicer_that_agrees_least(monkeypatch: pytest.MonkeyPatch) -> None:
    found: dict[Any, Any] = {
        "near": run_replay.ReplayAgreement(20, 0.1, True),
        "far": run_replay.ReplayAgreement(18, 0.4, False),
        "unrecorded": None,
    }
    monkeypatch.setattr(run_replay, "compare_with_campaign", lambda run, _: found[run])
    compare: Any = run_replay.compare_all
    compare = getattr(compare, "__wrapped__", compare)
    assert compare(["near", "far", "unrecorded"], None) == run_replay.ReplayAgreement(18, 0.4, False)
    assert compare(["unrecorded"], None) is None
