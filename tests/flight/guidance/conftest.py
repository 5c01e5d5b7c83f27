"""Estimate of a servicer behind its target."""

import pytest
import rendezvous_scene

from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate


@pytest.fixture(scope="session")
def known(flight: FlightParams) -> OrbitEstimate:
    """Estimate with the target 30 m ahead."""
    return rendezvous_scene.estimate(flight)
