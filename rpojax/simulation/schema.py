"""The form of a scenario file: strict models, one section each; free of jax, so that checking a file is instant."""

import difflib
import math
from datetime import UTC, date, datetime
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from rpojax.physics.effects import FaultKind
from rpojax.simulation.figures_of_merit import UNITS

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)]
Angle = Annotated[float, Field(gt=0.0, lt=180.0, allow_inf_nan=False)]
Vector = Annotated[list[Finite], Field(min_length=3, max_length=3)]
PositiveVector = Annotated[list[Positive], Field(min_length=3, max_length=3)]
NonNegativeVector = Annotated[list[NonNegative], Field(min_length=3, max_length=3)]
PositivePair = Annotated[list[Positive], Field(min_length=2, max_length=2)]


_SHORTEST = 1e-6
"""A direction or quaternion shorter than this is taken for a zero: its unit vector would be noise."""


def _nonzero(value: list[float]) -> list[float]:
    if math.hypot(*value) < _SHORTEST:
        raise ValueError(f"expected a vector that is not zero, at least {_SHORTEST:g} long")
    return value


def _inertia(value: list[list[float]]) -> list[list[float]]:
    matrix = np.array(value)
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=0.0):
        raise ValueError("expected a symmetric matrix")
    principal = np.linalg.eigvalsh(matrix)
    if principal[0] <= 0.0:
        raise ValueError("expected a positive definite matrix")
    if principal[2] > (principal[0] + principal[1]) * (1.0 + 1e-9):
        raise ValueError("expected principal moments of a real body: the largest at most the sum of the others")
    return value


def _invertible(value: list[list[float]]) -> list[list[float]]:
    rows = np.array(value)
    if not np.allclose(np.linalg.norm(rows, axis=1), 1.0, atol=1e-6):
        raise ValueError("expected unit vectors, one a row")
    if abs(np.linalg.det(rows)) < 1e-3:
        raise ValueError("expected three axes that span space")
    return value


def _covariance(value: list[list[float]]) -> list[list[float]]:
    if any(len(row) != len(value) for row in value):
        raise ValueError("expected as many columns as rows")
    matrix = np.array(value)
    sigma = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    # Of unit variances, so that metres beside millimetres per second do not hide a fault.
    scale = np.outer(*(2 * [np.where(sigma > 0.0, sigma, 1.0)]))
    correlation = matrix / scale
    if not np.allclose(correlation, correlation.T, rtol=0.0, atol=1e-9):
        raise ValueError("expected a symmetric matrix")
    if np.any(np.diag(matrix) < 0.0) or np.linalg.eigvalsh(correlation)[0] < -1e-9:
        raise ValueError("expected a positive semidefinite matrix")
    return value


def _as_text(value: Any) -> Any:
    """TOML has dates of its own; unquoted they arrive as such."""
    return value.isoformat() if isinstance(value, date) else value


def _epoch(value: str) -> str:
    try:
        seconds = epoch_seconds(value)
    except (ValueError, OverflowError):
        raise ValueError("expected a date and time such as '2026-03-20T14:46:00'") from None
    if abs(seconds) > _EPHEMERIS_SPAN_S:
        raise ValueError("expected a date from 1950 to 2050, for which Sun and Moon are known well")
    return value


_EPHEMERIS_SPAN_S = 50.0 * 365.25 * 86400.0


def epoch_seconds(utc: str) -> float:
    """Seconds of terrestrial time from 2000-01-01 12:00 to a date and time in UTC."""
    moment = datetime.fromisoformat(utc)
    if moment.tzinfo is not None:
        moment = moment.astimezone(UTC).replace(tzinfo=None)
    return (moment - datetime(2000, 1, 1, 12)).total_seconds() + _TERRESTRIAL_LESS_UTC_S


_TERRESTRIAL_LESS_UTC_S = 69.184
"""Since 2017; the Sun moves by three millionths of a radian in that time."""


def _metric(value: str) -> str:
    if value not in UNITS:
        close = difflib.get_close_matches(value, UNITS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ", such as 'formation_error_rms_m'"
        raise ValueError(f"expected the name of a metric{hint}")
    return value


Metric = Annotated[str, AfterValidator(_metric), Field(json_schema_extra={"enum": list(UNITS)})]
Epoch = Annotated[str, BeforeValidator(_as_text), AfterValidator(_epoch)]
Direction = Annotated[Vector, AfterValidator(_nonzero)]
Quaternion = Annotated[list[Finite], Field(min_length=4, max_length=4), AfterValidator(_nonzero)]
Rows3 = Annotated[list[Vector], Field(min_length=3, max_length=3)]
Inertia = Annotated[Rows3, AfterValidator(_inertia)]
Axes = Annotated[Rows3, AfterValidator(_invertible)]
Covariance = Annotated[list[list[Finite]], Field(min_length=1, max_length=64), AfterValidator(_covariance)]
Hull = Annotated[list[Vector], Field(min_length=4, max_length=64)]


class Section(BaseModel):
    """Base of all sections: unknown keys are refused, types are not converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Rates(Section):
    """How often things happen."""

    plant_hz: Annotated[float, Field(gt=0.0, le=1000.0, allow_inf_nan=False)]
    camera_hz: Positive
    formation_period_s: Positive


class OrbitSection(Section):
    """Orbit of the target at the start."""

    semi_major_axis_m: Annotated[float, Field(gt=6.5e6, lt=1e8, allow_inf_nan=False)]
    eccentricity: Annotated[float, Field(ge=0.0, lt=0.9, allow_inf_nan=False)]
    inclination_deg: Annotated[float, Field(ge=0.0, le=180.0, allow_inf_nan=False)]
    raan_deg: Finite
    argument_of_perigee_deg: Finite
    true_anomaly_deg: Finite


class InitialSection(Section):
    """Servicer from target at the start, Hill frame."""

    relative_position_m: Vector
    relative_velocity_m_s: Vector


ZonalDegree = Literal[0, 2, 3, 4, 5, 6]


class EffectsSection(Section):
    """What the plant takes into account; what is off costs nothing."""

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
    """Air that thins out exponentially."""

    density_kg_m3: NonNegative
    altitude_m: Finite
    scale_height_m: Positive
    rotation_rad_s: Finite


class SunlightSection(Section):
    """Strength of sunlight."""

    flux_w_m2: NonNegative


class SurfaceSection(Section):
    """What air and light push on."""

    area_m2: NonNegative
    drag_coefficient: NonNegative
    pressure_coefficient: NonNegative
    center_of_pressure_m: Vector


class FaultSection(Section):
    """A fault of the servicer's equipment."""

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
    """The target as it is."""

    mass_kg: Positive
    inertia_kg_m2: Inertia
    hull_m: Hull
    tumble_rate_deg_s: Finite
    tumble_axis: Direction
    attitude: Quaternion


class ThrusterSection(Section):
    """The servicer's one thruster."""

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
    """The servicer's three reaction wheels."""

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
    """Camera and bounding-box detector."""

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
    sun_exclusion_deg: Annotated[float, Field(ge=0.0, lt=180.0, allow_inf_nan=False)]


class ImagingSection(Section):
    """Pictures and the detector that looks at them; counts for the rendered and the statistical camera."""

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


class StarTrackerSection(Section):
    """Star tracker."""

    noise_deg: NonNegativeVector
    misalignment_deg: Vector
    boresight: Direction
    sun_exclusion_deg: Annotated[float, Field(ge=0.0, lt=180.0, allow_inf_nan=False)]


class GyroSection(Section):
    """Rate gyro."""

    angle_random_walk_deg_sqrt_s: NonNegative
    initial_bias_sigma_deg_s: NonNegative
    bias_walk_deg_s_sqrt_s: NonNegative


class NavigationSection(Section):
    """Orbit filter and gate."""

    gating: Literal["covariance", "none"]
    zonal_degree: ZonalDegree
    luni_solar: bool
    gps_noise_m: Positive
    gps_error_sigma_m: Positive
    gps_error_time_constant_s: Positive
    edge_noise_px: Positive
    center_sigma_m: NonNegative
    center_time_constant_s: Positive
    target_size_m: Positive
    scale_sigma: PositivePair
    scale_time_constant_s: PositivePair
    bearing_bias_sigma_deg: Positive
    attitude_sigma_deg: NonNegative
    acceleration_noise_m_s2_sqrt_hz: NonNegative
    relative_acceleration_noise_m_s2_sqrt_hz: NonNegative
    burn_magnitude_sigma: NonNegative
    burn_direction_sigma_deg: NonNegative
    gate_sigma: Positive
    confirm_tolerance_px: Positive
    confirm_above: Positive
    confirm_frames: Positive
    rejections_before_recovery: Positive
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
    """LQR and its limits."""

    desired_position_m: Vector
    position_weight: NonNegativeVector
    velocity_weight: NonNegativeVector
    delta_v_weight: PositiveVector
    lead_s: NonNegative
    dead_band_mm_s: NonNegative
    range_uncertainty_limit: Positive
    thruster_retry_s: NonNegative


class PointingSection(Section):
    """Slews and search."""

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


class LimitsSection(Section):
    """What ends a run."""

    keep_out_m: NonNegative


class Normal(Section):
    """Nominal value plus a normal error, per component."""

    key: str
    kind: Literal["normal"]
    sigma: NonNegative | list[NonNegative]


class TruncatedNormal(Section):
    """Nominal value plus a normal error, redrawn beyond `limit_sigmas`."""

    key: str
    kind: Literal["truncated_normal"]
    sigma: NonNegative | list[NonNegative]
    limit_sigmas: Positive


class Uniform(Section):
    """Uniform between two values, per component."""

    key: str
    kind: Literal["uniform"]
    low: Finite
    high: Finite

    @model_validator(mode="after")
    def _ordered(self) -> "Uniform":
        if self.low > self.high:
            raise ValueError("expected low at most high")
        return self


class LogNormal(Section):
    """Nominal value times the exponential of a normal number, per component."""

    key: str
    kind: Literal["log_normal"]
    sigma: NonNegative | list[NonNegative]


class Choice(Section):
    """One of several values, all equally likely."""

    key: str
    kind: Literal["choice"]
    values: Annotated[list[Finite] | list[list[Finite]] | list[FaultKind], Field(min_length=1)]


class RandomDirection(Section):
    """Unit vector, uniform over the sphere."""

    key: str
    kind: Literal["direction"]


class RandomAttitude(Section):
    """Quaternion, uniform over all attitudes."""

    key: str
    kind: Literal["attitude"]


class SmallRotation(Section):
    """Nominal quaternion turned by a small normal rotation vector."""

    key: str
    kind: Literal["small_rotation"]
    sigma_deg: NonNegative | list[NonNegative]


class CorrelatedNormal(Section):
    """Nominal values plus normal errors that depend on one another; a vector key stands for its components."""

    keys: Annotated[list[str], Field(min_length=1, max_length=64)]
    kind: Literal["correlated_normal"]
    covariance: Covariance


class Term(Section):
    """A multiple of another number of the same run."""

    key: str
    factor: Finite


class Derived(Section):
    """What follows from other numbers of the same run, drawn or nominal: an offset plus a sum of terms."""

    key: str
    kind: Literal["derived"]
    offset: Finite | list[Finite]
    terms: Annotated[list[Term], Field(min_length=1, max_length=64)]


Dispersion = Annotated[
    Normal
    | TruncatedNormal
    | Uniform
    | LogNormal
    | Choice
    | RandomDirection
    | RandomAttitude
    | SmallRotation
    | CorrelatedNormal
    | Derived,
    Field(discriminator="kind"),
]


class RequirementSection(Section):
    """A bound that a metric must keep in at least a share of all runs that could be made."""

    metric: Metric
    bound: Literal["at most", "at least"]
    limit: Finite
    probability: Annotated[float, Field(gt=0.0, lt=1.0, allow_inf_nan=False)]
    consumer_risk: Annotated[float, Field(gt=0.0, lt=0.5, allow_inf_nan=False)]


class IndependentDesign(Section):
    """Every run draws for itself."""

    kind: Literal["independent"]


class LatinHypercubeDesign(Section):
    """Runs that fill the range of every dispersed number evenly."""

    kind: Literal["latin_hypercube"]


class SobolDesign(Section):
    """Runs that fill the space of all dispersed numbers evenly."""

    kind: Literal["sobol"]


class TableDesign(Section):
    """Values of some keys for each run, from a CSV file; once loaded, they are in `values` and `file` is empty."""

    kind: Literal["table"]
    file: str = ""
    values: dict[str, list[Finite] | list[FaultKind]] = {}


class GridDesign(Section):
    """Every combination of some values of some keys; the last key changes from run to run."""

    kind: Literal["grid"]
    values: Annotated[
        dict[str, Annotated[list[Finite] | list[list[Finite]] | list[FaultKind], Field(min_length=1)]],
        Field(min_length=1, max_length=64),
    ]


Design = Annotated[
    IndependentDesign | LatinHypercubeDesign | SobolDesign | TableDesign | GridDesign, Field(discriminator="kind")
]


class ScenarioFile(Section):
    """A whole scenario, in the user's units."""

    name: Annotated[str, Field(min_length=1)]
    description: str
    duration_s: Positive
    epoch_utc: Epoch
    effects: EffectsSection
    rates: Rates
    orbit: OrbitSection
    initial: InitialSection
    atmosphere: AtmosphereSection
    sunlight: SunlightSection
    servicer: ServicerSection
    servicer_surface: SurfaceSection
    target: TargetSection
    target_surface: SurfaceSection
    thruster: ThrusterSection
    wheels: WheelsSection
    camera: CameraSection
    imaging: ImagingSection
    gps: GpsSection
    star_tracker: StarTrackerSection
    gyro: GyroSection
    navigation: NavigationSection
    attitude_filter: AttitudeFilterSection
    formation: FormationSection
    pointing: PointingSection
    attitude_control: AttitudeControlSection
    limits: LimitsSection
    fault: FaultSection
    dispersions: list[Dispersion]
    requirements: list[RequirementSection] = []
    design: Design = IndependentDesign(kind="independent")


def nominal(file: ScenarioFile, key: str) -> Any:
    """Value of a key such as `servicer.mass_kg` as numbers, or None if the key names no dispersable number."""
    section_name, _, name = key.partition(".")
    section = getattr(file, section_name, None) if section_name in ScenarioFile.model_fields else None
    if (
        not isinstance(section, Section)
        or isinstance(section, Rates | EffectsSection)
        or name not in type(section).model_fields
    ):
        return None
    value = getattr(section, name)
    if isinstance(section, FaultSection) and name == "kind":
        return float(get_args(FaultKind).index(value))
    if isinstance(section, FaultSection) and name == "wheel":
        return float(value)
    return None if isinstance(value, str | int | bool) else value
