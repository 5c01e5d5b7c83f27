"""Static settings of a team from its scenario."""

from rpojax.flight.cooperation.team_settings import LinkSettings, TeamSettings
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.team.members import member_names


def team_settings(file: ScenarioFile) -> TeamSettings:
    """Static settings of a validated scenario of a team."""
    return TeamSettings(
        servicers=len(file.servicers),
        link=_link_settings(file),
        decision_offsets=_decision_offsets(file),
        carrier_differences=file.gps_differences.kind == "carrier",
        coordinated=is_coordinated(file),
    )


def is_coordinated(file: ScenarioFile) -> bool:
    """Whether the servicers of a team decide with what they know of each other."""
    return file.team.keep_out_m > 0.0 or file.team.phasing != "fixed"


def _link_settings(file: ScenarioFile) -> LinkSettings:
    """Settings of the messages; with `central` everybody hears everybody in every tick and at once."""
    names = member_names(file)
    is_central = file.navigation.sharing == "central"
    pairs = [[receiver, sender] for receiver in names for sender in names if receiver != sender]
    hears = pairs if file.link.hears is None or is_central else file.link.hears
    return LinkSettings(
        servicers=len(names),
        sharing=file.navigation.sharing,
        period_ticks=1 if is_central else round(file.link.period_s * file.rates.camera_hz),
        delay_ticks=0 if is_central else round(file.link.delay_s * file.rates.camera_hz),
        hears=tuple((names.index(receiver), names.index(sender)) for receiver, sender in hears),
        zonal_degree=file.navigation.zonal_degree,
        ranging=file.link_range.enabled,
    )


def _decision_offsets(file: ScenarioFile) -> tuple[int, ...]:
    """Offsets of the servicers' decisions in camera ticks; unless given they share out the time between two burns."""
    unit, period, count = decision_unit_s(file), burn_period_s(file), len(file.servicers)
    offsets = []
    for k, changes in enumerate(file.servicers):
        given = changes.decision_offset_s
        seconds = unit * round(k * period / (count * unit)) if given is None else given
        offsets.append(round(seconds * file.rates.camera_hz))
    return tuple(offsets)


def burn_period_s(file: ScenarioFile) -> float:
    """Time between two burn decisions of a servicer, in the first phase of a mission with phases [s]."""
    of_phase = file.phases[0].control_period_s if file.phases else None
    return of_phase or file.rates.formation_period_s


def decision_unit_s(file: ScenarioFile) -> float:
    """Time of which the offset of a servicer's decisions is a multiple [s]: the mission manager decides that often."""
    return file.mission.decision_period_s if file.phases else 1.0 / file.rates.camera_hz
