"""Settings of a tuning, and the checks of a scenario before it is tuned."""

import math
from dataclasses import dataclass
from typing import Final

from rpojax.errors import RpojaxError, ScenarioError
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

_EXPECTED: Final = {
    "--runs": "at least 1",
    "--steps": "at least 1",
    "--rate": "a number above 0 and up to 1",
    "--seed": "a number from 0",
    "--horizon": "a time above 0 s",
}


@dataclass(frozen=True)
class TuningSettings:
    """Settings of a tuning.

    Attributes:
        parameters: names of groups and keys
        runs: per step
        steps: of the descent
        seed: of the runs; step n simulates runs n * runs and on
        horizon_s: length of each run [s]
        rate: length of the first steps, in coordinates: 0.2 changes a number by about twenty per cent
    """

    parameters: tuple[str, ...]
    runs: int = 64
    steps: int = 80
    seed: int = 0
    horizon_s: float = 2000.0
    rate: float = 0.2


def scenario_at_horizon(file: ScenarioFile, settings: TuningSettings) -> ScenarioFile:
    """The scenario with the duration of the tuning's runs.

    Raises:
        RpojaxError: a setting is out of range, or the scenario cannot be tuned by gradient.
    """
    for option, found, good in (
        ("--runs", settings.runs, settings.runs >= 1),
        ("--steps", settings.steps, settings.steps >= 1),
        ("--rate", settings.rate, 0.0 < settings.rate <= 1.0),
        ("--seed", settings.seed, 0 <= settings.seed < 2**63),
        ("--horizon", settings.horizon_s, math.isfinite(settings.horizon_s) and settings.horizon_s > 0.0),
    ):
        if not good:
            raise RpojaxError(f"{option}: found {found}, expected {_EXPECTED[option]}")
    check_differentiable(file)
    if file.design.kind != "independent":
        raise ScenarioError("design.kind", file.design.kind, "'independent', since every step draws fresh runs")
    horizon = min(settings.horizon_s, file.duration_s)
    return scenario_loader.validate({**file.model_dump(), "duration_s": horizon})


def check_differentiable(file: ScenarioFile) -> None:
    """Refuses the rendered camera, whose images have no useful gradient.

    Raises:
        ScenarioError: the scenario has one.
    """
    if file.camera.model == "rendered":
        raise ScenarioError("camera.model", "rendered", "'geometric' or 'statistical': images have no useful gradient")
