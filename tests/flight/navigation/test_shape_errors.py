"""Correlation times of the errors that come from the target's shape."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.flight.navigation import shape_errors
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.team.members import member_params

TUNING = member_params(scenario_loader.load("inspection"))[0].flight.navigation
R = jnp.array([0.0, -30.0, 0.0])


def slow_time(v: jax.Array, r: jax.Array = R) -> jax.Array:
    """Correlation time of the slow part of the size [s] of a target at `r` that moves by `v`."""
    return shape_errors.shape_errors(TUNING, TUNING.outline_time_constant, jnp.zeros(()), r, v).scale_time_constant[0]


@pytest.mark.parametrize("period_s", [5700.0, 20000.0, 43000.0])
def test_slow_part_lasts_for_the_same_turn_of_the_line_of_sight_on_any_orbit(period_s: float) -> None:
    rate = 2.0 * np.pi / period_s
    along, away = slow_time(jnp.array([30.0 * rate, 0.0, 0.0])), slow_time(jnp.array([30.0 * rate, 0.03, 0.0]))
    assert float(along) * rate == pytest.approx(600.0 * 1.1e-3, rel=0.04)
    assert float(away) == pytest.approx(float(along), rel=1e-6), "motion along the line of sight does not turn it"
    assert float(slow_time(jnp.array([60.0 * rate, 0.0, 0.0]), 2.0 * R)) == pytest.approx(float(along), rel=1e-6)


def test_slow_part_lasts_neither_for_ever_nor_for_seconds_only() -> None:
    assert float(slow_time(jnp.zeros(3))) == pytest.approx(40.0 * 600.0)
    assert float(slow_time(jnp.array([5.0, 0.0, 0.0]))) == pytest.approx(150.0)


@pytest.mark.parametrize(("declared", "longest"), [((600.0, 30.0), 600.0), ((900.0, 30.0), 900.0)])
def test_the_fast_part_is_no_slower_than_the_slow_one_as_declared(
    declared: tuple[float, float], longest: float
) -> None:
    tuning = replace(TUNING, scale_time_constant=jnp.array(declared))
    times = [
        float(
            shape_errors.shape_errors(
                tuning, tempo * tuning.outline_time_constant, jnp.zeros(()), R, R
            ).scale_time_constant[1]
        )
        for tempo in (2.0, 25.0, 150.0)
    ]
    assert times == pytest.approx([60.0, min(25.0 * 30.0, longest), longest])


def test_derivative_is_defined_without_motion() -> None:
    gradient = jax.grad(slow_time)(jnp.zeros(3))
    np.testing.assert_array_equal(gradient, 0.0)


def test_bearing_walks_by_the_same_variance_for_the_same_turn() -> None:
    def walk(rate: float) -> float:
        v = jnp.array([30.0 * rate, 0.0, 0.0])
        errors = shape_errors.shape_errors(TUNING, TUNING.outline_time_constant, jnp.zeros(()), R, v)
        return float(errors.bearing_process_variance) / rate

    assert walk(5e-4) == pytest.approx(walk(2e-3), rel=2e-3)
