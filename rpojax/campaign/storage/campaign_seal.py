"""Seal of a campaign folder: digests that bind identity, blocks, histories and changes of requirements together.

Seal of a JSON record: SHA-256 of its other entries, by which a change of any of them is noticed.

The seal of `campaign.json` is the root: manifests, digests of arrays, and changes of requirements contain it. Seals
show accidents and edits; who rewrites a whole folder consistently can compute them anew.
"""

import datetime
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rpojax.campaign.storage import atomic_files, safe_paths
from rpojax.errors import ResultError
from rpojax.untrusted.file_reading import FileKind

SEAL: Final = "seal"
"""Entry of a record that holds its seal."""
CAMPAIGN_SEAL: Final = "campaign_seal"
"""Entry of a record that holds the seal of the campaign that it belongs to."""
FOLDER: Final = "requirements"
_NAME: Final = re.compile(r"\d{6}\.json", re.ASCII)


def record_digest(record: Mapping[str, Any]) -> str:
    """SHA-256 of the entries of a record in the types of JSON, but for its seal; their order is without effect."""
    content = {key: value for key, value in record.items() if key != SEAL}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def sealed(record: Mapping[str, Any]) -> dict[str, Any]:
    """The record with its seal."""
    return {**record, SEAL: record_digest(record)}


def check_seal(path: Path, record: Mapping[str, Any], hint: str = "") -> str:
    """The seal of a record that was read from `path`.

    Raises:
        ResultError: it has none, or it is not that of its entries; with a hint.
    """
    found = record.get(SEAL)
    if found != record_digest(record):
        what = "no seal" if found is None else "entries that differ from its seal"
        raise ResultError(f"{path}: found {what}, expected the file as rpojax wrote it{hint}")
    return str(found)


def check_belongs(path: Path, record: Mapping[str, Any], campaign_seal: str | None, hint: str = "") -> None:
    """Checks the seal of a record, and that it belongs to a campaign; one without a seal has records without.

    Raises:
        ResultError: the record was changed, or belongs to another campaign.
    """
    if campaign_seal is None:
        if SEAL in record or CAMPAIGN_SEAL in record:
            raise ResultError(f"{path}: found a seal, expected none in a campaign whose campaign.json has none")
        return
    check_seal(path, record, hint)
    if record.get(CAMPAIGN_SEAL) != campaign_seal:
        raise ResultError(f"{path}: found the seal of another campaign.json, expected that of this one{hint}")


def array_binding(campaign_seal: str | None, place: str, first_run: int, runs: int = 1) -> str:
    """Text that enters the digest of arrays: campaign, place in the folder and run numbers; empty without a seal."""
    return "" if campaign_seal is None else f"{campaign_seal} {place} runs {first_run} to {first_run + runs - 1}\n"


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
