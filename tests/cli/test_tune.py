"""`rpojax tune`: what it writes and prints, with a synthetic descent, and what it refuses in one line."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpojax
from rpojax.analysis.gradients.tuning import gradient_descent, tune
from rpojax.analysis.gradients.tuning.gradient_descent import TuningResult, TuningStep
from rpojax.analysis.gradients.tuning.tunable_parameters import scenario_at_horizon
from rpojax.analysis.gradients.tuning.tune import _progress_text
from rpojax.analysis.gradients.tuning.tuning_settings import TuningSettings
from rpojax.analysis.statistics.paired_comparison import RunMetrics
from rpojax.cli import main
from rpojax.metrics.metric_catalogue import UNITS
from rpojax.scenario.schema import ScenarioFile


def call(*words: object) -> int:
    """Exit status of a command line."""
    return main.main(["tune", *map(str, words)])


STAGES: dict[int, rpojax.Stages | None] = {0: None}
"""Stages of the flight software that runs are expected to have."""


@pytest.fixture
def nothing_simulated(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An empty folder to work in; a tuning doubles one number, and that halves all metrics."""

    def descend(file: ScenarioFile, settings: TuningSettings, *_: Any) -> TuningResult:
        scenario_at_horizon(file, settings)
        steps = tuple(
            TuningStep(
                objective, {"formation": 0.5, "pointing": 0.5}, {"formation": 0, "pointing": lost}, 1.0, 0, 0, 2.0
            )
            for objective, lost in ((3.0, 5), (1.0, 2))
        )
        return TuningResult(np.zeros(1), {"navigation.edge_noise_px": 2.0}, steps, "reverse", 9.0, 1000)

    def simulate_runs(file: ScenarioFile, seed: int, runs: int, on_progress: Any, stages: Any) -> RunMetrics:
        assert (seed, stages) == (8, STAGES[0])
        base = np.random.default_rng(runs).lognormal(0.0, 0.1, runs) / file.navigation.edge_noise_px
        metrics = dict.fromkeys(UNITS, base)
        if file.navigation.edge_noise_px == 2.0:
            metrics["pointing_error_p95_deg"] = np.where(np.arange(runs) < 3, np.nan, base)
            metrics["nees_mean"] = np.full(runs, np.nan)
        return RunMetrics(np.arange(runs), np.full(runs, "completed"), metrics)

    monkeypatch.setattr(gradient_descent, "descend", descend)
    monkeypatch.setattr(tune, "simulate_runs", simulate_runs)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_tuning_writes_a_scenario_and_its_record(nothing_simulated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("inspection", "--seed", 7, "--judge", 50, "--out", "new/tuned.toml", "--json") == 0
    content = json.loads(capsys.readouterr().out)
    assert sorted(path.name for path in (nothing_simulated / "new").iterdir()) == ["tuned.json", "tuned.toml"]
    assert json.loads((nothing_simulated / "new" / "tuned.json").read_text()) == content
    assert content["changes"] == {"navigation.edge_noise_px": {"from": 1.0, "to": 2.0}}
    assert (content["tuning_s"], content["compile_s"]) == (4.0, 9.0)
    change = content["judged"]["means"]["formation_error_rms_m"]
    assert change["ratio_95"][0] <= change["ratio"] <= change["ratio_95"][1]
    assert change["ratio"] == pytest.approx(0.5, abs=0.1)
    assert [step["undefined"] for step in content["steps"]] == [
        {"formation": 0, "pointing": 5},
        {"formation": 0, "pointing": 2},
    ]
    assert content["judged"]["undefined"] == {"pointing_error_p95_deg": [0, 3], "nees_mean": [0, 50]}
    made = rpojax.load("new/tuned.toml")
    assert made == rpojax.load("inspection", ["navigation.edge_noise_px=2.0"])


def test_validation_runs_have_the_stages_of_the_tuning(
    nothing_simulated: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(STAGES, 0, rpojax.Stages(formation_law=lambda gain, deviation: -deviation[3:]))
    found = rpojax.tune(rpojax.load("inspection"), stages=STAGES[0], seed=7, validation_runs=50, progress=False)
    assert found.validation is not None
    table = found.to_dataframe()
    assert table["part.pointing"].tolist() == [0.5, 0.5]
    assert table["undefined.pointing"].tolist() == [5, 2]
    texts = [_progress_text(step, 64) for step in found.result.steps]
    assert texts[0] == "objective 3.0000, pointing undefined in 5 of 64 runs"
    assert _progress_text(replace(found.result.steps[0], undefined={"pointing": 0}), 64) == "objective 3.0000"


def test_a_tuning_prints_what_it_changed(nothing_simulated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call("inspection", "--seed", 7, "--judge", 50, "--out", "tuned.toml") == 0
    text = capsys.readouterr().out
    assert "navigation.edge_noise_px: 1.0 -> 2.0" in text
    assert "objective of the first step 3.0000, of the last 1.0000, which had other runs" in text
    assert "50 unseen runs, seed 8" in text
    assert "failed runs: 0 of 50 with the start, 0 with the tuned scenario\n" in text
    assert "pointing: no value in 5 of 64 runs at the first step and 2 at the last (7 of all 128)" in text
    assert "formation: no value" not in text
    assert "pointing_error_p95_deg has no value in 0 runs with the start and in 3 with the tuned scenario" in text
    assert "nees_mean has no value in 0 runs with the start and in 50 with the tuned scenario" in text
    assert "Beyond chance" not in text


def test_a_tuning_that_changes_nothing_says_so() -> None:
    from rpojax.cli.commands.analysis.tune import _verdict

    same = {"ratio_95": (0.98, 1.03)}
    wide = {**same, "ratio_95": (0.6, 1.7)}
    told = _verdict({"formation_error_rms_m": same, "delta_v_m_s": wide}, {})
    assert told.startswith("No error or effort differs from the start's beyond chance; what these runs leave open is ")
    assert told.endswith("delta_v_m_s of 0.600 to 1.70 times the start's.")
    more = {"ratio_95": (1.1, 1.2)}
    worse = _verdict({"formation_error_rms_m": more, "delta_v_m_s": same}, {})
    assert worse == "Beyond chance, worse than the start: formation_error_rms_m."
    assert _verdict({"seen": more, "delta_v_m_s": same}, {"seen": -2.0}) == ""
    few = {"formation_error_rms_m": {"ratio_95": None}}
    assert (
        _verdict(few, {})
        == "No interval: it needs a value in 10 runs with both, so that nothing is said beyond chance."
    )
    assert _verdict({"seen": more}, {"seen": 1.0}) == "Beyond chance, worse than the start: seen."


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--parameters", "navigaton"], "--parameters: found 'navigaton', expected one of navigation, pose, gate,"),
        (["--steps", "0"], "--steps: found 0, expected at least 1"),
        (["--runs", "0"], "--runs: found 0, expected at least 1"),
        (["--judge", "1"], "--judge: found 1, expected 0 or at least 2"),
        (["--rate", "nan"], "--rate: found nan"),
        (["--horizon", "inf"], "--horizon: found inf"),
        (["--horizon", "50.5"], "--horizon: found 50.5 (duration_s: found 50.5, expected a whole number"),
        (["--set", "navigation.edge_noise_px=nan"], "navigation.edge_noise_px: found nan, expected"),
        (["--set", "camera.model=rendered"], "camera.model: found 'rendered', expected 'geometric' or 'statistical'"),
        (["--resume"], "tuned.progress.json: found no tuning to resume, expected one"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(
    words: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert call("inspection", *words, "--out", "tuned.toml") == 2
    error = capsys.readouterr().err.strip()
    assert message in error
    assert "\n" not in error
    assert list(tmp_path.iterdir()) == []


def test_an_objective_without_weights_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    weights = [f"tuning.{name}=0" for name in type(rpojax.load("inspection").tuning).model_fields if name != "metrics"]
    assert call("inspection", "--set", *weights, "--out", "tuned.toml") == 2
    assert "tuning: found 'no weight above zero'" in capsys.readouterr().err


def test_existing_files_are_kept(nothing_simulated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("tuned.toml").write_text("mine")
    assert call("inspection", "--out", "tuned.toml") == 2
    assert Path("tuned.toml").read_text() == "mine"
    Path("tuned.toml").unlink()
    Path("tuned.progress.json").write_text("a walk")
    assert call("inspection", "--out", "tuned.toml") == 2
    assert "a tuning is under way; --resume goes on with it, --force begins anew" in capsys.readouterr().err
    assert call("inspection", "--out", "tuned.toml", "--force", "--steps", 0) == 2
    assert Path("tuned.progress.json").read_text() == "a walk"


def test_a_tuned_file_extends_what_was_tuned_with_the_changed_numbers_alone(nothing_simulated: Path) -> None:
    assert call("inspection", "--judge", 0, "--out", "tuned.toml", "--set", "duration_s=3000") == 0
    content = tomllib.loads(Path("tuned.toml").read_text())
    assert content == {
        "format_version": 4,
        "extends": "inspection",
        "duration_s": 3000.0,
        "navigation": {"edge_noise_px": 2.0},
    }
    assert "# navigation.edge_noise_px: 1 -> 2" in Path("tuned.toml").read_text()


def test_a_tuned_file_elsewhere_finds_the_file_that_it_extends(nothing_simulated: Path) -> None:
    Path("mine.toml").write_text('extends = "inspection"\nname = "mine"\n')
    assert call("mine.toml", "--judge", 0, "--out", "new/tuned.toml") == 0
    assert tomllib.loads(Path("new/tuned.toml").read_text())["extends"] == "../mine.toml"
    assert rpojax.load("new/tuned.toml") == rpojax.load("mine.toml", ["navigation.edge_noise_px=2.0"])


def test_a_scenario_that_no_file_gives_is_written_as_a_whole(nothing_simulated: Path) -> None:
    file = rpojax.load("inspection", ["requirements=[]"])
    rpojax.tune(file.model_copy(update={"name": "mine"}), validation_runs=0, progress=False).write("tuned.toml")
    content = tomllib.loads(Path("tuned.toml").read_text())
    assert "extends" not in content
    assert content["orbit"]


def test_a_tuning_has_a_summary(nothing_simulated: Path) -> None:
    shown = repr(rpojax.tune(rpojax.load("inspection"), seed=7, validation_runs=50, progress=False))
    assert shown.startswith("Tuning of inspection in 2 steps\n  tuned      navigation.edge_noise_px: 1 -> 2")
    assert "50 runs, failed 0 -> 0" in shown
