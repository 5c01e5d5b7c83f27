"""Control authority: burns as burn planning allows them, and the least burns of a transfer."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.flight.guidance import burn_schedule
from rpojax.flight.guidance.pointing_tuning import GuidanceSoftware
from rpojax.scenario import params
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.warnings import control_authority, nominal_motion
from rpojax.scenario.warnings.dispersed_reach import DispersedReach

SIGHT = np.array([0.0, 1.0, 0.0])


@pytest.mark.parametrize(("angle", "turn_s"), [(0.0, 6.0), (0.5 * np.pi, 24.836), (np.pi, 35.124)])
def test_the_longest_burn_leaves_time_for_both_turns(angle: float, turn_s: float) -> None:
    # sqrt(2 pi angle / 16 mrad/s2), at least 6 s; 5 s to settle and 3 s of margin of 110 s; 30 mN on 30 kg.
    file = scenario_loader.load("inspection", ["dispersions=[]"])
    push = np.array([np.sin(angle), np.cos(angle), 0.0])
    found = control_authority.largest_delta_v_m_s(file, DispersedReach(file), SIGHT, push)
    assert float(found) == pytest.approx(1e-3 * (110.0 - 2.0 * turn_s - 8.0), rel=1e-3)


@pytest.mark.parametrize("camera_hz", [0.2, 1.0])
def test_the_longest_burn_is_that_of_burn_planning(camera_hz: float) -> None:
    file = scenario_loader.load("inspection", ["dispersions=[]", f"rates.camera_hz={camera_hz}"])
    flight = params.build_params(file.model_dump(), file.camera.width_px, file.camera.height_px).flight
    guidance = GuidanceSoftware(
        pointing=flight.pointing, formation=flight.formation, vehicle=flight.vehicle, tick_s=1.0 / camera_hz
    )
    q_look = jnp.array([1.0, 0.0, 0.0, 0.0])
    for push in np.eye(3):
        # Body axes along N: the camera looks along the body's x axis.
        planned = burn_schedule.largest_delta_v(guidance, jnp.asarray(push), q_look)
        found = control_authority.largest_delta_v_m_s(file, DispersedReach(file), np.eye(3)[0], push)
        assert float(found) == pytest.approx(float(planned), rel=1e-9)


def test_a_thruster_across_the_boresight_has_to_turn_by_it() -> None:
    across = scenario_loader.load("inspection", ["dispersions=[]", "thruster.direction=[0.0, 0.0, 1.0]"])
    found = control_authority.largest_delta_v_m_s(across, DispersedReach(across), SIGHT, SIGHT)
    assert float(found) == pytest.approx(1e-3 * (110.0 - 2.0 * 24.836 - 8.0), rel=1e-3)


def test_a_straight_transfer_takes_its_mean_velocity_at_both_ends() -> None:
    file = scenario_loader.load("inspection", ["dispersions=[]"])
    motion = nominal_motion.transition_matrices(1e-9, np.array([2000.0, 0.0]))[:, :, 3:]
    change = np.array([0.0, 20.0, 0.0, 0.0, 0.0, 0.0])
    sight = np.broadcast_to(SIGHT, (2, 3))
    needed, _ = control_authority._smallest_burns(file, DispersedReach(file), motion, change, sight)
    np.testing.assert_allclose(needed, 0.01, rtol=1e-6)


def test_many_burns_share_a_change_of_velocity_as_the_thruster_can_give_it() -> None:
    file = scenario_loader.load("inspection", ["dispersions=[]"])
    motion = np.tile(np.concatenate([np.zeros((3, 3)), np.eye(3)]), (4, 1, 1))
    change = np.array([0.0, 0.0, 0.0, 0.04, 0.0, 0.0])
    sight = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    needed, available = control_authority._smallest_burns(file, DispersedReach(file), motion, change, sight)
    # Equal shares of 90 mm/s along the boresight and 31.75 mm/s against it.
    np.testing.assert_allclose(needed / available, 0.04 / available.sum(), rtol=1e-3)
