"""Looks of a sequential campaign that have been taken, in `looks.json`: counts and verdicts. Free of numpy."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from rpojax.campaign.storage import atomic_files, campaign_seal, safe_paths
from rpojax.errors import ResultError
from rpojax.untrusted.file_reading import FileKind

FILE_NAME: Final = "looks.json"
VERIFIED: Final = "verified"
REFUTED: Final = "refuted"
OPEN: Final = "open"


@dataclass(frozen=True)
class LookVerdict:
    """State of one requirement at a look: runs that count, violations among them, and `verified`, `refuted`, `open`."""

    requirement: str
    counted: int
    violations: int
    verdict: str


@dataclass(frozen=True)
class Look:
    """A look that was taken after a number of `runs`."""

    runs: int
    requirements: tuple[LookVerdict, ...]

    @property
    def is_decided(self) -> bool:
        """Whether every requirement is verified or refuted."""
        return all(each.verdict != OPEN for each in self.requirements)


def write(directory: Path, seal: str, looks: list[Look]) -> None:
    """Writes the looks taken so far; equal results give an equal file.

    Raises:
        UnfinishedError: it cannot be written.
        ResultError: its path contains a symbolic link.
    """
    path = directory / FILE_NAME
    safe_paths.check_no_links(directory, path)
    record = {"looks": [asdict(look) for look in looks], campaign_seal.CAMPAIGN_SEAL: seal}
    atomic_files.write_json(path, campaign_seal.sealed(_as_lists(record)))


def _as_lists(value: Any) -> Any:
    """A value with lists in place of tuples, as JSON is read back."""
    if isinstance(value, dict):
        return {key: _as_lists(one) for key, one in value.items()}
    return [_as_lists(one) for one in value] if isinstance(value, list | tuple) else value


def read(directory: Path, seal: str | None) -> list[Look]:
    """Looks that were taken, none without the file.

    Raises:
        ResultError: the file was changed, or belongs to another campaign.
    """
    path = directory / FILE_NAME
    safe_paths.check_no_links(directory, path)
    if not path.exists():
        return []
    content = atomic_files.read_json(path, "the looks of a campaign", FileKind.MANIFEST)
    if not isinstance(content, dict) or seal is None:
        raise ResultError(f"{path}: found no looks of a sealed campaign, expected them")
    campaign_seal.check_belongs(path, content, seal)
    try:
        return [
            Look(int(one["runs"]), tuple(LookVerdict(**each) for each in one["requirements"]))
            for one in content["looks"]
        ]
    except (KeyError, TypeError, ValueError):
        raise ResultError(f"{path}: found other entries, expected the looks of a campaign") from None
