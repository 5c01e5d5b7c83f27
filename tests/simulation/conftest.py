"""Short runs shared by the tests of this folder."""

import pytest
from fault_and_eclipse_runs import Runs, simulate_cases
from named_loops import name_loop
from short_run import OVERRIDES, STAGES, TICKS, Run, init, rollout

from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State


@pytest.fixture(scope="session")
def loop() -> tuple[Scenario, Params]:
    """Static settings and parameters of the short run."""
    file = name_loop("short run", scenario_loader.load("inspection", OVERRIDES))
    scenario = static_settings(file)
    return scenario, parameters.build_params(file.model_dump(), scenario.width_px, scenario.height_px)


@pytest.fixture(scope="session")
def start(loop: tuple[Scenario, Params]) -> State:
    """Initial state of the short run."""
    return init(*loop, run_key(1, 0))


@pytest.fixture(scope="session")
def run(loop: tuple[Scenario, Params], start: State) -> Run:
    """Final state and telemetry of the short run."""
    return rollout(*loop, start, TICKS, STAGES)


@pytest.fixture(scope="session")
def runs() -> Runs:
    """Final state and telemetry of runs with each fault, with a sunset and with a sunrise."""
    return simulate_cases()
