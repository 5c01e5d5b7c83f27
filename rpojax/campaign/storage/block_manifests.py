"""Manifests of finished blocks: one JSON file per block, written after its arrays. Free of jax, to be read fast.

Beside them, `manifest/000007.attempts` has a line for every attempt at a block that is not finished.
"""

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from rpojax.campaign.argument_checks import MAX_RUN_ID
from rpojax.campaign.storage import atomic_files, campaign_seal, safe_paths
from rpojax.campaign.storage.campaign_configuration import CampaignConfiguration
from rpojax.errors import ResultError
from rpojax.untrusted.file_reading import FileError, FileKind, read_bytes

_NAME = re.compile(r"\d{6}", re.ASCII)
_RESUME_HINT = "(without the file, a resume runs the block again)"


@dataclass(frozen=True)
class Manifest:
    """Record of one finished block.

    Attributes:
        campaign: `id` of the campaign that it belongs to
        first: row of its first run
        count: number of its runs
        completed: runs whose outcome is `completed`
        failed: runs that failed; the others are not judged
        reasons: reason of failure -> number of runs
        sha256: group of arrays -> digest of the block's values in it
        began_s: when its computation began, seconds since 1970 [s]
        wall_s: time from then until its runs had ended, shared with the blocks computed at the same time [s]
        compile_s: time to compile the programs that computed it [s]
        attempts: how often it was begun
        device: description of the devices that computed it
        versions: versions of the packages that computed it
        campaign_seal: seal of its `campaign.json`, None if that has none
    """

    campaign: str
    first: int
    count: int
    completed: int
    failed: int
    reasons: dict[str, int]
    sha256: dict[str, str]
    began_s: float
    wall_s: float
    compile_s: float
    attempts: int
    device: str
    versions: dict[str, str]
    campaign_seal: str | None = None


_ENTRIES = [field for field in fields(Manifest) if field.name != campaign_seal.CAMPAIGN_SEAL]
"""Entries of every manifest; those with a seal are checked before."""


def manifest_path(directory: Path, block: int) -> Path:
    """Path of a block's manifest."""
    return directory / "manifest" / f"{block:06d}.json"


def write(directory: Path, block: int, manifest: Manifest) -> None:
    """Writes a block's manifest, which declares the block finished.

    Raises:
        UnfinishedError: it cannot be written.
        ResultError: its path contains a symbolic link.
    """
    path = manifest_path(directory, block)
    safe_paths.make_folder(directory, path.parent)
    record = asdict(manifest)
    if manifest.campaign_seal is None:
        del record[campaign_seal.CAMPAIGN_SEAL]
    atomic_files.write_json(path, record if manifest.campaign_seal is None else campaign_seal.sealed(record))
    _attempts_path(directory, block).unlink(missing_ok=True)


def remove(directory: Path, block: int) -> None:
    """Removes a block's manifest, so that the block is unfinished.

    Raises:
        UnfinishedError: it cannot be removed.
        ResultError: its path contains a symbolic link.
    """
    path = manifest_path(directory, block)
    safe_paths.check_no_links(directory, path)
    atomic_files.remove(path)


def finished_blocks(directory: Path, blocks: int) -> list[int]:
    """Numbers of the blocks with a manifest, in order.

    Raises:
        ResultError: the folder of manifests is a symbolic link.
    """
    folder = directory / "manifest"
    safe_paths.check_no_links(directory, folder)
    return sorted(number for number in _numbered_files(folder, ".json") if number < blocks)


def _numbered_files(folder: Path, suffix: str) -> list[int]:
    try:
        paths = list(folder.iterdir())
    except OSError:
        return []
    return [int(path.stem) for path in paths if path.suffix == suffix and _NAME.fullmatch(path.stem)]


def read(directory: Path, configuration: CampaignConfiguration, block: int) -> Manifest:
    """Manifest of a finished block, checked against `campaign.json`.

    Raises:
        ResultError: it is no manifest, or that of another campaign or block.
    """
    path = manifest_path(directory, block)
    safe_paths.check_no_links(directory, path)
    expected = f"the manifest of a finished block {_RESUME_HINT}"
    content = atomic_files.read_json(path, expected, FileKind.MANIFEST)
    if isinstance(content, dict):
        campaign_seal.check_belongs(path, content, configuration.seal, f" {_RESUME_HINT}")
    for field in _ENTRIES:
        value = content.get(field.name) if isinstance(content, dict) else None
        if not _is_valid_entry(field.name, value):
            raise ResultError(f"{path}: found {value!r:.60} for {field.name!r}, expected {expected}")
    found = Manifest(**{field.name: content[field.name] for field in _ENTRIES}, campaign_seal=configuration.seal)
    if found.campaign != configuration.id:
        expected_id = f"{configuration.id:.40}"
        raise ResultError(f"{path}: found campaign {found.campaign:.40}, expected {expected_id} {_RESUME_HINT}")
    rows = (block * configuration.block_size, configuration.runs_in_block(block))
    if (found.first, found.count) != rows:
        text = f"first {found.first}, count {found.count}"
        raise ResultError(f"{path}: found {text}, expected first {rows[0]}, count {rows[1]} {_RESUME_HINT}")
    if found.completed + found.failed > found.count or sum(found.reasons.values()) != found.failed:
        text = f"{found.completed} completed and {found.failed} failed runs"
        raise ResultError(f"{path}: found {text} of {found.count}, expected each of them once {_RESUME_HINT}")
    return found


def _is_valid_entry(name: str, value: Any) -> bool:
    match name:
        case "first" | "count" | "completed" | "failed" | "attempts":
            return _is_count(value)
        case "began_s" | "wall_s" | "compile_s":
            return isinstance(value, int | float) and not isinstance(value, bool) and 0.0 <= value < 1e12
        case "reasons":
            return isinstance(value, dict) and all(_is_count(number) for number in value.values())
        case "sha256":
            return isinstance(value, dict) and all(_is_sha256(text) for text in value.values())
        case "device" | "campaign":
            return isinstance(value, str)
        case _:
            return isinstance(value, dict) and all(isinstance(text, str) for text in value.values())


def _is_count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= MAX_RUN_ID


def _is_sha256(value: Any) -> bool:
    return isinstance(value, str) and re.fullmatch(r"[0-9a-f]{64}", value) is not None


def read_all(directory: Path, configuration: CampaignConfiguration, blocks: Iterable[int]) -> list[Manifest]:
    """Manifests of some finished blocks."""
    return [read(directory, configuration, block) for block in blocks]


def timing(manifests: Sequence[Manifest], duration_s: float) -> dict[str, float]:
    """Computation time and speed of finished blocks of runs of `duration_s` [s]; empty if no block is finished.

    `run_s` is the time in which at least one block was computed, `devices` the largest number of blocks at once.
    """
    if not manifests:
        return {}
    changes = sorted(
        change for entry in manifests for change in ((entry.began_s, 1), (entry.began_s + entry.wall_s, -1))
    )
    run_s, since, active, most = 0.0, 0.0, 0, 0
    for moment, step in changes:
        if active:
            run_s += moment - since
        since, active = moment, active + step
        most = max(most, active)
    runs = sum(entry.count for entry in manifests)
    return {
        "compile_s": max(entry.compile_s for entry in manifests),
        "run_s": run_s,
        "run_seconds_per_s": runs * duration_s / run_s if run_s > 0.0 else 0.0,
        "devices": most,
    }


def count_failure_reasons(manifests: Iterable[Manifest]) -> dict[str, int]:
    """Reason of failure -> number of runs, of all blocks."""
    total: Counter[str] = Counter()
    for entry in manifests:
        total.update(entry.reasons)
    return dict(sorted(total.items()))


def _attempts_path(directory: Path, block: int) -> Path:
    return manifest_path(directory, block).with_suffix(".attempts")


def record_attempt(directory: Path, block: int) -> None:
    """Appends a line to the block's file of attempts.

    Raises:
        UnfinishedError: it cannot be written.
        ResultError: its path contains a symbolic link.
    """
    path = _attempts_path(directory, block)
    safe_paths.make_folder(directory, path.parent)
    safe_paths.check_no_links(directory, path)
    try:
        # So short a line is appended whole, also when several processes append.
        with path.open("ab") as stream:
            stream.write(f"{atomic_files.machine_id()}\n".encode())
    except OSError as error:
        raise atomic_files.write_error(path, error) from None


def count_attempts(directory: Path, block: int) -> int:
    """How often an unfinished block was begun."""
    path = _attempts_path(directory, block)
    safe_paths.check_no_links(directory, path)
    try:
        return read_bytes(path, FileKind.MANIFEST).count(b"\n")
    except FileError:
        return 0


def attempts_at_unfinished_blocks(directory: Path, blocks: int) -> dict[int, int]:
    """Unfinished block -> how often it was begun, for blocks that were."""
    finished = set(finished_blocks(directory, blocks))
    numbers = [number for number in _numbered_files(directory / "manifest", ".attempts") if number < blocks]
    return {number: count_attempts(directory, number) for number in sorted(set(numbers) - finished)}
