"""Flight software of the test scenario, and a camera that points at its target."""

import numpy as np
import pytest
import rendezvous_scene

from rpojax.flight.flight_records import FlightParams
from rpojax.scenario.params import Params


@pytest.fixture(scope="session")
def flight(params: Params) -> FlightParams:
    """Flight parameters of the test scenario."""
    return params.flight


@pytest.fixture(scope="session")
def q_KN(flight: FlightParams) -> np.ndarray:
    """Attitude of a camera that points at the target of the scene."""
    return rendezvous_scene.camera_attitude(flight, rendezvous_scene.estimate(flight))
