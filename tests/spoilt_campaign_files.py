"""Campaign folders with changed entries in their JSON files: read whole, or refused in one line."""

import json
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from rpojax.campaign.status import status
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
"""Any content of a JSON file."""


def read_all(directory: Path) -> None:
    """Reads everything that a campaign folder offers."""
    found = Campaign(directory)
    for name in ("info", "metrics", "drawn", "traces", "completed", "failed_at_s", "run_ids", "history_ids"):
        getattr(found, name)
    status(directory)


def read_with(begun: Campaign, name: str, key: str, value: Any) -> None:
    """Reads everything with a changed entry in a file; errors must be of one line."""
    path = begun.directory / name
    before = path.read_bytes()
    try:
        path.write_text(json.dumps(json.loads(before) | {key: value}))
        read_all(begun.directory)
    except RpojaxError as error:
        assert "\n" not in str(error)
    finally:
        path.write_bytes(before)
