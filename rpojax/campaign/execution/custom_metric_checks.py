"""Checks of a plugin's metrics before anything is compiled: that their channels exist, and that they are numbers."""

import jax
import jax.numpy as jnp

from rpojax.campaign.execution.batch_engine import BatchEngine
from rpojax.campaign.options.history_retention import Retention
from rpojax.errors import RpojaxError
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.plugins.custom_metrics import unknown_channel
from rpojax.scenario.schema import ScenarioFile

_ALWAYS = ("time_s", "rho_desired_H")
"""Channels that are no telemetry in every scenario."""


def check_metrics(file: ScenarioFile, engine: BatchEngine, histories: Retention) -> None:
    """Refuses metrics of channels that the scenario does not have, and of ticks that give no number.

    Raises:
        RpojaxError: naming the metric, what was found and what was expected.
    """
    own = plugin_registry.metrics_of(file)
    for name, _ in histories.worst_kept:
        if name not in own and name not in METRICS:
            raise RpojaxError.of_argument("histories", f"found metric {name!r}, expected one of the campaign")
    if not own:
        return
    shapes = engine.channel_shapes()
    for metric in own.values():
        for channel in metric.inputs:
            if channel not in shapes and channel not in _ALWAYS:
                raise unknown_channel(metric.name, channel, (*shapes, *_ALWAYS))
        if not callable(metric.reduction):
            example = {"time_s": jax.ShapeDtypeStruct((), jnp.float64)}
            example |= {"rho_desired_H": jax.ShapeDtypeStruct((3,), jnp.float64), **shapes}
            jax.eval_shape(lambda *values, m=metric: m.value(jnp, *values), *(example[name] for name in metric.inputs))
