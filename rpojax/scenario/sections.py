"""Schema of the sections of a scenario: orbit, spacecraft, sensors, flight software; one strict model each."""

from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field, model_validator

from rpojax.core.lamp import Lamp
from rpojax.core.orbits.exponential_atmosphere import Atmosphere
from rpojax.core.orbits.keplerian_elements import KeplerianElements
from rpojax.flight.control.attitude_control import AttitudeControlTuning
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.flight.control.plume_rule import PlumeRule
from rpojax.flight.control.thruster_isolation import IsolationTuning
from rpojax.flight.cooperation.team_settings import BaselineTuning
from rpojax.flight.guidance.lens_choice import BelievedWideLens
from rpojax.flight.guidance.pointing_tuning import PointingTuning
from rpojax.flight.navigation.attitude_ekf import AttitudeFilterTuning
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation_health import HealthTuning
from rpojax.flight.team_guidance.team_situation import TeamTuning
from rpojax.metrics.passive_safety import STANDARD_HORIZONS, horizon_length
from rpojax.physics.environment.solar_radiation_pressure import Sunlight
from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.physics.equipment_faults import Fault
from rpojax.physics.plant_state import Target
from rpojax.physics.plume_impingement import Plume
from rpojax.physics.radio_link import RadioLink
from rpojax.physics.rcs_thrusters import IsolationValves, RcsThruster
from rpojax.physics.reaction_wheels import ReactionWheels
from rpojax.physics.rigid_body import Body
from rpojax.physics.thruster import Thruster
from rpojax.scenario.numbers.number_sections import section_of
from rpojax.scenario.numbers.start_and_limits import HandoverErrors, InitialRelativeState, Limits
from rpojax.sensors.camera import Camera, WideLens
from rpojax.sensors.chamber_pressure import ChamberPressure
from rpojax.sensors.gps import Gps, GpsDifferences
from rpojax.sensors.gyro import Gyro
from rpojax.sensors.imaging import Imaging
from rpojax.sensors.link_range import LinkRange
from rpojax.sensors.measurement_delay import MeasurementDelay
from rpojax.sensors.star_tracker import StarTracker
from rpojax.value_types import (
    Covariance,
    Epoch,
    Finite,
    NonNegative,
    OptionalKeys,
    Positive,
    Section,
    Vector,
)


def _check_horizon(value: str) -> str:
    horizon_length(value)
    return value


NonNegativePair = Annotated[list[NonNegative], Field(min_length=2, max_length=2)]
NamePair = Annotated[list[str], Field(min_length=2, max_length=2)]
Delay = Annotated[float, Field(ge=0.0, le=60.0, allow_inf_nan=False)]
IncidenceLimit = Annotated[float, Field(gt=0.0, le=90.0, allow_inf_nan=False)]


class RatesSection(Section):
    """Rates of plant, camera and burn decisions."""

    plant_hz: Annotated[float, Field(gt=0.0, le=1000.0, allow_inf_nan=False)]
    camera_hz: Positive
    formation_period_s: Positive
    command_delay_s: Delay = 0.0


class OrbitSection(section_of(KeplerianElements)):
    """Osculating orbit of the target at the start."""


Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
MessageKind = Literal["OEM", "OMM", "OPM", "TLE"]


class StartSection(OptionalKeys):
    """Files from which epoch and orbits were taken, and what was read; no simulation depends on it."""

    target: str
    servicer: str | None = None
    epoch_utc: Epoch | None = None
    target_sha256: Sha256
    target_format: MessageKind
    target_object: str
    target_frame: str
    target_position_m: Vector
    target_velocity_m_s: Vector
    target_interpolation_error_m: NonNegative | None = None
    servicer_sha256: Sha256 | None = None
    servicer_format: MessageKind | None = None
    servicer_object: str | None = None
    servicer_frame: str | None = None
    servicer_position_m: Vector | None = None
    servicer_velocity_m_s: Vector | None = None
    servicer_interpolation_error_m: NonNegative | None = None


class HandoverSection(section_of(HandoverErrors, name="initial.handover", optional=True)):
    """True errors of the orbits at hand-over in H, where they are not those that the filter is told."""

    covariance: Annotated[Covariance, Field(min_length=12, max_length=12)] | None = None

    @model_validator(mode="after")
    def _check_one_way(self) -> "HandoverSection":
        if self.covariance is not None and len(self.model_dump()) > 1:
            raise ValueError("expected a covariance or sigmas, not both")
        return self


class InitialSection(section_of(InitialRelativeState, optional=True)):
    """State of the servicer relative to the target at the start, Hill frame, and errors of the hand-over."""

    handover: HandoverSection | None = None


ZonalDegree = Literal[0, 2, 3, 4, 5, 6]


class EffectsSection(Section):
    """Model switches of the plant; what is off is not compiled."""

    integrator: Literal["rk4", "rk8"]
    zonal_degree: ZonalDegree
    sun_gravity: bool
    moon_gravity: bool
    drag: bool
    solar_pressure: bool
    gravity_gradient: bool
    wheel_friction: bool
    wheel_torque_steps: bool
    thruster_ramps: bool
    center_of_mass_shift: bool
    faults: bool
    plume: bool = False
    inertia_change: bool = False


class AtmosphereSection(section_of(Atmosphere)):
    """Exponential atmosphere."""


class SunlightSection(section_of(Sunlight)):
    """Solar flux."""


class SurfaceSection(section_of(Surface)):
    """Surface exposed to drag and solar radiation pressure."""


Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]


class FaultSection(section_of(Fault)):
    """Fault of the servicer's equipment."""

    name: Name


class ServicerSection(section_of(Body)):
    """Mass properties of the servicer."""


class TargetSection(section_of(Target)):
    """Mass properties, outline and attitude motion of the target."""


class ThrusterSection(section_of(Thruster)):
    """Thruster of the servicer."""


class RcsThrusterSection(section_of(RcsThruster)):
    """Thruster of the reaction control system."""

    name: Name


class IsolationSection(section_of(IsolationValves, IsolationTuning, name="isolation", first=("enabled",))):
    """Isolation valves of the reaction control system, and when flight software shuts them."""

    enabled: bool = False


class PlumeSection(section_of(Plume, PlumeRule, name="plume")):
    """Plumes of the thrusters of the reaction control system, and when they may not point at the target."""


class WheelsSection(section_of(ReactionWheels)):
    """Reaction wheels of the servicer."""


NO_LANDMARKS: Final = "none"
"""Value of `camera.landmarks` of a camera that finds none."""


class CameraSection(
    section_of(
        Camera, MeasurementDelay, name="camera", first=("model", "landmarks", "width_px", "height_px"), optional=True
    )
):
    """Camera, and errors of the geometric bounding-box model."""

    model: Literal["geometric", "statistical", "rendered"]
    landmarks: str = NO_LANDMARKS
    width_px: Annotated[int, Field(ge=16, le=4096)]
    height_px: Annotated[int, Field(ge=16, le=4096)]


class ImagingSection(
    section_of(Imaging, OrbitFilterTuning, name="imaging", first=("field", "detector", "statistics"), optional=True)
):
    """Images and detector of the rendered and the statistical camera."""

    field: str
    detector: str
    statistics: str
    landmark_network: str = "packaged"
    sky_seed: Annotated[int, Field(ge=0)]


class WideLensSection(
    section_of(WideLens, BelievedWideLens, name="wide_lens", first=("field_of_view", "switch", "return"), optional=True)
):
    """Second, wider lens of the camera, through which it looks near the target."""

    statistics: Annotated[str, Field(min_length=1)] | None = None


class LampSection(section_of(Lamp)):
    """Lamp of the servicer that lights the target."""


class GpsSection(section_of(Gps)):
    """GPS receiver."""


class StarTrackerSection(section_of(StarTracker)):
    """Star tracker."""


class GyroSection(section_of(Gyro)):
    """Rate gyro."""


class ChamberPressureSection(section_of(ChamberPressure, first=("enabled",))):
    """Pressure sensor in the thruster's chamber."""

    enabled: bool = False


class NavigationSection(
    section_of(
        OrbitFilterTuning,
        BaselineTuning,
        name="navigation",
        first=("gating", "sharing", "zonal_degree", "luni_solar", "gps_", "difference_"),
    )
):
    """Orbit filter and measurement gate."""

    gating: Literal["covariance", "none"]
    sharing: Literal["none", "boxes", "estimates", "central", "naive"] = "none"
    zonal_degree: ZonalDegree
    luni_solar: bool
    delays: Literal["compensated", "ignored"] = "compensated"
    delay_memory_s: Delay = 0.0


class AttitudeFilterSection(section_of(AttitudeFilterTuning)):
    """Attitude estimator."""


class FormationSection(section_of(FormationTuning)):
    """Formation-keeping LQR and its limits."""


class PointingSection(section_of(PointingTuning)):
    """Attitude guidance: slews, look-aways and search."""


class AttitudeControlSection(section_of(AttitudeControlTuning)):
    """Attitude controller."""


class HealthSection(section_of(HealthTuning)):
    """Tests of the orbit filter on board, and what follows from a loss of confidence."""


class LimitsSection(section_of(Limits)):
    """Limits of which the outcome of a run depends; entering the keep-out sphere ends it."""


class SafetySection(Section):
    """Free drifts from which passive safety is judged."""

    horizons: list[Annotated[str, AfterValidator(_check_horizon)]] = Field(
        default=list(STANDARD_HORIZONS), min_length=1
    )
    spacing_s: Positive = 10.0
    stuck_on_s: Annotated[float, Field(ge=0.0, le=300.0, allow_inf_nan=False)] = 30.0


class CoverageSection(Section):
    """Surface of the target whose inspection is judged, and what counts as seen."""

    enabled: bool = False
    surface: Annotated[str, Field(min_length=1)] = "hull"
    mesh_units: Literal["m", "cm", "mm", "in", "ft"] = "m"
    facet_size_m: Positive = 0.1
    incidence_limit_deg: IncidenceLimit = 60.0
    sun_incidence_limit_deg: IncidenceLimit = 70.0
    resolution_limit_m_px: Positive = 0.05
    spacing_s: Positive = 10.0


class LinkSection(section_of(RadioLink, first=("period_s", "delay_s"), optional=True)):
    """Radio links between the servicers of a team."""

    period_s: Positive = 1.0
    delay_s: Delay = 0.0
    outages_s: list[NonNegativePair] = Field(default=[], max_length=16)
    hears: Annotated[list[NamePair], Field(max_length=56)] | None = None

    @model_validator(mode="after")
    def _check_windows(self) -> "LinkSection":
        for window in self.outages_s:
            if window[1] <= window[0]:
                raise ValueError(f"expected windows that end after they start, unlike outages_s = {window}")
        return self


class TeamSection(section_of(TeamTuning, first=("keep_out_m", "phasing"))):
    """Guidance of a team: how the servicers keep clear of each other, and where on their relative orbit they are."""

    phasing: Literal["fixed", "spread", "viewpoints"] = "fixed"


class GpsDifferencesSection(section_of(GpsDifferences, first=("kind",))):
    """Differences of the GPS positions of two servicers, as the truth has them."""

    kind: Literal["code", "carrier"] = "code"


class LinkRangeSection(section_of(LinkRange, first=("enabled",))):
    """Ranges that servicers measure to each other over their links, as the truth has them."""

    enabled: bool = False


class TuningSection(OptionalKeys):
    """Weights of the objective that `rpojax tune` minimises; no simulation depends on them.

    `metrics` has weights of further metrics by name, negative where more is better.
    """

    innovations: NonNegative = 1.0
    estimate: NonNegative = 3.0
    consistency: NonNegative = 1.0
    navigation: NonNegative = 1.0
    formation: NonNegative = 0.5
    delta_v: NonNegative = 0.15
    pointing: NonNegative = 0.05
    metrics: dict[str, Finite] | None = None
