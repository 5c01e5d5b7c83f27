"""Visibility of the target by light, phase angle and Sun exclusion."""

import jax
import numpy as np
import rendezvous_scene
from numpy_reference import (
    unit,
)

from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import (
    target_visibility,
)
from rpojax.flight.navigation.combined_orbit_filter import OrbitEstimate

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
