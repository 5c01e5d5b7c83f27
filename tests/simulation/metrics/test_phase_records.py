"""What is stored of the phases of runs, against the records of three short runs by hand."""

import numpy as np
import pytest
from synthetic_channel_records import Records, perfect_run

from rpojax.errors import RpojaxError
from rpojax.flight.mission.mission_state import AbortReason, Condition, Transition
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.phases.phase_sections import CorridorSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics import phase_records, recorded_metrics
from rpojax.simulation.metrics.phase_records import MAX_TRANSITIONS, PhaseTransition

TICKS, PLAIN, HELD, FROZEN = 100, 0, 1, 2
NAMES = ("drift", "stay", "hold", "aborted")


@pytest.fixture(scope="module")
def file() -> ScenarioFile:
    """Two phases, with two ticks in a second."""
    tables = scenario_loader.load("inspection", [f"duration_s={TICKS // 2}", "requirements=[]"]).model_dump()
    reference = {"kind": "hold", "position_m": [0.0, -50.0, 0.0]}
    phases = [
        {"name": "drift", "reference": reference, "until": {"time_s": 10.0}},
        {"name": "stay", "reference": reference},
    ]
    found = scenario_loader.validate(tables | {"phases": phases})
    return found.model_copy(update={"rates": found.rates.model_copy(update={"camera_hz": 2.0})})


@pytest.fixture
def records() -> Records:
    """A run that drifts and stays, one that holds in between and aborts, one that is frozen as it stays."""
    found = perfect_run(TICKS, 3)
    phase, by = np.zeros((2, 3, TICKS), np.int8)
    for run, changes in {
        PLAIN: [(40, 1, Transition.CONDITIONS_MET)],
        HELD: [(20, 2, Transition.HOLD_COMMAND), (30, 0, Transition.RESUME_COMMAND), (60, 3, Transition.ABORT)],
        FROZEN: [(50, 1, Transition.TIMEOUT)],
    }.items():
        for tick, number, cause in changes:
            phase[run, tick:], by[run, tick:] = number, cause
    found["range_m"] += np.arange(TICKS, dtype=np.float32)
    found["rho_desired_H"] = found["rho_H"] + np.float32([0.0, 2.0, 0.0])
    found["delta_v_m_s"][:, 40:] = 0.25
    reason = np.where(phase == 3, AbortReason.TARGET_LOST, AbortReason.NONE).astype(np.int8)
    running = np.ones((3, TICKS), bool)
    running[FROZEN, 80:] = False
    unmet = np.where(phase == 0, np.int8(Condition.TIME | Condition.ARRIVAL), np.int8(0))
    flags = {"unmet_conditions": unmet, "running": running}
    return {**found, "phase": phase, "phase_entered_by": by, "abort_reason": reason, **flags}


def test_the_arrival_is_judged_by_the_truth_as_the_last_phase_begins(file: ScenarioFile, records: Records) -> None:
    records["rho_H"][:] = [7.0, -7.0, 7.0]
    records["rho_desired_H"] = np.broadcast_to(np.float32([0.0, -12.0, 0.0]), records["rho_H"].shape)
    records["rho_H"][PLAIN, 40] = [3.0, -12.0, 4.0]
    records["rho_H"][FROZEN, 50] = [0.0, -10.0, 0.0]
    records["range_m"][:] = np.linspace(50.0, 30.0, TICKS, dtype=np.float32)
    records["range_m"][PLAIN, 90:92] = [19.5, 19.0]
    found = recorded_metrics.evaluate(file, records, {})
    # The second run never comes to the last phase, and none but the first within 20 m.
    np.testing.assert_allclose(found["final_lateral_error_m"], [5.0, np.nan, 0.0], rtol=1e-6, atol=1e-8)
    # Too near by 2 m is the worst of the three, not the best.
    np.testing.assert_allclose(found["final_range_error_m"], [1.0, np.nan, 2.0], rtol=1e-6)
    fall = 2.0 * (records["range_m"][PLAIN, 89] - 19.5)
    np.testing.assert_allclose(found["closing_speed_max_m_s"], [fall, np.nan, np.nan], rtol=1e-6)


def test_the_lateral_error_is_from_the_axis_of_the_corridor(file: ScenarioFile, records: Records) -> None:
    corridor = CorridorSection(axis=[0.0, -2.0, 0.0], half_angle_deg=10.0, width_m=1.0)
    phases = [file.phases[0], file.phases[1].model_copy(update={"corridor": corridor})]
    records["rho_H"][PLAIN, 40] = [3.0, -12.0, 4.0]
    inside = file.model_copy(update={"phases": phases})
    assert recorded_metrics.evaluate(inside, records, {})["final_lateral_error_m"][PLAIN] == pytest.approx(5.0)
    turned = {"phases.stay.corridor.axis": np.tile([0.0, 0.0, 3.0], (3, 1))}
    found = recorded_metrics.evaluate(inside, records, turned)["final_lateral_error_m"][PLAIN]
    assert found == pytest.approx(np.hypot(3.0, 12.0))


def test_requirements_on_the_arrival_need_phases() -> None:
    tables = scenario_loader.load("inspection").model_dump()
    one = {"metric": "final_range_error_m", "bound": "at most", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
    with pytest.raises(RpojaxError, match=r"requirements\.0\.metric: found 'final_range_error_m', expected .*phases"):
        scenario_loader.validate(tables | {"requirements": [one]})


def test_requirements_on_plumes_need_them() -> None:
    tables = scenario_loader.load("final_approach", ["effects.plume=false"]).model_dump()
    one = {"metric": "plume_impulse_n_s", "bound": "at most", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
    with pytest.raises(
        RpojaxError, match=r"requirements\.0\.metric: found 'plume_impulse_n_s', expected .*plume = true"
    ):
        scenario_loader.validate(tables | {"requirements": [one]})
    with pytest.raises(RpojaxError, match=r"effects\.plume: found True, expected false, or \[\[thrusters\]\]"):
        scenario_loader.load("inspection", ["effects.plume=true"])


@pytest.mark.parametrize(
    "change", ["chamber_pressure.enabled=false", "isolation.enabled=false", "effects.faults=false"]
)
def test_requirements_on_isolation_need_faults_valves_and_sensors(change: str) -> None:
    one = {"metric": "isolation_delay_s", "bound": "at most", "limit": 2.0, "probability": 0.9, "consumer_risk": 0.1}
    tables = scenario_loader.load("thruster_failure").model_dump()
    scenario_loader.validate(tables | {"requirements": [one]})
    without = scenario_loader.load("thruster_failure", [change]).model_dump()
    with pytest.raises(
        RpojaxError, match=r"requirements\.0\.metric: found 'isolation_delay_s', expected .*isolation\.enabled"
    ):
        scenario_loader.validate(without | {"requirements": [one]})


def test_figures_of_a_phase_are_those_of_its_ticks(file: ScenarioFile, records: Records) -> None:
    found = phase_records.evaluate(file, records, {})
    nan = np.nan
    expected = {
        "duration_s": [[20.0, 30.0, 0.0, 0.0], [25.0, 0.0, 5.0, 20.0], [25.0, 15.0, 0.0, 0.0]],
        # The burn before tick 40 is of the phase at tick 39.
        "delta_v_m_s": [[0.25, 0.0, nan, nan], [0.25, nan, 0.0, 0.0], [0.25, 0.0, nan, nan]],
        "formation_error_rms_m": [[2.0, 2.0, nan, nan], [2.0, nan, 2.0, nan], [2.0, 2.0, nan, nan]],
        "nees_relative_mean": [[6.0, 6.0, nan, nan], [6.0, nan, 6.0, 6.0], [6.0, 6.0, nan, nan]],
        "min_range_m": [[30.0, 70.0, nan, nan], [30.0, nan, 50.0, 90.0], [30.0, 80.0, nan, nan]],
        "max_range_m": [[69.0, 129.0, nan, nan], [89.0, nan, 59.0, 129.0], [79.0, 109.0, nan, nan]],
    }
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    np.testing.assert_array_equal(found["abort_reason"], [0, AbortReason.TARGET_LOST, 0])
    # The last phase has no conditions: its begin is the goal.
    np.testing.assert_array_equal(found["goal_reached_at_s"], [20.0, nan, 25.0])
    np.testing.assert_array_equal(found["unmet_conditions"], [0, Condition.TIME | Condition.ARRIVAL, 0])
    assert set(found) == set(phase_records.UNITS) - {"arrival_place_P_m"}


def test_transitions_tell_phase_time_and_cause(file: ScenarioFile, records: Records) -> None:
    found = phase_records.evaluate(file, records, {})
    np.testing.assert_array_equal(found["transition_count"], [2, 4, 2])
    none = AbortReason.NONE
    assert phase_records.listed_transitions(np.array([7, 8, 9]), file.phase_names, found) == [
        PhaseTransition(7, 0.0, "drift", Transition.START, none),
        PhaseTransition(7, 20.0, "stay", Transition.CONDITIONS_MET, none),
        PhaseTransition(8, 0.0, "drift", Transition.START, none),
        PhaseTransition(8, 10.0, "hold", Transition.HOLD_COMMAND, none),
        PhaseTransition(8, 15.0, "drift", Transition.RESUME_COMMAND, none),
        PhaseTransition(8, 30.0, "aborted", Transition.ABORT, AbortReason.TARGET_LOST),
        PhaseTransition(9, 0.0, "drift", Transition.START, none),
        PhaseTransition(9, 25.0, "stay", Transition.TIMEOUT, none),
    ]


@pytest.mark.parametrize("axis", [(0.0, -2.0, 0.0), (-1.0, 0.0, 0.0)])
def test_of_a_corridor_that_was_left_the_place_of_the_estimate_is_kept(
    file: ScenarioFile, records: Records, axis: tuple[float, float, float]
) -> None:
    """Of the run that leaves the second phase by it; the corridor of the first is another one."""
    corridor = CorridorSection(axis=[0.0, -2.0, 0.0], half_angle_deg=1.0, width_m=0.5)
    stay = file.phases[1].model_copy(update={"corridor": corridor})
    drift = file.phases[0].model_copy(update={"corridor": corridor.model_copy(update={"axis": [0.0, 0.0, 1.0]})})
    file = file.model_copy(update={"phases": (drift, stay)})
    records["phase"][HELD, 30:60] = 1
    records["abort_reason"] = np.where(records["phase"] == 3, AbortReason.CORRIDOR_LEFT, 0).astype(np.int8)
    records["rho_H"][HELD, 60], records["relative_error_H"][HELD, 60] = (0.5, -40.0, 1.0), (-0.1, 1.0, 0.2)
    found = phase_records.evaluate(file, records, {"phases.stay.corridor.axis": np.tile(axis, (3, 1))})
    nan = np.nan  # The estimate is (0.6, -41.0, 0.8).
    ahead, aside = (41.0, 1.0) if axis[1] else (-0.6, np.hypot(41.0, 0.8))
    np.testing.assert_allclose(found["corridor_ahead_m"], [nan, ahead, nan], rtol=1e-6)
    np.testing.assert_allclose(found["corridor_aside_m"], [nan, aside, nan], rtol=1e-6)


def in_target_frame(file: ScenarioFile) -> ScenarioFile:
    """The last phase in the frame of the target, with a corridor along its z axis."""
    corridor = CorridorSection(axis=[0.0, 0.0, 2.0], half_angle_deg=5.0, width_m=0.3)
    stay = file.phases[1].model_copy(update={"corridor": corridor, "frame": "target"})
    return file.model_copy(update={"phases": (file.phases[0], stay)})


def test_a_corridor_in_the_target_frame_is_left_there(file: ScenarioFile, records: Records) -> None:
    records["phase"][HELD, 30:60] = 1
    records["abort_reason"] = np.where(records["phase"] == 3, AbortReason.CORRIDOR_LEFT, 0).astype(np.int8)
    place_T = np.zeros((*records["phase"].shape, 3), np.float32)
    place_T[HELD, 60] = [0.3, -0.4, 2.5]
    more = {"rho_estimate_T": place_T, "port_place_P": place_T}
    found = phase_records.evaluate(in_target_frame(file), records | more, {})
    np.testing.assert_allclose(
        [found["corridor_ahead_m"][HELD], found["corridor_aside_m"][HELD]], [2.5, 0.5], rtol=1e-6
    )


def test_the_place_before_the_port_is_that_as_the_last_phase_begins(file: ScenarioFile, records: Records) -> None:
    place_P = np.random.default_rng(5).normal(size=(*records["phase"].shape, 3)).astype(np.float32)
    records["phase"][FROZEN, 30:50] = 3
    found = phase_records.evaluate(in_target_frame(file), records | {"port_place_P": place_P}, {})["arrival_place_P_m"]
    np.testing.assert_array_equal(found[PLAIN], place_P[PLAIN, 40])
    assert np.isnan(found[HELD]).all(), "it never came there"
    np.testing.assert_array_equal(found[FROZEN], place_P[FROZEN, 50])


def test_a_capture_is_judged_as_the_last_phase_begins(file: ScenarioFile, records: Records) -> None:
    shape = records["phase"].shape
    records |= {"port_place_P": np.full((*shape, 3), 9.0), "port_velocity_P": np.full((*shape, 3), 9.0)}
    records |= {"port_angle_deg": np.full(shape, 90.0), "hull_distance_m": np.full(shape, 5.0)}
    records["port_place_P"][PLAIN, 40], records["port_velocity_P"][PLAIN, 40] = [0.03, -0.04, 1.2], [0.0, 0.003, 0.004]
    records["port_angle_deg"][PLAIN, 40], records["hull_distance_m"][PLAIN, 20] = 1.5, 0.2
    found = recorded_metrics.evaluate(in_target_frame(file), records, {})
    expected = {
        "capture_lateral_m": 0.05,
        "capture_speed_m_s": 0.005,
        "capture_angle_deg": 1.5,
        "hull_distance_min_m": 0.2,
    }
    np.testing.assert_allclose([found[name][PLAIN] for name in expected], list(expected.values()), rtol=1e-6)
    assert np.isnan(found["capture_lateral_m"][HELD]), "it never came there"


def test_the_axis_of_an_approach_in_the_target_frame_is_that_of_its_reference(
    file: ScenarioFile, records: Records
) -> None:
    records["rho_desired_H"] = np.broadcast_to(np.float32([0.0, -12.0, 0.0]), records["rho_H"].shape)
    records["rho_H"][PLAIN, 40] = [3.0, -12.0, 4.0]
    turning = in_target_frame(file)
    records |= {"port_place_P": np.ones((*records["phase"].shape, 3), np.float32)}
    records |= {name: np.ones(records["phase"].shape) for name in ("port_angle_deg", "hull_distance_m")}
    records |= {"port_velocity_P": records["port_place_P"]}
    found = recorded_metrics.evaluate(turning, records, {})
    # By the corridor's axis as if it were in H it would be 12.4 m.
    assert found["final_lateral_error_m"][PLAIN] == pytest.approx(5.0)


def test_of_many_transitions_the_first_are_kept_and_all_counted(file: ScenarioFile, records: Records) -> None:
    records["phase"][PLAIN] = np.arange(TICKS) % 2
    found = phase_records.evaluate(file, records, {})
    assert found["transition_count"][PLAIN] == TICKS
    np.testing.assert_array_equal(found["transition_phase"][PLAIN], np.arange(MAX_TRANSITIONS) % 2)


def test_without_phases_nothing_is_stored(records: Records) -> None:
    assert phase_records.evaluate(scenario_loader.load("inspection"), records, {}) == {}
    assert phase_records.listed_transitions(np.arange(3), (), {}) == []


def test_reasons_and_causes_have_words() -> None:
    assert AbortReason.KEEP_OUT_PREDICTED.text == "keep-out zone ahead"
    assert (AbortReason.TARGET_LOST.text, AbortReason.NONE.text) == ("target lost", "")
    assert Transition.CONDITIONS_MET.text == "conditions met"
