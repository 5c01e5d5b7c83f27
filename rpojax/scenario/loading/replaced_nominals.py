"""Keys that are set in vain, because a dispersion or the design gives every run a value of its own."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rpojax.dispersions.kinds.registry import kind_class
from rpojax.errors import ScenarioError
from rpojax.scenario.loading.table_merging import dispersion_name, key_names
from rpojax.scenario.parameter_keys import ParameterKey, parse_key

Tables = Mapping[str, Any]


@dataclass(frozen=True)
class Layer:
    """What one file, or the overrides, change in the tables that they get.

    Attributes:
        before: tables without the changes
        changes: tables of the changes
        is_override: whether they are overrides
        source: packaged name or path of the file, empty for what is no file
    """

    before: Tables
    changes: Tables
    is_override: bool = False
    source: str = ""


@dataclass(frozen=True)
class _Replacement:
    """A key whose nominal value has no effect.

    Attributes:
        parameter: the key, or a component
        what: replaces it
        removal: override that removes this
        lines: of a file that remove it
        layer: from which it comes
    """

    parameter: ParameterKey
    what: str
    removal: str
    lines: str
    layer: int


def check_no_replaced_key_is_set(layers: Sequence[Layer], tables: Tables) -> None:
    """Refuses a key that a file or an override sets, and that a dispersion or design from elsewhere replaces.

    A file may hold a nominal value beside the dispersion that replaces it; `tables` are the result of all layers.

    Raises:
        ScenarioError: naming the key, what replaces it, and how that is removed.
    """
    replacements = [*_dispersions(layers, tables), *_design(layers, tables)]
    for index, layer in enumerate(layers):
        for key, value, before in _set_keys(layer):
            for found in replacements:
                elsewhere = layer.is_override or found.layer < index
                if elsewhere and found.parameter.key == key and _is_in_vain(found.parameter.index, value, before):
                    raise _error(layer, key, value, found)


def _dispersions(layers: Sequence[Layer], tables: Tables) -> Iterator[_Replacement]:
    """Keys that dispersions replace, each by the last layer that has a dispersion of that name."""
    entries = tables.get("dispersions")
    for entry in entries if isinstance(entries, list) else []:
        kind = entry.get("kind") if isinstance(entry, dict) else None
        known = kind_class(kind)
        if known is None or known.uses_nominal:
            continue
        name = dispersion_name(entry)
        origin = max(index for index, layer in enumerate(layers) if _has_dispersion(layer, name) or index == 0)
        keys = key_names(entry)
        lines = f'[[dispersions]] with {"key" if len(keys) == 1 else "keys"} and kind = "none"'
        for text in keys:
            yield _Replacement(parse_key(text), f"the {kind} dispersion", f"dispersions.{name}=none", lines, origin)


def _has_dispersion(layer: Layer, name: str) -> bool:
    entries = layer.changes.get("dispersions")
    return isinstance(entries, list) and any(dispersion_name(entry) == name for entry in entries)


def _design(layers: Sequence[Layer], tables: Tables) -> Iterator[_Replacement]:
    """Keys whose values a table or grid lists."""
    design = tables.get("design")
    if not isinstance(design, dict) or not isinstance(values := design.get("values"), dict):
        return
    origin = max(index for index, layer in enumerate(layers) if "design" in layer.changes or index == 0)
    for text in values:
        what, lines = f"the {design['kind']} of the design", '[design] with kind = "independent"'
        yield _Replacement(parse_key(text), what, "design={kind='independent'}", lines, origin)


def _set_keys(layer: Layer) -> Iterator[tuple[str, Any, Any]]:
    """Keys of sections that a layer sets, with the new value and the one before."""
    sections = {name: table for name, table in layer.changes.items() if name != "design"}
    return _leaves(sections, layer.before, "")


def _leaves(changes: Tables, before: Any, prefix: str) -> Iterator[tuple[str, Any, Any]]:
    for name, value in changes.items():
        old = before.get(name) if isinstance(before, dict) else None
        if isinstance(value, dict):
            yield from _leaves(value, old, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value, old


def _is_in_vain(index: int | None, value: Any, before: Any) -> bool:
    """Whether a new value has no effect, or one component of it that differs from that before.

    A key that was absent is not set in vain: only one with a value can be dispersed.
    """
    if before is None:
        return False
    if index is None or not all(isinstance(each, list) and index < len(each) for each in (value, before)):
        return True
    return value[index] != before[index]


def _error(layer: Layer, key: str, value: Any, found: _Replacement) -> ScenarioError:
    where, why = f"no value beside {found.what} of {found.parameter}", "which replaces it in every run"
    if layer.is_override:
        return ScenarioError(
            "overrides", f"{key}={value}", f"{where}, {why}; {found.removal} removes that", is_argument=True
        )
    return ScenarioError(key, value, f"{where} in the base, {why}; {found.lines} removes that")
