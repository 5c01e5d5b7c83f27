"""Properties that all reference trajectories have in common."""

from functools import partial
from types import ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from relative_motion_cases import entry, orbit, period

from rpojax.batching.vmap_last_axis import vmap
from rpojax.core.orbits import yamanaka_ankersen
from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import replace
from rpojax.flight.guidance.references import approach, fly_around, hold, relative_orbit, retreat, transfer
from rpojax.flight.guidance.references.phase_entry import PhaseEntry

AT = orbit(0.0)
ENTRY = entry(12.0, -140.0, 8.0, 0.02, 0.01, -0.015)


def numbers(**values: Any) -> dict[str, jax.Array]:
    return {name: jnp.asarray(value, dtype=jnp.float64) for name, value in values.items()}


ORBIT = numbers(
    radial=20.0, radial_phase=0.4, cross_track=25.0, cross_track_phase=0.5, along_track=-60.0, drift_per_orbit=7.0
)
TRANSFER = numbers(position=[0.0, -50.0, 4.0], duration=1500.0, speed_ratio=0.2)
KINDS: dict[str, tuple[ModuleType, Any]] = {
    "hold": (hold, hold.Hold(**numbers(position=[0.0, -30.0, 5.0]))),
    "relative_orbit": (relative_orbit, relative_orbit.RelativeOrbit(**ORBIT, **numbers(join=0.0))),
    "relative_orbit_joined": (relative_orbit, relative_orbit.RelativeOrbit(**ORBIT, **numbers(join=3000.0))),
    "transfer": (transfer, transfer.Transfer(**TRANSFER, **numbers(pulses=2.0))),
    "glide_slope": (transfer, transfer.Transfer(**TRANSFER, **numbers(pulses=6.0))),
    "fly_around": (
        fly_around,
        fly_around.FlyAround(**numbers(radius=40.0, axis=[0.2, 0.3, 2.0], rate=1e-3, join=900.0)),
    ),
    "fly_around_from_an_angle": (
        fly_around,
        fly_around.FlyAround(**numbers(radius=40.0, axis=[0.0, 1.0, 0.0], rate=1e-3, join=0.0, start=0.3)),
    ),
    "approach": (
        approach,
        approach.Approach(
            **numbers(end_position=[0.0, -12.0, 0.0], max_speed=0.1, time_constant=400.0, final_speed=0.02)
        ),
    ),
    "retreat": (retreat, retreat.Retreat(**numbers(distance=400.0, speed=0.1))),
}
TIMES = [-150.0, 20.0, 700.0, 1340.0, 5000.0]
every_kind = pytest.mark.parametrize("kind", sorted(KINDS))


def along_the_orbit(
    module: ModuleType, reference: Any, start: PhaseEntry, at: TargetOrbit, elapsed: jax.Array
) -> jax.Array:
    """State `elapsed` [s] after the entry, on an orbit known at the entry."""
    return module.state(reference, start, yamanaka_ankersen.advanced(at, elapsed), elapsed)


@partial(jax.jit, static_argnums=0)
def with_slopes(
    module: ModuleType, reference: Any, start: PhaseEntry, at: TargetOrbit, elapsed: jax.Array
) -> tuple[tuple[Any, PhaseEntry, jax.Array], jax.Array]:
    """Derivatives to the reference, the entry and the time, and the state: one program for all tests."""

    def state(reference: Any, start: PhaseEntry, elapsed: jax.Array) -> tuple[jax.Array, jax.Array]:
        found = along_the_orbit(module, reference, start, at, elapsed)
        return found, found

    return jax.jacrev(state, argnums=(0, 1, 2), has_aux=True)(reference, start, elapsed)


def state(kind: str, elapsed: float) -> np.ndarray:
    return np.asarray(with_slopes(*KINDS[kind], ENTRY, orbit(0.3), jnp.asarray(elapsed))[1])


@every_kind
def test_the_velocity_is_the_derivative_of_the_position(kind: str) -> None:
    for elapsed in TIMES:
        (_, _, slope), _ = with_slopes(*KINDS[kind], ENTRY, orbit(0.3), jnp.asarray(elapsed))
        np.testing.assert_allclose(state(kind, elapsed)[3:], slope[:3], atol=1e-12, err_msg=f"{elapsed} s")


@partial(jax.jit, static_argnums=0)
def batched(module: ModuleType, *arguments: Any) -> jax.Array:
    """States (6, times) by the transform of campaigns."""
    return vmap(partial(along_the_orbit, module), in_axes=(None, None, None, -1), out_axes=-1)(*arguments)


@every_kind
def test_a_batch_in_single_precision_agrees_with_single_runs_in_double(kind: str) -> None:
    module, reference = KINDS[kind]
    double = np.stack([state(kind, elapsed) for elapsed in TIMES], axis=-1)
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (reference, ENTRY, orbit(0.3), jnp.asarray(TIMES)))
    found = batched(module, *single)
    assert found.dtype == jnp.float32
    scale = np.array([1.0] * 3 + [1e-3] * 3)[:, None]
    # Positions are sums of terms of up to some 1000 m, each with some roundings of 6e-8.
    np.testing.assert_allclose(np.asarray(found) / scale, double / scale, atol=0.01)


@every_kind
def test_derivatives_to_the_parameters_agree_with_differences(kind: str) -> None:
    module, reference = KINDS[kind]
    # A reference joined at once is another than one joined soon, and impulses are counted in whole numbers.
    names = [name for name, value in vars(reference).items() if value is not None and name != "pulses"]
    names = [name for name in names if name != "join" or float(reference.join) > 0.0]
    for elapsed in (20.0, 700.0, 5000.0):
        (slopes, _, _), _ = with_slopes(module, reference, ENTRY, orbit(0.3), jnp.asarray(elapsed))
        for name in names:
            value = np.asarray(getattr(reference, name))
            step = 1e-5 * max(float(np.max(np.abs(value))), 1e-2) * np.eye(value.size)[0].reshape(value.shape)
            above, below = (
                with_slopes(module, replace(reference, **{name: jnp.asarray(value + sign * step)}), ENTRY, orbit(0.3),
                            jnp.asarray(elapsed))[1] for sign in (1.0, -1.0)
            )  # fmt: skip
            expected = np.asarray(above - below) / (2.0 * np.max(step))
            found = np.asarray(getattr(slopes, name)).reshape(6, -1)[:, 0]
            largest = max(1.0, float(np.max(np.abs(expected))))
            np.testing.assert_allclose(found, expected, atol=1e-6 * largest, err_msg=f"{name} at {elapsed} s")


@every_kind
def test_derivatives_at_the_target_and_at_rest_are_finite(kind: str) -> None:
    start = entry(*[0.0] * 6)
    (_, slopes, _), _ = with_slopes(*KINDS[kind], start, orbit(0.3), jnp.asarray(50.0))
    assert bool(jnp.all(jnp.isfinite(slopes.relative_state)))


@pytest.mark.parametrize(
    "kind", ["transfer", "glide_slope", "approach", "retreat", "relative_orbit_joined", "fly_around"]
)
def test_references_from_the_entry_begin_there_and_continue_the_motion_before_it(kind: str) -> None:
    np.testing.assert_allclose(state(kind, 0.0)[:3], ENTRY.relative_state[:3], atol=1e-9)
    np.testing.assert_allclose(state(kind, -1e-9), ENTRY.relative_state, atol=1e-8)


@pytest.mark.parametrize("kind", ["hold", "transfer", "glide_slope", "approach", "retreat"])
def test_references_with_an_end_stay_there_at_rest(kind: str) -> None:
    module, reference = KINDS[kind]
    end = module.end_position(reference, ENTRY)
    np.testing.assert_allclose(state(kind, 2e4), np.concatenate([end, np.zeros(3)]), atol=1e-9)


def osculating(at: TargetOrbit, elapsed: jax.Array) -> TargetOrbit:
    """Orbit after a time as flight software sees it: with oblateness, elements go to and fro twice in an orbit."""
    place = yamanaka_ankersen.advanced(at, elapsed)
    c, s = jnp.cos(2.0 * place.argument_of_latitude), jnp.sin(2.0 * place.argument_of_latitude)
    return replace(
        place, ex=place.ex + 1e-3 * c, ey=place.ey + 1e-3 * s, semi_major_axis=place.semi_major_axis + 9.6e3 * c
    )


FROM_AN_ELLIPSE = entry(5.0, 45.0, 28.0, 0.02, 0.01, 0.01, e=0.0)
BESIDE = numbers(position=[0.0, 40.0, 0.0], speed_ratio=1.0, pulses=2.0)
MOVING = {kind: KINDS[kind] for kind in sorted(KINDS) if kind != "relative_orbit"} | {
    "transfer_in_half_an_orbit": (transfer, transfer.Transfer(**BESIDE, **numbers(duration=0.51 * period(0.0)))),
    "transfer_in_an_orbit": (transfer, transfer.Transfer(**BESIDE, **numbers(duration=period(0.0)))),
    "transfer_in_two_orbits": (transfer, transfer.Transfer(**BESIDE, **numbers(duration=2.0 * period(0.0)))),
}


@partial(jax.jit, static_argnums=0)
def states_on_osculating_orbits(module: Any, reference: Any, times: jax.Array) -> jax.Array:
    return jax.vmap(lambda seconds: module.state(reference, FROM_AN_ELLIPSE, osculating(AT, seconds), seconds))(times)


@jax.jit
def states_of_transfer(followed: transfer.Transfer, start: PhaseEntry, times: jax.Array) -> jax.Array:
    return jax.vmap(lambda seconds: transfer.state(followed, start, start.orbit, seconds))(times)


@pytest.mark.parametrize("kind", MOVING)
def test_a_reference_moves_smoothly_while_the_osculating_orbit_changes(kind: str) -> None:
    """In a second by what its speed says: ten times in an orbit, and around the times at which it may turn."""
    module, reference = MOVING[kind]
    times = np.concatenate([np.linspace(1.0, 2.2 * period(0.0), 4001), 0.51 * period(0.0) + np.arange(-30.0, 30.0)])
    here, later = (np.asarray(states_on_osculating_orbits(module, reference, times + step)) for step in (0.0, 1.0))
    moved = np.linalg.norm(later[:, :3] - here[:, :3], axis=1)
    speed = np.maximum(np.linalg.norm(here[:, 3:], axis=1), np.linalg.norm(later[:, 3:], axis=1))
    assert np.all(moved < 1.05 * speed + 0.02)
    assert np.max(moved) < 0.3


@pytest.mark.parametrize("place", np.linspace(0.0, 2.0 * np.pi, 7)[:-1])
def test_half_an_orbit_from_an_ellipse_does_not_swing_across_the_track(place: float) -> None:
    """3000 s from 25 by 50 by 30 m to 40 m ahead: two impulses alone would swing by 150 m."""
    c, s = np.cos(place), np.sin(place)
    n = 2.0 * np.pi / period(0.0)
    start = entry(-25.0 * c, 50.0 * s, 30.0 * s, 25.0 * n * s, 50.0 * n * c, 30.0 * n * c, e=0.0)
    followed = transfer.Transfer(**BESIDE, **numbers(duration=3000.0))
    states = np.asarray(states_of_transfer(followed, start, np.linspace(0.0, 2999.0, 500)))
    assert np.max(np.abs(states[:, 2])) < 45.0
    np.testing.assert_allclose(states[-1, :3], [0.0, 40.0, 0.0], atol=0.2)


@pytest.mark.parametrize("kind", ["transfer_in_half_an_orbit", "transfer_in_an_orbit", "transfer_in_two_orbits"])
def test_a_transfer_near_a_singular_time_has_finite_derivatives_to_all_that_it_begins_with(kind: str) -> None:
    (*slopes, _), _ = with_slopes(*MOVING[kind], FROM_AN_ELLIPSE, AT, jnp.asarray(2500.0))
    assert all(np.all(np.isfinite(each)) for each in jax.tree.leaves(slopes))
