"""Making a campaign folder: there is none, or a whole one, whenever its maker dies and whoever else makes it too."""

import datetime
import os
import platform
import secrets
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tomli_w
import zarr

from rpojax.campaign import preflight
from rpojax.campaign.storage import atomic_files, campaign_json
from rpojax.errors import OutputError, UnfinishedError
from rpojax.scenario import scenario_file
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
) -> dict[str, Any]:
    """Content of `campaign.json`; `histories` is a rule as `Retention` writes it down, `stages` those replaced.

    `design` is the record of the design, by default that of just these runs; `report` tells whether one is wanted.
    """
    return {
        "format": campaign_json.FORMAT_VERSION,
        "name": file.name,
        "description": file.description,
        "scenario": file.model_dump(mode="json"),
        "scenario_hash": scenario_file.digest(file),
        "seed": seed,
        "runs": runs,
        "first_run": first_run,
        "block_size": block_size,
        "histories": dict(histories),
        "stages": dict(stages or {}),
        "design": dict(design or {"first_run": first_run, "runs": runs}),
        "report": report,
        "dtype": "float32" if file.precision == "single" else "float64",
        **provenance(len(jax.devices())),
    }


def provenance(devices: int) -> dict[str, Any]:
    """Entries of `campaign.json` about where and when it was made; `id` tells it from any other."""
    return {
        "id": secrets.token_hex(8),
        "versions": package_versions(),
        "device": device_description(devices),
        "created": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def package_versions() -> dict[str, str]:
    """Versions of what numbers depend on."""
    return {
        "rpojax": __version__,
        "jax": jax.__version__,
        "numpy": np.__version__,
        "zarr": zarr.__version__,
        "python": platform.python_version(),
    }


def device_description(count: int) -> str:
    """Some devices of this machine, as text."""
    return f"{count} x {jax.devices()[0].device_kind} ({platform.machine()})"


def create_folder(directory: Path, configuration: Mapping[str, Any], force: bool) -> None:
    """New campaign folder with its `campaign.json` and `scenario.toml`, made aside and put in place by a rename.

    Raises:
        OutputError: the folder exists and `force` is not given, or it holds something that is no campaign.
    """
    preflight.check_folder(directory, force)
    if not _move_into_place(directory, configuration, force):
        raise OutputError(f"--out: found {str(directory)!r}, which has just been made, expected no such folder")


def join_folder(directory: Path, configuration: Mapping[str, Any]) -> None:
    """The folder of a campaign that several share: made by the first to come, and checked by the others.

    Raises:
        RpojaxError: what is there is no campaign, or one that asks for something else.
    """
    if not os.path.lexists(directory):
        preflight.check_folder(directory, force=False)
        if _move_into_place(directory, configuration, force=False):
            return
    campaign_json.check_compatible(directory, campaign_json.read(directory), configuration)


def _move_into_place(directory: Path, configuration: Mapping[str, Any], force: bool) -> bool:
    """Whether the folder could be put into its place; it could not if another was faster."""
    place = Path(os.path.realpath(directory))
    made = place.with_name(atomic_files.partial_name(place.name))
    try:
        for left in atomic_files.stale_folders(place):
            shutil.rmtree(left, ignore_errors=True)
        made.mkdir(parents=True)
        atomic_files.write(made / "scenario.toml", tomli_w.dumps(configuration["scenario"]).encode())
        atomic_files.write_json(made / campaign_json.FILE_NAME, configuration)
        if force and place.exists():
            _remove_folder(place)
        return _try_rename(made, place)
    except (OSError, UnfinishedError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error).partition(", expected")[0]
        raise OutputError(f"--out: found {str(directory)!r} ({reason}), expected a folder to write to") from None
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _try_rename(made: Path, place: Path) -> bool:
    """Whether a folder could be renamed; it cannot replace one that holds something."""
    try:
        made.rename(place)
    except OSError:
        if os.path.lexists(place):
            return False
        raise
    return True


def _remove_folder(place: Path) -> None:
    """Removes a campaign at once, under another name, so that there is never half of it."""
    old = place.with_name(atomic_files.partial_name(place.name))
    place.rename(old)
    shutil.rmtree(old, ignore_errors=True)
