"""Keys of a scenario: form, values and meaning from the schema, else meaning from the page on scenario files."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_PAGE = Path(__file__).parents[1] / "reference" / "scenario.md"
_LISTS = {"dispersions", "faults", "phases", "requirements", "servicers", "design"}


def lines() -> Iterator[str]:
    """Markdown: one section with a table for each section of the schema."""
    from rpojax.scenario.loading import scenario_loader
    from rpojax.scenario.schema import ScenarioFile
    from rpojax.value_types import Section

    schema = ScenarioFile.model_json_schema()
    file = scenario_loader.load("inspection")
    packaged = file.model_dump()
    meanings = _meanings(_PAGE.read_text(encoding="utf-8"))
    top = [name for name, field in schema["properties"].items() if "$ref" not in str(field) and name not in _LISTS]
    yield from _table("Top level", "", top, schema["properties"], packaged, meanings.get("Top level", {}), file)
    for name, entry in sorted(schema["properties"].items(), key=lambda each: each[0] not in packaged):
        definition = _definition(entry, schema)
        if name in _LISTS or definition is None:
            continue
        values = packaged.get(name) or {}
        assert isinstance(values, dict)
        keys = definition["properties"]
        section = getattr(file, name, None)
        text = definition.get("description", "") if isinstance(section, Section) or section is None else ""
        yield from _table(f"`{name}`", text, list(keys), keys, values, meanings.get(name, {}), file, name)
    fault = schema["$defs"]["FaultSection"]
    known = meanings.get("faults", {}) | {"name": "of the fault"}
    yield from _table(
        "`faults`", fault["description"], list(fault["properties"]), fault["properties"], {}, known, file, "faults.NAME"
    )
    yield from _phases(schema["$defs"], meanings["phases"], file)


def _phases(definitions: dict[str, Any], meanings: dict[str, str], file: Any) -> Iterator[str]:
    """Tables of the parts of a phase."""
    references = definitions["PhaseSection"]["properties"]["reference"]["discriminator"]["mapping"]
    parts = {"`phases`": "PhaseSection", "`phases.until`": "UntilSection", "`phases.corridor`": "CorridorSection"}
    parts |= {f"`phases.reference` of kind `{kind}`": path.rpartition("/")[2] for kind, path in references.items()}
    for heading, name in parts.items():
        text, keys = definitions[name]["description"], definitions[name]["properties"]
        section = heading.split("`")[1].replace("phases", "phases.NAME")
        known = meanings | {"kind": "kind of the reference"}
        yield from _table(heading, text, list(keys), keys, {}, known, file, section)


def _definition(entry: dict[str, Any], schema: dict[str, Any]) -> dict[str, Any] | None:
    options = [entry, *entry.get("anyOf", []), *entry.get("allOf", [])]
    found = next((option["$ref"] for option in options if "$ref" in option), None)
    return schema["$defs"][found.rpartition("/")[2]] if found else None


def _table(
    heading: str,
    text: str,
    names: list[str],
    keys: dict[str, Any],
    values: dict[str, Any],
    meanings: dict[str, str],
    file: Any,
    section: str = "",
) -> Iterator[str]:
    yield from (
        f"## {heading}",
        "",
        text,
        "",
        "| key | form | in `inspection` | varies | meaning | has an effect with |",
        "|---|---|---|---|---|---|",
    )
    for name in names:
        key = f"{section}.{name}" if section else name
        meaning = keys[name].get("description") or meanings.get(name, "")
        cells = (
            _form(keys[name]) + _default(keys[name]),
            _value(values.get(name), keys[name]),
            _varies(file, key, keys[name]),
            meaning,
        )
        yield f"| `{key}` | {' | '.join(cells)} | {_needed(key)} |"
    yield ""


def _needed(key: str) -> str:
    """What a key needs beside it to have an effect, nothing for most."""
    from rpojax.scenario.warnings.key_uses import FAULT_USES, USES, keys_of

    found = [use.needs for use in USES if any(key in keys_of(pattern) for pattern in use.keys)]
    found += [use.needs for use in FAULT_USES if key in {f"faults.NAME.{name}" for name in use.keys}]
    return "; ".join(dict.fromkeys(found))


def _varies(file: Any, key: str, entry: dict[str, Any]) -> str:
    from rpojax.scenario.parameter_keys import nominal_of_key

    is_of_phase = key.startswith(("faults.", "phases.")) and "description" in entry and entry.get("type") != "integer"
    return "yes" if is_of_phase or ("." in key and nominal_of_key(file, key) is not None) else ""


def _value(value: Any, entry: dict[str, Any]) -> str:
    if value is None:
        value = entry.get("default")
    text = "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
    return f"`{text}`" if 0 < len(text) <= 40 else "" if not text else f"`{text[:36]} ...`"


def _default(entry: dict[str, Any]) -> str:
    """What a number is that is left out."""
    default = entry.get("default")
    return f", default {default}" if isinstance(default, float | list) and default else ""


def _form(entry: dict[str, Any]) -> str:
    options = [option for option in entry.get("anyOf", [entry]) if option.get("type") != "null"]
    return " or ".join(_one_form(option) for option in options).replace("|", r"\|")


def _one_form(entry: dict[str, Any]) -> str:
    if "enum" in entry or "const" in entry:
        choices = entry.get("enum", [entry.get("const")])
        return ", ".join(f"`{choice}`" for choice in choices) if len(choices) < 9 else f"one of {len(choices)} names"
    if "$ref" in entry:
        return "table"
    kind = {"number": "number", "integer": "whole number", "string": "text", "boolean": "`true` or `false`"}
    if entry.get("type") == "array":
        low, high = entry.get("minItems", 0), entry.get("maxItems")
        count = f"{low}" if low == high else f"{low} to {high}" if high else f"{low} or more" if low else "list of"
        return f"{count} x ({_form(entry.get('items', {}))})"
    bounds = [
        f"{sign} {entry[name]:g}"
        for name, sign in (("exclusiveMinimum", ">"), ("minimum", "≥"), ("exclusiveMaximum", "<"), ("maximum", "≤"))
        if name in entry
    ]
    return " ".join([kind.get(entry.get("type", ""), "table"), ", ".join(bounds)]).strip()


def _meanings(page: str) -> dict[str, dict[str, str]]:
    """Section -> key -> meaning, from the tables of the page on scenario files, with links as plain text."""
    found: dict[str, dict[str, str]] = {}
    for part in re.split(r"^## ", page, flags=re.MULTILINE)[1:]:
        heading, _, body = part.partition("\n")
        for name in re.findall(r"`([^`]+)`", heading) or [heading.strip()]:
            rows = [line.strip("|").split("|") for line in body.splitlines() if line.startswith("| `")]
            for row in rows:
                for key in re.findall(r"`([^`]+)`", row[0]):
                    text = re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", row[-1].strip())
                    found.setdefault(name, {})[key] = text
    return found
