"""Visibility of the target by light, phase angle and Sun exclusion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import (
    unit,
)

from rpojax.core import quaternion
from rpojax.core.lamp import Lamp
from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import (
    target_pointing,
    target_visibility,
)
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate
from rpojax.flight.vehicle_model import VehicleModel

is_visible = jax.jit(target_visibility.is_visible)


def test_visibility_ends_at_the_phase_limit_the_sun_exclusion_and_in_the_shadow(
    flight: FlightParams, known: OrbitEstimate
) -> None:
    line, up = unit(rendezvous_scene.TARGET_AHEAD), unit(rendezvous_scene.R_SN_N)

    def seen(phase_deg: float) -> bool:
        """The Sun at an angle from the direction target to servicer, leaning to the zenith."""
        phase = np.deg2rad(phase_deg)
        sun = 1.5e11 * (-np.cos(phase) * line + np.sin(phase) * up)
        return bool(is_visible(flight.vehicle, known, sun))

    assert seen(90.0)
    assert seen(149.9)
    assert not seen(150.1)  # both limits: a crescent, and the Sun 30 deg from the view
    assert not bool(is_visible(flight.vehicle, known, rendezvous_scene.SUN_BEHIND_EARTH))


def with_lamp(flight: FlightParams, reach: float) -> VehicleModel:
    """The vehicle with a lamp along the camera's boresight."""
    boresight = jnp.array([1.0, 0.0, 0.0])
    return replace(
        flight.vehicle,
        lamp=Lamp(boresight=boresight, beam_half_angle=jnp.deg2rad(15.0), reach=jnp.float64(reach)),
    )


@pytest.mark.parametrize(("reach", "seen"), [(31.0, True), (29.0, False)])
def test_in_the_shadow_the_target_is_visible_within_the_reach_of_the_lamp(
    flight: FlightParams, known: OrbitEstimate, reach: float, seen: bool
) -> None:
    dark, vehicle = rendezvous_scene.SUN_BEHIND_EARTH, with_lamp(flight, reach)
    assert bool(is_visible(vehicle, known, dark)) is seen
    assert bool(jax.jit(target_visibility.is_in_sight)(vehicle, known, dark)) is seen
    later = jax.jit(target_visibility.is_in_sight_after)
    assert bool(later(vehicle, known, rendezvous_scene.SUN_OVERHEAD, jnp.pi)) is seen
    assert not bool(later(flight.vehicle, known, rendezvous_scene.SUN_OVERHEAD, jnp.pi))


def test_a_box_in_the_shadow_is_expected_where_the_beam_is(flight: FlightParams, known: OrbitEstimate) -> None:
    dark, vehicle = rendezvous_scene.SUN_BEHIND_EARTH, with_lamp(flight, 60.0)
    ahead, _ = target_pointing.look_attitude(vehicle, known)
    turned = quaternion.multiply(quaternion.exp(jnp.array([0.0, 0.0, np.deg2rad(20.0)])), ahead)
    assert bool(is_visible(vehicle, known, dark, 0.0, ahead))
    assert not bool(is_visible(vehicle, known, dark, 0.0, turned))
    assert bool(is_visible(vehicle, known, dark, np.deg2rad(6.0), turned))
