"""Batching of one run's tick over many runs: the transform, and the batch axis of each field of the state."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax

from rpojax.batching import vmap_last_axis
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.state import State


def batch_transform(scenario: Scenario) -> Callable[..., Callable[..., Any]]:
    """Transform that batches a tick: `jax.vmap`, or its equivalent that keeps the runs in the last axis."""
    # Images are rendered by convolutions and lookups, which JAX batches best itself.
    return jax.vmap if scenario.camera_model == "rendered" else vmap_last_axis.vmap


def state_axes(axis: int) -> State:
    """Batch axis of each field of `State`: `axis`, but None for the tick, which is the same for all runs.

    An unbatched tick makes the burn decision a true branch, taken on one tick in two hundred.
    """
    axes: dict[str, Any] = {field.name: axis for field in dataclasses.fields(State)}
    return State(**{**axes, "tick": None})
