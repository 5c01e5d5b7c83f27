"""One tick of the closed loop as its sequence of stages."""

from rpojax.flight.computer import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation import step_stages
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.state import State
from rpojax.simulation.step_stages import GuidedTick
from rpojax.simulation.telemetry import Telemetry


def step(
    scenario: Scenario, params: Params, state: State, stages: Stages | None = None, noise: TickNoise | None = None
) -> tuple[State, Telemetry]:
    """State one tick later, and telemetry of the tick.

    Args:
        scenario: static settings
        params: parameters of the run
        state: at the beginning of the tick
        stages: replaceable parts of the flight software, by default its own
        noise: random numbers of the tick, by default those of the run's keys
    """
    stages = stages or Stages()
    sensed = step_stages.sense(scenario, params, state, noise)
    flight, innovation = step_stages.navigate(stages, scenario, params, state, sensed)
    flight, burn_error = step_stages.plan_burn(stages, scenario, params, state, sensed, flight)
    flight, mode = step_stages.guide(scenario, params, sensed, flight, innovation.accepted)
    telemetry = step_stages.make_telemetry(state, sensed, flight, innovation, mode)
    guided = GuidedTick(sensed=sensed, flight=flight, burn_error=burn_error)
    motion = step_stages.control_and_propagate(stages, scenario, params, state, guided)
    return step_stages.finish(stages, scenario, params, state, guided, motion), telemetry
