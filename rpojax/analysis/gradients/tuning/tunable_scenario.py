"""Checks of a scenario before it is tuned, and its shorter form for the runs of a tuning."""

from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

_DEFAULT_S = 2000.0
"""Simulated time of a run of a mission of one phase, such as station keeping [s]."""


def scenario_at_horizon(file: ScenarioFile, settings: TuningSettings) -> ScenarioFile:
    """The scenario with the duration of the tuning's runs.

    Raises:
        ScenarioError: the scenario cannot be tuned by gradient.
        RpojaxError: its phases do not fit into the time.
    """
    check_differentiable(file)
    if file.design.kind != "independent":
        raise ScenarioError("design.kind", file.design.kind, "'independent', since every step draws fresh runs")
    used = horizon(file, settings)
    try:
        return scenario_loader.with_duration(file, used)
    except ScenarioError as error:
        if not file.phases:
            raise
        expected = f"one in which the phases of the mission of {file.duration_s:g} s can end"
        raise RpojaxError.of_argument("horizon_s", f"found {used:g} ({error}), expected {expected}") from None


def horizon(file: ScenarioFile, settings: TuningSettings) -> float:
    """Simulated time of a run of the tuning [s], at most that of the scenario.

    By default it is 2000 s, and all of a mission of several phases: those that have not begun are not tuned for.
    """
    default = file.duration_s if len(file.phases) > 1 else _DEFAULT_S
    return min(default if settings.horizon_s is None else settings.horizon_s, file.duration_s)


def unreached_phases_warning(file: ScenarioFile, settings: TuningSettings) -> str | None:
    """Why runs of a tuning may not get to all phases of a mission; None if they are as long as the mission."""
    used = horizon(file, settings)
    if len(file.phases) < 2 or used >= file.duration_s:
        return None
    return f"horizon: {used:g} s of a mission of {file.duration_s:g} s: phases that begin later are not tuned for"


def check_differentiable(file: ScenarioFile) -> None:
    """Refuses the rendered camera, whose images have no useful gradient.

    Raises:
        ScenarioError: the scenario has one.
    """
    if file.camera.model == "rendered":
        raise ScenarioError("camera.model", "rendered", "'geometric' or 'statistical': images have no useful gradient")
