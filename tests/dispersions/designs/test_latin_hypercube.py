"""Latin hypercube: one run in each stratum of each coordinate."""

import numpy as np
import pytest
from scenario_variants import with_design

from rpojax.campaign import experiment_design
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.scenario.dispersed_numbers import dispersion_keys
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture(scope="module")
def hypercube(mission: ScenarioFile) -> ScenarioFile:
    """`mission` as a Latin hypercube."""
    return with_design(mission, kind="latin_hypercube")


def test_every_stratum_of_every_coordinate_contains_one_run(hypercube: ScenarioFile) -> None:
    runs = 97
    assigned = experiment_design.make_design(hypercube, 1, RunRange(0, runs)).assigned
    assert set(assigned) == {entry.name for entry in hypercube.dispersions}
    for entry in hypercube.dispersions:
        values = assigned[entry.name]
        assert values.shape == (runs, dispersion_keys.coordinate_count(hypercube, entry))
        strata = np.sort(np.floor(values * runs), axis=0)
        np.testing.assert_array_equal(strata, np.broadcast_to(np.arange(runs)[:, None], values.shape))
    both = np.concatenate(list(assigned.values()), axis=1)
    correlation = np.corrcoef(both.T) - np.eye(both.shape[1])
    assert np.abs(correlation).max() < 5.0 / np.sqrt(runs)


def test_adding_a_dispersion_leaves_the_others_unchanged(hypercube: ScenarioFile) -> None:
    tables = hypercube.model_dump()
    fewer = scenario_loader.validate(tables | {"dispersions": tables["dispersions"][::2]})
    whole = experiment_design.make_design(hypercube, 1, RunRange(0, 9)).assigned
    for name, values in experiment_design.make_design(fewer, 1, RunRange(0, 9)).assigned.items():
        np.testing.assert_array_equal(values, whole[name])
