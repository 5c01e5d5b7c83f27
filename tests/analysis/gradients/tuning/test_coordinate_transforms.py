"""Coordinate transforms and their inverses."""

import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rpojax.analysis.gradients.tuning.tunable_parameters import Coordinate, LogCoordinate, LogitCoordinate


@given(st.floats(1e-6, 1e6), st.sampled_from([LogCoordinate(), LogitCoordinate(-1e-9, 2e6)]))
def test_a_coordinate_maps_back_to_its_value(value: float, coordinate: Coordinate) -> None:
    x = coordinate.to_coordinate(np.asarray([value]))
    np.testing.assert_allclose(coordinate.from_coordinate(jnp.asarray(x)), [value], rtol=1e-9)


@given(st.floats(-30.0, 30.0))
def test_every_coordinate_is_an_allowed_value(x: float) -> None:
    assert float(LogCoordinate().from_coordinate(jnp.asarray(x))) > 0.0
    assert 0.2 < float(LogitCoordinate(0.2, 3.0).from_coordinate(jnp.asarray(0.5 * x))) < 3.0
