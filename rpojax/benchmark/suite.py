"""Parts of `rpojax bench`: the closed loop, its kernels, the rendered camera."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from rpojax.benchmark import closed_loop_speed, filter_speed, orbit_speed, vision_speed
from rpojax.scenario.schema import ScenarioFile


def _measure_kernels(file: ScenarioFile, _: Sequence[int]) -> dict[str, Any]:
    return {"kernels": {"orbit": asdict(orbit_speed.measure()), "filter": filter_speed.measure(file)}}


def _measure_vision(_: ScenarioFile, __: Sequence[int]) -> dict[str, Any]:
    return {"vision": asdict(vision_speed.measure())}


PARTS: Mapping[str, Callable[[ScenarioFile, Sequence[int]], dict[str, Any]]] = {
    "loop": closed_loop_speed.measure,
    "kernels": _measure_kernels,
    "vision": _measure_vision,
}
"""Name of a part -> function that measures it, given a scenario and the batch sizes of the closed loop."""
