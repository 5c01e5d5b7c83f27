"""Missions of several phases fly as declared: transitions, pointing, commands, values of single runs, one trace."""

import shutil
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from named_loops import name_loop

from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.campaign import single_run
from rpojax.campaign.execution import run_programs
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.rerun import rerun
from rpojax.campaign.run_and_resume import resume_campaign, run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightMemory
from rpojax.flight.mission.abort_burn import AbortBurnReason
from rpojax.flight.mission.mission_state import AbortReason, Condition
from rpojax.flight.stages import Stages
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import step_stages
from rpojax.simulation.noise import run_keys
from rpojax.simulation.state import State
from rpojax.simulation.step import step
from rpojax.simulation.tick import Loop

PHASES: list[dict[str, Any]] = [
    {
        "name": "wait",
        "reference": {"kind": "hold", "position_m": [0.0, 50.0, 0.0]},
        "until": {"time_s": 50.0, "range_sigma_m": 60.0},
    },
    {
        "name": "ahead",
        "reference": {"kind": "hold", "position_m": [0.0, 50.0, 0.0]},
        "pointing": "velocity",
        "timeout_s": 80.0,
        "on_timeout": "next",
    },
    {
        "name": "safe",
        "reference": {"kind": "hold", "position_m": [0.0, 50.0, 0.0]},
        "pointing": "sun_safe",
        "until": {"time_s": 80.0},
    },
    {
        "name": "ellipse",
        "reference": {"kind": "relative_orbit", "radial_m": 20.0, "cross_track_m": 25.0, "along_track_m": 60.0},
        "passively_safe": True,
        "delta_v_weight": [4e4, 4e4, 4e4],
    },
]
WAIT, AHEAD, SAFE, ELLIPSE, HELD, ABORTED = range(6)
DURATION = 400
OWN_VALUES: dict[str, list[float]] = {
    "phases.wait.until.time_s": [50.0, 95.0, 50.0, 50.0],
    "phases.ahead.timeout_s": [80.0, 80.0, 80.0, 35.0],
    "phases.ellipse.reference.radial_m": [20.0, 20.0, 20.0, 35.0],
    "phases.ellipse.delta_v_weight[0]": [4e4, 4e4, 4e4, 1e3],
    "mission.abort_at_s": [1e9, 1e9, 91.0, 1e9],
    "mission.hold_at_s": [1e9, 310.0, 1e9, 1e9],
    "mission.resume_at_s": [1e9, 345.0, 1e9, 1e9],
}
"""Values of four runs: as the scenario has them; held for a while; aborted; with other numbers of its phases."""
NOMINAL, HELD_RUN, ABORTED_RUN, OTHER_RUN = range(4)


def mission(**changes: Any) -> ScenarioFile:
    """Four phases in 400 s, with burns every 40 s and decisions every 20 s."""
    tables = scenario_loader.load("inspection", ["requirements=[]"]).model_dump()
    tables["rates"]["formation_period_s"] = 40.0
    tables["formation"]["lead_s"] = 20.0
    tables["pointing"]["look_away_limit_s"] = 40.0
    tables["initial"]["relative_position_m"] = [0.0, 50.0, 0.0]
    return scenario_loader.validate(tables | {"duration_s": float(DURATION), "phases": PHASES} | changes)


@pytest.fixture(scope="module")
def traces() -> list[int]:
    """One entry for each trace of the step while the campaign is made."""
    return []


@pytest.fixture(scope="module")
def campaign(programs: None, traces: list[int], tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Four runs with their own values in four blocks."""
    simulate_tick = step

    def counted(*arguments: Any) -> Any:
        traces.append(len(arguments))
        return simulate_tick(*arguments)

    columns = {key: list(values) for key, values in OWN_VALUES.items()}
    file = name_loop("phases", mission(design={"kind": "table", "file": "", "values": columns}))
    out = tmp_path_factory.mktemp("phases") / "runs"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_programs, "step", counted)
        return run_campaign(file, 4, out, seed=3, block_size=1, histories=range(4), devices=jax.devices()[:1])


def changes_of(values: np.ndarray) -> list[tuple[int, int]]:
    """Second of each change of a channel, and the value from then on."""
    at = np.flatnonzero(np.diff(values)) + 1
    return [(int(second), int(values[second])) for second in at]


def test_phases_change_as_declared(campaign: Campaign) -> None:
    phase = campaign.history(NOMINAL)["phase"]
    assert phase[0] == WAIT
    assert changes_of(phase) == [(60, AHEAD), (140, SAFE), (220, ELLIPSE)]
    assert not campaign.history(NOMINAL)["abort_reason"].any()
    np.testing.assert_array_equal(campaign.phases["goal_reached_at_s"], [220.0, 260.0, np.nan, 180.0])


def test_unmet_conditions_are_those_for_which_a_phase_goes_on(campaign: Campaign) -> None:
    history = campaign.history(NOMINAL)
    unmet, phase = history["unmet_conditions"], history["phase"]
    np.testing.assert_array_equal(unmet[1:50] & Condition.TIME, Condition.TIME)
    assert not (unmet[50:60] & Condition.TIME).any()
    np.testing.assert_array_equal(unmet[phase == SAFE], [Condition.TIME] * 80)
    assert not unmet[phase == AHEAD].any()
    assert not campaign.history(ABORTED_RUN)["unmet_conditions"][100:].any()


def test_runs_follow_their_own_values_and_commands(campaign: Campaign) -> None:
    assert changes_of(campaign.history(OTHER_RUN)["phase"]) == [(60, AHEAD), (100, SAFE), (180, ELLIPSE)]
    held = [(100, AHEAD), (180, SAFE), (260, ELLIPSE), (320, HELD), (360, ELLIPSE)]
    assert changes_of(campaign.history(HELD_RUN)["phase"]) == held


def test_an_abort_between_two_decisions_begins_with_the_next_one(campaign: Campaign) -> None:
    history = campaign.history(ABORTED_RUN)
    assert changes_of(history["phase"]) == [(60, AHEAD), (100, ABORTED)]
    assert changes_of(history["abort_reason"]) == [(100, AbortReason.COMMAND)]
    assert history["abort_burns"].max() <= 1
    assert campaign.outcomes.tolist() == ["completed", "completed", "aborted", "completed"]


def test_the_desired_position_is_that_of_the_phase(campaign: Campaign) -> None:
    nominal, other = (campaign.history(run) for run in (NOMINAL, OTHER_RUN))
    np.testing.assert_array_equal(nominal["rho_desired_H"][:220], np.broadcast_to([0.0, 50.0, 0.0], (220, 3)))
    for radial, history in ((20.0, nominal), (35.0, other)):
        place = history["rho_desired_H"][260:].astype(float)
        # On the ellipse (x / radial)^2 + ((y - offset) / (2 radial))^2 = 1, to the eccentricity of the target's orbit.
        size = np.hypot(place[:, 0], 0.5 * (place[:, 1] - 60.0))
        np.testing.assert_allclose(size, radial, rtol=5e-3)


def angle_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between vectors [deg]."""
    cosine = np.sum(a * b, axis=-1) / (np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1))
    return np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))


def test_other_attitudes_are_reached_and_left(campaign: Campaign) -> None:
    history = campaign.history(NOMINAL)
    off, line_H, line_N = history["pointing_error_deg"], -history["rho_H"], -history["r_ST_N"]
    at_target = [*range(30, 60), *range(295, 300)]
    assert np.all(off[at_target] < 3.0)
    velocity_H, from_sun_N = np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 0.0])
    np.testing.assert_allclose(off[130:140], angle_deg(line_H, velocity_H)[130:140], atol=1.0)
    np.testing.assert_allclose(off[210:220], angle_deg(line_N, from_sun_N)[210:220], atol=1.0)
    assert np.all(off[130:140] > 170.0)
    assert np.all(off[210:220] > 30.0)
    assert history["box_accepted"][300:].any()


def test_the_campaign_traced_the_step_once_whatever_the_values(campaign: Campaign, traces: list[int]) -> None:
    assert campaign.missing_blocks() == []
    assert len(traces) == 1


def test_rerun_and_resume_give_the_same_bits(campaign: Campaign, tmp_path: Path) -> None:
    again = rerun(campaign, HELD_RUN, tmp_path / "again").campaign.history(HELD_RUN)
    for name, values in campaign.history(HELD_RUN).items():
        np.testing.assert_array_equal(again[name], values, err_msg=name)
    begun = tmp_path / "begun"
    shutil.copytree(campaign.directory, begun)
    (begun / "manifest" / "000002.json").unlink()
    resumed = resume_campaign(begun)
    for name, values in campaign.metrics.items():
        np.testing.assert_array_equal(resumed.metrics[name], values, err_msg=name)
    np.testing.assert_array_equal(resumed.outcomes, campaign.outcomes)


@pytest.mark.traces
def test_missions_with_the_statistical_camera_in_single_precision_have_channels_of_the_mission() -> None:
    tables = mission().model_dump()
    tables["camera"]["model"] = "statistical"
    engine = BatchEngine(scenario_loader.validate(tables | {"precision": "single"}), 1, jax.devices()[:1])
    _, channels = engine._loop_traces.outputs
    found = {name: channels[name].dtype for name in ("phase", "abort_reason", "rho_desired_H")}
    assert found == {"phase": np.int8, "abort_reason": np.int8, "rho_desired_H": np.float32}


def test_a_scenario_without_phases_has_no_channels_of_a_mission() -> None:
    engine = BatchEngine(scenario_loader.load("inspection", ["duration_s=200"]), 1, jax.devices()[:1])
    _, channels = engine._loop_traces.outputs
    assert not {"phase", "abort_reason", "rho_desired_H"} & set(channels)


@partial(jax.jit, static_argnums=(0, 1))
def decided(scenario: Scenario, stages: Stages, params: Params, state: State) -> FlightMemory:
    """Memory of the flight software after the decision on the phase."""
    loop = Loop(scenario, params, stages)
    return step_stages.manage_mission(loop, step_stages.sense(loop, state)).flight


@partial(jax.jit, static_argnums=(0, 1))
def planned(scenario: Scenario, stages: Stages, params: Params, state: State) -> FlightMemory:
    """Memory of the flight software after the decision on the burn."""
    loop = Loop(scenario, params, stages)
    tick = step_stages.manage_mission(loop, step_stages.sense(loop, state))
    return step_stages.plan_burn(loop, tick).flight


def planned_delta_v(file: ScenarioFile, stages: Stages | None = None, **numbers: jax.Array) -> jax.Array:
    """Velocity change of the burn that is planned at 200 s, with the state of the start and a target in sight.

    `numbers` are those of the reference of the phase `only`.
    """
    scenario, params, state = single_run.initialise_run(file)
    pointing = rendezvous_scene.with_acquisition(
        state.flight.pointing, acquired=jnp.asarray(True), recent_detections=jnp.asarray(5.0)
    )
    state = replace(state, flight=replace(state.flight, pointing=pointing), tick=state.tick + 200)
    changed = dispersed_values.apply_to_params(params, {f"phases.only.reference.{k}": v for k, v in numbers.items()})
    return planned(scenario, stages or Stages(), changed, state).plan.delta_v_N


def test_a_held_station_needs_the_burns_of_a_mission_without_phases() -> None:
    station = {"name": "station", "reference": {"kind": "hold", "position_m": [0.0, -30.0, 0.0]}}
    # Without a zone: that of a station is not that of a mission.
    tables = scenario_loader.load("inspection", ["health.clearance=0", "limits.keep_out_m=0"]).model_dump()
    mission = tables["mission"] | {"abort_margin_m": 0.0}
    found = planned_delta_v(scenario_loader.validate(tables | {"phases": [station], "mission": mission}))
    expected = planned_delta_v(scenario_loader.validate(tables))
    assert jnp.linalg.norm(expected) > 1e-3
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-3 * float(jnp.linalg.norm(expected)))


def test_a_burn_is_judged_as_the_look_away_limit_shortens_it() -> None:
    station = {"name": "station", "reference": {"kind": "hold", "position_m": [0.0, -50.0, 0.0]}}
    file = scenario_loader.validate(scenario_loader.load("inspection").model_dump() | {"phases": [station]})
    # Half a metre per second towards the target passes it within two control periods; what the limit leaves does not.
    towards = Stages(formation_law=lambda gain, deviation: jnp.array([0.0, 0.5, 0.0]) + 0.0 * (gain @ deviation))
    assert 0.02 < float(jnp.linalg.norm(planned_delta_v(file, towards))) < 0.1


@pytest.mark.parametrize(
    ("passively_safe", "reason"), [(False, AbortReason.KEEP_OUT_PREDICTED), (True, AbortReason.NONE)]
)
def test_an_uncertain_estimate_is_a_threat_but_not_on_a_passively_safe_orbit(
    passively_safe: bool, reason: AbortReason
) -> None:
    station = {"name": "station", "reference": {"kind": "hold", "position_m": [0.0, -30.0, 0.0]}}
    station["passively_safe"] = passively_safe
    file = scenario_loader.validate(scenario_loader.load("inspection").model_dump() | {"phases": [station]})
    scenario, params, state = single_run.initialise_run(file)
    relative = state.flight.orbit.relative
    uncertain = replace(relative, covariance=100.0 * relative.covariance)
    flight = replace(state.flight, orbit=replace(state.flight.orbit, relative=uncertain))
    begun = replace(state, flight=flight, tick=state.tick + 200)
    after = decided(scenario, Stages(), params, begun).mission
    assert after is not None
    assert int(after.abort_reason) == reason


def test_a_blind_servicer_burns_once_after_an_abort_however_uncertain_its_estimate_is() -> None:
    station = {"name": "station", "reference": {"kind": "hold", "position_m": [0.0, -30.0, 0.0]}}
    file = scenario_loader.validate(scenario_loader.load("inspection").model_dump() | {"phases": [station]})
    scenario, params, state = single_run.initialise_run(file)
    mission, relative = state.flight.mission, state.flight.orbit.relative
    assert mission is not None
    uncertain = replace(state.flight.orbit, relative=replace(relative, covariance=100.0 * relative.covariance))

    def burn(is_decided: bool, count: int) -> tuple[jax.Array, jax.Array, jax.Array]:
        """On-time, and number and reason of burns, at a decision after the abort with a target that was never seen."""
        number = jnp.int32(count)
        burns = replace(mission.abort_burns, decided=jnp.asarray(is_decided), count=number, reason=number)
        aborted = replace(mission, phase=jnp.int32(2), abort_burns=burns)
        flight = replace(state.flight, orbit=uncertain, mission=aborted)
        begun = replace(state, flight=flight, tick=state.tick + 200)
        after = planned(scenario, Stages(), params, begun)
        assert after.mission is not None
        return (
            after.plan.cutoff - after.plan.ignition,
            after.mission.abort_burns.count,
            after.mission.abort_burns.reason,
        )

    on_time, *record = burn(False, 0)
    assert float(on_time) > 0.0
    assert [int(each) for each in record] == [1, AbortBurnReason.ABORT]
    on_time, *record = burn(True, 1)
    assert float(on_time) == 0.0
    assert [int(each) for each in record] == [1, AbortBurnReason.ABORT]


def test_a_target_that_should_be_seen_is_lost_after_two_minutes_and_not_after_a_few_frames() -> None:
    station = {"name": "station", "reference": {"kind": "hold", "position_m": [0.0, -30.0, 0.0]}}
    file = scenario_loader.validate(scenario_loader.load("inspection").model_dump() | {"phases": [station]})
    scenario, params, state = single_run.initialise_run(file)
    assert state.flight.mission is not None
    mission = replace(state.flight.mission, has_seen_target=jnp.asarray(True))

    def abort_reason(unseen_s: float) -> int:
        pointing = rendezvous_scene.with_acquisition(
            state.flight.pointing, acquired=jnp.asarray(True), unseen_time=jnp.asarray(unseen_s)
        )
        flight = replace(state.flight, pointing=pointing, mission=mission)
        after = decided(scenario, Stages(), params, replace(state, flight=flight, tick=state.tick + 200)).mission
        assert after is not None
        return int(after.abort_reason)

    limit = file.health.unseen_limit_s
    assert [abort_reason(each) for each in (20.0, limit, limit + 1.0)] == [
        0,
        0,
        AbortReason.TARGET_LOST,
    ]


@pytest.mark.parametrize(
    ("reference", "key", "step"),
    [
        ({"kind": "relative_orbit", "radial_m": 8.0, "along_track_m": -50.0, "join_s": 3000.0}, "radial_m", 1e-3),
        pytest.param(
            *({"kind": "transfer", "position_m": [0.0, -40.0, 0.0], "duration_s": 1500.0}, "duration_s", 0.1),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_derivative_of_a_planned_burn_by_a_number_of_its_phase(
    reference: dict[str, Any], key: str, step: float
) -> None:
    tables = scenario_loader.load("inspection").model_dump()
    file = scenario_loader.validate(tables | {"phases": [{"name": "only", "reference": reference}]})
    planned = jax.jit(lambda value: planned_delta_v(file, **{key: value}))
    value = jnp.asarray(reference[key])
    found = jax.jit(jax.jacfwd(planned))(value)
    central = (planned(value + step) - planned(value - step)) / (2.0 * step)
    assert jnp.linalg.norm(central) > 1e-7
    np.testing.assert_allclose(found, central, rtol=0.0, atol=1e-4 * float(jnp.linalg.norm(central)))


@pytest.mark.slow
def test_derivatives_of_metrics_by_numbers_of_phases_agree_with_central_differences() -> None:
    near = {"kind": "transfer", "position_m": [0.0, -40.0, 0.0], "duration_s": 350.0}
    around = {"kind": "relative_orbit", "radial_m": 8.0, "cross_track_m": 6.0, "along_track_m": -40.0, "join_s": 1500.0}
    phases = [
        {"name": "near", "reference": near, "timeout_s": 380.0, "on_timeout": "next"},
        {"name": "around", "reference": around},
    ]
    calm = ["duration_s=660", "camera.outlier_probability=0.0", "camera.miss_probability=0.0", "requirements=[]"]
    tables = scenario_loader.load("inspection", calm).model_dump()
    file = scenario_loader.validate(tables | {"phases": phases})
    metrics = ["formation_error_rms_m", "delta_v_m_s", "min_range_m"]
    steps = {"phases.near.reference.duration_s": 0.01, "phases.around.reference.radial_m": 1e-3}
    nominal = {"phases.near.reference.duration_s": 350.0, "phases.around.reference.radial_m": 8.0}

    def own_values(shifts: jax.Array, run_key: jax.Array) -> dict[str, jax.Array]:
        values = {key: jnp.asarray(value) + shifts[number] for number, (key, value) in enumerate(nominal.items())}
        return dispersed_values.draw(file, run_key, {}) | values

    # One program for all: the runs of one seed with no shift, and with each number shifted up and down.
    runs = 2
    step_sizes = np.diag(list(steps.values()))
    shifts = np.concatenate([np.zeros((1, 2)), step_sizes, -step_sizes]).repeat(runs, axis=0)
    keys = np.tile(run_keys(3, np.arange(runs)), (len(shifts) // runs, 1))
    found = RolloutEvaluator(file, own_values, len(steps), metrics, runs=len(shifts)).jacobian(shifts, keys)
    assert found.jacobian is not None
    values = found.metrics.reshape(-1, runs, len(metrics))
    np.testing.assert_array_equal(found.events.reshape(-1, runs), np.broadcast_to(found.events[:runs], (5, runs)))
    assert not found.failed.any()
    for number, step_size in enumerate(steps.values()):
        central = (values[1 + number] - values[3 + number]) / (2.0 * step_size)
        assert np.all(central != 0.0)
        np.testing.assert_allclose(found.jacobian[:runs, :, number], central, rtol=1e-3)
