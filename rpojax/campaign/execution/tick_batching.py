"""Batching of one run's tick over many runs: the transform."""

from collections.abc import Callable
from typing import Any

from rpojax.batching import batching_mode
from rpojax.batching.batching_mode import BatchingMode
from rpojax.scenario.static_settings import Scenario


def tick_batching_mode(scenario: Scenario, mode: BatchingMode | None = None) -> BatchingMode:
    """How a tick is batched: as given, or by default as the environment says."""
    # Images are rendered by convolutions and lookups, which JAX batches best itself.
    return "jax" if scenario.camera_model == "rendered" else mode or batching_mode.chosen_mode()


def batch_transform(scenario: Scenario, mode: BatchingMode | None = None) -> Callable[..., Callable[..., Any]]:
    """Transform that batches a tick: `jax.vmap`, or its equivalent that keeps the runs in the last axis."""
    return batching_mode.transform(tick_batching_mode(scenario, mode))
