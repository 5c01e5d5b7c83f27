"""What a frame tells of the size by having a box or none, against numerical integration of Bayes' rule."""

import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.box_measurement import detection_model

GRID = np.linspace(-6.0, 8.0, 20_001)
OFFSET, SPREAD = 0.3, 0.2
SLOPE = detection_model._LOGISTIC_SLOPE
MISSES = 0.1


def information(flight: FlightParams, mean: float, variance: float, present: bool, looked_for: bool) -> tuple:
    """Precision and residual for a threshold of 4 px; `mean` is the log of the size over it."""
    tuning = replace(
        flight.navigation,
        minimum_size=jnp.float64(4.0),
        miss_probability=jnp.float64(MISSES),
        largest_side_log=jnp.array([OFFSET, SPREAD]),
    )
    found = detection_model.detection_information(
        tuning, jnp.float64(mean + np.log(4.0)), jnp.float64(variance), jnp.asarray(present), jnp.asarray(looked_for)
    )
    return float(found.precision), float(found.residual)


def posterior(mean: float, variance: float, present: bool) -> tuple[float, float]:
    """Mean and variance by numerical integration."""
    seen = 1.0 / (1.0 + np.exp(-SLOPE * (GRID + OFFSET) / SPREAD))
    likelihood = (1.0 - MISSES) * seen if present else 1.0 - (1.0 - MISSES) * seen
    weights = likelihood * np.exp(-0.5 * (GRID - mean) ** 2 / variance)
    weights /= weights.sum()
    center = float(np.sum(weights * GRID))
    return center, float(np.sum(weights * (GRID - center) ** 2))


@pytest.mark.parametrize("present", [True, False])
@pytest.mark.parametrize("mean", [-0.6, -0.3, 0.0, 0.3])
def test_the_equivalent_measurement_gives_the_posterior(flight: FlightParams, mean: float, present: bool) -> None:
    variance = 0.15**2
    precision, residual = information(flight, mean, variance, present, looked_for=True)
    left = 1.0 / (1.0 / variance + precision)
    exact_mean, exact_variance = posterior(mean, variance, present)
    # The convolution of the logistic function with the prior is approximated as that of a normal one, whose tails are
    # thinner: four sigma from the threshold the shift of two sigma is exaggerated by a fifth,
    # and the variance left by two fifths.
    np.testing.assert_allclose(mean + left * residual, exact_mean, atol=0.4 * np.sqrt(variance))
    np.testing.assert_allclose(left, exact_variance, rtol=0.4)


def test_a_large_target_tells_nothing(flight: FlightParams) -> None:
    for present in (True, False):
        np.testing.assert_allclose(information(flight, 2.0, 0.02, present, looked_for=True), 0.0, atol=1e-4)


def test_a_frame_in_which_the_target_is_not_expected_tells_nothing(flight: FlightParams) -> None:
    assert information(flight, -0.2, 0.02, present=False, looked_for=False) == (0.0, 0.0)


def test_no_box_makes_the_target_smaller_and_a_box_makes_it_greater(flight: FlightParams) -> None:
    assert information(flight, -0.2, 0.02, present=False, looked_for=True)[1] < 0.0
    assert information(flight, -0.2, 0.02, present=True, looked_for=True)[1] > 0.0


def test_a_rod_is_found_at_a_size_at_which_a_cube_is_not(flight: FlightParams) -> None:
    # Logs of the largest side over the mean one: 0.05 and 0.03 of a cube, 0.29 and 0.20 of a rod of six by one.
    def surely_found(largest_side_log: list[float]) -> bool:
        scales = replace(flight.navigation, scale_sigma=jnp.full(2, 1e-3), target_size=jnp.float64(1.0))
        tuning = replace(scales, minimum_size=jnp.float64(4.0), largest_side_log=jnp.array(largest_side_log))
        place = jnp.array([float(flight.vehicle.focal_px) / 4.0 / 1.03, 0.0, 0.0])
        return not detection_model.may_be_too_small(tuning, flight.vehicle.focal_px, place, jnp.zeros(()))

    assert not surely_found([0.05, 0.05])
    assert surely_found([0.29, 0.05])


def test_a_small_target_may_be_missed_and_a_large_one_may_not(flight: FlightParams) -> None:
    tuning = replace(flight.navigation, minimum_size=jnp.float64(4.0))

    def small(range_m: float, log_scale: float = 0.0) -> bool:
        place = jnp.array([range_m, 0.0, 0.0])
        focal = flight.vehicle.focal_px
        return bool(detection_model.may_be_too_small(tuning, focal, place, jnp.float64(log_scale)))

    assert small(200.0)
    assert not small(60.0)
    assert small(100.0, -0.5)
    assert not small(200.0, 1.0)
