"""For every kind of dispersion and of design, planned, drawn and used values are equal."""

import csv
import io
import json
from pathlib import Path
from typing import Any, get_args

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from rewritten_campaigns import rewrite_campaign

from rpojax.campaign import dry_run, experiment_design, single_run
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.run_and_resume import resume_campaign, run_campaign
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.core import random_streams
from rpojax.dispersions.designs.design_sections import Design
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.dispersions.kinds.registry import Dispersion
from rpojax.errors import ResultError, RpojaxError
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.parameter_keys import component_columns
from rpojax.scenario.schema import ScenarioFile

ONE_DEVICE = jax.devices()[:1]
LAST_DIGITS = 1e-13
RUNS = 4

HANDOVER = ["initial.relative_position_m", "initial.relative_velocity_m_s"]
SPREAD = np.diag([4.0, 4.0, 1.0, 1e-4, 1e-4, 1e-4])
SPREAD[0, 4] = SPREAD[4, 0] = -0.015
ALWAYS: list[dict[str, Any]] = [
    {"keys": HANDOVER, "kind": "correlated_normal", "covariance": SPREAD.tolist()},
    {"key": "orbit.true_anomaly_deg", "kind": "uniform", "low": 0.0, "high": 360.0},
    {"key": "target.tumble_rate_deg_s", "kind": "choice", "values": [0.9, 1.1]},
    {"key": "target.tumble_axis", "kind": "direction"},
    {"key": "thruster.misalignment_deg", "kind": "normal", "sigma": [0.01, 0.02, 0.02]},
    {"key": "star_tracker.misalignment_deg", "kind": "normal", "sigma": 0.02},
    {
        "key": "camera.misalignment_deg",
        "kind": "derived",
        "offset": [0.0, 0.01, 0.0],
        "terms": [
            {"key": "star_tracker.misalignment_deg", "factor": -0.5},
            {"key": "thruster.misalignment_deg[2]", "factor": 0.1},
        ],
    },
]
DRAWN: list[dict[str, Any]] = [
    {"key": "target.attitude", "kind": "attitude"},
    {"key": "servicer.mass_kg", "kind": "truncated_normal", "sigma": 0.3, "limit_sigmas": 2.0},
    {"key": "thruster.force_scale", "kind": "log_normal", "sigma": 0.01},
    {"key": "thruster.position_m[1]", "kind": "normal", "sigma": 0.002},
]
TURNED: list[dict[str, Any]] = [{"key": "target.attitude", "kind": "small_rotation", "sigma_deg": 5.0}]
COLUMNS = {
    "servicer.mass_kg": [29.8, 30.1, 30.05, 29.7],
    "thruster.force_scale": [0.99, 1.0, 1.01, 1.02],
    "thruster.position_m[1]": [0.0, 0.001, -0.001, 0.002],
}
POINTS = {
    "servicer.mass_kg": [29.9, 30.1],
    "thruster.force_scale": [1.0],
    "thruster.position_m": [[-0.25, 0.0, 0.0], [-0.25, 0.001, 0.001]],
}
CASES: dict[str, tuple[list[dict[str, Any]], dict[str, Any]]] = {
    "independent": (ALWAYS + DRAWN, {"kind": "independent"}),
    "latin_hypercube": (ALWAYS + DRAWN, {"kind": "latin_hypercube"}),
    "sobol": (ALWAYS + TURNED + DRAWN[1:], {"kind": "sobol"}),
    "table": (ALWAYS + TURNED, {"kind": "table", "values": COLUMNS}),
    "grid": (ALWAYS + DRAWN[:1], {"kind": "grid", "values": POINTS}),
}
"""Dispersions and design of each case; all disperse the same keys, so that the compiled loop is the same."""


def case(mission: ScenarioFile, kind: str) -> ScenarioFile:
    """`mission` with the dispersions and design of a case."""
    entries, settings = CASES[kind]
    return scenario_loader.validate(mission.model_dump() | {"dispersions": entries, "design": settings})


def same_bits(found: dict[str, np.ndarray], expected: dict[str, np.ndarray]) -> None:
    assert found.keys() == expected.keys()
    for key, values in expected.items():
        np.testing.assert_array_equal(found[key], values, err_msg=key)


def test_cases_cover_all_dispersions_and_designs(mission: ScenarioFile) -> None:
    def kinds(union: Any) -> set[str]:
        return {get_args(model.model_fields["kind"].annotation)[0] for model in get_args(get_args(union)[0])}

    assert set(CASES) == kinds(Design)
    assert {entry["kind"] for entries, _ in CASES.values() for entry in entries} == kinds(Dispersion)
    for kind in CASES:
        assert set(dispersion_keys.varied_keys(case(mission, kind))) == set(dispersion_keys.varied_keys(mission))


def single_run_values(file: ScenarioFile, run_id: int) -> dict[str, np.ndarray]:
    """Dispersed values of the Params of a run that is prepared alone."""
    _, chosen, _ = single_run.initialise_run(file, 5, run_id, RunRange(0, RUNS))
    return jax.tree.map(np.asarray, dispersed_values.read_back(chosen, dispersion_keys.varied_keys(file)))


def check_campaign(file: ScenarioFile, out: Path) -> Campaign:
    """Checks that planned, drawn and used values agree in a campaign, in a single run and in a campaign of that run."""
    campaign = run_campaign(file, RUNS, out, seed=5, block_size=1, histories=[], devices=ONE_DEVICE)
    planned = dry_run.plan_campaign(file, CampaignOptions(RUNS, 5, block_size=1), devices=ONE_DEVICE)
    same_bits(planned.values, campaign.drawn)
    assert set(planned.values) == set(dispersion_keys.varied_keys(file))
    alone = single_run_values(file, 2)
    for key, values in campaign.drawn.items():
        np.testing.assert_allclose(campaign.used[key], values, rtol=LAST_DIGITS, atol=1e-16, err_msg=key)
        np.testing.assert_allclose(alone[key], values[2], rtol=1e-12, atol=1e-15, err_msg=key)
        assert len(np.unique(values.reshape(RUNS, -1), axis=0)) > 1 or key == "thruster.force_scale"
    again = run_campaign(
        file,
        1,
        out / "again",
        seed=5,
        first_run=2,
        block_size=1,
        devices=ONE_DEVICE,
        run_range=RunRange(0, RUNS),
    )
    same_bits(again.drawn, {key: values[2:3] for key, values in campaign.drawn.items()})
    same_bits(again.metrics, {key: values[2:3] for key, values in campaign.metrics.items()})
    assert again.configuration.options.run_range == RunRange(0, RUNS)
    return campaign


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_planned_values_are_those_of_the_runs(mission: ScenarioFile, kind: str) -> None:
    file = case(mission, kind)
    planned = dry_run.plan_campaign(file, CampaignOptions(RUNS, 5, block_size=1), devices=ONE_DEVICE)
    assert set(planned.values) == set(dispersion_keys.varied_keys(file))
    design = experiment_design.make_design(file, 5, RunRange(0, RUNS))
    engine = BatchEngine(file, RUNS, ONE_DEVICE, design=design)
    drawn, used, _ = engine._compiled_preparation(*engine._preparation_inputs(5, np.arange(RUNS)))
    alone = single_run_values(file, 2)
    for key, values in planned.values.items():
        for found in (drawn[key], used[key]):
            np.testing.assert_allclose(found, values, rtol=LAST_DIGITS, atol=1e-15, err_msg=key)
        np.testing.assert_allclose(alone[key], values[2], rtol=1e-12, atol=1e-15, err_msg=key)
        assert len(np.unique(values.reshape(RUNS, -1), axis=0)) > 1
    # One run in each quarter of the anomalies.
    quarters = np.floor(planned.values["orbit.true_anomaly_deg"] / 360.0 * RUNS)
    assert sorted(quarters) == [0.0, 1.0, 2.0, 3.0]


@pytest.mark.slow
def test_planned_values_of_a_latin_hypercube_are_drawn_and_used(mission: ScenarioFile, tmp_path: Path) -> None:
    file = case(mission, "latin_hypercube")
    campaign = check_campaign(file, tmp_path / "runs")
    # One run in each quarter of the anomalies.
    quarters = np.floor(campaign.drawn["orbit.true_anomaly_deg"] / 360.0 * RUNS)
    assert sorted(quarters) == [0.0, 1.0, 2.0, 3.0]
    # A resume makes the design of the whole campaign for any missing blocks.
    before = campaign.drawn, campaign.metrics
    (campaign.directory / "manifest" / "000002.json").unlink()
    resumed = resume_campaign(campaign.directory)
    same_bits(resumed.drawn, before[0])
    same_bits(resumed.metrics, before[1])


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(set(CASES) - {"latin_hypercube"}))
def test_planned_values_are_drawn_and_used(mission: ScenarioFile, tmp_path: Path, kind: str) -> None:
    check_campaign(case(mission, kind), tmp_path / "runs")


def test_resume_with_another_design_is_refused(
    mission: ScenarioFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rpojax.campaign.run_and_resume.simulate_missing_blocks", lambda *_: None)
    file = case(mission, "latin_hypercube")
    begun = run_campaign(file, 3, tmp_path / "runs", block_size=1, devices=ONE_DEVICE)
    resume_campaign(begun.directory)
    recorded = begun.info["design"]
    rewrite_campaign(begun.directory, design=recorded | {"sha256": "0" * 64})
    with pytest.raises(ResultError, match=r"^campaign.json: found another design"):
        resume_campaign(begun.directory)


@pytest.fixture(scope="module")
def grid_plan(mission: ScenarioFile) -> dry_run.Plan:
    """Plan of two of the four runs of a grid."""
    file = scenario_loader.validate(mission.model_dump() | {"dispersions": ALWAYS[:1], "design": CASES["grid"][1]})
    options = CampaignOptions(2, 5, first_run=1, block_size=2)
    return dry_run.plan_campaign(file, options, devices=ONE_DEVICE, speed=400.0)


def test_grid_values_are_in_the_order_of_runs(grid_plan: dry_run.Plan) -> None:
    assert grid_plan.run_ids.tolist() == [1, 2]
    np.testing.assert_array_equal(grid_plan.values["servicer.mass_kg"], [29.9, 30.1])
    np.testing.assert_array_equal(
        grid_plan.values["thruster.position_m"], np.array(POINTS["thruster.position_m"])[[1, 0]]
    )


def draw_first_runs(file: ScenarioFile, runs: int) -> dict[str, np.ndarray]:
    """Values drawn by the first runs."""
    given = experiment_design.make_design(file, 0, RunRange(0, runs)).assigned

    def one(run_id: jax.Array, row: dispersed_values.Values) -> dispersed_values.Values:
        return dispersed_values.draw(file, random_streams.fold_in(random_streams.master_key(0), run_id), row)

    ids = jnp.arange(runs, dtype=jnp.int32)
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(one))(ids, given))


def test_derived_keys_are_computed_in_any_order(mission: ScenarioFile) -> None:
    """Chains of keys derived from drawn, tabulated and nominal numbers, in any order in the file."""
    entries = [
        {
            "key": "navigation.edge_noise_px",
            "kind": "derived",
            "offset": 0.5,
            "terms": [{"key": "navigation.gps_noise_m", "factor": 2.0}],
        },
        {
            "key": "navigation.gps_noise_m",
            "kind": "derived",
            "offset": 0.1,
            "terms": [
                {"key": "gps.noise_m", "factor": 1.5},
                {"key": "gps.bias_sigma_m", "factor": -0.25},
                {"key": "servicer.mass_kg", "factor": 0.01},
            ],
        },
        {"key": "gps.noise_m", "kind": "uniform", "low": 1.0, "high": 3.0},
        {
            "key": "formation.desired_position_m[0]",
            "kind": "derived",
            "offset": 0.0,
            "terms": [{"key": "gps.noise_m", "factor": 1.0}],
        },
    ]
    settings = {
        "kind": "table",
        "values": {"gps.bias_sigma_m": [1.0, 2.0, 3.0], "formation.desired_position_m[1]": [-40.0, -30.0, -20.0]},
    }
    file = scenario_loader.validate(mission.model_dump() | {"dispersions": entries, "design": settings})
    values = draw_first_runs(file, 3)
    gps_noise = 0.1 + 1.5 * values["gps.noise_m"] - 0.25 * np.array([1.0, 2.0, 3.0]) + 0.01 * 30.0
    np.testing.assert_allclose(values["navigation.gps_noise_m"], gps_noise, rtol=1e-14)
    np.testing.assert_allclose(values["navigation.edge_noise_px"], 0.5 + 2.0 * gps_noise, rtol=1e-14)
    place = np.stack([values["gps.noise_m"], [-40.0, -30.0, -20.0], np.zeros(3)], axis=1)
    np.testing.assert_array_equal(values["formation.desired_position_m"], place)


def test_csv_table_is_read_back_exactly(grid_plan: dry_run.Plan) -> None:
    rows = list(csv.DictReader(io.StringIO(dry_run.csv_text(grid_plan))))
    assert [(row["run_id"], row["seed"]) for row in rows] == [("1", "5"), ("2", "5")]
    for name, values in component_columns(grid_plan.values).items():
        assert [float(row[name]) for row in rows] == values.tolist()
    assert "initial.relative_position_m[2]" in rows[0]
    content = json.loads(json.dumps(dry_run.as_json(grid_plan), allow_nan=False))
    assert content["values"] == {key: values.tolist() for key, values in grid_plan.values.items()}
    assert (content["design"], content["independent"], content["runs"]) == ("grid", False, 2)


def test_plan_estimates_resources_and_names_the_source_of_the_speed(
    grid_plan: dry_run.Plan, mission: ScenarioFile
) -> None:
    assert grid_plan.estimate.time_s == 2 * 400.0 / 400.0
    assert grid_plan.estimate.speed_source == "given"
    rough = dry_run.plan_campaign(mission, CampaignOptions(2, block_size=1), devices=ONE_DEVICE).estimate
    assert rough.speed_source == "rough figure for 1 x CPU core"
    assert rough.time_s == pytest.approx(800.0 / dry_run.TYPICAL_SPEEDS["geometric"])
    assert rough.memory_bytes > 5e8
    assert rough.disk_bytes > 1e7
    with pytest.raises(RpojaxError, match=r"^speed"):
        dry_run.plan_campaign(mission, CampaignOptions(2), speed=0.0)
