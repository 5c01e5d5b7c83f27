"""Equipment faults and eclipse in the closed loop: one batch of short runs that differ in their parameters."""

import jax
import numpy as np
import pytest
from fault_and_eclipse_runs import BEGIN, CASES, END, SUNRISE, SUNSET, TICKS, Runs

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.physics import equipment_faults
from rpojax.simulation.telemetry import Telemetry


def sigma(telemetry: Telemetry, what: str) -> np.ndarray:
    """Root of the sum of variances at each tick."""
    orbit = telemetry.flight.orbit
    covariance, part = {
        "servicer": (orbit.servicer.covariance, slice(0, 3)),
        "relative": (orbit.relative.covariance, slice(0, 3)),
        "velocity": (orbit.relative.covariance, slice(3, 6)),
        "bearing": (orbit.relative.covariance, slice(8, 10)),
        "attitude": (telemetry.flight.attitude.covariance, slice(0, 3)),
    }[what]
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)[:, part].sum(axis=1))


def planned(telemetry: Telemetry) -> np.ndarray:
    """Whether a burn was planned at each decision."""
    plan = telemetry.flight.plan
    return (plan.cutoff > plan.ignition)[::100]


@pytest.mark.parametrize("name", CASES)
def test_all_runs_stay_finite(runs: Runs, name: str) -> None:
    state, telemetry = runs[name]
    assert int(state.failure) == 0
    assert np.all(telemetry.running)
    for leaf in jax.tree.leaves((state.truth, state.sensor_errors, telemetry.truth, telemetry.flight.orbit)):
        assert np.all(np.isfinite(leaf))


@pytest.mark.parametrize("name", equipment_faults.KINDS)
def test_a_fault_has_no_effect_before_it_begins(runs: Runs, name: str) -> None:
    healthy, struck = runs["none"][1].truth, runs[name][1].truth
    # One program computes all cases, so that equal inputs give equal results.
    np.testing.assert_array_equal(struck.q_BN[:BEGIN], healthy.q_BN[:BEGIN])
    if name in ("radio_off", "thruster_stuck_open", "thruster_leak"):
        # Nobody listens, and these valves are those of small thrusters: a servicer alone flies on as if nothing had
        # happened.
        np.testing.assert_array_equal(struck.q_BN, healthy.q_BN)
    elif name != "none":
        assert np.max(np.abs(struck.q_BN - healthy.q_BN)) > 1e-9


def test_a_healthy_run_burns_and_tracks_its_target(runs: Runs) -> None:
    _, telemetry = runs["none"]
    assert planned(telemetry)[1:].sum() >= 2
    looking = (telemetry.mode == Mode.LOOK) & (np.arange(TICKS) > 20)
    assert telemetry.innovation.sensors["box"].accepted[looking].mean() > 0.7


@pytest.mark.parametrize(
    ("name", "what", "growth"),
    [
        ("gps_outage", "servicer", 1.5),
        ("star_tracker_blind", "attitude", 2.0),
        ("star_tracker_blind", "bearing", 1.03),
        ("camera_blackout", "relative", 1.3),
    ],
)
def test_an_outage_increases_the_covariance_until_it_ends(runs: Runs, name: str, what: str, growth: float) -> None:
    healthy, blind = (sigma(runs[kind][1], what) for kind in ("none", name))
    assert blind[END - 1] > growth * blind[BEGIN - 1]
    assert blind[END - 1] > growth * healthy[END - 1]
    if what != "bearing":
        assert blind[-1] < 0.7 * blind[END - 1]


def test_a_blackout_gives_no_boxes_and_no_burns(runs: Runs) -> None:
    _, telemetry = runs["camera_blackout"]
    assert not np.any(telemetry.frame.box.present[BEGIN:END])
    assert not np.any(telemetry.innovation.sensors["box"].accepted[BEGIN:END])
    assert not np.any(planned(telemetry)[2:])  # at 100 s the estimate is still accurate
    assert telemetry.innovation.sensors["box"].accepted[END:].any()


def test_a_blackout_is_no_darkness(runs: Runs) -> None:
    _, telemetry = runs["camera_blackout"]
    assert np.all(telemetry.frame.observable)


def test_a_dead_thruster_is_detected_and_not_used(runs: Runs) -> None:
    _, telemetry = runs["thruster_off"]
    gained = telemetry.truth.delta_v
    assert gained[END - 1] == gained[BEGIN]
    assert BEGIN < telemetry.flight.thruster_failed_at[END - 1] < BEGIN + 80.0  # the last second of the one burn
    assert planned(telemetry).tolist()[2:] == [False, False]
    # The filter takes the missing thrust into account.
    error = np.linalg.norm(telemetry.flight.orbit.relative.v_TS_N + telemetry.truth.v_ST_N, axis=1)
    assert error[BEGIN + 60] < 3.0 * sigma(telemetry, "velocity")[BEGIN + 60]


def test_the_thrust_ratio_of_a_weak_thruster_is_estimated(runs: Runs) -> None:
    healthy, weak = runs["none"][1], runs["thruster_weak"][1]
    after = BEGIN + 60
    first = [telemetry.truth.delta_v[after] - telemetry.truth.delta_v[BEGIN] for telemetry in (weak, healthy)]
    np.testing.assert_allclose(first[0] / first[1], 0.5, rtol=0.02)
    np.testing.assert_allclose(weak.flight.thrust_estimate.ratio[after], 0.5, atol=0.06)  # three sigma
    error = np.linalg.norm(weak.flight.orbit.relative.v_TS_N + weak.truth.v_ST_N, axis=1)
    assert error[after] < 3.0 * sigma(weak, "velocity")[after]


def test_a_stuck_wheel_stops_and_the_others_continue(runs: Runs) -> None:
    speed = runs["wheel_stuck"][1].truth.wheel_speed
    assert np.max(np.abs(speed[BEGIN + 30 : END, 0])) < 0.1  # fifteen time constants
    assert np.max(np.abs(speed[BEGIN + 30 : END, 1:])) > 1.0


def test_a_burn_is_aborted_if_the_attitude_error_is_too_large(runs: Runs) -> None:
    _, telemetry = runs["wheel_stuck"]
    assert planned(telemetry)[1]
    assert telemetry.truth.delta_v[BEGIN + 90] == 0.0
    assert Mode.TURN_BACK in telemetry.mode[BEGIN : BEGIN + 90]


def test_the_controller_compensates_wheel_friction(runs: Runs) -> None:
    _, telemetry = runs["wheel_friction"]
    looking = telemetry.mode == Mode.LOOK
    assert telemetry.innovation.sensors["box"].accepted[looking & (np.arange(TICKS) > BEGIN)].mean() > 0.5


def dark(telemetry: Telemetry) -> np.ndarray:
    return ~telemetry.frame.observable


def test_the_eclipse_runs_have_one_sunset_or_sunrise(runs: Runs) -> None:
    for name, first in ((SUNSET, False), (SUNRISE, True)):
        flags = dark(runs[name][1])
        assert flags[0] == first
        assert flags[-1] != first
        assert np.count_nonzero(np.diff(flags)) == 1
        assert 50 < np.flatnonzero(np.diff(flags))[0] < 250


@pytest.mark.parametrize("name", [SUNSET, SUNRISE])
def test_in_eclipse_there_are_no_boxes_no_search_and_no_burn_plans(runs: Runs, name: str) -> None:
    _, telemetry = runs[name]
    flags = dark(telemetry)
    assert not np.any(telemetry.frame.box.present[flags])
    assert not np.any(telemetry.innovation.sensors["box"].accepted[flags])
    assert not np.any(planned(telemetry)[flags[::100]])
    # Sunset and sunrise as predicted on board differ by a second or two.
    deep = flags & np.roll(flags, 3) & np.roll(flags, -3)
    assert np.all(telemetry.mode[deep] != Mode.SEARCH)
    assert np.all(telemetry.flight.pointing.acquisition.unseen_time[deep] == 0.0)
    assert np.all(telemetry.flight.pointing.acquisition.recent_detections[deep] == 0.0)


def test_after_sunset_the_estimate_is_propagated_with_growing_covariance(runs: Runs) -> None:
    _, telemetry = runs[SUNSET]
    flags = dark(telemetry)
    last = np.flatnonzero(~flags)[-1]
    looking = (telemetry.mode == Mode.LOOK) & ~flags & (np.arange(TICKS) > 20)
    assert telemetry.innovation.sensors["box"].accepted[looking].mean() > 0.5
    assert telemetry.flight.pointing.acquisition.acquired[last - 5]
    uncertain = sigma(telemetry, "relative")
    assert uncertain[-1] > 1.2 * uncertain[last]
    gained = telemetry.truth.delta_v
    assert gained[-1] == gained[last + 60]  # a burn planned before sunset may still be executed


def test_after_sunrise_the_target_is_acquired_and_burns_begin(runs: Runs) -> None:
    state, telemetry = runs[SUNRISE]
    sunrise = np.flatnonzero(~dark(telemetry))[0]
    assert state.truth.delta_v > 0.0
    assert np.all(telemetry.truth.delta_v[:sunrise] == 0.0)
    accepted = np.flatnonzero(telemetry.innovation.sensors["box"].accepted)
    assert sunrise <= accepted[0] < sunrise + 60
    acquired = telemetry.flight.pointing.acquisition.acquired
    assert not acquired[sunrise - 1]
    assert acquired[-1]
