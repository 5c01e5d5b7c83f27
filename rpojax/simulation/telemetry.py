"""Telemetry of one tick, and the estimation errors of the orbit filter in it."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core.frames import hill_frame
from rpojax.core.numerics import double_single
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.pytree import pytree
from rpojax.flight.decisions import phase_goal
from rpojax.flight.flight_records import FlightMemory, Measurements
from rpojax.flight.guidance import target_frame
from rpojax.flight.guidance.target_frame import TargetFrame
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.physics.plant_state import Truth
from rpojax.scenario.params import Params
from rpojax.sensors.camera import CameraFrame
from rpojax.simulation.tick import Loop, Tick


@pytree
class Telemetry:
    """Quantities of one tick, after navigation and guidance.

    Attributes:
        truth: state of the plant at the beginning of the tick
        flight: memory of the flight software
        frame: camera frame, with its errors
        measurements: inputs of the flight software
        innovation: of the orbit filter
        mode: () guidance mode
        tick: () ticks since the start
        running: () bool, whether the run has not failed
        rho_desired_H: (3,) position of the present phase's reference [m]
    """

    truth: Truth
    flight: FlightMemory
    frame: CameraFrame
    measurements: Measurements
    innovation: Innovation
    mode: Array
    tick: Array
    running: Array
    rho_desired_H: Array


def telemetry_of(loop: Loop, tick: Tick) -> Telemetry:
    """Telemetry of a tick after guidance."""
    assert tick.innovation is not None
    assert tick.mode is not None
    return Telemetry(
        truth=tick.state.truth,
        flight=tick.flight,
        frame=tick.frame,
        measurements=tick.measurements,
        innovation=tick.innovation,
        mode=tick.mode,
        tick=tick.state.tick,
        running=jnp.isinf(tick.state.failed_at),
        rho_desired_H=_desired_position(loop, tick),
    )


def _desired_position(loop: Loop, tick: Tick) -> Array:
    """Position in H of the present phase's reference (3,), for the true orbit and attitude of the target."""
    truth = tick.state.truth
    frame = true_target_frame(loop.params, truth) if any(loop.software.mission.in_target_frame) else None
    orbit = yamanaka_ankersen.target_orbit(truth.r_TN_N, truth.v_TN_N)
    return phase_goal.desired_state(loop.software, tick.flight.mission, orbit, frame, tick.time)[:3]


def true_target_frame(params: Params, truth: Truth) -> TargetFrame:
    """Frame of the target of a scenario whose camera finds landmarks."""
    axes, inertia = hill_frame(truth.r_TN_N, truth.v_TN_N), params.plant.target.inertia
    return target_frame.of_target(truth.q_TN, truth.omega_TN_T, inertia, params.mesh_offset, *axes)


def orbit_errors(telemetry: Telemetry) -> tuple[Float[Array, "6"], Float[Array, "6"]]:
    """Estimate minus truth in N [m, m/s]: state of the servicer, and of the target relative to it."""
    truth, servicer, relative = telemetry.truth, telemetry.flight.orbit.servicer, telemetry.flight.orbit.relative
    low, true_low = (each.orbit_low if each.orbit_low is not None else (None, None) for each in (servicer, truth))
    return (
        jnp.concatenate(
            [
                double_single.subtract(servicer.r_SN_N, low[0], truth.r_TN_N, true_low[0]) - truth.r_ST_N,
                double_single.subtract(servicer.v_SN_N, low[1], truth.v_TN_N, true_low[1]) - truth.v_ST_N,
            ]
        ),
        jnp.concatenate([relative.r_TS_N + truth.r_ST_N, relative.v_TS_N + truth.v_ST_N]),
    )
