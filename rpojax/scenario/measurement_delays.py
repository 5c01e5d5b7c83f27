"""Delays of a scenario's measurements: which sensors have one, and for how long flight software remembers."""

import math
from dataclasses import dataclass
from typing import Any, Final, NoReturn

import numpy as np

from rpojax.core.declared_numbers import declared_numbers
from rpojax.errors import ScenarioError
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.additional.registry import present_sensors
from rpojax.sensors.measurement_delay import MeasurementDelay
from rpojax.value_types import Section

KEYS: Final = tuple(key.partition(".")[2] for key, _ in declared_numbers(MeasurementDelay).values())
"""Keys of a sensor's section that make its measurements late, or their time tags wrong."""


@dataclass(frozen=True)
class DelaySettings:
    """Static settings of late measurements.

    Attributes:
        sensors: names of those whose measurements are late, `camera` among them
        slots: measurements of a sensor that can be under way, and ticks that flight software remembers
        compensated: whether the filter uses a measurement as one of its exposure, not as one of now
    """

    sensors: tuple[str, ...]
    slots: int
    compensated: bool


def delay_settings(file: ScenarioFile) -> DelaySettings | None:
    """Static settings of the delays of a scenario, None without one."""
    dispersed = _dispersed(file)
    late = {name: section for name, section in _sections(file).items() if _is_late(section) or name in dispersed}
    if not late:
        return None
    longest = max(file.navigation.delay_memory_s, *map(_longest_s, late.values()))
    # One more, as of two that arrive in one tick the second waits for the next.
    slots = math.ceil(longest * file.rates.camera_hz - _ROUNDING) + 2
    return DelaySettings(tuple(late), slots, file.navigation.delays == "compensated")


def delayed_sensor(file: ScenarioFile, key: str) -> str | None:
    """Name of the sensor whose measurements a key makes late, None for any other key."""
    name, _, setting = key.partition(".")
    return name if setting in KEYS and name in _sections(file) else None


def check_delays(file: ScenarioFile) -> None:
    """Refuses delays that flight software cannot remember, and those where no one takes them into account.

    Raises:
        ScenarioError: naming the key.
    """
    memory = file.navigation.delay_memory_s
    for name, section in _sections(file).items():
        longest = _longest_s(section)
        if memory and longest > memory:
            expected = f"at most navigation.delay_memory_s = {memory:g} with jitter and processing, which add to it"
            raise ScenarioError(f"{name}.delay_s", section.delay_s, f"{expected}: {longest:g} s")
        ticks = math.ceil((section.delay_s + section.processing_s) * file.rates.camera_hz - _ROUNDING)
        if section.time_tag_error_s > (youngest := ticks / file.rates.camera_hz):
            expected = f"at most {youngest:g}, the least age of a measurement that flight software gets"
            raise ScenarioError(f"{name}.time_tag_error_s", section.time_tag_error_s, expected)
        if longest > LONGEST_S:
            raise ScenarioError(f"{name}.delay_s", section.delay_s, f"at most {LONGEST_S:g} s with all that adds to it")
    dispersed = _dispersed(file)
    for name, section in _sections(file).items():
        if file.servicers and (_is_late(section) or name in dispersed):
            _refuse_late_team(file, name)
    for name in dispersed:
        if not memory:
            expected = "a time for which flight software remembers, with a delay that is dispersed"
            raise ScenarioError("navigation.delay_memory_s", memory, f"{expected} ({name})")
        _check_dispersed(file, name)


def _refuse_late_team(file: ScenarioFile, name: str) -> NoReturn:
    """Refuses a late sensor of a team, by its first key that is dispersed or not 0."""
    section, dispersed = _sections(file)[name], _dispersed_keys(file)
    key = next(key for key in KEYS if f"{name}.{key}" in dispersed or getattr(section, key) != 0.0)
    found = "a dispersed number" if f"{name}.{key}" in dispersed else getattr(section, key)
    raise ScenarioError(f"{name}.{key}", found, "no late measurements in a team of servicers")


def _check_dispersed(file: ScenarioFile, name: str) -> None:
    """Refuses drawn delays of a sensor that may be longer than flight software remembers."""
    section, memory, ends = _sections(file)[name], file.navigation.delay_memory_s, dict[str, float]()
    for number, each in enumerate(file.dispersions):
        for key in (key for key in KEYS if f"{name}.{key}" in each.key_texts):
            reach = [one.ppf(_ENDS) for one in each.marginals(np.atleast_1d(getattr(section, key))) if one is not None]
            if len(each.key_texts) > 1 or not reach or not np.isfinite(reach).all():
                expected = f"one with ends, such as uniform, for {name}.{key}, which flight software must remember"
                raise ScenarioError(f"dispersions.{number}.kind", each.kind, expected)
            ends[key] = float(reach[0][0] if key == TIME_TAG else reach[0][1])
    for key in KEYS:
        if values := getattr(file.design, "values", {}).get(f"{name}.{key}"):
            ends[key] = float(min(values) if key == TIME_TAG else max(values))
    longest = _longest_s(section.model_copy(update=ends))
    if longest > memory + _ROUNDING:
        expected = f"at least {longest:g}, the longest delay of {name} that is drawn, with all that adds to it"
        raise ScenarioError("navigation.delay_memory_s", memory, expected)


LONGEST_S: Final = 10.0
"""Longest delay [s]: the filter takes the target's motion over it for a straight line."""
_ROUNDING: Final = 1e-9
TIME_TAG: Final = "time_tag_error_s"
"""Key of which the least value makes a measurement oldest."""
_ENDS: Final = np.array([0.0, 1.0])


def _sections(file: ScenarioFile) -> dict[str, Any]:
    return {"camera": file.camera, **present_sensors(file)}


def _is_late(section: Section) -> bool:
    return any(getattr(section, key) != 0.0 for key in KEYS)


def _longest_s(section: Any) -> float:
    return section.delay_s + section.delay_jitter_s + section.processing_s + max(-section.time_tag_error_s, 0.0)


def _dispersed(file: ScenarioFile) -> set[str]:
    """Names of the sensors of which a delay is dispersed."""
    keys = _dispersed_keys(file)
    return {name for name in _sections(file) if any(f"{name}.{key}" in keys for key in KEYS)}


def _dispersed_keys(file: ScenarioFile) -> set[str]:
    return {key for each in file.dispersions for key in each.key_texts} | set(getattr(file.design, "values", ()))
