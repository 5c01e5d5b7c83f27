"""The command `faults`: its cells, what they say of known runs, its files and refusals."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpojax
from rpojax.analysis.robustness import fault_study
from rpojax.cli import main
from rpojax.physics.equipment_faults import KINDS

FILES = {"faults.json", "faults.html"}


class KnownRuns:
    """Runs that a camera blackout before 3000 s brings to 9 m in one of four, and nothing else to less than 20 m."""

    def __init__(self, file: Any, keys: Sequence[str], runs: int, *_: Any) -> None:
        self.runs, self.keys = runs, keys
        self.values: dict[str, np.ndarray] = {}

    def compile(self) -> None:
        """Nothing."""

    def simulate_changes(self, changes: Sequence[Mapping[str, np.ndarray]], on_batch: Any) -> list[dict[str, Any]]:
        on_batch(1.0, len(changes) * self.runs, 0)
        found = []
        for change in changes:
            assert {*change} <= {*self.keys}
            black = change.get("faults.fault.kind", np.zeros(1))[0] == KINDS.index("camera_blackout")
            is_early = change.get("faults.fault.start_s", np.zeros(1))[0] < 3000.0
            ranges = np.full(self.runs, 20.0)
            ranges[::4] = 9.0 if black and is_early else 18.0
            found.append({"min_range_m": ranges, "outcomes": np.full(self.runs, "completed")})
        return found


@pytest.fixture
def known_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """No simulation."""
    monkeypatch.setattr(fault_study, "AssignedRuns", KnownRuns)


@pytest.mark.usefixtures("known_runs")
def test_cells_are_written_as_record_and_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["faults", "inspection_faults", "--runs", "8", "--times", "1000,4000", "--out", str(out)]
    assert main.main(words) == main.Status.DONE
    printed = capsys.readouterr().out
    assert "All 8 runs survive 21 of 22 faults and times." in printed
    assert {path.name for path in out.iterdir()} == FILES
    content = json.loads((out / "faults.json").read_text())
    assert len(content["cells"]) == 22
    (black,) = [cell for cell in content["cells"] if cell["survived"] < 8]
    assert (black["kinds"], black["time_s"], black["survived"]) == (["camera_blackout"], 1000.0, 6)
    assert black["margin"] == {
        "requirement": "min_range_m", "value": 9.0, "limit": 12.0, "unit": "m", "relative": -0.25
    }  # fmt: skip
    assert (black["clearance_m"], black["worst_run"]) == (-1.0, 0)
    assert black["interval_95"] == pytest.approx([0.349, 0.968], abs=1e-3)
    assert content["nominal"]["survived"] == 8
    page = (out / "faults.html").read_text()
    assert "camera blackout" in page
    assert "--share: 0.750" in page
    assert "rpojax run inspection_faults --seed 0 --run-id 0 --set " in page
    assert main.main(words) == main.Status.BAD_INPUT
    assert "exists already" in capsys.readouterr().err
    assert main.main([*words, "--force", "--json"]) == main.Status.DONE
    assert json.loads(capsys.readouterr().out)["cells"] == content["cells"]


def test_every_piece_of_equipment_has_each_of_its_faults_and_pairs_are_of_different_ones() -> None:
    file = rpojax.load("final_approach")
    singles = fault_study.single_faults(file)
    assert len(singles) == 2 * 3 + 4 * len(file.thrusters) + 3
    assert {each.kind for each in singles} == {*KINDS} - {"none", "radio_off"}
    assert {each.thruster for each in singles} == set(range(len(file.thrusters)))
    alone = fault_study.single_faults(rpojax.load("inspection"))
    assert {each.kind for each in alone} == {each.kind for each in singles} - {*fault_study.LEAKS}
    pairs = fault_study.fault_sets(rpojax.load("inspection"), is_double=True)
    # Of 11 faults 55 pairs, without those of one wheel and of the one thruster.
    assert len(pairs) == 55 - 3 - 1


@pytest.mark.parametrize("source", ["inspection_faults", "inspection", "thruster_failure"])
def test_the_settings_of_a_cell_make_the_scenario_of_its_runs(source: str) -> None:
    file = rpojax.load(source)
    singles = fault_study.single_faults(file)
    one, two = singles[1], next(each for each in reversed(singles) if each.kind == "thruster_off")
    injection = fault_study.inject(file, 2)
    cell = fault_study.Cell((one, two), 750.0)
    alone = rpojax.load(source, injection.settings_of(cell))
    assert alone.effects.faults
    first, second = alone.faults
    assert [each.kind for each in alone.faults] == [one.kind, two.kind]
    assert (first.start_s, second.start_s) == (750.0, 750.0)
    for key, value in injection.values(cell, 1).items():
        _, name, field = key.split(".")
        given = getattr(next(each for each in alone.faults if each.name == name), field)
        if field in ("wheel", "thruster") and not value[0]:
            continue  # of another kind of equipment
        assert (KINDS.index(given) if field == "kind" else given) == value[0]
    varied = {entry.name for entry in alone.dispersions}
    assert varied == {entry.name for entry in injection.file.dispersions}
    assert not {f"faults.{name}.{key}" for name in injection.names for key in ("kind", "start_s", "wheel")} & varied


def test_an_ended_run_does_not_survive_and_has_no_margin() -> None:
    file = rpojax.load("inspection_faults")
    judged = [("min_range_m", file.requirements[0])]
    found = {"min_range_m": np.array([20.0, np.nan]), "outcomes": np.array(["completed", "keep_out"])}
    cell = fault_study.judge_cell(judged, found, np.full(2, 10.0))
    assert (cell["survived"], cell["worst_run"], cell["clearance_m"]) == (1, 1, 0.0)
    assert cell["margin"]["relative"] == -np.inf
    lost = {**found, "outcomes": np.array(["lost", "completed"]), "min_range_m": np.array([20.0, 15.0])}
    cell = fault_study.judge_cell([], lost, np.full(2, 10.0))
    assert (cell["survived"], cell["completed"], cell["worst_run"], cell["margin"]) == (1, 1, 0, None)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["cooperative_far"], "servicers: found 2, expected a scenario without [[servicers]] for faults"),
        (["inspection", "--runs", "0"], "--runs: found 0"),
        (["inspection", "--times", "1,x"], "--times: found '1,x', expected numbers"),
        (["inspection", "--times", "6000"], "--times: found 6000, expected a time within 6000 s"),
        (["inspection", "--times", "nan"], "--times: found nan"),
        (["inspection", "--every", "0"], "--every: found 0, expected a time within 6000 s"),
        (["inspection", "--every", "0.001"], "faults and times, expected at most"),
        (["inspection", "--every", "9", "--times", "5"], "--every: found 9 beside times"),
        (
            ["inspection", "--set", "design={kind='grid', values={'gps.noise_m'=[1.0, 2.0]}}"],
            "design.kind: found 'grid'",
        ),
    ],
)
def test_what_cannot_be_studied_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], told: str
) -> None:
    assert main.main(["faults", *words, "--out", str(tmp_path / "out")]) == main.Status.BAD_INPUT
    error = capsys.readouterr().err
    assert told in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()
