"""Missing and corrupt arrays are errors, never results."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zarr
from empty_campaign_folders import synthetic_block, synthetic_timing

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError


def remove(path: Path) -> str:
    """Removes a file; returns part of the error."""
    path.unlink()
    return "missing"


def corrupt(path: Path) -> str:
    """Overwrites a file; returns part of the error."""
    path.write_bytes(b"garbage")
    return "readable arrays"


@pytest.mark.parametrize("group", ["metrics", "traces", "drawn", "status"])
@pytest.mark.parametrize("damage", [remove, corrupt])
def test_missing_and_corrupt_chunks_are_errors(empty: Campaign, group: str, damage: Callable[[Path], str]) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    chunk = next(path for path in (empty.directory / "results.zarr" / group).rglob("c/**/0") if path.is_file())
    message = damage(chunk)
    read = Campaign(empty.directory)
    with pytest.raises(ResultError, match=message) as caught:
        _ = read.completed if group == "status" else getattr(read, group)
    assert "\n" not in str(caught.value)


def test_chunks_of_fill_values_are_written(empty: Campaign) -> None:
    empty.write_block(0, {**synthetic_block(0), "metrics/time_to_acquire_s": np.full(2, np.nan)}, synthetic_timing())
    assert np.isnan(Campaign(empty.directory).metrics["time_to_acquire_s"]).all()
    empty.write_history(10, {"delta_v_m_s": np.zeros(3), "box_present": np.zeros(3, bool)})
    assert empty.history(10)["delta_v_m_s"].tolist() == [0.0, 0.0, 0.0]
    remove(empty.directory / "results.zarr" / "histories" / "10" / "delta_v_m_s" / "c" / "0")
    with pytest.raises(ResultError, match="missing"):
        empty.history(10)


def test_changed_status_is_an_error(empty: Campaign) -> None:
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    status = zarr.open_group(str(empty.directory / "results.zarr"), mode="r+")["status/failure"]
    assert isinstance(status, zarr.Array)
    assert status.fill_value == -1
    status[:2] = np.array([0, 0], np.int8)
    with pytest.raises(ResultError, match="status: found other values in block 0, expected"):
        _ = Campaign(empty.directory).completed


def test_removed_results_of_a_finished_block_are_an_error(empty: Campaign) -> None:
    assert empty.metrics == {}
    empty.write_block(0, synthetic_block(0), synthetic_timing())
    shutil.rmtree(empty.directory / "results.zarr")
    for group in ("metrics", "drawn", "traces", "completed"):
        with pytest.raises(ResultError, match=r"results\.zarr"):
            getattr(Campaign(empty.directory), group)
