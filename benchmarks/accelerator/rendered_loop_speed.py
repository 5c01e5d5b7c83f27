"""The closed loop with a rendered camera: an image and a detection for every run and second."""

from collections.abc import Iterator
from typing import Any

from benchmarks.accelerator import loop_speed, memory
from benchmarks.accelerator.sizes import Sizes
from rpojax.benchmark import closed_loop_speed
from rpojax.scenario.loading import scenario_loader


def measure(sizes: Sizes) -> Iterator[dict[str, Any]]:
    """One entry: compilation, speed, kernels, memory."""
    file = scenario_loader.load("inspection", ["camera.model=rendered", f"duration_s={sizes.rendered_duration_s}"])

    def figures() -> dict[str, Any]:
        engine = closed_loop_speed.compile_engine(file, sizes.rendered_runs)
        speed = loop_speed.loop_figures(engine, repeats=1)
        return {"compile_s": engine.compile_s, **speed, **loop_speed.kernel_figures(engine)}

    yield memory.measured_or_reason(figures, batch=sizes.rendered_runs)
