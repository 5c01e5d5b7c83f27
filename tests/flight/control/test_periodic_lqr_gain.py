"""Gains of elliptic orbits against those of circular ones and one large Riccati equation; stability over the orbit."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from numpy_reference import MU
from scipy.linalg import solve_discrete_are

from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.keplerian_elements import mean_motion
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit, advanced, transition_matrix
from rpojax.core.pytree import replace
from rpojax.flight.control import periodic_lqr_gain
from rpojax.flight.control.formation_law import lqr_gain
from rpojax.flight.control.formation_tuning import FormationTuning
from rpojax.scenario.params import Params

PERIGEE, PERIGEE_ANGLE, BURNS = 7.0e6, 2.1, 40
periodic_lqr_gains = jax.jit(periodic_lqr_gain.periodic_lqr_gains, static_argnums=(2, 3))
gain_at = jax.jit(periodic_lqr_gain.gain_at)
mean_argument_of_latitude = jax.jit(yamanaka_ankersen.mean_argument_of_latitude)


def orbit(e: float, true_anomaly: float = 0.6) -> TargetOrbit:
    return TargetOrbit(
        argument_of_latitude=jnp.asarray(PERIGEE_ANGLE + true_anomaly),
        ex=jnp.asarray(e * np.cos(PERIGEE_ANGLE)),
        ey=jnp.asarray(e * np.sin(PERIGEE_ANGLE)),
        semi_major_axis=jnp.asarray(PERIGEE / (1.0 - e)),
    )


def period(e: float) -> float:
    return float(2.0 * np.pi * np.sqrt((PERIGEE / (1.0 - e)) ** 3 / MU))


def weighted(params: Params, delta_v_weight: float) -> FormationTuning:
    return replace(params.flight.formation, delta_v_weight=jnp.full(3, delta_v_weight))


@partial(jax.jit, static_argnums=2)
def motions(start: TargetOrbit, interval: jax.Array, count: int) -> tuple[TargetOrbit, jax.Array]:
    """Places of burns and the motion from each to the next."""

    def one(place: TargetOrbit, _: None) -> tuple[TargetOrbit, tuple[TargetOrbit, jax.Array]]:
        return advanced(place, interval), (place, transition_matrix(place, interval))

    return jax.lax.scan(one, start, None, length=count)[1]


def closed_loop(gains: jax.Array, e: float, interval: float, count: int) -> np.ndarray:
    """Transition matrix of the deviation over a number of burns at real places of the orbit."""
    places, free = motions(orbit(e), jnp.asarray(interval), count)
    total = np.eye(6)
    for gain, motion in zip(np.asarray(jax.vmap(gain_at, in_axes=(None, 0))(gains, places)), np.asarray(free),
                            strict=True):  # fmt: skip
        total = motion @ (np.eye(6) - np.concatenate([np.zeros((3, 6)), gain])) @ total
    return total


def test_on_a_circular_orbit_every_gain_is_that_of_the_lqr(params: Params) -> None:
    formation, interval = weighted(params, 1e6), period(0.0) / BURNS
    expected = np.asarray(lqr_gain(formation, mean_motion(jnp.asarray(PERIGEE)), interval))
    found = np.asarray(periodic_lqr_gains(formation, orbit(0.0), BURNS))
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-8 * np.max(np.abs(expected)))


@pytest.mark.parametrize("e", [0.1, 0.7])
def test_the_gain_is_that_of_one_riccati_equation_over_the_whole_orbit(params: Params, e: float) -> None:
    """The burns of an orbit as one input: scipy solves the equation from each orbit to the next."""
    formation = replace(weighted(params, 1e6), velocity_weight=jnp.full(3, 1e3))
    _, free = motions(at_mean_argument(e, 0.0), jnp.asarray(period(e) / BURNS), BURNS)
    Q = np.diag([1.0] * 3 + [1e3] * 3)
    state, inputs = np.eye(6), np.zeros((6, 3 * BURNS))
    cost, cross, effort = np.zeros((6, 6)), np.zeros((6, 3 * BURNS)), 1e6 * np.eye(3 * BURNS)
    for k, motion in enumerate(np.asarray(free)):
        cost, cross, effort = cost + state.T @ Q @ state, cross + state.T @ Q @ inputs, effort + inputs.T @ Q @ inputs
        inputs[3:, 3 * k : 3 * k + 3] += np.eye(3)
        state, inputs = motion @ state, motion @ inputs
    P = solve_discrete_are(state, inputs, cost, effort, s=cross)
    expected = np.linalg.solve(effort + inputs.T @ P @ inputs, inputs.T @ P @ state + cross.T)[:3]
    found = np.asarray(periodic_lqr_gains(formation, orbit(e), BURNS))[0]
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.max(np.abs(expected)))


def at_mean_argument(e: float, angle: float) -> TargetOrbit:
    start = orbit(e)
    change = angle - float(mean_argument_of_latitude(start))
    return jax.jit(advanced)(start, jnp.asarray(change * period(e) / (2.0 * np.pi)))


@pytest.mark.parametrize("e", [0.0, 0.1, 0.7])
@pytest.mark.parametrize("delta_v_weight", [3e4, 1e8])
def test_all_floquet_multipliers_of_the_closed_loop_are_below_one(
    params: Params, e: float, delta_v_weight: float
) -> None:
    gains = periodic_lqr_gains(weighted(params, delta_v_weight), orbit(e), BURNS)
    multipliers = np.linalg.eigvals(closed_loop(gains, e, period(e) / BURNS, BURNS))
    assert np.max(np.abs(multipliers)) < 0.9
    free = np.linalg.eigvals(closed_loop(jnp.zeros_like(gains), e, period(e) / BURNS, BURNS))
    np.testing.assert_allclose(np.abs(free), 1.0, atol=1e-3)


@pytest.mark.parametrize("e", [0.1, 0.7])
def test_burns_that_do_not_divide_the_orbit_bring_the_servicer_to_its_reference(params: Params, e: float) -> None:
    gains = periodic_lqr_gains(weighted(params, 1e6), orbit(e), BURNS)
    after = closed_loop(gains, e, 1.013 * period(e) / BURNS, 3 * BURNS) @ np.array([50.0, -300.0, 40.0, 0.0, 0.0, 0.0])
    assert np.linalg.norm(after[:3]) < 0.1


@pytest.mark.parametrize("e", [0.0, 0.7])
def test_gains_are_interpolated_in_the_mean_argument_of_latitude_round_the_orbit(params: Params, e: float) -> None:
    gains = np.asarray(periodic_lqr_gains(params.flight.formation, orbit(e), BURNS))
    step = 2.0 * np.pi / BURNS
    for turn in (-2, 0, 1):
        for place, expected in ((3.0, gains[3]), (0.25, 0.75 * gains[0] + 0.25 * gains[1]),
                                (39.5, 0.5 * (gains[39] + gains[0]))):  # fmt: skip
            found = gain_at(jnp.asarray(gains), at_mean_argument(e, step * place + 2.0 * np.pi * turn))
            np.testing.assert_allclose(found, expected, atol=1e-9 * np.max(np.abs(gains)))


@pytest.mark.parametrize("count", [1, 2])
def test_equal_gains_are_that_gain_everywhere(count: int) -> None:
    gain = np.arange(18.0).reshape(3, 6)
    for angle in (0.0, 0.7, 2.0, 3.1, 5.0, -1.0):
        found = gain_at(jnp.asarray(np.stack([gain] * count)), at_mean_argument(0.3, angle))
        np.testing.assert_allclose(found, gain, atol=1e-12)


def test_the_derivative_agrees_with_differences(params: Params) -> None:
    def gain(logarithm: jax.Array, ex: jax.Array) -> jax.Array:
        formation = replace(params.flight.formation, delta_v_weight=jnp.full(3, jnp.exp(logarithm)))
        place = replace(orbit(0.3), ex=ex)
        scale = jnp.array([1e3] * 3 + [1.0] * 3)
        return scale[None, :] * periodic_lqr_gain.gain_at(
            periodic_lqr_gain.periodic_lqr_gains(formation, place, 12), place
        )

    check_grads(jax.jit(gain), (jnp.asarray(12.0), jnp.asarray(0.1)), order=1, modes=["rev"], eps=1e-5, rtol=1e-6)


def test_single_precision_agrees_with_double(params: Params) -> None:
    formation = params.flight.formation
    double = np.asarray(periodic_lqr_gains(formation, orbit(0.7), BURNS))
    single = periodic_lqr_gains(*jax.tree.map(lambda x: x.astype(jnp.float32), (formation, orbit(0.7))), BURNS)
    assert single.dtype == jnp.float32
    scale = np.array([1e3] * 3 + [1.0] * 3)
    # The cost of a deviation loses three of seven digits to the scale of its velocity part.
    np.testing.assert_allclose(np.asarray(single) * scale, double * scale, atol=3e-3)


def test_a_table_has_the_nearest_number_of_burns_and_at_least_a_few() -> None:
    assert periodic_lqr_gain.burns_per_orbit(5700.0, 200.0) == 28
    assert periodic_lqr_gain.burns_per_orbit(5700.0, 2000.0) == 8


def turned(place: TargetOrbit, angle: float) -> TargetOrbit:
    """The same place on an orbit from a reference direction that is ahead by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return replace(
        place,
        argument_of_latitude=place.argument_of_latitude - angle,
        ex=c * place.ex + s * place.ey,
        ey=c * place.ey - s * place.ex,
    )


@pytest.mark.parametrize(("e", "burns"), [(0.1, 8), (0.3, 8), (0.5, 8), (0.7, 12), (0.7, 60)])
@pytest.mark.parametrize("delta_v_weight", [3e4, 1e6, 1e7])
def test_gains_midway_between_those_of_a_table_are_those_of_burns_there(
    params: Params, e: float, burns: int, delta_v_weight: float
) -> None:
    """A long control period: few burns in an orbit, between which a table of their gains alone errs by up to 70 %."""
    formation = weighted(params, delta_v_weight)
    tables = periodic_lqr_gain.tables_per_burn(e, burns)
    count = burns * tables
    gains = np.asarray(periodic_lqr_gains(formation, orbit(e), burns, tables))
    assert gains.shape == (count, 3, 6)
    np.testing.assert_allclose(gains[::tables], periodic_lqr_gains(formation, orbit(e), burns), rtol=1e-9)
    half = np.pi / count
    expected = np.asarray(periodic_lqr_gains(formation, turned(orbit(e), half), burns, tables))
    scale = np.array([1e3] * 3 + [1.0] * 3)
    error = np.abs((0.5 * (gains + np.roll(gains, -1, axis=0)) - expected) * scale).max(axis=(1, 2))
    assert np.max(error / np.abs(expected * scale).max(axis=(1, 2))) < 0.02


def test_one_table_suffices_where_burns_are_many() -> None:
    assert periodic_lqr_gain.tables_per_burn(0.1, 28) == 1
    assert periodic_lqr_gain.tables_per_burn(0.7, 177) == 1
    assert periodic_lqr_gain.tables_per_burn(0.7, 12) > 1
