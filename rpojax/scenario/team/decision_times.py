"""Times at which the servicers of a team may decide about burns; free of JAX."""

from rpojax.scenario.schema import ScenarioFile


def burn_period_s(file: ScenarioFile) -> float:
    """Time between two burn decisions of a servicer, in the first phase of a mission with phases [s]."""
    of_phase = file.phases[0].control_period_s if file.phases else None
    return of_phase or file.rates.formation_period_s


def decision_unit_s(file: ScenarioFile) -> float:
    """Time of which the offset of a servicer's decisions is a multiple [s]: the mission manager decides that often."""
    return file.mission.decision_period_s if file.phases else 1.0 / file.rates.camera_hz
