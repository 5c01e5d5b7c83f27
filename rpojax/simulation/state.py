"""What a run carries from tick to tick, and what there is to see of a tick."""

from jaxtyping import Array

from rpojax.core.pytree import pytree
from rpojax.flight.computer import FlightMemory, Measurements
from rpojax.flight.navigation.orbit_filter import Innovation
from rpojax.physics.actuators import BurnError
from rpojax.physics.plant import Truth
from rpojax.sensors.geometric_camera import CameraFrame


@pytree
class SensorErrors:
    """Errors that outlive a tick.

    Attributes:
        gps_bias_N: (3,) [m]
        gyro_bias_B: (3,) [rad/s]
        box_edges: (4,) what lasts of the statistical camera's errors [1 sigma], None for other cameras
    """

    gps_bias_N: Array
    gyro_bias_B: Array
    box_edge_errors: Array | None


@pytree
class State:
    """Everything that changes during a run.

    Attributes:
        truth: the plant
        flight: memory of the flight software
        sensors: slowly varying sensor errors
        burn_error: execution error of the present burn
        keys: (streams, 2) one random key per stream
        tick: () whole ticks since the start
        failed_at: () time of failure [s], infinite while all is well
        failure: () 0 none, 1 non-finite, 2 keep-out
    """

    truth: Truth
    flight: FlightMemory
    sensor_errors: SensorErrors
    burn_error: BurnError
    keys: Array
    tick: Array
    failed_at: Array
    failure: Array


@pytree
class Telemetry:
    """One tick seen from outside, after sensing and navigation.

    Attributes:
        truth: the plant
        flight: memory of the flight software
        frame: the camera's frame
        measurements: what flight software got
        innovation: diagnostics of the orbit filter
        mode: () guidance mode
        tick: () whole ticks since the start
        running: () bool, the run had not failed
    """

    truth: Truth
    flight: FlightMemory
    frame: CameraFrame
    measurements: Measurements
    innovation: Innovation
    mode: Array
    tick: Array
    running: Array
