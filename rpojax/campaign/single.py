"""One dispersed run in memory, for looking around and for gradients."""

from functools import partial

import jax
import numpy as np

from rpojax.campaign import dispersions
from rpojax.flight.computer import Stages
from rpojax.simulation import closed_loop, params, scenario, telemetry
from rpojax.simulation.closed_loop import State
from rpojax.simulation.params import Params
from rpojax.simulation.scenario import Scenario
from rpojax.simulation.schema import ScenarioFile


def nominal(file: ScenarioFile) -> tuple[Scenario, Params]:
    """Static settings and undispersed numbers of a scenario."""
    static = scenario.static(file)
    return static, params.build(file.model_dump(), static.width_px, static.height_px)


def dispersed(file: ScenarioFile, seed: int = 0, run_id: int = 0) -> tuple[Scenario, Params, State]:
    """Static settings, dispersed numbers and initial state of one run of a campaign."""
    static, base = nominal(file)
    key = closed_loop.run_key(seed, run_id)
    chosen = dispersions.apply(base, dispersions.draw(file, key))
    return static, chosen, closed_loop.init(static, chosen, key)


def simulate(file: ScenarioFile, seed: int = 0, run_id: int = 0, stages: Stages | None = None) -> dict[str, np.ndarray]:
    """All channels of one run at every camera tick, time first, as a campaign's history holds them."""
    static, chosen, state = dispersed(file, seed, run_id)
    channels = jax.tree.map(np.asarray, _run(static, stages or Stages(), chosen, state))
    return {
        "time_s": np.arange(static.ticks) * static.tick_s,
        "rho_desired_H": np.asarray(file.formation.desired_position_m),
        **channels,
    }


@partial(jax.jit, static_argnums=(0, 1))
def _run(static: Scenario, stages: Stages, chosen: Params, state: State) -> telemetry.Channels:
    def body(carry: State, _: None) -> tuple[State, telemetry.Channels]:
        after, seen = closed_loop.tick(stages, static, chosen, carry)
        return after, telemetry.observe(static, chosen, seen)

    return jax.lax.scan(body, state, None, length=static.ticks)[1]
