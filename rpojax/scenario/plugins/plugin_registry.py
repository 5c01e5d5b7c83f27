"""Plugins of this process by the reference and hash that scenarios carry, and whether files of code may be executed."""

from collections.abc import Collection, Mapping
from typing import Any, Final

from rpojax.errors import RpojaxError, ScenarioError
from rpojax.flight.stages import Stages
from rpojax.metrics import filter_consistency
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.metrics.metric_definition import Metric
from rpojax.scenario import metric_needs
from rpojax.scenario.plugins import plugin_file
from rpojax.scenario.plugins.plugin import Plugin, described_plugin
from rpojax.scenario.schema import ScenarioFile, with_sensors
from rpojax.sensors.additional import registry
from rpojax.sensors.additional.additional_sensor import AdditionalSensor
from rpojax.sensors.additional.registry import present_sensors

FROM_PYTHON: Final = "python"
"""Reference of a plugin that was made in Python and comes from no file."""

_KNOWN: Final[dict[tuple[str, str], Plugin]] = {}
_permission: Final = {"granted": False}


def permit() -> None:
    """Lets this process execute the plugins that scenarios name."""
    _permission["granted"] = True


def is_permitted() -> bool:
    """Whether this process may execute the plugins that scenarios name."""
    return _permission["granted"]


def add(plugin: Plugin) -> dict[str, str]:
    """Makes a plugin from Python known; returns the entries of a scenario that has it."""
    entries = {"plugin": FROM_PYTHON, "plugin_sha256": plugin.sha256()}
    _KNOWN[FROM_PYTHON, entries["plugin_sha256"]] = plugin
    plugin.activate()
    return entries


def add_description(scenario: Mapping[str, Any], record: Mapping[str, Any]) -> None:
    """Makes the description of a plugin known for a recorded scenario, unless its code is known."""
    reference, digest = scenario.get("plugin"), scenario.get("plugin_sha256")
    if isinstance(reference, str) and isinstance(digest, str):
        _KNOWN.setdefault((reference, digest), described_plugin(record))


def load_for(tables: dict[str, Any], allow: bool) -> None:
    """Loads the plugin that the tables of a scenario name, and completes them with its hash.

    Raises:
        ScenarioError: it is not allowed, cannot be used, or has another hash than the tables say.
    """
    reference, digest = tables.get("plugin"), tables.get("plugin_sha256")
    if not isinstance(reference, str) or ((reference, digest) in _KNOWN and _KNOWN[reference, str(digest)].has_code):
        return
    if reference == FROM_PYTHON:
        raise ScenarioError("plugin", reference, "the same metrics or plugin given again in Python")
    if not (allow or is_permitted()):
        expected = "allow_plugin=True, since a plugin is code that is executed"
        raise ScenarioError("plugin", reference, expected)
    found, plugin = plugin_file.load(reference)
    if digest is not None and digest != found:
        expected = f"a file with the SHA-256 {digest!s:.12}..., with which the results began"
        raise ScenarioError("plugin", f"{reference} with {found:.12}...", expected)
    tables["plugin_sha256"] = found
    _KNOWN[reference, found] = plugin
    plugin.activate()


def schema_for(tables: Mapping[str, Any]) -> type[ScenarioFile]:
    """Schema of a scenario with the sections of its plugin.

    Raises:
        ScenarioError: the plugin is not known.
    """
    plugin = _of_tables(tables)
    if plugin is None:
        return ScenarioFile
    plugin.activate()
    return with_sensors(tuple(plugin.sensors.items()))


def sensors_for(tables: Mapping[str, Any]) -> dict[str, type[AdditionalSensor]]:
    """Classes of the additional sensors that a scenario in tables has, by name.

    Raises:
        ScenarioError: the plugin is not known.
    """
    plugin = _of_tables(tables)
    known = {**registry.packaged_sensors(), **({} if plugin is None else plugin.sensors)}
    return {name: cls for name, cls in known.items() if tables.get(name) is not None}


def metrics_for(tables: Mapping[str, Any]) -> dict[str, Metric]:
    """Metrics of the plugin of a scenario in tables, and of the sensors that its filter believes, by name.

    Raises:
        ScenarioError: the plugin is not known.
    """
    plugin = _of_tables(tables)
    return _metrics_of_sensors(tables) | ({} if plugin is None else plugin.definitions)


def _metrics_of_sensors(tables: Mapping[str, Any]) -> dict[str, Metric]:
    """Metrics of the package's additional sensors that the filter of a scenario believes, by name."""
    found: dict[str, Metric] = {}
    for name, cls in registry.packaged_sensors().items():
        if cls.is_believed() and tables.get(name) is not None:
            found |= {each.name: each for each in filter_consistency.sensor_metrics(name, cls.row_count)}
    return found


def recorded_metrics(record: Mapping[str, Any]) -> dict[str, Metric]:
    """Descriptions of the metrics of a campaign's plugin and sensors, by name, from its `campaign.json`."""
    return _metrics_of_sensors(record.get("scenario") or {}) | described_plugin(record.get("plugin") or {}).definitions


def _of_tables(tables: Mapping[str, Any]) -> Plugin | None:
    reference, digest = tables.get("plugin"), tables.get("plugin_sha256")
    if not isinstance(reference, str):
        return None
    key = (reference, str(digest))
    if (key not in _KNOWN or not _KNOWN[key].has_code) and is_permitted() and reference != FROM_PYTHON:
        load_for(dict(tables), allow=True)
    if key not in _KNOWN:
        load_for(dict(tables), allow=False)
    return _KNOWN[key]


def plugin_of(file: ScenarioFile) -> Plugin | None:
    """Plugin of a scenario, None without one."""
    return None if file.plugin is None else _KNOWN[file.plugin, str(file.plugin_sha256)]


def metrics_of(file: ScenarioFile) -> dict[str, Metric]:
    """Metrics of a scenario's plugin, and of the sensors that its filter believes, by name."""
    plugin = plugin_of(file)
    own = _metrics_of_sensors(dict.fromkeys(present_sensors(file), True))
    return own | ({} if plugin is None else plugin.definitions)


def catalogue_of(file: ScenarioFile) -> dict[str, Metric]:
    """Metrics of the package that a scenario may have, and of its plugin, by name."""
    own = {name: metric for name, metric in METRICS.items() if metric_needs.lacks(file, metric) is None}
    return own | metrics_of(file)


def stages_of(file: ScenarioFile, stages: Stages | None = None) -> Stages:
    """Stages with which a scenario is simulated: those given, else those of its plugin, else the packaged ones.

    Raises:
        RpojaxError: only the description of the plugin is known.
    """
    plugin = plugin_of(file)
    if plugin is None:
        return stages or Stages()
    require_code(file)
    if stages is not None and plugin.stages is not None and stages != plugin.stages:
        raise RpojaxError("stages: found some beside those of the plugin, expected either")
    return stages or plugin.stages or Stages()


def replaced_stages(file: ScenarioFile, beside: Collection[str] = ()) -> frozenset[str]:
    """Names of the stages that the plugin of a scenario replaces, where its code is known, and of those `beside` it."""
    plugin = plugin_of(file)
    return frozenset(beside).union(() if plugin is None or plugin.stages is None else plugin.stages.replaced)


def require_code(file: ScenarioFile) -> None:
    """Refuses a scenario of whose plugin only the description is known.

    Raises:
        ScenarioError: naming how to give the plugin.
    """
    plugin = plugin_of(file)
    if plugin is None or plugin.has_code:
        return
    expected = "allow_plugin=True, since a plugin is code that is executed"
    if file.plugin == FROM_PYTHON:
        expected = "the same metrics given again in Python, such as resume_campaign(folder, metrics=...)"
    raise ScenarioError("plugin", file.plugin, expected)


def check_metrics(file: ScenarioFile) -> None:
    """Refuses weights of tuning on metrics that the scenario does not have, or that have no derivative.

    Raises:
        ScenarioError: naming the key.
    """
    known = catalogue_of(file)
    for name in file.tuning.metrics or {}:
        if name not in known or not known[name].has_derivative:
            raise ScenarioError(f"tuning.metrics.{name}", name, "a metric with a derivative")
