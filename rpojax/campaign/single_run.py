"""One dispersed run in memory, for looking around and for gradients."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.dispersions import designs, dispersed_values
from rpojax.dispersions.designs import RunRange
from rpojax.flight.computer import Stages
from rpojax.scenario import params, scenario_file
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation import closed_loop, telemetry
from rpojax.simulation.closed_loop import State


def nominal_parameters(file: ScenarioFile) -> tuple[Scenario, Params]:
    """Static settings and undispersed numbers of a scenario."""
    static = scenario_file.static_settings(file)
    return static, params.build_params(file.model_dump(), static.width_px, static.height_px)


def initialise_run(
    file: ScenarioFile, seed: int = 0, run_id: int = 0, population: RunRange | None = None
) -> tuple[Scenario, Params, State]:
    """Static settings, dispersed numbers and initial state of one run of a campaign.

    `population` are the runs of the campaign, on which the values of a Latin hypercube depend; by default this one.
    """
    static, chosen, key = dispersed_parameters(file, seed, run_id, population)
    return static, chosen, closed_loop.init(static, chosen, key)


def dispersed_parameters(
    file: ScenarioFile, seed: int = 0, run_id: int = 0, population: RunRange | None = None
) -> tuple[Scenario, Params, Array]:
    """Static settings, dispersed numbers and random key of one run of a campaign, before anything is started."""
    static, base = nominal_parameters(file)
    key = closed_loop.run_key(seed, run_id)
    rows = designs.make_design(file, seed, population or RunRange(run_id, 1)).for_runs(np.array([run_id]))
    given = {name: jnp.asarray(values[0]) for name, values in rows.items()}
    return static, dispersed_values.apply_to_params(base, dispersed_values.draw(file, key, given)), key


def simulate(
    file: ScenarioFile,
    seed: int = 0,
    run_id: int = 0,
    stages: Stages | None = None,
    population: RunRange | None = None,
) -> dict[str, np.ndarray]:
    """All channels of one run at every camera tick, time first, as a campaign's history holds them."""
    static, chosen, state = initialise_run(file, seed, run_id, population)
    channels = jax.tree.map(np.asarray, _simulate_ticks(static, stages or Stages(), chosen, state))
    return {
        "time_s": np.arange(static.ticks) * static.tick_s,
        "rho_desired_H": np.asarray(file.formation.desired_position_m),
        **channels,
    }


@partial(jax.jit, static_argnums=(0, 1))
def _simulate_ticks(static: Scenario, stages: Stages, chosen: Params, state: State) -> telemetry.Channels:
    def body(carry: State, _: None) -> tuple[State, telemetry.Channels]:
        after, seen = closed_loop.tick(stages, static, chosen, carry)
        return after, telemetry.compute_channels(static, chosen, seen)

    return jax.lax.scan(body, state, None, length=static.ticks)[1]
