"""Content of the packaged scenario_loader."""

from dataclasses import replace

import numpy as np
from numpy_reference import axis_angle_quaternion, random_unit, rotation_matrix, unit

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings


def test_the_full_scenario_has_every_effect_but_faults() -> None:
    full, faulty = (static_settings(scenario_loader.load(f"inspection_{name}")).effects for name in ("full", "faults"))
    assert {name for name, value in vars(full).items() if value is False} == {"faults"}
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
