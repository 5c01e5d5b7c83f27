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


def test_the_cone_of_directions_touches_the_ellipsoid_and_is_all_round_for_a_target_that_may_be_here(
    flight: FlightParams,
) -> None:
    cone = jax.jit(line_of_sight_uncertainty.uncertainty_cone)
    known = rendezvous_scene.estimate(flight)
    line = unit(rendezvous_scene.TARGET_AHEAD)

    def angle(along: float, across: float) -> float:
        """Half-angle by sigmas of the position [m] along the line of sight and in each direction across it."""
        P = across**2 * np.eye(3) + (along**2 - across**2) * np.outer(line, line)
        covariance = known.relative.covariance.at[:3, :3].set(jnp.asarray(P))
        return float(cone(replace(known, relative=replace(known.relative, covariance=covariance)), np.float64(3.0)))

    # Tangent from a point at 30 m to an ellipse with half-axes of 18 m along and 1.5 m across.
    np.testing.assert_allclose(angle(6.0, 0.5), np.sqrt(2.0) * 1.5 / np.sqrt(30.0**2 - 18.0**2), rtol=1e-9)
    np.testing.assert_allclose(angle(0.05, 0.05), np.sqrt(2.0) * 0.15 / 30.0, rtol=1e-4)
    assert angle(10.1, 2.0) == np.pi
