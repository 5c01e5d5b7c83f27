"""Whether the report of a campaign is as it was written: report.json holds digests of itself and of the other files."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rpojax.campaign.storage import safe_paths
from rpojax.campaign.storage.campaign_seal import CAMPAIGN_SEAL, SEAL, record_digest, sealed
from rpojax.errors import RpojaxError
from rpojax.untrusted.file_reading import FileKind, read_bytes
from rpojax.untrusted.json_reading import read_json

JSON_NAME, PAGE_NAME, FIGURES_NAME = "report.json", "report.html", "figures"
_FILES: Final = "files"


def with_digests(content: Mapping[str, Any], directory: Path, page: bytes, campaign_seal: str | None) -> dict[str, Any]:
    """Content of report.json with digests of the page and of the figures in the folder, and its own seal."""
    folder = directory / FIGURES_NAME
    figures = sorted(path for path in folder.iterdir() if path.is_file()) if folder.is_dir() else []
    files = {f"{FIGURES_NAME}/{path.name}": _digest(read_bytes(path, FileKind.REPORT)) for path in figures}
    # The digest is that of the types of JSON, as they are read again.
    record = {**content, _FILES: {PAGE_NAME: _digest(page), **files}, CAMPAIGN_SEAL: campaign_seal}
    return sealed(json.loads(json.dumps(record, allow_nan=False)))


def is_as_written(directory: Path, campaign_seal: str | None) -> bool:
    """Whether there is a report on all runs of a campaign, and none of its files was changed since."""
    try:
        content = _read(directory, JSON_NAME)
        if content[SEAL] != record_digest(content) or content[CAMPAIGN_SEAL] != campaign_seal:
            return False
        return content["runs"]["missing"] == 0 and all(
            _digest(_bytes(directory, name)) == digest for name, digest in content[_FILES].items()
        )
    except (RpojaxError, KeyError, TypeError, AttributeError, ValueError):
        return False


def _read(directory: Path, name: str) -> dict[str, Any]:
    safe_paths.check_no_links(directory, directory / name)
    return dict(read_json(directory / name, FileKind.REPORT))


def _bytes(directory: Path, name: str) -> bytes:
    safe_paths.check_no_links(directory, directory / name)
    return read_bytes(directory / name, FileKind.REPORT)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
