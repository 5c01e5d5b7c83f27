"""The plant reproduces trajectories of Basilisk, and files of another format are refused."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.validation import replay
from experiments.validation.reference_file import read_reference, validate
from experiments.validation.replay import ReplayOptions, ReplayResult

ROOT = Path(__file__).parents[2]


FILES = sorted((Path(__file__).parent / "references").glob("*.npz"))


# Basilisk is accurate to about 1e-5 m per day and 1e-9 rad; it holds air density and shadow constant over a step.
TOLERANCES: dict[str, dict[str, float]] = {
    "a_two_body": {"position_error_m": 1e-4, "velocity_error_m_s": 1e-7},
    "a_two_body_eccentric": {"position_error_m": 1e-3, "velocity_error_m_s": 1e-6},
    "b_j2": {"position_error_m": 1e-4, "velocity_error_m_s": 1e-7},
    "b_zonals_6": {"position_error_m": 1e-4, "velocity_error_m_s": 1e-7},
    "c_relative": {"position_error_m": 1e-4, "relative_position_error_m": 1e-5},
    "c_safety_ellipse_eccentric": {"position_error_m": 1e-3, "relative_position_error_m": 1e-4},
    "c_safety_ellipse_low": {"position_error_m": 1e-4, "relative_position_error_m": 1e-5},
    "d_middle_axis": {"attitude_error_rad": 1e-6, "rate_error_rad_s": 1e-7},
    "d_tumble": {"attitude_error_rad": 1e-8, "rate_error_rad_s": 1e-9},
    "e_wheels": {"attitude_error_rad": 1e-8, "rate_error_rad_s": 1e-9, "wheel_speed_error_rad_s": 1e-8},
    "f_gravity_gradient": {"position_error_m": 1e-4, "attitude_error_rad": 1e-10, "rate_error_rad_s": 1e-13},
    "g_burns": {"position_error_m": 1e-6, "velocity_error_m_s": 1e-8, "attitude_error_rad": 1e-9},
    "h_drag": {"position_error_m": 0.1, "velocity_error_m_s": 1e-4},
    "h_sunlight": {"position_error_m": 0.01, "illumination_error": 1e-10},
    "i_combined": {"position_error_m": 1e-6, "attitude_error_rad": 1e-8, "wheel_speed_error_rad_s": 1e-8},
    "j_attitude_loop": {"attitude_error_rad": 1e-6, "rate_error_rad_s": 1e-7},
}


def exceeded(result: ReplayResult, tolerances: dict[str, float]) -> dict[str, Any]:
    """Errors that are missing or above their tolerances."""
    errors = {key: getattr(result, key) for key in tolerances}
    return {key: error for key, error in errors.items() if error is None or not error <= tolerances[key]}


def file(case: str) -> Path:
    return next(path for path in FILES if path.stem == case)


def test_every_reference_has_tolerances_and_their_total_size_is_small() -> None:
    assert [path.stem for path in FILES] == sorted(TOLERANCES)
    assert sum(path.stat().st_size for path in FILES) < 600_000


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_plant_follows_basilisk(path: Path) -> None:
    assert exceeded(replay.replay(read_reference(path)), TOLERANCES[path.stem]) == {}


def test_replayed_torque_commands_reproduce_the_attitude_loop() -> None:
    """A run with feedback, and one with its logged torques as commands, give the same attitude."""
    loop = read_reference(file("j_attitude_loop"))
    closed = replay.replay(loop)
    period = loop.number("dt_ctrl")
    times = np.arange(0.0, loop["t"][-1], period)
    states, _ = replay.propagate(validate("dense", {**loop.arrays, **_sampled_at(loop.arrays, times)}), ReplayOptions())
    law = loop.number("K") * _sigma(np.asarray(states.q_BN)) + loop.number("P") * np.asarray(states.omega_BN_B)
    logged = validate("logged", {**loop.arrays, "t_cmd": times, "u_cmd": law @ loop["gs"].T})
    opened = replay.replay(logged, ReplayOptions(logged_commands=True))
    assert closed.attitude_error_rad is not None and opened.attitude_error_rad is not None
    assert opened.attitude_error_rad < 1e-9


def _sampled_at(arrays: dict[str, np.ndarray], times: np.ndarray) -> dict[str, np.ndarray]:
    """Histories with samples at the given times; their values are placeholders."""
    histories = {key: arrays[key] for key in ("q", "omega", "Omega")}
    return {"t": times, **{key: np.repeat(value[:1], times.size, axis=0) for key, value in histories.items()}}


def _sigma(q_BN: np.ndarray) -> np.ndarray:
    q = q_BN * np.array([1.0, -1.0, -1.0, -1.0]) * np.sign(q_BN[:, :1])
    return q[:, 1:] / (1.0 + q[:, :1])


def test_burns_that_end_inside_a_step_meet_the_tolerances() -> None:
    """Without splitting steps: the plant's own treatment of a burn that ends inside a step."""
    result = replay.replay(read_reference(file("g_burns")), ReplayOptions(step_s=0.2, whole_steps=True))
    assert exceeded(result, TOLERANCES["g_burns"]) == {}


@pytest.mark.parametrize(
    ("case", "key", "factor"),
    [
        ("b_zonals_6", "J", [1.0, 1.0, 1.0, 1.0, 1.01]),
        ("e_wheels", "Js", 1.0 + 1e-5),
        ("g_burns", "burns", [1.0, 1.0, 1.0 + 1e-5]),
        ("f_gravity_gradient", "I", [[1.0 + 1e-5, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]),
        ("h_sunlight", "Cr", 1.01),
        ("h_drag", "Cd", 1.001),
    ],
)
def test_a_wrong_parameter_exceeds_the_tolerances(case: str, key: str, factor: Any) -> None:
    arrays = dict(read_reference(file(case)).arrays)
    arrays[key] = arrays[key] * np.array(factor)
    words = {"meta_json": np.array(json.dumps({"torque": "gravity gradient"}))} if case.startswith("f") else {}
    assert exceeded(replay.replay(validate(case, {**arrays, **words})), TOLERANCES[case]) != {}


def test_the_shadow_needs_no_logged_illumination() -> None:
    arrays = read_reference(file("h_sunlight")).arrays
    unlogged = replay.replay(validate("unlogged", {key: arrays[key] for key in arrays if key != "illumination"}))
    assert unlogged.illumination_error is None
    assert exceeded(unlogged, {"position_error_m": 0.01}) == {}


def test_the_command_line_prints_one_json_object_per_file() -> None:
    names = ["d_tumble", "g_burns"]
    found = _run(*(str(file(name)) for name in names), "--json")
    assert found.returncode == 0, found.stderr
    lines = [json.loads(line) for line in found.stdout.splitlines()]
    assert [line["case"] for line in lines] == names
    assert lines[0]["position_error_m"] is None and lines[0]["attitude_error_rad"] < 1e-8
    assert lines[1]["position_error_m"] < 1e-6 and lines[1]["illumination_error"] is None
    assert lines[1]["effects"] == ["gravity", "attitude", "burns"]
    assert all(line["integrator"] == "rk8" and line["step_s"] > 0.0 for line in lines)


def _run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "experiments.validation.replay", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_the_command_line_refuses_other_files_in_one_line_with_status_2(tmp_path: Path) -> None:
    path = tmp_path / "words.npz"
    path.write_text("no archive")
    found = _run(str(path), "--json")
    assert (found.returncode, found.stdout) == (2, "")
    assert len(found.stderr.splitlines()) == 1 and "words.npz" in found.stderr


def test_a_refused_file_does_not_silence_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words, damaged = tmp_path / "words.npz", tmp_path / "damaged.npz"
    words.write_text("no archive")
    content = bytearray(file("d_tumble").read_bytes())
    content[len(content) // 2] ^= 0xFF
    damaged.write_bytes(content)
    assert replay.main([str(words), str(file("d_tumble")), str(damaged), "--json"]) == 2
    found = capsys.readouterr()
    assert [json.loads(line)["case"] for line in found.out.splitlines()] == ["d_tumble"]
    assert [Path(line.split(":")[1].strip()).name for line in found.err.splitlines()] == ["words.npz", "damaged.npz"]


def test_the_first_sample_need_not_be_the_start() -> None:
    arrays = read_reference(file("d_tumble")).arrays
    later = {key: value[3:] if key in ("t", "q", "omega") else value for key, value in arrays.items()}
    assert exceeded(replay.replay(validate("later", later)), TOLERANCES["d_tumble"]) == {}
