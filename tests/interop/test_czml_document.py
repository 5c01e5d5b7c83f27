"""CZML of a run, read by `czml3`; positions and attitudes against the states, and the Earth's rotation by hand."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from czml3 import Document, Packet
from scipy.spatial.transform import Rotation

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import main
from rpojax.errors import RpojaxError
from rpojax.interop import czml_document, run_replay
from rpojax.interop.czml_document import SpacecraftShapes
from rpojax.interop.export import export
from rpojax.interop.run_replay import ReplayedRun
from rpojax.interop.spacecraft_states import BothStates, SpacecraftStates
from rpojax.time_scales import Instant, instant

RUN = 3
NANORADIAN = 1e-9


@pytest.fixture
def packets(
    campaign: Campaign, states_run: ReplayedRun[BothStates], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> dict[str, Any]:
    """Packets of the exported run by their id, read by `czml3`."""
    monkeypatch.setattr(run_replay, "replay_servicers", lambda *_, **__: (states_run,))
    [path] = export(campaign, tmp_path / "run.czml", run_id=RUN, progress=False)
    read = [Packet(**each) for each in json.loads(path.read_text())]
    assert Document(packets=read).packets[0].id == "document"
    return {each.id: each for each in read}


def rows(values: list[float], components: int) -> np.ndarray:
    """Samples (ticks, 1 + components), time first."""
    return np.reshape(values, (-1, 1 + components))


def test_positions_are_those_of_the_run_in_the_inertial_frame(
    packets: dict[str, Any], states_run: ReplayedRun[BothStates]
) -> None:
    values = states_run.values
    expected = {"target": values.r_TN_N, "servicer": values.r_TN_N + values.r_ST_N}
    for name, position in expected.items():
        found = packets[name].position
        read = rows(found.cartesian.values, 3)
        assert found.referenceFrame == "INERTIAL"
        assert found.epoch == "2026-03-20T14:46:00.000000Z"
        np.testing.assert_array_equal(read[:, 0], states_run.time_s)
        np.testing.assert_array_equal(read[:, 1:], position)


def test_the_attitude_between_the_spacecraft_is_that_of_the_run(
    packets: dict[str, Any], states_run: ReplayedRun[BothStates]
) -> None:
    # Both orientations are relative to the Earth, whose rotation drops out of that of one body to the other.
    R_EB, R_ET = (
        Rotation.from_quat(rows(packets[name].orientation.unitQuaternion.values, 4)[:, 1:]).as_matrix()
        for name in ("servicer", "target")
    )
    R_BN, R_TN = (
        Rotation.from_quat(np.roll(q, -1, axis=1)).as_matrix() for q in (states_run.values.q_BN, states_run.values.q_TN)
    )
    found, expected = R_EB.transpose(0, 2, 1) @ R_ET, R_BN @ R_TN.transpose(0, 2, 1)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=NANORADIAN)


def states_at(epoch: Instant, time_s: np.ndarray) -> SpacecraftStates:
    """A target whose body axes are those of N."""
    q = np.tile([1.0, 0.0, 0.0, 0.0], (len(time_s), 1))
    zeros = np.zeros((len(time_s), 3))
    return SpacecraftStates("target", epoch, time_s, zeros, zeros, q, about=("nothing",))


def test_inertial_axes_turn_with_the_sidereal_day_in_those_of_the_earth() -> None:
    # Earth rotation angle at J2000 (Capitaine 2000): 0.7790572732640 turns, and 1.00273781191135448 turns a day.
    time = np.array([0.0, 1000.0, 86400.0])
    found = Rotation.from_quat(czml_document.earth_fixed_attitudes(states_at(instant("2000-01-01T12:00:00"), time)))
    turns = 0.7790572732640 + 1.00273781191135448 * time / 86400.0
    expected = Rotation.from_rotvec(-2.0 * np.pi * turns[:, None] * np.array([0.0, 0.0, 1.0]))
    # Nutation at that epoch is below 20 arc seconds.
    assert (found * expected.inv()).magnitude().max() < np.deg2rad(20.0 / 3600.0)
    assert (found * expected.inv()).magnitude().max() > np.deg2rad(1.0 / 3600.0)


def test_the_pole_of_the_model_is_off_that_of_the_earth_by_a_quarter_of_a_century_of_precession() -> None:
    found = Rotation.from_quat(
        czml_document.earth_fixed_attitudes(states_at(instant("2026-03-20T14:46:00"), np.zeros(1)))
    )
    pole = found.apply([0.0, 0.0, 1.0])[0]
    # 20.04 arc seconds a year (Lieske 1977), nutation up to 10.
    assert np.rad2deg(np.arccos(pole[2])) * 3600.0 == pytest.approx(20.04 * 26.215, abs=10.0)


def test_a_document_shows_sizes_keep_out_zone_and_line_of_sight(packets: dict[str, Any]) -> None:
    assert set(packets) == {"document", "servicer", "servicer to target", "target"}
    line = packets["servicer to target"].polyline.positions.references.values
    assert line == ["servicer#position", "target#position"]
    assert packets["target"].ellipsoid.radii.cartesian.values == [10.0] * 3
    assert packets["document"].clock.interval.to_dict() == "2026-03-20T14:46:00.000000Z/2026-03-20T14:48:59.000000Z"
    assert f"run {RUN} of seed 5" in packets["document"].description


def test_each_servicer_of_a_team_has_a_packet_and_a_line() -> None:
    epoch, time = instant("2026-01-01"), np.arange(3.0)
    target = states_at(epoch, time)
    team = [SpacecraftStates(name, epoch, time, *3 * (np.zeros((3, 3)),), about=()) for name in ("north", "south")]
    team = [SpacecraftStates(**{**vars(each), "q": target.q}) for each in team]
    content = json.loads(czml_document.czml([*team, target], SpacecraftShapes((np.ones(3),) * 3, 10.0)))
    assert [each["id"] for each in content[1:]] == ["north", "north to target", "south", "south to target", "target"]


def test_a_scene_needs_a_run_and_does_not_replace_a_file(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RpojaxError, match="run_id: found none, expected the run whose CZML is wanted"):
        export(campaign, tmp_path / "run.czml", progress=False)
    (tmp_path / "run.czml").write_text("mine")
    words = [
        "export",
        str(campaign.directory),
        "--format",
        "czml",
        "--run-id",
        "3",
        "--out",
        str(tmp_path / "run.czml"),
    ]
    assert main.main(words) == 2
    assert "run.czml: exists already" in capsys.readouterr().err
