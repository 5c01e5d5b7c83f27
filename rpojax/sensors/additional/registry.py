"""The additional sensors: one field for each, whose name is that of its section in scenario files.

Sensors of plugins join those of the package when they become known to the process: `register`.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from pydantic import model_serializer

from rpojax.sensors.additional.additional_sensor import AdditionalSensor
from rpojax.sensors.additional.landmark_camera import LandmarkCamera
from rpojax.sensors.additional.lidar import Lidar
from rpojax.sensors.additional.range_finder import RangeFinder
from rpojax.value_types import Section

_OF_PLUGINS: Final[dict[str, list[type[AdditionalSensor]]]] = {}
"""Sensors of the plugins of this process by the name of their section, which several may have."""


class AdditionalSensors(Section):
    """Sections of additional sensors; a scenario without the section does not have the sensor."""

    range_finder: RangeFinder | None = None
    lidar: Lidar | None = None
    landmarks: LandmarkCamera | None = None

    @model_serializer(mode="wrap")
    def _leave_out_absent(self, serialise: Callable[[Any], dict[str, Any]]) -> dict[str, Any]:
        names = (*sensor_names(), *self.absent_keys())
        return {key: value for key, value in serialise(self).items() if value is not None or key not in names}

    @classmethod
    def absent_keys(cls) -> Iterable[str]:
        """Further keys that are left out where they are None."""
        return ()


def register(sensors: Mapping[str, type[AdditionalSensor]]) -> None:
    """Makes sensors of plugins known by the names of their sections."""
    for name, cls in sensors.items():
        known = _OF_PLUGINS.setdefault(name, [])
        if cls not in known:
            known.append(cls)


def sensor_names() -> tuple[str, ...]:
    """Names of all additional sensors that are known."""
    return (*AdditionalSensors.model_fields, *_OF_PLUGINS)


def present_sensors(sections: AdditionalSensors) -> dict[str, AdditionalSensor]:
    """The additional sensors that a scenario has, by name."""
    found = {name: getattr(sections, name, None) for name in sensor_names()}
    return {name: sensor for name, sensor in found.items() if isinstance(sensor, AdditionalSensor)}


def sensor_classes(name: str) -> list[type[AdditionalSensor]]:
    """Classes of the additional sensors of that name: of the package, or of all plugins that have one."""
    return _OF_PLUGINS[name] if name in _OF_PLUGINS else [packaged_sensors()[name]]


def packaged_sensors() -> dict[str, type[AdditionalSensor]]:
    """Classes of the additional sensors of the package by name."""
    annotations: dict[str, Any] = {name: each.annotation for name, each in AdditionalSensors.model_fields.items()}
    return {name: each.__args__[0] for name, each in annotations.items()}
