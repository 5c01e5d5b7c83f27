"""Static settings of a run: the hashable part of a scenario, for which the simulation is compiled."""

from dataclasses import dataclass, replace

from rpojax.errors import ScenarioError
from rpojax.flight.computer import LANDMARKS
from rpojax.flight.cooperation.team_settings import TeamSettings
from rpojax.flight.flight_records import FilterSettings
from rpojax.flight.mission.static_mission_settings import MissionSettings
from rpojax.flight.navigation.believed_sensor import BelievedSensor
from rpojax.flight.navigation.relative_filter_state import LANDMARK_NETWORK
from rpojax.physics.plant_options import Effects
from rpojax.scenario.measurement_delays import DelaySettings, delay_settings
from rpojax.scenario.mission_from_phases import mission_settings
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import member_files
from rpojax.scenario.team.team_options import team_settings
from rpojax.scenario.trained import image_sampling
from rpojax.sensors.additional.additional_sensor import AdditionalSensor
from rpojax.sensors.additional.registry import present_sensors
from rpojax.vision.radiance_field.ray_budget import RaySampling


@dataclass(frozen=True)
class Scenario:
    """Static settings of a run; changing one recompiles the simulation.

    Attributes:
        ticks: camera ticks of a run
        tick_s: camera, filter and guidance period [s]
        substeps: plant and attitude control steps per tick
        formation_ticks: ticks between burn decisions
        width_px: image width
        height_px: image height
        camera_model: `geometric`, `statistical` or `rendered`
        box_gating: whether boxes must pass the covariance gate
        navigation_zonal_degree: highest zonal harmonic in the gravity model of the orbit filter
        navigation_luni_solar: whether the orbit filter models the attraction of Sun and Moon
        effects: model switches of the plant
        ray_sampling: of rendered images, None for other camera models
        mission: static settings of its phases
        chamber_pressure: whether the thruster's chamber pressure is measured
        additional_sensors: names and classes of the additional sensors
        team: static settings of a team of servicers, None for a servicer alone
        thrusters: number of those of the reaction control system
        command_steps: plant steps until wheels and valves have a command
        delays: of measurements, None where flight software has each at once
        isolation: whether flight software shuts off those that are open without a command, by their pressure sensors
        temperature: of a detector whose boxes and scores are smooth, for derivatives of a rendered loop, in log-odds;
            None for one that decides, as in runs
    """

    ticks: int
    tick_s: float
    substeps: int
    formation_ticks: int
    width_px: int
    height_px: int
    camera_model: str
    box_gating: bool
    navigation_zonal_degree: int
    navigation_luni_solar: bool
    effects: Effects
    ray_sampling: RaySampling | None
    mission: MissionSettings
    chamber_pressure: bool = False
    additional_sensors: tuple[tuple[str, type[AdditionalSensor]], ...] = ()
    team: TeamSettings | None = None
    thrusters: int = 0
    command_steps: int = 0
    delays: DelaySettings | None = None
    isolation: bool = False
    temperature: float | None = None

    @property
    def _believed_sensors(self) -> list[tuple[str, type[AdditionalSensor]]]:
        """Names and classes of the additional sensors that the filter believes."""
        return [(name, each) for name, each in self.additional_sensors if each.is_believed()]

    @property
    def filter_settings(self) -> FilterSettings:
        """Static settings of the orbit filter."""
        sensors = tuple(BelievedSensor(name, each.rows, each.row_count) for name, each in self._believed_sensors)
        memory = 0 if self.delays is None or not self.delays.compensated else self.delays.slots
        return FilterSettings(self.box_gating, self.navigation_zonal_degree, sensors, memory)

    @property
    def shown_states(self) -> list[str]:
        """Names of what gives states to the filter beside those of all: the sensors that it believes, and a network."""
        believed = [name for name, _ in self._believed_sensors]
        by_network = self.has_landmarks and self.camera_model != "geometric"
        return [*believed, LANDMARK_NETWORK] if by_network else believed

    @property
    def has_landmarks(self) -> bool:
        """Whether the camera finds landmarks of the target."""
        return LANDMARKS in dict(self.additional_sensors)

    @property
    def direction_sensors(self) -> list[str]:
        """Names of the sensors whose use by the filter shows that the target is where it should be."""
        additional = [name for name, each in self._believed_sensors if each.shows_direction]
        return ["box", *additional]

    @property
    def step_s(self) -> float:
        """Plant step [s]."""
        return self.tick_s / self.substeps

    @property
    def formation_period_s(self) -> float:
        """Time between burn decisions [s]."""
        return self.tick_s * self.formation_ticks


def static_settings(file: ScenarioFile, allow_single: bool = False, allow_team: bool = False) -> Scenario:
    """Static settings of a validated scenario.

    Those of the servicers of a team are equal, as its checks demand; `team` has what they have together.

    Args:
        file: the scenario
        allow_single: whether the caller can simulate in single precision
        allow_team: whether the caller can simulate several servicers

    Raises:
        ScenarioError: the scenario has single precision or several servicers, which the caller does not support.
    """
    if file.precision == "single" and not allow_single:
        raise ScenarioError("precision", file.precision, "'double', as only run, campaign and bench know 'single'")
    if file.servicers and not allow_team:
        raise ScenarioError(
            "servicers", f"{len(file.servicers)} of them", "none, as only campaigns and runs know teams"
        )
    if file.servicers:
        own, team = static_settings(member_files(file)[0], allow_single), team_settings(file)
        mission = replace(
            own.mission,
            coordinated=team.coordinated,
            servicers=team.servicers,
            keeps_clear=file.team.keep_out_m > 0.0,
            phasing=file.team.phasing,
        )
        return replace(own, mission=mission, team=team)
    rates = file.rates
    return Scenario(
        ticks=round(file.duration_s * rates.camera_hz),
        tick_s=1.0 / rates.camera_hz,
        substeps=round(rates.plant_hz / rates.camera_hz),
        formation_ticks=round(rates.formation_period_s * rates.camera_hz),
        width_px=file.camera.width_px,
        height_px=file.camera.height_px,
        camera_model=file.camera.model,
        box_gating=file.navigation.gating == "covariance",
        navigation_zonal_degree=file.navigation.zonal_degree,
        navigation_luni_solar=file.navigation.luni_solar,
        effects=Effects(**file.effects.model_dump()),
        ray_sampling=image_sampling.sampling_for_model(file.model_dump()),
        chamber_pressure=file.chamber_pressure.enabled,
        additional_sensors=tuple((name, type(sensor)) for name, sensor in present_sensors(file).items()),
        mission=mission_settings(file),
        thrusters=len(file.thrusters),
        command_steps=round(rates.command_delay_s * rates.plant_hz),
        delays=delay_settings(file),
        isolation=file.isolates_thrusters,
    )
