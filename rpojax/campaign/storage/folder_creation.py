"""Creation of a campaign folder by a rename: it is absent or complete, also when makers die or several race for it."""

import contextlib
import os
import re
import shutil
import time
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import tomli_w

from rpojax.campaign import argument_checks
from rpojax.campaign.storage import atomic_files, campaign_configuration, campaign_seal, safe_paths
from rpojax.campaign.storage.campaign_configuration import FORMAT_VERSION, CampaignConfiguration
from rpojax.errors import OutputError, ResultError, RpojaxError, UnfinishedError
from rpojax.untrusted.file_reading import FileKind
from rpojax.untrusted.text_reading import read_text
from rpojax.untrusted.toml_reading import parse_toml

_STALE_S = 600.0
"""Age after which a partial file counts as stale on any machine [s]: writing one takes moments."""
_PARTIAL = re.compile(r"\.(?P<machine>[0-9a-f]{8})-(?P<process>\d+)-\d+\.partial$")
_SCENARIO_NAME = "scenario.toml"


def remove_stale_files(folder: Path) -> None:
    """Removes the partial files below a folder whose writers have ended on this machine, or that are old."""
    for place, _, names in os.walk(folder):
        for name in names:
            if _is_stale(Path(place, name)):
                with contextlib.suppress(OSError):  # a file of another user
                    Path(place, name).unlink()


def stale_folders(directory: Path) -> list[Path]:
    """Partial folders that were to become `directory` and whose makers were killed."""
    if not directory.parent.is_dir():
        return []
    start = atomic_files.partial_prefix(directory.name)
    found = [path for path in directory.parent.iterdir() if path.name.startswith(start) and path.is_dir()]
    return [path for path in found if not path.is_symlink() and _is_stale(path)]


def _is_stale(path: Path) -> bool:
    found = _PARTIAL.search(path.name)
    if not found:
        return False
    if found["machine"] == atomic_files.machine_id() and not _is_running(int(found["process"])):
        return True
    try:
        return time.time() - path.lstat().st_mtime > _STALE_S
    except OSError:
        return False


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True


def create_folder(directory: Path, configuration: CampaignConfiguration, force: bool) -> None:
    """Creates a campaign folder with its `campaign.json` and `scenario.toml`.

    Raises:
        OutputError: the folder exists and `force` is not given, or it holds something that is no campaign.
    """
    argument_checks.check_folder(directory, force)
    if not _move_into_place(directory, configuration, force):
        raise OutputError.of_argument(
            "out", f"found {str(directory)!r}, which has just been made, expected no such folder"
        )


def join_folder(directory: Path, configuration: CampaignConfiguration) -> None:
    """Creates the folder of a campaign that several processes share, or checks that the existing one agrees.

    Raises:
        RpojaxError: what exists is no campaign, or one with another configuration.
    """
    if not os.path.lexists(directory):
        argument_checks.check_folder(directory, force=False)
        if _move_into_place(directory, configuration, force=False):
            return
    campaign_configuration.check_compatible(directory, campaign_configuration.read(directory), configuration)


def check_scenario_copy(directory: Path, configuration: CampaignConfiguration) -> None:
    """Refuses a `scenario.toml` that says another thing than `campaign.json`; one that is missing is no harm.

    Raises:
        ResultError: it differs, or cannot be read.
    """
    path = directory / _SCENARIO_NAME
    safe_paths.check_no_links(directory, path)
    if not path.exists():
        return
    try:
        found = parse_toml(read_text(path, FileKind.SCENARIO))
    except RpojaxError as error:
        raise ResultError(f"{path}: found no readable scenario ({error}), expected that of campaign.json") from None
    if found != tomllib.loads(tomli_w.dumps(configuration.scenario)):
        raise ResultError(f"{path}: found another scenario, expected that of campaign.json")


def _move_into_place(directory: Path, configuration: CampaignConfiguration, force: bool) -> bool:
    """Makes the folder under a temporary name and renames it; false if another process was faster."""
    # The format is the present one also for a rerun of an older campaign.
    record = campaign_seal.sealed(replace(configuration, format_version=FORMAT_VERSION).to_record())
    place = Path(os.path.realpath(directory))
    try:
        with _temporary_folder(place) as made:
            made.mkdir(parents=True)
            atomic_files.write(made / _SCENARIO_NAME, tomli_w.dumps(configuration.scenario).encode())
            atomic_files.write_json(made / campaign_configuration.FILE_NAME, record)
            return _takes_place(made, place, force)
    except (OSError, UnfinishedError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error).partition(", expected")[0]
        raise OutputError.of_argument(
            "out", f"found {str(directory)!r} ({reason}), expected a folder to write to"
        ) from None


@contextlib.contextmanager
def made_whole(directory: Path, force: bool) -> Iterator[Path]:
    """A temporary folder for a campaign, which takes the place of `directory` at the end of the body, if it succeeds.

    Raises:
        OutputError: there is something that `force` does not let it replace, or the folder cannot be moved.
    """
    argument_checks.check_folder(directory, force)
    place = Path(os.path.realpath(directory))
    try:
        with _temporary_folder(place) as made:
            yield made
            if not _takes_place(made, place, force):
                raise OutputError(f"{directory}: exists already; force=True replaces it")
    except OSError as error:
        raise OutputError(f"{directory}: found {error.strerror or error}, expected a folder to write to") from None


@contextlib.contextmanager
def _temporary_folder(place: Path) -> Iterator[Path]:
    """A folder to be made beside a place, gone at the end; those of processes that were killed are removed."""
    made = place.with_name(atomic_files.partial_name(place.name))
    try:
        for stale in stale_folders(place):
            shutil.rmtree(stale, ignore_errors=True)
        yield made
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _takes_place(made: Path, place: Path, force: bool) -> bool:
    """Whether the folder could be renamed; without `force` it cannot replace a folder that is not empty."""
    if force and place.exists():
        _remove_folder(place)
    try:
        made.rename(place)
    except OSError:
        if os.path.lexists(place):
            return False
        raise
    return True


def _remove_folder(place: Path) -> None:
    """Removes a campaign after renaming it, so that there is never half of it under its name."""
    old = place.with_name(atomic_files.partial_name(place.name))
    place.rename(old)
    shutil.rmtree(old, ignore_errors=True)
