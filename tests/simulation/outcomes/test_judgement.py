"""Outcomes of hand-made records: thresholds, precedence, recovery, and each run by its own limits."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.outcomes import outcome_kinds
from rpojax.simulation.outcomes.judgement import REQUIRED_CHANNELS, JudgedRuns, Records, judge, judge_one
from rpojax.simulation.outcomes.outcome_events import MAX_EVENTS, listed_events
from rpojax.simulation.outcomes.outcome_kinds import REASONS, Outcome

NEES_OF_25_PER_COMPONENT = 150.0


@pytest.fixture(scope="module")
def mission() -> ScenarioFile:
    """One frame a second, lost after 600 s, 10 m about the station judged from 3000 s, and no need to be there."""
    return scenario_loader.load("inspection", ["goal.phase=none"])


def good_records(ticks: int, runs: int = 1) -> dict[str, np.ndarray]:
    """Runs on station that always see the target and use no propellant."""
    flag = np.ones((runs, ticks), bool)
    scalar = np.zeros((runs, ticks), np.float32)
    return {
        "box_accepted": flag.copy(),
        "box_outlier": ~flag,
        "observable": flag.copy(),
        "nees_relative": scalar + np.float32(6.0),
        "relative_error_H": np.zeros((runs, ticks, 3), np.float32),
        "relative_sigma_H": np.ones((runs, ticks, 3), np.float32),
        "rho_H": np.zeros((runs, ticks, 3), np.float32) + np.array([0.0, -30.0, 0.0], np.float32),
        "propellant_used_kg": scalar.copy(),
        "running": flag.copy(),
    }


def judged(file: ScenarioFile, records: Records, varied: Mapping[str, np.ndarray] | None = None) -> JudgedRuns:
    """Outcomes of runs that were not frozen."""
    runs = len(records["running"])
    return judge(file, varied or {}, records, np.zeros(runs, np.int8), np.full(runs, np.inf))


def outcome(file: ScenarioFile, records: Records) -> str:
    """Outcome of one run."""
    return judge_one(file, {}, records)


def test_the_channels_of_a_good_run_are_all_that_is_read(mission: ScenarioFile) -> None:
    assert set(good_records(1)) == set(REQUIRED_CHANNELS)
    found = judged(mission, good_records(6000))
    assert (found.codes.tolist(), found.failed.tolist(), found.events.count.tolist()) == ([0], [False], [0])
    assert np.isnan(found.since_s).all()


@pytest.mark.parametrize(("outside_s", "expected"), [(1800, "completed"), (1801, "diverged")])
def test_no_run_is_completed_whose_filter_is_wrong_for_a_tenth_of_it(
    mission: ScenarioFile, outside_s: int, expected: str
) -> None:
    records = good_records(6000)
    records["relative_error_H"][:, :outside_s, 1] = 3.1
    assert outcome(mission, records) == expected
    since_s = float(judged(mission, records).since_s[0])
    assert math.isnan(since_s) if expected == "completed" else since_s == 1800.0


@pytest.mark.parametrize(("unseen_s", "expected"), [(599, "completed"), (600, "lost")])
def test_a_run_is_lost_after_600_s_without_a_box(mission: ScenarioFile, unseen_s: int, expected: str) -> None:
    records = good_records(2000)
    records["box_accepted"][:, 2000 - unseen_s :] = False
    assert outcome(mission, records) == expected


def test_a_false_box_that_was_accepted_is_no_box_of_the_target(mission: ScenarioFile) -> None:
    records = good_records(2000)
    records["box_outlier"][:, 1000:] = True
    assert outcome(mission, records) == "lost"


def test_only_time_with_light_counts(mission: ScenarioFile) -> None:
    records = good_records(3000)
    records["box_accepted"][:, 1000:] = False
    records["observable"][:, 1300:2700] = False
    found = judged(mission, records)
    # 300 s of light before the shadow and 300 s after it.
    assert outcome_kinds.of_codes(found.codes).tolist() == ["lost"]
    assert found.since_s.tolist() == [2999.0]
    records["observable"][:, 2700] = False
    assert outcome(mission, records) == "completed"


@pytest.mark.parametrize("camera_hz", [0.2, 1.0, 5.0])
def test_seconds_are_counted_and_not_frames(camera_hz: float) -> None:
    file = scenario_loader.load("inspection", [f"rates.camera_hz={camera_hz}"])
    ticks = round(2000 * camera_hz)
    records = good_records(ticks)
    records["box_accepted"][:, round(1000 * camera_hz) + 1 :] = False
    found = judged(file, records)
    assert outcome_kinds.of_codes(found.codes).tolist() == ["lost"]
    # The last box was at 1000 s.
    np.testing.assert_allclose(found.since_s, 1600.0, atol=1e-6)


def test_a_run_that_finds_the_target_again_completes_and_the_flag_is_an_event(mission: ScenarioFile) -> None:
    records = good_records(3000)
    records["box_accepted"][:, 500:1800] = False
    found = judged(mission, records)
    assert found.codes.tolist() == [0]
    (event,) = listed_events(np.array([7]), found.events.stored(slice(None)))
    assert (event.run_id, event.outcome, event.raised_at_s, event.cleared_at_s) == (7, "lost", 1099.0, 1800.0)


@pytest.mark.parametrize(
    ("nees", "since", "expected"),
    [
        (NEES_OF_25_PER_COMPONENT + 1e-3, 1400, "diverged"),
        (NEES_OF_25_PER_COMPONENT + 1e-3, 1401, "completed"),
        (NEES_OF_25_PER_COMPONENT, 0, "completed"),
        (np.nan, 0, "diverged"),
    ],
)
def test_a_filter_has_diverged_after_600_s_above_25_per_component(
    mission: ScenarioFile, nees: float, since: int, expected: str
) -> None:
    records = good_records(2000)
    records["nees_relative"][:, since:] = nees
    assert outcome(mission, records) == expected


def test_one_consistent_tick_interrupts_the_divergence(mission: ScenarioFile) -> None:
    records = good_records(2000)
    records["nees_relative"][:] = 1e4
    records["nees_relative"][:, 1500] = 6.0
    found = judged(mission, records)
    assert found.codes.tolist() == [0]
    (event,) = listed_events(np.array([0]), found.events.stored(slice(None)))
    assert (event.outcome, event.cleared_at_s) == ("diverged", 1500.0)


def test_off_station_is_judged_by_distance_from_the_time_of_arrival_on(mission: ScenarioFile) -> None:
    records = good_records(6000)
    records["rho_H"][:, 4000:] += np.array([6.0, 0.0, 8.1], np.float32)
    found = judged(mission, records)
    assert outcome_kinds.of_codes(found.codes).tolist() == ["off_station"]
    assert found.since_s.tolist() == [4000.0]
    records["rho_H"][:, -1] = [0.0, -39.9, 0.0]
    assert outcome(mission, records) == "completed"
    early = good_records(2999)
    early["rho_H"] += 100.0
    assert outcome(mission, early) == "completed"
    # The last tick stands for the end of the run.
    late = good_records(3000)
    late["rho_H"] += 100.0
    assert outcome(mission, late) == "off_station"


@pytest.mark.parametrize(
    ("duration_s", "arrive_by_s", "expected"),
    [(2900, 3000.0, "not_judged"), (2999, 3000.0, "not_judged"), (3000, 3000.0, "completed"), (99, 0.0, "completed")],
)
def test_a_run_that_ends_before_it_must_be_on_station_is_not_judged(
    duration_s: int, arrive_by_s: float, expected: str
) -> None:
    file = scenario_loader.load("inspection", [f"limits.arrive_by_s={arrive_by_s}"])
    found = judged(file, good_records(duration_s))
    assert outcome_kinds.of_codes(found.codes).tolist() == [expected]
    assert (found.failed.tolist(), found.frozen.tolist(), np.isnan(found.since_s).all()) == ([False], [False], True)


def test_what_ends_too_early_fails_by_all_other_limits() -> None:
    file = scenario_loader.load("inspection")
    records = good_records(1000, runs=3)
    records["box_accepted"][0, 300:] = False
    records["rho_H"] += 100.0
    found = judge(file, {}, records, np.array([0, Outcome.KEEP_OUT.code, 0]), np.array([np.inf, 500.0, np.inf]))
    assert outcome_kinds.of_codes(found.codes).tolist() == ["lost", "keep_out", "not_judged"]
    assert found.failed.tolist() == [True, True, False]
    varied = {"limits.arrive_by_s": np.array([900.0, 1000.0, 1001.0])}
    found = judged(file, good_records(1000, runs=3), varied)
    assert outcome_kinds.of_codes(found.codes).tolist() == ["completed", "completed", "not_judged"]


def test_a_run_that_used_its_propellant_stays_without(mission: ScenarioFile) -> None:
    records = good_records(100)
    records["propellant_used_kg"][:, 60:] = 3.0
    found = judged(mission, records)
    assert outcome_kinds.of_codes(found.codes).tolist() == ["out_of_propellant"]
    assert found.since_s.tolist() == [60.0]


def test_the_first_outcome_by_precedence_counts(mission: ScenarioFile) -> None:
    records = good_records(4000, runs=6)
    records["rho_H"] += 100.0
    records["nees_relative"][:5] = 1e4
    records["box_accepted"][:4] = False
    records["propellant_used_kg"][:3] = 5.0
    frozen = np.array([Outcome.NON_FINITE.code, Outcome.KEEP_OUT.code, 0, 0, 0, 0])
    found = judge(mission, {}, records, frozen, np.array([100.0, 200.0, *[np.inf] * 4]))
    expected = ["non_finite", "keep_out", "out_of_propellant", "lost", "diverged", "off_station"]
    assert outcome_kinds.of_codes(found.codes).tolist() == expected
    assert found.since_s.tolist() == [100.0, 200.0, 0.0, 599.0, 599.0, 3000.0]
    assert found.frozen.tolist() == [True, True, False, False, False, False]
    assert found.failed.all()


def test_each_run_is_judged_by_its_own_limits(mission: ScenarioFile) -> None:
    records = good_records(4000, runs=2)
    varied = {
        "formation.desired_position_m": np.array([[0.0, -30.0, 0.0], [0.0, -50.0, 0.0]]),
        "limits.lost_after_s": np.array([600.0, 50.0]),
    }
    found = judged(mission, records, varied)
    assert outcome_kinds.of_codes(found.codes).tolist() == ["completed", "off_station"]
    records["box_accepted"][:, 3900:] = False
    found = judged(mission, records, varied)
    assert outcome_kinds.of_codes(found.codes).tolist() == ["completed", "lost"]
    for key, values in (("limits.off_station_m", [20.1, 19.9]), ("limits.arrive_by_s", [5000.0, 3000.0])):
        shifted = good_records(4000, runs=2)
        shifted["rho_H"] += np.array([0.0, 20.0, 0.0], np.float32)
        found = judged(mission, shifted, {key: np.array(values)})
        assert outcome_kinds.of_codes(found.codes).tolist() == ["completed", "off_station"]
    used = good_records(100, runs=2)
    used["propellant_used_kg"][:] = 0.1
    found = judged(mission, used, {"limits.propellant_kg": np.array([0.11, 0.1])})
    assert outcome_kinds.of_codes(found.codes).tolist() == ["completed", "out_of_propellant"]


def test_a_frozen_run_raises_no_flag_after_its_end(mission: ScenarioFile) -> None:
    records = good_records(3000)
    records["box_accepted"][:, 200:] = False
    records["running"][:, 500:] = False
    found = judge(mission, {}, records, np.array([Outcome.KEEP_OUT.code]), np.array([499.0]))
    assert found.events.count.tolist() == [0]


def test_the_first_events_of_a_run_are_stored_and_all_are_counted(mission: ScenarioFile) -> None:
    records = good_records(3100)
    records["rho_H"][:, 3000::2] += 100.0
    found = judged(mission, records)
    assert found.events.count.tolist() == [50]
    stored = listed_events(np.array([0]), found.events.stored(slice(None)))
    assert [(each.raised_at_s, each.cleared_at_s) for each in stored] == [
        (3000.0 + 2 * i, 3001.0 + 2 * i) for i in range(MAX_EVENTS)
    ]


def test_every_outcome_but_completed_has_its_own_reason() -> None:
    assert len(REASONS) == len(Outcome)
    failures = [kind for kind in Outcome if kind.is_failure]
    assert set(Outcome) - set(failures) == {Outcome.COMPLETED, Outcome.NOT_JUDGED}
    assert {kind.reason for kind in set(Outcome) - set(failures)} == {""}
    assert len({kind.reason for kind in failures}) == len(failures) == len(Outcome) - 2
    # Codes are stored in campaign folders.
    assert (Outcome.ABORTED.code, Outcome.UNFINISHED.code, Outcome.NOT_JUDGED.code) == (7, 8, 9)
    outcomes = np.array(["completed", "lost", "unfinished", "not_judged"])
    assert outcome_kinds.is_failed(outcomes).tolist() == [False, True, True, False]
    assert sum(outcome_kinds.count_outcomes(np.array(["lost", "lost", "completed"])).values()) == 3
