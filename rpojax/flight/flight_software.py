"""Flight software of one servicer: what does not change from tick to tick, bound once."""

from dataclasses import dataclass

from rpojax.flight.flight_records import FilterSettings, FlightParams
from rpojax.flight.guidance.detector_window import CameraFormat
from rpojax.flight.guidance.pointing_tuning import GuidanceSoftware
from rpojax.flight.mission.static_mission_settings import MissionSettings
from rpojax.flight.stages import Stages


@dataclass(frozen=True, eq=False)
class FlightSoftware:
    """Flight software of one servicer.

    Attributes:
        stages: replaceable parts
        params: tuning, vehicle model, and what it believes of sensors
        filter: static settings of the orbit filter
        camera: sizes of the camera's images
        mission: static settings of the phases
        tick_s: time between guidance ticks [s]
        isolates: whether it shuts off thrusters that are open without a command
    """

    stages: Stages
    params: FlightParams
    filter: FilterSettings
    camera: CameraFormat
    mission: MissionSettings
    tick_s: float
    isolates: bool = False

    @property
    def guidance(self) -> GuidanceSoftware:
        """The part that guidance has."""
        params = self.params
        return GuidanceSoftware(
            pointing=params.pointing, formation=params.formation, vehicle=params.vehicle, tick_s=self.tick_s
        )
