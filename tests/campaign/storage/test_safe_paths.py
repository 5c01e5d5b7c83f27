"""Paths through symbolic links are refused."""

import shutil
from pathlib import Path

import pytest
from empty_campaign_folders import synthetic_block, synthetic_timing

from rpojax.campaign.status import status
from rpojax.campaign.storage import safe_paths
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError


def test_only_paths_through_links_are_refused(tmp_path: Path) -> None:
    root, outside = tmp_path / "root", tmp_path / "outside"
    (root / "inside").mkdir(parents=True)
    outside.mkdir()
    (root / "link").symlink_to(outside)
    safe_paths.check_no_links(root, root / "inside" / "file")
    with pytest.raises(ResultError, match="link: found a link that leads elsewhere"):
        safe_paths.check_no_links(root, root / "link" / "file")


def read_all(directory: Path) -> None:
    """Reads everything that a campaign folder offers."""
    found = Campaign(directory)
    for name in ("info", "metrics", "drawn", "traces", "completed", "failed_at_s", "run_ids", "history_ids"):
        getattr(found, name)
    status(directory)


def contents(path: Path) -> dict[str, bytes]:
    """Content of every file below a path, or of the file itself."""
    return {str(file): file.read_bytes() for file in [path, *path.rglob("*")] if file.is_file()}


@pytest.mark.parametrize("part", ["campaign.json", "manifest", "results.zarr", "results.zarr/metrics"])
def test_links_in_a_campaign_folder_are_neither_read_nor_written(begun: Campaign, tmp_path: Path, part: str) -> None:
    copy = Path(shutil.copytree(begun.directory, tmp_path / "copy"))
    outside = tmp_path / "outside"
    shutil.move(copy / part, outside)
    (copy / part).symlink_to(outside)
    before = contents(outside)
    with pytest.raises(ResultError, match="found a link that leads elsewhere"):
        read_all(copy)
    with pytest.raises(ResultError, match="found a link that leads elsewhere"):
        Campaign(copy).write_block(1, synthetic_block(1), synthetic_timing())
    assert contents(outside) == before
