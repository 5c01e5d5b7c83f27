"""Retention rules of histories."""

import numpy as np
import pytest

from rpojax.campaign.execution.block_recording import thin_history
from rpojax.campaign.execution.selected_histories import selected_by_result
from rpojax.campaign.options import history_retention
from rpojax.campaign.options.campaign_options import DEFAULT_HISTORIES
from rpojax.campaign.options.history_retention import Retention
from rpojax.errors import RpojaxError

IDS = np.arange(10, 16)
FAILED = np.array([False, False, True, False, False, False])
METRICS = {
    "min_range_m": np.array([5.0, 3.0, np.nan, 4.0, 3.0, 9.0]),
    "formation_error_rms_m": np.array([0.1, 0.5, np.nan, 0.4, np.nan, 0.2]),
}


@pytest.mark.parametrize(
    ("rule", "kept"),
    [
        ("none", set()),
        ("0", set()),
        ("all", {10, 11, 12, 13, 14, 15}),
        ("2", {10, 11}),
        ("99", {10, 11, 12, 13, 14, 15}),
        ("11,15", {11, 15}),
        ("11,", {11}),
        ("every:3", {10, 13}),
        ("1+every:5+12,", {10, 12, 15}),
        ("failures+worst:2:min_range_m", set()),
    ],
)
def test_runs_kept_independently_of_results(rule: str, kept: set[int]) -> None:
    assert Retention(rule).unconditional_run_ids(10, 6) == kept


@pytest.mark.parametrize(
    ("rule", "kept"),
    [
        ("all", set()),
        ("failures", {12}),
        ("worst:1:min_range_m", {11}),  # low is bad; the first of equals
        ("worst:2:min_range_m", {11, 14}),
        ("worst:2:formation_error_rms_m", {11, 13}),  # high is bad
        ("worst:9:formation_error_rms_m", {10, 11, 13, 15}),  # undefined is never selected
        ("2+failures+worst:1:formation_error_rms_m", {11, 12}),
    ],
)
def test_runs_selected_by_results(rule: str, kept: set[int]) -> None:
    found = Retention(rule)
    assert selected_by_result(found, IDS, FAILED, METRICS) == kept
    assert found.depends_on_results == (rule != "all")


def test_worst_run_of_each_requirement_is_kept_by_default() -> None:
    required = [("min_range_m", True), ("formation_error_rms_m", False)]
    assert DEFAULT_HISTORIES.rule == "8+requirements"
    assert selected_by_result(DEFAULT_HISTORIES, IDS, FAILED, METRICS, required) == {11}
    assert selected_by_result(Retention("8"), IDS, FAILED, METRICS, required) == set()
    assert DEFAULT_HISTORIES.max_histories(0, 100, 6) == 8 + 6


@pytest.mark.parametrize(
    "rule",
    [
        "",
        "some",
        "-1",
        "1.5",
        "every:0",
        "every:",
        "worst:2",
        "worst:0:min_range_m",
        "2++3",
        "1,x",
        "../1",
        "all:3",
    ],
)
def test_invalid_rules_are_refused_with_the_possible_forms(rule: str) -> None:
    with pytest.raises(RpojaxError, match=r"histories: found .*expected none, all, N .*worst:K:METRIC"):
        Retention(rule)


def test_unknown_metrics_and_channels_are_refused_with_a_suggestion() -> None:
    with pytest.raises(RpojaxError, match=r"found metric 'min_rang_m', expected .*did you mean 'min_range_m'"):
        Retention("worst:2:min_rang_m")
    with pytest.raises(RpojaxError, match=r"history_channels: found 'rho_h', expected .*'rho_H'"):
        history_retention.check_channels(["range_m", "rho_h"], ["range_m", "rho_H"])
    with pytest.raises(RpojaxError, match="history_every: found 0"):
        Retention("all", None, 0)


def test_runs_outside_of_the_campaign_are_refused() -> None:
    Retention("10,15+99").check_run_ids(10, 6)
    with pytest.raises(RpojaxError, match="histories: found run 16"):
        Retention("10,16").check_run_ids(10, 6)


def test_thinning_always_keeps_time_and_desired_position() -> None:
    history = {
        "time_s": np.arange(7.0),
        "rho_desired_H": np.zeros(3),
        "rho_H": np.arange(21.0).reshape(7, 3),
        "nees": np.arange(7.0),
    }
    kept = thin_history(history, Retention("all", ("rho_H",), 3), 7)
    assert kept.keys() == {"time_s", "rho_desired_H", "rho_H"}
    assert kept["time_s"].tolist() == [0.0, 3.0, 6.0]
    assert kept["rho_H"][:, 0].tolist() == [0.0, 9.0, 18.0]
    assert kept["rho_desired_H"].shape == (3,)


def test_rule_is_read_back_from_its_record() -> None:
    for rule in (Retention("1+failures", ("range_m",), 5), Retention.from_run_ids([3, 1]), Retention.from_run_ids([])):
        assert Retention.from_record(rule.to_record()) == rule
    assert Retention.from_run_ids([3, 1]).unconditional_run_ids(0, 9) == {1, 3}
    assert Retention.from_run_ids([3]).unconditional_run_ids(0, 9) == {3}
