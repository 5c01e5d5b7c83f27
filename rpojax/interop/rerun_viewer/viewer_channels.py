"""Channels of a run for the viewer: those of a stored history, the Hill frame and the full relative covariance."""

import numpy as np
from jaxtyping import Array

from rpojax.core.frames import hill_frame
from rpojax.flight.stages import Stages
from rpojax.scenario.params import Params
from rpojax.scenario.static_settings import Scenario
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.telemetry import Telemetry

ViewerChannels = dict[str, np.ndarray]
"""Values of all ticks by name, ticks first."""


def observe_tick(_: Stages, scenario: Scenario, params: Params, record: Telemetry) -> dict[str, Array]:
    """Channels of one tick, `R_HN` (3, 3) and `relative_covariance_H` (3, 3) [m^2] of the relative position."""
    R_HN = hill_frame(record.truth.r_TN_N, record.truth.v_TN_N)[0]
    P_N = record.flight.orbit.relative.position_covariance
    own = {"R_HN": R_HN, "relative_covariance_H": R_HN @ P_N @ R_HN.T}
    return {**compute_channels(scenario, params, record), **own}
