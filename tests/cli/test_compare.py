"""`rpojax compare`: what changed between two campaigns, and which campaigns it refuses."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from empty_campaign_folders import empty_campaign, synthetic_timing
from isolated_plugins import forgotten_plugins

import rpojax
from rpojax.cli import main
from rpojax.metrics.metric_catalogue import UNITS
from rpojax.report.labels import metric_label
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins.plugin import Plugin
from rpojax.scenario.plugins.plugin_registry import metrics_of
from rpojax.scenario.schema import ScenarioFile

RUNS = 40
RNG = np.random.default_rng(0)
DRAWN = RNG.normal(30.0, 0.3, RUNS)
BEFORE = RNG.lognormal(-1.0, 0.4, RUNS)


def written(
    directory: Path, error: np.ndarray, failed: tuple[int, ...] = (), seed: int = 0, drawn: np.ndarray = DRAWN
) -> Path:
    """A finished campaign of one block whose metrics are all `error`."""
    file = scenario_loader.load("inspection", [f"navigation.gate_sigma={3.0 + len(failed)}"])
    return written_campaign(directory, file, error, failed, seed, drawn)


def written_campaign(
    directory: Path,
    file: ScenarioFile,
    error: np.ndarray,
    failed: tuple[int, ...] = (),
    seed: int = 0,
    drawn: np.ndarray = DRAWN,
) -> Path:
    """A finished campaign of one block of a scenario, whose metrics are all `error`."""
    result = empty_campaign(directory, file, seed, RUNS, 0, RUNS)
    failure = np.isin(np.arange(RUNS), failed).astype(np.int8)
    arrays = {f"metrics/{name}": np.where(failure > 0, np.nan, error) for name in {*UNITS, *metrics_of(file)}}
    arrays |= {
        "status/failure": failure,
        "status/failed_at_s": np.where(failure > 0, 10.0, np.nan),
        "drawn/servicer.mass_kg": drawn,
        "used/servicer.mass_kg": drawn,
        "traces/range_m": np.tile(np.linspace(50.0, 30.0, 600, dtype=np.float32), (RUNS, 1)),
    }
    result.write_block(0, arrays, synthetic_timing())
    return directory


def compared(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, object]:
    assert main.main(["compare", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_a_better_campaign_is_seen_to_be_better_run_by_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = written(tmp_path / "a", BEFORE)
    second = written(tmp_path / "b", 0.5 * BEFORE, failed=(3, 7))
    found = compared(capsys, first, second)
    assert found["changed"] == [{"key": "navigation.gate_sigma", "first": 3.0, "second": 5.0}]
    assert found["pairs"] == RUNS
    assert found["failures"] == {
        "event": "failed",
        "both": 0,
        "only_first": 0,
        "only_second": 2,
        "neither": RUNS - 2,
        "p_value": 0.5,
    }
    metrics = found["metrics"]
    assert isinstance(metrics, list)
    formation = next(each for each in metrics if each["metric"] == "formation_error_rms_m")
    assert formation["pairs"] == RUNS - 2
    assert formation["ratio"]["value"] == pytest.approx(0.5)
    assert formation["ratio"]["interval_95"] == pytest.approx([0.5, 0.5])
    assert main.main(["compare", str(first), str(second)]) == 0
    shown = capsys.readouterr().out
    assert "navigation.gate_sigma: 3.0 -> 5.0" in shown
    assert "40 pairs of runs" in shown


def test_several_campaigns_are_compared_with_the_first_on_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [written(tmp_path / name, factor * BEFORE) for name, factor in (("a", 1.0), ("b", 0.5), ("c", 2.0))]
    page = tmp_path / "changes.html"
    found = compared(capsys, *folders, "--out", page)["comparisons"]
    assert isinstance(found, list)
    assert [Path(each["second"]).name for each in found] == ["b", "c"]
    assert "A: a / B: b / C: c" in page.read_text()
    assert main.main(["compare", *map(str, folders), "--out", str(page)]) == 2
    assert "changes.html" in capsys.readouterr().err, "a page that exists is not overwritten without --force"


def test_other_durations_and_metrics_are_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = written(tmp_path / "a", BEFORE)
    file = scenario_loader.load("inspection", ["duration_s=3000"])
    other = empty_campaign(tmp_path / "b", file, 0, RUNS, 0, RUNS)
    arrays = {f"metrics/{name}": BEFORE for name in UNITS if name != "delta_v_m_s"}
    status = {"status/failure": np.zeros(RUNS, np.int8), "status/failed_at_s": np.full(RUNS, np.nan)}
    other.write_block(0, arrays | status, synthetic_timing())
    warnings = compared(capsys, first, other.directory)["warnings"]
    assert isinstance(warnings, list)
    assert warnings[0].startswith("durations differ, 6000 s and 3000 s")
    assert "lacks metrics of" in warnings[1]
    assert warnings[1].endswith("delta_v_m_s")
    assert main.main(["compare", str(first), str(other.directory)]) == 0
    assert capsys.readouterr().err.count("rpojax: warning: ") == 2


def test_a_requirement_on_a_metric_that_one_campaign_alone_has_is_left_out_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plugin = rpojax.Plugin(metrics={"minutes_late": lambda time_s: time_s[-1] / 60.0})
    packaged = written(tmp_path / "packaged", BEFORE)
    with forgotten_plugins():
        wanted = [
            {"metric": metric, "bound": "at most", "limit": limit, "probability": 0.9, "consumer_risk": 0.1}
            for metric, limit in (("minutes_late", 60.0), ("formation_error_rms_m", 2.0))
        ]
        override = f"requirements={json.dumps(wanted).replace(':', '=')}"
        file = scenario_loader.load("inspection", [override], plugin=plugin)
        own = written_campaign(tmp_path / "own", file, BEFORE)
        page = tmp_path / "changes.html"
        for pair in ((packaged, own), (own, packaged)):
            found = compared(capsys, *pair, "--out", page, "--force")
            requirements, warnings = found["requirements"], found["warnings"]
            assert isinstance(requirements, list)
            assert isinstance(warnings, list)
            events = [each["event"] for each in requirements]
            assert "not formation_error_rms_m at most 2" in events
            assert not any("minutes_late" in event for event in events)
            unjudged = [each for each in warnings if "no values for requirements" in each]
            assert unjudged == [
                f"{packaged} has no values for requirements, which are not compared: minutes_late at most 60"
            ]
            assert f"{packaged} lacks metrics of {own}, which are not compared: minutes_late" in warnings
            assert "minutes_late at most 60" in page.read_text()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 1}, ["found seed 1", "expected 0"]),
        ({"drawn": DRAWN + 1.0}, ["other values drawn for 'servicer.mass_kg'"]),
    ],
)
def test_runs_that_are_not_the_same_cases_are_not_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, object], words: list[str]
) -> None:
    first = written(tmp_path / "a", BEFORE)
    second = written(tmp_path / "b", BEFORE, **change)  # pyright: ignore[reportArgumentType]
    assert main.main(["compare", str(first), str(second)]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert all(word in line for word in words)


def test_servicers_of_a_team_are_compared_in_json_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    team, folders = scenario_loader.load("cooperative_far", ["requirements=[]"]), []
    for name, factor in (("a", 1.0), ("b", 2.0)):
        result = empty_campaign(tmp_path / name, team, 0, RUNS, 0, RUNS)
        arrays = {
            "metrics/delta_v_m_s": BEFORE,
            "servicer_metrics/delta_v_m_s": np.stack([BEFORE, factor * BEFORE], axis=1),
            "status/failure": np.zeros(RUNS, np.int8),
            "status/failed_at_s": np.full(RUNS, np.nan),
        }
        result.write_block(0, arrays, synthetic_timing())
        folders.append(result.directory)
    metrics = compared(capsys, *folders)["metrics"]
    assert isinstance(metrics, list)
    ratios = {each["metric"]: each["ratio"]["value"] for each in metrics}
    assert ratios == pytest.approx({"delta_v_m_s": 1.0, "delta_v_m_s/first": 1.0, "delta_v_m_s/second": 2.0})
    assert main.main(["compare", *map(str, folders)]) == 0
    shown = capsys.readouterr().out
    assert "Delta-v" in shown
    assert "Delta-v, second" not in " ".join(shown.split())


def with_score(directory: Path, function: Callable[..., Any]) -> Path:
    """A finished campaign with a metric `score_m` of the user's own, and a requirement on it."""
    file = scenario_loader.load("inspection", plugin=Plugin({"score_m": function}))
    limit = {"metric": "score_m", "bound": "at most", "limit": 1.0, "probability": 0.9, "consumer_risk": 0.1}
    file = scenario_loader.validate({**file.model_dump(), "requirements": [limit]})
    result = empty_campaign(directory, file, 0, RUNS, 0, RUNS)
    arrays = {f"metrics/{name}": BEFORE for name in (*UNITS, "score_m")}
    arrays |= {"drawn/servicer.mass_kg": DRAWN, "used/servicer.mass_kg": DRAWN}
    arrays |= {"traces/range_m": np.tile(np.linspace(50.0, 30.0, 600, dtype=np.float32), (RUNS, 1))}
    status = {"status/failure": np.zeros(RUNS, np.int8), "status/failed_at_s": np.full(RUNS, np.nan)}
    result.write_block(0, arrays | status, synthetic_timing())
    return directory


def score_of_mean(range_m):
    return range_m.mean()


def score_of_peak(range_m):
    return range_m.max()


def test_metrics_that_plugins_define_differently_are_named_and_not_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with forgotten_plugins():
        folders = [
            with_score(tmp_path / name, function)
            for name, function in (("a", score_of_mean), ("b", score_of_peak), ("c", score_of_mean))
        ]
        apart = compared(capsys, folders[0], folders[1], "--out", tmp_path / "apart.html")
        alike = compared(capsys, folders[0], folders[2], "--out", tmp_path / "alike.html")
    for found, page, is_compared in ((apart, "apart.html", False), (alike, "alike.html", True)):
        metrics = found["metrics"]
        assert isinstance(metrics, list)
        assert ("score_m" in {each["metric"] for each in metrics}) is is_compared
        assert ("metrics that plugins define differently are not compared: score_m" in found["warnings"]) is (
            not is_compared
        )
        assert ("histogram-score_m" in (tmp_path / page).read_text()) is is_compared


def test_a_team_is_not_paired_with_a_servicer_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    alone = written(tmp_path / "alone", BEFORE)
    team = written_campaign(tmp_path / "team", scenario_loader.load("cooperative_inspection"), BEFORE)
    assert main.main(["compare", str(alone), str(team)]) != 0
    [line] = capsys.readouterr().err.strip().splitlines()
    assert "found the servicers first, second, third, expected any of " in line
    assert "(one without a name): run n of the one is not run n of the other" in line


def test_every_row_of_the_table_is_one_line_of_100_columns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = written(tmp_path / "a", 1234.5 * BEFORE), written(tmp_path / "b", 617.25 * BEFORE, failed=(3,))
    monkeypatch.setenv("COLUMNS", "100")
    assert main.main(["compare", str(first), str(second)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    [row] = [line for line in lines if line.strip().startswith("Delta-v ")]
    assert row.split()[-1] == "better"
    assert not any("\N{HORIZONTAL ELLIPSIS}" in line[26:] for line in lines), "no number is cut"
    titles = {title for name in UNITS if len(title := metric_label(name).title) < 26}
    missing = [title for title in titles if sum(line.strip().startswith(f"{title} ") for line in lines) < 1]
    assert missing == []
