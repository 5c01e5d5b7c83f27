"""Schema of a whole scenario file; free of JAX, so that validation is instant."""

from typing import Annotated, Literal

from pydantic import Field

from rpojax.scenario.design_kinds import Design, IndependentDesign
from rpojax.scenario.dispersion_kinds import Dispersion
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
from rpojax.scenario.value_types import Epoch, Finite, MetricName, Positive, Section


class RequirementSection(Section):
    """Bound that a metric must satisfy with at least a given probability."""

    metric: MetricName
    bound: Literal["at most", "at least"]
    limit: Finite
    probability: Annotated[float, Field(gt=0.0, lt=1.0, allow_inf_nan=False)]
    consumer_risk: Annotated[float, Field(gt=0.0, lt=0.5, allow_inf_nan=False)]


class ScenarioFile(Section):
    """A whole scenario, in the units of its keys."""

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
