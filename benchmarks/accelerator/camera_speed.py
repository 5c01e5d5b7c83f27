"""Images rendered and searched by the detector per second."""

import dataclasses
from collections.abc import Iterator
from typing import Any

from benchmarks.accelerator import memory
from benchmarks.accelerator.sizes import Sizes
from rpojax.benchmark import vision_speed


def measure(sizes: Sizes) -> Iterator[dict[str, Any]]:
    """One entry: frames and detections per second, with the times behind them."""
    yield memory.measured_or_reason(
        lambda: {**dataclasses.asdict(vision_speed.measure(sizes.images)), "peak_device_bytes": memory.peak_bytes()}
    )
