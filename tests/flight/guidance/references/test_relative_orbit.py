"""Relative orbits against their textbook formulas and integrated free motion."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import ECCENTRICITIES, advanced, entry, integrated_free_motion, orbit, period

from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.flight.guidance.references import impulsive_tracking, relative_orbit
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit

free_motion = jax.jit(yamanaka_ankersen.free_motion)
state, tracked_point = jax.jit(relative_orbit.state), jax.jit(impulsive_tracking.tracked_point)


def begin(e: float) -> PhaseEntry:
    return entry(150.0, -900.0, 30.0, 0.0, -0.2, 0.05, e=e)


def reference(**changes: float) -> RelativeOrbit:
    values: dict[str, Any] = dict.fromkeys(
        ["radial", "radial_phase", "cross_track", "cross_track_phase", "along_track", "drift_per_orbit", "join"], 0.0
    )
    return RelativeOrbit(**{name: jnp.asarray(value) for name, value in {**values, **changes}.items()})


SAFE = reference(radial=30.0, radial_phase=1.0, cross_track=40.0, cross_track_phase=1.0)
WALKING = reference(
    radial=30.0, radial_phase=0.3, cross_track=40.0, cross_track_phase=0.9, along_track=-200.0, drift_per_orbit=55.0
)


def at(e: float, elapsed: float) -> tuple[TargetOrbit, jax.Array]:
    seconds = jnp.asarray(elapsed)
    return advanced(orbit(e), seconds), seconds


@pytest.mark.parametrize("share", [0.0, 0.2, 0.75])
def test_on_a_circular_orbit_it_is_the_safety_ellipse_of_the_textbook(share: float) -> None:
    """D'Amico and Montenbruck 2006, equation 5."""
    target, elapsed = at(0.0, share * period(0.0))
    u, n = float(target.argument_of_latitude), 2.0 * np.pi / period(0.0)
    expected = [
        -30.0 * np.cos(u - 1.0),
        60.0 * np.sin(u - 1.0),
        40.0 * np.sin(u - 1.0),
        30.0 * n * np.sin(u - 1.0),
        60.0 * n * np.cos(u - 1.0),
        40.0 * n * np.cos(u - 1.0),
    ]
    np.testing.assert_allclose(state(SAFE, begin(0.0), target, elapsed), expected, atol=1e-10)


def test_a_coelliptic_orbit_is_above_or_below_by_its_drift() -> None:
    """A lower orbit by da drifts ahead by 3 pi da in each period."""
    drifting = reference(drift_per_orbit=3.0 * np.pi * 100.0, along_track=-2000.0)
    start, later = (np.asarray(state(drifting, begin(0.0), *at(0.0, share * period(0.0)))) for share in (0.0, 1.0))
    np.testing.assert_allclose(start[:4], [-100.0, -2000.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(later[:4], [-100.0, -2000.0 + 300.0 * np.pi, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_it_is_a_free_motion(e: float) -> None:
    start = np.asarray(state(WALKING, begin(e), *at(e, 0.0)))
    seconds = 1.4 * period(e)
    expected = integrated_free_motion(e, orbit(e), start, seconds)
    found = np.asarray(state(WALKING, begin(e), *at(e, seconds)))
    np.testing.assert_allclose(found[:3], expected[:3], atol=1e-6 * np.max(np.abs(expected[:3])))
    np.testing.assert_allclose(found[3:], expected[3:], atol=1e-6 * np.max(np.abs(expected[3:])))


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_parallel_vectors_keep_clear_of_the_along_track_axis_and_perpendicular_ones_do_not(e: float) -> None:
    crossing = reference(radial=30.0, radial_phase=1.0, cross_track=40.0, cross_track_phase=1.0 + np.pi / 2.0)

    def clearance(followed: RelativeOrbit) -> float:
        shares = np.linspace(0.0, 1.0, 2001) * period(e)
        targets = jax.vmap(advanced, in_axes=(None, 0))(orbit(e), shares)
        states = jax.vmap(state, in_axes=(None, None, 0, 0))(followed, begin(e), targets, shares)
        return float(np.min(np.linalg.norm(np.asarray(states)[:, [0, 2]], axis=1)))

    assert clearance(SAFE) >= min(30.0, 40.0 / (1.0 + e)) - 1e-9
    assert clearance(crossing) < 0.5


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_a_join_from_the_targets_own_orbit_is_nearly_free_and_keeps_clear_of_the_target(e: float) -> None:
    """From 1500 m behind in two orbits; a forced straight line would take twice the mean motion times it, 3 m/s."""
    at_start = orbit(e)
    behind = -1500.0 * jnp.array([1.0, at_start.ey, -at_start.ex, 0.0, 0.0, 0.0])
    joining = reference(radial=30.0, radial_phase=0.3, cross_track=40.0, cross_track_phase=0.3, join=2.0 * period(e))
    far = PhaseEntry(relative_state=free_motion(at_start, jnp.asarray(0.0), behind), orbit=at_start)
    interval = period(e) / 30.0
    burns = jnp.arange(63.0) * interval
    places = jax.vmap(advanced, in_axes=(None, 0))(orbit(e), burns)
    positions = jax.vmap(state, in_axes=(None, None, 0, 0))(joining, far, places, burns)[:, :3]
    three = jnp.arange(len(burns) - 2)[:, None] + jnp.arange(3)[None]
    burn = jax.vmap(tracked_point, in_axes=(0, None, 0))
    impulses = burn(jax.tree.map(lambda x: x[three], places), interval, positions[three])
    assert float(jnp.sum(jnp.linalg.norm(impulses.impulse, axis=1))) < 0.35
    assert float(jnp.min(jnp.linalg.norm(positions, axis=1))) > 25.0


@pytest.mark.parametrize("e", ECCENTRICITIES)
def test_it_is_reached_at_the_end_of_the_join(e: float) -> None:
    joining = reference(radial=30.0, radial_phase=0.3, cross_track=40.0, cross_track_phase=0.9, join=1.5 * period(e))
    at_once = reference(radial=30.0, radial_phase=0.3, cross_track=40.0, cross_track_phase=0.9)
    np.testing.assert_allclose(state(joining, begin(e), *at(e, 0.0)), begin(e).relative_state, atol=1e-9)
    for share in (1.5, 2.1):
        target, elapsed = at(e, share * period(e))
        found, expected = state(joining, begin(e), target, elapsed), state(at_once, begin(e), target, elapsed)
        np.testing.assert_allclose(found, expected, atol=1e-9)
