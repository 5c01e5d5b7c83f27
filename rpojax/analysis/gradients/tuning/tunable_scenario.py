"""Checks of a scenario before it is tuned, and its shorter form for the runs of a tuning."""

from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.errors import ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


def scenario_at_horizon(file: ScenarioFile, settings: TuningSettings) -> ScenarioFile:
    """The scenario with the duration of the tuning's runs.

    Raises:
        ScenarioError: the scenario cannot be tuned by gradient.
    """
    check_differentiable(file)
    if file.design.kind != "independent":
        raise ScenarioError("design.kind", file.design.kind, "'independent', since every step draws fresh runs")
    horizon = min(settings.horizon_s, file.duration_s)
    return scenario_loader.with_duration(file, horizon)


def check_differentiable(file: ScenarioFile) -> None:
    """Refuses the rendered camera, whose images have no useful gradient.

    Raises:
        ScenarioError: the scenario has one.
    """
    if file.camera.model == "rendered":
        raise ScenarioError("camera.model", "rendered", "'geometric' or 'statistical': images have no useful gradient")
