"""Missions of one's own: what is derived fits, what cannot be flown is said, and the file is the scenario."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

import rpojax
from rpojax.cli import main
from rpojax.errors import RpojaxError
from rpojax.scenario.own_mission.facts import MissionFacts
from rpojax.scenario.own_mission.mission_file import own_mission
from rpojax.scenario.own_mission.target_outline import mass_of_volume, side_of_mass
from rpojax.scenario.scenario_digest import scenario_digest

_PLACE = "--altitude-km 550 --hold-m 40 --approach-m 15"
PANELS = [word for words in ("--mass-kg 120 --thrust-n 1 --target-m 3 --span-m 9", _PLACE) for word in words.split()]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_file_is_the_mission_and_warns_of_nothing(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main.main(["new", "panels", *PANELS]) == 0
    assert capsys.readouterr() == ("panels.toml\n", "")
    facts = MissionFacts(
        mass_kg=120.0, thrust_n=1.0, target_m=(3.0,), span_m=9.0, altitude_km=550.0, hold_m=40.0, approach_m=15.0
    )
    mission = own_mission("panels", facts)
    assert (here / "panels.toml").read_text() == mission.text
    assert scenario_digest(rpojax.load("panels.toml")) == scenario_digest(mission.file)
    assert mission.problems == []


def test_derived_numbers_follow_from_those_that_are_known() -> None:
    file = own_mission(
        "one", MissionFacts(mass_kg=120.0, target_m=(3.0,), span_m=9.0, hold_m=40.0, approach_m=15.0)
    ).file
    side = side_of_mass(120.0)
    assert mass_of_volume(side**3) == pytest.approx(120.0)
    assert np.trace(file.servicer.inertia_kg_m2) / 3.0 == pytest.approx(120.0 * side**2 / 6.0, rel=0.07)
    frame = 2.0 * 0.9 * 15.0 * np.tan(np.radians(0.5 * file.camera.field_of_view_deg))
    assert frame >= 1.2 * 9.38 > 0.9 * frame
    torque = 1e-3 * file.pointing.slew_acceleration_mrad_s2 * np.max(file.servicer.inertia_kg_m2)
    assert torque < file.wheels.torque_limit_n_m[0] < 2.0 * torque
    assert file.limits.keep_out_m < 15.0 - file.mission.abort_margin_m
    assert [phase.name for phase in file.phases] == ["hold_far", "approach", "hold_near"]


def test_reasons_stand_beside_what_is_derived(here: Path) -> None:
    main.main(["new", "panels", *PANELS])
    lines = (here / "panels.toml").read_text().splitlines()
    assert "field_of_view_deg = 46.0  # holds 9.38 m and a fifth at 13.5 m: 45.3 deg" in lines
    assert max(map(len, lines)) < 260
    assert tomllib.loads("\n".join(lines))["extends"] == "inspection"


def test_starts_are_in_the_light_where_there_is_darkness() -> None:
    file = own_mission("one", MissionFacts(local_time_h=12.0)).file
    (found,) = [each for each in file.model_dump()["dispersions"] if each.get("key") == "orbit.true_anomaly_deg"]
    assert 0.0 < found["high"] - found["low"] <= 60.0
    assert own_mission("one", MissionFacts()).file.orbit.raan_deg == pytest.approx(89.67, abs=0.1)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--hold-m", "2", "--target-m", "3"], "hold_m: found 2, expected more than 3.12"),
        (["--target-m", "3", "1"], "--target-m: found 2 sides, expected one or three"),
        (["--mass-kg", "-1"], "--mass-kg: found -1, expected 0.5 to 100000"),
        (["--approach-m", "40"], "--approach-m: found 40, expected less than hold_m = 30"),
        (["--local-time-h", "6", "--beta-deg", "10"], "found both, expected one of them"),
        (["--beta-deg", "60", "--inclination-deg", "3"], "--beta-deg: found 60, expected -"),
        (["--mass-kg", "20", "--extends", "inspection"], "--extends: found 'inspection' beside mass_kg"),
        (["--target-mesh", "none.obj"], "none.obj: no such file"),
    ],
)
def test_what_makes_no_mission_is_refused_in_one_line(
    words: list[str], expected: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main.main(["new", "one", *words]) == 2
    error = capsys.readouterr().err
    assert expected.replace("hold_m: found", "hold-m: found") in error or expected in error
    assert error.count("\n") == 1
    assert not (here / "one.toml").exists()


def test_what_cannot_be_flown_is_said_in_two_numbers() -> None:
    narrow = own_mission("one", MissionFacts(target_m=(3.0,), span_m=9.0, lens_deg=5.0)).problems
    assert narrow[0].startswith("camera.field_of_view_deg: found 5, expected at least 23.5 to hold a target")
    long = own_mission("one", MissionFacts(target_m=(2.0, 2.0, 3.0), span_m=30.0, hold_m=120.0)).problems
    assert [line for line in long if "varies by 0.386 over attitudes (1 sigma), expected at most 0.25" in line]
    weak = own_mission("one", MissionFacts(mass_kg=100.0, thrust_n=1e-3)).problems
    assert any(line.startswith("thruster.force_n: the way to the station") for line in weak)


def test_a_mesh_takes_the_place_of_sizes(here: Path) -> None:
    corners = [(a, b, c) for a in (-1, 1) for b in (-0.5, 0.5) for c in (-0.5, 0.5)]
    faces = ["1 3 4", "1 4 2", "5 6 8", "5 8 7", "1 2 6", "1 6 5", "3 7 8", "3 8 4", "1 5 7", "1 7 3", "2 4 8", "2 8 6"]
    text = [f"v {a} {b} {c}" for a, b, c in corners] + [f"f {each}" for each in faces]
    (here / "box.obj").write_text("\n".join([*text, ""]))
    of_mesh = own_mission("one", MissionFacts(target_mesh="box.obj", mesh_units="m")).file
    of_sides = own_mission("one", MissionFacts(target_m=(2.0, 1.0, 1.0))).file
    assert sorted(of_mesh.target.hull_m) == sorted(of_sides.target.hull_m)
    assert of_mesh.navigation.target_size_m == of_sides.navigation.target_size_m


def test_questions_are_asked_in_a_terminal_alone(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from rpojax.cli.commands.scenarios import new

    lines = iter(["120\n", "one\n", "1\n", *["\n"] * 8])
    monkeypatch.setattr(new, "_is_terminal", lambda: True)
    monkeypatch.setattr(new.sys.stdin, "readline", lambda: next(lines), raising=False)
    assert main.main(["new", "asked"]) == 0
    asked = capsys.readouterr().err
    assert "mass of the servicer [kg] [30.0]: " in asked
    assert "thrust_n: found 'one', expected numbers" in asked
    file = rpojax.load("asked.toml")
    assert (file.servicer.mass_kg, file.thruster.force_n) == (120.0, 1.0)


def test_facts_have_limits() -> None:
    with pytest.raises(RpojaxError, match="span_m: found 2, expected more than the body, 3 m"):
        MissionFacts(target_m=(3.0,), span_m=2.0)
