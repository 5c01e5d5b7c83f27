"""Keys of a resolved scenario: value, unit, the file from which each comes, and meaning."""

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, get_args

from pydantic import BaseModel

from rpojax.errors import UnknownKeyError
from rpojax.scenario.checks.nearest_key import nearest_key
from rpojax.scenario.loading.replaced_nominals import Layer
from rpojax.scenario.loading.scenario_loader import ScenarioReading
from rpojax.scenario.loading.table_merging import dispersion_name, key_names
from rpojax.scenario.numbers.key_units import unit_symbol
from rpojax.scenario.setting_meanings import setting_meaning
from rpojax.scenario.warnings.key_uses import USES, keys_of
from rpojax.value_types import ChangesOf

DEFAULT: Final = "default"
"""Origin of a key that no file gives."""
_OVERRIDE: Final = "--set"
_FURTHER_UNITS: Final = {"_m_px": "m/pixel", "_hz": "Hz"}
"""Units of settings that are no parameters, by suffix."""
_NUMBERED: Final = "requirements"
_BY_NAME: Final = ("faults", "phases", "servicers", "thrusters")
"""Lists of which each part has a name."""
_WHOLE: Final = (*_BY_NAME, _NUMBERED, "design")
"""What a file replaces as a whole (`table_merging.merge`); overrides set keys in place."""


@dataclass(frozen=True)
class ShownKey:
    """A key of a scenario as it is simulated.

    Attributes:
        key: with its section; that of a phase, servicer or thruster has its name, of a requirement its number
        value: in its unit, None for one that may be left out and is
        unit: empty for what is no number, or has none
        origin: name of the file that gives it, `--set`, or `default`
        before: value and origin that this replaces, None if it replaces none
        meaning: of the key
        varied_by: kind of the dispersion, or of the design, that gives runs values of their own; empty without
        needs: what it needs beside it to have an effect; empty for most
    """

    key: str
    value: Any
    unit: str
    origin: str
    before: tuple[Any, str] | None
    meaning: str
    varied_by: str
    needs: str


def shown_keys(reading: ScenarioReading, wanted: str = "") -> list[ShownKey]:
    """Keys of a scenario in the order of its schema: all, those of a section, or one; `phases.0` is the first phase.

    Raises:
        ScenarioError: the scenario is not acceptable.
        UnknownKeyError: it has no such key or section.
    """
    file = reading.scenario()
    wanted, tables = _by_name(file, wanted), file.model_dump()
    varied = _varied_keys(tables)
    leaves = [
        leaf
        for leaf in _leaves(file, tables, "")
        if not wanted or leaf[0] == wanted or leaf[0].startswith(f"{wanted}.")
    ]
    found = [_shown(reading, key, value, meaning, varied) for key, value, meaning in leaves or _left_out(file, wanted)]
    if not found:
        known = [key for key, _, _ in _leaves(file, tables, "")]
        raise UnknownKeyError(wanted, _hint(wanted, known) or ", expected a key or section of the scenario")
    return found


def _by_name(file: BaseModel, wanted: str) -> str:
    """A key with the name of what it gives by its place in a list, as errors of a scenario do."""
    section, _, rest = wanted.partition(".")
    number, *inner = rest.split(".")
    held = getattr(file, section, None)
    if section not in _BY_NAME or not number.isdecimal() or not isinstance(held, list) or int(number) >= len(held):
        return wanted
    return ".".join((section, held[int(number)].name, *inner))


def _hint(wanted: str, known: Sequence[str]) -> str:
    """The nearest key or section of the scenario."""
    sections = {key.rpartition(".")[0] for key in known} - {""}
    near = difflib.get_close_matches(wanted[:100], [*sections, *known], n=1, cutoff=0.75)
    if not near and (hint := nearest_key(wanted)):
        return hint
    near = near or difflib.get_close_matches(wanted[:100], known, n=1, cutoff=0.5)
    return f" (did you mean {near[0]!r}?)" if near else ""


def _left_out(file: BaseModel, wanted: str) -> Iterator[tuple[str, Any, str]]:
    """A key that may be left out and is, or those of a section of which all are: no value, and the meaning of each."""
    model: Any = file
    parts, kind = wanted.split("."), type(file)
    for place, part in enumerate(parts):
        if isinstance(model, list | dict):
            model = model.get(part) if isinstance(model, dict) else _named(model, part)
            kind = type(model)
        elif (field := getattr(kind, "model_fields", {}).get(part)) is not None:
            model, kind = getattr(model, part, None), _section(field.annotation)
            if place == len(parts) - 1 and model is None:
                yield wanted, None, field.description or setting_meaning(wanted)
        else:
            return
    if isinstance(model, BaseModel):
        for name in type(model).model_fields:
            yield from _left_out(file, f"{wanted}.{name}")


def _named(models: Sequence[BaseModel], name: str) -> BaseModel | None:
    return next((each for each in models if getattr(each, "name", None) == name), None)


def _section(annotation: Any) -> type | None:
    """The section that an annotation allows beside None, whole or in part; None where there is not just one."""
    found = [annotation, *get_args(annotation)]
    found += [mark.section for each in found for mark in get_args(each) if isinstance(mark, ChangesOf)]
    sections = [each for each in found if isinstance(each, type) and issubclass(each, BaseModel)]
    return sections[0] if len(sections) == 1 else None


def _leaves(model: BaseModel, tables: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any, str]]:
    """Key, value and meaning of what a section holds, in its order."""
    for name, value in tables.items():
        key, held = f"{prefix}{name}", getattr(model, name, None)
        field = type(model).model_fields.get(name)
        meaning = (field.description if field else None) or setting_meaning(key)
        if isinstance(held, BaseModel) and isinstance(value, dict):
            yield from _leaves(held, value, f"{key}.")
        elif isinstance(held, dict) and any(isinstance(each, BaseModel) for each in held.values()):
            for inner, part in held.items():
                yield from _leaves(part, value[inner], f"{key}.{inner}.")
        elif isinstance(held, list) and held and isinstance(held[0], BaseModel):
            yield from _of_list(name, held, value)
        elif isinstance(held, dict) and held and key != "design.values":  # Files are merged in it key by key.
            for inner, part in held.items():
                yield f"{key}.{inner}", part, setting_meaning(f"{key}.{inner}") or meaning
        else:
            yield key, value, meaning


def _of_list(name: str, held: Sequence[BaseModel], tables: Sequence[dict[str, Any]]) -> Iterator[tuple[str, Any, str]]:
    """Keys of phases and servicers by their names; dispersions and requirements whole."""
    for index, (model, table) in enumerate(zip(held, tables, strict=True)):
        if name == "dispersions":
            rest = {key: value for key, value in table.items() if key not in ("key", "keys")}
            yield f"{name}.{dispersion_name(table)}", rest, "differs from run to run"
        elif name == _NUMBERED:
            yield f"{name}.{index}", table, "what is asked of the runs"
        else:
            yield from _leaves(model, table, f"{name}.{table['name']}.")


def _shown(reading: ScenarioReading, key: str, value: Any, meaning: str, varied: Mapping[str, str]) -> ShownKey:
    givers = _givers(reading, key)
    if key == "design.file" and givers:
        value = givers[-1][0]  # As given: its values have been read.
    origin = givers[-1][1] if givers else DEFAULT
    before = givers[-2] if len(givers) > 1 and givers[-2][0] != givers[-1][0] else None
    needs = dict.fromkeys(use.needs for use in USES if any(key in keys_of(pattern) for pattern in use.keys))
    return ShownKey(key, value, _unit(key, value), origin, before, meaning, varied.get(key, ""), "; ".join(needs))


def _givers(reading: ScenarioReading, key: str) -> list[tuple[Any, str]]:
    """What each file, and the overrides, give for a key, and the name of each, in their order, since it was absent."""
    section, found = key.partition(".")[0], []
    results = [*(layer.before for layer in reading.layers[1:]), reading.tables]
    for layer, result in zip(reading.layers, results, strict=True):
        if (section in _WHOLE and _is_whole(layer, section)) or _given(result, key) is None:
            found = []
        if (value := _given(layer.changes, key)) is not None and _given(result, key) is not None:
            found.append((value, _name(layer)))
    if section == "dispersions" and (value := _given(reading.tables, key)) != _given(reading.layers[-1].before, key):
        found.append((value, _OVERRIDE))  # The changes of overrides are without dispersions.
    design = reading.tables.get("design")
    if key == "design.values" and not found and isinstance(design, dict) and design.get("values"):
        found += [(design["values"], str(file)) for file, _ in _givers(reading, "design.file")]
    return found


def _is_whole(layer: Layer, section: str) -> bool:
    """Whether a layer replaces what those before it give of a section."""
    given = layer.changes.get(section)
    return isinstance(given, list) or (given is not None and not layer.is_override)


def _name(layer: Layer) -> str:
    return layer.source or (_OVERRIDE if layer.is_override else "files of [start]")


def _given(changes: Mapping[str, Any], key: str) -> Any:
    """What a file gives for a key, None if nothing; lists of phases and servicers are given as a whole."""
    parts = key.split(".")
    if parts[0] == "dispersions":
        entries = changes.get("dispersions")
        named = [each for each in entries if dispersion_name(each) == key[12:]] if isinstance(entries, list) else []
        return {name: value for name, value in named[-1].items() if name not in ("key", "keys")} if named else None
    table: Any = changes
    for place, part in enumerate(parts):
        if isinstance(table, list):
            table = _entry(table, part)
        elif place and not isinstance(table, dict):
            return None
        else:
            table = table.get(part)
        if table is None:
            return None
    return table


def _entry(entries: Sequence[Any], part: str) -> Any:
    """The table of a list with that name or number."""
    tables = [each for each in entries if isinstance(each, dict)]
    if part.isdigit():
        return tables[int(part)] if int(part) < len(tables) else None
    return next((each for each in tables if each.get("name") == part), None)


def _varied_keys(tables: Mapping[str, Any]) -> dict[str, str]:
    """Key -> kind of what gives every run a value of its own."""
    found = {}
    for entry in tables["dispersions"]:
        for key in key_names(entry):
            found[key.partition("[")[0]] = f"{entry['kind']} dispersion"
    values = tables["design"].get("values")
    for key in values if isinstance(values, dict) else ():
        found[key.partition("[")[0]] = f"{tables['design']['kind']} of the design"
    return found


def _unit(key: str, value: Any) -> str:
    inner = value
    while isinstance(inner, list) and inner:
        inner = inner[0]
    if isinstance(inner, bool) or not isinstance(inner, int | float):
        return ""
    further = next((unit for suffix, unit in _FURTHER_UNITS.items() if key.endswith(suffix)), "")
    symbol = further or unit_symbol(key)
    return "" if symbol == "1" else symbol
