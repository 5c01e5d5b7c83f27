"""Changes of requirements after a campaign: `requirements/000001.json` and so on, a chain from `campaign.json`."""

import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.campaign.storage.seal.record_seal import CAMPAIGN_SEAL, SEAL, check_belongs, sealed
from rpojax.errors import ResultError
from rpojax.untrusted.file_reading import FileKind

FOLDER: Final = "requirements"
_NAME: Final = re.compile(r"\d{6}\.json", re.ASCII)


@dataclass(frozen=True)
class RequirementChange:
    """A recorded change of the requirements on which a campaign is judged.

    Attributes:
        number: 1 for the first change
        changed: when
        reason: why, as its author says
        requirements: all that hold from then on, in the types of JSON
        seal: of the record
    """

    number: int
    changed: str
    reason: str
    requirements: list[dict[str, Any]]
    seal: str


def read_changes(directory: Path, campaign_seal: str | None) -> list[RequirementChange]:
    """Changes of a folder in their order, each bound to the one before and the first to `campaign.json`.

    Raises:
        ResultError: a record was changed, is missing in between, or does not belong to the campaign.
    """
    folder = directory / FOLDER
    safe_paths.check_no_links(directory, folder)
    if not folder.is_dir():
        return []
    paths = sorted(path for path in folder.iterdir() if _NAME.fullmatch(path.name))
    found: list[RequirementChange] = []
    for number, path in enumerate(paths, start=1):
        previous = found[-1].seal if found else campaign_seal
        found.append(_read(directory, path, number, campaign_seal, previous))
    return found


def record_change(
    directory: Path, campaign_seal: str, before: Sequence[RequirementChange], requirements: list[Any], reason: str
) -> None:
    """Writes a change after those `before` it.

    Raises:
        UnfinishedError: it cannot be written.
        ResultError: its path contains a symbolic link.
    """
    number = len(before) + 1
    path = directory / FOLDER / f"{number:06d}.json"
    safe_paths.make_folder(directory, path.parent)
    record = {
        "number": number,
        "changed": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "reason": reason,
        "requirements": requirements,
        "previous": before[-1].seal if before else campaign_seal,
        CAMPAIGN_SEAL: campaign_seal,
    }
    atomic_files.write_json(path, sealed(record))


def _read(
    directory: Path, path: Path, number: int, campaign_seal: str | None, previous: str | None
) -> RequirementChange:
    safe_paths.check_no_links(directory, path)
    content = atomic_files.read_json(path, "a change of requirements", FileKind.MANIFEST)
    if not isinstance(content, dict) or campaign_seal is None:
        raise ResultError(f"{path}: found no change of a sealed campaign, expected one")
    check_belongs(path, content, campaign_seal)
    if content.get("number") != number or content.get("previous") != previous:
        raise ResultError(f"{path}: found another change than number {number}, expected each after the one before")
    requirements = content.get("requirements")
    if not isinstance(requirements, list) or not all(isinstance(entry, dict) for entry in requirements):
        raise ResultError(f"{path}: found no list of requirements, expected one")
    return RequirementChange(
        number, str(content.get("changed")), str(content.get("reason")), requirements, str(content[SEAL])
    )
