"""Speed of rendering and detection on all devices, in batches of the size of a campaign's blocks."""

from functools import cache

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpojax.benchmark import vision_speed
from rpojax.benchmark.timed_device_programs import MultiDeviceProgram


@cache
def programs() -> dict[str, MultiDeviceProgram]:
    """The compiled renderer and detector."""
    return dict(zip(("render", "detect"), vision_speed.compile_camera_and_detector(), strict=True))


@pytest.mark.parametrize("work", ["render", "detect"])
def test_images(benchmark: BenchmarkFixture, work: str) -> None:
    program = programs()[work]
    images = programs()["detect"].inputs[0][1]
    benchmark.group = "images"
    benchmark.pedantic(program.run, warmup_rounds=1, rounds=6)
    assert benchmark.stats is not None
    benchmark.extra_info |= {
        "images_per_s": len(images) * len(program.inputs) / benchmark.stats["min"],
        "compile_s": program.compile_s,
        "devices": len(program.inputs),
    }
