"""Telemetry of one tick."""

from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.flight.computer import FlightMemory, Measurements
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.physics.plant_state import Truth
from rpojax.sensors.camera import CameraFrame


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
