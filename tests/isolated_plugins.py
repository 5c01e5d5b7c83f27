"""Plugins of a test are forgotten after it: names of their metrics and sensors, and the permission to execute them."""

import copy
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
        metric_catalogue._OF_PLUGINS,
        registry._OF_PLUGINS,
        plugin_registry._KNOWN,
        plugin_registry._permission,
    ]
    before = [{key: copy.copy(value) for key, value in table.items()} for table in tables]
    try:
        yield
    finally:
        for table, content in zip(tables, before, strict=True):
            table.clear()
            table.update(content)
