"""One batch of short runs that differ in their parameters: with each fault, with a sunset and with a sunrise."""

from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from named_loops import name_loop

from rpojax.core.pytree import replace
from rpojax.physics import equipment_faults
from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import Scenario, static_settings
from rpojax.simulation import initial_state
from rpojax.simulation.noise import run_key
from rpojax.simulation.rollout import rollout
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry

TICKS, BEGIN, END = 400, 100, 300
"""Length of a run, and start and end of the fault [s]."""
OVERRIDES = (
    f"duration_s={TICKS}.0",
    "rates.formation_period_s=100.0",
    "pointing.look_away_limit_s=80.0",
    "formation.lead_s=40.0",
    "wheels.initial_speed_rad_s=[20.0, 20.0, 20.0]",
    "dispersions.faults.fault.start_s=none",
    f"faults.fault.start_s={BEGIN}.0",
    f"faults.fault.duration_s={END - BEGIN}.0",
)
"""Burns planned every 100 s and executed 40 s later."""
ECLIPSE_RAAN = np.deg2rad(30.3)
"""The Sun 30 deg out of the orbit plane, as in the packaged scenario: sunset at 30 deg of anomaly, sunrise at 159."""
SUNSET, SUNRISE = "sunset", "sunrise"
CASES = (*equipment_faults.KINDS, SUNSET, SUNRISE)


def case(nominal: Params, name: str) -> Params:
    """Params of one case."""
    if name in equipment_faults.KINDS:
        return parameters.replace_leaf(
            nominal, ("plant", "faults", "fault", "kind"), jnp.float64(equipment_faults.KINDS.index(name))
        )
    # 0.063 deg of orbit a second: sunset or sunrise some 150 s after the start.
    anomaly = np.deg2rad(20.5 if name == SUNSET else 149.5)
    orbit = replace(nominal.orbit, raan=jnp.float64(ECLIPSE_RAAN), true_anomaly=jnp.float64(anomaly))
    return replace(nominal, orbit=orbit)


@partial(jax.jit, static_argnums=0)
def simulate_all(scenario: Scenario, params: Params, key: jax.Array) -> tuple[State, Telemetry]:
    """All cases as one batch, with the same random numbers."""

    def one(params: Params) -> tuple[State, Telemetry]:
        return rollout(scenario, params, initial_state.init(scenario, params, key), TICKS)

    return jax.vmap(one)(params)


Runs = dict[str, tuple[State, Telemetry]]


@cache
def nominal() -> tuple[ScenarioFile, Scenario, Params]:
    """The scenario, its static settings and the parameters that the cases change."""
    file = name_loop("faults", scenario_loader.load("inspection_faults", OVERRIDES))
    static = static_settings(file)
    return file, static, parameters.build_params(file.model_dump(), static.width_px, static.height_px)


def simulate_cases() -> Runs:
    """Final state and telemetry of every case."""
    _, static, params = nominal()
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *(case(params, name) for name in CASES))
    results = jax.tree.map(np.asarray, simulate_all(static, batch, run_key(1, 0)))
    return {name: jax.tree.map(lambda leaf, place=place: leaf[place], results) for place, name in enumerate(CASES)}
