"""Provenance of results, and the configuration of a new campaign with it."""

import datetime
import platform
import secrets
from collections.abc import Mapping
from typing import Any, TypedDict

import jax
import numpy as np
import zarr

from rpojax.batching import batching_mode
from rpojax.batching.batching_mode import BatchingMode
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.errors import RpojaxError
from rpojax.flight.stages import Stages
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.plugins.function_digests import qualified_name, source_digest, values_digest
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.version import __version__

StageRecords = dict[str, dict[str, str | None]]


class Provenance(TypedDict):
    """Entries of `campaign.json` on where and when it was made; the random `id` tells it from any other campaign."""

    id: str
    versions: dict[str, str]
    device: str
    created: str


def new_configuration(
    file: ScenarioFile,
    options: CampaignOptions,
    stages: Mapping[str, Any] | None = None,
    design_sha256: str | None = None,
    batching: BatchingMode = batching_mode.DEFAULT_MODE,
) -> CampaignConfiguration:
    """Configuration of a new campaign.

    Args:
        file: the scenario
        options: with a block size
        stages: records of the replaced stages
        design_sha256: of the values that the experiment design assigns
        batching: how a tick is batched over the runs
    """
    plugin = plugin_registry.plugin_of(file)
    return CampaignConfiguration(
        name=file.name,
        description=file.description,
        scenario=file.model_dump(mode="json"),
        scenario_hash=scenario_digest(file),
        options=options,
        stages=dict(stages or {}),
        design_sha256=design_sha256,
        batching=batching,
        plugin=None if plugin is None else {"sha256": file.plugin_sha256, **plugin.describe()},
        dtype="float32" if file.precision == "single" else "float64",
        **new_provenance(len(jax.devices())),
    )


def new_provenance(devices: int) -> Provenance:
    """Provenance of a campaign that is made now with a number of devices."""
    return {
        "id": secrets.token_hex(8),
        "versions": package_versions(),
        "device": device_description(devices),
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def package_versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    return {
        "rpojax": __version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "zarr": zarr.__version__,
        "python": platform.python_version(),
    }


def device_description(count: int) -> str:
    """Number and kind of devices of this machine, as text."""
    return f"{count} x {jax.devices()[0].device_kind} ({platform.machine()})"


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
