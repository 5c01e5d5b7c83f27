"""Plugins of a test are forgotten after it: names of their metrics and sensors, and the permission to execute them."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rpojax.metrics import metric_catalogue
from rpojax.scenario.plugins import plugin_registry
from rpojax.sensors.additional import registry


@contextmanager
def forgotten_plugins() -> Iterator[None]:
    """Restores what the process knows of plugins."""
    tables: list[dict[Any, Any]] = [
        metric_catalogue.METRICS,
        metric_catalogue.UNITS,
        registry._OF_PLUGINS,
        plugin_registry._KNOWN,
        plugin_registry._permission,
    ]
    before, differentiable = [dict(table) for table in tables], list(metric_catalogue.DIFFERENTIABLE)
    try:
        yield
    finally:
        for table, content in zip(tables, before, strict=True):
            table.clear()
            table.update(content)
        metric_catalogue.DIFFERENTIABLE[:] = differentiable
