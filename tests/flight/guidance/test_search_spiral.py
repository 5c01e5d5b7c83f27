"""Search spiral: coverage of the search cone and speed of the camera."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import rendezvous_scene
from numpy_reference import (
    rotation_matrix,
    unit,
)
from scipy.spatial.transform import Rotation
from simulated_guidance import SAMPLES, boresight, simulate_search

from rpojax.core.pytree import replace
from rpojax.flight.flight_records import FlightParams
from rpojax.flight.guidance import search_spiral
from rpojax.flight.guidance.pointing_modes import Mode


@pytest.mark.parametrize(("radius_deg", "dt"), [(8.0, 1.0), (20.0, 1.0), (44.0, 1.0), (20.0, 0.2), (44.0, 5.0)])
def test_the_frames_of_a_search_cover_its_cone_at_any_rate_of_the_camera(
    flight: FlightParams, radius_deg: float, dt: float
) -> None:
    # The cone is three sigma of the bearing's uncertainty as guidance takes it, sqrt(2) of one axis.
    sigma = np.deg2rad(radius_deg) / 3.0 / np.sqrt(2.0) * 30.0
    modes, attitudes = simulate_search(flight, sigma, int(300 / min(dt, 1.0)), dt)
    assert np.all(modes[20:] == Mode.SEARCH)
    cameras = np.array([rotation_matrix(q) for q in attitudes[:, 0]])  # one frame a tick
    line = unit(rendezvous_scene.TARGET_AHEAD)
    across = unit(np.cross(line, [0.0, 0.0, 1.0]))
    other = np.cross(line, across)
    rng = np.random.default_rng(1)
    # The last turn may end a pitch of 6.5 deg inside of the rim, and the view reaches 5 deg to each side.
    distance = np.deg2rad(radius_deg - 1.5) * np.sqrt(rng.uniform(size=1000))[:, None]
    around = rng.uniform(0.0, 2.0 * np.pi, (1000, 1))
    targets = np.cos(distance) * line + np.sin(distance) * (np.cos(around) * across + np.sin(around) * other)
    ahead, right, down = np.moveaxis(np.einsum("kij,nj->kni", cameras, targets), 2, 0)
    half = np.tan(np.deg2rad(5.0)) * ahead
    in_view = (ahead > 0.0) & (np.abs(right) < half) & (np.abs(down) < half)
    assert np.all(np.any(in_view, axis=0))
    farthest = np.rad2deg(np.arccos(np.clip(cameras[:, 0] @ line, -1.0, 1.0))).max()
    assert farthest < radius_deg + 3.0  # the step of a second, at the speed of the outer turns


def test_the_angular_velocity_of_a_search_is_that_of_its_rotation_vector(flight: FlightParams) -> None:
    pointing = flight.pointing
    pitch, acceleration = float(pointing.search_pitch), float(pointing.search_acceleration)
    # Half a pitch a second is reached where the centripetal acceleration allows it.
    near = (0.5 * pitch) ** 2 / acceleration
    at_full_speed = near**1.5 * np.pi / (0.75 * pitch * np.sqrt(acceleration))
    area_rate = 0.5 * pitch**2 / (2.0 * np.pi)
    first = at_full_speed + (np.cos(near) - np.cos(np.deg2rad(45.0))) / area_rate
    assert 3.0 < at_full_speed < first - 10.0
    times = np.concatenate(
        [
            np.linspace(0.5, at_full_speed - 2.0, 6),
            np.linspace(at_full_speed, first - 1.0, 6),
            first + np.linspace(0.5, 3.0 * first, 8),
        ]
    )
    offset = jax.jit(jax.vmap(lambda time: search_spiral.spiral_offset(pointing, time)))
    step = 1e-4
    (before, _), (vector, rate), (after, _) = (offset(times + shift) for shift in (-step, 0.0, step))
    turned = Rotation.from_rotvec(np.array(before)).inv() * Rotation.from_rotvec(np.array(after))
    np.testing.assert_allclose(rate, turned.as_rotvec() / (2.0 * step), rtol=1e-5, atol=1e-8)
    # The spiral is left a second after its middle.
    np.testing.assert_allclose(np.linalg.norm(offset(np.array([at_full_speed - 1.0]))[0][0]), near, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(offset(np.array([first - 1.0]))[0][0]), np.deg2rad(45.0), rtol=1e-9)
    # Turns are a pitch apart: the angle in the plane grows by 2 pi a pitch.
    turns = np.linalg.norm(np.asarray(vector), axis=1) / pitch
    angle = np.arctan2(vector[:, 1], vector[:, 0]) / (2.0 * np.pi)
    np.testing.assert_allclose(np.remainder(turns - angle + 0.5, 1.0), 0.5, atol=1e-9)


def test_a_search_of_all_directions_shows_nearly_all_in_two_frames_within_a_few_seconds(flight: FlightParams) -> None:
    flight = replace(flight, pointing=replace(flight.pointing, search_radius_max=jnp.deg2rad(170.0)))
    modes, attitudes = simulate_search(flight, 100.0, 2400)
    assert np.all(modes[20:] == Mode.SEARCH)
    cameras = np.array([rotation_matrix(q) for q in attitudes[:, 0]])
    line = unit(rendezvous_scene.TARGET_AHEAD)
    targets = np.random.default_rng(1).normal(size=(500, 3))
    targets /= np.linalg.norm(targets, axis=1)[:, None]
    targets = targets[targets @ line > np.cos(np.deg2rad(165.0))]
    ahead, right, down = np.moveaxis(np.einsum("kij,nj->kni", cameras, targets), 2, 0)
    half = np.tan(np.deg2rad(5.0)) * ahead
    in_view = (ahead > 0.0) & (np.abs(right) < half) & (np.abs(down) < half)
    confirmed = np.any(in_view[1:] & in_view[:-1], axis=0)
    assert confirmed.mean() > 0.97
    rates = np.rad2deg(np.arccos(np.clip(np.sum(cameras[1:, 0] * cameras[:-1, 0], axis=1), -1.0, 1.0)))
    assert np.sort(rates)[-60] < 3.4  # half a pitch a frame, but for the slew back to the middle


def test_the_search_rate_is_limited_by_the_centripetal_acceleration(flight: FlightParams) -> None:
    _, attitudes = simulate_search(flight, 30.0 * np.deg2rad(45.0), 300)
    settled = [boresight(flight, q) for q in attitudes[20:200].reshape(-1, 4)]
    rates = np.array([np.arccos(np.clip(a @ b, -1, 1)) for a, b in itertools.pairwise(settled)]) * SAMPLES
    # At radius r the rate on the spiral is sqrt(a r) rad/s, but at most half of the pitch of 6.5 deg a frame. The last
    # of a tick's rates is left out: the way to the next tick, where the straight path is corrected.
    within = rates[: len(rates) // SAMPLES * SAMPLES].reshape(-1, SAMPLES)[:, : SAMPLES - 1]
    first = np.array(settled[: len(within) * SAMPLES : SAMPLES])
    radii = np.arccos(np.clip(first @ unit(rendezvous_scene.TARGET_AHEAD), -1.0, 1.0))
    bound = np.minimum(np.sqrt(0.012 * radii), np.deg2rad(6.5) / 2.0)
    assert np.all(within < 1.03 * bound[:, None])
    assert np.any(within > 0.99 * np.deg2rad(6.5) / 2.0)
