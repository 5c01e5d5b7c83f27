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
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.version import __version__


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
