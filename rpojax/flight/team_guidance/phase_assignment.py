"""Packaged choice of the phase of a servicer's relative orbit in its team."""

from jaxtyping import Array, Float

from rpojax.flight.mission.phase_settings import MissionSettings
from rpojax.flight.team_guidance import phase_spreading, viewpoint_assignment
from rpojax.flight.team_guidance.team_situation import TeamSituation
from rpojax.flight.team_guidance.team_tuning import TeamTuning


def assign(settings: MissionSettings, tuning: TeamTuning, team: TeamSituation) -> Float[Array, ""]:
    """Angle by which this servicer's relative orbit is to be ahead of the plan [rad], as the settings want it."""
    if settings.phasing == "viewpoints":
        return viewpoint_assignment.assign(tuning, team)
    return phase_spreading.spread(team)
