"""The additional sensors: one field for each, whose name is that of its section in scenario files."""

from collections.abc import Callable
from typing import Any

from pydantic import model_serializer

from rpojax.sensors.additional.additional_sensor import AdditionalSensor
from rpojax.sensors.additional.range_finder import RangeFinder
from rpojax.value_types import Section


class AdditionalSensors(Section):
    """Sections of additional sensors; a scenario without the section does not have the sensor."""

    range_finder: RangeFinder | None = None

    @model_serializer(mode="wrap")
    def _leave_out_absent(self, serialise: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        names = sensor_names()
        return {key: value for key, value in serialise(self).items() if value is not None or key not in names}


def sensor_names() -> tuple[str, ...]:
    """Names of all additional sensors."""
    return tuple(AdditionalSensors.model_fields)


def present_sensors(sections: AdditionalSensors) -> dict[str, AdditionalSensor]:
    """The additional sensors that a scenario has, by name."""
    found = {name: getattr(sections, name) for name in sensor_names()}
    return {name: sensor for name, sensor in found.items() if sensor is not None}


def sensor_class(name: str) -> type[AdditionalSensor]:
    """Class of an additional sensor."""
    annotation: Any = AdditionalSensors.model_fields[name].annotation
    return next(each for each in annotation.__args__ if each is not type(None))
