"""What designs give to runs: strata, balance, rows and combinations, the same whoever asks."""

import itertools
import json
from typing import Any

import numpy as np
import pytest

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.dispersions.designs import experiment_design
from rpojax.dispersions.designs.run_range import RunRange, recorded_run_range
from rpojax.errors import ResultError, RpojaxError
from rpojax.scenario import dispersion_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile


def with_design(mission: ScenarioFile, **settings: Any) -> ScenarioFile:
    """`mission` with a design, checked."""
    return scenario_loader.validate(mission.model_dump() | {"design": settings})


@pytest.fixture(scope="module")
def hypercube(mission: ScenarioFile) -> ScenarioFile:
    """`mission` as a Latin hypercube."""
    return with_design(mission, kind="latin_hypercube")


def test_only_runs_that_draw_for_themselves_are_independent(mission: ScenarioFile) -> None:
    values = {"gps.noise_m": [1.0, 2.0]}
    for kind in ("latin_hypercube", "sobol"):
        assert not experiment_design.has_independent_runs(with_design(mission, kind=kind))
    for kind in ("table", "grid"):
        assert not experiment_design.has_independent_runs(with_design(mission, kind=kind, values=values))
    assert experiment_design.has_independent_runs(mission)
    assert experiment_design.make_design(mission, 0, RunRange(0, 10)).assigned == {}


def test_every_stratum_of_every_coordinate_of_a_latin_hypercube_holds_one_run(hypercube: ScenarioFile) -> None:
    runs = 97
    given = experiment_design.make_design(hypercube, 1, RunRange(0, runs)).assigned
    assert set(given) == {dispersion_keys.dispersion_name(entry) for entry in hypercube.dispersions}
    for entry in hypercube.dispersions:
        values = given[dispersion_keys.dispersion_name(entry)]
        assert values.shape == (runs, dispersion_keys.coordinate_count(hypercube, entry))
        strata = np.sort(np.floor(values * runs), axis=0)
        np.testing.assert_array_equal(strata, np.broadcast_to(np.arange(runs)[:, None], values.shape))
    both = np.concatenate(list(given.values()), axis=1)
    correlation = np.corrcoef(both.T) - np.eye(both.shape[1])
    assert np.abs(correlation).max() < 5.0 / np.sqrt(runs)


def test_a_sobol_design_has_the_balance_of_a_net(mission: ScenarioFile) -> None:
    """Each half of each coordinate, and each quarter of the first two, hold equally many of 64 runs."""
    given = experiment_design.make_design(with_design(mission, kind="sobol"), 1, RunRange(0, 64)).assigned
    points = np.concatenate([given[dispersion_keys.dispersion_name(entry)] for entry in mission.dispersions], axis=1)
    assert points.shape[1] == sum(dispersion_keys.coordinate_count(mission, entry) for entry in mission.dispersions)
    for parts in (2, 4, 8, 16, 32, 64):
        counts = [np.bincount(np.floor(column * parts).astype(int), minlength=parts) for column in points.T]
        assert np.all(np.array(counts) == 64 // parts)
    cells = np.floor(points[:, :2] * 8).astype(int)
    assert len({tuple(cell) for cell in cells.tolist()}) == 64


def test_more_runs_of_a_sobol_design_leave_the_earlier_ones_as_they_were(mission: ScenarioFile) -> None:
    file = with_design(mission, kind="sobol")
    whole = experiment_design.make_design(file, 1, RunRange(0, 50)).assigned
    for population in (RunRange(0, 20), RunRange(13, 7), RunRange(49, 1)):
        part = experiment_design.make_design(file, 1, population).assigned
        rows = slice(population.first_run, population.first_run + population.runs)
        for name, values in part.items():
            np.testing.assert_array_equal(values, whole[name][rows])


def test_adding_a_dispersion_leaves_the_others_of_a_latin_hypercube_as_they_were(hypercube: ScenarioFile) -> None:
    tables = hypercube.model_dump()
    fewer = scenario_loader.validate(tables | {"dispersions": tables["dispersions"][::2]})
    whole = experiment_design.make_design(hypercube, 1, RunRange(0, 9)).assigned
    for name, values in experiment_design.make_design(fewer, 1, RunRange(0, 9)).assigned.items():
        np.testing.assert_array_equal(values, whole[name])


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_another_seed_is_another_design_and_the_same_is_the_same(mission: ScenarioFile, kind: str) -> None:
    file = with_design(mission, kind=kind)
    one, same, other = (experiment_design.make_design(file, seed, RunRange(0, 9)).assigned for seed in (1, 1, 2))
    for name, values in one.items():
        np.testing.assert_array_equal(values, same[name])
        assert not np.any(values == other[name])
        assert np.all((values > 0.0) & (values < 1.0))


def test_a_table_gives_each_run_its_row_and_no_more_runs_than_rows(mission: ScenarioFile) -> None:
    columns = {"gps.noise_m": [1.0, 2.0, 3.0], "fault.kind": ["none", "gps_outage", "none"]}
    file = with_design(mission, kind="table", values=columns)
    made = experiment_design.make_design(file, 0, RunRange(0, 3))
    assert made.for_runs(np.array([2, 0])) == {
        "gps.noise_m": pytest.approx([3.0, 1.0]),
        "fault.kind": pytest.approx([0, 0]),
    }
    assert made.assigned["fault.kind"][1] == 5.0  # the fifth kind after none
    later = experiment_design.make_design(file, 0, RunRange(1, 2))
    np.testing.assert_array_equal(later.for_runs(np.array([2]))["gps.noise_m"], [3.0])
    np.testing.assert_array_equal(later.for_runs(np.array([5]))["gps.noise_m"], [3.0])  # padding
    with pytest.raises(RpojaxError, match=r"^--runs: found run 3, expected runs up to 2: the table"):
        experiment_design.make_design(file, 0, RunRange(0, 4))
    with pytest.raises(RpojaxError, match="table"):
        experiment_design.make_design(file, 0, RunRange(3, 1))


def test_a_grid_has_every_combination_once_with_the_last_key_as_last_digit(mission: ScenarioFile) -> None:
    places = [[0.0, -30.0, 0.0], [0.0, 40.0, 0.0], [20.0, 0.0, 0.0]]
    values = {"gps.noise_m": [1.0, 2.0], "formation.desired_position_m": places, "fault.kind": ["none", "gps_outage"]}
    file = with_design(mission, kind="grid", values=values)
    given = experiment_design.make_design(file, 0, RunRange(0, 12)).assigned
    found = [
        (noise, place, ("none", "gps_outage")[int(code > 0)])
        for noise, place, code in zip(*(given[key].tolist() for key in values), strict=True)
    ]
    assert found == list(itertools.product(*values.values()))
    part = experiment_design.make_design(file, 0, RunRange(5, 3)).assigned
    np.testing.assert_array_equal(part["gps.noise_m"], given["gps.noise_m"][5:8])
    with pytest.raises(RpojaxError, match=r"found run 12, expected runs up to 11: the grid"):
        experiment_design.make_design(file, 0, RunRange(0, 13))


def test_the_order_of_a_grids_keys_is_part_of_the_scenarios_hash(mission: ScenarioFile) -> None:
    values = {"gps.noise_m": [1.0, 2.0], "servicer.mass_kg": [29.0, 31.0]}
    tables = mission.model_dump()
    free = tables | {"dispersions": []}
    there, back = (
        scenario_loader.validate(free | {"design": {"kind": "grid", "values": dict(items)}})
        for items in (values.items(), reversed(values.items()))
    )
    assert scenario_digest(there) != scenario_digest(back)
    tables.pop("design")
    assert scenario_digest(scenario_loader.validate(tables)) == scenario_digest(mission)
    assert scenario_digest(with_design(mission, kind="sobol")) != scenario_digest(mission)


def test_a_design_too_large_for_memory_is_refused_before_it_is_made(hypercube: ScenarioFile) -> None:
    with pytest.raises(RpojaxError, match=r"^--runs: found 2000000000, expected at most \d+ for this design"):
        experiment_design.make_design(hypercube, 0, RunRange(0, 2_000_000_000))


def test_a_design_is_made_again_from_what_campaign_json_says(hypercube: ScenarioFile) -> None:
    made = experiment_design.make_design(hypercube, 3, RunRange(10, 20))
    info = json.loads(json.dumps({"seed": 3, "first_run": 14, "runs": 1, "design": made.record()}))
    again = experiment_design.recreate_design(hypercube, info)
    assert again.run_range == RunRange(10, 20)
    for name, values in made.assigned.items():
        np.testing.assert_array_equal(again.assigned[name], values)
    with pytest.raises(ResultError, match=r"campaign.json: found another design"):
        experiment_design.recreate_design(hypercube, info | {"seed": 4})
    older = {"seed": 3, "first_run": 10, "runs": 20}
    np.testing.assert_array_equal(
        experiment_design.recreate_design(hypercube, older).assigned["servicer.mass_kg"],
        made.assigned["servicer.mass_kg"],
    )


@pytest.mark.parametrize(
    "recorded",
    [
        None,
        3,
        [],
        {},
        {"first_run": 0},
        {"first_run": -1, "runs": 5},
        {"first_run": True, "runs": 5},
        {"first_run": 2, "runs": 5},
    ],
    ids=str,
)
def test_a_campaign_json_that_says_no_design_is_refused(recorded: Any) -> None:
    with pytest.raises(ResultError, match=r"^campaign.json: found .*expected"):
        recorded_run_range({"first_run": 0, "runs": 1, "design": recorded})


def test_an_engine_without_the_design_of_its_scenario_is_refused(hypercube: ScenarioFile) -> None:
    with pytest.raises(RpojaxError, match=r"^design: found none"):
        BatchEngine(hypercube, 1)
