"""Innovation of a box against its nonlinear model and a dense covariance, in numpy."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from numpy_reference import SEEDS, random_covariance, random_unit, rotation_matrix, unit

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import relative_filter_state
from rpojax.flight.navigation.box_measurement import box_measurement_model
from rpojax.flight.navigation.box_measurement.box_measurement_model import ExpectedBox, PriorBox
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import BoxMeasurement, box_view
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate

FOCAL = 731.5
"""Of the camera [px]."""


@jax.jit
def _both(
    tuning: OrbitFilterTuning, q_KN: jax.Array, estimate: RelativeEstimate, box: BoxMeasurement
) -> tuple[dict[str, Any], ExpectedBox]:
    prior = box_measurement_model.prior_box(tuning, box_view(box, jnp.asarray(FOCAL), q_KN), estimate)
    return vars(prior), box_measurement_model.expected_box(prior, box)


def both(
    tuning: OrbitFilterTuning, q_KN: np.ndarray, estimate: RelativeEstimate, box: BoxMeasurement
) -> tuple[PriorBox, ExpectedBox]:
    prior, expected = _both(tuning, q_KN, estimate, box)
    return PriorBox(**prior), expected


class Scene:
    """A target within 30 deg of the boresight, a random estimate of it and a box near the expected one."""

    def __init__(self, tuning: OrbitFilterTuning, seed: int, wide: bool = False, **flags: bool) -> None:
        rng = np.random.default_rng(seed)
        self.size = float(tuning.target_size)
        self.q_KN = random_unit(rng, 4)
        self.R_KN = rotation_matrix(self.q_KN)
        self.r = rng.uniform(10.0, 60.0) * self.R_KN.T @ unit(np.array([*rng.uniform(-0.4, 0.4, 2), 1.0]))
        range_m = np.linalg.norm(self.r)
        sigmas = [*3 * [0.05 * range_m], *3 * [1e-3], 0.1, 0.05, 1e-3, 1e-3, 0.1, 0.1]
        self.P = random_covariance(rng, np.array(sigmas))
        if wide:
            self.P[:3, :3] += (0.5 * range_m) ** 2 * np.eye(3)
        self.scale, self.bias, self.center = rng.normal(0.0, 0.05, 2), rng.normal(0.0, 1e-3, 2), rng.normal(0.0, 0.1, 2)
        self.growth = 1e-5
        self.measured = self.model(self.r) + rng.normal(0.0, 0.02, 3)
        self.box = BoxMeasurement(
            tangent=jnp.asarray(self.measured[:2]),
            log_size=jnp.asarray(self.measured[2]),
            log_aspect=jnp.zeros(()),
            side_px=jnp.asarray(40.0),
            present=jnp.asarray(flags.get("present", True)),
            expected=jnp.asarray(True),
            truncated=jnp.asarray(flags.get("truncated", False)),
            half_frame_tangent=jnp.full(2, 0.1),
            attitude_variance_change=jnp.asarray(self.growth),
            interval=jnp.ones(()),
        )
        estimate = relative_filter_state.initial(tuning, jnp.asarray(self.r), jnp.zeros(3))
        self.prior, self.expected = both(
            tuning,
            self.q_KN,
            replace(
                estimate,
                slow={
                    "size": jnp.asarray(self.scale),
                    "bearing_bias": jnp.asarray(self.bias),
                    "center_offset": jnp.asarray(self.center),
                },
                covariance=jnp.asarray(self.P),
            ),
            self.box,
        )

    def model(self, r: np.ndarray) -> np.ndarray:
        """Tangents and log-size without slow errors."""
        r_K = self.R_KN @ r
        return np.array([r_K[0] / r_K[2], r_K[1] / r_K[2], np.log(self.size / np.linalg.norm(r))])

    def position_derivative(self, r: np.ndarray) -> np.ndarray:
        """Derivative (3, 3) of the model to the position, by central differences."""
        steps = 1e-4 * np.eye(3)
        return np.array([(self.model(r + step) - self.model(r - step)) / 2e-4 for step in steps]).T

    def jacobian(self, r: np.ndarray) -> np.ndarray:
        """Derivative (3, 12) of the measurement to the state."""
        H = np.zeros((3, 12))
        H[:, :3] = self.position_derivative(r)
        # In the direction in which the target appears.
        H[:2, :3] -= self.bias[:, None] * self.R_KN[2] / (self.R_KN @ r)[2]
        H[2, 6:8] = 1.0
        H[:2, 8:10] = np.eye(2)
        H[:2, 10:12] = np.eye(2) / (self.R_KN @ r)[2]
        return H

    def variance(self, r: np.ndarray) -> np.ndarray:
        """Variance (3,) of the box that comes from the state."""
        process = np.diag([*8 * [0.0], self.growth, self.growth, 0.0, 0.0])
        H = self.jacobian(r)
        return np.diag(H @ (self.P + process) @ H.T)

    def slow_errors(self) -> np.ndarray:
        bearing = self.bias + self.center / (self.R_KN @ self.r)[2]
        return np.array([*bearing, self.scale.sum()])


@given(SEEDS)
def test_the_innovation_is_what_differs_from_the_model_with_the_dense_variance(flight: FlightParams, seed: int) -> None:
    scene = Scene(flight.navigation, seed)
    prior, r = scene.prior, scene.r
    assert not prior.range_is_wide
    assert prior.in_front
    np.testing.assert_allclose(prior.slow_errors, scene.slow_errors(), rtol=1e-12)
    np.testing.assert_allclose(prior.measured, scene.measured - scene.slow_errors(), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(prior.residual, scene.measured - scene.slow_errors() - scene.model(r), atol=1e-12)
    np.testing.assert_allclose(prior.variance, scene.variance(r), rtol=1e-6)
    np.testing.assert_allclose(prior.innovation_variance - prior.variance, prior.model.variance, rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(prior.process_variance, [*8 * [0.0], scene.growth, scene.growth, 0.0, 0.0])
    np.testing.assert_allclose(scene.expected.values, scene.model(r) + scene.slow_errors(), rtol=1e-9, atol=1e-12)


@given(SEEDS)
def test_a_prior_of_unknown_range_is_compared_where_the_box_has_the_target(flight: FlightParams, seed: int) -> None:
    scene = Scene(flight.navigation, seed, wide=True)
    prior, measured = scene.prior, scene.measured - scene.slow_errors()
    assert prior.range_is_wide
    assert prior.is_wide
    ray = scene.R_KN.T @ unit(np.array([*measured[:2], 1.0]))
    reference = scene.size * np.exp(-measured[2]) * ray
    np.testing.assert_allclose(prior.reference, reference, rtol=1e-12)
    # There the box is as measured, and the prior away from it to first order.
    expected = scene.position_derivative(reference) @ (reference - scene.r)
    np.testing.assert_allclose(prior.residual, expected, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(prior.variance, scene.variance(reference), rtol=1e-6)
    np.testing.assert_allclose(prior.predicted, scene.model(scene.r), rtol=1e-12)


@pytest.mark.parametrize(
    ("flags", "present_noise"),
    [({}, True), ({"truncated": True}, True), ({"present": False, "truncated": True}, False)],
)
def test_the_noise_of_the_expected_box_is_that_of_the_present_one_or_of_a_whole_one(
    flight: FlightParams, flags: dict[str, bool], present_noise: bool
) -> None:
    tuning = flight.navigation
    scene = Scene(tuning, 5, **flags)
    edge, attitude = float(tuning.edge_noise), float(tuning.attitude_sigma)
    whole = 0.5 * (edge / FOCAL) ** 2 + attitude**2
    truncation = (0.5 * 40.0 / FOCAL) ** 2 if flags.get("truncated") and present_noise else 0.0
    side_px = FOCAL * scene.size * np.exp(scene.scale[0]) / np.linalg.norm(scene.r)
    noise = np.array([whole + truncation, whole + truncation, 1.5 * (edge / side_px) ** 2])
    np.testing.assert_allclose(scene.prior.untruncated_variance, whole, rtol=1e-12)
    np.testing.assert_allclose(scene.expected.variance, scene.variance(scene.r) + noise, rtol=1e-6)


@pytest.mark.parametrize(("factor", "is_wide"), [(0.99, False), (1.01, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_bearing_is_wide_against_a_box_that_is_not_truncated(
    flight: FlightParams, factor: float, is_wide: bool, axis: int
) -> None:
    tuning = flight.navigation
    sigma = float(tuning.confirm_above) * np.sqrt(
        0.5 * (float(tuning.edge_noise) / FOCAL) ** 2 + float(tuning.attitude_sigma) ** 2
    )
    scene = Scene(tuning, 7, truncated=True)
    P = np.zeros((12, 12))
    P[8 + axis, 8 + axis] = (factor * sigma) ** 2
    estimate = replace(
        relative_filter_state.initial(tuning, jnp.asarray(scene.r), jnp.zeros(3)), covariance=jnp.asarray(P)
    )
    still = replace(scene.box, attitude_variance_change=jnp.zeros(()))
    assert bool(both(tuning, scene.q_KN, estimate, still)[0].is_wide) == is_wide


def test_a_learnt_bias_shifts_no_bearing_along_the_line_of_sight(flight: FlightParams) -> None:
    # The range is so wide that the box is linearised where it has the target, far along its ray.
    tuning, q_KN = flight.navigation, np.array([1.0, 0.0, 0.0, 0.0])
    scene = Scene(tuning, 5)
    ray, bias = np.array([0.02, -0.01, 1.0]), np.array([2e-3, -1e-3])
    near = float(tuning.target_size) * np.exp(-float(scene.box.log_size)) * unit(ray)
    estimate = relative_filter_state.initial(tuning, jnp.asarray(2.0 * near), jnp.zeros(3))
    wide = estimate.covariance.at[:3, :3].set((2.0 * np.linalg.norm(near)) ** 2 * np.eye(3))
    slow = {**estimate.slow, "bearing_bias": jnp.asarray(bias)}
    box = replace(scene.box, tangent=jnp.asarray(ray[:2] + bias))
    prior, _ = both(tuning, q_KN, replace(estimate, slow=slow, covariance=wide), box)
    assert bool(prior.range_is_wide)
    np.testing.assert_allclose(prior.residual[:2], 0.0, atol=1e-12)
