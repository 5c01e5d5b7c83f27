"""Telemetry of one tick."""

import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.flight.flight_records import FlightMemory, Measurements
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.physics.plant_state import Truth
from rpojax.sensors.camera import CameraFrame
from rpojax.simulation.tick import Tick


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
    """

    truth: Truth
    flight: FlightMemory
    frame: CameraFrame
    measurements: Measurements
    innovation: Innovation
    mode: Array
    tick: Array
    running: Array


def telemetry_of(tick: Tick) -> Telemetry:
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
    )
