"""Speed of the rendered camera on all devices, in batches as they are flown: pictures, and looks for boxes in them."""

from functools import cache

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from rpojax.benchmark import vision_speed
from rpojax.benchmark.timing import DeviceProgram


@cache
def programs() -> dict[str, DeviceProgram]:
    """Both programs, compiled."""
    return dict(zip(("render", "detect"), vision_speed.compile_camera_and_detector(), strict=True))


@pytest.mark.parametrize("work", ["render", "detect"])
def test_pictures(benchmark: BenchmarkFixture, work: str) -> None:
    program = programs()[work]
    pictures = programs()["detect"].inputs[0][1]
    benchmark.group = "pictures"
    benchmark.pedantic(program.run, warmup_rounds=1, rounds=6)
    assert benchmark.stats is not None
    benchmark.extra_info |= {
        "pictures_per_s": len(pictures) * len(program.inputs) / benchmark.stats["min"],
        "compile_s": program.compile_s,
        "devices": len(program.inputs),
    }
