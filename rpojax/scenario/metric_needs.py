"""What a scenario must have so that a metric is evaluated, of those that not all have."""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from rpojax.metrics.metric_definition import Metric, Need
from rpojax.scenario.schema import ScenarioFile


class _Condition(NamedTuple):
    """Condition in words, and whether a scenario fulfils it."""

    text: str
    holds: Callable[[ScenarioFile], bool]


_CONDITIONS: Final[Mapping[Need, _Condition]] = {
    "phases": _Condition("[[phases]]", lambda file: bool(file.phases)),
    "plume": _Condition("effects.plume = true", lambda file: file.effects.plume),
    "isolation": _Condition(
        "isolation.enabled, chamber_pressure.enabled and effects.faults = true with [[thrusters]]",
        lambda file: file.effects.faults and file.isolates_thrusters,
    ),
    "landmarks": _Condition("camera.landmarks", lambda file: file.landmarks is not None),
    "port": _Condition('a last phase with frame = "target"', lambda file: file.ends_at_port),
    "coverage": _Condition("coverage.enabled = true", lambda file: file.coverage.enabled),
}


def lacks(file: ScenarioFile, metric: Metric) -> str | None:
    """What the scenario lacks for the metric, as a message says it; None if nothing."""
    condition = None if metric.needs is None else _CONDITIONS[metric.needs]
    return None if condition is None or condition.holds(file) else condition.text
