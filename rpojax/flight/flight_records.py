"""Records of the flight software: its tuning, its memory between ticks, and its measurements."""

from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array

from rpojax.core import lens_distortion
from rpojax.core.orbits.exponential_atmosphere import Atmosphere
from rpojax.core.pytree import pytree, replace
from rpojax.flight.control.attitude_control import AttitudeControlTuning
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.control.plume_rule import PlumeRule
from rpojax.flight.control.rcs_control import RcsCommand
from rpojax.flight.control.thruster_allocation import ThrusterLayout
from rpojax.flight.control.thruster_isolation import IsolationTuning
from rpojax.flight.guidance.attitude_guidance import PointingState
from rpojax.flight.guidance.burn_schedule import BurnPlan
from rpojax.flight.guidance.detector_window import CameraCommand
from rpojax.flight.guidance.lens_choice import BelievedWideLens, LensInUse
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.mission.mission_state import MissionState
from rpojax.flight.mission.phase_table import MissionTuning
from rpojax.flight.navigation.attitude_ekf import AttitudeEstimate, AttitudeFilterTuning
from rpojax.flight.navigation.believed_sensor import BelievedSensor
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, GpsMeasurement
from rpojax.flight.navigation.retrodiction import History
from rpojax.flight.navigation.target_attitude_ekf import BelievedTarget
from rpojax.flight.navigation.thrust_estimator import ThrustEstimate
from rpojax.flight.navigation_health import HealthTuning, NavigationHealth
from rpojax.flight.vehicle_model import VehicleModel


@pytree
class FlightParams:
    """Tuning of all flight software, its models of vehicle and air, and what it believes of additional sensors."""

    vehicle: VehicleModel
    navigation: OrbitFilterTuning
    attitude_filter: AttitudeFilterTuning
    formation: FormationTuning
    pointing: PointingTuning
    attitude_control: AttitudeControlTuning
    health: HealthTuning
    mission: MissionTuning
    atmosphere: Atmosphere
    isolation: IsolationTuning
    plume_rule: PlumeRule
    sensors: dict[str, dict[str, Array]] = field(default_factory=dict)
    thrusters: ThrusterLayout | None = None
    wide_lens: BelievedWideLens | None = None
    target: BelievedTarget | None = None

    def seen_through(self, lens: LensInUse | None) -> "FlightParams":
        """The same with focal length, distortion and edge noise of the lens in use, None without a second one."""
        wide = self.wide_lens
        if wide is None or lens is None:
            return self
        focal_px = jnp.where(lens.is_wide, wide.focal_px, self.vehicle.focal_px)
        navigation = self.navigation
        if wide.edge_noise is not None:
            edge_noise = jnp.where(lens.is_wide, wide.edge_noise, navigation.edge_noise)
            navigation = replace(navigation, edge_noise=edge_noise)
        distortion = lens_distortion.of_lens_in_use(self.vehicle.distortion, wide.distortion, lens.is_wide)
        vehicle = replace(self.vehicle, focal_px=focal_px, distortion=distortion)
        return replace(self, vehicle=vehicle, navigation=navigation)


@pytree
class FlightMemory:
    """State of the flight software.

    Attributes:
        orbit: estimate of both orbits
        gate: state of the outlier gate
        health: tests of the orbit filter, and confidence in it
        attitude: estimate of the attitude
        attitude_variance: () of the camera across its boresight at the last frame [rad^2]
        plan: latest decided burn
        thrust_estimate: estimated thrust
        thruster_failed_at: () when a burn last gave no thrust [s], minus infinity before
        pointing: state of the attitude guidance
        reopened: () bool, guidance has widened the estimate of the target in this tick, as a search of it has failed
        camera: latest command for an exposure
        wheel_allocation: (3, 3) body torque to wheel torques, solved once at start
        mission: state of the mission manager
        phase_gains: (places, 3, 6) gains of the formation controller over the orbit for each row of the phase table,
            solved once at start
        rejected_s: () for how long an additional sensor has been rejected while nothing else measured the target [s],
            by name; from `recovery_after` on the estimate is widened in this tick
        own: memory of replaced stages, empty without one
        rcs: command of the reaction control system, None without one
        history: of attitude and burns, for measurements that are late and not taken for those of now; else None
        lens: of the latest exposure, None unless the camera has two
    """

    orbit: OrbitEstimate
    gate: GateState
    health: NavigationHealth
    attitude: AttitudeEstimate
    attitude_variance: Array
    plan: BurnPlan
    thrust_estimate: ThrustEstimate
    thruster_failed_at: Array
    pointing: PointingState
    reopened: Array
    camera: CameraCommand
    wheel_allocation: Array
    mission: MissionState
    phase_gains: tuple[Array, ...]
    rejected_s: dict[str, Array] = field(default_factory=dict)
    own: Any = ()
    rcs: RcsCommand | None = None
    history: History | None = None
    lens: LensInUse | None = None


@dataclass(frozen=True)
class FilterSettings:
    """Static settings of the orbit filter.

    Attributes:
        gated: whether measurements must pass the gate
        zonal_degree: highest zonal harmonic of its gravity model
        sensors: the additional sensors that it believes
        memory_ticks: ticks that it remembers for late measurements, 0 if it takes each for one of now
    """

    gated: bool
    zonal_degree: int
    sensors: tuple[BelievedSensor, ...] = ()
    memory_ticks: int = 0


@pytree
class Measurements:
    """Measurements of one camera tick.

    Attributes:
        gps: position
        star_tracker_q_BN: (4,)
        star_tracker_present: () bool
        box: bounding box
        additional: measurements of additional sensors by name
        picture: (p, p, 3) that the detector got, None where no stage asks for it
        age: () time since its exposure by its time tag [s], of each sensor with late measurements, by name
        is_wide: () bool, the box is of a frame through the wide lens; None with one lens
        window: of the picture, None where no stage asks for it
    """

    gps: GpsMeasurement
    star_tracker_q_BN: Array
    star_tracker_present: Array
    box: BoxMeasurement
    additional: dict[str, Array] = field(default_factory=dict)
    picture: Array | None = None
    age: dict[str, Array] = field(default_factory=dict)
    is_wide: Array | None = None
    window: CameraCommand | None = None
