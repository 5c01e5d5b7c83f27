"""Health tests of the orbit filter: false alarms of a consistent one, and detection of what is wrong."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from scipy import stats

from rpojax.core.pytree import replace
from rpojax.flight import navigation_health
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation.box_measurement import outlier_gate
from rpojax.flight.navigation.box_measurement.box_measurement_model import ExpectedBox
from rpojax.flight.navigation.box_measurement.outlier_gate import GateState
from rpojax.flight.navigation.combined_orbit_filter import Innovation
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.flight.navigation.sensor_innovation import SensorInnovation
from rpojax.flight.navigation_health import TESTS, HealthEvidence, NavigationHealth

TICKS = 1500


def evidence(
    health: NavigationHealth, innovation: Innovation, gate: GateState, estimate: RelativeEstimate, interval: jax.Array
) -> HealthEvidence:
    """Evidence of a tick in which the target is seen at a known range."""
    return HealthEvidence(
        interval=interval,
        innovation=innovation,
        gate=gate,
        estimate=estimate,
        effort=health.effort,
        lasting=health.lasting,
        lasting_ratio=jnp.zeros(()),
        unseen_time=jnp.zeros(()),
        range_sigma=jnp.zeros(()),
    )


def innovation_of(sigmas: jax.Array, accepted: jax.Array) -> Innovation:
    """GPS and a box that is accepted or rejected, with innovations (6,) in sigmas."""

    def of_sensor(sigmas: jax.Array, accepted: jax.Array) -> SensorInnovation:
        return SensorInnovation(
            innovation=0.1 * sigmas,
            variance=jnp.full(3, 0.01),
            used=jnp.ones(3, dtype=bool),
            log_likelihood=jnp.zeros(()),
            accepted=accepted,
            rejected=~accepted,
        )

    return Innovation(
        sensors={"gps": of_sensor(sigmas[:3], jnp.asarray(True)), "box": of_sensor(sigmas[3:], accepted)},
        expected_box=ExpectedBox(values=jnp.zeros(3), variance=jnp.ones(3), in_front=jnp.asarray(True)),
    )


@jax.jit
def run_tests(flight: FlightParams, sigmas: jax.Array, contradicted: jax.Array, scale: jax.Array) -> NavigationHealth:
    """Health at every tick, for innovations (ticks, 6) in sigmas; the size error is `scale` all the time."""
    estimate = rendezvous_scene.estimate(flight).relative
    estimate = replace(estimate, slow={**estimate.slow, "size": jnp.stack([0.0 * scale, scale])})

    def tick(health: NavigationHealth, now: tuple[jax.Array, jax.Array]) -> tuple[NavigationHealth, NavigationHealth]:
        innovation = innovation_of(now[0], ~now[1])
        gate = replace(outlier_gate.initial(), contradicted=now[1])
        after = navigation_health.update(
            flight.health,
            flight.navigation,
            health,
            evidence(health, innovation, gate, estimate, jnp.ones(())),
        )
        return after, after

    return jax.lax.scan(tick, navigation_health.initial(estimate), (sigmas, contradicted))[1]


def white(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(TICKS, 6))


def alarms(health: NavigationHealth) -> set[str]:
    """Tests over their threshold at the end."""
    return {name for name, ratio in zip(TESTS, np.asarray(health.ratios)[-1], strict=True) if ratio >= 1.0}


NEVER = np.zeros(TICKS, dtype=bool)
NO_ERROR = np.float64(0.0)


@pytest.mark.parametrize("seed", range(5))
def test_a_consistent_filter_keeps_the_confidence(flight: FlightParams, seed: int) -> None:
    health = run_tests(flight, white(seed), NEVER, NO_ERROR)
    assert np.all(health.confident)


@pytest.mark.parametrize(
    ("rows", "factor", "offset", "names"),
    [
        (slice(0, 3), 2.0, 0.0, {"gps_variance"}),
        (slice(3, 5), 2.0, 0.0, {"box_variance"}),
        (slice(5, 6), 1.0, 0.4, {"box_bias"}),
    ],
)
def test_innovations_of_another_variance_or_mean_are_detected(
    flight: FlightParams, rows: slice, factor: float, offset: float, names: set[str]
) -> None:
    sigmas = white(1)
    sigmas[:, rows] = factor * sigmas[:, rows] + offset
    health = run_tests(flight, sigmas, NEVER, NO_ERROR)
    assert alarms(health) == names
    assert bool(health.confident[-1]) is (names == {"gps_variance"})


def test_noise_somewhat_above_the_belief_is_no_alarm(flight: FlightParams) -> None:
    assert alarms(run_tests(flight, 1.4 * white(1), NEVER, NO_ERROR)) == set()


def test_contradictions_are_detected_and_confidence_returns_after_them(flight: FlightParams) -> None:
    contradicted = NEVER.copy()
    contradicted[100:200] = True
    health = run_tests(flight, white(2), contradicted, NO_ERROR)
    confident = np.asarray(health.confident)
    # The share after k contradictions is 1 - (1 - 1/300)^k: a fifth after 67. It fades to below 0.14 in 212 s.
    assert np.flatnonzero(~confident).tolist() == list(range(166, 411))


@pytest.mark.parametrize(("interval", "ticks"), [(0.2, 2949), (1.0, 589), (5.0, 117)])
def test_a_recovery_of_the_gate_takes_the_confidence_for_ten_minutes_at_any_rate_of_the_camera(
    flight: FlightParams, interval: float, ticks: int
) -> None:
    estimate = rendezvous_scene.estimate(flight).relative
    quiet = innovation_of(jnp.zeros(6), jnp.asarray(True))
    update = jax.jit(navigation_health.update)
    recovered = replace(outlier_gate.initial(), contradicted=jnp.asarray(True), recovered=jnp.asarray(True))
    health, gate, without = navigation_health.initial(estimate), recovered, 0
    for _ in range(round(700 / interval)):
        health = update(
            flight.health,
            flight.navigation,
            health,
            evidence(health, quiet, gate, estimate, jnp.float64(interval)),
        )
        gate, without = outlier_gate.initial(), without + int(not health.confident)
    assert without == ticks  # (1 - interval/300)^k falls below 0.14 with the next tick


@pytest.mark.parametrize(("sigmas", "confident"), [(3.9, True), (4.1, False)])
def test_a_size_error_that_the_filter_had_excluded_is_detected(
    flight: FlightParams, sigmas: float, confident: bool
) -> None:
    prior = float(np.hypot(*np.asarray(flight.navigation.scale_sigma)))
    health = run_tests(flight, white(3), NEVER, np.float64(sigmas * prior))
    assert bool(health.confident[-1]) is confident


def test_the_variance_threshold_is_the_quantile_of_chi_square(flight: FlightParams) -> None:
    # The mean square that equals the threshold has the ratio 1: found by the ratio of a known excess.
    health = run_tests(flight, np.full((1, 6), 2.0), NEVER[:1], NO_ERROR)
    dof = 2.0 * float(flight.health.time_constant)
    quantile = stats.chi2.ppf(stats.norm.cdf(float(flight.health.alarm_sigma)), dof) / dof
    excess = 3.0 / float(flight.health.time_constant)
    np.testing.assert_allclose(
        health.ratios[0, 0], excess / (1.5**2 * quantile - 1.0), rtol=0.02
    )  # the formula is approximate
