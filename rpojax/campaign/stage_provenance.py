"""Which stages of the flight software a campaign replaced, as text that can be written down and compared."""

import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages

StageRecords = dict[str, dict[str, str | None]]


def replaced_stages(stages: Stages) -> StageRecords:
    """Name of each stage that is not the default -> its function, and the SHA-256 of its source (None if unknown)."""
    default = Stages()
    replaced = {field.name: getattr(stages, field.name) for field in fields(Stages)}
    return {
        name: {"function": _qualified_name(function), "source_sha256": _source_digest(function)}
        for name, function in replaced.items()
        if function is not getattr(default, name)
    }


def _qualified_name(function: Any) -> str:
    """Module and qualified name; of the class where an object is called."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _source_digest(function: Any) -> str | None:
    try:
        source = inspect.getsource(function if hasattr(function, "__qualname__") else type(function))
    except (OSError, TypeError):
        return None
    return hashlib.sha256(source.encode()).hexdigest()


def check_same_stages(recorded: Mapping[str, Any], stages: Stages) -> None:
    """Refuses to go on with other stages than those that a campaign began with.

    Raises:
        RpojaxError: naming the stage, and what was found and expected there.
    """
    given = replaced_stages(stages)
    for name in sorted({*recorded, *given}):
        found, expected = given.get(name), recorded.get(name)
        if found != expected:
            raise RpojaxError(
                f"stages: found {format_stage(found)} for {name}, expected {format_stage(expected)}, with which "
                "the campaign began; resume it with rpojax.resume_campaign(folder, stages=...)"
            )


def format_stage(record: Mapping[str, Any] | None) -> str:
    """One stage for a reader."""
    if record is None:
        return "the default"
    source = record.get("source_sha256")
    return f"{record.get('function')} ({f'source {source[:12]}' if source else 'source unknown'})"
