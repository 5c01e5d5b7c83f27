"""One tick of a team as its sequence of stages: those of one servicer, mapped over all, and what they share."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core.pytree import replace
from rpojax.flight.stages import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import step_stages
from rpojax.simulation.noise import TickNoise, draw_tick_noise
from rpojax.simulation.state import State, state_axes
from rpojax.simulation.team import common_gps_error, exchange
from rpojax.simulation.team.member_axes import TeamParams, put, take
from rpojax.simulation.team.team_loop import TeamLoop
from rpojax.simulation.team.team_state import TeamState
from rpojax.simulation.telemetry import Telemetry, telemetry_of
from rpojax.simulation.tick import Loop, Motion, Tick, tick_axes

STATE_AXES = state_axes(-1)
TICK_AXES = tick_axes(-1)


def step(
    scenario: Scenario, params: TeamParams, state: TeamState, stages: Stages | None = None
) -> tuple[TeamState, Telemetry]:
    """State of a team one tick later, and telemetry (..., N) of the tick.

    Args:
        scenario: static settings, with those of the team
        params: parameters of the servicers
        state: at the beginning of the tick
        stages: replaceable stages of the flight software, the same for all servicers; by default its own
    """
    loop = TeamLoop(scenario, params, stages or Stages())
    ticks = _each(loop, _sense_and_navigate, (STATE_AXES, -1), TICK_AXES)(state.servicers, _noise(loop, state))
    ticks, state = exchange.share(loop, state, ticks)
    ticks = _decide(loop, ticks)
    ticks, motion = _each(loop, _guide_and_move, TICK_AXES, (TICK_AXES, -1))(ticks)
    after = _each(loop, step_stages.finish, (TICK_AXES, -1), STATE_AXES)(ticks, motion)
    return exchange.predict(loop, state, ticks, motion, after), _each(loop, telemetry_of, TICK_AXES, -1)(ticks)


def _each(loop: TeamLoop, stage: Callable[..., Any], in_axes: Any, out_axes: Any) -> Callable[..., Any]:
    """A stage of one servicer as one of records (..., N) of all."""

    def of_one(params: Params, *records: Any) -> Any:
        return stage(Loop(loop.scenario, params, loop.stages), *records)

    return loop.params.each(of_one, in_axes, out_axes)


def _noise(loop: TeamLoop, state: TeamState) -> TickNoise:
    """Random numbers of the tick; the slow GPS errors of the receivers have a part in common."""

    def draw(_: Params, servicer: State) -> TickNoise:
        return draw_tick_noise(loop.scenario, servicer.keys, servicer.tick)

    noise = loop.params.each(draw, (STATE_AXES,))(state.servicers)
    return replace(noise, biases=with_common_gps_error(loop.params, noise.biases))


def with_common_gps_error(params: TeamParams, biases: Array) -> Array:
    """Numbers (6, N) of the slow errors of GPS and gyros, the former with the correlation between receivers."""
    share = params.member(0).gps.common_share
    return jnp.concatenate([common_gps_error.correlate(share, biases[:3]), biases[3:]])


def _sense_and_navigate(loop: Loop, state: State, noise: TickNoise) -> Tick:
    return step_stages.navigate(loop, step_stages.sense(loop, step_stages.command_camera(loop, state), noise))


def _decide(loop: TeamLoop, ticks: Tick) -> Tick:
    """Decisions about the mission and burns, of one servicer after the other.

    Each servicer's clock of decisions is late by its own offset, so that somebody always looks. The number of the tick
    is equal for all runs of a batch, so that the branches stay branches under `vmap`.
    """
    scenario, offsets = loop.scenario, jnp.array(loop.settings.decision_offsets, dtype=jnp.int32)
    period = scenario.mission.decision_ticks
    late_ticks = ticks.state.tick - offsets
    is_turn = (late_ticks % period == 0) & (late_ticks >= 0)

    def decide(number: Array, decided: tuple[Any, Any]) -> tuple[Any, Any]:
        flight, burn_error = decided
        tick = _member_tick(replace(ticks, flight=flight, burn_error=burn_error), number)
        late = replace(tick, state=replace(tick.state, tick=take(late_ticks, number)))
        own = Loop(scenario, loop.params.member(number), loop.stages)
        after = step_stages.plan_burn(own, step_stages.manage_mission(own, late))
        return jax.tree.map(lambda all_, one: put(all_, number, one), decided, (after.flight, after.burn_error))

    def decide_if_turn(number: Array, decided: tuple[Any, Any]) -> tuple[Any, Any]:
        return jax.lax.cond(take(is_turn, number), lambda: decide(number, decided), lambda: decided)

    def decide_all(decided: tuple[Any, Any]) -> tuple[Any, Any]:
        numbers = jnp.arange(loop.settings.servicers, dtype=jnp.int32)
        return jax.lax.scan(lambda now, number: (decide_if_turn(number, now), None), decided, numbers)[0]

    before = (ticks.flight, ticks.burn_error)
    with jax.named_scope("decide"):
        flight, burn_error = jax.lax.cond(jnp.any(is_turn), decide_all, lambda decided: decided, before)
    return replace(ticks, flight=flight, burn_error=burn_error)


def _member_tick(ticks: Tick, number: Array) -> Tick:
    """The tick of one servicer."""
    return jax.tree.map(
        lambda axis, part: part if axis is None else jax.tree.map(lambda leaf: take(leaf, number), part),
        TICK_AXES,
        ticks,
        is_leaf=lambda node: node is None or node == -1,
    )


def _guide_and_move(loop: Loop, tick: Tick) -> tuple[Tick, Motion]:
    tick = step_stages.guide(loop, step_stages.translate(loop, tick))
    return tick, step_stages.control_and_propagate(loop, tick)
