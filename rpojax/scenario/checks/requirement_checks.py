"""Checks of requirements: metrics that the scenario has, and windows inside the run."""

from typing import Any

from rpojax.errors import ScenarioError
from rpojax.metrics import passive_safety
from rpojax.metrics.metric_catalogue import find
from rpojax.scenario import metric_needs
from rpojax.scenario.schema import RequirementSection, ScenarioFile


def check_requirements(file: ScenarioFile) -> None:
    """Refuses requirements on drifts over unknown horizons, on what is not evaluated, and in windows that no run has.

    Raises:
        ScenarioError: naming the key, what was found and what was expected.
    """
    drift_metrics = {passive_safety.horizon_metric_name(horizon) for horizon in file.safety.horizons}
    for number, requirement in enumerate(file.requirements):
        name = requirement.metric
        if name == passive_safety.ONE_ORBIT_RANGE:
            name = passive_safety.horizon_metric_name("1_orbit")
        if passive_safety.is_of_horizon(name) and name not in drift_metrics:
            expected = f"one of the metrics of safety.horizons = {file.safety.horizons}"
            raise ScenarioError(f"requirements.{number}.metric", requirement.metric, expected)
        metric = find(name)
        if metric is not None and (lacking := metric_needs.lacks(file, metric)):
            expected = f"a metric that is evaluated: this one needs {lacking}"
            raise ScenarioError(f"requirements.{number}.metric", name, expected)
        for key, found, expected in _window_faults(file, requirement):
            raise ScenarioError(f"requirements.{number}.{key}", found, expected)


def _window_faults(file: ScenarioFile, requirement: RequirementSection) -> list[tuple[str, Any, str]]:
    """Key, what was found and what was expected, of everything that is wrong with a window."""
    window, faults = requirement.window, list[tuple[str, Any, str]]()
    if requirement.among is not None and requirement.phase is None:
        faults.append(("among", requirement.among, "it only beside phase"))
    if not window.suffix and requirement.at is None:
        return faults
    metric, names = find(requirement.metric), file.phase_names
    if metric is None or metric.source not in ("records", "drifts", "plugin"):
        faults.append(("metric", requirement.metric, "a metric of ticks or of free drifts, as it is for a window"))
    if window.phase is None and window.at is not None:
        faults.append(("at", window.at, "it only beside phase"))
    if window.phase is not None:
        if window.from_s is not None or window.to_s is not None:
            faults.append(("phase", window.phase, "either a phase or times from_s and to_s"))
        last = file.phases[-1] if file.phases else None
        if window.at == "end" and last is not None and window.phase == last.name and last.until is None:
            faults.append(("at", window.at, f"begin, as phase {last.name} has no conditions until that end it"))
        if window.phase not in names:
            expected = f"one of {', '.join(names)}" if names else "it only in a scenario with [[phases]]"
            faults.append(("phase", window.phase, expected))
        return faults
    last_s = file.duration_s - 1.0 / file.rates.camera_hz
    for key, value in (("from_s", window.from_s), ("to_s", window.to_s)):
        if value is not None and value > file.duration_s:
            faults.append((key, value, f"a time within the run: duration_s = {file.duration_s:g}"))
    ticks = window.between_times(round(file.duration_s * file.rates.camera_hz), 1.0 / file.rates.camera_hz)
    if not faults and not ticks.any():
        faults.append(("from_s", window.from_s, f"a window with a camera tick, from 0 to {last_s:g} s"))
    return faults
