"""Simulation of many ticks by a scan."""

import jax

from rpojax.flight.stages import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.state import State
from rpojax.simulation.step import step
from rpojax.simulation.telemetry import Telemetry


def rollout(
    scenario: Scenario, params: Params, state: State, ticks: int | None = None, stages: Stages | None = None
) -> tuple[State, Telemetry]:
    """State after `ticks` ticks, by default those of the whole run, and their telemetry with time as first axis."""

    def body(carry: State, _: None) -> tuple[State, Telemetry]:
        return step(scenario, params, carry, stages)

    return jax.lax.scan(body, state, None, length=scenario.ticks if ticks is None else ticks)
