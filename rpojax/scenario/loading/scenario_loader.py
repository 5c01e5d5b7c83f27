"""Scenario files, packaged or of the user, read and validated."""

import copy
import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from rpojax.errors import RpojaxError, ScenarioError
from rpojax.metrics import metric_catalogue
from rpojax.scenario.checks.consistency_checks import check_consistency
from rpojax.scenario.checks.requirement_checks import check_requirements
from rpojax.scenario.checks.validation_errors import did_you_mean, first_error
from rpojax.scenario.loading import case_table_csv, format_migration
from rpojax.scenario.loading.replaced_nominals import Layer, check_no_replaced_key_is_set
from rpojax.scenario.loading.starts import start_files
from rpojax.scenario.loading.table_merging import apply_override, merge
from rpojax.scenario.plugins import plugin_file, plugin_registry
from rpojax.scenario.plugins.custom_metrics import MetricFunction
from rpojax.scenario.plugins.plugin import Plugin
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import NO_LANDMARKS
from rpojax.scenario.team.team_checks import check_team
from rpojax.scenario.trained import trained_files
from rpojax.scenario.trained.coverage_surface import SURFACES
from rpojax.untrusted.file_reading import FileError, FileKind, absolute_path, is_folder
from rpojax.untrusted.structure_limits import StructureError
from rpojax.untrusted.text_reading import read_text
from rpojax.untrusted.toml_reading import parse_toml

_MAX_EXTENDS_DEPTH = 8
_READ_FIRST = ("plugin", "start")
"""A key and a section whose files are read before overrides are applied."""
_MOST_BESIDE = 500
"""Most files beside one that is not there that are compared with its name."""


def packaged_names() -> list[str]:
    """Names of the packaged scenarios."""
    folder = resources.files("rpojax.scenario") / "packaged"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load(
    source: str | Path, overrides: Sequence[str] = (), *, allow_plugin: bool = False, plugin: Plugin | None = None
) -> ScenarioFile:
    """Validated scenario from a packaged name or the path of a TOML file, with `KEY=VALUE` overrides.

    A file with `extends = NAME_OR_PATH` needs only the keys that differ, its dispersions are added to the base's.
    The CSV file of a `table` design is read here, its values become part of the scenario.

    Args:
        source: packaged name or path
        overrides: `KEY=VALUE`
        allow_plugin: execute the Python file that the scenario names as its `plugin`
        plugin: metrics, sensors and stages from Python, for a scenario that names none

    Raises:
        ScenarioError: the source is unknown, a key is not acceptable, or a plugin is not allowed.
    """
    return read(source, overrides, allow_plugin=allow_plugin, plugin=plugin).scenario()


@dataclass(frozen=True)
class ScenarioReading:
    """Tables of a scenario before it is validated, and the layers that they were merged from."""

    tables: dict[str, Any]
    layers: Sequence[Layer]

    def scenario(self) -> ScenarioFile:
        """The validated scenario.

        Raises:
            ScenarioError: a key is not acceptable.
        """
        file = validate(self.tables)
        check_no_replaced_key_is_set(self.layers, self.tables)
        return file


def read(
    source: str | Path, overrides: Sequence[str] = (), *, allow_plugin: bool = False, plugin: Plugin | None = None
) -> ScenarioReading:
    """What `load` validates; arguments and errors are those of `load`."""
    layers, tables = _merge_files(_read_files(source))
    _find_plugin(tables, allow_plugin, plugin)
    if "start" in tables:
        start_files.check_nothing_is_set_beside([layer.changes for layer in layers])
        without_start = copy.deepcopy(tables)
        layers.append(Layer(without_start, start_files.resolve_start(tables)))
    before = copy.deepcopy(tables)
    changes: dict[str, Any] = {}
    for override in overrides:
        changes = merge(changes, apply_override(tables, override))
    for name in _READ_FIRST:
        if name in changes:
            found = next(each for each in overrides if each.strip().startswith(name))
            expected = f"{name} in the scenario file, which is read before overrides"
            raise ScenarioError("overrides", found, expected, is_argument=True)
    _load_case_table(tables)
    return ScenarioReading(tables, [*layers, Layer(before, changes, is_override=True)])


def validate(tables: Mapping[str, Any]) -> ScenarioFile:
    """Validated scenario from nested tables in the units of the keys.

    Raises:
        ScenarioError: naming the key's path, what was found and what was expected.
    """
    with metric_catalogue.metrics_of_scenario(plugin_registry.metrics_for(tables)):
        file = _of_schema(tables)
        check_consistency(file)
        check_team(file)
    return file


def validate_recorded(tables: Mapping[str, Any]) -> ScenarioFile:
    """Scenario of a stored campaign, for reading what was simulated.

    One of an older format is brought to the present one. It passed the checks of its own version; those of this one
    are for what is simulated, but for the checks of its requirements.

    Raises:
        ScenarioError: naming the key's path, what was found and what was expected.
    """
    present = copy.deepcopy(dict(tables))
    if not format_migration.migrate_recorded(present):
        return validate(tables)
    with metric_catalogue.metrics_of_scenario(plugin_registry.metrics_for(present)):
        file = _of_schema(present)
        check_requirements(file)
    return file


def _of_schema(tables: Mapping[str, Any]) -> ScenarioFile:
    try:
        file = plugin_registry.schema_for(tables).model_validate(tables)
    except ValidationError as error:
        raise first_error(error, tables) from None
    plugin_registry.check_metrics(file)
    return file


def with_metrics(file: ScenarioFile, metrics: Mapping[str, MetricFunction] | None) -> ScenarioFile:
    """The scenario with metrics of a user's own functions, `metrics` as in a plugin; None for none.

    Raises:
        RpojaxError: a metric cannot be used, or the scenario has a plugin already.
    """
    if not metrics:
        return file
    if file.plugin is not None:
        raise RpojaxError.of_argument("metrics", "found some beside the scenario's plugin, expected them in the plugin")
    return validate({**file.model_dump(), **plugin_registry.add(Plugin(metrics=metrics))})


def _find_plugin(tables: dict[str, Any], allow: bool, plugin: Plugin | None) -> None:
    """Loads the plugin that a scenario names, or gives it that from Python."""
    if plugin is not None:
        if "plugin" in tables:
            raise ScenarioError("plugin", tables["plugin"], "none in the file beside one from Python")
        tables.update(plugin_registry.add(plugin))
    plugin_registry.load_for(tables, allow)


def with_duration(file: ScenarioFile, duration_s: float) -> ScenarioFile:
    """The scenario simulated for another time [s], without its requirements in windows.

    Raises:
        ScenarioError: the duration does not suit the scenario.
    """
    kept = [each.model_dump() for each in file.requirements if not each.window.suffix]
    return validate({**file.model_dump(), "duration_s": duration_s, "requirements": kept})


def _merge_files(files: Sequence[tuple[str, dict[str, Any]]]) -> tuple[list[Layer], dict[str, Any]]:
    """Changes that each file makes to those before it, and the tables of all together."""
    layers, tables = [], {}
    for source, changes in files:
        layers.append(Layer(tables, changes, source=source))
        tables = merge(tables, changes)
    return layers, copy.deepcopy(tables)


def _read_files(source: str | Path, depth: int = 0) -> list[tuple[str, dict[str, Any]]]:
    """Name and tables of a file after those of the files that it extends."""
    if depth > _MAX_EXTENDS_DEPTH:
        raise ScenarioError("extends", str(source), "a chain of scenarios that ends")
    text, folder = _read_text(source)
    try:
        tables = parse_toml(text)
    except StructureError as error:
        raise ScenarioError.of_structure(str(source), error) from None
    _resolve_paths(tables, folder)
    base = tables.pop("extends", None)
    if base is None:
        format_migration.migrate(tables, {}, str(source))
        return [(str(source), tables)]
    if not isinstance(base, str):
        raise ScenarioError("extends", base, "the name of a packaged scenario or the path of a TOML file")
    extended = _read_files(base if base in packaged_names() else folder / base, depth + 1)
    before = functools.reduce(merge, (changes for _, changes in extended), {})
    format_migration.migrate(tables, before, str(source))
    return [*extended, (str(source), tables)]


def _read_text(source: str | Path) -> tuple[str, Path]:
    """Text of a scenario, and the folder to which its paths are relative."""
    if str(source) in packaged_names():
        return (resources.files("rpojax.scenario") / "packaged" / f"{source}.toml").read_text(), Path()
    path = Path(source)
    try:
        text = read_text(path, FileKind.SCENARIO)
    except FileError as error:
        if error.is_there and (path.suffix == ".toml" or not is_folder(path)):
            raise ScenarioError("scenario", f"{source} ({error.found})", error.expected) from None
        raise ScenarioError("scenario", str(source), _instead_of(path)) from None
    return text.replace("\r\n", "\n").replace("\r", "\n"), path.parent


def _instead_of(missing: Path) -> str:
    """What was expected in place of a missing file, with the most similar name of a scenario or of a file beside it."""
    try:
        beside = sorted(path.name for path in itertools.islice(missing.parent.glob("*.toml"), _MOST_BESIDE))
    except (OSError, ValueError):  # a name with a zero byte is a ValueError
        beside = []
    # Names alone are compared: two files of one long folder are always alike.
    near = did_you_mean(missing.name, [*packaged_names(), *(name for name in beside if name != missing.name)])
    return f"{' '.join(packaged_names())} or a TOML file{near}"


def _resolve_paths(tables: dict[str, Any], folder: Path) -> None:
    """Makes the paths of trained files and of a case table absolute."""
    if isinstance(reference := tables.get("plugin"), str):
        tables["plugin"] = plugin_file.absolute_reference(reference, folder)
    start = tables.get("start")
    for key in ("target", "servicer"):
        if isinstance(start, dict) and isinstance(name := start.get(key), str):
            start[key] = str(absolute_path(folder / name))
    trained = [("imaging", key) for key in trained_files.PACKAGED_FILES]
    for section, key in (*trained, ("wide_lens", "statistics"), ("camera", "landmarks")):
        table = tables.get(section)
        name = table.get(key) if isinstance(table, dict) else None
        if isinstance(name, str) and name not in (trained_files.PACKAGED, NO_LANDMARKS) and isinstance(table, dict):
            table[key] = str(absolute_path(folder / name))
    coverage = tables.get("coverage")
    if isinstance(coverage, dict) and isinstance(name := coverage.get("surface"), str) and name not in SURFACES:
        coverage["surface"] = str(absolute_path(folder / name))
    design = tables.get("design")
    if isinstance(design, dict) and isinstance(design.get("file"), str) and design["file"]:
        design["file"] = str(folder.absolute() / design["file"])


def _load_case_table(tables: dict[str, Any]) -> None:
    """Replaces the file of a `table` design by its values, so that the scenario is complete without the file."""
    design = tables.get("design")
    if not isinstance(design, dict) or design.get("kind") != "table" or not isinstance(design.get("file"), str):
        return
    if design["file"] and design.get("values"):
        raise ScenarioError("design.file", design["file"], "no file beside values")
    if design["file"]:
        tables["design"] = {**design, "file": "", "values": case_table_csv.read_columns(Path(design["file"]))}
