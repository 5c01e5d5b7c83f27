"""Channels of the viewer agree with the run and with its messages."""

import numpy as np
import pytest

from rpojax.campaign import single_run
from rpojax.interop.rerun_viewer.rrd_chunks import ViewerChannels
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun


def test_hill_frame_covariance_and_poses_agree_with_the_channels(viewer_run: ReplayedRun[ViewerChannels]) -> None:
    values = viewer_run.values
    rho_H = np.einsum("tij,tj->ti", values["R_HN"], viewer_run.poses["r_ST_N"])
    np.testing.assert_allclose(rho_H, values["rho_H"], atol=1e-4)
    sigma = np.sqrt(np.einsum("tii->ti", values["relative_covariance_H"]))
    np.testing.assert_allclose(sigma, values["relative_sigma_H"], rtol=1e-5)
    assert np.abs(values["relative_covariance_H"][:, 0, 1]).max() > 1e-6


def test_channels_agree_with_message_values(
    viewer_run: ReplayedRun[ViewerChannels], ros_run: ReplayedRun[RosTickValues]
) -> None:
    values, message_values = viewer_run.values, ros_run.values
    np.testing.assert_allclose(values["rho_H"], message_values.relative.position, atol=1e-4)
    np.testing.assert_array_equal(values["mode"], message_values.guidance_mode)
    np.testing.assert_array_equal(values["box_accepted"], message_values.box_accepted)
    covariance = np.asarray(message_values.relative_estimate.pose_covariance)[:, :3, :3]
    np.testing.assert_allclose(values["relative_covariance_H"], covariance, rtol=1e-3, atol=1e-6)


@pytest.mark.slow
def test_a_replay_has_the_channels_of_a_single_run(viewer_run: ReplayedRun[ViewerChannels]) -> None:
    alone = single_run.simulate(viewer_run.file, viewer_run.seed, viewer_run.run_id, run_range=viewer_run.run_range)
    assert set(viewer_run.values) - {"R_HN", "relative_covariance_H"} == set(alone) - {"time_s", "rho_desired_H"}
    np.testing.assert_array_equal(viewer_run.time_s, alone["time_s"])
    for name in ("rho_H", "relative_error_H", "box_px", "mode", "delta_v_m_s"):
        np.testing.assert_allclose(viewer_run.values[name], alone[name], rtol=1e-4, atol=1e-4)
    assert float(viewer_run.params.plant.servicer.mass) == pytest.approx(alone["mass_kg"][0], rel=1e-6)
