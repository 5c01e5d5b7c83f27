"""Configuration of a new campaign, as `campaign.json` records it, with the provenance of its results."""

import datetime
import platform
import secrets
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
import zarr

from rpojax.batching import batching_mode
from rpojax.batching.batching_mode import BatchingMode
from rpojax.campaign.storage import campaign_json
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.version import __version__


def new_configuration(
    file: ScenarioFile,
    seed: int,
    runs: int,
    first_run: int,
    block_size: int,
    histories: Mapping[str, Any],
    stages: Mapping[str, Any] | None = None,
    design: Mapping[str, Any] | None = None,
    report: bool = False,
    batching: BatchingMode = batching_mode.DEFAULT_MODE,
) -> dict[str, Any]:
    """Content of `campaign.json`.

    Args:
        file: the scenario
        seed: master seed
        runs: number of runs
        first_run: number of the first run
        block_size: runs per block and device
        histories: record of the retention rule
        stages: records of the replaced stages
        design: record of the experiment design, by default that of just these runs
        report: whether a report is wanted
        batching: how a tick is batched over the runs
    """
    return {
        "format": campaign_json.FORMAT_VERSION,
        "name": file.name,
        "description": file.description,
        "scenario": file.model_dump(mode="json"),
        "scenario_hash": scenario_digest(file),
        "seed": seed,
        "runs": runs,
        "first_run": first_run,
        "block_size": block_size,
        "histories": dict(histories),
        "stages": dict(stages or {}),
        "design": dict(design or {"first_run": first_run, "runs": runs}),
        "report": report,
        "batching": batching,
        "dtype": "float32" if file.precision == "single" else "float64",
        **provenance(len(jax.devices())),
    }


def provenance(devices: int) -> dict[str, Any]:
    """Entries of `campaign.json` on where and when it was made; the random `id` tells it from any other campaign."""
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
