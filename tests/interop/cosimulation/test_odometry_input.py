"""Orbit estimates from odometry messages invert the messages of the flight software."""

import numpy as np
import pytest

from rpojax.core.frames import hill_frame
from rpojax.interop.cosimulation.command_input import orbit_estimate_from_odometry
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import tick_messages
from rpojax.interop.ros2.odometry import hill_covariance
from rpojax.interop.run_replay import ReplayedRun


@pytest.mark.parametrize("tick", [0, 120])
def test_messages_of_the_flight_software_give_back_its_estimate(ros_run: ReplayedRun, tick: int) -> None:
    values = ros_run.tick(tick)
    messages = {topic.name: build() for topic, build in tick_messages(values)}
    odometries = [messages[topic.name] for topic in (topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE)]
    found = orbit_estimate_from_odometry(*odometries)
    target = values.target_estimate
    r_TN_N, v_TN_N = found.r_SN_N + found.r_TS_N, found.v_SN_N + found.v_TS_N
    np.testing.assert_array_equal(found.r_SN_N, values.servicer_estimate.position)
    np.testing.assert_allclose(r_TN_N, target.position, rtol=0.0, atol=1e-8)
    R_HN, omega_HN_N = hill_frame(r_TN_N, v_TN_N)
    np.testing.assert_allclose(R_HN @ v_TN_N, target.velocity, rtol=0.0, atol=1e-10)
    P_H = np.asarray(hill_covariance(R_HN, omega_HN_N, found.relative_covariance))
    np.testing.assert_allclose(P_H[:3, :3], values.relative_estimate.pose_covariance[:3, :3], rtol=1e-9, atol=1e-12)
    # The velocity covariance is along the body axes; its trace is the same along any axes.
    trace = np.trace(values.relative_estimate.twist_covariance[:3, :3])
    np.testing.assert_allclose(np.trace(P_H[3:, 3:]), trace, rtol=1e-9)
    np.testing.assert_allclose(P_H[:3, 3:], 0.0, atol=1e-12)
