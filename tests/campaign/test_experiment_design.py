"""Experiment designs of campaigns: independence, reproduction from the record, and size."""

import numpy as np
import pytest
from scenario_variants import with_design

from rpojax.campaign import experiment_design
from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import ResultError, RpojaxError
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture(scope="module")
def hypercube(mission: ScenarioFile) -> ScenarioFile:
    """`mission` as a Latin hypercube."""
    return with_design(mission, kind="latin_hypercube")


def test_only_the_independent_design_has_independent_runs(mission: ScenarioFile) -> None:
    values = {"gps.noise_m": [1.0, 2.0]}
    for kind in ("latin_hypercube", "sobol"):
        assert not experiment_design.has_independent_runs(with_design(mission, kind=kind))
    for kind in ("table", "grid"):
        assert not experiment_design.has_independent_runs(with_design(mission, kind=kind, values=values))
    assert experiment_design.has_independent_runs(mission)
    assert experiment_design.make_design(mission, 0, RunRange(0, 10)).assigned == {}


@pytest.mark.parametrize("kind", ["latin_hypercube", "sobol"])
def test_a_design_depends_on_the_seed_and_lies_in_the_open_unit_cube(mission: ScenarioFile, kind: str) -> None:
    file = with_design(mission, kind=kind)
    one, same, other = (experiment_design.make_design(file, seed, RunRange(0, 9)).assigned for seed in (1, 1, 2))
    for name, values in one.items():
        np.testing.assert_array_equal(values, same[name])
        assert not np.any(values == other[name])
        assert np.all((values > 0.0) & (values < 1.0))


def test_a_design_too_large_for_memory_is_refused(hypercube: ScenarioFile) -> None:
    with pytest.raises(RpojaxError, match=r"^runs: found 2000000000, expected at most \d+ for this design"):
        experiment_design.make_design(hypercube, 0, RunRange(0, 2_000_000_000))


def test_a_recorded_design_is_recreated(hypercube: ScenarioFile) -> None:
    design = experiment_design.make_design(hypercube, 3, RunRange(10, 20))
    recreated = experiment_design.recreate_design(hypercube, 3, RunRange(10, 20), design.sha256())
    assert recreated.run_range == RunRange(10, 20)
    for name, values in design.assigned.items():
        np.testing.assert_array_equal(recreated.assigned[name], values)
    with pytest.raises(ResultError, match=r"campaign.json: found another design"):
        experiment_design.recreate_design(hypercube, 4, RunRange(10, 20), design.sha256())
    unrecorded = experiment_design.recreate_design(hypercube, 3, RunRange(10, 20), None)
    np.testing.assert_array_equal(unrecorded.assigned["servicer.mass_kg"], design.assigned["servicer.mass_kg"])


def test_an_engine_without_the_design_of_its_scenario_is_refused(hypercube: ScenarioFile) -> None:
    with pytest.raises(RpojaxError, match=r"^design: found none"):
        BatchEngine(hypercube, 1)
