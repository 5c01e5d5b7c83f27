"""Schema of a whole scenario file; free of JAX, so that validation is instant."""

import difflib
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from rpojax.dispersions.designs.design_kinds import Design, IndependentDesign
from rpojax.dispersions.kinds.registry import Dispersion
from rpojax.metrics.metric_catalogue import UNITS, is_of_campaigns
from rpojax.scenario.phases.phase_sections import MissionSection, PhaseSection
from rpojax.scenario.sections import (
    AtmosphereSection,
    AttitudeControlSection,
    AttitudeFilterSection,
    CameraSection,
    CoverageSection,
    EffectsSection,
    FaultSection,
    FormationSection,
    GpsSection,
    GyroSection,
    HealthSection,
    ImagingSection,
    InitialSection,
    LimitsSection,
    NavigationSection,
    OrbitSection,
    PointingSection,
    RatesSection,
    SafetySection,
    ServicerSection,
    StarTrackerSection,
    SunlightSection,
    SurfaceSection,
    TargetSection,
    ThrusterSection,
    TuningSection,
    WheelsSection,
)
from rpojax.sensors.additional.registry import AdditionalSensors
from rpojax.value_types import Epoch, Finite, Positive, Section


def _check_metric_name(value: str) -> str:
    if not is_of_campaigns(value):
        close = difflib.get_close_matches(value, UNITS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ", such as 'formation_error_rms_m'"
        raise ValueError(f"expected the name of a metric{hint}")
    return value


MetricName = Annotated[str, AfterValidator(_check_metric_name), Field(json_schema_extra={"enum": list(UNITS)})]


class RequirementSection(Section):
    """Bound that a metric must satisfy with at least a given probability."""

    metric: MetricName
    bound: Literal["at most", "at least"]
    limit: Finite
    probability: Annotated[float, Field(gt=0.0, lt=1.0, allow_inf_nan=False)]
    consumer_risk: Annotated[float, Field(gt=0.0, lt=0.5, allow_inf_nan=False)]


class ScenarioFile(AdditionalSensors):
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
    health: HealthSection
    limits: LimitsSection
    safety: SafetySection = SafetySection()
    coverage: CoverageSection = CoverageSection()
    fault: FaultSection
    mission: MissionSection = MissionSection()
    phases: list[PhaseSection] = Field(default_factory=list, max_length=12)
    dispersions: list[Dispersion]
    requirements: list[RequirementSection] = Field(default_factory=list)
    tuning: TuningSection = TuningSection()
    design: Design = IndependentDesign(kind="independent")
