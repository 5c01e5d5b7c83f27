"""Quantities of scenarios, how they are moved, and what the runs of a step break."""

import numpy as np
import pytest

from rpojax.analysis.robustness.assigned_runs import values_of_runs
from rpojax.analysis.robustness.believed_quantities import HANDOVER, find_quantities, with_handover
from rpojax.analysis.robustness.step_runs import COMPLETED, judge_step
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.experiment_design import make_design
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import RequirementSection, ScenarioFile

IDS = np.arange(5)


@pytest.fixture(scope="module")
def mission() -> ScenarioFile:
    """The nominal mission with hand-over errors."""
    return with_handover(scenario_loader.load("inspection"))


def requirement(limit: float, probability: float = 0.9) -> RequirementSection:
    """Requirement on the formation error."""
    return RequirementSection(
        metric="formation_error_rms_m", bound="at most", limit=limit, probability=probability, consumer_risk=0.1
    )


def runs(values: list[float], failed: int = 0) -> dict[str, np.ndarray]:
    """Metrics of runs of which the first ones failed."""
    outcomes = np.array(["lost"] * failed + ["completed"] * (len(values) - failed))
    return {"formation_error_rms_m": np.array(values), "outcomes": outcomes}


def test_quantities_are_those_that_the_scenario_uses_and_the_filter_believes(mission: ScenarioFile) -> None:
    found, left_out = find_quantities(mission)
    sigmas = {each.name: each.believed_sigma for each in found}
    assert sigmas == {
        "thruster.force_scale": 0.02,
        "thruster.misalignment_deg": 0.3,
        "camera.misalignment_deg": 0.1,
        "target.scale": 0.065,
        "camera.edge_noise_px": 1.0,
        "gps.noise_m": 2.0,
        "servicer.mass_kg": pytest.approx(0.6),
        HANDOVER: 1.0,
    }
    assert "effects.drag" in left_out["target_surface.area_m2"]


def test_quantities_depend_on_camera_effects_and_beliefs() -> None:
    believed = ["navigation.burn_scale_sigma=0.0", "navigation.burn_magnitude_sigma=0.0"]
    file = scenario_loader.load("inspection", ["effects.drag=true", "camera.model='statistical'", *believed])
    found, left_out = find_quantities(file)
    sigmas = {each.name: each.believed_sigma for each in found}
    assert sigmas["target_surface.area_m2"] == pytest.approx(0.005 * 45.0)
    assert {"camera.edge_noise_px", "thruster.force_scale", "servicer.mass_kg"} <= {*left_out}
    assert "believes no error" in left_out["servicer.mass_kg"]


def test_numbers_are_shifted_and_stay_where_they_mean_something(mission: ScenarioFile) -> None:
    found = {each.name: each for each in find_quantities(mission)[0]}
    noise = found["camera.edge_noise_px"]
    assert noise.farthest("low") == 1.0
    assert noise.moved({"camera.edge_noise_px": np.ones(5)}, -2.0, IDS)["camera.edge_noise_px"].tolist() == [0.0] * 5
    thrust = found["thruster.force_scale"]
    assert thrust.offset("low", 2.0) == -0.04
    drawn = np.linspace(0.98, 1.02, 5)
    assert thrust.moved({"thruster.force_scale": drawn}, 0.1, IDS)["thruster.force_scale"] == pytest.approx(drawn + 0.1)
    errors = found[HANDOVER]
    moved = errors.moved({key: np.ones(5) for key in errors.keys}, 0.5, IDS)
    assert all((values == 1.5).all() for values in moved.values())


@pytest.mark.parametrize(
    ("name", "axis"), [("thruster.misalignment_deg", [1.0, 0.0, 0.0]), ("camera.misalignment_deg", [0.0, 0.0, 1.0])]
)
def test_turns_are_across_their_axis_in_all_directions(mission: ScenarioFile, name: str, axis: list[float]) -> None:
    turn = next(each for each in find_quantities(mission)[0] if each.name == name)
    ids = np.arange(200)
    moved = turn.moved({name: np.zeros((200, 3))}, 2.0, ids)[name]
    assert np.linalg.norm(moved, axis=1) == pytest.approx(np.full(200, 2.0))
    assert np.abs(moved @ axis).max() < 1e-12
    assert np.abs(moved.mean(axis=0)).max() < 0.02
    assert turn.sides == ("any",)


def test_hand_over_errors_are_those_told_unless_the_scenario_has_others() -> None:
    file = scenario_loader.load("inspection", ["initial.handover.position_sigma_m=7.0"])
    handover = with_handover(file).initial.handover
    assert handover is not None
    assert handover.position_sigma_m == 7.0
    assert handover.velocity_sigma_m_s == file.navigation.initial_velocity_sigma_m_s


@pytest.mark.parametrize("design", ["independent", "sobol"])
def test_values_are_those_that_a_campaign_draws(design: str) -> None:
    file = scenario_loader.load("inspection", [f"design.kind='{design}'"])
    found = values_of_runs(file, ["gps.noise_m"], 3, IDS)
    drawn = BatchEngine(file, len(IDS), design=make_design(file, 3, RunRange(0, len(IDS)))).draw_values(3, IDS)
    assert {*found} == {*drawn, "gps.noise_m"}
    for key, values in drawn.items():
        np.testing.assert_allclose(found[key], values, rtol=1e-12, atol=1e-15)
    assert found["gps.noise_m"].tolist() == [2.0] * 5


def test_a_step_breaks_by_the_share_of_runs() -> None:
    nine = [1.0] * 9
    assert judge_step([requirement(2.0)], runs([*nine, 3.0])).broken == ()
    assert judge_step([requirement(2.0)], runs([*nine[1:], 3.0, np.nan])).broken == ("formation_error_rms_m",)
    found = judge_step([requirement(2.0)], runs([*nine, 1.0], failed=2))
    assert found.broken == (COMPLETED,)
    assert found.record["outcomes"] == {"completed": 8, "lost": 2}
    assert judge_step([requirement(2.0)], runs([*nine, 1.0], failed=2), ["formation_error_rms_m"]).broken == ()


def test_the_worst_of_what_breaks_is_named_first() -> None:
    requirements = [requirement(2.0), requirement(1.5)]
    found = judge_step(requirements, runs([1.0] * 5 + [1.7] * 3 + [2.5] * 2))
    assert found.broken == ("formation_error_rms_m at most 1.5", "formation_error_rms_m at most 2")


def test_confidence_takes_more_runs_than_a_verdict() -> None:
    few, many = judge_step([requirement(2.0)], runs([1.0] * 10)), judge_step([requirement(2.0)], runs([1.0] * 22))
    assert (few.surely_holds, few.surely_broken) == (False, False)
    assert many.surely_holds
    assert judge_step([requirement(2.0)], runs([3.0] * 5 + [1.0] * 5)).surely_broken


def test_a_requirement_without_its_metric_is_not_judged() -> None:
    drift = RequirementSection(
        metric="passive_range_24_h_m", bound="at least", limit=10.0, probability=0.9, consumer_risk=0.1
    )
    assert [*judge_step([drift], runs([1.0])).record["violations"]] == [COMPLETED]
