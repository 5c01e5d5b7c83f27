"""Content of campaign.json is checked."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from spoilt_campaign_files import JSON, read_with

from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage import campaign_configuration, folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.provenance import new_configuration
from rpojax.dispersions.designs.run_range import RunRange
from rpojax.errors import ResultError
from rpojax.scenario.schema import ScenarioFile


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


@given(key=st.sampled_from(sorted({*campaign_configuration._REQUIRED_ENTRIES, "format"})), value=JSON)
def test_any_entry_is_read_or_refused_in_one_line(begun: Campaign, key: str, value: Any) -> None:
    read_with(begun, "campaign.json", key, value)


@pytest.mark.parametrize(
    "options",
    [
        CampaignOptions(3, block_size=2),
        CampaignOptions(
            runs=5,
            seed=2**63 - 1,
            first_run=7,
            block_size=2,
            histories=Retention("7,+worst:2:min_range_m", ("range_m",), 3),
            run_range=RunRange(0, 40),
            report=True,
        ),
    ],
    ids=["defaults", "all set"],
)
def test_options_are_read_back_from_the_folder(tmp_path: Path, mission: ScenarioFile, options: CampaignOptions) -> None:
    written = new_configuration(mission, options, {"formation_law": {"function": "mine"}}, "0" * 64)
    folder_creation.create_folder(tmp_path / "runs", written, force=False)
    assert campaign_configuration.read(tmp_path / "runs") == written
    content = json.loads((tmp_path / "runs" / "campaign.json").read_text())
    assert Campaign(tmp_path / "runs").info == content | {"sealed": True}
    assert content["histories"]["rule"] == options.histories.rule
    assert {name: content[name] for name in ("seed", "runs", "first_run", "block_size", "report")} == {
        name: getattr(options, name) for name in ("seed", "runs", "first_run", "block_size", "report")
    }


def test_a_folder_of_an_earlier_version_is_read(empty: Campaign) -> None:
    path = empty.directory / "campaign.json"
    content = json.loads(path.read_text())
    later = ("batching", "dtype", "device", "created")
    older = {key: value for key, value in content.items() if key not in (*later, "seal")} | {"format": 3}
    path.write_text(json.dumps(older))
    found = campaign_configuration.read(empty.directory)
    assert found.options == empty.configuration.options
    assert (found.dtype, found.device, found.created) == ("", "", "")
    assert (found.design_sha256, found.batching) == (None, None)
    assert not Campaign(empty.directory).is_sealed
