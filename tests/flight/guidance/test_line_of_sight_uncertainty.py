"""Uncertainty of range and bearing."""

import jax
import jax.numpy as jnp
import numpy as np
import rendezvous_scene
from numpy_reference import (
    unit,
)

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import (
    line_of_sight_uncertainty,
)

range_uncertainty = jax.jit(line_of_sight_uncertainty.relative_range_sigma)
bearing_uncertainty = jax.jit(line_of_sight_uncertainty.bearing_sigma)


def test_range_and_bearing_sigma_are_those_along_and_across_the_line_of_sight(flight: FlightParams) -> None:
    known = rendezvous_scene.estimate(flight)
    line = unit(rendezvous_scene.TARGET_AHEAD)
    P = 0.01 * np.eye(3) + 8.99 * np.outer(line, line)
    covariance = known.relative.covariance.at[:3, :3].set(jnp.asarray(P))
    long = replace(known, relative=replace(known.relative, covariance=covariance))
    np.testing.assert_allclose(range_uncertainty(long), 3.0 / 30.0, rtol=1e-12)
    np.testing.assert_allclose(bearing_uncertainty(long), np.sqrt(2) * 0.1 / 30.0, rtol=1e-9)
