"""What a batch compiles of one run: its preparation and its tick, for one servicer or for a team."""

import dataclasses
from collections.abc import Callable, Collection
from typing import Any

from jaxtyping import Array

from rpojax.batching import batching_mode
from rpojax.batching.batching_mode import BatchingMode
from rpojax.campaign.execution.teams import draw_of_members, numbers_of_members
from rpojax.flight.stages import Stages
from rpojax.scenario import params
from rpojax.scenario.dispersed_numbers import dispersed_values, dispersion_keys
from rpojax.scenario.dispersed_numbers.dispersed_values import Arrays, Values
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario
from rpojax.scenario.team import members
from rpojax.simulation import initial_state, single_precision
from rpojax.simulation.channels import Channels, compute_channels
from rpojax.simulation.state import State, state_axes
from rpojax.simulation.step import step
from rpojax.simulation.team import initial_team, member_axes, team_step
from rpojax.simulation.team.member_axes import TeamParams
from rpojax.simulation.team.team_state import TeamState


@dataclasses.dataclass(frozen=True)
class ServicerRun:
    """Run of one servicer.

    Attributes:
        file: the scenario
        scenario: its static settings
        stages: of the flight software
        nominal: nominal parameters
    """

    file: ScenarioFile
    scenario: Scenario
    stages: Stages
    nominal: Params

    @property
    def state_axes(self) -> State:
        """Batch axis of each field of the state."""
        return state_axes(-1)

    @property
    def draw_numbers(self) -> Arrays:
        """Numbers of the scenario from which values are drawn."""
        return dispersed_values.draw_numbers(self.file)

    def prepare(
        self, nominal: Params, numbers: Arrays, run_key: Array, assigned: Values, *, single: bool
    ) -> tuple[Values, Values, State]:
        """Values drawn, values read back from the parameters, and initial state, which may be in `single` precision."""
        drawn = dispersed_values.draw(self.file, run_key, assigned, numbers=numbers)
        dispersed = dispersed_values.apply_to_params(nominal, drawn)
        used = dispersed_values.read_back(dispersed, dispersion_keys.varied_keys(self.file))
        state = initial_state.init(self.scenario, dispersed, run_key, stages=self.stages)
        return drawn, used, single_precision.round_state_to_single(state) if single else state

    def tick(self, nominal: Params, values: Values, state: State) -> tuple[State, Channels]:
        """State one tick later, and channels of the tick."""
        dispersed = dispersed_values.apply_to_params(nominal, values)
        after, seen = step(self.scenario, dispersed, state, self.stages)
        return after, compute_channels(self.scenario, dispersed, seen)


@dataclasses.dataclass(frozen=True)
class TeamRun:
    """Run of a team; values of keys that are not common, states and channels have the servicers in the last axis.

    Attributes:
        file: the scenario of the team
        scenario: its static settings
        stages: of the flight software, the same for all servicers
        team: nominal parameters of the servicers
        common: dispersed keys with one value for all
    """

    file: ScenarioFile
    scenario: Scenario
    stages: Stages
    team: TeamParams
    common: Collection[str]

    @property
    def nominal(self) -> Params:
        """Nominal parameters."""
        return self.team.leaves

    @property
    def state_axes(self) -> TeamState:
        """Batch axis of each field of the state."""
        return TeamState(servicers=state_axes(-1), links=-1, sharing=-1, coordination=-1)  # pyright: ignore[reportArgumentType]

    @property
    def draw_numbers(self) -> list[Arrays]:
        """Numbers of the scenario from which values of each servicer are drawn."""
        return numbers_of_members(self.file)

    def prepare(
        self, nominal: Params, numbers: list[Arrays], run_key: Array, assigned: Values, *, single: bool
    ) -> tuple[Values, Values, TeamState]:
        """Values drawn, values read back from the parameters, and initial state, which may be in `single` precision."""
        drawn = draw_of_members(self.file, run_key, assigned, numbers)
        dispersed = self._dispersed(nominal, drawn)
        used = dispersed_values.read_back(dispersed.leaves, dispersion_keys.varied_keys(self.file))
        state = initial_team.init(self.scenario, dispersed, run_key, self.stages)
        if single:
            servicers = single_precision.round_state_to_single(state.servicers)
            state = dataclasses.replace(single_precision.round_to_single(state), servicers=servicers)
        return drawn, used, state

    def tick(self, nominal: Params, values: Values, state: TeamState) -> tuple[TeamState, Channels]:
        """State one tick later, and channels of the tick."""
        dispersed = self._dispersed(nominal, values)
        after, seen = team_step.step(self.scenario, dispersed, state, self.stages)
        channels = dispersed.each(lambda own, tick: compute_channels(self.scenario, own, tick))(seen)
        if state.sharing is not None:
            assert after.sharing is not None
            channels |= {"news_used": after.sharing.messages_used}
        return after, channels

    def _dispersed(self, nominal: Params, values: Values) -> TeamParams:
        return member_axes.with_values(dataclasses.replace(self.team, leaves=nominal), values, self.common)


def run_program(file: ScenarioFile, scenario: Scenario, stages: Stages, mode: BatchingMode) -> ServicerRun | TeamRun:
    """Program of a run of a scenario."""
    if not file.servicers:
        nominal = params.build_params(file.model_dump(), scenario.width_px, scenario.height_px)
        return ServicerRun(file, scenario, stages, nominal)
    team = member_axes.stack_members(members.member_params(file), mode)
    return TeamRun(file, scenario, stages, team, dispersion_keys.common_keys(file))


def tick_batching_mode(scenario: Scenario, mode: BatchingMode | None = None) -> BatchingMode:
    """How a tick is batched: as given, or by default as the environment says."""
    # Images are rendered by convolutions and lookups, which JAX batches best itself.
    return "jax" if scenario.camera_model == "rendered" else mode or batching_mode.chosen_mode()


def batch_transform(scenario: Scenario, mode: BatchingMode | None = None) -> Callable[..., Callable[..., Any]]:
    """Transform that batches a tick: `jax.vmap`, or its equivalent that keeps the runs in the last axis."""
    return batching_mode.transform(tick_batching_mode(scenario, mode))
