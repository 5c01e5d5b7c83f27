"""Shared compilation and samples for the tests of this folder."""

import numpy as np
import pytest
from dispersed_samples import ONE_OF_EACH, RUNS, draw
from scenario_variants import with_dispersions

from rpojax.scenario.schema import ScenarioFile


@pytest.fixture(scope="session", autouse=True)
def shared_compilation(programs: None) -> None:
    """Engines for the same scenario share compiled programs."""


@pytest.fixture(scope="session")
def samples(mission: ScenarioFile) -> dict[str, np.ndarray]:
    """Values of many runs with one dispersion of each kind."""
    return draw(with_dispersions(mission, *ONE_OF_EACH), np.arange(RUNS))
