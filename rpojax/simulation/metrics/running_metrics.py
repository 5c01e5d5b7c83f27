"""Metrics accumulated during the simulation, differentiable and without a history, and a hash of its events.

They have the same definitions as those of records. The quantities of a tick are in the precision of the simulation, and
some of them are not recorded.
"""

from collections.abc import Sequence
from functools import partial
from typing import Final

import jax.numpy as jnp
from jaxtyping import Array, Float

from rpojax.core import vectors
from rpojax.core.pytree import pytree
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics import running_reduction
from rpojax.metrics.metric_definition import Metric
from rpojax.metrics.running_reduction import Accumulators
from rpojax.scenario.params import Params
from rpojax.scenario.plugins.custom_metrics import unknown_channel
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.channels import (
    CHANNELS,
    ISOLATION_CHANNELS,
    LANDMARK_CHANNELS,
    MISSION_CHANNELS,
    PLUME_CHANNELS,
    PORT_CHANNELS,
    POSE_CHANNELS,
    ChannelFunctions,
    ObservedTick,
    evaluate,
    sensor_channels,
)
from rpojax.simulation.telemetry import Telemetry

Scalar = Float[Array, ""]


_QUANTITIES: Final[ChannelFunctions] = {
    **CHANNELS,
    "desired_position_H": lambda tick: tick.telemetry.rho_desired_H,
    "log_determinant": lambda tick: tick.relative_density[1] + tick.servicer_density[1],
    "innovations": lambda tick: tick.telemetry.innovation.sensors,
    "image_area": lambda tick: (
        tick.scenario.width_px * tick.scenario.height_px / tick.in_use.flight.vehicle.focal_px**2
    ),
    "pointing_error_sine_N": lambda tick: vectors.cross(*tick.boresight_and_line),
}
"""Channels and the other inputs of metrics, as functions of a tick."""


def _is_arrival(tick: ObservedTick) -> Array:
    """Whether the last phase begins."""
    settings, state = tick.scenario.mission, tick.telemetry.flight.mission
    time = tick.telemetry.tick.astype(state.entered_at.dtype) * tick.scenario.tick_s
    is_now = jnp.abs(state.entered_at - time) < 0.5 * tick.scenario.tick_s
    return is_now & (state.phase == settings.hold - 1)


def _approach_axis(tick: ObservedTick) -> Array:
    """Axis of the corridor of the last phase, or direction of its reference where it turns, in H; of any length."""
    corridor = tick.params.flight.mission.phases[tick.scenario.mission.phases[-1].name].corridor
    if corridor is None or tick.scenario.mission.ends_in_target_frame:
        return tick.telemetry.rho_desired_H
    return corridor.axis


_OF_MISSIONS: Final[ChannelFunctions] = {
    **MISSION_CHANNELS,
    "is_arrival": _is_arrival,
    "approach_axis_H": _approach_axis,
}

_OF_LANDMARKS: Final[ChannelFunctions] = {
    **LANDMARK_CHANNELS,
    "pose_log_determinant": lambda tick: tick.pose_density[1],
}


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


def initial_sums(metrics: Sequence[Metric]) -> RunningSums:
    """Sums before the first tick.

    Raises:
        RpojaxError: a metric needs whole records.
    """
    return RunningSums(
        accumulators=running_reduction.initial_accumulators(metrics),
        pointing_ticks=jnp.zeros((), dtype=jnp.float64),
        event_hash=jnp.zeros((), dtype=jnp.uint32),
    )


def add_tick(
    metrics: Sequence[Metric], scenario: Scenario, params: Params, telemetry: Telemetry, sums: RunningSums
) -> RunningSums:
    """Sums after one more tick."""
    pointing_ticks = jnp.where(telemetry.mode == Mode.LOOK, sums.pointing_ticks + 1.0, 0.0)
    inputs = {name for metric in metrics for name in metric.inputs} - {"is_settled"}
    inputs = sorted(inputs)
    quantities = evaluate(_functions(metrics, scenario, telemetry), inputs, ObservedTick(scenario, params, telemetry))
    quantities["is_settled"] = pointing_ticks > _settle_ticks(scenario, params)
    return RunningSums(
        accumulators=running_reduction.accumulate(
            metrics, quantities, sums.accumulators, telemetry.tick, scenario.ticks, scenario.tick_s
        ),
        pointing_ticks=pointing_ticks,
        event_hash=_updated_event_hash(sums.event_hash, telemetry),
    )


def _functions(metrics: Sequence[Metric], scenario: Scenario, telemetry: Telemetry) -> ChannelFunctions:
    """Quantities that the metrics may be made of.

    Raises:
        RpojaxError: a metric is made of something else.
    """
    functions = {
        **_QUANTITIES,
        **POSE_CHANNELS,
        "time_s": lambda tick: tick.telemetry.tick * tick.scenario.tick_s,
        "rho_desired_H": _QUANTITIES["desired_position_H"],
        **{name: partial(_measurement, name) for name in telemetry.measurements.additional},
        **sensor_channels(telemetry.flight.rejected_s),
        **(_OF_MISSIONS if scenario.mission.is_managed else {}),
        **(PLUME_CHANNELS if scenario.effects.plume else {}),
        **(_OF_LANDMARKS if telemetry.flight.orbit.relative.target is not None else {}),
        **(PORT_CHANNELS if scenario.mission.ends_in_target_frame else {}),
        **(ISOLATION_CHANNELS if scenario.effects.faults and scenario.isolation else {}),
    }
    for metric in metrics:
        for name in metric.inputs:
            if name not in functions and name != "is_settled":
                raise unknown_channel(metric.name, name, functions)
    return functions


def _measurement(name: str, tick: ObservedTick) -> Array:
    return tick.telemetry.measurements.additional[name]


def final_values(metrics: Sequence[Metric], sums: RunningSums) -> Float[Array, " metrics"]:
    """Values of the metrics; NaN where undefined."""
    return running_reduction.final_values(metrics, sums.accumulators)


def _updated_event_hash(events: Array, telemetry: Telemetry) -> Array:
    """Polynomial hash of the events up to and including those of a tick."""
    sensors, multiplier = telemetry.innovation.sensors, jnp.uint32(1000003)
    accepted, rejected, mode = (
        word.astype(jnp.uint32) for word in (sensors["box"].accepted, sensors["box"].rejected, telemetry.mode)
    )
    events = events * multiplier + accepted + jnp.uint32(2) * rejected + jnp.uint32(4) * mode
    for name in telemetry.flight.rejected_s:
        events = events * multiplier + sensors[name].accepted.astype(jnp.uint32)
    return events


def _settle_ticks(scenario: Scenario, params: Params) -> Scalar:
    return jnp.round(params.flight.pointing.settle_time / scenario.tick_s)
