"""Coverage of hand-made runs: analytic caps of a sphere, self-shadow, limits, and values of each run."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
import pytest

from rpojax.campaign.execution.surface_coverage import CoverageResults, SurfaceCoverage
from rpojax.campaign.single_run import nominal_parameters
from rpojax.core.orbits import sun_moon_ephemeris
from rpojax.scenario.loading import scenario_loader
from tests import surface_meshes

RANGE_M = 30.0
RADIUS_M = 0.7
TICKS = 40
ORBIT_M = 6.9e6


def evaluator(triangles: np.ndarray, runs: int = 1, overrides: Sequence[str] = ()) -> SurfaceCoverage:
    file = scenario_loader.load(
        "inspection", ["coverage.enabled=true", f"duration_s={TICKS}", "coverage.spacing_s=10", *overrides]
    )
    scenario, nominal = nominal_parameters(file)
    nominal = jax.tree.map(np.asarray, nominal)
    return SurfaceCoverage(file, scenario, nominal, runs, jax.devices()[:1], triangles)


def sun_direction() -> np.ndarray:
    _, params = nominal_parameters(scenario_loader.load("inspection"))
    sun = np.asarray(sun_moon_ephemeris.sun_position(jax.numpy.float64(0.0), params.epoch))
    return sun / np.linalg.norm(sun)


def records(directions: Sequence[np.ndarray], runs: int = 1) -> dict[str, np.ndarray]:
    """Channels of a target at rest, seen from one direction in each of equal parts of the time, in sunlight."""
    sun = sun_direction()
    parts = [part for part, ticks in enumerate(np.array_split(np.arange(TICKS), len(directions))) for _ in ticks]
    towards = np.array([directions[part] for part in parts])
    shape = np.ones((TICKS, 1, runs))
    return {
        "r_TN_N": (ORBIT_M * sun[None, :, None] * shape).astype(np.float32),
        "r_ST_N": (RANGE_M * towards[:, :, None] * shape).astype(np.float32),
        "q_TN": np.tile(np.array([1.0, 0.0, 0.0, 0.0], np.float32)[None, :, None], (TICKS, 1, runs)),
        "q_BN": np.repeat(np.array([looking_along(-each) for each in towards], np.float32)[:, :, None], runs, axis=2),
        "box_accepted": np.ones((TICKS, runs), bool),
        "running": np.ones((TICKS, runs), bool),
    }


def looking_along(direction_N: np.ndarray) -> np.ndarray:
    """Attitude `q_BN` of a body whose x axis, the camera's, points along a direction."""
    x = direction_N / np.linalg.norm(direction_N)
    y = np.cross([0.3, -0.5, 0.8], x)
    y /= np.linalg.norm(y)
    rotation = np.stack([x, y, np.cross(x, y)])
    # Scalar-first Hamilton quaternion of v_B = R v_N.
    w = 0.5 * np.sqrt(max(1.0 + np.trace(rotation), 1e-12))
    axis = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    return np.concatenate([[w], axis / (4.0 * w)])


def evaluate(coverage: SurfaceCoverage, channels: Mapping[str, np.ndarray], **drawn: Any) -> CoverageResults:
    return coverage.evaluate({name.replace("__", "."): np.asarray(each) for name, each in drawn.items()}, channels)


@pytest.fixture(scope="module")
def sphere() -> SurfaceCoverage:
    return evaluator(surface_meshes.sphere(RADIUS_M, 4), overrides=["coverage.facet_size_m=0.07"])


def cap_share(half_angle_deg: float) -> float:
    return 0.5 * (1.0 - np.cos(np.radians(half_angle_deg)))


def seen_cap_deg(incidence_deg: float) -> float:
    """Half angle of the cap whose incidence is below a limit, seen from a distance (law of sines)."""
    incidence = np.radians(incidence_deg)
    return np.degrees(incidence - np.arcsin(RADIUS_M / RANGE_M * np.sin(incidence)))


def test_cap_of_a_sphere_is_lit_and_seen(sphere: SurfaceCoverage) -> None:
    found = evaluate(sphere, records([sun_direction()]))
    areas, section = sphere.facets.areas, sphere.section
    # The inscribed triangles of 6 deg are a little smaller.
    assert areas.sum() == pytest.approx(4.0 * np.pi * RADIUS_M**2, rel=0.005)
    lit = found.maps["lit_samples"][0] == 4
    seen = found.maps["seen_samples"][0] == 4
    towards = sphere.facets.normals @ sun_direction()
    np.testing.assert_array_equal(lit, towards > np.cos(np.radians(section.sun_incidence_limit_deg)))
    # A ring of facets of 6 deg is cut by the edge of a cap, and half a ring is 7 % of the area.
    lit_share = cap_share(section.sun_incidence_limit_deg)
    assert areas[lit].sum() / areas.sum() == pytest.approx(lit_share, rel=0.07)
    seen_share = cap_share(seen_cap_deg(section.incidence_limit_deg))
    assert areas[seen].sum() / areas.sum() == pytest.approx(seen_share, rel=0.07)
    assert found.metrics["surface_seen_fraction"][0] == pytest.approx(seen_share / lit_share, rel=0.07)
    assert set(np.unique(found.maps["seen_samples"])) == {0, 4}


def test_opposite_side_is_not_seen_and_dark_side_not_lit(sphere: SurfaceCoverage) -> None:
    found = evaluate(sphere, records([-sun_direction()]))
    assert found.metrics["surface_seen_fraction"][0] == 0.0
    assert np.isnan(found.metrics["time_to_90_percent_seen_s"][0])
    lit = found.maps["lit_samples"][0] > 0
    assert np.all(sphere.facets.normals[lit] @ sun_direction() > 0.0)


@pytest.mark.parametrize(
    ("channel", "value", "lit_remains"),
    [("box_accepted", False, True), ("running", False, False), ("r_TN_N", "shadow", False), ("q_BN", "away", True)],
)
def test_nothing_is_seen_without_frame_sunlight_or_pointing(
    sphere: SurfaceCoverage, channel: str, value: Any, lit_remains: bool
) -> None:
    channels = records([sun_direction()])
    if value == "shadow":
        channels["r_TN_N"] = -channels["r_TN_N"]
    elif value == "away":
        channels["q_BN"][:] = looking_along(np.cross(sun_direction(), [0.0, 0.0, 1.0]))[None, :, None]
    else:
        channels[channel][:] = value
    found = evaluate(sphere, channels)
    assert not np.any(found.maps["seen_samples"])
    assert np.any(found.maps["lit_samples"]) == lit_remains
    fraction = found.metrics["surface_seen_fraction"][0]
    assert fraction == 0.0 if lit_remains else np.isnan(fraction)


def test_time_to_90_percent_is_that_of_the_sample_that_completes_it() -> None:
    sun = sun_direction()
    aside = np.cross(sun, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    # Two sides of a cube are lit alike and each is seen in one half of the time: the second begins at 20 s.
    diagonal = looking_matrix(sun, aside)
    cube = surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)) @ diagonal
    first, second = (sun + aside) / np.sqrt(2.0), (sun - aside) / np.sqrt(2.0)
    coverage = evaluator(cube, overrides=["coverage.incidence_limit_deg=20", "coverage.facet_size_m=0.25"])
    found = evaluate(coverage, records([first, second]))
    assert found.metrics["surface_seen_fraction"][0] == pytest.approx(1.0)
    assert found.metrics["time_to_90_percent_seen_s"][0] == 20.0
    half = evaluate(coverage, records([first]))
    assert half.metrics["surface_seen_fraction"][0] == pytest.approx(0.5)
    assert np.isnan(half.metrics["time_to_90_percent_seen_s"][0])


def looking_matrix(sun: np.ndarray, aside: np.ndarray) -> np.ndarray:
    """Rows are axes of a cube: two sides at 45 deg to the Sun."""
    first, second = (sun + aside) / np.sqrt(2.0), (sun - aside) / np.sqrt(2.0)
    return np.stack([first, second, np.cross(first, second)])


def test_a_plate_in_front_shadows_and_hides_the_body() -> None:
    sun = sun_direction()
    aside = np.cross(sun, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    axes = np.stack([sun, aside, np.cross(sun, aside)])
    # A plate of 0.5 m stands 0.5 m in front of the sunlit side, 1 m wide, of a cube.
    parts = [
        surface_meshes.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
        surface_meshes.box((1.025, 0.0, 0.0), (0.05, 0.5, 0.5)),
    ]
    coverage = evaluator(np.concatenate(parts) @ axes, overrides=["coverage.facet_size_m=0.1"])
    found = evaluate(coverage, records([sun]))
    x, y, z = (coverage.facets.centers @ axes.T).T
    face = (coverage.facets.normals @ sun > 0.99) & (x < 0.6)
    lit, seen = (found.maps[name][0] > 0 for name in ("lit_samples", "seen_samples"))
    shadow = face & (np.abs(y) < 0.15) & (np.abs(z) < 0.15)
    clear = face & (np.maximum(np.abs(y), np.abs(z)) > 0.4)
    assert shadow.sum() >= 9
    assert clear.sum() >= 20
    assert not np.any(lit[shadow])
    assert np.all(lit[clear] & seen[clear])
    assert np.all(lit[(coverage.facets.normals @ sun > 0.99) & (x > 0.9)])


def test_coverage_grows_with_every_limit() -> None:
    sun = sun_direction()
    view = sun + 0.8 * np.cross(sun, [0.0, 0.0, 1.0])
    channels = records([view / np.linalg.norm(view)])

    def counts(*overrides: str) -> tuple[np.ndarray, np.ndarray]:
        coverage = evaluator(surface_meshes.sphere(RADIUS_M, 2), overrides=["coverage.facet_size_m=0.2", *overrides])
        maps = evaluate(coverage, channels).maps
        return maps["lit_samples"][0], maps["seen_samples"][0]

    lit, seen = counts()
    for wider, narrower in (
        ("coverage.incidence_limit_deg=75", "coverage.incidence_limit_deg=40"),
        ("coverage.sun_incidence_limit_deg=88", "coverage.sun_incidence_limit_deg=40"),
        ("coverage.resolution_limit_m_px=0.1", "coverage.resolution_limit_m_px=0.02"),
    ):
        more_lit, more_seen = counts(wider)
        less_lit, less_seen = counts(narrower)
        assert np.all(more_lit >= lit) and np.all(lit >= less_lit)
        assert np.all(more_seen >= seen) and np.all(seen >= less_seen)
        assert less_seen.sum() < seen.sum()


def test_each_run_has_its_own_size_and_lens() -> None:
    coverage = evaluator(surface_meshes.sphere(RADIUS_M, 2), 3, ["coverage.facet_size_m=0.2"])
    channels = records([sun_direction()], runs=3)
    # Four times as large, the sphere of 5.6 m exceeds the frame of 5.2 m; a lens of 40 deg has pixels of 17 cm.
    found = evaluate(coverage, channels, target__scale=[1.0, 4.0, 1.0], camera__field_of_view_deg=[10.0, 10.0, 40.0])
    seen = np.sum(found.maps["seen_samples"], axis=1)
    assert seen[0] > seen[1] > 0
    assert seen[2] == 0
    np.testing.assert_array_equal(found.maps["lit_samples"][0], found.maps["lit_samples"][2])
    alone = evaluate(coverage, channels, target__scale=[4.0, 4.0, 1.0], camera__field_of_view_deg=[10.0, 10.0, 10.0])
    np.testing.assert_array_equal(alone.maps["seen_samples"][0], found.maps["seen_samples"][1])
    np.testing.assert_array_equal(alone.maps["seen_samples"][2], found.maps["seen_samples"][0])
