"""Laser range finder: alone against the corners of a box, in the loop, dispersed, and believed by the filter."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from rpojax import Stages
from rpojax.analysis.linear_covariance.covariance_propagation import check_scenario
from rpojax.campaign.single_run import initialise_run
from rpojax.core.orbits.sun_moon_ephemeris import SunMoonPositions
from rpojax.core.pytree import replace
from rpojax.errors import RpojaxError
from rpojax.flight.navigation.believed_sensor import SensorView
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.sensors.additional.additional_sensor import SensedScene
from rpojax.sensors.additional.range_finder import RangeFinder
from rpojax.simulation.channels import compute_channels
from rpojax.simulation.rollout import rollout

SECTION = (
    "range_finder.noise_m=0.05",
    "range_finder.bias_m=0.5",
    "range_finder.maximum_range_m=100.0",
    "range_finder.beam_half_angle_deg=0.05",
    "range_finder.boresight=[2.0, 0.0, 0.0]",
    "range_finder.believed_noise_m=0.06",
    "duration_s=40",
)
TICKS = 40
BOX = "target.hull_m=[[-1,-1,-2],[-1,-1,2],[-1,1,-2],[-1,1,2],[1,-1,-2],[1,-1,2],[1,1,-2],[1,1,2]]"
"""A box whose faces are 1 m, 1 m and 2 m from the centre."""


def measure(distance: float, off_deg: float, *overrides: str, turned_deg: float = 0.0) -> float:
    """Measurement of that box, turned about z, at a distance [m] and this far from the boresight; noise of 1 sigma."""
    file = scenario_loader.load("inspection", [*SECTION, BOX, "coverage.surface=hull", *overrides])
    _, params, state = initialise_run(file)
    angle = np.radians(off_deg)
    truth = replace(
        state.truth,
        r_ST_N=jnp.asarray(-distance * np.array([np.cos(angle), np.sin(angle), 0.0])),
        q_BN=jnp.array([1.0, 0.0, 0.0, 0.0]),
        q_TN=jnp.array([np.cos(np.radians(0.5 * turned_deg)), 0.0, 0.0, np.sin(np.radians(0.5 * turned_deg))]),
    )
    sky = SunMoonPositions(sun_N=jnp.ones(3), moon_N=jnp.ones(3))
    scene = SensedScene(
        truth=truth, sky=sky, time=jnp.zeros(()), surface=replace(params.surface, scale=params.plant.target.scale)
    )
    return float(RangeFinder.measure(params.additional_sensors["range_finder"], scene, jnp.ones(1))["range_finder_m"])


@pytest.mark.parametrize(("distance", "off_deg"), [(40.0, 0.0), (30.0, 1.7), (10.0, -5.0)])
def test_the_range_is_that_of_the_nearest_surface_with_bias_and_noise(distance: float, off_deg: float) -> None:
    ahead = distance * np.cos(np.radians(off_deg)) - 1.0
    assert measure(distance, off_deg) == pytest.approx(ahead + 0.5 + 0.05, abs=1e-9)


def test_the_true_size_counts_and_the_nearest_return_of_a_wide_beam() -> None:
    assert measure(40.0, 0.0, "target.scale=1.5") == pytest.approx(40.0 - 1.5 + 0.55, abs=1e-9)
    beside = 40.0 * np.sin(np.radians(1.6)) - 1.0
    assert beside > 0.1
    assert np.isnan(measure(40.0, 1.6))
    # The ring of a beam of 0.5 deg reaches 0.24 m to the side.
    wide = measure(40.0, 1.6, "range_finder.beam_half_angle_deg=0.5")
    assert wide == pytest.approx(40.0 * np.cos(np.radians(1.6)) - 1.0 + 0.55, abs=0.01)


@pytest.mark.parametrize(
    ("distance", "off_deg"), [(56.0, 0.0), (40.0, 2.01), (40.0, 180.0)], ids=["too far for grey", "beside", "behind"]
)
def test_there_is_no_range_out_of_reach_or_beside_the_beam(distance: float, off_deg: float) -> None:
    assert np.isnan(measure(distance, off_deg))


def test_the_reach_falls_with_reflectivity_and_incidence() -> None:
    # Of a reach of 100 m on white, a grey surface of 0.3 leaves 54.8 m face-on, and 46.1 m at 45 deg.
    assert np.isfinite(measure(56.0, 0.0, "range_finder.maximum_range_m=110.0"))
    assert np.isfinite(measure(50.0, 0.3))
    assert np.isnan(measure(50.0, 0.3, turned_deg=45.0))
    assert np.isfinite(measure(47.0, 0.3, turned_deg=45.0))


def test_the_filter_has_a_state_for_the_surface_where_it_is_believed_and_else_none() -> None:
    with_it = initialise_run(scenario_loader.load("inspection", SECTION))[2].flight.orbit.relative
    plain = initialise_run(scenario_loader.load("inspection"))[2].flight.orbit.relative
    assert with_it.layout["nearest_surface"] == slice(6, 8)
    assert with_it.layout.size == plain.layout.size + 2
    assert set(with_it.slow) - set(plain.slow) == {"nearest_surface"}


def test_its_row_is_the_range_less_the_expected_surface() -> None:
    _, params, state = initialise_run(scenario_loader.load("inspection", SECTION))
    estimate, tuning = state.flight.orbit.relative, params.flight.navigation
    view = SensorView(tuning=tuning, relative=estimate, q_BN=jnp.array([1.0, 0, 0, 0]), time=jnp.zeros(()))
    beliefs = params.flight.sensors["range_finder"]
    rows = RangeFinder.rows(beliefs, view, {"range_finder_m": jnp.asarray(50.0)})
    distance = float(jnp.linalg.norm(estimate.r_TS_N))
    assert float(rows.residual[0]) == pytest.approx(50.0 - distance + 0.305 * 1.063, abs=1e-9)
    expected = np.concatenate([estimate.r_TS_N / distance, np.zeros(3), [-1.0, -1.0]])
    np.testing.assert_allclose(rows.jacobian[0, :8], expected, atol=1e-12)
    np.testing.assert_allclose(rows.jacobian[0, 8:], 0.0)
    assert float(rows.variance[0]) == pytest.approx(0.06**2)
    assert float(RangeFinder.rows(beliefs, view, {"range_finder_m": jnp.asarray(np.nan)}).weight[0]) == 0.0


def test_one_that_never_meets_the_target_is_refused_in_one_line() -> None:
    near = "range_finder.maximum_range_m=29.0"
    with pytest.raises(RpojaxError, match=r"^range_finder\.maximum_range_m: found 29\.0, expected more than 30[^\n]*$"):
        scenario_loader.load("inspection", [*SECTION, near])
    with pytest.raises(RpojaxError, match=r"^range_finder\.boresight: found [^\n]* boresight, which[^\n]*$"):
        scenario_loader.load("inspection", [*SECTION, "range_finder.boresight=[0.0, 1.0, 0.0]"])


@pytest.mark.slow
def test_in_the_loop_the_range_error_falls_and_is_recorded() -> None:
    quiet = ["dispersions=[]", "duration_s=300"]

    def channels(overrides: list[str]) -> dict[str, np.ndarray]:
        scenario, params, state = initialise_run(scenario_loader.load("inspection", overrides), seed=4)
        telemetry = jax.jit(lambda start: rollout(scenario, params, start, 300, Stages())[1])(state)
        observe = jax.jit(jax.vmap(lambda tick: compute_channels(scenario, params, tick)))
        return jax.tree.map(np.asarray, observe(telemetry))

    found, plain = channels([*SECTION, "range_finder.bias_m=0.0", *quiet]), channels(quiet)
    assert set(found) - set(plain) == {"range_finder_m", "range_finder_innovation_sigmas", "range_finder_accepted"}
    used = found["range_finder_accepted"].astype(bool)
    assert used[100:].mean() > 0.5
    before_surface = found["range_m"] - found["range_finder_m"]
    assert np.all((before_surface[used] > 0.0) & (before_surface[used] < 1.0))
    along = [np.abs(each["relative_error_H"][100:, 1]).mean() for each in (found, plain)]
    assert along[0] < 0.15 < along[1]


def test_its_numbers_are_dispersed_and_its_settings_checked() -> None:
    dispersion = "dispersions=[{key='range_finder.bias_m', kind='normal', sigma=0.2}]"
    file = scenario_loader.load("inspection", [*SECTION, dispersion])
    values = [float(initialise_run(file, 1, run)[1].additional_sensors["range_finder"]["bias"]) for run in range(3)]
    assert len(set(values)) == 3
    assert all(abs(value - 0.5) < 1.0 for value in values)
    with pytest.raises(RpojaxError, match=r"^range_finder\.noise_m: found -1\.0, expected [^\n]*$"):
        scenario_loader.load("inspection", [*SECTION, "range_finder.noise_m=-1.0"])
    with pytest.raises(RpojaxError, match=r"^range_finder\.[^\n]*$"):
        scenario_loader.load("inspection", SECTION[:1])


def test_a_scenario_without_it_keeps_its_hash_and_one_with_it_has_another() -> None:
    plain = scenario_loader.load("inspection")
    assert "range_finder" not in plain.model_dump()
    with_it = scenario_loader.load("inspection", [*SECTION[:6]])
    assert scenario_digest(with_it) != scenario_digest(plain)
    assert scenario_loader.validate(with_it.model_dump()) == with_it


def test_a_linear_covariance_refuses_it() -> None:
    with pytest.raises(RpojaxError, match=r"^range_finder: found a section, expected none for a linear covariance$"):
        check_scenario(scenario_loader.load("inspection", SECTION))
