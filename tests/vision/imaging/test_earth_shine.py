"""Earth-shine against an integration over random directions."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.vision.imaging.earth_shine import ALBEDO, earth_shine


def by_random_directions(radius: float, sun: np.ndarray, count: int = 400_000) -> float:
    """Mean of the ground's light over directions with the density of their cosine from nadir."""
    rng = np.random.default_rng(3)
    sine, azimuth = np.sqrt(rng.random(count)), 2.0 * np.pi * rng.random(count)
    down = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), -np.sqrt(1.0 - sine**2)], axis=1)
    place = np.array([0.0, 0.0, radius])
    along = down @ place
    square = along**2 - radius**2 + 1.0
    distance = -along - np.sqrt(np.maximum(square, 0.0))
    ground = place + distance[:, None] * down
    return float(ALBEDO * np.mean(np.where(square > 0.0, np.maximum(ground @ sun, 0.0), 0.0)))


@pytest.mark.parametrize("angle_deg", [0.0, 50.0, 80.0, 95.0, 105.0])
@pytest.mark.parametrize("radius", [1.06, 1.08, 1.2])
def test_irradiance_is_that_of_random_directions(radius: float, angle_deg: float) -> None:
    angle = np.radians(angle_deg)
    sun = np.array([np.sin(angle), 0.0, np.cos(angle)])
    found = earth_shine(jnp.array([0.0, 0.0, radius]), jnp.asarray(sun))
    assert float(found) == pytest.approx(by_random_directions(radius, sun), abs=0.004)


def test_earth_that_hides_the_sun_is_dark() -> None:
    angle = np.radians(120.0)
    sun = jnp.array([np.sin(angle), 0.0, np.cos(angle)])
    assert float(earth_shine(jnp.array([0.0, 0.0, 1.08]), sun)) < 1e-3
