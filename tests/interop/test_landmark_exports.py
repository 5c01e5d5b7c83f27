"""Estimated attitude of the target in exported files, against the channels of the same run with landmarks."""

import dataclasses
import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun.chunk as rrc
from ccsds_ndm.ndm_io import NdmIo
from empty_campaign_folders import empty_campaign
from mcap_ros2.reader import read_ros2_messages
from scipy.spatial.transform import Rotation

from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.interop import ccsds_messages, run_replay, spacecraft_states
from rpojax.interop.export import export
from rpojax.interop.rerun_viewer import rrd_chunks, rrd_recording
from rpojax.interop.ros2 import message_values, run_bag
from rpojax.interop.ros2.mcap_or_sqlite3_writer import BagFormat
from rpojax.interop.ros2.run_bag import ImageStorage
from rpojax.interop.run_replay import ReplayedRun
from rpojax.scenario.loading import scenario_loader

pytestmark = pytest.mark.slow
RUN = 2


def rotations(q: Any) -> Rotation:
    """Rotations of the axes of N to those of a body, of scalar-first `q_BN` (n, 4)."""
    return Rotation.from_quat(np.roll(np.asarray(q, dtype=float), -1, axis=1)).inv()


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """A campaign of ten minutes in which no block is done."""
    file = scenario_loader.load("pose_inspection", ["duration_s=600", "limits.arrive_by_s=600"])
    return empty_campaign(tmp_path_factory.mktemp("landmarks") / "runs", file, 5, 4, 0, 1)


@pytest.fixture(scope="module")
def observed(campaign: Campaign) -> ReplayedRun[Any]:
    """Run with the values of messages, of the viewer, and of both spacecraft."""

    def observe(*tick: Any) -> tuple[Any, Any, Any]:
        return tuple(each.observe_tick(*tick) for each in (message_values, rrd_chunks, spacecraft_states))

    return run_replay.replay_servicers(campaign, RUN, observe)[0]


def part(run: ReplayedRun[Any], number: int) -> ReplayedRun[Any]:
    """The run with one kind of its values."""
    return dataclasses.replace(run, values=run.values[number])


def known_ticks(run: ReplayedRun[Any]) -> np.ndarray:
    found = np.isfinite(run.values[1]["q_TN_estimate"]).all(axis=1)
    assert 0 < found.sum() < run.ticks, "it is found on the way"
    return found


def test_the_aem_of_the_estimate_is_that_of_the_channel(
    campaign: Campaign, observed: ReplayedRun[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_replay, "replay_servicers", lambda *_, **__: (part(observed, 2),))
    paths = export(campaign, tmp_path / "run.aem", run_id=RUN, progress=False)
    assert [path.name for path in paths] == ["run_servicer.aem", "run_target.aem", "run_target_estimate.aem"]
    segments = NdmIo().from_path(paths[-1]).body.segment
    assert {each.metadata.object_name for each in segments} == {"TARGET"}
    rows = [row.quaternion_state.quaternion for each in segments for row in each.data.attitude_state]
    read = Rotation.from_quat([[float(row.q1), float(row.q2), float(row.q3), float(row.qc)] for row in rows])
    known = known_ticks(observed)
    assert len(rows) == known.sum()
    assert np.max((read * rotations(observed.values[2].q_TN_estimate[known]).inv()).magnitude()) < 1e-9
    # Channels are in single precision.
    assert np.max((read * rotations(observed.values[1]["q_TN_estimate"][known]).inv()).magnitude()) < 1e-6
    off = (read * rotations(observed.poses["q_TN"][known]).inv()).magnitude()
    assert 1e-5 < np.median(off) < np.radians(5.0), "it is an estimate, and a good one"


def test_a_gap_of_the_estimate_parts_the_aem(observed: ReplayedRun[Any], campaign: Campaign, tmp_path: Path) -> None:
    states = part(observed, 2)
    q = np.array(states.values.q_TN_estimate)
    known = np.flatnonzero(np.isfinite(q).all(axis=1))
    lost = known[20:25]
    q[lost] = np.nan
    gap = dataclasses.replace(states, values=dataclasses.replace(states.values, q_TN_estimate=q))
    (estimate,) = spacecraft_states.estimated_attitudes((gap,), campaign)
    text = ccsds_messages.aem(estimate, datetime.datetime(2026, 1, 1))
    assert text.count("META_START") == text.count("DATA_STOP") == 1 + _stretches(known, lost)
    assert text.count("\n2026-") == len(known) - len(lost)


def _stretches(known: np.ndarray, lost: np.ndarray) -> int:
    """Gaps in the ticks that are left."""
    return int(np.sum(np.diff(np.setdiff1d(known, lost)) > 1))


def test_the_bag_has_the_pose_of_the_channels(observed: ReplayedRun[Any], tmp_path: Path) -> None:
    run_bag.write_run(part(observed, 0), tmp_path / "bag", BagFormat.MCAP, ImageStorage.NONE, force=False)
    (path,) = (tmp_path / "bag").glob("*.mcap")
    found = [each.ros_msg for each in read_ros2_messages(path, topics=["/target/estimate/pose"])]
    channels, known = observed.values[1], known_ticks(observed)
    assert [each.header.stamp.sec for each in found] == np.flatnonzero(known).tolist()
    place = np.array(
        [[each.pose.pose.position.x, each.pose.pose.position.y, each.pose.pose.position.z] for each in found]
    )
    turns = [each.pose.pose.orientation for each in found]
    R_KT = Rotation.from_quat([[each.x, each.y, each.z, each.w] for each in turns])
    # The servicer from the target's centre of mass in T; the channel counts from the origin of the mesh.
    offset = R_KT.inv().apply(-place) - channels["rho_estimate_T"][known]
    assert np.abs(offset).max() < 0.2
    np.testing.assert_allclose(
        np.linalg.norm(place, axis=1), np.linalg.norm(channels["rho_estimate_H"][known], axis=1), atol=5e-6
    )
    covariance = np.array([each.pose.covariance for each in found]).reshape(-1, 6, 6)
    sigma = np.degrees(np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2)))
    expected = np.linalg.norm(channels["target_attitude_sigma_T_deg"][known], axis=1)
    np.testing.assert_allclose(sigma, expected, rtol=1e-5)


def test_the_recording_has_axes_where_the_attitude_is_known(observed: ReplayedRun[Any], tmp_path: Path) -> None:
    path = rrd_recording.write_recording(part(observed, 1), tmp_path / "run.rrd").path
    batch = next(
        chunk.to_record_batch()
        for chunk in rrc.RrdReader(path).stream().to_chunks()
        if chunk.entity_path == "/hill/target_estimate"
    )
    known, R_HN = known_ticks(observed), observed.values[1]["R_HN"]
    lengths = np.array([row[0] for row in batch.column("TransformAxes3D:axis_length").to_pylist()])
    np.testing.assert_array_equal(lengths > 0.0, known)
    read = Rotation.from_quat([row[0] for row in batch.column("Transform3D:quaternion").to_pylist()])
    expected = Rotation.from_matrix(R_HN) * rotations(
        np.where(known[:, None], observed.values[1]["q_TN_estimate"], 1.0)
    )
    assert np.max((read * expected.inv()).magnitude()[known]) < 1e-6
