"""OEM, AEM and OPM of a run, read back by `ccsds-ndm` and `oem`, and the meaning of their frames and quaternions."""

import datetime
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ccsds_ndm.ndm_io import NdmIo
from oem import OrbitEphemerisMessage
from scipy.spatial.transform import Rotation

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.cli import main
from rpojax.errors import RpojaxError
from rpojax.interop import ccsds_messages, run_replay
from rpojax.interop.export import export
from rpojax.interop.run_replay import ReplayedRun
from rpojax.interop.spacecraft_states import BothStates, SpacecraftStates
from rpojax.scenario.loading.starts import start_files
from rpojax.time_scales import instant

RUN = 3
MILLIMETRE = 1e-3
CREATED = datetime.datetime(2026, 1, 1)


@pytest.fixture
def written(
    campaign: Campaign, states_run: ReplayedRun[BothStates], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> dict[str, Path]:
    """Messages of both spacecraft of the replayed run, by `KIND_SPACECRAFT`."""
    monkeypatch.setattr(run_replay, "replay_servicers", lambda *_, **__: (states_run,))
    found = {}
    for kind in ("oem", "aem", "opm"):
        for path in export(campaign, tmp_path / f"run.{kind}", run_id=RUN, progress=False):
            found[f"{kind}_{path.stem.partition('_')[2]}"] = path
    return found


def expected_states(run: ReplayedRun[BothStates], spacecraft: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and attitude of a spacecraft."""
    values = run.values
    if spacecraft == "target":
        return values.r_TN_N, values.v_TN_N, values.q_TN
    return values.r_TN_N + values.r_ST_N, values.v_TN_N + values.v_ST_N, values.q_BN


def only_segment(path: Path) -> Any:
    """The segment of a message, read by `ccsds-ndm`."""
    body = NdmIo().from_path(path).body
    segment = body.segment
    return segment[0] if isinstance(segment, list) else segment


@pytest.mark.parametrize("spacecraft", ["servicer", "target"])
def test_an_oem_has_the_orbit_to_less_than_a_millimetre(
    spacecraft: str, written: dict[str, Path], states_run: ReplayedRun[BothStates]
) -> None:
    position, velocity, _ = expected_states(states_run, spacecraft)
    states = OrbitEphemerisMessage.open(written[f"oem_{spacecraft}"]).states
    assert len(states) == states_run.ticks
    np.testing.assert_allclose(1e3 * np.array([each.position for each in states]), position, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(1e3 * np.array([each.velocity for each in states]), velocity, rtol=0.0, atol=1e-8)
    assert {each.frame for each in states} == {"EME2000"}
    elapsed = [(each.epoch.datetime - datetime.datetime(2026, 3, 20, 14, 46)).total_seconds() for each in states]
    np.testing.assert_allclose(elapsed, states_run.time_s, rtol=0.0, atol=1e-6)
    rows = only_segment(written[f"oem_{spacecraft}"]).data.state_vector
    read = 1e3 * np.array([[float(row.x.value), float(row.y.value), float(row.z.value)] for row in rows])
    np.testing.assert_allclose(read, position, rtol=0.0, atol=1e-6)


def test_the_servicer_is_where_it_was_from_the_target(
    written: dict[str, Path], states_run: ReplayedRun[BothStates]
) -> None:
    each = [
        1e3 * np.array([state.position for state in OrbitEphemerisMessage.open(written[f"oem_{name}"]).states])
        for name in ("servicer", "target")
    ]
    np.testing.assert_allclose(np.linalg.norm(each[0] - each[1], axis=1), states_run.poses["range_m"], atol=MILLIMETRE)


@pytest.mark.parametrize("spacecraft", ["servicer", "target"])
def test_an_aem_has_the_attitude_to_a_nanoradian(
    spacecraft: str, written: dict[str, Path], states_run: ReplayedRun[BothStates]
) -> None:
    _, _, q = expected_states(states_run, spacecraft)
    segment = only_segment(written[f"aem_{spacecraft}"])
    assert (segment.metadata.ref_frame_a, segment.metadata.ref_frame_b) == ("EME2000", "SC_BODY_1")
    rows = [row.quaternion_state.quaternion for row in segment.data.attitude_state]
    read = Rotation.from_quat([[float(row.q1), float(row.q2), float(row.q3), float(row.qc)] for row in rows])
    # SciPy's rotation turns vectors; from frame to frame it is the inverse. R(q_BN) takes N components to B components.
    taken = read.inv()
    of_package = Rotation.from_quat(np.concatenate([q[:, 1:], q[:, :1]], axis=1))
    assert np.max((taken * of_package.inv()).magnitude()) < 1e-9
    signs = read.as_quat()
    assert np.all(np.sum(signs[1:] * signs[:-1], axis=1) > 0.0)


def test_a_body_turned_by_a_right_angle_about_z_has_the_quaternion_of_that_rotation() -> None:
    # The example of docs/reference/conventions.md: the body's x axis lies along N's y axis.
    half = np.sqrt(0.5)
    found = ccsds_messages.ccsds_quaternions(np.array([[half, 0.0, 0.0, -half]]))
    np.testing.assert_allclose(found, [[0.0, 0.0, half, half]], atol=1e-15)


@pytest.mark.parametrize("spacecraft", ["servicer", "target"])
def test_an_opm_has_the_state_at_the_start(
    spacecraft: str, written: dict[str, Path], states_run: ReplayedRun[BothStates]
) -> None:
    position, velocity, _ = expected_states(states_run, spacecraft)
    vector = only_segment(written[f"opm_{spacecraft}"]).data.state_vector
    assert vector.epoch == "2026-03-20T14:46:00.000000"
    read = [float(each.value) for each in (vector.x, vector.y, vector.z, vector.x_dot, vector.y_dot, vector.z_dot)]
    np.testing.assert_allclose(1e3 * np.array(read[:3]), position[0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(1e3 * np.array(read[3:]), velocity[0], rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("kind", ["oem", "opm"])
def test_messages_that_were_written_are_a_start(
    kind: str, written: dict[str, Path], states_run: ReplayedRun[BothStates]
) -> None:
    start: dict[str, Any] = {each: str(written[f"{kind}_{each}"]) for each in ("target", "servicer")}
    tables: dict[str, Any] = {"start": start}
    start_files.resolve_start(tables)
    assert tables["epoch_utc"] == "2026-03-20T14:46:00"
    for each in ("target", "servicer"):
        position, velocity, _ = expected_states(states_run, each)
        assert (start[f"{each}_format"], start[f"{each}_object"]) == (kind.upper(), each.upper())
        np.testing.assert_allclose(start[f"{each}_position_m"], position[0], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(start[f"{each}_velocity_m_s"], velocity[0], rtol=0.0, atol=1e-9)
    # Positions of both are rounded to 1e-6 m.
    relative = np.linalg.norm(tables["initial"]["relative_position_m"])
    assert relative == pytest.approx(np.linalg.norm(states_run.values.r_ST_N[0]), abs=2e-6)


@pytest.mark.parametrize("rate_hz", [1.0, 3.0, 5.0, 7.0, 30.0, 64.0])
@pytest.mark.parametrize("epoch", ["2026-03-20T14:46:00", "2016-12-31T23:58:00.000192"])
def test_a_sample_is_where_the_spacecraft_is_at_its_label_at_any_rate(
    tmp_path: Path, rate_hz: float, epoch: str
) -> None:
    time_s = np.arange(400) / rate_hz
    speed = 7600.0
    line = np.array([1.0, 2.0, 2.0]) / 3.0
    position, velocity = 7e6 + speed * time_s[:, None] * line, np.tile(speed * line, (400, 1))
    q = np.tile([1.0, 0.0, 0.0, 0.0], (400, 1))
    states = SpacecraftStates("target", instant(epoch), time_s, position, velocity, q, about=())
    text = ccsds_messages.oem(states, CREATED)
    rows = [line.split() for line in text.splitlines() if line[:2] == "20"]
    for number, (label, *cells) in enumerate(rows):
        at = Fraction(instant(label).tai_ps - instant(epoch).tai_ps, 10**12)
        expected = 7e6 + speed * float(at) * line
        np.testing.assert_allclose(1e3 * np.array(list(map(float, cells[:3]))), expected, rtol=0.0, atol=1e-6)
        assert abs(at - Fraction(number) / Fraction(rate_hz)) < Fraction(1, 10**10)
    assert {len(label) for label, *_ in rows} == {26 if rate_hz in (1.0, 5.0, 64.0) else 32}
    (tmp_path / "target.oem").write_text(text)
    read = OrbitEphemerisMessage.open(tmp_path / "target.oem").states
    seconds = [(each.epoch - read[0].epoch).sec for each in read]
    np.testing.assert_allclose(seconds, time_s, rtol=0.0, atol=1e-9)


def test_a_message_says_what_its_frame_neglects(written: dict[str, Path]) -> None:
    for path in written.values():
        comments = " ".join(NdmIo().from_path(path).header.comment)
        assert "precession, nutation and polar motion are not modelled" in comments
        assert f"run {RUN} of seed 5" in comments


def test_an_epoch_in_another_zone_is_converted_and_rounded_to_microseconds() -> None:
    epoch = instant("2026-03-20T16:46:00+02:00")
    states = SpacecraftStates("target", epoch, np.array([0.0, 0.2, 86400.0]), *3 * (np.zeros((3, 3)),), about=())
    assert states.epochs == [
        "2026-03-20T14:46:00.000000",
        "2026-03-20T14:46:00.200000",
        "2026-03-21T14:46:00.000000",
    ]


def test_messages_need_a_run_and_do_not_replace_files(campaign: Campaign, tmp_path: Path) -> None:
    with pytest.raises(RpojaxError, match="run_id: found none, expected the run whose OEM is wanted"):
        export(campaign, tmp_path / "run.oem", progress=False)
    with pytest.raises(RpojaxError, match="run_id: found 9, expected a run of this campaign, 0 to 3"):
        export(campaign, tmp_path / "run.opm", run_id=9, progress=False)
    (tmp_path / "run_target.oem").write_text("mine")
    with pytest.raises(RpojaxError, match=r"run_target.oem: exists already"):
        export(campaign, tmp_path / "run.oem", run_id=RUN, progress=False)


def test_the_command_writes_both_spacecraft(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", str(campaign.directory), "--format", "opm", "--run-id", "3", "--out", str(tmp_path / "a.opm")]
    assert main.main(words) == 0
    assert [Path(line).name for line in capsys.readouterr().out.splitlines()] == ["a_servicer.opm", "a_target.opm"]
