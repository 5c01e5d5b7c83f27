"""Records of a tick in progress: what its stages share, what they hand on, and the motion between two plant steps."""

import dataclasses
from dataclasses import dataclass
from typing import Any

from jaxtyping import Array

from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import pytree
from rpojax.flight import stage_use
from rpojax.flight.control.thruster_isolation import Isolation, OpenTime
from rpojax.flight.flight_records import FlightMemory, Measurements
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.flight.stages import Stages
from rpojax.flight.team_guidance.team_knowledge import KnownPeers
from rpojax.physics.equipment_faults import Health
from rpojax.physics.plant_state import Truth
from rpojax.physics.rcs_thrusters import RcsState
from rpojax.physics.thruster import BurnError
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.sensors.camera import CameraFrame
from rpojax.simulation.camera_models import camera_format
from rpojax.simulation.command_delay import CommandsUnderWay
from rpojax.simulation.noise import TickNoise
from rpojax.simulation.state import State, state_axes


@dataclass(frozen=True)
class Loop:
    """Closed loop of one run: what does not change from tick to tick.

    Attributes:
        scenario: static settings
        params: parameters of the run
        stages: replaceable parts of the flight software

    Raises:
        RpojaxError: `stages` replaces a stage that this scenario does not use.
    """

    scenario: Scenario
    params: Params
    stages: Stages

    @property
    def software(self) -> FlightSoftware:
        """Flight software of the servicer."""
        scenario = self.scenario
        return FlightSoftware(
            stages=self.stages,
            params=self.params.flight,
            filter=scenario.filter_settings,
            camera=camera_format(scenario),
            mission=scenario.mission,
            tick_s=scenario.tick_s,
            isolates=scenario.isolation,
        )

    def __post_init__(self) -> None:
        kinds = stage_use.kinds_of(self.scenario.camera_model, self.scenario.mission, self.scenario.team)
        stage_use.check(self.stages, kinds)
        stage_use.check_believed(self.stages, [each.name for each in self.scenario.filter_settings.sensors])
        stage_use.check_exposures(self.stages, self.scenario.filter_settings.memory_ticks)
        stage_use.check_picture(self.stages, self.scenario.camera_model)


@pytree
class Tick:
    """A tick in progress, which each stage takes and hands on.

    Attributes:
        state: at the beginning of the tick
        time: () since the start of the run [s]
        sky: positions of Sun and Moon
        health: of the equipment
        noise: random numbers of the tick
        frame: camera frame
        measurements: inputs of the flight software
        flight: memory of the flight software after the latest stage
        burn_error: execution error of the present burn
        innovation: of the orbit filter, None before navigation
        mode: () pointing mode, None before guidance
        confirmed: () bool, whether boxes of other servicers take the place of one of its own; None without other
            servicers
        peers: what is known of the other servicers, None unless a team is coordinated
        thrusters: true thrusters of the reaction control system, None without one
    """

    state: State
    time: Array
    sky: SunMoonPositions
    health: Health
    noise: TickNoise
    frame: CameraFrame
    measurements: Measurements
    flight: FlightMemory
    burn_error: BurnError
    innovation: Innovation | None = None
    mode: Array | None = None
    confirmed: Array | None = None
    peers: KnownPeers | None = None
    thrusters: RcsState | None = None


def tick_axes(axis: int) -> Tick:
    """Batch axis of each field of `Tick`: `axis`, or None for the tick number."""
    axes: dict[str, Any] = {field.name: axis for field in dataclasses.fields(Tick)}
    return Tick(**{**axes, "state": state_axes(axis)})


@pytree
class Motion:
    """State of the vehicle between two plant steps of a tick.

    Attributes:
        truth: state of the plant
        attitude: estimate propagated by the gyro
        delta_v_N: (3,) velocity change in this tick as expected by the flight software [m/s]
        owed: (n,) on-time that thrusters of the reaction control system owe [s], None without them
        fired: (n,) their on-time in this tick [s], None without them
        isolation: what is known of thrusters that are open without a command, None where they are not isolated
        uncommanded: for how long they were open so in this tick by their pressure, None alike
        commands: that wheels and valves have not got yet, None where they have each at once
    """

    truth: Truth
    attitude: AttitudeEstimate
    delta_v_N: Array
    owed: Array | None = None
    fired: Array | None = None
    isolation: Isolation | None = None
    uncommanded: OpenTime | None = None
    commands: CommandsUnderWay | None = None
