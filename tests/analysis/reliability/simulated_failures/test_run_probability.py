"""The probability that simulated runs fail: noise in it, resumed to the same bits, with runs that can be repeated."""

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from shared_compilation import shared_programs

from rpojax.analysis.reliability.rare_events.latent_points import LatentPoints
from rpojax.analysis.reliability.search_settings import EstimateSettings, FailureChoice
from rpojax.analysis.reliability.simulated_failures.estimate_folder import EstimateFolder
from rpojax.analysis.reliability.simulated_failures.failure_margin import choose_failure
from rpojax.analysis.reliability.simulated_failures.run_probability import run_probability
from rpojax.analysis.reliability.simulated_failures.simulated_margins import SimulatedMargins
from rpojax.campaign.run_and_resume import run_campaign
from rpojax.cli import main
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile

pytestmark = pytest.mark.slow  # it compiles the closed loop and simulates some 8000 short runs

BUDGET = 3000
"""Runs of the estimate; with fewer its weights degenerate."""
KEEP_OUT = FailureChoice(outcome="keep_out")
OVERRIDES = ("duration_s=100.0", "formation.desired_position_m=[0.0,-50.0,0.0]", "limits.keep_out_m=43.0")
"""100 s at 50 m, where a range of 43 m is three sigmas away."""


@pytest.fixture(scope="module", autouse=True)
def programs() -> Iterator[None]:
    """Engines share compiled programs."""
    with shared_programs():
        yield


@pytest.fixture(scope="module")
def mission() -> ScenarioFile:
    """The short mission."""
    return scenario_loader.load("inspection", OVERRIDES)


@pytest.fixture(scope="module")
def simulated() -> SimulatedMargins:
    """Margins to keep-out of runs that are long enough for a burn, by which noise reaches them."""
    mission = scenario_loader.load("inspection", [*OVERRIDES, "duration_s=400.0"])
    return SimulatedMargins(standard_normal_space.make_space(mission), choose_failure(mission, KEEP_OUT), 3)


def test_redrawn_noise_changes_a_run_and_its_own_does_not(simulated: SimulatedMargins) -> None:
    rng = np.random.default_rng(0)
    own = simulated.latent.sample(rng, 12)
    margins = simulated(own)
    keys = own.keys.copy()
    keys[:, 1:] = rng.integers(1, 2**32, keys[:, 1:].shape, dtype=np.uint32)
    changes = np.abs(simulated(LatentPoints(own.x, keys)) - margins)
    one = int(np.argmax(changes))
    assert 0.0 < changes[one] < 2.0
    keys[:one], keys[one + 1 :] = own.keys[:one], own.keys[one + 1 :]
    alone = np.abs(simulated(LatentPoints(own.x, keys)) - margins)
    np.testing.assert_array_equal(np.delete(alone, one), 0.0)
    assert alone[one] == changes[one]


@pytest.fixture(scope="module")
def estimated(mission: ScenarioFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a small estimate; tests must not change it."""
    out = tmp_path_factory.mktemp("estimate") / "p"
    run_probability(mission, KEEP_OUT, EstimateSettings(budget=BUDGET), 3, out)
    return out


def test_the_result_has_what_was_promised(estimated: Path) -> None:
    content = json.loads((estimated / "probability.json").read_text())
    assert 1e-4 < content["probability"] < 2e-2
    assert content["interval_95"][0] < content["probability"] < content["interval_95"][1]
    assert content["evaluations"] <= BUDGET
    assert content["method"] in ("importance", "subset")
    assert content["failing_runs"]
    farthest = content["design_points"][0]["dispersions"][0]["name"]
    assert farthest.startswith("initial.relative_")


def without_place(path: Path, folder: Path) -> str:
    """Text of a file, without the folder's name in commands, nor the digest of a content that has such commands."""
    text = path.read_text().replace(str(folder), "DIR")
    if path.name == "probability.json":
        return "".join(line for line in text.splitlines() if '"sha256"' not in line)
    return text


@pytest.mark.parametrize("by_folder_alone", [False, True])
def test_a_killed_estimate_ends_with_the_same_bits(
    mission: ScenarioFile, estimated: Path, tmp_path: Path, by_folder_alone: bool
) -> None:
    killed = tmp_path / "p"
    shutil.copytree(estimated, killed)
    (killed / "probability.json").unlink()
    batches = sorted((killed / "evaluations").iterdir())
    for path in batches[len(batches) // 2 :]:
        path.unlink()
    if by_folder_alone:
        assert main.main(["resume", str(killed), "--json"]) in (0, 3)
    else:
        run_probability(mission, KEEP_OUT, EstimateSettings(budget=BUDGET), 3, killed)
    EstimateFolder(killed).read("probability.json")  # whose digest is right
    for path in estimated.rglob("*.json"):
        assert without_place(killed / path.relative_to(estimated), killed) == without_place(path, estimated)


def test_the_command_of_a_failing_run_simulates_that_failure(estimated: Path, tmp_path: Path) -> None:
    content = json.loads((estimated / "probability.json").read_text())
    run = content["failing_runs"][0]
    assert f"--run-id {run['run_id']} " in run["command"]
    file = scenario_loader.load(str(estimated / run["scenario"]))
    found = run_campaign(file, 1, tmp_path / "run", 3, first_run=run["run_id"], block_size=1, progress=False)
    assert found.outcomes.tolist() == ["keep_out"]


def test_the_command_returns_a_finished_estimate(estimated: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = [word for text in OVERRIDES for word in ("--set", text)]
    words = ["probability", "inspection", *options, "--outcome", "keep_out", "--budget", str(BUDGET), "--seed", "3"]
    status = main.main([*words, "--out", str(estimated), "--json"])
    content = json.loads(capsys.readouterr().out)
    assert status == (0 if content["trusted"] else 3)
    assert {
        "probability",
        "interval_95",
        "coefficient_of_variation",
        "evaluations",
        "method",
        "trusted",
        "warnings",
    } <= set(content)
    assert "Most likely failing runs" in (estimated / "probability.html").read_text()
    assert main.main([*words[:-1], "4", "--out", str(estimated)]) == 2
    assert "another seed" in capsys.readouterr().err
