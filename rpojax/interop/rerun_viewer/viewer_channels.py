"""What the viewer shows of one tick: the channels of a history, with the Hill frame and the whole covariance in it."""

import numpy as np
from jaxtyping import Array

from rpojax.core.frames import hill_frame
from rpojax.flight.computer import Stages
from rpojax.interop.ros2.frame_names import rotate_covariance
from rpojax.scenario.params import Params
from rpojax.scenario.scenario_file import Scenario
from rpojax.simulation import telemetry
from rpojax.simulation.closed_loop import Telemetry

ViewerChannels = dict[str, np.ndarray]
"""Values of all ticks by name, ticks first."""


def observe_tick(_: Stages, scenario: Scenario, params: Params, telemetry_record: Telemetry) -> dict[str, Array]:
    """Channels of one tick, `R_HN` (3, 3) and `relative_covariance_H` (3, 3) [m^2] of the relative position."""
    R_HN = hill_frame(telemetry_record.truth.r_TN_N, telemetry_record.truth.v_TN_N)[0]
    P_N = telemetry_record.flight.orbit.relative.covariance[:3, :3]
    own = {"R_HN": R_HN, "relative_covariance_H": rotate_covariance(R_HN, P_N)}
    return {**telemetry.compute_channels(scenario, params, telemetry_record), **own}
