"""A plugin: metrics, sensors and stages of the flight software that a user adds to a scenario."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar

import jax
from pydantic import create_model

from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.metrics import filter_consistency, metric_catalogue
from rpojax.metrics.metric_definition import Metric
from rpojax.scenario.numbers import key_units
from rpojax.scenario.plugins import custom_metrics, function_digests
from rpojax.scenario.plugins.custom_metrics import MetricFunction
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.additional import registry
from rpojax.sensors.additional.additional_sensor import AdditionalSensor, SensedScene


@dataclass(frozen=True)
class Plugin:
    """What a user adds to a scenario.

    Attributes:
        metrics: functions of channels by the metric's name, of a tick if marked with `rpojax.metric`, else of a run
        sensors: subclasses of `rpojax.AdditionalSensor` by the name of their section in scenario files
        stages: replaced stages of the flight software: controllers, filters, references

    Raises:
        RpojaxError: a name or a function cannot be used.
    """

    metrics: Mapping[str, MetricFunction] = field(default_factory=dict)
    sensors: Mapping[str, type[AdditionalSensor]] = field(default_factory=dict)
    stages: Stages | None = None

    def __post_init__(self) -> None:
        for name, cls in self.sensors.items():
            if not (isinstance(cls, type) and issubclass(cls, AdditionalSensor)):
                raise RpojaxError(f"sensors.{name}: found {cls!r:.80}, expected a subclass of rpojax.AdditionalSensor")
            if name in ScenarioFile.model_fields or not name.isidentifier():
                raise RpojaxError(f"sensors.{name}: found this name, expected one that no section of a scenario has")
            if not isinstance(getattr(cls, "normals", None), int):
                raise RpojaxError(f"sensors.{name}: found no `normals`, expected how many random numbers it takes")
            if isinstance(cls.beliefs, str) or (cls.beliefs and not cls.is_believed()):
                expected = "a tuple of keys, of a class with `rows` and `row_count`"
                raise RpojaxError(f"sensors.{name}.beliefs: found {cls.beliefs!r}, expected {expected}")
            if unknown := set(cls.beliefs) - set(cls.model_fields):
                raise RpojaxError(f"sensors.{name}.beliefs: found {min(unknown)!r}, expected keys of its section")
            if (cls.rows is not AdditionalSensor.rows) is not cls.is_believed():
                expected = "`rows` with `row_count` above 0, or neither"
                raise RpojaxError(f"sensors.{name}: found row_count = {cls.row_count}, expected {expected}")
        _ = self.definitions

    @cached_property
    def definitions(self) -> dict[str, Metric]:
        """Definitions of the metrics by name."""
        own = {name: custom_metrics.make_metric(name, each, _unit(name)) for name, each in self.metrics.items()}
        for sensor, cls in self.sensors.items():
            if cls.is_believed():
                of_sensor = {each.name: each for each in filter_consistency.sensor_metrics(sensor, cls.row_count)}
                if taken := sorted(own.keys() & of_sensor.keys()):
                    raise RpojaxError(f"metrics: found {taken[0]!r}, expected a name that no metric of a sensor has")
                own |= of_sensor
        return own

    @property
    def has_code(self) -> bool:
        """Whether runs can be simulated with it; else it is a description for reading results."""
        return True

    def describe(self) -> dict[str, Any]:
        """Description in the types of JSON, from which results can be read without the code."""
        return {
            "metrics": {
                name: {**custom_metrics.describe(each), "sha256": self._metric_sha256(name)}
                for name, each in self.definitions.items()
            },
            "sensors": {name: list(cls.model_fields) for name, cls in self.sensors.items()},
        }

    def _metric_sha256(self, name: str) -> str:
        """SHA-256 of the definition of a metric: of its source, the values that it holds, and its settings."""
        if name not in self.metrics:  # of a sensor, the same whatever the sensor does
            return hashlib.sha256(repr(custom_metrics.describe(self.definitions[name])).encode()).hexdigest()
        function = self.metrics[name]
        text = f"{_content(function)} {custom_metrics.settings_of(function)!r}"
        return hashlib.sha256(text.encode()).hexdigest()

    def sha256(self) -> str:
        """SHA-256 of the sources of all functions and classes, and of the values that functions hold."""
        parts = {f"metrics.{name}": _content(each) for name, each in self.metrics.items()}
        parts |= {f"settings.{name}": repr(custom_metrics.settings_of(each)) for name, each in self.metrics.items()}
        parts |= {f"sensors.{name}": " ".join(map(_content, _own_classes(cls))) for name, cls in self.sensors.items()}
        if self.stages is not None:
            of_stages = {each.name: getattr(self.stages, each.name) for each in fields(self.stages)}
            parts |= {f"stages.{name}": _content(function) for name, function in of_stages.items()}
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def activate(self) -> None:
        """Makes its metrics and sensors known to the process by their names.

        Raises:
            RpojaxError: a metric has a name of the package.
        """
        metric_catalogue.register(self.definitions.values())
        registry.register(self.sensors)


@dataclass(frozen=True)
class DescribedPlugin(Plugin):
    """A plugin without its code.

    Attributes:
        described: definitions of the metrics by name, without functions
    """

    described: Mapping[str, Metric] = field(default_factory=dict)

    @cached_property
    def definitions(self) -> dict[str, Metric]:
        """Definitions of the metrics by name."""
        return dict(self.described)

    @property
    def has_code(self) -> bool:
        """False: no run can be simulated with it."""
        return False


class _DescribedSensor(AdditionalSensor):
    """A sensor of which only the keys of its section are known."""

    normals: ClassVar[int] = 0

    @staticmethod
    def measure(settings: Mapping[str, jax.Array], scene: SensedScene, normals: jax.Array) -> dict[str, jax.Array]:
        """Refused: the measurement is code that was not loaded."""
        raise RpojaxError("plugin: found its description alone, expected allow_plugin=True")


def described_plugin(record: Mapping[str, Any]) -> DescribedPlugin:
    """Plugin from its description in `campaign.json`."""
    metrics, sensors = record.get("metrics"), record.get("sensors")
    of_metrics = metrics if isinstance(metrics, dict) else {}
    of_sensors = sensors if isinstance(sensors, dict) else {}
    return DescribedPlugin(
        sensors={name: _described_sensor(name, keys) for name, keys in of_sensors.items()},
        described={
            name: custom_metrics.described_metric(name, each)
            for name, each in of_metrics.items()
            if isinstance(each, dict)
        },
    )


def _described_sensor(name: str, keys: Iterable[str]) -> type[AdditionalSensor]:
    """Class of a sensor whose section has some keys, but no measurement."""
    fields: dict[str, Any] = {str(key): (Any, None) for key in keys}
    return create_model(f"Described_{name}", __base__=_DescribedSensor, **fields)


def _own_classes(cls: type[AdditionalSensor]) -> list[type]:
    """The class and those that it inherits from, without those of the package."""
    return [each for each in cls.__mro__ if issubclass(each, AdditionalSensor) and each is not AdditionalSensor]


def _unit(name: str) -> str:
    unit = key_units.unit_symbol(name)
    return "-" if unit == "1" else unit


def _content(function: Any) -> str:
    """Text that differs for functions or classes of different content."""
    source, values = function_digests.source_digest(function), function_digests.values_digest(function)
    code = getattr(function, "__code__", None)
    unknown = "" if source or code is None else f"{code.co_code.hex()} {code.co_names}"
    return f"{function_digests.qualified_name(function)} {source} {values} {unknown}"
