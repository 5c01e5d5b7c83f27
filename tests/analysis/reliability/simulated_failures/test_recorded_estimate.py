"""What an estimate was asked for is read back from its folder, and forged records are refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rpojax.analysis.reliability.search_settings import EstimateSettings, FailureChoice
from rpojax.analysis.reliability.simulated_failures import run_probability
from rpojax.analysis.reliability.simulated_failures.estimate_folder import RESULT_NAME, EstimateFolder, read_estimate
from rpojax.analysis.reliability.simulated_failures.failure_margin import choose_failure
from rpojax.cli import main
from rpojax.errors import ResultError
from rpojax.runtime.progress import Progress
from rpojax.scenario.loading import scenario_loader

SETTINGS = EstimateSettings(budget=700, method="subset")


def record(choice: FailureChoice) -> dict[str, Any]:
    """Content of the configuration of an estimate."""
    file = scenario_loader.load("inspection", ["limits.keep_out_m=12.5"])
    return run_probability._configuration(file, choose_failure(file, choice), SETTINGS, 5)  # pyright: ignore[reportPrivateUsage]


def finished(asked: dict[str, Any]) -> dict[str, Any]:
    """Content of the result of an estimate that is not to be trusted."""
    return {
        "probability": 0.25,
        "interval_95": [0.2, 0.3],
        "coefficient_of_variation": 0.1,
        "evaluations": 700,
        "method": "subset",
        "reason": "asked for",
        "trusted": False,
        "warnings": [],
        "levels": [],
        "design_points": [],
        "scenario": asked["scenario_name"],
        "scenario_hash": asked["scenario_hash"],
        "seed": asked["seed"],
        "failure": asked["failure"],
        "requirement": None,
        "plain_runs_for_equal_accuracy": None,
        "repeats": {},
        "remark": "",
        "noise": "drawn with every run",
        "unmapped": [],
        "failing_runs": [],
    }


@pytest.mark.parametrize(
    "choice",
    [
        FailureChoice(outcome="keep_out"),
        FailureChoice(requirement="min_range_m"),
        FailureChoice(metric="final_range_m", limit=80.0, bound="at most"),
    ],
    ids=["outcome", "requirement", "metric"],
)
def test_an_estimate_is_read_back_as_it_was_asked(tmp_path: Path, choice: FailureChoice) -> None:
    written = record(choice)
    EstimateFolder(tmp_path / "a").begin(written, force=False)
    found = read_estimate(tmp_path / "a")
    assert (found.choice, found.settings, found.seed) == (choice, SETTINGS, 5)
    again = run_probability._configuration(  # pyright: ignore[reportPrivateUsage]
        found.file, choose_failure(found.file, found.choice), found.settings, found.seed
    )
    assert json.loads(json.dumps(again)) == json.loads(json.dumps(written))


@pytest.mark.parametrize(
    ("key", "value", "named"),
    [
        ("budget", "many", "budget"),
        ("budget", True, "budget"),
        ("method", "guess", "method"),
        ("seed", None, "seed"),
        ("failure", {"metric": 3}, "failure"),
        ("failure", [], "failure"),
        ("scenario", {"name": 1}, "name"),
    ],
)
def test_forged_records_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], key: str, value: object, named: str
) -> None:
    EstimateFolder(tmp_path / "a").begin({**record(FailureChoice(outcome="keep_out")), key: value}, force=False)
    assert main.main(["resume", str(tmp_path / "a")]) == 2
    said = capsys.readouterr().err
    assert named in said
    assert said.count("\n") == 1


def test_no_estimate_is_no_estimate(tmp_path: Path) -> None:
    with pytest.raises(ResultError):
        read_estimate(tmp_path)


def test_options_of_a_campaign_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    EstimateFolder(tmp_path / "a").begin(record(FailureChoice(outcome="keep_out")), force=False)
    assert main.main(["resume", str(tmp_path / "a"), "--workers", "2"]) == 2
    assert "workers" in capsys.readouterr().err


def test_an_estimate_of_other_versions_is_not_continued(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = EstimateFolder(tmp_path / "a")
    folder.begin({**record(FailureChoice(outcome="keep_out")), "versions": {"jax": "0.0.1"}}, force=False)
    assert main.main(["resume", str(tmp_path / "a")]) == 2
    said = capsys.readouterr().err
    assert "other versions" in said
    assert "--" not in said
    assert said.count("\n") == 1


def test_a_finished_estimate_of_other_versions_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = record(FailureChoice(outcome="keep_out"))
    folder = EstimateFolder(tmp_path / "a")
    folder.begin({**asked, "versions": {"jax": "0.0.1"}}, force=False)
    folder.write(RESULT_NAME, finished(asked))
    assert main.main(["resume", str(tmp_path / "a"), "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["probability"] == 0.25


@pytest.mark.parametrize("name", ["inspection_eclipse", "cooperative_far"])
def test_packaged_scenarios_are_the_same_after_their_record(tmp_path: Path, name: str) -> None:
    file = scenario_loader.load(name)
    choice = FailureChoice(outcome="keep_out")
    written = run_probability._configuration(file, choose_failure(file, choice), SETTINGS, 5)  # pyright: ignore[reportPrivateUsage]
    EstimateFolder(tmp_path / "a").begin(written, force=False)
    assert read_estimate(tmp_path / "a").file == file


def test_progress_counts_the_failures_of_the_runs_that_are_done() -> None:
    shown: list[Progress] = []
    watch = run_probability._Watch(300, shown.append)  # pyright: ignore[reportPrivateUsage]
    margins = np.array([-1.0, 2.0, -3.0, 4.0, 5.0, -6.0])

    def in_batches(points: np.ndarray) -> np.ndarray:
        for part in np.split(margins[points], 2):
            watch.add_runs(len(part), int((part <= 0.0).sum()))
        return margins[points]

    watch.counted(np.arange(6), in_batches)
    watch.counted(np.arange(6), lambda points: margins[points])  # remembered, without a batch
    assert [(each.done, each.failed) for each in shown] == [(3, 2), (6, 3), (6, 3), (12, 6)]
