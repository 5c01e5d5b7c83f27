"""The command `robustness`: its files, its refusals, and that its steps are those of campaigns."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpojax
from rpojax.analysis.robustness import study
from rpojax.analysis.robustness.margin_search import SideSearch
from rpojax.cli import main
from rpojax.errors import RpojaxError
from rpojax.report import robust_margins
from rpojax.report.page import robustness_page
from rpojax.scenario.loading import scenario_loader

FILES = {"robustness.json", "robustness.html", "robustness.png"}
KEYS = {"unit", "believed_sigma", "low_margin", "high_margin", "requirement"}


class KnownRuns:
    """Runs whose formation error is 1 m and 20 m for each relative change of thrust; nothing else has an effect."""

    def __init__(self, file: Any, quantities: Any, runs: int, *_: Any) -> None:
        self.runs = runs

    def compile(self) -> None:
        """Nothing."""

    def simulate(self, steps: Any, on_batch: Any) -> list[dict[str, np.ndarray]]:
        on_batch(1.0, len(steps) * self.runs, 0)
        found = []
        for quantity, offset in steps:
            change = offset if quantity.name == "thruster.force_scale" else 0.0
            error = np.full(self.runs, 1.0 + 20.0 * max(change, -0.5 * change))
            found.append({"formation_error_rms_m": error, "outcomes": np.full(self.runs, "completed")})
        return found


@pytest.fixture
def known_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """No simulation."""
    monkeypatch.setattr(study, "StepRuns", KnownRuns)


@pytest.mark.usefixtures("known_runs")
def test_margins_are_written_as_record_page_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["robustness", "inspection", "--runs", "8", "--out", str(tmp_path / "out")]
    assert main.main(words) == main.Status.DONE
    printed = capsys.readouterr().out
    assert "thruster.force_scale" in printed
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    content = json.loads((tmp_path / "out" / "robustness.json").read_text())
    details = content.pop("study")
    assert all({*entry} == KEYS for entry in content.values())
    thrust = content["thruster.force_scale"]
    assert thrust["high_margin"] == pytest.approx(0.05, rel=0.1)
    assert thrust["low_margin"] == pytest.approx(0.1, rel=0.1)
    assert thrust["requirement"] == dict.fromkeys(("low", "high"), "formation_error_rms_m")
    assert content["gps.noise_m"] | {"unit": "m"} == content["gps.noise_m"]
    assert (content["gps.noise_m"]["low_margin"], content["gps.noise_m"]["high_margin"]) == (None, None)
    assert details["quantities"]["gps.noise_m"]["high_holds_to"] == 32.0
    assert details["not_judged"] != []
    page = (tmp_path / "out" / "robustness.html").read_text()
    assert "holds to the last step, 32 m (16 sigma)" in page
    assert "data:image/png;base64," in page
    assert "The narrowest margin is that of the thrust" in page
    assert main.main(words) == main.Status.BAD_INPUT
    assert "exists already" in capsys.readouterr().err
    assert main.main([*words, "--force", "--json"]) == main.Status.DONE
    assert json.loads(capsys.readouterr().out)["thruster.force_scale"] == thrust


@pytest.mark.usefixtures("known_runs")
def test_what_is_broken_at_the_nominal_values_is_not_judged() -> None:
    tables = rpojax.load("inspection").model_dump(mode="json")
    tables["requirements"][0]["limit"] = 0.5
    content = study.robustness(scenario_loader.validate(tables), runs=4, progress=False)
    assert content["study"]["broken_at_nominal"] == ["formation_error_rms_m"]
    assert content["study"]["judged"] == ["completed"]
    assert content["thruster.force_scale"]["high_margin"] is None
    told = robust_margins.sentences(content)
    assert told[0] == "Nothing breaks up to the last steps."
    assert any("broken already at the nominal values: Formation error" in each for each in told)


def test_a_scenario_of_which_all_is_broken_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class LostRuns(KnownRuns):
        def simulate(self, steps: Any, on_batch: Any) -> list[dict[str, np.ndarray]]:
            return [{"outcomes": np.full(self.runs, "lost")} for _ in steps]

    monkeypatch.setattr(study, "StepRuns", LostRuns)
    with pytest.raises(RpojaxError, match=r"found all broken at nominal values \(completed\), expected one that holds"):
        study.robustness(rpojax.load("inspection"), runs=2, progress=False)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["cooperative_far"], "servicers: found 2, expected a scenario without [[servicers]] for robustness"),
        (["inspection", "--runs", "0"], "--runs: found 0"),
        (["inspection", "--seed", "-1"], "--seed: found -1"),
        (
            ["inspection", "--set", "design={kind='grid', values={'gps.noise_m'=[1.0, 2.0]}}"],
            "design.kind: found 'grid', expected a design whose values dispersions draw",
        ),
    ],
)
def test_what_cannot_be_studied_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    assert main.main(["robustness", *words, "--out", str(tmp_path / "out")]) == main.Status.BAD_INPUT
    error = capsys.readouterr().err
    assert told in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("known_runs")
def test_an_interval_is_told_in_words(tmp_path: Path) -> None:
    content = study.robustness(rpojax.load("inspection"), runs=300, progress=False)
    row = next(each for each in robust_margins.rows(content) if each.name == "thruster.force_scale")
    low, high = content["study"]["quantities"]["thruster.force_scale"]["high_interval"]
    assert low <= 0.05 < high
    assert row.high.interval == f"{robust_margins.format_number(low, 3)} to {robust_margins.format_number(high, 3)}"
    robustness_page.write_page(content, tmp_path)
    assert (tmp_path / "robustness.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_steps_are_those_of_a_campaign_with_another_nominal_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SideSearch, "next_size", lambda self: None if self.steps else 4.0)
    short = ["duration_s=600", "rates.formation_period_s=100", "pointing.look_away_limit_s=60"]
    content = rpojax.robustness(rpojax.load("inspection", short), runs=4, seed=3, progress=False)
    steps = content["study"]["quantities"]["thruster.force_scale"]["steps"]
    violations = next(each for each in steps if each["side"] == "low")["violations"]
    file = rpojax.load("inspection", [*short, "thruster.force_scale=0.92"])
    campaign = rpojax.run_campaign(file, 4, tmp_path / "campaign", seed=3, progress=False)
    for each in file.requirements:
        if each.metric in violations:
            values = campaign.metrics[each.metric]
            broken = ~(values <= each.limit) if each.bound == "at most" else ~(values >= each.limit)
            assert violations[each.metric] == broken.sum(), each.metric
