"""State of a run between ticks."""

import dataclasses
from dataclasses import field
from typing import Any

from jaxtyping import Array

from rpojax.core.frames import hill_frame, inertial_to_hill
from rpojax.core.pytree import pytree
from rpojax.flight.flight_records import FlightMemory
from rpojax.physics.plant_state import Truth
from rpojax.physics.thruster import BurnError
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors.measurement_delay import InTransit
from rpojax.simulation.command_delay import CommandsUnderWay


@pytree
class SensorErrors:
    """Sensor errors that are correlated over ticks.

    Attributes:
        gps_bias_N: (3,) [m]
        gyro_bias_B: (3,) [rad/s]
        box_edge_errors: (4,) normalised errors of the statistical camera's box edges, None for other cameras
        landmark_errors: (m,) likewise of its landmarks, None without any
    """

    gps_bias_N: Array
    gyro_bias_B: Array
    box_edge_errors: Array | None
    landmark_errors: Array | None = None


@pytree
class State:
    """State of a run at the beginning of a tick.

    Attributes:
        truth: state of the plant
        flight: memory of the flight software
        sensor_errors: slowly varying sensor errors
        burn_error: execution error of the present burn
        keys: (streams, 2) one random key per stream
        tick: () int32, ticks since the start
        failed_at: () time of failure [s], infinite for a run that has not failed
        failure: () int32, code of the outcome that froze the run, else 0
        commands: that wheels and valves have not got yet, None where they have each at once
        in_transit: late measurements that flight software has not got yet, by sensor; empty without any
    """

    truth: Truth
    flight: FlightMemory
    sensor_errors: SensorErrors
    burn_error: BurnError
    keys: Array
    tick: Array
    failed_at: Array
    failure: Array
    commands: CommandsUnderWay | None = None
    in_transit: dict[str, InTransit] = field(default_factory=dict)


def state_axes(axis: int) -> State:
    """Batch axis of each field of `State`: `axis`, but None for the tick, which is the same for all runs.

    An unbatched tick makes the burn decision a true branch, taken on one tick in two hundred.
    """
    axes: dict[str, Any] = {each.name: axis for each in dataclasses.fields(State)}
    return State(**{**axes, "tick": None})


def elapsed_time(scenario: Scenario, truth: Truth, tick: Array) -> Array:
    """Time () since the start of the run at the beginning of a tick [s], in the precision of the simulation."""
    return tick.astype(truth.r_ST_N.dtype) * scenario.tick_s


def true_relative_state(truth: Truth) -> tuple[Array, Array]:
    """True relative position `rho_H` [m] and velocity `rho_dot_H` [m/s] of the servicer."""
    R_HN, omega_HN_N = hill_frame(truth.r_TN_N, truth.v_TN_N)
    return inertial_to_hill(truth.r_ST_N, truth.v_ST_N, R_HN, omega_HN_N)
