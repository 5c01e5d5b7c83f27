"""What the viewer shows of a run that was flown again."""

import numpy as np
import pytest

from rpojax.campaign import single_run
from rpojax.interop.rerun_viewer.viewer_channels import ViewerChannels
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun


def test_frame_covariance_and_poses_belong_to_the_channels(shown: ReplayedRun[ViewerChannels]) -> None:
    values = shown.values
    rho_H = np.einsum("tij,tj->ti", values["R_HN"], shown.poses["r_ST_N"])
    np.testing.assert_allclose(rho_H, values["rho_H"], atol=1e-4)
    sigma = np.sqrt(np.einsum("tii->ti", values["relative_covariance_H"]))
    np.testing.assert_allclose(sigma, values["relative_sigma_H"], rtol=1e-5)
    assert np.abs(values["relative_covariance_H"][:, 0, 1]).max() > 1e-6


def test_the_viewer_shows_what_messages_say(
    shown: ReplayedRun[ViewerChannels], flight: ReplayedRun[RosTickValues]
) -> None:
    values, said = shown.values, flight.values
    np.testing.assert_allclose(values["rho_H"], said.relative.position, atol=1e-4)
    np.testing.assert_array_equal(values["mode"], said.guidance_mode)
    np.testing.assert_array_equal(values["box_accepted"], said.box_accepted)
    covariance = np.asarray(said.relative_estimate.pose_covariance)[:, :3, :3]
    np.testing.assert_allclose(values["relative_covariance_H"], covariance, rtol=1e-3, atol=1e-6)


@pytest.mark.slow
def test_a_run_flown_again_has_the_channels_of_a_run_alone(shown: ReplayedRun[ViewerChannels]) -> None:
    alone = single_run.simulate(shown.file, shown.seed, shown.run_id, population=shown.population)
    assert set(shown.values) - {"R_HN", "relative_covariance_H"} == set(alone) - {"time_s", "rho_desired_H"}
    np.testing.assert_array_equal(shown.time_s, alone["time_s"])
    for name in ("rho_H", "relative_error_H", "box_px", "mode", "delta_v_m_s"):
        np.testing.assert_allclose(shown.values[name], alone[name], rtol=1e-4, atol=1e-4)
    assert float(shown.params.plant.servicer.mass) == pytest.approx(alone["mass_kg"][0], rel=1e-6)
