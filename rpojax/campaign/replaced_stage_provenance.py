"""Provenance of replaced flight-software stages: records of names and sources, and comparison with a campaign's."""

import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages

StageRecords = dict[str, dict[str, str | None]]


def replaced_stages(stages: Stages) -> StageRecords:
    """Name of each stage that is not the default -> its function, and the SHA-256 of its source (None if unknown)."""
    default = Stages()
    functions = {field.name: getattr(stages, field.name) for field in fields(Stages)}
    return {
        name: {"function": _qualified_name(function), "source_sha256": _source_digest(function)}
        for name, function in functions.items()
        if function is not getattr(default, name)
    }


def _qualified_name(function: Any) -> str:
    """Module and qualified name of a function, or of the class of a callable object."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _source_digest(function: Any) -> str | None:
    try:
        source = inspect.getsource(function if hasattr(function, "__qualname__") else type(function))
    except (OSError, TypeError):
        return None
    return hashlib.sha256(source.encode()).hexdigest()


def check_same_stages(recorded: Mapping[str, Any], stages: Stages) -> None:
    """Refuses stages that differ from those with which a campaign began.

    Raises:
        RpojaxError: naming the stage, and what was found and expected there.
    """
    replaced = replaced_stages(stages)
    for name in sorted({*recorded, *replaced}):
        found, expected = replaced.get(name), recorded.get(name)
        if found != expected:
            raise RpojaxError(
                f"stages: found {format_stage(found)} for {name}, expected {format_stage(expected)}, with which "
                "the campaign began; resume it with rpojax.resume_campaign(folder, stages=...)"
            )


def format_stage(record: Mapping[str, Any] | None) -> str:
    """Record of one stage as text."""
    if record is None:
        return "the default"
    source = record.get("source_sha256")
    return f"{record.get('function')} ({f'source {source[:12]}' if source else 'source unknown'})"
