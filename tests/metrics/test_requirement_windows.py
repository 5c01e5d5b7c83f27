"""Metrics in the windows of requirements against NumPy on the same records, and which windows are refused."""

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np
import pytest
from synthetic_channel_records import Records, perfect_run

from rpojax.analysis.statistics import tolerance_verdicts
from rpojax.analysis.statistics.tolerance_verdicts import RequirementEvaluation
from rpojax.errors import ScenarioError
from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics import metric_catalogue
from rpojax.metrics.time_windows import MetricWindow
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import OutcomeName, ScenarioFile
from rpojax.simulation.metrics import recorded_metrics
from rpojax.simulation.outcomes import requirement_violations
from rpojax.simulation.outcomes.outcome_kinds import Outcome

RUNS, TICKS = 3, 600
PHASES = [
    {"name": name, "reference": {"kind": "hold", "position_m": [0.0, -50.0, 0.0]}, "until": {"time_s": 200.0}}
    for name in ("drift", "approach", "stay")
]
REST = {"bound": "at most", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
METRICS = (
    "formation_error_rms_m", "min_range_m", "nees_relative_mean", "boxes_rejected", "delta_v_m_s", "look_away_peak_s",
    "pointing_error_p95_deg", "longest_unseen_s",
)  # fmt: skip


def with_requirements(*entries: dict[str, Any], overrides: Sequence[str] = ()) -> ScenarioFile:
    """Ten minutes of the packaged mission with requirements of these entries."""
    tables = scenario_loader.load("inspection", [f"duration_s={TICKS}", *overrides]).model_dump()
    tables["requirements"] = [REST | entry for entry in entries]
    tables["phases"] = PHASES if any("phase" in entry for entry in entries) else []
    return scenario_loader.validate(tables)


@pytest.fixture
def records() -> Records:
    """Runs with errors of all kinds."""
    rng = np.random.default_rng(5)
    found = perfect_run(TICKS, RUNS)
    found["rho_H"] += rng.normal(size=(RUNS, TICKS, 3)).astype(np.float32)
    found["range_m"] = np.linalg.norm(found["rho_H"], axis=2)
    found["nees_relative"] = rng.chisquare(6.0, (RUNS, TICKS)).astype(np.float32)
    found["box_accepted"] = rng.random((RUNS, TICKS)) < 0.7
    found["mode"] = rng.choice([Mode.LOOK, Mode.TURN], (RUNS, TICKS), p=[0.9, 0.1]).astype(np.int8)
    found["pointing_error_deg"] = rng.random((RUNS, TICKS)).astype(np.float32)
    found["delta_v_m_s"] = np.cumsum(rng.random((RUNS, TICKS)) < 0.1, axis=1).astype(np.float32)
    return {**found, "running": np.ones((RUNS, TICKS), bool)}


def expected(name: str, records: Records, run: int, ticks: Any) -> float:
    """The metric of one run over some ticks."""
    part = {key: values[run, ticks] for key, values in records.items()}
    match name:
        case "formation_error_rms_m":
            return float(np.sqrt(np.mean(np.sum((part["rho_H"] - [0.0, -30.0, 0.0]) ** 2, axis=1))))
        case "min_range_m":
            return float(part["range_m"].min())
        case "nees_relative_mean":
            return float(part["nees_relative"].astype(float).mean())
        case "boxes_rejected":
            return float(np.sum(part["box_present"] & ~part["box_accepted"]))
        case "delta_v_m_s":
            whole = records["delta_v_m_s"][run].astype(float)
            return whole[min(ticks.stop, TICKS - 1)] - whole[ticks.start]
        case "look_away_peak_s":
            periods = np.arange(ticks.start, ticks.stop) // 200
            return max(float(np.sum(part["mode"][periods == period] == Mode.TURN)) for period in np.unique(periods))
        case "pointing_error_p95_deg":
            turned = np.flatnonzero(records["mode"][run] != Mode.LOOK)
            settled = [not np.any((turned <= tick) & (turned >= tick - 10)) for tick in range(ticks.start, ticks.stop)]
            return float(np.percentile(part["pointing_error_deg"][settled].astype(float), 95.0))
        case "longest_unseen_s":
            gaps = np.diff(np.concatenate([[-1], np.flatnonzero(part["box_accepted"]), [len(part["mode"])]])) - 1
            return float(gaps.max())
    raise AssertionError(name)


@pytest.mark.parametrize(("from_s", "to_s", "ticks"), [
    (150.0, 420.0, slice(150, 421)), (None, 99.0, slice(0, 100)), (330.5, None, slice(331, TICKS)),
])  # fmt: skip
def test_metrics_between_times_are_those_of_these_ticks(
    records: Records, from_s: float | None, to_s: float | None, ticks: slice
) -> None:
    times = {key: value for key, value in (("from_s", from_s), ("to_s", to_s)) if value is not None}
    file = with_requirements(*({"metric": name, **times} for name in METRICS), overrides=["pointing.settle_time_s=10"])
    found = recorded_metrics.evaluate_windows(file, records, {})
    assert len(found) == len(METRICS)
    for requirement in file.requirements:
        values = [expected(requirement.metric, records, run, ticks) for run in range(RUNS)]
        # Channels are in single precision.
        np.testing.assert_allclose(found[requirement.metric_name], values, rtol=1e-5, err_msg=requirement.metric)


def test_parts_of_a_run_add_up_to_its_totals(records: Records) -> None:
    names = ("delta_v_m_s", "boxes_rejected")
    parts = [
        {"metric": name, "from_s": begin, "to_s": begin + 199.0} for name in names for begin in (0.0, 200.0, 400.0)
    ]
    file = with_requirements(*parts)
    found, whole = (
        evaluate(file, records, {}) for evaluate in (recorded_metrics.evaluate_windows, recorded_metrics.evaluate)
    )
    for name in names:
        total = sum(values for key, values in found.items() if key.startswith(name)) + (
            records["delta_v_m_s"][:, 0] if name == "delta_v_m_s" else 0.0
        )
        np.testing.assert_allclose(total, whole[name])


def test_a_frozen_run_has_the_metrics_of_the_windows_that_it_came_through(records: Records) -> None:
    records["running"][1, 250:] = False
    windows = ({"to_s": 100.0}, {"from_s": 200.0, "to_s": 300.0}, {"from_s": 400.0})
    file = with_requirements(*({"metric": "min_range_m", **window} for window in windows))
    found = recorded_metrics.evaluate_windows(file, records, {})
    assert [np.isfinite(values).tolist() for values in found.values()] == [
        [True, True, True], [True, False, True], [True, False, True],
    ]  # fmt: skip


def test_metrics_of_whole_runs_do_not_depend_on_windows(records: Records) -> None:
    plain, timed = with_requirements(), with_requirements({"metric": "min_range_m", "to_s": 100.0})
    assert recorded_metrics.evaluate_windows(plain, records, {}) == {}
    before, after = (recorded_metrics.evaluate(file, records, {}) for file in (plain, timed))
    assert all(np.array_equal(before[name], after[name], equal_nan=True) for name in before | after)


def test_stored_names_tell_the_window_and_have_unit_and_title() -> None:
    assert [MetricWindow(from_s=0.1, to_s=1e6).suffix, MetricWindow(to_s=30.0).suffix] == ["@0.1-1000000", "@0-30"]
    assert [MetricWindow(from_s=2.5).suffix, MetricWindow("approach").suffix] == ["@2.5-end", "@approach"]
    assert MetricWindow("approach", "end").presence_name == "event_time_s@approach.end"
    titles = {
        "min_range_m@600-1200": "Minimum range from 600 to 1200 s",
        "min_range_m@600-end": "Minimum range from 600 s to the end",
        "min_range_m@approach": "Minimum range in approach",
        "min_range_m@approach.end": "Minimum range at the end of approach",
        "duration_s@approach": "Duration in approach",
    }
    for name, title in titles.items():
        metric = metric_catalogue.find(name)
        assert metric is not None
        assert (metric.title, metric.name) == (title, name)
        assert metric_catalogue.unit_of(name) == ("m" if name.startswith("min") else "s")
    assert metric_catalogue.find("min_range_m@-") is None
    assert metric_catalogue.find("duration_s") is None
    assert not metric_catalogue.is_of_campaigns("min_range_m@approach")


def test_windows_are_part_of_the_digest_and_limits_are_not() -> None:
    entry = {"metric": "min_range_m", "to_s": 100.0}
    digests = [scenario_digest(with_requirements(*entries)) for entries in (
        [], [entry], [entry | {"limit": 3.0}], [entry | {"to_s": 101.0}], [{"metric": "min_range_m"}],
    )]  # fmt: skip
    assert digests[1] == digests[2]
    assert digests[0] == digests[4]
    assert len({*digests}) == 3


@pytest.mark.parametrize(("entry", "message"), [
    ({"from_s": 700.0}, "requirements.0.from_s: found 700.0, expected a time within the run: duration_s = 600"),
    ({"to_s": 601.0}, "requirements.0.to_s: found 601.0, expected a time within the run: duration_s = 600"),
    ({"from_s": 40.2, "to_s": 40.8}, "requirements.0.from_s: found 40.2, expected a window with a camera tick"),
    ({"from_s": 50.0, "to_s": 40.0}, "requirements.0.from_s: found 50.0, expected a window with a camera tick"),
    ({"at": "end"}, "requirements.0.at: found 'end', expected it only beside phase"),
    ({"phase": "approach", "to_s": 3.0}, "requirements.0.phase: found 'approach', expected either a phase or times"),
    ({"metric": "surface_seen_fraction", "to_s": 3.0}, "requirements.0.metric: found 'surface_seen_fraction'"),
    ({"metric": "min_range_m@0-3"}, "requirements.0.metric: found 'min_range_m@0-3', expected the name of a metric"),
    ({"outcome": "fine"}, "requirements.0.outcome: found 'fine', expected 'completed', "),
])  # fmt: skip
def test_windows_that_no_run_has_are_refused_in_one_line(entry: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        with_requirements({"metric": "min_range_m"} | entry)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_an_unknown_phase_and_one_in_a_mission_without_phases_are_refused() -> None:
    with pytest.raises(
        ScenarioError, match=r"^requirements\.0\.phase: found 'dock', expected one of drift, approach, stay"
    ):
        with_requirements({"metric": "min_range_m", "phase": "dock"})
    tables = with_requirements({"metric": "min_range_m", "phase": "approach"}).model_dump() | {"phases": []}
    with pytest.raises(ScenarioError, match=r"^requirements\.0\.phase: found 'approach', expected it only in a scen"):
        scenario_loader.validate(tables)


def in_phases(records: Records) -> Records:
    """Records of a run that comes through the approach, one that stays in it, and one that never begins it."""
    phase = np.zeros((RUNS, TICKS), np.int8)
    phase[0, 200:450], phase[0, 450:], phase[1, 300:] = 1, 2, 1
    # A phase that a hold interrupts has not ended.
    phase[1, 400:420] = 3
    return {**records, "rho_desired_H": np.full((RUNS, TICKS, 3), [0.0, -30.0, 0.0]), "phase": phase}


def test_metrics_of_phases_are_those_of_their_ticks_and_undefined_where_a_run_never_was(records: Records) -> None:
    name = "formation_error_rms_m"
    file = with_requirements(
        *({"metric": name, "phase": "approach"} | at for at in ({}, {"at": "begin"}, {"at": "end"}))
    )
    found = recorded_metrics.evaluate_windows(file, in_phases(records), {})
    for window, ticks in {
        "approach": (slice(200, 450), np.r_[300:400, 420:TICKS]),
        "approach.begin": (slice(200, 201), slice(300, 301)),
        "approach.end": (slice(449, 450),),
    }.items():
        values = [expected(name, records, run, each) for run, each in enumerate(ticks)]
        np.testing.assert_allclose(found[f"{name}@{window}"], values + [np.nan] * (RUNS - len(values)), rtol=1e-5)
    np.testing.assert_array_equal(found["duration_s@approach"], [250.0, 280.0, 0.0])
    np.testing.assert_array_equal(found["event_time_s@approach.begin"], [200.0, 300.0, np.nan])
    np.testing.assert_array_equal(found["event_time_s@approach.end"], [449.0, np.nan, np.nan])


def test_a_total_at_an_event_is_that_since_the_start(records: Records) -> None:
    file = with_requirements({"metric": "delta_v_m_s", "phase": "approach", "at": "end"})
    found = recorded_metrics.evaluate_windows(file, in_phases(records), {})
    assert found["delta_v_m_s@approach.end"][0] == records["delta_v_m_s"][0, 449]


def verdict_on(file: ScenarioFile, metrics: dict[str, Any], outcomes: np.ndarray) -> RequirementEvaluation:
    """Verdict on the first requirement, from those of the runs that count."""
    [requirement, *_] = file.requirements
    counted = requirement_violations.counts(requirement, metrics, outcomes)
    values = requirement_violations.required_values(requirement, metrics)
    return tolerance_verdicts.evaluate_requirement(requirement, values, np.arange(RUNS), True, counted=counted)


@pytest.mark.parametrize(
    ("among", "expected"),
    [({}, (3, 0, 2, 2)), ({"among": "all_runs"}, (3, 0, 2, 2)), ({"among": "reaching_runs"}, (2, 1, 1, 1))],
)
def test_runs_that_never_were_in_a_phase_and_those_frozen_in_it_fail(
    records: Records, among: dict[str, str], expected: tuple[int, ...]
) -> None:
    records["running"][1, 400:] = False
    file = with_requirements({"metric": "min_range_m", "phase": "approach", "limit": 100.0, **among})
    found = recorded_metrics.evaluate_windows(file, in_phases(records), {})
    verdict = verdict_on(file, found, np.array(["completed", "keep_out", "completed"]))
    assert (verdict.runs, verdict.not_counted, verdict.violations, verdict.without_value) == expected


def test_a_total_of_no_ticks_is_no_value_of_a_run_that_never_was_there(records: Records) -> None:
    file = with_requirements({"metric": "delta_v_m_s", "bound": "at most", "phase": "approach", "limit": 1e9})
    found = recorded_metrics.evaluate_windows(file, in_phases(records), {})
    verdict = verdict_on(file, found, np.full(RUNS, "completed"))
    assert (verdict.violations, verdict.violating_ids) == (1, (2,))


def test_which_runs_count_is_said_beside_a_phase_only() -> None:
    with pytest.raises(ScenarioError, match=r"requirements\.0\.among: found 'reaching_runs', expected it only beside"):
        with_requirements({"metric": "min_range_m", "from_s": 100.0, "among": "reaching_runs"})


def test_of_an_outcome_only_its_runs_count() -> None:
    file = with_requirements({"metric": "min_range_m", "outcome": "lost"})
    verdict = verdict_on(file, {"min_range_m": np.array([5.0, 0.5, 3.0])}, np.array(["completed", "lost", "lost"]))
    assert (verdict.runs, verdict.not_counted, verdict.violations, verdict.violating_ids) == (2, 1, 1, (2,))


def test_outcomes_of_requirements_are_those_of_runs() -> None:
    assert get_args(OutcomeName) == tuple(map(str, Outcome))
