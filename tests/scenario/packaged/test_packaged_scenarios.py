"""Content of the packaged scenario_loader."""

from dataclasses import replace

import numpy as np
import pytest
from numpy_reference import axis_angle_quaternion, random_unit, rotation_matrix, unit

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.phases.reference_sections import RelativeOrbitSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.scenario.team.members import member_files


def test_the_full_scenario_has_every_effect_but_faults_plumes_and_a_tank_of_its_own_size() -> None:
    full, faulty = (static_settings(scenario_loader.load(f"inspection_{name}")).effects for name in ("full", "faults"))
    assert {name for name, value in vars(full).items() if value is False} == {"faults", "plume", "inertia_change"}
    assert full.zonal_degree == 6
    assert faulty == replace(full, faults=True)


def test_the_cold_start_differs_in_the_hand_over_only() -> None:
    warm, cold = scenario_loader.load("inspection").model_dump(), scenario_loader.load("inspection_cold").model_dump()
    differing = {key for key in warm["navigation"] if warm["navigation"][key] != cold["navigation"][key]}
    assert differing == {"initial_relative_position_sigma_m", "initial_relative_velocity_sigma_m_s"}
    assert {key for key in warm if warm[key] != cold[key]} == {"name", "description", "navigation"}


def test_requirements_are_stricter_than_the_limits(inspection_file: ScenarioFile) -> None:
    limits = {requirement.metric: requirement.limit for requirement in inspection_file.requirements}
    assert limits["min_range_m"] > inspection_file.limits.keep_out_m
    assert limits["look_away_peak_s"] == inspection_file.pointing.look_away_limit_s


def log_sizes(hull: np.ndarray, attitudes: np.ndarray) -> np.ndarray:
    """Log of the geometric mean side [m] of the outline's box from afar, for rotation matrices (..., 3, 3)."""
    seen = np.einsum("...ij,nj->...ni", attitudes, hull)
    sides = seen.max(axis=-2) - seen.min(axis=-2)
    return 0.5 * np.log(sides[..., 0] * sides[..., 1])


def test_the_target_size_of_the_filter_is_the_mean_over_all_attitudes(inspection_file: ScenarioFile) -> None:
    rng = np.random.default_rng(1)
    attitudes = np.array([rotation_matrix(random_unit(rng, 4)) for _ in range(4000)])
    sizes = log_sizes(np.array(inspection_file.target.hull_m), attitudes)
    # Four sigma of the mean of 4000 logs with a spread of 0.15.
    np.testing.assert_allclose(np.exp(sizes.mean()), inspection_file.navigation.target_size_m, rtol=0.01)
    total = np.linalg.norm(inspection_file.navigation.scale_sigma)
    np.testing.assert_allclose(sizes.std(), total, rtol=0.1)


def test_the_scale_sigmas_of_the_filter_are_those_of_a_tumbling_hull(
    inspection_file: ScenarioFile,
) -> None:
    rng = np.random.default_rng(2)
    hull = np.array(inspection_file.target.hull_m)
    means, spreads = [], []
    for _ in range(300):
        # Tumble about an axis fixed in the target, from one direction of view.
        axis, start = unit(rng.normal(size=3)), rotation_matrix(random_unit(rng, 4))
        angles = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
        sizes = log_sizes(
            hull, np.array([start @ rotation_matrix(axis_angle_quaternion(axis, angle)) for angle in angles])
        )
        means.append(sizes.mean())
        spreads.append(sizes.var())
    slow, fast = inspection_file.navigation.scale_sigma
    # Four sigma of a standard deviation from 300 draws are 16 per cent.
    np.testing.assert_allclose(np.std(means), slow, rtol=0.2)
    np.testing.assert_allclose(np.sqrt(np.mean(spreads)), fast, rtol=0.2)


def _places(file: ScenarioFile) -> list[tuple[np.ndarray, np.ndarray]]:
    """Position (3,) [m] and rate (3,) [m/s] of each servicer on its relative orbit at the start, by the textbook."""
    n = np.sqrt(3.986004418e14 / file.orbit.semi_major_axis_m**3)
    latitude = np.radians(file.orbit.argument_of_perigee_deg + file.orbit.true_anomaly_deg)
    found = []
    for member in member_files(file):
        orbit = member.phases[0].reference
        assert isinstance(orbit, RelativeOrbitSection)
        a, b = latitude - np.radians([orbit.radial_phase_deg, orbit.cross_track_phase_deg])
        r, c = orbit.radial_m, orbit.cross_track_m
        place = np.array([-r * np.cos(a), 2.0 * r * np.sin(a), c * np.sin(b)])
        found.append((place, n * np.array([r * np.sin(a), 2.0 * r * np.cos(a), c * np.cos(b)])))
    return found


@pytest.mark.parametrize("name", ["cooperative_inspection", "cooperative_far", "cooperative_faults"])
def test_the_servicers_of_a_team_start_on_their_relative_orbits(name: str) -> None:
    """Within the digits to which the file gives them, of 1e-5 m/s, or 1e-4 m/s at 200 m."""
    file = scenario_loader.load(name)
    for member, (place, rate) in zip(member_files(file), _places(file), strict=True):
        np.testing.assert_allclose(member.initial.relative_position_m, place, atol=1e-9)
        np.testing.assert_allclose(member.initial.relative_velocity_m_s, rate, atol=1e-4)


def test_a_drift_along_the_track_brings_no_two_servicers_together() -> None:
    """The separation across the track of any two stays above 25 m, at all arguments of latitude."""
    file = scenario_loader.load("cooperative_inspection")
    latitudes = np.linspace(0.0, 360.0, 721)
    across = []
    for member in member_files(file):
        orbit = member.phases[0].reference
        assert isinstance(orbit, RelativeOrbitSection)
        a, b = np.radians(latitudes - orbit.radial_phase_deg), np.radians(latitudes - orbit.cross_track_phase_deg)
        across.append(np.stack([-orbit.radial_m * np.cos(a), orbit.cross_track_m * np.sin(b)]))
    for first, second in ((0, 1), (1, 2), (0, 2)):
        assert np.linalg.norm(across[first] - across[second], axis=0).min() > 25.0


def test_what_the_cooperative_scenarios_fail() -> None:
    file = scenario_loader.load("cooperative_faults")
    assert file.link.loss == 0.3
    first, second, third = member_files(file)
    (of_first,), (of_second,) = first.faults, second.faults
    assert (of_first.kind, of_second.kind, of_second.duration_s) == ("none", "camera_blackout", 1800.0)
    assert first.mission.abort_at_s > file.duration_s > third.mission.abort_at_s
    assert static_settings(file, allow_team=True).effects.faults
