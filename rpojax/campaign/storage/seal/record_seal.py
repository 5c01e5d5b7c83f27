"""Seal of a JSON record: SHA-256 of its other entries, by which a change of any of them is noticed.

The seal of `campaign.json` is the root: manifests, digests of arrays, and changes of requirements contain it. Seals
show accidents and edits; who rewrites a whole folder consistently can compute them anew.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rpojax.errors import ResultError

SEAL: Final = "seal"
"""Entry of a record that holds its seal."""
CAMPAIGN_SEAL: Final = "campaign_seal"
"""Entry of a record that holds the seal of the campaign that it belongs to."""


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
