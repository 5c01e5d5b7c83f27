"""Delays of a scenario's measurements: which sensors have one, and for how long flight software remembers."""

import math
from dataclasses import dataclass
from typing import Any, Final

from rpojax.errors import ScenarioError
from rpojax.scenario.schema import ScenarioFile
from rpojax.sensors.additional.registry import present_sensors
from rpojax.value_types import Section

KEYS: Final = ("delay_s", "delay_jitter_s", "processing_s", "time_tag_error_s")
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
        if longest > LONGEST_S:
            raise ScenarioError(f"{name}.delay_s", section.delay_s, f"at most {LONGEST_S:g} s with all that adds to it")
        if _is_late(section) and file.servicers:
            raise ScenarioError(f"{name}.delay_s", section.delay_s, "no late measurements in a team of servicers")
    for name in _dispersed(file):
        if not memory:
            expected = "a time for which flight software remembers, with a delay that is dispersed"
            raise ScenarioError("navigation.delay_memory_s", memory, f"{expected} ({name})")


LONGEST_S: Final = 10.0
"""Longest delay [s]: the filter takes the target's motion over it for a straight line."""
_ROUNDING: Final = 1e-9


def _sections(file: ScenarioFile) -> dict[str, Any]:
    return {"camera": file.camera, **present_sensors(file)}


def _is_late(section: Section) -> bool:
    return any(getattr(section, key) != 0.0 for key in KEYS)


def _longest_s(section: Any) -> float:
    return section.delay_s + section.delay_jitter_s + section.processing_s + max(-section.time_tag_error_s, 0.0)


def _dispersed(file: ScenarioFile) -> set[str]:
    """Names of the sensors of which a delay is dispersed."""
    keys = {key for each in file.dispersions for key in each.key_texts} | set(getattr(file.design, "values", ()))
    return {name for name in _sections(file) if any(f"{name}.{key}" in keys for key in KEYS)}
