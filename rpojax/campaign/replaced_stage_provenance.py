"""Provenance of replaced flight-software stages: records of names and digests, and comparison with a campaign's."""

from collections.abc import Mapping
from typing import Any

from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.scenario.plugins.function_digests import qualified_name, source_digest, values_digest

StageRecords = dict[str, dict[str, str | None]]


def replaced_stages(stages: Stages) -> StageRecords:
    """Name of each stage that is not the default -> its function, and the SHA-256 of its source and of its values.

    Values are what it captures, has bound or holds as an object. A digest is None where there is none.
    """
    functions = {name: getattr(stages, name) for name in stages.replaced}
    return {
        name: {
            "function": qualified_name(function),
            "source_sha256": source_digest(function),
            "values_sha256": values_digest(function),
        }
        for name, function in functions.items()
    }


def check_same_stages(recorded: Mapping[str, Any], stages: Stages) -> None:
    """Refuses stages that differ from those with which a campaign began.

    Raises:
        RpojaxError: naming the stage, and what was found and expected there.
    """
    replaced = replaced_stages(stages)
    for name in sorted({*recorded, *replaced}):
        found, expected = replaced.get(name), recorded.get(name)
        if not _are_same(found, expected):
            raise RpojaxError(
                f"stages: found {format_stage(found)} for {name}, expected {format_stage(expected)}, with which "
                "the campaign began; resume it with rpojax.resume_campaign(folder, stages=...)"
            )


def _are_same(found: Mapping[str, Any] | None, recorded: Mapping[str, Any] | None) -> bool:
    """Whether two records are of the same function; one recorded without a digest of its values had none to compare."""
    if found is None or recorded is None:
        return found is recorded
    unknown = "values_sha256" in recorded and recorded["values_sha256"] is None
    return not unknown and all(found[name] == value for name, value in recorded.items())


def format_stage(record: Mapping[str, Any] | None) -> str:
    """Record of one stage as text."""
    if record is None:
        return "the default"
    source, values = record.get("source_sha256"), record.get("values_sha256")
    known = [f"source {source[:12]}" if source else "source unknown", *([f"values {values[:12]}"] if values else [])]
    return f"{record.get('function')} ({', '.join(known)})"
