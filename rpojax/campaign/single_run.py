"""One run of a scenario in memory: its parameters, its initial state, and its simulation without a campaign folder."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.campaign import experiment_design
from rpojax.campaign.execution import teams
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.flight.stages import Stages
from rpojax.runtime.progress import stage
from rpojax.scenario import params
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.params import Params
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.scenario.team.members import member_files, member_params
from rpojax.simulation import initial_state
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State
from rpojax.simulation.step import step
from rpojax.simulation.team import initial_team, member_axes
from rpojax.simulation.team.initial_team import member_key
from rpojax.simulation.team.member_axes import TeamParams
from rpojax.simulation.team.team_state import TeamState

# One program instead of two hundred small ones, each of which would be compiled.
_init = jax.jit(initial_state.init, static_argnums=0, static_argnames="stages")


def nominal_parameters(file: ScenarioFile) -> tuple[Scenario, Params]:
    """Static settings and nominal Params of a scenario."""
    scenario = static_settings(file)
    return scenario, params.build_params(file.model_dump(), scenario.width_px, scenario.height_px)


def dispersed_parameters(
    file: ScenarioFile, seed: int = 0, run_id: int = 0, run_range: RunRange | None = None, servicer: int | None = None
) -> tuple[Scenario, Params, Array]:
    """Static settings, dispersed Params and random key of one run of a campaign, or of one servicer of a team in it.

    Args:
        file: the scenario
        seed: master seed
        run_id: number of the run
        run_range: that of the campaign, on which designs such as a Latin hypercube depend; by default this run alone
        servicer: number of the servicer of a team, None for one alone

    Raises:
        ScenarioError: the scenario has a team, and no servicer of it was chosen.
    """
    scenario, nominal = nominal_parameters(file if servicer is None else member_files(file)[servicer])
    key = run_key(seed, run_id)
    design = experiment_design.make_design(file, seed, run_range or RunRange(run_id, 1))
    assigned = {name: jnp.asarray(rows[0]) for name, rows in design.for_runs(np.array([run_id])).items()}
    if servicer is None:
        return scenario, dispersed_values.apply_to_params(nominal, dispersed_values.draw(file, key, assigned)), key
    values = teams.of_member(file, teams.draw_of_members(file, key, assigned), servicer)
    return scenario, dispersed_values.apply_to_params(nominal, values), member_key(key, servicer)


def initialise_run(
    file: ScenarioFile,
    seed: int = 0,
    run_id: int = 0,
    run_range: RunRange | None = None,
    servicer: int | None = None,
    stages: Stages | None = None,
) -> tuple[Scenario, Params, State]:
    """Static settings, dispersed Params and initial state of one run of a campaign, or of one servicer of a team.

    The stages of the flight software are by default the packaged ones, whatever the scenario's plugin replaces: they
    matter for a memory of their own alone. GPS errors that the servicers of a team have in common are not in that
    state.
    """
    scenario, dispersed, key = dispersed_parameters(file, seed, run_id, run_range, servicer)
    return scenario, dispersed, _init(scenario, dispersed, key, stages=stages)


def initialise_team_run(
    file: ScenarioFile,
    seed: int = 0,
    run_id: int = 0,
    run_range: RunRange | None = None,
    stages: Stages | None = None,
) -> tuple[Scenario, TeamParams, TeamState]:
    """Static settings, dispersed parameters and initial state of one run of a campaign of a team.

    `run_range` is the range of runs of the campaign, by default this run alone; `stages` as in `initialise_run`.
    """
    scenario = static_settings(file, allow_team=True)
    key = run_key(seed, run_id)
    design = experiment_design.make_design(file, seed, run_range or RunRange(run_id, 1))
    assigned = {name: jnp.asarray(rows[0]) for name, rows in design.for_runs(np.array([run_id])).items()}
    values = teams.draw_of_members(file, key, assigned)
    team = member_axes.with_values(
        member_axes.stack_members(member_params(file)), values, dispersion_keys.common_keys(file)
    )
    init = jax.jit(
        lambda leaves, key: initial_team.init(scenario, dataclasses.replace(team, leaves=leaves), key, stages)
    )
    return scenario, team, init(team.leaves, key)


def simulate(
    file: ScenarioFile,
    seed: int = 0,
    run_id: int = 0,
    stages: Stages | None = None,
    run_range: RunRange | None = None,
    *,
    progress: bool = True,
) -> dict[str, np.ndarray]:
    """Channels of one run at every camera tick, time first, as in a history of a campaign.

    Args:
        file: the scenario
        seed: master seed
        run_id: number of the run
        stages: of the flight software, replaced ones included
        run_range: runs of the campaign, by default this run alone
        progress: show in a terminal that it is under way
    """
    with stage("compiling and simulating a run", quiet=not progress, announce=False):
        chosen = plugin_registry.stages_of(file, stages)
        scenario, dispersed, state = initialise_run(file, seed, run_id, run_range, stages=chosen)
        channels = jax.tree.map(np.asarray, _simulate_ticks(scenario, chosen, dispersed, state))
    return {
        "time_s": np.arange(scenario.ticks) * scenario.tick_s,
        "rho_desired_H": np.asarray(dispersed.flight.formation.desired_position),
        **channels,
    }


@partial(jax.jit, static_argnums=(0, 1))
def _simulate_ticks(scenario: Scenario, stages: Stages, params: Params, state: State) -> Channels:
    def tick(carry: State, _: None) -> tuple[State, Channels]:
        after, seen = step(scenario, params, carry, stages)
        return after, compute_channels(scenario, params, seen)

    return jax.lax.scan(tick, state, None, length=scenario.ticks)[1]
