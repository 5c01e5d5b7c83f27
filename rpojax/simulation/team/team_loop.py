"""Closed loop of a team: what does not change from tick to tick."""

from dataclasses import dataclass

from rpojax.flight.cooperation.team_settings import TeamSettings
from rpojax.flight.stages import Stages
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.team.member_axes import TeamParams


@dataclass(frozen=True)
class TeamLoop:
    """Closed loop of the servicers of one run.

    Attributes:
        scenario: static settings, with those of the team
        params: parameters of the servicers
        stages: replaceable parts of the flight software, the same for all
    """

    scenario: Scenario
    params: TeamParams
    stages: Stages

    @property
    def settings(self) -> TeamSettings:
        """Static settings of the team."""
        assert self.scenario.team is not None
        return self.scenario.team
