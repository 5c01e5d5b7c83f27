"""Choice of the lens: hysteresis over the range, and what flight software believes of the lens in use."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene

from rpojax.core.pytree import replace
from rpojax.flight import computer
from rpojax.flight.flight_records import FlightMemory, FlightParams
from rpojax.flight.flight_software import FlightSoftware
from rpojax.flight.guidance import lens_choice
from rpojax.flight.guidance.detector_window import CameraFormat
from rpojax.flight.guidance.lens_choice import BelievedWideLens, LensInUse

WIDE = BelievedWideLens(
    focal_px=jnp.float64(300.0),
    switch_range=jnp.float64(12.0),
    return_range=jnp.float64(15.0),
    misalignment_sigma=jnp.float64(1e-3),
)
LARGE = CameraFormat(width_px=768, height_px=768, input_px=128)


def lens(is_wide: bool, was_wide: bool | None = None) -> LensInUse:
    was = is_wide if was_wide is None else was_wide
    return LensInUse(is_wide=jnp.asarray(is_wide), was_wide=jnp.asarray(was))


def test_the_lens_changes_at_different_ranges_on_the_way_in_and_out() -> None:
    change = jax.jit(lens_choice.next_lens)
    in_use = lens_choice.first_lens(WIDE, jnp.float64(20.0))
    found = []
    for distance in (20.0, 14.0, 12.1, 11.9, 12.1, 14.9, 15.1, 14.0):
        in_use = change(WIDE, in_use, jnp.float64(distance))
        found.append((bool(in_use.is_wide), bool(in_use.is_wide != in_use.was_wide)))
        in_use = lens_choice.after_frame(in_use, in_use)
    assert found == [
        (False, False), (False, False), (False, False), (True, True), (True, False), (True, False), (False, True),
        (False, False),
    ]  # fmt: skip
    assert bool(lens_choice.first_lens(WIDE, jnp.float64(11.0)).is_wide)


def test_only_the_frame_after_a_change_adds_the_misalignment_of_the_lenses() -> None:
    assert float(lens_choice.misalignment_variance(WIDE, lens(True, False))) == pytest.approx(1e-6)
    assert float(lens_choice.misalignment_variance(WIDE, lens(False, True))) == pytest.approx(1e-6)
    assert float(lens_choice.misalignment_variance(WIDE, lens(True, True))) == 0.0


def test_beliefs_are_those_of_the_lens_in_use(flight: FlightParams) -> None:
    two = replace(flight, wide_lens=replace(WIDE, edge_noise=jnp.float64(2.5)))
    wide, own = two.seen_through(lens(True)), two.seen_through(lens(False))
    assert (float(wide.vehicle.focal_px), float(wide.navigation.edge_noise)) == (300.0, 2.5)
    for name in ("focal_px", "mass"):
        assert float(getattr(own.vehicle, name)) == float(getattr(flight.vehicle, name))
    assert float(own.navigation.edge_noise) == float(flight.navigation.edge_noise)
    alone = replace(flight, wide_lens=WIDE).seen_through(lens(True))
    assert float(alone.navigation.edge_noise) == float(flight.navigation.edge_noise)
    assert flight.seen_through(None) is flight


def at_range(flight: FlightParams, distance: float) -> tuple[FlightSoftware, FlightMemory]:
    """Flight software at its start, with the target ahead at a distance [m] and tracked."""
    software = rendezvous_scene.software(flight, camera=LARGE)
    ahead = distance * rendezvous_scene.TARGET_AHEAD / np.linalg.norm(rendezvous_scene.TARGET_AHEAD)
    orbit = rendezvous_scene.estimate(flight, r_TS_N=ahead)
    memory = computer.initial(software, orbit, jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(3))
    tracked = {"acquired": jnp.asarray(True), "unseen_time": jnp.zeros(())}
    return software, replace(memory, pointing=rendezvous_scene.with_acquisition(memory.pointing, **tracked))


def test_the_window_is_that_of_the_lens_in_use(flight: FlightParams) -> None:
    two = replace(flight, wide_lens=WIDE)
    alone = replace(flight, vehicle=replace(flight.vehicle, focal_px=WIDE.focal_px))
    for distance, same in ((11.0, alone), (20.0, flight)):
        found = computer.command_camera(*at_range(two, distance), jnp.zeros(()))
        expected = computer.command_camera(*at_range(same, distance), jnp.zeros(()))
        assert found.lens is not None
        assert bool(found.lens.is_wide) is (same is alone)
        jax.tree.map(np.testing.assert_array_equal, found.camera, expected.camera)


def test_the_range_has_a_finite_gradient_through_the_choice() -> None:
    def size_px(distance: jax.Array) -> jax.Array:
        wide = lens_choice.next_lens(WIDE, lens(False), distance).is_wide
        return jnp.where(wide, WIDE.focal_px, 900.0) / distance

    slope = jax.jit(jax.grad(size_px))
    np.testing.assert_allclose(slope(11.0), -300.0 / 11.0**2)
    np.testing.assert_allclose(slope(13.0), -900.0 / 13.0**2)
    assert np.isfinite(slope(12.0))
