"""LiDAR: its pattern, the centroid of its returns, what comes back of dark and turned surfaces, and its rows."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax.campaign.single_run import initialise_run
from rpojax.core import vectors
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.flight.guidance.sight_cone import SightCone, sight_cone
from rpojax.flight.navigation import believed_sensor
from rpojax.flight.navigation.believed_sensor import SensorView
from rpojax.flight.navigation.relative_filter_state import RelativeEstimate
from rpojax.metrics.metric_catalogue import metrics_of_scenario
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.plugins import plugin_registry
from rpojax.sensors.additional import surface_ranging
from rpojax.sensors.additional.additional_sensor import SensedScene
from rpojax.sensors.additional.lidar import Lidar
from rpojax.sensors.additional.surface_ranging import TargetSurface

SECTION = (
    "lidar.noise_m=0.05",
    "lidar.bias_m=0.02",
    "lidar.angle_noise_deg=0.02",
    "lidar.maximum_range_m=100.0",
    "lidar.field_half_angle_deg=10.0",
    "lidar.boresight=[1.0, 0.0, 0.0]",
    "lidar.believed_noise_m=0.05",
    "lidar.believed_angle_noise_deg=0.03",
)
WALL = np.array([[[0.0, -1, -1], [0.0, 1, -1], [0.0, 1, 1]], [[0.0, -1, -1], [0.0, 1, 1], [0.0, -1, 1]]])
"""A square wall of 2 m through the centre, across x."""
IDENTITY = jnp.array([1.0, 0.0, 0.0, 0.0])


def measure(distance: float, cone_deg: float, normals: tuple[float, ...] = (0, 0, 0), **changes: object) -> tuple:
    """Centroid (3,) and number of returns of a wall ahead at a distance [m]; `changes` are of the scene."""
    _, params, state = initialise_run(scenario_loader.load("inspection", SECTION))
    truth = replace(state.truth, r_ST_N=jnp.array([-distance, 0.0, 0.0]), q_BN=IDENTITY, q_TN=IDENTITY)
    scene = {
        "surface": TargetSurface(triangles=jnp.asarray(WALL), reflectivity=jnp.full(2, 0.3), scale=jnp.ones(())),
        "cone": SightCone(axis_B=jnp.array([1.0, 0.0, 0.0]), half_angle=jnp.asarray(np.radians(cone_deg))),
        **changes,
    }
    sky = SunMoonPositions(sun_N=jnp.ones(3), moon_N=jnp.ones(3))
    sensed = SensedScene(truth=truth, sky=sky, time=jnp.asarray(7.0), **scene)
    found = Lidar.measure(params.additional_sensors["lidar"], sensed, jnp.array(normals, dtype=float))
    return np.asarray(found["lidar_centroid_m"]), float(found["lidar_returns_count"])


def test_the_centroid_of_a_wall_is_its_middle_with_bias_and_noise() -> None:
    centroid, count = measure(20.0, 2.5, (2.0, 1.0, -1.0))
    assert count == 64  # all beams of 0.87 m meet it
    np.testing.assert_allclose(centroid[0], 20.0 + 0.02 + 2.0 * 0.05 / 8.0, atol=2e-3)
    np.testing.assert_allclose(centroid[1:], 20.0 * np.radians(0.02) * np.array([1.0, -1.0]), atol=0.02)


def test_beams_beside_the_target_do_not_count_and_without_a_return_there_is_no_centroid() -> None:
    centroid, count = measure(20.0, 8.0)
    # 4 m^2 of the circle of 2.8 m.
    assert count == pytest.approx(64 * 4.0 / (np.pi * (20.0 * np.tan(np.radians(8.0))) ** 2), abs=3)
    np.testing.assert_allclose(centroid, [20.02, 0.0, 0.0], atol=0.15)
    nothing, none = measure(200.0, 10.0)
    assert none == 0
    assert np.isnan(nothing).all()


def test_dark_and_glancing_surfaces_return_nothing() -> None:
    def wall(reflectivity: float, turned_deg: float = 0.0) -> TargetSurface:
        c, s = np.cos(np.radians(turned_deg)), np.sin(np.radians(turned_deg))
        turned = WALL @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return TargetSurface(triangles=jnp.asarray(turned), reflectivity=jnp.full(2, reflectivity), scale=jnp.ones(()))

    # The reach of 100 m falls to 100 sqrt(0.04) = 20 m, or 100 sqrt(0.3 cos 85 deg) = 16 m.
    assert measure(21.0, 2.0, surface=wall(0.04))[1] == 0
    assert measure(19.0, 2.0, surface=wall(0.04))[1] == 64
    assert measure(18.0, 0.2, surface=wall(0.3, 85.0))[1] == 0
    assert measure(15.0, 0.2, surface=wall(0.3, 85.0))[1] == 64


def test_the_pattern_is_evenly_spread_within_its_cone_and_follows_the_predicted_target() -> None:
    axis = jnp.array([0.6, 0.0, 0.8])
    pattern = jnp.asarray(surface_ranging.sunflower(64))
    beams = np.asarray(surface_ranging.within_cone(axis, jnp.asarray(0.1), pattern))
    np.testing.assert_allclose(np.linalg.norm(beams, axis=1), 1.0, atol=1e-12)
    angles = np.arccos(beams @ np.asarray(axis))
    assert 0.098 < angles.max() < 0.1
    # In a disc the median radius is the root of a half.
    assert np.median(np.tan(angles)) == pytest.approx(np.tan(0.1) * np.sqrt(0.5), rel=0.03)
    _, params, state = initialise_run(scenario_loader.load("inspection", SECTION))
    orbit = state.flight.orbit
    cone = sight_cone(params.flight.navigation, orbit, IDENTITY)
    r = np.asarray(orbit.relative.r_TS_N)
    np.testing.assert_allclose(cone.axis_B, r / np.linalg.norm(r), atol=1e-12)
    # 0.95 m of target, and three times the root of two of a hand-over of 1.5 m.
    expected = (0.95 + 3.0 * np.sqrt(2.0) * 1.5) / np.linalg.norm(r)
    assert float(cone.half_angle) == pytest.approx(expected, rel=0.05)


def test_axes_across_are_orthonormal() -> None:
    for line in np.random.default_rng(0).normal(size=(20, 3)):
        u = jnp.asarray(line / np.linalg.norm(line))
        axes = np.stack([u, *vectors.across_axes(u)])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.stack(vectors.across_axes(jnp.array([1.0, 0.0, 0.0]))), np.eye(3)[1:])


def test_its_rows_are_linear_in_place_and_offsets() -> None:
    _, params, state = initialise_run(scenario_loader.load("inspection", SECTION))
    estimate, tuning = state.flight.orbit.relative, params.flight.navigation
    assert estimate.layout["centroid"] == slice(6, 12)
    offset = jnp.array([0.01, 0.02, 0.03, 0.04, 0.05, 0.06])
    estimate = replace(estimate, slow={**estimate.slow, "centroid": offset})
    r = np.asarray(estimate.r_TS_N)
    line = r / np.linalg.norm(r)
    view = SensorView(tuning=tuning, relative=estimate, q_BN=IDENTITY, time=jnp.zeros(()))
    measured = {"lidar_centroid_m": jnp.asarray(r - 0.2 * line), "lidar_returns_count": jnp.asarray(16.0)}
    rows = Lidar.rows(params.flight.sensors["lidar"], view, measured)
    expected = [-0.2 + 0.15 * 1.063 + 0.03, -(0.03 + 0.05), -(0.04 + 0.06)]
    np.testing.assert_allclose(rows.residual, expected, atol=1e-9)
    signs = [[-1, -1, 0, 0, 0, 0], [0, 0, 1, 0, 1, 0], [0, 0, 0, 1, 0, 1]]
    np.testing.assert_allclose(rows.jacobian[:, 6:12], signs, atol=1e-12)
    np.testing.assert_allclose(rows.jacobian[0, :3], line, atol=1e-12)
    np.testing.assert_allclose(rows.weight, 1.0)
    # 16 evenly spread returns: 0.22 of 1.063 m over 16 to the power of 3/4, which is 8.
    np.testing.assert_allclose(rows.variance[0], 0.05**2 / 16.0 + (0.22 * 1.063 / 8.0) ** 2, rtol=1e-12)
    none = {"lidar_centroid_m": jnp.full(3, jnp.nan), "lidar_returns_count": jnp.asarray(0.0)}
    without = Lidar.rows(params.flight.sensors["lidar"], view, none)
    np.testing.assert_array_equal(without.weight, 0.0)
    assert np.isfinite(np.asarray(without.jacobian)).all()


def test_offsets_across_say_nothing_of_the_range() -> None:
    """At 3 m a centroid that wanders across by 0.06 m, which as rows along its own direction shortens the range."""
    _, params, state = initialise_run(scenario_loader.load("inspection", SECTION))
    tuning, relative = params.flight.navigation, state.flight.orbit.relative
    truth = jnp.array([3.0, 0.0, 0.0])
    nearer = jnp.array([0.15 * 1.063, 0.0, 0.0])
    wander = jnp.asarray(np.random.default_rng(4).normal(size=(300, 3)) * [0.0, 0.06, 0.06])

    def body(estimate: RelativeEstimate, across: jax.Array) -> tuple[RelativeEstimate, None]:
        view = SensorView(tuning=tuning, relative=estimate, q_BN=IDENTITY, time=jnp.zeros(()))
        measured = {"lidar_centroid_m": truth - nearer + across, "lidar_returns_count": jnp.asarray(16.0)}
        rows = Lidar.rows(params.flight.sensors["lidar"], view, measured)
        return believed_sensor.update(tuning, False, estimate, rows)[0], None

    found, _ = jax.lax.scan(body, replace(relative, r_TS_N=truth), wander)
    assert float(found.r_TS_N[0]) == pytest.approx(3.0, abs=0.03)


def test_bad_input_and_its_metrics() -> None:
    for override, key in (
        ("lidar.maximum_range_m=20.0", "maximum_range_m"),
        ("lidar.boresight=[1.0, 0.5, 0.0]", "boresight"),
        ("lidar.believed_noise_m=0.0", "believed_noise_m"),
    ):
        with pytest.raises(RpojaxError, match=rf"^lidar\.{key}: found [^\n]*$"):
            scenario_loader.load("inspection", [*SECTION, override])
    file = scenario_loader.load("inspection", SECTION)
    own = plugin_registry.metrics_of(file)
    assert set(own) == {"nis_lidar_mean", "lidar_innovation_lag1", "lidar_used_fraction"}
    with metrics_of_scenario(own):
        assert own["nis_lidar_mean"].degrees_of_freedom == 3
    assert not plugin_registry.metrics_of(scenario_loader.load("inspection"))
