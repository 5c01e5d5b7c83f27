"""Clearance of free drifts and the burns that keep it, against drifts propagated step by step."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.orbits import clohessy_wiltshire, yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import replace
from rpojax.flight.mission import drift_clearance, safe_burn
from rpojax.flight.mission.drift_clearance import Drift

A = 6.878e6
N = float(jax.jit(mean_motion)(A))
ORBIT = TargetOrbit(
    argument_of_latitude=jnp.float64(0.3), ex=jnp.float64(0.0), ey=jnp.float64(0.0), semi_major_axis=jnp.float64(A)
)
PERIOD = 2.0 * np.pi / N
DAY = 16.0 * PERIOD
GREATEST = 0.04
NO, YES = jnp.asarray(False), jnp.asarray(True)

transition_matrices = jax.jit(jax.vmap(clohessy_wiltshire.transition_matrix, in_axes=(None, 0)))
free_motion = jax.jit(yamanaka_ankersen.free_motion)
orbit_period = jax.jit(drift_clearance.orbit_period)
even_times = jax.jit(yamanaka_ankersen.times_of_even_eccentric_anomalies)


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, None))
def free_motions(orbit: TargetOrbit, time: jax.Array, constants: jax.Array) -> jax.Array:
    """States at times from the place of an orbit."""
    return yamanaka_ankersen.free_motion(yamanaka_ankersen.advanced(orbit, time), time, constants)


least_clearance = jax.jit(drift_clearance.least_clearance)
near_clearance = jax.jit(partial(drift_clearance.least_clearance, near=drift_clearance.NEAR_SAMPLES))
safe_delta_v = jax.jit(safe_burn.safe_delta_v)


UNIT_DRIFT = np.asarray(free_motion(ORBIT, jnp.float64(0.0), np.eye(6)[3]))
DRIFT_COVARIANCE = jnp.asarray(0.3**2 * np.outer(UNIT_DRIFT, UNIT_DRIFT))
"""Of a state whose drift constant alone is uncertain, by 0.3 m."""


def drift_of(
    state: list[float], keep_out: float = 12.0, sigmas: float = 0.0, covariance_H: jax.Array = DRIFT_COVARIANCE
) -> Drift:
    return Drift(
        orbit=ORBIT,
        state_H=jnp.asarray(state),
        scale_sigma=jnp.float64(0.03),
        covariance_H=covariance_H,
        sigmas=jnp.float64(sigmas),
        semi_axes=jnp.asarray(np.full(3, keep_out)),
        first_span=jnp.float64(PERIOD),
        horizon=jnp.float64(DAY),
    )


def least_range(state: np.ndarray, horizon: float = DAY) -> float:
    """Least range of a drift, sampled every 10 s."""
    matrices = np.asarray(transition_matrices(N, np.arange(10.0, horizon, 10.0)))
    return float(np.linalg.norm(matrices[:, :3] @ state, axis=1).min())


ELLIPSE = [0.0, 40.0, 25.0, 20.0 * N, 0.0, 0.0]
V_BAR = [0.0, -30.0, 0.0, 0.0, 0.0, 0.0]
TOWARD = [0.0, -30.0, 0.0, 0.0, 1e-3, 0.0]


@pytest.mark.parametrize(
    "state",
    [ELLIPSE, V_BAR, [0.0, -400.0, 30.0, 0.0, 0.004, 0.01], [20.0, 300.0, 0.0, 0.0, -1.5 * N * 20.0, 0.0]],
    ids=["safety ellipse", "hold", "drift", "co-elliptic"],
)
def test_the_clearance_is_that_of_the_drift_sampled_finely(state: list[float]) -> None:
    found = float(least_clearance(drift_of(state), np.zeros((3, 1)), np.zeros((1, 1)))[0][0, 0]) * 12.0
    expected = least_range(np.array(state))
    # Between the passages, which lie on the line, the servicer may be farther away.
    assert found <= expected + 0.02 * expected + 0.5
    assert found >= 0.8 * expected - 3.0


def test_the_clearance_of_an_ellipsoid_is_that_in_the_scale_of_its_axes() -> None:
    semi_axes = np.array([4.0, 30.0, 8.0])
    drift = replace(drift_of(ELLIPSE), semi_axes=jnp.asarray(semi_axes))
    found = float(least_clearance(drift, np.zeros((3, 1)), np.zeros((1, 1)))[0][0, 0])
    places = np.asarray(transition_matrices(N, np.arange(10.0, PERIOD, 10.0)))[:, :3] @ np.array(ELLIPSE)
    expected = float(np.linalg.norm(places / semi_axes, axis=1).min())
    assert expected - 0.1 < found <= 1.02 * expected
    # The sphere around it would be entered.
    assert float(least_clearance(drift_of(ELLIPSE, 30.0), np.zeros((3, 1)), np.zeros((1, 1)))[0][0, 0]) < 1.0 < found


@pytest.mark.parametrize("latitude", [0.0, 1.0, 2.5, 3.5, 5.5])
def test_passages_of_the_perigee_of_an_elliptic_orbit_are_not_missed(latitude: float) -> None:
    orbit = replace(
        ORBIT, argument_of_latitude=jnp.float64(latitude), ex=jnp.float64(0.7), semi_major_axis=jnp.float64(2.44e7)
    )
    period = orbit_period(orbit)
    times = float(period) * np.linspace(1e-4, 1.0, 4000)
    for number in range(4):
        # Its free motion is a closed orbit of 10 to 30 m of any shape.
        constants = np.random.default_rng(number).normal(size=6) * [20.0, 15.0, 15.0, 0.0, 15.0, 15.0]
        state = free_motion(orbit, jnp.float64(0.0), constants)
        drift = replace(drift_of(state.tolist(), 1.0), orbit=orbit, first_span=period, horizon=period)
        found = float(least_clearance(drift, np.zeros((3, 1)), np.zeros((1, 1)))[1][0, 0])
        places = np.asarray(free_motions(orbit, times, constants))[:, :3]
        expected = float(np.linalg.norm(places, axis=1).min())
        assert expected - 0.5 < found < expected + 0.5, number


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, None, None))
def passages(orbit: TargetOrbit, time: jax.Array, later: jax.Array, constants: jax.Array) -> jax.Array:
    """First and last place (2, 3) of the passages of places on an orbit."""
    place = yamanaka_ankersen.advanced(orbit, time)
    first, last = (yamanaka_ankersen.free_motion(place, time + each, constants)[:3] for each in (0.0, later))
    return jnp.stack([first, last])


@pytest.mark.parametrize("e", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("drift_m", [0.0, 50.0])
def test_drifts_of_orbits_are_seldom_nearer_than_the_clearance_by_more_than_a_metre(e: float, drift_m: float) -> None:
    """Half of `abort_margin_m`. Against the places of an orbit and the lines of their passages, sampled densely."""
    rng, errors = np.random.default_rng(1), []
    semi_major_axis = 7e6 / (1.0 - e)
    for _ in range(120):
        perigee, latitude = rng.uniform(0.0, 2.0 * np.pi, size=2)
        orbit = TargetOrbit(
            argument_of_latitude=jnp.float64(latitude),
            ex=jnp.float64(e * np.cos(perigee)),
            ey=jnp.float64(e * np.sin(perigee)),
            semi_major_axis=jnp.float64(semi_major_axis),
        )
        period = float(orbit_period(orbit))
        # A drift constant of a metre is 6 pi / (1 - e^2)^1.5 metres an orbit along the track.
        constants = rng.normal(size=6) * [40.0, 20.0, 20.0, 0.0, 20.0, 20.0]
        constants[3] = rng.choice([-1.0, 1.0]) * drift_m * (1.0 - e**2) ** 1.5 / (6.0 * np.pi)
        state = free_motion(orbit, jnp.float64(0.0), constants).tolist()
        drift = replace(
            drift_of(state, 1.0), orbit=orbit, first_span=jnp.float64(period), horizon=jnp.float64(4.0 * period)
        )
        found = float(least_clearance(drift, np.zeros((3, 1)), np.zeros((1, 1)))[1][0, 0])
        eccentric = np.linspace(0.0, 1.0, 2001)
        times = even_times(orbit, jnp.float64(period), eccentric)
        near, far = np.moveaxis(np.asarray(passages(orbit, times, jnp.float64(3.0 * period), constants)), 1, 0)
        along = far - near
        square = (along**2).sum(axis=1)
        share = np.clip(-(near * along).sum(axis=1) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        distance = np.linalg.norm(near + share[:, None] * along, axis=1)
        # What the servicer leaves at once, as it is where it is, does not count.
        counted = distance[np.argmax(np.diff(distance) < 0.0) :] if np.any(np.diff(distance) < 0.0) else distance[-1:]
        errors.append(found - counted.min())
    assert np.percentile(errors, 95) < 1.0


def test_a_start_that_the_drift_leaves_does_not_count_as_no_burn_changes_it() -> None:
    half = jnp.float64(0.5 * PERIOD)
    drift = replace(drift_of([0.0, -10.0, 0.0, 0.12, -0.03, 0.0]), first_span=half, horizon=half)
    found = float(least_clearance(drift, np.zeros((3, 1)), np.zeros((1, 1)))[1][0, 0])
    assert found > 1.0


def test_a_drift_that_comes_near_and_leaves_within_the_first_samples_is_seen() -> None:
    # Past the target at 6 m within three minutes.
    passing = np.array([6.0, -8.0, 0.0, 0.0, 0.1, 0.0])
    found = float(least_clearance(drift_of(passing.tolist()), np.zeros((3, 1)), np.zeros((1, 1)))[1][0, 0])
    assert found * 12.0 < least_range(passing) + 1.0


def test_the_uncertainty_of_the_drift_counts() -> None:
    slow = [0.0, -60.0, 0.0, 0.0, 1e-4, 0.0]
    none = np.zeros((3, 1)), np.zeros((1, 1))
    certain, uncertain = (float(least_clearance(drift_of(slow, sigmas=k), *none)[0][0, 0]) for k in (0.0, 3.0))
    assert uncertain < 0.5 * certain


UNCERTAIN = jnp.asarray(np.diag(np.square([0.2, 1.3, 0.8, 1e-3, 1e-3, 1e-3])))
"""Covariance of a state that has been watched for a few minutes."""


def test_drifts_come_nearer_than_the_clearance_as_seldom_as_its_sigmas_say() -> None:
    drift = replace(
        drift_of(ELLIPSE, sigmas=2.0, covariance_H=UNCERTAIN), horizon=jnp.float64(PERIOD), scale_sigma=jnp.float64(0.0)
    )
    bound = 12.0 * float(least_clearance(drift, np.zeros((3, 1)), np.zeros((1, 1)))[0][0, 0])
    errors = np.random.default_rng(5).multivariate_normal(np.zeros(6), np.asarray(UNCERTAIN), size=300)
    ranges = np.array([least_range(np.array(ELLIPSE) + error, PERIOD) for error in errors])
    assert np.mean(ranges < bound) <= 0.05
    assert bound > 0.7 * np.min(ranges)


def test_a_servicer_on_a_safe_orbit_waits_until_it_knows_enough() -> None:
    unknown = drift_of(ELLIPSE, sigmas=3.0, covariance_H=16.0 * UNCERTAIN)
    planned = jnp.array([0.0, 8e-3, 0.0])
    np.testing.assert_array_equal(safe_delta_v(unknown, planned, jnp.float64(GREATEST), YES), jnp.zeros(3))
    assert np.linalg.norm(safe_delta_v(unknown, planned, jnp.float64(GREATEST), NO)) > 0.0
    expected = float(least_clearance(unknown, np.zeros((3, 1)), np.zeros((1, 1)))[1][0, 0])
    assert expected * 12.0 == pytest.approx(least_range(np.array(ELLIPSE)), rel=0.02)


def test_where_nothing_is_certain_the_best_burn_by_the_estimate_is_made() -> None:
    heading = np.array([-12.0, -27.0, 0.0, 0.0, 0.045, 0.0])
    lost = drift_of(heading.tolist(), sigmas=3.0, covariance_H=1e4 * UNCERTAIN)
    found = np.asarray(safe_delta_v(lost, jnp.zeros(3), jnp.float64(GREATEST), NO))
    assert least_range(heading) < 3.0
    assert least_range(heading + np.concatenate([np.zeros(3), found])) > 18.0


def test_a_servicer_that_drifts_into_the_keep_out_zone_does_not_wait() -> None:
    found = np.asarray(safe_delta_v(drift_of(TOWARD), jnp.zeros(3), jnp.float64(GREATEST), YES))
    assert least_range(np.array(TOWARD) + np.concatenate([np.zeros(3), found])) > 12.0


def test_a_safe_planned_burn_is_made_as_planned() -> None:
    planned = jnp.array([1e-3, -1e-3, 2e-3])
    np.testing.assert_array_equal(safe_delta_v(drift_of(ELLIPSE), planned, jnp.float64(GREATEST), NO), planned)


def test_a_burn_that_gives_up_the_safety_is_made_in_part() -> None:
    lowest = np.array([-20.0, 0.0, 0.0, 0.0, 40.0 * N, 25.0 * N])
    planned = np.array([0.0, 2e-3, -25.0 * N])
    found = np.asarray(safe_delta_v(drift_of(list(lowest)), jnp.asarray(planned), jnp.float64(GREATEST), NO))
    share = float(found[1] / planned[1])
    assert share in (0.25, 0.5)
    assert least_range(lowest + np.concatenate([np.zeros(3), found])) > 12.0
    assert least_range(lowest + np.concatenate([np.zeros(3), planned])) < 12.0


@pytest.mark.parametrize("seed", range(6))
def test_an_abort_leaves_the_keep_out_zone_alone_for_a_day(seed: int) -> None:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    place = rng.uniform(20.0, 80.0) * direction / np.linalg.norm(direction)
    state = [*place, *(2e-3 * rng.normal(size=3))]
    found = np.asarray(safe_delta_v(drift_of(state, sigmas=1.0), jnp.zeros(3), jnp.float64(GREATEST), NO))
    assert np.linalg.norm(found) <= GREATEST * (1.0 + 1e-12)
    assert least_range(np.array(state) + np.concatenate([np.zeros(3), found])) > 12.0


CLOSE = [0.0, -3.05, 0.0, 0.0, 0.0, 0.0]
CLOSE_COVARIANCE = jnp.asarray(np.diag([0.05, 0.04, 0.04, 1.2e-4, 1e-4, 5e-5]) ** 2)


@pytest.mark.parametrize(
    "burn",
    [(0.0, -0.13, 0.0), (0.1, -0.1, 0.0), (-0.1, -0.1, 0.0), (0.13, 0.02, 0.0), (0.0, 0.1, 0.1), (0.0, 0.13, 0.0)],
)
def test_metres_from_the_zone_the_clearance_is_that_of_the_drift(burn: tuple[float, float, float]) -> None:
    drift = drift_of(CLOSE, 2.3, covariance_H=CLOSE_COVARIANCE)
    found = near_clearance(drift, np.array(burn)[:, None], np.ones((1, 1)))[1][0, 0] * 2.3
    # The start counts but for what follows within some seconds, as does the least distance found.
    moved = np.array(CLOSE) + np.concatenate([np.zeros(3), burn])
    matrices = np.asarray(transition_matrices(N, np.arange(1.0, 0.9 * PERIOD, 1.0)))
    distances = np.linalg.norm(matrices[:, :3] @ moved, axis=1)
    assert distances.min() - 0.05 <= found <= distances[14:].min() + 0.05


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_abort_metres_from_the_zone_covers_the_error_of_its_burn(side: float) -> None:
    close = -side * np.array(CLOSE)
    drift = drift_of(close.tolist(), 2.3, sigmas=3.0, covariance_H=CLOSE_COVARIANCE)
    greatest, sigma, rng = jnp.float64(2.7), 0.0106, np.random.default_rng(0)

    def least(burn: np.ndarray) -> float:
        """Of a hundred drifts with the errors of estimate and burn."""
        size = np.linalg.norm(burn) * sigma
        errors = rng.normal(size=(100, 6)) * np.sqrt(np.diag(CLOSE_COVARIANCE) + np.repeat([0.0, size**2], 3))
        starts = close + np.concatenate([np.zeros(3), burn]) + errors
        matrices = np.asarray(transition_matrices(N, np.arange(20.0, DAY, 10.0)))[:, :3]
        return float(np.linalg.norm(starts @ matrices.transpose(0, 2, 1), axis=2).min())

    found = np.asarray(safe_delta_v(drift, jnp.zeros(3), greatest, NO, near_sigma=jnp.float64(sigma)))
    assert least(found) > 2.3
    # The smallest one straight away is enough, which lines from the first passage on take for one through the target.
    np.testing.assert_allclose(found, [0.0, side * 0.05 * 2.7, 0.0], atol=1e-12)
    coarse = safe_delta_v(drift, jnp.zeros(3), greatest, NO)
    assert np.linalg.norm(coarse) > 2.0 * np.linalg.norm(found)


def test_a_change_that_is_not_finite_is_returned() -> None:
    planned = jnp.array([jnp.nan, 0.0, 0.0])
    assert np.isnan(safe_delta_v(drift_of(ELLIPSE), planned, jnp.float64(GREATEST), NO)[0])


def test_a_zone_of_no_size_stops_no_burn() -> None:
    planned = jnp.array([0.0, 1e-3, 0.0])
    found = safe_delta_v(drift_of(V_BAR, keep_out=0.0, sigmas=3.0), planned, GREATEST, NO)
    np.testing.assert_array_equal(found, planned)
