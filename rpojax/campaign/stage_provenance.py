"""Which stages of the flight software a campaign replaced, as text that can be written down and compared."""

import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from rpojax.errors import RpojaxError
from rpojax.flight.computer import Stages

Described = dict[str, dict[str, str | None]]


def describe(stages: Stages) -> Described:
    """Name of each stage that is not the default -> its function, and the SHA-256 of its source (None if unknown)."""
    default = Stages()
    replaced = {field.name: getattr(stages, field.name) for field in fields(Stages)}
    return {
        name: {"function": _name(function), "source_sha256": _digest(function)}
        for name, function in replaced.items()
        if function is not getattr(default, name)
    }


def _name(function: Any) -> str:
    """Module and qualified name; of the class where an object is called."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{named.__module__}.{named.__qualname__}"


def _digest(function: Any) -> str | None:
    try:
        source = inspect.getsource(function if hasattr(function, "__qualname__") else type(function))
    except (OSError, TypeError):
        return None
    return hashlib.sha256(source.encode()).hexdigest()


def check_same(recorded: Mapping[str, Any], stages: Stages) -> None:
    """Refuses to go on with other stages than those that a campaign began with.

    Raises:
        RpojaxError: naming the stage, and what was found and expected there.
    """
    given = describe(stages)
    for name in sorted({*recorded, *given}):
        found, expected = given.get(name), recorded.get(name)
        if found != expected:
            raise RpojaxError(
                f"stages: found {text(found)} for {name}, expected {text(expected)}, with which the campaign began; "
                "resume it with rpojax.resume_campaign(folder, stages=...)"
            )


def text(described: Mapping[str, Any] | None) -> str:
    """One stage for a reader."""
    if described is None:
        return "the default"
    source = described.get("source_sha256")
    return f"{described.get('function')} ({f'source {source[:12]}' if source else 'source unknown'})"
