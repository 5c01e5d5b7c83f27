"""Measurements of additional sensors in the relative filter: rows, update, gate and recovery."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from believed_lidar import Lidar
from numpy_reference import random_covariance

from rpojax import nominal_parameters
from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import believed_sensor
from rpojax.flight.navigation.believed_sensor import BelievedSensor, SensorView
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.sensor_innovation import SensorInnovation
from rpojax.scenario.loading import scenario_loader

SIGMA = np.array([*np.full(3, 0.3), *np.full(3, 2e-3), 0.065, 0.14, 5e-4, 5e-4, 5e-3, 5e-3, 0.015, 0.01, 0.01, 5e-3])
NOISE = np.array([0.1, 2e-3, 2e-3])
BELIEFS = {"believed_noise": jnp.asarray(NOISE[0]), "believed_angle_noise": jnp.asarray(NOISE[1])}
Q_BN = np.array([0.9, 0.1, -0.3, 0.3]) / np.linalg.norm([0.9, 0.1, -0.3, 0.3])


@functools.cache
def nominal_tuning() -> OrbitFilterTuning:
    with jax.ensure_compile_time_eval():
        return nominal_parameters(scenario_loader.load("inspection"))[1].flight.navigation


def axes() -> np.ndarray:
    """Body axes in N, by columns of the direction cosines of the attitude."""
    w, x, y, z = Q_BN
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross


def seen(r_N: np.ndarray) -> np.ndarray:
    x, y, z = axes() @ r_N
    return np.array([np.linalg.norm(r_N), np.arctan2(y, x), np.arctan2(z, x)])


@jax.jit
def lidar_rows(estimate: RelativeEstimate, measured: jax.Array):
    view = SensorView(tuning=nominal_tuning(), relative=estimate, q_BN=jnp.asarray(Q_BN), time=jnp.zeros(()))
    return Lidar.rows(BELIEFS, view, {"ranger_m": measured[0], "ranger_rad": measured[1:]})


@jax.jit
def take(
    tuning: OrbitFilterTuning, estimate: RelativeEstimate, measured: jax.Array
) -> tuple[RelativeEstimate, SensorInnovation]:
    return believed_sensor.update(tuning, True, estimate, lidar_rows(estimate, measured))


@pytest.fixture(scope="module")
def known(flight: FlightParams) -> RelativeEstimate:
    """A target ahead of the sensor, with correlated errors."""
    place = axes().T @ np.array([30.0, 1.0, -2.0])
    estimate = rendezvous_scene.estimate(flight, place).relative
    return replace(estimate, covariance=jnp.asarray(random_covariance(np.random.default_rng(3), SIGMA)))


def jacobian(known: RelativeEstimate) -> np.ndarray:
    r, step = np.asarray(known.r_TS_N), 1e-4
    columns = [(seen(r + step * e) - seen(r - step * e)) / (2.0 * step) for e in np.eye(3)]
    return np.pad(np.stack(columns, axis=1), ((0, 0), (0, 13)))


def test_rows_of_a_function_of_the_estimate_are_its_derivative(known: RelativeEstimate) -> None:
    rows = lidar_rows(known, seen(np.asarray(known.r_TS_N)) + np.array([0.2, 1e-3, -1e-3]))
    np.testing.assert_allclose(rows.residual, [0.2, 1e-3, -1e-3], atol=1e-12)
    np.testing.assert_allclose(rows.jacobian, jacobian(known), atol=1e-8)
    np.testing.assert_array_equal(rows.weight, 1.0)


def test_the_update_agrees_with_the_textbook(flight: FlightParams, known: RelativeEstimate) -> None:
    residual = np.array([0.2, 1e-3, -1e-3])
    after, innovation = take(flight.navigation, known, seen(np.asarray(known.r_TS_N)) + residual)
    H, P = np.asarray(lidar_rows(known, seen(np.asarray(known.r_TS_N))).jacobian), np.asarray(known.covariance)
    S = H @ P @ H.T + np.diag(NOISE**2)
    K = np.linalg.solve(S, H @ P).T
    units = np.outer(SIGMA, SIGMA)
    np.testing.assert_allclose((after.vector - known.vector) / SIGMA, K @ residual / SIGMA, atol=1e-9)
    np.testing.assert_allclose(after.covariance / units, (P - K @ S @ K.T) / units, atol=1e-9)
    assert (bool(innovation.accepted), bool(innovation.rejected)) == (True, False)
    # The rows are those of a state of zero: for another estimate they give the residual of the linear measurement.
    moved = believed_sensor.at_estimate(innovation.rows, after)
    np.testing.assert_allclose(moved.residual, residual - H @ np.asarray(after.vector - known.vector), atol=1e-9)


@pytest.mark.parametrize(("fraction", "accepted"), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize("row", [0, 1, 2])
def test_a_measurement_beyond_the_gate_changes_nothing(
    flight: FlightParams, known: RelativeEstimate, fraction: float, accepted: bool, row: int
) -> None:
    H = np.asarray(lidar_rows(known, seen(np.asarray(known.r_TS_N))).jacobian)
    S = H @ np.asarray(known.covariance) @ H.T + np.diag(NOISE**2)
    offset = fraction * float(flight.navigation.gate_sigma) * np.sqrt(S[row, row]) * np.eye(3)[row]
    after, innovation = take(flight.navigation, known, seen(np.asarray(known.r_TS_N)) + offset)
    assert (bool(innovation.accepted), bool(innovation.rejected)) == (accepted, not accepted)
    if not accepted:
        jax.tree.map(np.testing.assert_array_equal, after, known)


def test_no_measurement_changes_nothing_and_is_not_rejected(flight: FlightParams, known: RelativeEstimate) -> None:
    after, innovation = take(flight.navigation, known, np.full(3, np.nan))
    jax.tree.map(np.testing.assert_array_equal, after, known)
    assert not bool(innovation.accepted | innovation.rejected)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(innovation))


def test_what_is_no_number_does_not_count_in_values_and_derivatives(
    flight: FlightParams, known: RelativeEstimate
) -> None:
    rows = lidar_rows(known, seen(np.asarray(known.r_TS_N)))
    holes = {
        "residual": replace(rows, residual=rows.residual.at[1].set(jnp.nan)),
        "variance": replace(rows, variance=rows.variance.at[1].set(jnp.nan)),
        "jacobian": replace(rows, jacobian=rows.jacobian.at[1, 0].set(jnp.inf)),
    }
    without = replace(rows, weight=jnp.array([1.0, 0.0, 1.0]))
    expected, _ = update(flight.navigation, known, without)
    for name, each in holes.items():
        after, innovation = update(flight.navigation, known, each)
        assert bool(innovation.accepted), name
        np.testing.assert_array_equal(after.vector, expected.vector, err_msg=name)
        assert np.isfinite(after.covariance).all(), name
    slopes = slope(flight.navigation, known, replace(rows, residual=jnp.full(3, jnp.nan), weight=jnp.zeros(3)))
    assert np.isfinite(slopes).all()


update = jax.jit(lambda tuning, estimate, rows: believed_sensor.update(tuning, True, estimate, rows))


@jax.jit
def slope(tuning: OrbitFilterTuning, estimate: RelativeEstimate, rows: MeasurementRows) -> jax.Array:
    """Derivative of the estimate after a measurement to a factor on the covariance before it, in reverse mode."""

    def total(factor: jax.Array) -> jax.Array:
        scaled = replace(estimate, covariance=factor * estimate.covariance)
        after, _ = believed_sensor.update(tuning, True, scaled, rows)
        return jnp.sum(after.vector) + jnp.sum(after.covariance)

    return jax.grad(total)(jnp.ones(()))


def test_rows_of_another_shape_are_refused(known: RelativeEstimate) -> None:
    def too_few(beliefs, view, measured):
        return replace(Lidar.rows(beliefs, view, measured), variance=jnp.ones(1))

    measured = {"ranger_m": jnp.asarray(30.0), "ranger_rad": jnp.zeros(2)}

    view = SensorView(tuning=nominal_tuning(), relative=known, q_BN=jnp.asarray(Q_BN), time=jnp.zeros(()))

    for rows, count, expected in (
        (too_few, 3, r"sensors.ranger.rows: found variance of shape \(1,\), expected \(3,\)"),
        (Lidar.rows, 2, r"found residual of shape \(3,\), expected \(2,\)"),
    ):
        with pytest.raises(RpojaxError, match=expected):
            BelievedSensor("ranger", rows, count).checked_rows(BELIEFS, view, measured)
    with pytest.raises(RpojaxError, match=r"found expected of shape \(\), expected \(1,\) as measured"):
        view.rows(lambda estimate: estimate.r_TS_N[0], jnp.ones(1), jnp.ones(1), jnp.asarray(True))
