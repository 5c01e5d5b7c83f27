"""Orbit filter: propagation of mean and covariance of both halves, and updates with and without measurements."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import IDENTITY, gravity, random_covariance, rotation_matrix
from scipy.integrate import solve_ivp
from scipy.stats import norm

from rpojax.core.kalman_update import MeasurementRows
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import combined_orbit_filter, lasting_error_effects, relative_filter_state
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.orbit_measurements import GpsMeasurement
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.stages import Stages
from rpojax.physics import equipment_faults, plant, plant_state
from rpojax.physics.plant_options import Effects
from rpojax.scenario.params import Params

SERVICER_SIGMA = np.repeat([2.0, 0.02, 1.2], 3)
RELATIVE_SIGMA = np.concatenate([np.full(3, 0.05), np.full(3, 0.01), [0.065, 0.14], [5e-4, 5e-4], [5e-3, 5e-3]])

# Kick and drift differ from the exact transition by (n dt)^2 = 1e-6; the gradient leaves J2 out, 1e-3 of n^2 dt.
FIRST_ORDER = 5e-6

HEALTHY = equipment_faults.healthy()

initial = jax.jit(combined_orbit_filter.initial)
initial_truth = jax.jit(plant_state.initial_truth)
step = jax.jit(plant.step, static_argnums=(0, 7))
predict = jax.jit(combined_orbit_filter.predict, static_argnums=(1, 8))
update = jax.jit(combined_orbit_filter.update, static_argnums=1)


def coast(
    tuning: OrbitFilterTuning,
    estimate: OrbitEstimate,
    delta_v_N: np.ndarray | None = None,
    burn_delta_v: float = 0.0,
    burn_sigma_inflation: float = 1.0,
    zonal_degree: int = 2,
    third_body_acceleration_N: np.ndarray | None = None,
) -> OrbitEstimate:
    """Estimate a second later, by default without thrust, Sun and Moon."""
    delta_v_N, third_body_acceleration_N = (
        np.zeros(3) if vector is None else vector for vector in (delta_v_N, third_body_acceleration_N)
    )
    return predict(
        tuning,
        zonal_degree,
        estimate,
        delta_v_N,
        np.float64(burn_delta_v),
        np.float64(burn_sigma_inflation),
        third_body_acceleration_N,
        lasting_error_effects.none(),
        1.0,
    )


def fix(position_N: np.ndarray, present: bool = True) -> GpsMeasurement:
    return GpsMeasurement(position_N=jnp.asarray(position_N), present=jnp.asarray(present))


@pytest.fixture(scope="module")
def estimate(flight: FlightParams) -> OrbitEstimate:
    """An estimate with correlated covariances and slow errors that are not zero, without that of burns."""
    rng = np.random.default_rng(1)
    known = rendezvous_scene.estimate(flight, v_TS_N=np.array([0.05, -0.03, 0.02]))
    servicer = replace(
        known.servicer, gps_error_N=rng.normal(size=3), covariance=random_covariance(rng, SERVICER_SIGMA)
    )
    relative = replace(
        known.relative,
        slow={
            "size": 0.1 * rng.normal(size=2),
            "bearing_bias": 5e-4 * rng.normal(size=2),
            "center_offset": 5e-3 * rng.normal(size=2),
        },
        covariance=random_covariance(rng, RELATIVE_SIGMA),
    )
    return OrbitEstimate(servicer=servicer, relative=relative)


def means(estimate: OrbitEstimate) -> tuple[jax.Array, jax.Array]:
    s, r = estimate.servicer, estimate.relative
    return (
        jnp.concatenate([s.r_SN_N, s.v_SN_N, s.gps_error_N]),
        r.vector,
    )


@jax.jit
def transitions(tuning: OrbitFilterTuning, estimate: OrbitEstimate) -> tuple[jax.Array, jax.Array]:
    """Dense derivative over one second of each half's mean to itself."""

    def after(servicer: jax.Array, relative: jax.Array) -> tuple[jax.Array, jax.Array]:
        moved = OrbitEstimate(
            servicer=replace(estimate.servicer, r_SN_N=servicer[:3], v_SN_N=servicer[3:6], gps_error_N=servicer[6:]),
            relative=relative_filter_state.moved_to(estimate.relative, relative, estimate.relative.covariance),
        )
        return means(
            combined_orbit_filter.predict(
                tuning,
                2,
                moved,
                jnp.zeros(3),
                jnp.zeros(()),
                jnp.ones(()),
                jnp.zeros(3),
                lasting_error_effects.none(),
                1.0,
            )
        )

    (servicer, _), (_, relative) = jax.jacfwd(after, argnums=(0, 1))(*means(estimate))
    return servicer, relative


def test_the_mean_follows_both_orbits_through_a_burn(flight: FlightParams, estimate: OrbitEstimate) -> None:
    delta_v = np.array([1e-3, -2e-4, 5e-4])  # per second
    found = estimate
    for _ in range(10):
        found = coast(flight.navigation, found, delta_v, 0.02)

    def derivative(_: float, y: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], gravity(y[:3]) + acceleration])

    s, r = estimate.servicer, estimate.relative
    orbits = []
    for start, acceleration in (
        (np.concatenate([s.r_SN_N, s.v_SN_N]), delta_v),
        (np.concatenate([s.r_SN_N + r.r_TS_N, s.v_SN_N + r.v_TS_N]), np.zeros(3)),
    ):
        solution = solve_ivp(derivative, (0.0, 10.0), start, "DOP853", rtol=1e-13, atol=1e-9, args=(acceleration,))
        orbits.append(solution.y[:, -1])
    servicer, target = orbits
    np.testing.assert_allclose(found.servicer.r_SN_N, servicer[:3], atol=1e-7)
    np.testing.assert_allclose(found.servicer.v_SN_N, servicer[3:], atol=1e-9)
    # The reference is a difference of 7000 km vectors: 1e-9 m of rounding each step.
    np.testing.assert_allclose(found.relative.r_TS_N, (target - servicer)[:3], atol=1e-7)
    np.testing.assert_allclose(found.relative.v_TS_N, (target - servicer)[3:], atol=1e-9)


def slow_time(predicted: OrbitEstimate) -> float:
    """Correlation time of the slow part of the size [s]: 600 s at a line of sight that turns by 1.1e-3 rad/s."""
    r, v = np.asarray(predicted.relative.r_TS_N), np.asarray(predicted.relative.v_TS_N)
    rate = float(np.linalg.norm(np.cross(r, v)) / (r @ r))
    return 600.0 * 1.1e-3 / float(np.hypot(rate, 1.1e-3 / 40.0))


def test_slow_errors_decay_with_their_time_constants(flight: FlightParams, estimate: OrbitEstimate) -> None:
    found = coast(flight.navigation, estimate)
    size_decay = np.exp([-1.0 / slow_time(found), -1.0 / 30.0])
    np.testing.assert_allclose(found.servicer.gps_error_N, estimate.servicer.gps_error_N * np.exp(-1.0 / 700.0))
    np.testing.assert_allclose(found.relative.slow["size"], estimate.relative.slow["size"] * size_decay)
    np.testing.assert_array_equal(found.relative.slow["bearing_bias"], estimate.relative.slow["bearing_bias"])
    center = estimate.relative.slow["center_offset"] * np.exp(-1.0 / 60.0)
    np.testing.assert_allclose(found.relative.slow["center_offset"], center)


@pytest.mark.parametrize("half", ["servicer", "relative"])
def test_the_predicted_covariance_agrees_with_the_derivative_of_the_mean(
    flight: FlightParams, estimate: OrbitEstimate, half: str
) -> None:
    predicted = coast(flight.navigation, estimate)
    found = np.asarray(getattr(predicted, half).covariance)
    F = np.asarray(transitions(flight.navigation, estimate)[0 if half == "servicer" else 1])
    P = np.asarray(getattr(estimate, half).covariance)
    if half == "servicer":
        noise = np.concatenate([np.zeros(3), np.full(3, 1e-6**2), np.full(3, 1.2**2 * (1 - np.exp(-2.0 / 700.0)))])
    else:
        # How fast the size error decays depends on the estimated motion, too: the filter takes it as known.
        assert np.abs(F[6, :6]).max() < 1e-2
        F = np.vstack([F[:6], np.pad(F[6, 6:], (6, 0)), F[7:]])
        scale = np.array([0.065, 0.14]) ** 2 * (1 - np.exp([-2.0 / slow_time(predicted), -2.0 / 30.0]))
        center = np.full(2, 0.005**2 * (1 - np.exp(-2.0 / 60.0)))
        noise = np.concatenate([np.zeros(3), np.full(3, 3e-7**2), scale, np.zeros(2), center])
    expected = F @ P @ F.T + np.diag(noise)
    units = np.sqrt(np.outer(np.diag(P), np.diag(P)))
    np.testing.assert_allclose(found / units, expected / units, atol=FIRST_ORDER)
    assert np.max(np.abs(found - P) / units) > 100 * FIRST_ORDER  # so that it did change


def test_acceleration_noise_makes_the_velocity_variance_grow_linearly(
    flight: FlightParams, estimate: OrbitEstimate
) -> None:
    loud = replace(
        flight.navigation, acceleration_noise=jnp.float64(0.01), relative_acceleration_noise=jnp.float64(0.003)
    )
    quiet = replace(loud, acceleration_noise=jnp.zeros(()), relative_acceleration_noise=jnp.zeros(()))
    noisy, calm = (coast(tuning, estimate) for tuning in (loud, quiet))
    servicer = np.asarray(noisy.servicer.covariance - calm.servicer.covariance)
    relative = np.asarray(noisy.relative.covariance - calm.relative.covariance)
    np.testing.assert_allclose(np.diag(servicer), [0.0] * 3 + [1e-4] * 3 + [0.0] * 3, atol=1e-12)
    np.testing.assert_allclose(np.diag(relative), [0.0] * 3 + [9e-6] * 3 + [0.0] * 6, atol=1e-12)


def test_a_burn_adds_its_execution_error_to_both_covariances(flight: FlightParams, estimate: OrbitEstimate) -> None:
    along, size = np.array([0.6, 0.0, 0.8]), 0.02
    fractions = np.array([0.1, 0.3, 0.3, 0.2, 0.1])
    added = {"servicer": np.zeros((3, 3)), "relative": np.zeros((3, 3))}
    for fraction in fractions:
        burning = coast(flight.navigation, estimate, fraction * size * along, size)
        coasting = coast(flight.navigation, estimate, np.zeros(3), size)
        for half in added:
            change = getattr(burning, half).covariance - getattr(coasting, half).covariance
            added[half] += np.asarray(change)[3:6, 3:6]
    projection = np.outer(along, along)
    expected = size**2 * (0.015**2 * projection + np.deg2rad(0.3) ** 2 * (np.eye(3) - projection))
    for half, found in added.items():
        # The difference of two velocity variances of (2 cm/s)^2 keeps nine digits of one of (0.3 mm/s)^2.
        np.testing.assert_allclose(found, expected, atol=1e-8 * size**2, err_msg=half)


@pytest.mark.parametrize("luni_solar", [True, False])
def test_the_predicted_mean_agrees_with_the_truth_with_the_same_gravity(params: Params, luni_solar: bool) -> None:
    effects = Effects(zonal_degree=6, sun_gravity=True, moon_gravity=True)
    sky = SunMoonPositions(sun_N=jnp.array([1.2e11, 0.8e11, 0.3e11]), moon_N=jnp.array([-2.5e8, 2.6e8, 1.0e8]))
    truth = initial_truth(params.plant, params.orbit, jnp.array([5.0, -50.0, 3.0]), jnp.zeros(3), jnp.asarray(IDENTITY))
    tuning = params.flight.navigation
    found = initial(tuning, truth.r_TN_N + truth.r_ST_N, truth.v_TN_N + truth.v_ST_N, -truth.r_ST_N, -truth.v_ST_N)
    for _ in range(100):
        position = found.servicer.r_SN_N
        truth = step(effects, params.plant, truth, np.zeros(3), (), sky, HEALTHY, 1.0)
        acceleration = luni_solar_acceleration(position, sky) if luni_solar else np.zeros(3)
        found = coast(tuning, found, zonal_degree=6, third_body_acceleration_N=acceleration)
    servicer = np.asarray(found.servicer.r_SN_N) - np.asarray(truth.r_TN_N + truth.r_ST_N)
    relative = np.asarray(found.relative.r_TS_N) + np.asarray(truth.r_ST_N)
    # Sun and Moon accelerate by 1e-6 m/s^2: 5 mm of the orbit after 100 s, and nothing of the difference.
    assert (np.linalg.norm(servicer) < 1e-5) is np.bool_(luni_solar)
    assert np.linalg.norm(servicer) < 0.01
    assert np.linalg.norm(relative) < 1e-6


def luni_solar_acceleration(r_N: jax.Array, sky: SunMoonPositions) -> np.ndarray:
    """Acceleration [m/s^2] of a vehicle by Sun and Moon less that of the Earth, by Battin's formula."""
    r = np.asarray(r_N)
    total = np.zeros(3)
    for mu, body in ((1.32712440018e20, np.asarray(sky.sun_N)), (4.9028e12, np.asarray(sky.moon_N))):
        q = r @ (r - 2.0 * body) / (body @ body)
        f = q * (3.0 + 3.0 * q + q * q) / (1.0 + (1.0 + q) ** 1.5)
        total -= mu / np.linalg.norm(r - body) ** 3 * (r + f * body)
    return total


def test_higher_zonal_harmonics_change_the_mean_by_decimetres_in_100_s(
    flight: FlightParams, estimate: OrbitEstimate
) -> None:
    full = plain = estimate
    for _ in range(100):
        full, plain = coast(flight.navigation, full, zonal_degree=6), coast(flight.navigation, plain)
    apart = np.linalg.norm(full.servicer.r_SN_N - plain.servicer.r_SN_N)
    assert 0.01 < apart < 0.5  # 2e-5 m/s^2 over 100 s


def test_the_burn_sigma_inflation_acts_on_magnitude_and_not_on_direction(
    flight: FlightParams, estimate: OrbitEstimate
) -> None:
    along, size = np.array([0.6, 0.0, 0.8]), 0.02
    nominal, inflated = (
        coast(flight.navigation, estimate, size * along, size, burn_sigma_inflation)
        for burn_sigma_inflation in (1.0, 3.0)
    )
    for half in ("servicer", "relative"):
        change = np.asarray(getattr(inflated, half).covariance - getattr(nominal, half).covariance)[3:6, 3:6]
        expected = size**2 * (3.0**2 - 1.0) * 0.015**2 * np.outer(along, along)
        np.testing.assert_allclose(change, expected, atol=1e-8 * size**2, err_msg=half)


def test_without_gps_the_servicer_is_propagated_and_its_covariance_grows(
    flight: FlightParams, estimate: OrbitEstimate
) -> None:
    """A minute without GPS, with a wrong position in the absent measurement, against a minute with GPS."""
    q_KN = rendezvous_scene.camera_attitude(flight, estimate)
    absent = rendezvous_scene.box(flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD, present=False)

    def minute(present: bool) -> list[OrbitEstimate]:
        known, history = estimate, [estimate]
        for _ in range(60):
            gps = fix(known.servicer.r_SN_N + (0.0 if present else 1e5), present)
            known = coast(flight.navigation, known)
            known, _, _ = update(
                flight.navigation, True, flight.vehicle.focal_px, known, outlier_gate.initial(), gps, q_KN, absent
            )
            history.append(known)
        return history

    blind, sighted = minute(False), minute(True)
    alone = estimate
    for _ in range(60):
        alone = coast(flight.navigation, alone)
    jax.tree.map(np.testing.assert_array_equal, blind[-1].servicer, alone.servicer)
    sigmas = [float(np.sqrt(np.trace(known.servicer.covariance[:3, :3]))) for known in blind]
    assert np.all(np.diff(sigmas[5:]) > 0.0)  # the hand-over's correlations may shrink it at first
    assert np.trace(sighted[-1].servicer.covariance[:3, :3]) < 0.5 * sigmas[-1] ** 2


def test_without_a_box_only_the_servicer_is_updated(flight: FlightParams, estimate: OrbitEstimate) -> None:
    q_KN = rendezvous_scene.camera_attitude(flight, estimate)
    absent = rendezvous_scene.box(flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD, present=False)
    present = rendezvous_scene.box(flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD)
    gps = fix(rendezvous_scene.R_SN_N + np.array([3.0, -2.0, 1.0]))

    def after(box: combined_orbit_filter.BoxMeasurement) -> tuple[OrbitEstimate, combined_orbit_filter.Innovation]:
        found, _, innovation = update(
            flight.navigation, True, flight.vehicle.focal_px, estimate, outlier_gate.initial(), gps, q_KN, box
        )
        return found, innovation

    without, none = after(absent)
    jax.tree.map(np.testing.assert_array_equal, without.relative, estimate.relative)
    assert np.max(np.abs(np.asarray(without.servicer.r_SN_N) - rendezvous_scene.R_SN_N)) > 0.1
    assert not none.sensors["box"].accepted
    assert not none.sensors["box"].rejected
    with_box, some = after(present)
    jax.tree.map(np.testing.assert_array_equal, with_box.servicer, without.servicer)
    assert some.sensors["box"].accepted
    assert np.trace(with_box.relative.covariance) < np.trace(estimate.relative.covariance)


def test_the_log_likelihood_is_that_of_the_used_rows(flight: FlightParams, estimate: OrbitEstimate) -> None:
    q_KN = rendezvous_scene.camera_attitude(flight, estimate)
    for present in (True, False):
        _, _, innovation = update(
            flight.navigation,
            True,
            flight.vehicle.focal_px,
            estimate,
            outlier_gate.initial(),
            fix(rendezvous_scene.R_SN_N + 1.0),
            q_KN,
            rendezvous_scene.box(flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD, present=present),
        )
        assert list(innovation.sensors) == ["box", "gps"]
        for name, each in innovation.sensors.items():
            of_rows = norm.logpdf(each.innovation, scale=np.sqrt(each.variance)).sum()
            expected = of_rows if name == "gps" or present else 0.0
            np.testing.assert_allclose(each.log_likelihood, expected, rtol=1e-9)


def test_a_replaced_update_that_returns_no_innovation_of_a_sensor_is_refused_by_its_name(
    flight: FlightParams, estimate: OrbitEstimate
) -> None:
    def forgetful(sensors: Any, **others: Any) -> Any:
        return combined_orbit_filter.update(sensors={}, **others)

    def lidar(relative: RelativeEstimate) -> MeasurementRows:
        one = jnp.ones(1)
        jacobian = jnp.zeros((1, relative.layout.size))
        return MeasurementRows(residual=one, jacobian=jacobian, variance=one, weight=one)

    q_KN = rendezvous_scene.camera_attitude(flight, estimate)
    measured = {
        "estimate": estimate,
        "gate": outlier_gate.initial(),
        "gps": fix(rendezvous_scene.R_SN_N),
        "q_KN": q_KN,
        "box": rendezvous_scene.box(flight, rotation_matrix(q_KN), rendezvous_scene.TARGET_AHEAD),
    }

    def call(measured: dict[str, Any]) -> Any:
        tuning, focal_px = flight.navigation, flight.vehicle.focal_px
        others = {"tuning": tuning, "gated": True, "focal_px": focal_px, "sensors": {"lidar": lidar}}
        return Stages(orbit_update=forgetful).call("orbit_update", **measured, **others)

    with pytest.raises(RpojaxError) as caught:
        jax.eval_shape(call, measured)
    assert str(caught.value) == (
        "stages.orbit_update: found a result of type (OrbitEstimate, GateState, Innovation) without "
        "[2].sensors['lidar'], expected one that has it"
    )
