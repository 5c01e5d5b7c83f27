"""Batching of one run's tick over many runs: the transform, and the batch axis of each field of the state."""

import dataclasses
from collections.abc import Callable
from typing import Any

from rpojax.batching import batching_mode
from rpojax.batching.batching_mode import BatchingMode
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.state import State


def tick_batching_mode(scenario: Scenario, mode: BatchingMode | None = None) -> BatchingMode:
    """How a tick is batched: as given, or by default as the environment says."""
    # Images are rendered by convolutions and lookups, which JAX batches best itself.
    return "jax" if scenario.camera_model == "rendered" else mode or batching_mode.chosen_mode()


def batch_transform(scenario: Scenario, mode: BatchingMode | None = None) -> Callable[..., Callable[..., Any]]:
    """Transform that batches a tick: `jax.vmap`, or its equivalent that keeps the runs in the last axis."""
    return batching_mode.transform(tick_batching_mode(scenario, mode))


def state_axes(axis: int) -> State:
    """Batch axis of each field of `State`: `axis`, but None for the tick, which is the same for all runs.

    An unbatched tick makes the burn decision a true branch, taken on one tick in two hundred.
    """
    axes: dict[str, Any] = {field.name: axis for field in dataclasses.fields(State)}
    return State(**{**axes, "tick": None})
