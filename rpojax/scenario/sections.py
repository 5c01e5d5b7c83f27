"""Schema of the sections of a scenario: orbit, spacecraft, sensors, flight software; one strict model each."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from rpojax.metrics.passive_safety import STANDARD_HORIZONS, horizon_length
from rpojax.physics.plant_options import FaultKind
from rpojax.value_types import (
    Angle,
    Axes,
    Covariance,
    Direction,
    Epoch,
    Finite,
    Hull,
    Inertia,
    NonNegative,
    NonNegativeAngle,
    NonNegativeVector,
    OptionalKeys,
    Positive,
    PositivePair,
    PositiveVector,
    Probability,
    Quaternion,
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


class OrbitSection(Section):
    """Osculating orbit of the target at the start."""

    semi_major_axis_m: Annotated[float, Field(gt=6.5e6, lt=1e8, allow_inf_nan=False)]
    eccentricity: Annotated[float, Field(ge=0.0, lt=0.9, allow_inf_nan=False)]
    inclination_deg: Annotated[float, Field(ge=0.0, le=180.0, allow_inf_nan=False)]
    raan_deg: Finite
    argument_of_perigee_deg: Finite
    true_anomaly_deg: Finite


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


class HandoverSection(OptionalKeys):
    """True errors of the orbits at hand-over in H, where they are not those that the filter is told."""

    position_sigma_m: NonNegative | NonNegativeVector | None = None
    velocity_sigma_m_s: NonNegative | NonNegativeVector | None = None
    relative_position_sigma_m: NonNegative | NonNegativeVector | None = None
    relative_velocity_sigma_m_s: NonNegative | NonNegativeVector | None = None
    covariance: Annotated[Covariance, Field(min_length=12, max_length=12)] | None = None

    @model_validator(mode="after")
    def _check_one_way(self) -> "HandoverSection":
        if self.covariance is not None and len(self.model_dump()) > 1:
            raise ValueError("expected a covariance or sigmas, not both")
        return self


class InitialSection(OptionalKeys):
    """State of the servicer relative to the target at the start, Hill frame, and errors of the hand-over."""

    relative_position_m: Vector
    relative_velocity_m_s: Vector
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


class AtmosphereSection(Section):
    """Exponential atmosphere."""

    density_kg_m3: NonNegative
    altitude_m: Finite
    scale_height_m: Positive
    rotation_rad_s: Finite


class SunlightSection(Section):
    """Solar flux."""

    flux_w_m2: NonNegative


class SurfaceSection(Section):
    """Surface exposed to drag and solar radiation pressure."""

    area_m2: NonNegative
    drag_coefficient: NonNegative
    pressure_coefficient: NonNegative
    center_of_pressure_m: Vector


class FaultSection(Section):
    """Fault of the servicer's equipment."""

    kind: FaultKind
    start_s: NonNegative
    duration_s: NonNegative
    severity: Probability
    wheel: Literal[0, 1, 2]


class ServicerSection(Section):
    """Mass properties of the servicer."""

    mass_kg: Positive
    inertia_kg_m2: Inertia


class TargetSection(Section):
    """Mass properties, outline and attitude motion of the target."""

    mass_kg: Positive
    inertia_kg_m2: Inertia
    hull_m: Hull
    scale: Positive = 1.0
    tumble_rate_deg_s: Finite
    tumble_axis: Direction
    attitude: Quaternion


class ThrusterSection(Section):
    """Thruster of the servicer."""

    force_n: Positive
    force_scale: Positive
    specific_impulse_s: Positive
    minimum_on_time_s: NonNegative
    rise_time_s: NonNegative
    fall_time_s: NonNegative
    position_m: Vector
    direction: Direction
    misalignment_deg: Vector
    tank_position_m: Vector
    magnitude_noise: NonNegative
    direction_noise_deg: NonNegative


class WheelsSection(Section):
    """Reaction wheels of the servicer."""

    axes: Axes
    inertia_kg_m2: PositiveVector
    torque_limit_n_m: PositiveVector
    speed_limit_rad_s: PositiveVector
    initial_speed_rad_s: Vector
    viscous_friction_n_m_s: NonNegativeVector
    coulomb_friction_n_m: NonNegativeVector
    stiction_speed_rad_s: Positive
    torque_step_n_m: Positive


class CameraSection(Section):
    """Camera, and errors of the geometric bounding-box model."""

    model: Literal["geometric", "statistical", "rendered"]
    width_px: Annotated[int, Field(ge=16, le=4096)]
    height_px: Annotated[int, Field(ge=16, le=4096)]
    field_of_view_deg: Angle
    mounting: Quaternion
    misalignment_deg: Vector
    edge_noise_px: NonNegative
    miss_probability: Probability
    minimum_size_px: NonNegative
    outlier_probability: Probability
    outlier_size_min_px: Positive
    outlier_size_max_px: Positive
    phase_limit_deg: Annotated[float, Field(gt=0.0, le=180.0, allow_inf_nan=False)]
    sun_exclusion_deg: NonNegativeAngle


class ImagingSection(Section):
    """Images and detector of the rendered and the statistical camera."""

    field: str
    detector: str
    statistics: str
    exposure: Positive
    full_well: Positive
    read_noise: NonNegative
    blur_px: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
    score_threshold: Probability
    center_sigma_m: NonNegative
    sky_seed: Annotated[int, Field(ge=0)]


class GpsSection(Section):
    """GPS receiver."""

    noise_m: NonNegative
    bias_sigma_m: NonNegative
    bias_time_constant_s: Positive
    common_share: Probability = 0.9


class StarTrackerSection(Section):
    """Star tracker."""

    noise_deg: NonNegativeVector
    misalignment_deg: Vector
    boresight: Direction
    sun_exclusion_deg: NonNegativeAngle


class GyroSection(Section):
    """Rate gyro."""

    angle_random_walk_deg_sqrt_s: NonNegative
    initial_bias_sigma_deg_s: NonNegative
    bias_walk_deg_s_sqrt_s: NonNegative


class ChamberPressureSection(Section):
    """Pressure sensor in the thruster's chamber."""

    enabled: bool = False
    noise: NonNegative = 0.03


class NavigationSection(Section):
    """Orbit filter and measurement gate."""

    gating: Literal["covariance", "none"]
    sharing: Literal["none", "boxes", "estimates", "central", "naive"] = "none"
    zonal_degree: ZonalDegree
    luni_solar: bool
    gps_noise_m: Positive
    gps_error_sigma_m: Positive
    gps_error_time_constant_s: Positive
    difference_noise_m: Positive = 2.83
    difference_error_sigma_m: Positive = 0.54
    difference_error_time_constant_s: Positive = 700.0
    difference_range_noise_m: Positive = 0.1
    difference_range_bias_sigma_m: NonNegative = 0.05
    edge_noise_px: Positive
    minimum_size_px: Positive = 4.0
    miss_probability: Annotated[float, Field(gt=0.0, lt=1.0, allow_inf_nan=False)] = 0.1
    center_sigma_m: NonNegative
    center_perspective: NonNegative = 0.152
    center_time_constant_s: Positive
    target_size_m: Positive
    target_size_sigma: NonNegative = 0.0
    outline_time_constant_s: Positive = 33.0
    largest_side_log: PositivePair = Field(default=[0.204, 0.124])
    scale_sigma: PositivePair
    scale_time_constant_s: PositivePair
    bearing_bias_sigma_deg: Positive
    attitude_sigma_deg: NonNegative
    acceleration_noise_m_s2_sqrt_hz: NonNegative
    relative_acceleration_noise_m_s2_sqrt_hz: NonNegative
    burn_magnitude_sigma: NonNegative
    burn_scale_sigma: NonNegative = 0.0
    burn_direction_sigma_deg: NonNegative
    thrust_sigma: Positive = 0.015
    thrust_walk_sqrt_s: Positive = 0.01
    pressure_noise: Positive = 0.03
    gate_sigma: Positive
    confirm_tolerance_deg_s: Positive
    confirm_above: Positive
    confirm_within_s: Positive
    recovery_after_s: Positive
    recovery_position_sigma: NonNegative
    recovery_velocity_sigma_m_s: NonNegative
    initial_position_sigma_m: Positive
    initial_velocity_sigma_m_s: Positive
    initial_relative_position_sigma_m: Positive
    initial_relative_velocity_sigma_m_s: Positive


class AttitudeFilterSection(Section):
    """Attitude estimator."""

    star_tracker_noise_deg: PositiveVector
    angle_random_walk_deg_sqrt_s: Positive
    bias_walk_deg_s_sqrt_s: NonNegative
    initial_bias_sigma_deg_s: Positive


class FormationSection(Section):
    """Formation-keeping LQR and its limits."""

    desired_position_m: Vector
    position_weight: NonNegativeVector
    velocity_weight: NonNegativeVector
    delta_v_weight: PositiveVector
    lead_s: NonNegative
    dead_band_mm_s: NonNegative
    range_uncertainty_limit: Positive
    thruster_retry_s: NonNegative


class PointingSection(Section):
    """Attitude guidance: slews, look-aways and search."""

    slew_acceleration_mrad_s2: Positive
    slew_minimum_time_s: Positive
    settle_time_s: NonNegative
    look_away_limit_s: Positive
    search_after_s: Positive
    acquisition_wait_s: Positive
    search_pitch_deg: Positive
    search_acceleration_mrad_s2: Positive
    search_sigmas: Positive
    search_radius_max_deg: Angle
    burn_attitude_limit_deg: Angle


class AttitudeControlSection(Section):
    """Attitude controller."""

    bandwidth_rad_s: Positive
    damping: Positive


class HealthSection(Section):
    """Tests of the orbit filter on board, and what follows from a loss of confidence."""

    time_constant_s: Positive
    alarm_sigma: Positive
    contradiction_limit: Positive
    size_limit: Positive
    unseen_limit_s: Positive
    range_limit: Positive
    regain: Annotated[float, Field(gt=0.0, le=1.0, allow_inf_nan=False)]
    clearance: Annotated[float, Field(ge=0.0, lt=1.0, allow_inf_nan=False)]


class LimitsSection(Section):
    """Limits of which the outcome of a run depends; entering the keep-out sphere ends it."""

    keep_out_m: NonNegative
    lost_after_s: Positive = 600.0
    off_station_m: Positive = 10.0
    arrive_by_s: NonNegative = 3000.0
    propellant_kg: Positive = 1e9


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


class LinkSection(OptionalKeys):
    """Radio links between the servicers of a team."""

    period_s: Positive = 1.0
    delay_s: Delay = 0.0
    loss: Probability = 0.0
    burst_loss: Probability = 1.0
    burst_interval_s: Positive = 1e9
    burst_duration_s: Positive = 10.0
    outages_s: list[NonNegativePair] = Field(default=[], max_length=16)
    hears: Annotated[list[NamePair], Field(max_length=56)] | None = None

    @model_validator(mode="after")
    def _check_windows(self) -> "LinkSection":
        for window in self.outages_s:
            if window[1] <= window[0]:
                raise ValueError(f"expected windows that end after they start, unlike outages_s = {window}")
        return self


class TeamSection(Section):
    """Guidance of a team: how the servicers keep clear of each other, and where on their relative orbit they are."""

    keep_out_m: NonNegative = 0.0
    phasing: Literal["fixed", "spread", "viewpoints"] = "fixed"
    lost_after_s: Positive = 60.0
    phase_rate_deg_h: Positive = 60.0
    view_incidence_deg: IncidenceLimit = 60.0
    view_sun_incidence_deg: IncidenceLimit = 70.0
    view_memory_s: Positive = 6000.0
    keeping_delta_v_m_s: Positive = 0.002


class GpsDifferencesSection(Section):
    """Differences of the GPS positions of two servicers, as the truth has them."""

    kind: Literal["code", "carrier"] = "code"
    noise_m: NonNegative = 0.05
    slow_error_m: NonNegative = 0.007
    slow_error_time_constant_s: Positive = 700.0


class LinkRangeSection(Section):
    """Ranges that servicers measure to each other over their links, as the truth has them."""

    enabled: bool = False
    noise_m: NonNegative = 0.1
    bias_sigma_m: NonNegative = 0.05


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
