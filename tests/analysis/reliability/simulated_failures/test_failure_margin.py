"""Margins are at or below zero exactly for failures, and continuous where what decides the failure is."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rpojax.analysis.reliability.simulated_failures import failure_margin
from rpojax.analysis.reliability.simulated_failures.failure_margin import Failure, SimulatedRuns
from rpojax.scenario.loading import scenario_loader
from rpojax.simulation.outcomes.judgement import JudgedRuns
from rpojax.simulation.outcomes.outcome_events import EventArrays
from rpojax.simulation.outcomes.outcome_kinds import Outcome

NO_EVENTS = EventArrays(np.zeros(3), np.zeros((3, 0)), np.zeros((3, 0)), np.zeros((3, 0)))


def simulated(codes: list[int], drifts: dict[str, np.ndarray] | None = None, **records: Any) -> SimulatedRuns:
    """Three runs with some records."""
    return SimulatedRuns(
        file=scenario_loader.load("inspection"),
        records=records,
        used={},
        drifts=drifts or {},
        judged=JudgedRuns(np.array(codes, dtype=np.int8), np.full(3, np.nan), NO_EVENTS),
    )


def test_keep_out_has_the_least_range_as_margin() -> None:
    rho = np.zeros((3, 2, 3))
    rho[:, :, 1] = [[-30.0, -25.0], [-12.0, -18.0], [-10.4, -10.2]]
    runs = simulated([0, 0, Outcome.KEEP_OUT.code], rho_H=rho)
    found = failure_margin.margins(runs, Failure(outcome=Outcome.KEEP_OUT))
    np.testing.assert_allclose(found[:2], [15.0, 2.0])
    assert found[2] == -failure_margin.LEAST


def test_a_lost_target_has_the_time_since_its_last_box_as_margin() -> None:
    seen = np.zeros((3, 300), dtype=bool)
    seen[0, 250], seen[1, 299] = True, True
    observable = np.ones((3, 300), dtype=bool)
    observable[2, :100] = False
    runs = simulated(
        [0, 0, 0], rho_H=np.zeros((3, 300, 3)), box_accepted=seen, box_outlier=~seen & False, observable=observable
    )
    found = failure_margin.margins(runs, Failure(outcome=Outcome.LOST))
    np.testing.assert_allclose(found, [600.0 - 49.0, 600.0, 600.0 - 200.0])


def test_a_missed_goal_has_the_time_left_when_it_is_reached_as_margin() -> None:
    phase = np.zeros((3, 100), np.int8)
    phase[0, 30:], phase[1, 90:] = 2, 2
    runs = simulated(
        [0, 0, Outcome.UNFINISHED.code], rho_H=np.zeros((3, 100, 3)), phase=phase, running=np.ones((3, 100), bool)
    )
    runs = replace(runs, file=scenario_loader.load("rbar_approach"))
    found = failure_margin.margins(runs, Failure(outcome=Outcome.UNFINISHED))
    np.testing.assert_allclose(found, [70.0, 10.0, -failure_margin.LEAST])


def test_a_metric_has_its_distance_from_the_limit_as_margin() -> None:
    values = np.array([12.0, 10.0, 9.5])
    runs = simulated([0, 0, 0], drifts={"passive_range_24_h_m": values})
    found = failure_margin.margins(runs, Failure("passive_range_24_h_m", "at least", 10.0))
    np.testing.assert_allclose(found, [2.0, failure_margin.LEAST, -0.5])


def test_a_run_that_was_frozen_breaks_every_limit() -> None:
    values = np.array([12.0, 50.0, 50.0])
    runs = simulated([0, Outcome.KEEP_OUT.code, Outcome.NON_FINITE.code], {"passive_range_24_h_m": values})
    found = failure_margin.margins(runs, Failure("passive_range_24_h_m", "at least", 10.0))
    assert (found[1:] < 0.0).all()


def test_a_count_is_ranked_by_the_nearest_continuous_metric() -> None:
    drifts = {
        "passive_unsafe_fraction": np.array([0.0, 0.0, 0.2]),
        "passive_range_24_h_m": np.array([30.0, 12.0, 4.0]),
    }
    failure = Failure("passive_unsafe_fraction", "at most", 0.0)
    found = failure_margin.margins(simulated([0, 0, 0], drifts), failure)
    assert found[0] > found[1] > 0.0
    assert found[2] == pytest.approx(-0.2)
    assert "passive_range_24_h_m" in failure_margin.ranking_remark(failure)
