"""A whole scenario: sections, dispersions, design and requirements; free of jax, so that checking one is instant."""

from typing import Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from rpojax.physics.plant_options import FaultKind
from rpojax.scenario.field_types import Covariance, Epoch, Finite, MetricName, NonNegative, Positive, Section
from rpojax.scenario.sections import (
    AtmosphereSection,
    AttitudeControlSection,
    AttitudeFilterSection,
    CameraSection,
    EffectsSection,
    FaultSection,
    FormationSection,
    GpsSection,
    GyroSection,
    ImagingSection,
    InitialSection,
    LimitsSection,
    NavigationSection,
    OrbitSection,
    PointingSection,
    RatesSection,
    ServicerSection,
    StarTrackerSection,
    SunlightSection,
    SurfaceSection,
    TargetSection,
    ThrusterSection,
    TuningSection,
    WheelsSection,
)


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

    metric: MetricName
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
    values: dict[str, list[Finite] | list[FaultKind]] = Field(default_factory=dict)


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
    precision: Literal["double", "single"] = "double"
    epoch_utc: Epoch
    effects: EffectsSection
    rates: RatesSection
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
    requirements: list[RequirementSection] = Field(default_factory=list)
    tuning: TuningSection = TuningSection()
    design: Design = IndependentDesign(kind="independent")


def nominal_value(file: ScenarioFile, key: str) -> Any:
    """Value of a key such as `servicer.mass_kg` as numbers, or None if the key names no dispersable number."""
    section_name, _, name = key.partition(".")
    section = getattr(file, section_name, None) if section_name in ScenarioFile.model_fields else None
    if (
        not isinstance(section, Section)
        or isinstance(section, RatesSection | EffectsSection | TuningSection)
        or name not in type(section).model_fields
    ):
        return None
    value = getattr(section, name)
    if isinstance(section, FaultSection) and name == "kind":
        return float(get_args(FaultKind).index(value))
    if isinstance(section, FaultSection) and name == "wheel":
        return float(value)
    return None if isinstance(value, str | int | bool) else value
