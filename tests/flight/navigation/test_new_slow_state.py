"""A state that the package does not have: its one declaration is all that prediction, update and layout need."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene

from rpojax.core.pytree import replace
from rpojax.core.vectors import cross
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.navigation import (
    believed_sensor,
    combined_orbit_filter,
    lasting_error_effects,
    relative_filter_state,
)
from rpojax.flight.navigation.believed_sensor import SensorView
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.navigation.relative_filter_state import SLOW_STATES, SlowState

SIGMA = 0.02
"""Of the misalignment about each axis [rad]."""
MISALIGNMENT = np.array([0.015, -0.02, 0.01])
NOISE_M = 0.005
MISALIGNED_THRUST = SlowState(
    "thrust_misalignment",
    3,
    "rad",
    lambda tuning, r_TS_N: jnp.full(3, SIGMA**2),
    lambda tuning, errors, dt: (jnp.ones(3), jnp.zeros(3)),
    # A small rotation of the thrust about the axes of N.
    burn_effect=lambda effects, delta_v_N: jnp.stack([cross(axis, delta_v_N) for axis in jnp.eye(3)], axis=1),
)


@pytest.fixture
def states(monkeypatch: pytest.MonkeyPatch) -> tuple[SlowState, ...]:
    declared = (*SLOW_STATES, MISALIGNED_THRUST)
    monkeypatch.setattr(relative_filter_state, "SLOW_STATES", declared)
    return declared


def test_burns_teach_the_filter_the_misalignment_of_its_thrust(
    flight: FlightParams, states: tuple[SlowState, ...]
) -> None:
    tuning = replace(flight.navigation, burn_direction_sigma=jnp.asarray(1e-4), burn_scale_sigma=jnp.asarray(1e-4))
    servicer, relative = rendezvous_scene.estimate(flight).servicer, rendezvous_scene.estimate(flight).relative
    start = combined_orbit_filter.initial(
        tuning, servicer.r_SN_N, servicer.v_SN_N, relative.r_TS_N, relative.v_TS_N, states
    )
    turned = {**start.relative.slow, "thrust_misalignment": jnp.asarray(MISALIGNMENT)}
    truth = replace(start, relative=replace(start.relative, slow=turned))

    def second(
        carry: tuple[OrbitEstimate, OrbitEstimate], inputs: tuple[jax.Array, jax.Array]
    ) -> tuple[tuple[OrbitEstimate, OrbitEstimate], None]:
        delta_v, normals = inputs
        size = jnp.sqrt(jnp.sum(delta_v**2))
        truth, known = (
            combined_orbit_filter.predict(
                tuning, 2, each, delta_v, size, jnp.ones(()), jnp.zeros(3), lasting_error_effects.none(), 1.0
            )
            for each in carry
        )
        view = SensorView(
            tuning=tuning, relative=known.relative, q_BN=jnp.array([1.0, 0.0, 0.0, 0.0]), time=jnp.zeros(())
        )
        measured = truth.relative.r_TS_N + NOISE_M * normals
        rows = view.rows(lambda one: one.r_TS_N, measured, jnp.full(3, NOISE_M**2), jnp.asarray(True))
        after, _ = believed_sensor.update(tuning, True, known.relative, rows)
        return (truth, replace(known, relative=after)), None

    rng = np.random.default_rng(6)
    burns = np.where((np.arange(600) % 60 == 0)[:, None], rng.normal(size=(600, 3)) * 0.02, 0.0)
    noise = rng.normal(size=(600, 3))
    (_, known), _ = jax.jit(lambda start: jax.lax.scan(second, start, (jnp.asarray(burns), jnp.asarray(noise))))(
        (truth, start)
    )
    place = known.relative.layout["thrust_misalignment"]
    sigma = np.sqrt(np.diag(known.relative.covariance)[place])
    found = np.asarray(known.relative.slow["thrust_misalignment"])
    assert np.max(sigma) < 0.1 * SIGMA
    assert np.max(np.abs(found - MISALIGNMENT) / sigma) < 3.5
    assert np.max(np.abs(found - MISALIGNMENT)) < 2e-3
