"""Surface of the servicer for drag and solar radiation pressure."""

import pytest

from rpojax.physics.environment.spacecraft_surface import Surface
from rpojax.scenario.params import Params


@pytest.fixture(scope="module")
def surface(params: Params) -> Surface:
    """0.25 m^2, drag coefficient 2.2, pressure coefficient 1.3."""
    return params.plant.servicer_surface
