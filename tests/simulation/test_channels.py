"""Channels of a tick are computed on demand."""

import jax
import jax.numpy as jnp
import pytest

from rpojax.scenario import params as parameters
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.static_settings import static_settings
from rpojax.simulation import channels, initial_state
from rpojax.simulation.noise import run_key
from rpojax.simulation.state import State
from rpojax.simulation.telemetry import Telemetry

FILE = scenario_loader.load("inspection", ["initial.relative_velocity_m_s=[0.0, 0.002, 0.0]"])
SCENARIO = static_settings(FILE)
PARAMS = parameters.build_params(FILE.model_dump(), SCENARIO.width_px, SCENARIO.height_px)


def _telemetry(state: State, tick: jax.Array) -> Telemetry:
    return Telemetry(
        truth=state.truth,
        flight=state.flight,
        frame=None,
        measurements=None,
        innovation=None,
        mode=jnp.zeros((), dtype=jnp.int32),
        tick=tick,
        running=jnp.asarray(True),
        rho_desired_H=jnp.zeros(3),
    )


@pytest.fixture(scope="module")
def drifting_state() -> State:
    """State behind the target on its orbit, with a slow drift."""
    return jax.jit(initial_state.init, static_argnums=0)(SCENARIO, PARAMS, run_key(1, 0))


def test_quantities_that_nobody_asks_for_are_not_computed(drifting_state: State) -> None:
    def distance(state: State) -> jax.Array:
        tick = channels.ObservedTick(SCENARIO, PARAMS, _telemetry(state, jnp.int32(1)))
        return channels.evaluate(channels.CHANNELS, ["range_m"], tick)["range_m"]

    # Sum of squares, square root and its guard: neither Hill frame nor NEES.
    assert len(jax.make_jaxpr(distance)(drifting_state).eqns) < 12
