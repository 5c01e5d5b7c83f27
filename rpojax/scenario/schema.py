"""Schema of a whole scenario file: its sections, most of them of declared numbers."""

import difflib
import functools
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, create_model, model_validator

from rpojax.core.constants import RADIUS_EARTH
from rpojax.dispersions.designs.design_sections import Design, IndependentDesign
from rpojax.dispersions.kinds.registry import Dispersion
from rpojax.flight.mission.static_mission_settings import BUILT_IN_PHASES
from rpojax.metrics.metric_catalogue import UNITS, is_of_campaigns
from rpojax.metrics.time_windows import MetricWindow
from rpojax.scenario.phases.phase_sections import (
    CorridorSection,
    GoalSection,
    MissionSection,
    PhaseName,
    PhaseSection,
)
from rpojax.scenario.sections import (
    NO_LANDMARKS,
    AtmosphereSection,
    AttitudeControlSection,
    AttitudeFilterSection,
    CameraSection,
    ChamberPressureSection,
    CoverageSection,
    EffectsSection,
    FaultSection,
    FormationSection,
    GpsDifferencesSection,
    GpsSection,
    GyroSection,
    HealthSection,
    ImagingSection,
    InitialSection,
    IsolationSection,
    LampSection,
    LimitsSection,
    LinkRangeSection,
    LinkSection,
    Name,
    NavigationSection,
    OrbitSection,
    PlumeSection,
    PointingSection,
    RatesSection,
    RcsThrusterSection,
    SafetySection,
    ServicerSection,
    StarTrackerSection,
    StartSection,
    SunlightSection,
    SurfaceSection,
    TargetSection,
    TeamSection,
    ThrusterSection,
    TuningSection,
    WheelsSection,
    WideLensSection,
)
from rpojax.sensors.additional.additional_sensor import AdditionalSensor
from rpojax.sensors.additional.registry import AdditionalSensors
from rpojax.summary_text import Summarised, Summary, counted, numbers
from rpojax.value_types import ChangesOf, Epoch, Finite, NonNegative, OptionalKeys, Positive


def _check_metric_name(value: str) -> str:
    if not is_of_campaigns(value):
        close = difflib.get_close_matches(value, UNITS, n=1)
        hint = f" (did you mean {close[0]!r}?)" if close else ", such as 'formation_error_rms_m'"
        raise ValueError(f"expected the name of a metric{hint}")
    return value


MetricName = Annotated[str, AfterValidator(_check_metric_name), Field(json_schema_extra={"enum": list(UNITS)})]


OutcomeName = Literal[
    "completed", "non_finite", "keep_out", "out_of_propellant", "lost", "diverged", "off_station", "aborted",
    "unfinished", "not_judged",
]  # fmt: skip


class RequirementSection(OptionalKeys):
    """Bound that a metric, or the metric in a window, must satisfy with at least a given probability."""

    metric: MetricName
    bound: Literal["at most", "at least"]
    limit: Finite
    probability: Annotated[float, Field(gt=0.0, lt=1.0, allow_inf_nan=False)]
    consumer_risk: Annotated[float, Field(gt=0.0, lt=0.5, allow_inf_nan=False)]
    phase: str | None = None
    at: Literal["begin", "end"] | None = None
    from_s: NonNegative | None = None
    to_s: NonNegative | None = None
    outcome: OutcomeName | None = None
    among: Literal["all_runs", "reaching_runs"] | None = None

    @property
    def window(self) -> MetricWindow:
        """Ticks that count; the metric's own where none is named."""
        return MetricWindow(self.phase, self.at, self.from_s, self.to_s)

    @property
    def metric_name(self) -> str:
        """Name of the metric, in the window if there is one."""
        return self.metric + self.window.suffix

    @property
    def is_of_reaching_runs(self) -> bool:
        """Whether runs that never come to the phase are left out, in place of violating it."""
        return self.phase is not None and self.among == "reaching_runs"

    @property
    def is_of_all_runs(self) -> bool:
        """Whether the metric of every whole run counts: without a window and an outcome."""
        return not self.window.suffix and self.outcome is None


MAX_THRUSTERS: Final = 24
"""Most thrusters of a reaction control system."""
MAX_FAULTS: Final = 8
"""Most faults of a run; the compiled program grows with them."""
MAX_SERVICERS: Final = 8
"""Most servicers of a team; the filters' states and the compiled program grow with them."""
_PHASE = ChangesOf(PhaseSection, nested=(("corridor", CorridorSection),), tables=("reference",), without=("name",))


class ServicerChanges(OptionalKeys):
    """One servicer of a team: its name, and the keys of the scenario's sections that differ."""

    name: Name
    decision_offset_s: NonNegative | None = None
    initial: Annotated[OptionalKeys, ChangesOf(InitialSection)] | None = None
    servicer: Annotated[OptionalKeys, ChangesOf(ServicerSection)] | None = None
    servicer_surface: Annotated[OptionalKeys, ChangesOf(SurfaceSection)] | None = None
    thruster: Annotated[OptionalKeys, ChangesOf(ThrusterSection)] | None = None
    wheels: Annotated[OptionalKeys, ChangesOf(WheelsSection)] | None = None
    camera: Annotated[OptionalKeys, ChangesOf(CameraSection)] | None = None
    imaging: Annotated[OptionalKeys, ChangesOf(ImagingSection)] | None = None
    gps: Annotated[OptionalKeys, ChangesOf(GpsSection)] | None = None
    star_tracker: Annotated[OptionalKeys, ChangesOf(StarTrackerSection)] | None = None
    gyro: Annotated[OptionalKeys, ChangesOf(GyroSection)] | None = None
    chamber_pressure: Annotated[OptionalKeys, ChangesOf(ChamberPressureSection)] | None = None
    navigation: Annotated[OptionalKeys, ChangesOf(NavigationSection)] | None = None
    attitude_filter: Annotated[OptionalKeys, ChangesOf(AttitudeFilterSection)] | None = None
    formation: Annotated[OptionalKeys, ChangesOf(FormationSection)] | None = None
    pointing: Annotated[OptionalKeys, ChangesOf(PointingSection)] | None = None
    attitude_control: Annotated[OptionalKeys, ChangesOf(AttitudeControlSection)] | None = None
    health: Annotated[OptionalKeys, ChangesOf(HealthSection)] | None = None
    limits: Annotated[OptionalKeys, ChangesOf(LimitsSection)] | None = None
    faults: dict[Name, Annotated[OptionalKeys, ChangesOf(FaultSection, without=("name",))]] | None = None
    mission: Annotated[OptionalKeys, ChangesOf(MissionSection)] | None = None
    goal: GoalSection | None = None
    phases: dict[PhaseName, Annotated[OptionalKeys, _PHASE]] | None = None

    @property
    def tables(self) -> dict[str, Any]:
        """Keys that differ, by section, and by phase in `phases`."""
        return self.model_dump(exclude={"name", "decision_offset_s"})


FORMAT_VERSION: Final = 4
"""Version of the format of scenario files; `scenario/loading/format_migration.py` says what changed."""


class ScenarioFile(Summarised, AdditionalSensors):
    """A whole scenario, in the units of its keys."""

    format_version: Annotated[int, Field(ge=FORMAT_VERSION, le=FORMAT_VERSION)] = FORMAT_VERSION
    name: Annotated[str, Field(min_length=1)]
    description: str
    duration_s: Positive
    precision: Literal["double", "single"] = "double"
    plugin: Annotated[str, Field(min_length=1)] | None = None
    plugin_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")] | None = None
    epoch_utc: Epoch
    effects: EffectsSection
    rates: RatesSection
    start: StartSection | None = None
    orbit: OrbitSection
    initial: InitialSection
    atmosphere: AtmosphereSection
    sunlight: SunlightSection
    servicer: ServicerSection
    servicer_surface: SurfaceSection
    target: TargetSection
    target_surface: SurfaceSection
    thruster: ThrusterSection
    thrusters: list[RcsThrusterSection] = Field(default_factory=list, max_length=MAX_THRUSTERS)
    plume: PlumeSection = PlumeSection()
    isolation: IsolationSection = IsolationSection()
    wheels: WheelsSection
    camera: CameraSection
    imaging: ImagingSection
    wide_lens: WideLensSection | None = None
    lamp: LampSection | None = None
    gps: GpsSection
    star_tracker: StarTrackerSection
    gyro: GyroSection
    chamber_pressure: ChamberPressureSection = ChamberPressureSection()
    navigation: NavigationSection
    attitude_filter: AttitudeFilterSection
    formation: FormationSection
    pointing: PointingSection
    attitude_control: AttitudeControlSection
    health: HealthSection
    limits: LimitsSection
    safety: SafetySection = SafetySection()
    coverage: CoverageSection = CoverageSection()
    faults: list[FaultSection] = Field(default_factory=list, max_length=MAX_FAULTS)
    mission: MissionSection = MissionSection()
    goal: GoalSection = GoalSection()
    phases: list[PhaseSection] = Field(default_factory=list, max_length=12)
    servicers: list[ServicerChanges] = Field(default_factory=list, max_length=MAX_SERVICERS)
    link: LinkSection = LinkSection()
    team: TeamSection = TeamSection()
    gps_differences: GpsDifferencesSection = GpsDifferencesSection()
    link_range: LinkRangeSection = LinkRangeSection()
    dispersions: list[Dispersion]
    requirements: list[RequirementSection] = Field(default_factory=list)
    tuning: TuningSection = TuningSection()
    design: Design = IndependentDesign(kind="independent")

    @model_validator(mode="before")
    @classmethod
    def _with_landmarks(cls, data: Any) -> Any:
        """Tables with the section of landmarks, of the numbers by default, where the camera finds some."""
        camera = data.get("camera") if isinstance(data, dict) else None
        finds = isinstance(camera, dict) and camera.get("landmarks", NO_LANDMARKS) != NO_LANDMARKS
        return {**data, "landmarks": {}} if finds and data.get("landmarks") is None else data

    @property
    def phase_names(self) -> tuple[str, ...]:
        """Names of the phases in the order of the channel `phase`, none in a mission without phases."""
        return (*(phase.name for phase in self.phases), *BUILT_IN_PHASES) if self.phases else ()

    @property
    def turns_for_burns(self) -> bool:
        """Whether there is a phase in which the servicer turns to burn with its one thruster."""
        return not self.phases or any(phase.control == "burns" for phase in self.phases)

    @property
    def ends_at_port(self) -> bool:
        """Whether the last phase is in the frame of the target, before its docking port."""
        return bool(self.phases) and self.phases[-1].frame == "target"

    @property
    def isolates_thrusters(self) -> bool:
        """Whether flight software shuts off thrusters that are open without a command."""
        return self.isolation.enabled and self.chamber_pressure.enabled and bool(self.thrusters)

    @classmethod
    def absent_keys(cls) -> Iterable[str]:
        """Further keys that are left out where they are None."""
        return ("plugin", "plugin_sha256", "start", "wide_lens", "lamp")

    def _summary(self) -> Summary:
        return Summary(f"Scenario {self.name}: {self.description}", list(_summary_rows(self)))


def _summary_rows(file: ScenarioFile) -> Iterator[tuple[str, str]]:
    """Names and values of the lines of a scenario's summary."""
    orbit, servicer, camera = file.orbit, file.servicer, file.camera
    altitude_km = (orbit.semi_major_axis_m - RADIUS_EARTH) / 1e3
    start = "" if file.start is None else ", replaced by that of [start]"
    yield "time", f"{file.duration_s:g} s from {file.epoch_utc} UTC"
    yield "orbit", f"{altitude_km:,.0f} km, eccentricity {orbit.eccentricity:g}, {orbit.inclination_deg:g} deg{start}"
    place = numbers(file.initial.relative_position_m)
    yield "servicer", f"{servicer.mass_kg:g} kg, {file.thruster.force_n:g} N, from {place} m in the Hill frame"
    if file.servicers:
        yield "servicers", ", ".join(each.name for each in file.servicers)
    yield "target", f"{file.target.mass_kg:g} kg, tumbling at {file.target.tumble_rate_deg_s:g} deg/s"
    yield "camera", f"{camera.model}, {camera.width_px} x {camera.height_px} px, {camera.field_of_view_deg:g} deg"
    if file.wide_lens is not None:
        yield "wide lens", f"{file.wide_lens.field_of_view_deg:g} deg below {file.wide_lens.switch_range_m:g} m"
    if file.lamp is not None:
        yield "lamp", f"to {file.lamp.reach_m:g} m, within {file.lamp.beam_half_angle_deg:g} deg of its boresight"
    if file.phases:
        yield "phases", ", ".join(phase.name for phase in file.phases)
    yield "dispersed", f"{counted(len(file.dispersions), 'dispersion')}, {file.design.kind} draws"
    for each in file.requirements:
        limit = f"{each.limit:g} {UNITS.get(each.metric, '-').replace('-', '')}".strip()
        yield "required", f"{each.metric_name} {each.bound} {limit} in {100.0 * each.probability:g} % of runs"
    if file.plugin is not None:
        yield "plugin", file.plugin


@functools.cache
def with_sensors(sensors: tuple[tuple[str, type[AdditionalSensor]], ...]) -> type[ScenarioFile]:
    """Schema of a whole scenario with the sections of further additional sensors."""
    fields: dict[str, Any] = {name: (cls | None, None) for name, cls in sensors}
    return create_model("ScenarioFile", __base__=ScenarioFile, __doc__=ScenarioFile.__doc__, **fields)
