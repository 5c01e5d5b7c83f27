"""The plant follows trajectories that Basilisk has flown, and what is no such trajectory is refused."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.validation import replay
from experiments.validation.gravity_gradient_switch import has_gravity_gradient
from experiments.validation.reference_file import FormatError, read_reference, validate
from experiments.validation.replay import ReplayOptions, ReplayResult

ROOT = Path(__file__).parents[2]
FILES = sorted((Path(__file__).parent / "references").glob("*.npz"))

# Basilisk itself is good to some 1e-5 m a day, 1e-9 rad; it holds air density and shadow over a step.
BARS: dict[str, dict[str, float]] = {
    "a_two_body": {"position_error_m": 1e-4, "velocity_error_m_s": 1e-7},
    "a_two_body_eccentric": {"position_error_m": 1e-3, "velocity_error_m_s": 1e-6},
    "b_j2": {"position_error_m": 1e-4, "velocity_error_m_s": 1e-7},
    "b_zonals_6": {"position_error_m": 1e-4, "velocity_error_m_s": 1e-7},
    "c_relative": {"position_error_m": 1e-4, "relative_position_error_m": 1e-5},
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


def over(result: ReplayResult, bars: dict[str, float]) -> dict[str, Any]:
    """Errors that are missing or above their bars."""
    errors = {key: getattr(result, key) for key in bars}
    return {key: error for key, error in errors.items() if error is None or not error <= bars[key]}


def file(case: str) -> Path:
    return next(path for path in FILES if path.stem == case)


def test_every_reference_has_tolerances_and_their_total_size_is_small() -> None:
    assert [path.stem for path in FILES] == sorted(BARS)
    assert sum(path.stat().st_size for path in FILES) < 600_000


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_plant_follows_basilisk(path: Path) -> None:
    assert over(replay.replay(read_reference(path)), BARS[path.stem]) == {}


def test_replayed_torque_commands_reproduce_the_attitude_loop() -> None:
    """With the feedback law flown once, its torques logged and flown again the result is the same."""
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
    """Histories that have the samples asked for; only the times count."""
    histories = {key: arrays[key] for key in ("q", "omega", "Omega")}
    return {"t": times, **{key: np.repeat(value[:1], times.size, axis=0) for key, value in histories.items()}}


def _sigma(q_BN: np.ndarray) -> np.ndarray:
    q = q_BN * np.array([1.0, -1.0, -1.0, -1.0]) * np.sign(q_BN[:, :1])
    return q[:, 1:] / (1.0 + q[:, :1])


def test_burns_that_end_inside_a_step_meet_the_tolerances() -> None:
    """Without splitting, the plant's own treatment of a burn that ends inside a step."""
    result = replay.replay(read_reference(file("g_burns")), ReplayOptions(step_s=0.2, whole_steps=True))
    assert over(result, BARS["g_burns"]) == {}


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
    assert over(replay.replay(validate(case, {**arrays, **words})), BARS[case]) != {}


def test_the_shadow_needs_no_logged_illumination() -> None:
    arrays = read_reference(file("h_sunlight")).arrays
    unlogged = replay.replay(validate("unlogged", {key: arrays[key] for key in arrays if key != "illumination"}))
    assert unlogged.illumination_error is None
    assert over(unlogged, {"position_error_m": 0.01}) == {}


@pytest.mark.parametrize(
    ("acts", "meta"),
    [
        (True, {"torque": "gravity gradient of a point mass"}),
        (True, {"torque": "tau_B = 3 mu / r^5 * r_B x (I r_B); logged late, compare loosely"}),
        (True, {"gravity": "J2 + gravity-gradient torque (point-mass term)", "note": "no drag"}),
        (True, {"note": "no drag, gravity gradient on"}),
        (True, {"note": "the gravity gradient is not negligible"}),
        (True, {"effects": ["J2", "gravity_gradient"]}),
        (True, {"gravity_gradient": True, "note": "no gravity gradient in the first half"}),
        (True, {"case": "wheels_with_gravity_gradient"}),
        (False, {"note": "no gravity gradient"}),
        (False, {"note": "gravity-gradient torque not modelled"}),
        (False, {"note": "gravity gradient: off"}),
        (False, {"note": "point mass, without drag or gravity gradient"}),
        (False, {"note": "no drag, sunlight or gravity gradient"}),
        (False, {"note": "gravity gradient (off)"}),
        (False, {"note": "gravity-gradient-free orbit"}),
        (True, {"note": "J2, gravity gradient, no drag"}),
        (True, {"note": "gravity gradient (not logged exactly at the sample)"}),
        (False, {"note": "free of drag and gravity gradient"}),
        (False, {"note": "not modelled: drag, gravity gradient"}),
        (False, {"note": "gravity gradient torque is disabled", "case": "f_gravity_gradient"}),
        (False, {"case": "f_no_gravity_gradient"}),
        (False, {"gravity_gradient": "off"}),
        (False, {"effects": {"gravity_gradient": False}}),
        (False, {"no_gravity_gradient": True}),
        (False, {"case": "f_low_orbit"}),
        (False, {}),
    ],
)
def test_gravity_gradient_is_recognised_from_a_key_or_the_description(acts: bool, meta: dict[str, Any]) -> None:
    arrays = read_reference(file("f_gravity_gradient")).arrays
    described = validate("described", {**arrays, "meta_json": np.array(json.dumps(meta))})
    assert has_gravity_gradient(described) is acts
    assert [has_gravity_gradient(described, wish) for wish in ("on", "off")] == [True, False]


def test_gravity_gradient_is_recognised_from_a_logged_torque_unless_an_array_switches_it_off() -> None:
    arrays = read_reference(file("f_gravity_gradient")).arrays
    logged = {**arrays, "torque_gg": np.zeros_like(arrays["r"])}
    assert has_gravity_gradient(validate("logged", logged))
    assert not has_gravity_gradient(validate("off", {**logged, "gravity_gradient": np.array(False)}))
    assert (
        over(replay.replay(validate("off", logged), ReplayOptions(gravity_gradient="off")), BARS["f_gravity_gradient"])
        != {}
    )


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


def write(folder: Path, **changes: Any) -> Path:
    """A short tumble with changed keys; None leaves one out."""
    arrays: dict[str, Any] = {**read_reference(file("d_tumble")).arrays, **changes}
    path = folder / "changed.npz"
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})
    return path


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


def test_any_damage_to_an_archive_is_refused_or_harmless(tmp_path: Path) -> None:
    content = write(tmp_path).read_bytes()
    path = tmp_path / "damaged.npz"
    for place in range(0, len(content), 97):
        path.write_bytes(content[:place] + bytes([content[place] ^ 0xFF]) + content[place + 1 :])
        try:
            read_reference(path)
        except FormatError as refused:
            assert "\n" not in str(refused)


def test_the_first_sample_need_not_be_the_start() -> None:
    arrays = read_reference(file("d_tumble")).arrays
    later = {key: value[3:] if key in ("t", "q", "omega") else value for key, value in arrays.items()}
    assert over(replay.replay(validate("later", later)), BARS["d_tumble"]) == {}


ONE_THRUSTER = {"thr_loc": np.zeros((1, 3)), "thr_dir": np.eye(3)[:1], "F_max": np.ones(1)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t": None}, "'t' is missing"),
        ({"I": None}, "'I' is missing"),
        ({"q": None, "sigma_BN": None}, "nothing to compare"),
        ({"q": np.ones((3, 4)) / 2.0}, "'q': found shape"),
        ({"omega": np.full((99, 3), np.nan)}, "not finite"),
        ({"t": np.arange(99.0)[::-1]}, "times that increase"),
        ({"I": np.array([["a"] * 3] * 3)}, "expected numbers"),
        ({"I": np.array([[2.0, 0.1, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]])}, "'I': found a tensor that is not symm"),
        ({"I": np.diag([1.0, -1.0, 1.0])}, "'I': found a principal moment of -1"),
        ({"I": np.diag([1.0, 1.0, 2.1])}, "'I': found moments 1, 1, 2.1, expected"),
        ({"m": np.array(0.0)}, "'m': found 0, expected more than 0"),
        ({"omega0": np.array([1e4, 0.0, 0.0])}, "steps to simulate, expected 5e"),
        ({**ONE_THRUSTER, "thr_dir": np.zeros((1, 3)), "burns": np.zeros((1, 3))}, "'thr_dir': found a direction of"),
        ({"meta_json": np.array("{")}, "not JSON"),
        ({"burns": np.array([[0.0, 1.0, 1.0]])}, "'F_max' is missing: found 'burns', expected"),
        (ONE_THRUSTER, "'burns' is missing"),
        ({**ONE_THRUSTER, "burns": np.array([[1.0, 1.0, 1.0]])}, "not one of the 1"),
        ({"t_cmd": np.array([0.0, 1.0])}, "'u_cmd' is missing: found 't_cmd'"),
        ({"Omega": np.zeros((99, 3))}, "'gs' is missing: found 'Omega'"),
        ({"R_sun": np.array(7e8)}, "'Re_eclipse' is missing: found 'R_sun'"),
        ({"u_cmd": np.zeros((2, 3)), "t_cmd": np.array([0.0, 1.0])}, "'gs' is missing"),
        ({"Cr": np.array(1.2)}, "is missing"),
    ],
)
def test_a_file_that_is_not_of_the_format_is_refused_with_a_reason(
    tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    path = write(tmp_path, **changes)
    with pytest.raises(FormatError, match=message) as refused:
        replay.replay(read_reference(path))
    assert "\n" not in str(refused.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="nowhere"):
        read_reference(tmp_path / "nowhere.npz")
