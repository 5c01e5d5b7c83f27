"""Campaigns as xarray datasets, and their groups opened by xarray itself."""

import sys

import numpy as np
import pytest
from empty_campaign_folders import empty_campaign, synthetic_block, synthetic_timing

import rpojax
from rpojax.campaign.storage import labelled_results
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.errors import RpojaxError
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, mission: ScenarioFile) -> Campaign:
    """Five runs from number 10, of which the middle block is missing."""
    campaign = empty_campaign(tmp_path_factory.mktemp("dataset") / "runs", mission, 7, 5, 10, 2)
    for block in (0, 2):
        campaign.write_block(block, synthetic_block(block), synthetic_timing())
    return campaign


def test_variables_have_dimensions_and_units(written: Campaign) -> None:
    found = rpojax.open_campaign(written.directory)
    assert found["run"].values.tolist() == [10, 11, 14]
    assert found["min_range_m"].dims == ("run",)
    assert found["min_range_m"].attrs["units"] == "m"
    assert found["range_m"].dims == ("run", "time")
    assert found["time"].values.tolist() == [0.0, 10.0, 20.0]
    assert found["target.tumble_axis"].dims == ("run", "axis")
    assert found["target.tumble_axis"].sel(axis="y", run=14).item() == written.drawn["target.tumble_axis"][2, 1]
    assert found.sel(run=14)["min_range_m"].item() == 4.0
    assert found["failure_reason"].values.tolist() == ["", "entered the keep-out sphere", ""]
    assert found["completed"].values.tolist() == [True, False, True]
    for key in ("scenario_hash", "seed", "runs", "block_size"):
        assert found.attrs[key] == written.info[key]


@pytest.mark.parametrize(
    ("group", "name", "shown"),
    [
        ("metrics", "delta_v_m_s", "delta_v_m_s"),
        ("traces", "range_m", "range_m"),
        ("traces", "delta_v_m_s", "delta_v_m_s_over_time"),
        ("drawn", "servicer.mass_kg", "servicer.mass_kg"),
        ("used", "servicer.mass_kg", "used.servicer.mass_kg"),
        ("phases", "delta_v_m_s", "delta_v_m_s_by_phase"),
        ("phases", "transition_at_s", "transition_at_s"),
        ("phases", "goal_reached_at_s", "goal_reached_at_s"),
        ("phases", "arrival_place_P_m", "arrival_place_P_m"),
        ("servicer_metrics", "delta_v_m_s", "delta_v_m_s_by_servicer"),
        ("servicer_traces", "delta_v_m_s", "delta_v_m_s_over_time_by_servicer"),
    ],
)
def test_a_name_is_plain_unless_another_has_it(group: str, name: str, shown: str) -> None:
    assert labelled_results.variable_name(group, name, {"delta_v_m_s"}) == shown


def test_a_table_has_a_row_for_each_run_and_a_column_for_each_number(written: Campaign) -> None:
    found = written.to_dataframe()
    assert found.index.tolist() == [10, 11, 14]
    assert found.index.name == "run_id"
    assert found.loc[14, "min_range_m"] == 4.0
    assert found["outcome"].tolist() == written.outcomes.tolist()
    for axis in range(3):
        column = found[f"target.tumble_axis[{axis}]"].to_numpy()
        np.testing.assert_array_equal(column, written.drawn["target.tumble_axis"][:, axis])
    assert set(written.metrics) <= set(found.columns)


def test_xarray_opens_the_groups(written: Campaign) -> None:
    import xarray

    found = xarray.open_zarr(str(written.directory / "results.zarr"), group="traces", consolidated=False)
    assert found["range_m"].dims == ("run", "time")
    assert found["range_m"].attrs["units"] == "m"
    np.testing.assert_array_equal(found["range_m"].values[[0, 1, 4]], written.traces["range_m"])


def test_error_without_xarray_names_the_install_command(written: Campaign, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(RpojaxError, match=r"^xarray: not installed, expected: .*rpojax\[xarray\]"):
        rpojax.open_campaign(written.directory)
    with pytest.raises(RpojaxError, match=r"^pandas: not installed, expected: .*rpojax\[xarray\]"):
        written.to_dataframe()
