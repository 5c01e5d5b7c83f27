"""Metrics accumulated during the simulation, differentiable and without a history, and a hash of its events.

They have the same definitions as those of records. The quantities of a tick are in the precision of the simulation, and
some of them are not recorded.
"""

from collections.abc import Sequence
from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import vectors
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics import running_reduction
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.metrics.metric_definition import Metric
from rpojax.metrics.running_reduction import Accumulators
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.channels import CHANNELS, ChannelFunctions, ObservedTick, evaluate
from rpojax.simulation.telemetry import Telemetry

Scalar = Float[Array, ""]

_QUANTITIES: Final[ChannelFunctions] = {
    **CHANNELS,
    "desired_position_H": lambda tick: (
        tick.params.flight.formation.desired_position
        if tick.telemetry.rho_desired_H is None
        else tick.telemetry.rho_desired_H
    ),
    "log_determinant": lambda tick: tick.relative_density[1] + tick.servicer_density[1],
    "innovation": lambda tick: tick.telemetry.innovation.innovation,
    "innovation_variance": lambda tick: tick.telemetry.innovation.variance,
    "innovation_used": lambda tick: tick.telemetry.innovation.used,
    "box_received": lambda tick: tick.telemetry.innovation.accepted | tick.telemetry.innovation.rejected,
    "image_area": lambda tick: (
        tick.scenario.width_px * tick.scenario.height_px / tick.params.flight.vehicle.focal_px**2
    ),
    "pointing_error_sine_N": lambda tick: vectors.cross(*tick.boresight_and_line),
}
"""Channels and the other inputs of metrics, as functions of a tick."""


@pytree
class RunningSums:
    """What is accumulated over the ticks of a run.

    Attributes:
        accumulators: of the metrics
        pointing_ticks: () ticks for which the camera has pointed at the target
        event_hash: () uint32, hash of all accepted and rejected boxes and of the pointing modes
    """

    accumulators: Accumulators
    pointing_ticks: Array
    event_hash: Array


def initial_sums(names: Sequence[str]) -> RunningSums:
    """Sums before the first tick.

    Raises:
        RpojaxError: a metric needs whole records.
    """
    return RunningSums(
        accumulators=running_reduction.initial_accumulators(_metrics(names)),
        pointing_ticks=jnp.zeros((), dtype=jnp.float64),
        event_hash=jnp.zeros((), dtype=jnp.uint32),
    )


def add_tick(
    names: Sequence[str], scenario: Scenario, params: Params, telemetry: Telemetry, sums: RunningSums
) -> RunningSums:
    """Sums after one more tick."""
    metrics = _metrics(names)
    pointing_ticks = jnp.where(telemetry.mode == Mode.LOOK, sums.pointing_ticks + 1.0, 0.0)
    inputs = {name for metric in metrics for name in metric.inputs} - {"is_settled"}
    quantities = evaluate(_QUANTITIES, sorted(inputs), ObservedTick(scenario, params, telemetry))
    quantities["is_settled"] = pointing_ticks > _settle_ticks(scenario, params)
    return RunningSums(
        accumulators=running_reduction.accumulate(
            metrics, quantities, sums.accumulators, telemetry.tick, scenario.ticks, scenario.tick_s
        ),
        pointing_ticks=pointing_ticks,
        event_hash=_updated_event_hash(sums.event_hash, telemetry),
    )


def final_values(names: Sequence[str], sums: RunningSums) -> Float[Array, " metrics"]:
    """Metrics in the order of `names`; 0 where no tick has any weight."""
    return running_reduction.final_values(_metrics(names), sums.accumulators)


def _metrics(names: Sequence[str]) -> list[Metric]:
    return [METRICS[name] for name in names]


def _updated_event_hash(events: Array, telemetry: Telemetry) -> Array:
    """Polynomial hash of the events up to and including those of a tick."""
    innovation = telemetry.innovation
    accepted, rejected, mode = (
        word.astype(jnp.uint32) for word in (innovation.accepted, innovation.rejected, telemetry.mode)
    )
    return events * jnp.uint32(1000003) + accepted + jnp.uint32(2) * rejected + jnp.uint32(4) * mode


def _settle_ticks(scenario: Scenario, params: Params) -> Scalar:
    return jnp.round(params.flight.pointing.settle_time / scenario.tick_s)
