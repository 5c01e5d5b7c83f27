"""The machine, its devices and the versions of packages."""

from collections.abc import Iterator
from typing import Any

import jax

from benchmarks.accelerator.sizes import Sizes
from rpojax.benchmark.platform_info import platform_info


def measure(_: Sizes) -> Iterator[dict[str, Any]]:
    """One entry: machine, backend, number of devices, versions."""
    yield {**platform_info(), "devices": len(jax.devices())}
