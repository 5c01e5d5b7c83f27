"""Sizes of what is measured: for an accelerator, and small ones for a CPU."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """Sizes of one sitting.

    Attributes:
        aim_runs: batch size of the aim
        batches: other batch sizes of the closed loop, ascending
        loop_duration_s: simulated time of a pass [s]
        repeats: timed passes, after one that warms up
        compared_runs: runs that are simulated in both precisions
        compared_duration_s: their simulated time [s]
        images: rendered at once on each device
        rendered_runs: runs with rendered cameras at once
        rendered_duration_s: their simulated time [s]
        gradient_runs: runs of a gradient
        gradient_duration_s: their simulated time [s]
        training_batch: images of a training step
        training_steps: training steps that are timed
    """

    aim_runs: int
    batches: tuple[int, ...]
    loop_duration_s: float
    repeats: int
    compared_runs: int
    compared_duration_s: float
    images: int
    rendered_runs: int
    rendered_duration_s: float
    gradient_runs: int
    gradient_duration_s: float
    training_batch: int
    training_steps: int


ACCELERATOR = Sizes(
    aim_runs=10_000,
    batches=(1024, 4096, 16_384, 65_536),
    loop_duration_s=600.0,
    repeats=2,
    compared_runs=1024,
    compared_duration_s=3000.0,
    images=256,
    rendered_runs=256,
    rendered_duration_s=100.0,
    gradient_runs=64,
    gradient_duration_s=300.0,
    training_batch=64,
    training_steps=20,
)

SMALL = Sizes(
    aim_runs=512,
    batches=(256, 1024),
    loop_duration_s=400.0,
    repeats=2,
    compared_runs=256,
    compared_duration_s=1000.0,
    images=5,
    rendered_runs=10,
    rendered_duration_s=10.0,
    gradient_runs=64,
    gradient_duration_s=60.0,
    training_batch=8,
    training_steps=2,
)
