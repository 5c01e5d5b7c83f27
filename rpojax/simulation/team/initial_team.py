"""Initial state of a team: its servicers at hand-over, around the same target."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from rpojax.core import random_streams
from rpojax.core.pytree import replace
from rpojax.core.random_streams import Stream
from rpojax.flight.stages import Stages
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import initial_state
from rpojax.simulation.noise import draw_initial_noise
from rpojax.simulation.team import exchange, team_step
from rpojax.simulation.team.member_axes import TeamParams
from rpojax.simulation.team.team_loop import TeamLoop
from rpojax.simulation.team.team_state import TeamState


def member_key(run_key: Array, number: int) -> Array:
    """Random key of a servicer of a run; the first one has that of the run itself."""
    return run_key if number == 0 else random_streams.fold_in(random_streams.fold_in(run_key, Stream.SERVICER), number)


def init(scenario: Scenario, params: TeamParams, key: Array, stages: Stages | None = None) -> TeamState:
    """Initial state of the team in a run with a random key, with these stages of the flight software."""
    loop = TeamLoop(scenario, params, stages or Stages())
    keys = jnp.stack([member_key(key, number) for number in range(params.count)], axis=-1)
    streams = params.each(lambda _, own: initial_state.random_keys(own))(keys)
    noise = params.each(lambda _, own: draw_initial_noise(scenario, own))(streams)
    noise = replace(noise, biases=team_step.with_common_gps_error(params, noise.biases))
    offsets = jnp.asarray(np.array(loop.settings.decision_offsets) * scenario.tick_s)
    servicers = params.each(
        lambda own, key, noise, offset: initial_state.init(scenario, own, key, noise, offset, loop.stages),
        out_axes=team_step.STATE_AXES,
    )(keys, noise, offsets)
    return exchange.initial(loop, servicers)
