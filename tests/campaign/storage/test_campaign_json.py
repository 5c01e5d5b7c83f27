"""Content of campaign.json is checked."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from spoilt_campaign_files import JSON, read_with

from rpojax.campaign.storage import campaign_json
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import ResultError


@pytest.mark.parametrize(
    ("key", "value"), [("runs", None), ("runs", 0), ("block_size", 0), ("seed", "1"), ("scenario", []), ("stages", 3)]
)
def test_invalid_entries_are_named(empty: Campaign, edit_info: Callable[..., None], key: str, value: object) -> None:
    edit_info(empty.directory, **{key: value})
    with pytest.raises(ResultError, match=f"{key!r}, expected the"):
        Campaign(empty.directory)


@pytest.mark.parametrize("text", [None, "not json", "[]", "{}", '{"format": 99}'])
def test_folder_without_a_campaign_is_refused(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "campaign.json").write_text(text)
    with pytest.raises(ResultError):
        Campaign(tmp_path)


@given(key=st.sampled_from(sorted({*campaign_json._REQUIRED_ENTRIES, "format"})), value=JSON)
def test_any_entry_is_read_or_refused_in_one_line(begun: Campaign, key: str, value: Any) -> None:
    read_with(begun, "campaign.json", key, value)
