"""Correlation times of the errors that come from the target's shape."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.core.pytree import replace
from rpojax.flight.navigation import shape_errors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.flight.navigation.shape_errors import ShapeErrors
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


@jax.jit
def errors_at(tuning: OrbitFilterTuning, time: float, slow_scale: float, r: jax.Array, v: jax.Array) -> ShapeErrors:
    return shape_errors.shape_errors(tuning, jnp.asarray(time), jnp.asarray(slow_scale), r, v)


def test_every_error_has_the_variance_and_the_time_of_its_causes() -> None:
    tuning = replace(
        TUNING,
        target_size=jnp.asarray(1.5),
        target_size_sigma=jnp.asarray(0.2),
        scale_sigma=jnp.array([0.1, 0.05]),
        scale_time_constant=jnp.array([600.0, 40.0]),
        outline_time_constant=jnp.asarray(50.0),
        center_time_constant=jnp.asarray(70.0),
        center_sigma=jnp.asarray(0.04),
        center_perspective=jnp.asarray(0.3),
        detector_boxes=jnp.asarray(1.0),
        detector_center_sigma=jnp.asarray(0.03),
    )
    rate, r = 2.2e-3, jnp.array([3.0, -24.0, 18.0])
    v = rate * jnp.cross(jnp.array([1.0, 0.0, 0.0]), r) + 0.01 * r
    # The part of the line of sight that turns: 30 m across, of a range squared of 909 m^2.
    turn = rate * 30.0 / np.sqrt(909.0)
    found = errors_at(tuning, 100.0, 0.1, r, v)
    perspective = (0.3 * (1.5 * np.exp(0.1)) ** 2) ** 2 / 909.0
    np.testing.assert_allclose(found.scale_variance, [0.1**2 + 0.2**2, 0.05**2], rtol=1e-12)
    np.testing.assert_allclose(found.center_variance, 0.04**2 + 0.03**2 + perspective, rtol=1e-12)
    np.testing.assert_allclose(found.center_time_constant, 2.0 * 70.0, rtol=1e-12)
    # As good as the turn rate alone: a rate of a fortieth of the nominal one is added in quadrature.
    time = 600.0 * 1.1e-3 / turn
    np.testing.assert_allclose(found.scale_time_constant, [5.0 * time, 2.0 * 40.0], rtol=2e-4)
    np.testing.assert_allclose(found.bearing_process_variance, 2.0 * 0.33**2 * perspective / 909.0 / time, rtol=2e-4)

    known = errors_at(replace(tuning, target_size_sigma=jnp.asarray(0.0)), 100.0, 0.1, r, v)
    growth, of_known = (2.0 * each.scale_variance[0] / each.scale_time_constant[0] for each in (found, known))
    np.testing.assert_allclose(growth, of_known, rtol=1e-12)  # a constant error grows no more
    geometric = errors_at(replace(tuning, detector_boxes=jnp.asarray(0.0)), 100.0, 0.1, r, v)
    np.testing.assert_allclose(geometric.center_variance, 0.04**2 + perspective, rtol=1e-12)
