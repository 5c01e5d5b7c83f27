"""Data of single runs for the page's script: which runs, their courses coded in 16 bits, and the command."""

import base64

import numpy as np
import pytest

from rpojax.report.page import marked_runs
from rpojax.report.page.report_json import summarise


def decoded(coded):
    codes = np.frombuffer(base64.b64decode(coded["codes"]), "<u2").astype(float)
    shares = np.where(codes == 65535, np.nan, codes / 65534)
    low, high = coded["low"], coded["high"]
    return low * (high / low) ** shares if coded["log"] else low + shares * (high - low)


def test_runs_have_values_courses_outcome_and_command(build):
    campaign = build(runs=30, seconds=600, kept=(0, 1), failed=(3,))
    found = marked_runs.run_marks(campaign, summarise(campaign), ["range_m", "formation_error_m", "unknown"])
    assert (found["ids"], found["kept"]) == (list(range(30)), [0, 1])
    assert found["failed"] == {"3": "entered the keep-out sphere since 300 s"}
    assert found["values"]["delta_v_m_s"][5] == pytest.approx(campaign.metrics["delta_v_m_s"][5], rel=1e-4)
    assert found["command"].replace(found["placeholder"], "7").endswith("--run-id 7 --out run_7")
    times = np.array(found["traces"]["time_s"])
    columns = np.searchsorted(campaign.trace_time_s, times)
    assert set(found["traces"]["channels"]) == {"range_m", "formation_error_m"}
    for name, coded in found["traces"]["channels"].items():
        stored = campaign.traces[name][:, columns]
        np.testing.assert_allclose(decoded(coded).reshape(30, -1), stored, rtol=2e-3, atol=1e-3 * np.nanmax(stored))
        assert np.array_equal(np.isnan(decoded(coded).reshape(30, -1)), np.isnan(stored))


@pytest.mark.parametrize("values", [[[0.0, 0.0]], [[5.0, 5.0]], [[-1.0, np.nan], [3.0, np.inf]], [[np.nan, np.nan]]])
def test_equal_negative_and_missing_values_are_coded(values):
    wide = np.array(values)
    finite = np.isfinite(wide)
    back = decoded(marked_runs._coded(wide)).reshape(wide.shape)
    np.testing.assert_allclose(back[finite], wide[finite], atol=1e-4)
    assert np.isnan(back[~finite]).all()


def test_of_many_runs_those_with_a_history_and_the_failed_ones_are_among_the_first_thousand(build):
    campaign = build(runs=1500, seconds=30, kept=(1499,), failed=(1200, 1300))
    rows = marked_runs.shown_rows(campaign)
    assert len(rows) == marked_runs.MOST_RUNS
    assert {0, 1200, 1300, 1499} <= set(rows.tolist())
    assert (np.diff(rows) > 0).all()
    assert marked_runs.shown_rows(build(runs=12)).tolist() == list(range(12))
