"""Control laws, burn plans and simulated guidance for the tests."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import rendezvous_scene
from numpy_reference import (
    rotation_matrix,
)

from rpojax.core.pytree import replace
from rpojax.core.vectors import apply_transposed
from rpojax.flight.control.attitude_control import AttitudeCommand
from rpojax.flight.decisions.motion_prediction import predict_to_burn
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import attitude_guidance, burn_schedule, slew_profile, target_pointing
from rpojax.flight.guidance.attitude_guidance import GuidanceTick, PointingState
from rpojax.flight.guidance.burn_schedule import BurnPlan
from rpojax.flight.guidance.pointing_tuning import GuidanceSoftware
from rpojax.flight.guidance.target_acquisition import Sighting
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

GAIN = np.zeros((3, 6))
YES, NO = jnp.asarray(True), jnp.asarray(False)
SAMPLES = 5
Law = Callable[[jax.Array, jax.Array], jax.Array]
TIME = np.float64(1000.0)  # of the decision
evaluate = jax.jit(slew_profile.evaluate)
look_attitude = jax.jit(target_pointing.look_attitude)


def guidance_of(flight: FlightParams, dt: float = 1.0) -> GuidanceSoftware:
    """Guidance at a tick every `dt` [s]."""
    return replace(rendezvous_scene.software(flight), tick_s=dt).guidance


@partial(jax.jit, static_argnums=3)
def guide(
    flight: FlightParams, state: PointingState, tick: GuidanceTick, dt: float = 1.0
) -> tuple[PointingState, jax.Array]:
    return attitude_guidance.guide(guidance_of(flight, dt), state, tick)


@partial(jax.jit, static_argnums=(0, 5))
def plan_burn(
    law: Law,
    flight: FlightParams,
    estimate: OrbitEstimate,
    q_look: jax.Array,
    allowed: jax.Array,
    dt: float,
) -> BurnPlan:
    """Burn plan for the velocity change of a law, with guidance every `dt` [s]."""
    predicted = predict_to_burn(flight, estimate)
    desired_H = jnp.concatenate([flight.formation.desired_position, jnp.zeros(3)])
    delta_v_N = apply_transposed(predicted.R_CN, law(GAIN, predicted.burn_state_H - desired_H))
    return burn_schedule.schedule_burn(guidance_of(flight, dt), delta_v_N, q_look, allowed, jnp.asarray(TIME))


def push_back(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """20 mm/s backwards along the track."""
    return jnp.array([0.0, -0.02, 0.0])


def push_hard(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """1 m/s, more than the look-away limit allows."""
    return jnp.array([0.0, -1.0, 0.0])


def push_gently(gain: jax.Array, deviation: jax.Array) -> jax.Array:
    """0.9 mm/s, inside the dead band."""
    return jnp.array([0.0, 9e-4, 0.0])


def plan(
    law: Law,
    flight: FlightParams,
    estimate: OrbitEstimate,
    allowed: bool = True,
    dt: float = 1.0,
) -> BurnPlan:
    q_look, _ = look_attitude(flight.vehicle, estimate)
    found = plan_burn(law, flight, estimate, q_look, np.asarray(allowed), dt)
    return jax.tree.map(np.asarray, found)


def boresight(flight: FlightParams, q_BN: np.ndarray) -> np.ndarray:
    """Direction in N that the camera looks along; the nominal mounting is along body x."""
    return rotation_matrix(np.asarray(q_BN)).T @ np.array([1.0, 0.0, 0.0])


@partial(jax.jit, static_argnums=7)
def simulate(
    flight: FlightParams,
    estimate: OrbitEstimate,
    plan: BurnPlan,
    state: PointingState,
    times: jax.Array,
    blind: jax.Array,
    visible: jax.Array = YES,
    dt: float = 1.0,
) -> tuple[jax.Array, AttitudeCommand, jax.Array]:
    """Modes, commands five times per tick of `dt` [s], and whether a box was accepted, tick by tick.

    A box is accepted when the camera looks within 5 deg of the target, unless `blind`.
    """
    line = estimate.relative.r_TS_N / jnp.sqrt(jnp.sum(estimate.relative.r_TS_N**2))

    def body(
        state: PointingState, time: jax.Array
    ) -> tuple[PointingState, tuple[jax.Array, AttitudeCommand, jax.Array]]:
        q_BN = slew_profile.evaluate(state.reference, jnp.full((), dt)).q_CN
        looks = attitude_guidance.rotate(attitude_guidance.quaternion.conjugate(q_BN), jnp.array([1.0, 0.0, 0.0]))
        accepted = (jnp.sum(looks * line) > jnp.cos(jnp.deg2rad(5.0))) & ~blind
        tick = GuidanceTick(
            time=time,
            estimate=estimate,
            plan=plan,
            sighting=Sighting(seen=accepted, promising=accepted & ~accepted),
            visible=visible,
        )
        state, mode = guide(flight, state, tick, dt)
        ages = dt * jnp.arange(SAMPLES, dtype=jnp.float64) / SAMPLES
        return state, (mode, jax.vmap(lambda age: slew_profile.evaluate(state.reference, age))(ages), accepted)

    return jax.lax.scan(body, state, times)[1]


def simulate_search(
    flight: FlightParams, position_sigma: float, ticks: int, dt: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Modes and commanded attitudes (ticks, samples, 4) of a search for a target that is never seen."""
    known = rendezvous_scene.estimate(flight, v_TS_N=np.zeros(3), position_sigma=position_sigma)
    state = attitude_guidance.initial_pointing(flight.vehicle, known)
    modes, commands, _ = simulate(
        flight, known, burn_schedule.no_burn(), state, TIME + dt * np.arange(float(ticks)), np.asarray(True), YES, dt
    )
    return np.asarray(modes), np.asarray(commands.q_CN)


def look(
    flight: FlightParams,
    known: OrbitEstimate,
    frames: str,
    state: PointingState | None = None,
    plan: BurnPlan | None = None,
    visible: jax.Array = YES,
    dt: float = 1.0,
) -> PointingState:
    """State after frames with an accepted box ('x'), with one that may be the target's ('?') and without ('.')."""
    state = attitude_guidance.initial_pointing(flight.vehicle, known) if state is None else state
    for tick, frame in enumerate(frames):
        sighting = Sighting(seen=np.asarray(frame == "x"), promising=np.asarray(frame == "?"))
        inputs = GuidanceTick(
            time=TIME + dt * tick,
            estimate=known,
            plan=burn_schedule.no_burn() if plan is None else plan,
            sighting=sighting,
            visible=visible,
        )
        state, _ = guide(flight, state, inputs, dt)
    return state
