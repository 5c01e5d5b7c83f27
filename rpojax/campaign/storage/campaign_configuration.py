"""Configuration of a campaign: the record of `campaign.json`, written before anything is compiled; free of jax."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rpojax.campaign.argument_checks import MAX_BLOCKS, MAX_RUN_ID, MAX_SEED
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.storage import atomic_files, campaign_seal, look_records, safe_paths
from rpojax.campaign.storage.look_records import Look
from rpojax.errors import ResultError, RpojaxError
from rpojax.untrusted.file_reading import FileKind

FORMAT_VERSION = 4
"""Version of the layout of a campaign folder."""
UNSEALED_FORMAT = 3
"""Version of folders without a seal, which are read and completed, but get no verdicts."""
FILE_NAME = "campaign.json"

_REQUIRED_ENTRIES: dict[str, type] = {
    "name": str,
    "description": str,
    "scenario": dict,
    "scenario_hash": str,
    "seed": int,
    "runs": int,
    "first_run": int,
    "block_size": int,
    "histories": dict,
    "stages": dict,
    "design": dict,
    "report": bool,
    "id": str,
    "versions": dict,
}
"""Entries that `campaign.json` must hold, with their types."""
_RANGES = {
    "seed": (0, MAX_SEED),
    "runs": (1, MAX_RUN_ID),
    "first_run": (0, MAX_RUN_ID),
    "block_size": (1, MAX_RUN_ID),
}
_SHARED_ENTRIES = (
    "scenario_hash",
    "seed",
    "runs",
    "first_run",
    "block_size",
    "histories",
    "stages",
    "design",
    "batching",
    "sequential",
)
"""Entries that must be equal for processes that share one folder."""


@dataclass(frozen=True)
class CampaignConfiguration:
    """Content of `campaign.json`.

    Attributes:
        name: of the scenario
        description: of the scenario
        scenario: the scenario in the types of JSON
        scenario_hash: SHA-256 of its entries and trained files that affect results
        options: of the campaign, with its block size
        stages: records of the replaced stages
        design_sha256: of the values that the experiment design assigns; None in folders that do not record it
        batching: how a tick is batched over the runs; None in folders that do not record it
        dtype: floating-point type of the loop
        id: random identifier of the folder
        versions: package -> version
        device: description of the devices
        created: time of creation
        rerun_of: in the folder of a rerun, `first_run` and `runs` of the original campaign
        plugin: description of the scenario's plugin, from which results can be read without its code
        format_version: of the layout of the folder
        ended_at: number of runs at which a sequential campaign was decided
        seal: of the `campaign.json` that was read; None in one that has none, and in a configuration that was not read
    """

    name: str
    description: str
    scenario: dict[str, Any] = field(repr=False)
    scenario_hash: str
    options: CampaignOptions
    stages: dict[str, Any]
    design_sha256: str | None
    batching: str | None
    dtype: str
    id: str
    versions: dict[str, str]
    device: str
    created: str
    rerun_of: dict[str, int] | None = None
    plugin: dict[str, Any] | None = None
    format_version: int = FORMAT_VERSION
    seal: str | None = field(default=None, compare=False)
    ended_at: int | None = field(default=None, compare=False)

    @property
    def block_size(self) -> int:
        """Runs per block and device."""
        assert self.options.block_size is not None
        return self.options.block_size

    @property
    def runs(self) -> int:
        """Number of runs that the campaign has when it is complete; fewer than its options say once it is decided."""
        return self.options.runs if self.ended_at is None else self.ended_at

    @property
    def block_count(self) -> int:
        """Number of blocks."""
        return -(-self.runs // self.block_size)

    def runs_in_block(self, block: int) -> int:
        """Number of runs of a block, without padding."""
        return min(self.block_size, self.options.runs - block * self.block_size)

    def after(self, looks: Sequence[Look]) -> "CampaignConfiguration":
        """The configuration after the looks that were taken, the last of which may have decided."""
        decided = looks[-1].runs if self.options.plan is not None and looks and looks[-1].is_decided else None
        return replace(self, ended_at=decided)

    def to_record(self) -> dict[str, Any]:
        """Content of `campaign.json` without its seal, in the types of JSON."""
        options = self.options.to_record()
        report, design = options.pop("report"), options.pop("design")
        digest = {} if self.design_sha256 is None else {"sha256": self.design_sha256}
        batching = {} if self.batching is None else {"batching": self.batching}
        record = {
            "format": self.format_version,
            "name": self.name,
            "description": self.description,
            "scenario": self.scenario,
            "scenario_hash": self.scenario_hash,
            **options,
            "stages": self.stages,
            "design": design | digest,
            "report": report,
            **batching,
            "dtype": self.dtype,
            "id": self.id,
            "versions": self.versions,
            "device": self.device,
            "created": self.created,
        }
        further = {"rerun_of": self.rerun_of, "plugin": self.plugin}
        return record | {key: value for key, value in further.items() if value is not None}

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "CampaignConfiguration":
        """Configuration from the content of `campaign.json`, the types of which have been checked.

        Raises:
            RpojaxError: an option is out of range.
        """
        return cls(
            name=record["name"],
            description=record["description"],
            scenario=record["scenario"],
            scenario_hash=record["scenario_hash"],
            options=CampaignOptions.from_record(record),
            stages=record["stages"],
            design_sha256=record["design"].get("sha256"),
            batching=record.get("batching"),
            dtype=record.get("dtype", ""),
            id=record["id"],
            versions=record["versions"],
            device=record.get("device", ""),
            created=record.get("created", ""),
            rerun_of=record.get("rerun_of"),
            plugin=record.get("plugin") if isinstance(record.get("plugin"), dict) else None,
            format_version=record["format"],
            seal=record.get(campaign_seal.SEAL),
        )


def read(directory: Path) -> CampaignConfiguration:
    """Configuration of a folder's `campaign.json`, with seal, types and ranges checked.

    Raises:
        ResultError: the folder is no campaign, or not one that this version reads, or the file was changed.
    """
    path = directory / FILE_NAME
    safe_paths.check_no_links(directory, path)
    content = atomic_files.read_json(path, "a campaign folder", FileKind.CAMPAIGN_JSON)
    found = content.get("format") if isinstance(content, dict) else None
    if found not in (FORMAT_VERSION, UNSEALED_FORMAT) or isinstance(found, bool | float):
        raise ResultError(f"{directory}: found format {found!r:.60}, expected {UNSEALED_FORMAT} or {FORMAT_VERSION}")
    if found == FORMAT_VERSION:
        campaign_seal.check_seal(path, content)
    elif campaign_seal.SEAL in content:
        raise ResultError(f"{path}: found a seal, expected none in format {UNSEALED_FORMAT}")
    for key, form in _REQUIRED_ENTRIES.items():
        if not _is_valid_entry(key, content.get(key), form):
            raise ResultError(
                f"{path}: found {content.get(key)!r:.60} for {key!r}, expected the {form.__name__} of a campaign"
            )
    try:
        configuration = CampaignConfiguration.from_record(content)
    except ResultError:
        raise
    except RpojaxError as error:
        raise ResultError(f"{path}: {error}") from None
    configuration = configuration.after(look_records.read(directory, configuration.seal))
    if configuration.block_count > MAX_BLOCKS:
        raise ResultError(f"{path}: found {configuration.block_count} blocks, expected at most {MAX_BLOCKS}")
    return configuration


def _is_valid_entry(key: str, value: Any, form: type) -> bool:
    has_type = isinstance(value, form) and isinstance(value, bool) == (form is bool)
    if not has_type:
        return False
    if key == "histories":
        return _is_valid_retention(value)
    if key == "scenario_hash":
        return re.fullmatch(r"[0-9a-f]{64}", value) is not None
    low, high = _RANGES.get(key, (None, None))
    return low is None or high is None or low <= value <= high


def _is_valid_retention(value: Mapping[str, Any]) -> bool:
    rule, channels, every = (value.get(name) for name in ("rule", "channels", "every"))
    named = channels is None or (isinstance(channels, list) and all(isinstance(name, str) for name in channels))
    return isinstance(rule, str) and named and isinstance(every, int) and not isinstance(every, bool) and every >= 1


def check_compatible(directory: Path, found: CampaignConfiguration, expected: CampaignConfiguration) -> None:
    """Refuses to share the folder of a campaign with another configuration.

    Raises:
        ResultError: naming the entry that differs.
    """
    there, wanted = found.to_record(), expected.to_record()
    for key in _SHARED_ENTRIES:
        if there.get(key) != wanted.get(key):
            difference = f"found {key} {there.get(key)!r:.80}, expected {wanted.get(key)!r:.80}"
            raise ResultError(f"{directory}: {difference} to share the folder")
