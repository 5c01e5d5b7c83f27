"""The closed loop at several batch sizes, the smallest first."""

from collections.abc import Iterator
from typing import Any

from benchmarks.accelerator import loop_speed, memory
from benchmarks.accelerator.sizes import Sizes
from rpojax.benchmark import closed_loop_speed
from rpojax.scenario.schema import ScenarioFile


def measure(sizes: Sizes, precision: str) -> Iterator[dict[str, Any]]:
    """One entry for each batch size; after the first that does not fit no larger one is tried."""
    file = loop_speed.mission(sizes, precision)
    refused = 0
    for batch in sizes.batches:
        label = {"batch": batch, "precision": precision}
        if refused:
            yield {**label, "not_measured": f"memory: {refused} runs did not fit"}
            continue
        entry = memory.measured_or_reason(lambda batch=batch: _measure_batch(file, batch, sizes), **label)
        refused = batch if "not_measured" in entry else 0
        yield entry


def _measure_batch(file: ScenarioFile, batch: int, sizes: Sizes) -> dict[str, Any]:
    engine = closed_loop_speed.compile_engine(file, batch)
    return {"compile_s": engine.compile_s, **loop_speed.loop_figures(engine, sizes.repeats)}
