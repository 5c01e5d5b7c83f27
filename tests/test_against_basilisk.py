"""Comparison of speed with Basilisk: options, table, and, where Basilisk is installed, its mission."""

import json
import re
from contextlib import nullcontext
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import against_basilisk, basilisk_inputs, basilisk_peer, speed_comparison
from benchmarks.speed_comparison import MissionCheck, TimedPass
from experiments.validation.reference_file import quaternion_from_mrp
from rpojax.benchmark import closed_loop_speed
from rpojax.scenario.schema import ScenarioFile

WHERE = {
    "machine": "some machine",
    "cores_used": 2,
    "scenario": "inspection",
    "duration_s": 3000.0,
    "versions": {"Basilisk": "2.12.1", "rpojax": "0.1.0", "jax": "0.10.2", "python": "3.11.7"},
}
VALID = MissionCheck(orbits=3, formation_error_m=12.0, pointing_error_deg=0.05, burn_s=48.0)


def timed_pass(simulator: str, rate: float, at_once: int = 2) -> TimedPass:
    """A pass on one core whose set-up takes as long as its simulation."""
    span = 20 * 3000.0
    return TimedPass(simulator, at_once, 20, 3000.0, rate, rate / 2.0, 2.0 * span / rate, 0.01, 3.0, 0.05)


PASSES = [timed_pass("Basilisk", 10_000.0), timed_pass("rpojax", 40_000.0, 512), timed_pass("Basilisk", 12_000.0)]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--cores 0", "--cores: found 0, expected 1 to"),
        ("--cores 100000", "--cores: found 100000, expected 1 to"),
        ("--runs 0", "--runs: found 0, expected at least 1"),
        ("--duration-s 0.5", "--duration-s: found 0.5, expected at least 1"),
        ("--duration-s nan", "--duration-s: found nan, expected at least 1"),
        ("--batches 64 0", "--batches: found [64, 0], expected batch sizes from 1"),
        ("--json {folder}/taken.json", "--json: found {folder}/taken.json, expected a file that does not exist yet"),
        ("--json {folder}/taken.json/new.json", "expected a folder that can be written to"),
    ],
)
def test_bad_options_are_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: str, message: str
) -> None:
    (tmp_path / "taken.json").write_text("kept")
    assert against_basilisk.main(words.format(folder=tmp_path).split()) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert message.format(folder=tmp_path) in lines[0]
    assert (tmp_path / "taken.json").read_text() == "kept"


def test_by_default_two_batches_use_all_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(against_basilisk, "available_cores", lambda: 4)
    given = against_basilisk.parse_options([])
    assert (given.cores, given.batches, given.duration_s, given.json) == (4, [512, 1024], 3000.0, None)
    assert against_basilisk.parse_options(["--cores", "2"]).batches == [256, 512]


def test_error_without_basilisk_names_the_install_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(against_basilisk, "version", missing)
    assert against_basilisk.main([]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "against_basilisk: bsk: not installed, expected: pip install 'rpojax[validation]'"
    ]


def content() -> dict[str, Any]:
    return speed_comparison.as_json(PASSES, [VALID], {"Basilisk": 1.0, "rpojax": 2.0, "compile": 26.0}, WHERE)


def run_command(monkeypatch: pytest.MonkeyPatch, check: MissionCheck, *words: str) -> int:
    """Exit status of the command with stand-ins for both simulators, of given speeds."""
    monkeypatch.setattr(against_basilisk, "ROUNDS", 2)
    rates = {"Basilisk": iter([10_000.0, 12_000.0]), "rpojax": iter([90_000.0, 40_000.0, 39_000.0])}
    peer = SimpleNamespace(
        import_s=1.0,
        check_mission=lambda *_: [VALID, check],
        run_pass=lambda *_: timed_pass("Basilisk", next(rates["Basilisk"])),
    )
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    monkeypatch.setattr(against_basilisk, "basilisk_version", lambda: "2.12.1")
    monkeypatch.setattr(basilisk_inputs, "dispersed_inputs", lambda *_: [])
    monkeypatch.setattr(basilisk_peer, "started_workers", lambda *_: nullcontext(peer))
    monkeypatch.setattr(
        closed_loop_speed, "compile_engine", lambda _, batch: SimpleNamespace(capacity=batch, compile_s=26.0)
    )
    monkeypatch.setattr(
        against_basilisk, "rpojax_pass", lambda engine: timed_pass("rpojax", next(rates["rpojax"]), engine.capacity)
    )
    return against_basilisk.main([*words, "--batches", "512"])


def test_passes_alternate_and_the_first_of_rpojax_is_a_warm_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command(monkeypatch, VALID, "--json", str(tmp_path / "new" / "speed.json")) == 0
    found = json.loads((tmp_path / "new" / "speed.json").read_text())
    order = [(one["simulator"], one["flight_rate"]) for one in found["passes"]]
    assert order == [("Basilisk", 10_000.0), ("rpojax", 40_000.0), ("Basilisk", 12_000.0), ("rpojax", 39_000.0)]
    assert found["starts"]["compile"] == 26.0
    assert found["where"]["versions"]["Basilisk"] == "2.12.1"
    assert capsys.readouterr().out.splitlines() == speed_comparison.report_lines(found)


def test_an_invalid_mission_is_not_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lost = MissionCheck(orbits=3, formation_error_m=400.0, pointing_error_deg=0.05, burn_s=48.0)
    assert run_command(monkeypatch, lost, "--json", str(tmp_path / "speed.json")) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.splitlines()[-1] == (
        "against_basilisk: Basilisk's mission fails its check: formation error: found 400.0 m, expected at most 30 m"
    )
    assert not (tmp_path / "speed.json").exists()


def test_ratio_is_of_fastest_passes_and_all_passes_are_recorded() -> None:
    found = json.loads(json.dumps(content(), allow_nan=False))
    assert found["ratio"] == pytest.approx(40 / 12)
    assert found["ratio_with_setup"] == pytest.approx(40 / 12)
    assert found["ratio_by_cpu_time"] == pytest.approx(40 / 12)
    assert found["best"]["Basilisk"]["runs_per_hour"] == pytest.approx(12_000 * 3600 / 3000)
    assert found["best"]["rpojax"]["runs_per_hour_with_setup"] == pytest.approx(20_000 * 3600 / 3000)
    assert [one["flight_rate"] for one in found["passes"]] == [10_000.0, 40_000.0, 12_000.0]
    assert found["proofs"] == [vars(VALID)]


def test_report_has_one_table_and_lists_common_points_and_differences() -> None:
    lines = speed_comparison.report_lines(content())
    rows = [line for line in lines if line.startswith("|")]
    assert rows[0] == "| | Basilisk 2.12.1 | rpojax 0.1.0 | ratio |"
    assert {row.count("|") for row in rows} == {5}
    assert "| run-seconds per second, simulation alone | 12 000 | 40 000 | **3.33** |" in rows
    assert "| runs of 3000 s per hour, with set-up | 7 200 | 24 000 | **3.33** |" in rows
    assert "| tracing and compiling, s | 0 | 26.0 | |" in [re.sub(r" +", " ", row) for row in rows]
    assert [line for line in lines if line.startswith("- ")] == [
        f"- {word}" for word in (*speed_comparison.COMMON, *speed_comparison.DIFFERENCES)
    ]


def test_break_even_run_count_including_start_up_time() -> None:
    slow, fast = timed_pass("Basilisk", 12_000.0), timed_pass("rpojax", 40_000.0)
    runs = speed_comparison.break_even(slow, fast, 1.0, 28.0)
    assert runs is not None

    def lead(runs: int) -> float:
        return 1.0 + runs * 3000.0 / slow.whole_rate - (28.0 + runs * 3000.0 / fast.whole_rate)

    assert lead(runs - 1) < 0.0 <= lead(runs)
    assert speed_comparison.break_even(slow, fast, 28.0, 1.0) == 0
    assert speed_comparison.break_even(fast, slow, 1.0, 28.0) is None
    lines = speed_comparison.report_lines(
        speed_comparison.as_json([timed_pass("Basilisk", 9e4), PASSES[1]], [VALID], content()["starts"], WHERE)
    )
    assert any(line.endswith("| | none | |") for line in lines)


@pytest.mark.parametrize(
    ("check", "failure"),
    [
        (VALID, None),
        (MissionCheck(3, 400.0, 0.05, 48.0), "formation error: found 400.0 m, expected at most 30 m"),
        (MissionCheck(3, float("nan"), 0.05, 48.0), "formation error: found nan m, expected at most 30 m"),
        (MissionCheck(3, 12.0, 2.0, 48.0), "pointing error: found 2.00 deg, expected at most 0.5 deg"),
        (MissionCheck(3, 12.0, 0.05, 0.0), "burns: found none, expected at least one"),
    ],
)
def test_mission_check_bounds_formation_pointing_and_burns(check: MissionCheck, failure: str | None) -> None:
    assert check.failure() == failure


def test_modified_rodrigues_parameters_follow_basilisks_convention() -> None:
    for q in ([0.5, -0.5, 0.5, 0.5], [-0.1, 0.7, 0.1, 0.7], [0.0, 0.6, 0.0, 0.8]):
        sigma = basilisk_inputs.modified_rodrigues_parameters(np.array(q))
        assert np.linalg.norm(sigma) <= 1.0
        back = quaternion_from_mrp(sigma) * np.array([1.0, -1.0, -1.0, -1.0])
        np.testing.assert_allclose(abs(back @ np.array(q)) / np.linalg.norm(q), 1.0, rtol=1e-12)


def test_basilisk_starts_at_the_initial_state_and_points_at_the_target(inspection_file: ScenarioFile) -> None:
    pytest.importorskip("Basilisk")
    inputs = basilisk_inputs.dispersed_inputs(inspection_file, 2)
    with basilisk_peer.started_workers(inputs[1:], 1) as peer:  # the first run begins with a turn to a burn
        one = peer.run_pass(2, 1.0)
        (check,) = peer.check_mission(60.0, 1)
        assert peer.run_pass(1, 20.0).formation_error_m == peer.run_pass(1, 20.0).formation_error_m
    first, start = ([np.array(run[f"r0_{name}"]) for name in ("chaser", "target")] for run in inputs)
    assert np.linalg.norm(first[0] - first[1]) != np.linalg.norm(start[0] - start[1])
    assert abs(one.formation_error_m - (np.linalg.norm(start[0] - start[1]) - 30.0)) < 0.5
    assert one.runs == 2
    assert one.flight_rate > one.whole_rate > 0.0
    assert check.pointing_error_deg < speed_comparison.MAX_POINTING_ERROR_DEG
    assert check.failure() == "burns: found none, expected at least one"
