"""Slew profile: rest to rest, peak acceleration, and consistency of attitude, rate and acceleration."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy_reference import (
    SEEDS,
    attitude_difference,
    random_unit,
    rate_between,
)
from simulated_guidance import evaluate

from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import (
    slew_profile,
)
from rpojax.flight.guidance.slew_profile import SlewReference
from rpojax.scenario.params import Params

EXACT = 1e-12  # roundings of unit vectors and angles
slew_duration = jax.jit(slew_profile.slew_duration)


def slew_of(angle: float, end_rate: np.ndarray, flight: FlightParams, seed: int = 0) -> SlewReference:
    rng = np.random.default_rng(seed)
    return SlewReference(
        q_EN=random_unit(rng, 4),
        omega_EN_E=end_rate,
        remainder=angle * random_unit(rng),
        slew_age=np.float64(0.0),
        slew_time=np.asarray(slew_duration(flight.pointing, np.float64(angle))),
    )


@pytest.mark.parametrize("angle", [0.0, 0.05, 1.0, np.pi])
def test_a_slew_starts_and_ends_at_rest_relative_to_its_end_and_turns_by_its_angle(
    flight: FlightParams, angle: float
) -> None:
    reference = slew_of(angle, np.zeros(3), flight)
    first, last = evaluate(reference, np.float64(0.0)), evaluate(reference, reference.slew_time)
    for command in (first, last):
        np.testing.assert_allclose(command.omega_CN_C, np.zeros(3), atol=EXACT)
        np.testing.assert_allclose(command.acceleration_C, np.zeros(3), atol=EXACT)
    np.testing.assert_allclose(attitude_difference(np.asarray(first.q_CN), reference.q_EN), angle, atol=1e-7)
    assert attitude_difference(np.asarray(last.q_CN), reference.q_EN) < EXACT
    later = evaluate(reference, reference.slew_time + 20.0)
    assert attitude_difference(np.asarray(later.q_CN), reference.q_EN) < EXACT


@given(st.floats(0.5, 3.1))
def test_the_largest_acceleration_of_a_slew_is_the_planned_one(params: Params, angle: float) -> None:
    reference = slew_of(angle, np.zeros(3), params.flight)
    peak = evaluate(reference, 0.25 * reference.slew_time).acceleration_C
    np.testing.assert_allclose(np.linalg.norm(peak), 0.016, rtol=1e-12)


def test_short_slews_take_the_minimum_time(flight: FlightParams) -> None:
    times = [float(slew_duration(flight.pointing, np.float64(angle))) for angle in (0.0, 0.01, 0.05)]
    assert times == [6.0, 6.0, 6.0]


@given(SEEDS)
def test_commanded_rate_and_acceleration_are_the_derivatives_of_the_commanded_attitude(
    params: Params, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    reference = slew_of(rng.uniform(0.3, 3.0), 1e-3 * rng.normal(size=3), params.flight, seed)
    age, h = rng.uniform(0.05, 0.95) * float(reference.slew_time), 1e-4
    before, now, after = (evaluate(reference, np.float64(age + shift)) for shift in (-h, 0.0, h))
    omega = rate_between(np.asarray(before.q_CN), np.asarray(after.q_CN), 2 * h)
    np.testing.assert_allclose(now.omega_CN_C, omega, atol=1e-8)
    derivative = (np.asarray(after.omega_CN_C) - np.asarray(before.omega_CN_C)) / (2 * h)
    # The command neglects the rotation of the end rate by the slew: below the product of both rates.
    np.testing.assert_allclose(now.acceleration_C, derivative, atol=4e-3 * 0.2)
