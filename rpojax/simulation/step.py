"""One tick of the closed loop as its sequence of stages."""

from rpojax.flight.stages import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.state import State
from rpojax.simulation.step_stages import (
    command_camera,
    control_and_propagate,
    finish,
    guide,
    manage_mission,
    navigate,
    plan_burn,
    sense,
    translate,
)
from rpojax.simulation.telemetry import Telemetry, telemetry_of
from rpojax.simulation.tick import Loop


def step(
    scenario: Scenario, params: Params, state: State, stages: Stages | None = None, noise: TickNoise | None = None
) -> tuple[State, Telemetry]:
    """State one tick later, and telemetry of the tick.

    Args:
        scenario: static settings
        params: parameters of the run
        state: at the beginning of the tick
        stages: replaceable stages of the flight software, by default its own; those with a memory of their own need a
            state that was made with them
        noise: random numbers of the tick, by default those of the run's keys
    """
    loop = Loop(scenario, params, stages or Stages())
    state = command_camera(loop, state)
    tick = sense(loop, state, noise)
    tick = navigate(loop, tick)
    tick = manage_mission(loop, tick)
    tick = plan_burn(loop, tick)
    tick = translate(loop, tick)
    tick = guide(loop, tick)
    motion = control_and_propagate(loop, tick)
    return finish(loop, tick, motion), telemetry_of(loop, tick)
