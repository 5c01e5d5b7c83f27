"""Laser range finder: alone, in the loop, dispersed, and in a replaced orbit filter."""

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
    "range_finder.beam_half_angle_deg=2.0",
    "range_finder.boresight=[2.0, 0.0, 0.0]",
    "duration_s=40",
)
TICKS = 40


def measure(distance: float, off_deg: float) -> float:
    """Measurement of a target at a distance [m], this far from the boresight, with one sigma of noise."""
    _, params, state = initialise_run(scenario_loader.load("inspection", SECTION))
    angle = np.radians(off_deg)
    truth = replace(
        state.truth,
        r_ST_N=jnp.asarray(-distance * np.array([np.cos(angle), np.sin(angle), 0.0])),
        q_BN=jnp.array([1.0, 0.0, 0.0, 0.0]),
    )
    scene = SensedScene(truth=truth, sky=SunMoonPositions(sun_N=jnp.ones(3), moon_N=jnp.ones(3)), time=jnp.zeros(()))
    return float(RangeFinder.measure(params.additional_sensors["range_finder"], scene, jnp.ones(1))["range_finder_m"])


@pytest.mark.parametrize(("distance", "off_deg"), [(40.0, 0.0), (99.9, 1.99), (10.0, -1.99)])
def test_the_range_has_bias_and_noise(distance: float, off_deg: float) -> None:
    assert measure(distance, off_deg) == pytest.approx(distance + 0.5 + 0.05, abs=1e-9)


@pytest.mark.parametrize(("distance", "off_deg"), [(100.1, 0.0), (40.0, 2.01), (40.0, 180.0)])
def test_there_is_no_range_out_of_reach_or_beside_the_beam(distance: float, off_deg: float) -> None:
    assert np.isnan(measure(distance, off_deg))


@pytest.mark.slow
def test_in_the_loop_it_is_recorded_reaches_the_filter_and_changes_no_other_number() -> None:
    file = scenario_loader.load("inspection", SECTION)
    plain = scenario_loader.load("inspection", ["duration_s=40"])
    seen: set[str] = set()

    def watching(additional: dict[str, jax.Array], **others: object) -> object:
        seen.update(additional)
        return Stages().call("orbit_update", additional=additional, **others)

    def channels(scenario_file: object, stages: Stages) -> dict[str, np.ndarray]:
        scenario, params, state = initialise_run(scenario_file, seed=4)
        simulate = jax.jit(lambda start: rollout(scenario, params, start, TICKS, stages)[1])
        telemetry = simulate(state)
        observe = jax.jit(jax.vmap(lambda tick: compute_channels(scenario, params, tick)))
        return jax.tree.map(np.asarray, observe(telemetry))

    found, expected = channels(file, Stages(orbit_update=watching)), channels(plain, Stages())
    assert seen == {"range_finder_m"}
    error = found.pop("range_finder_m") - found["range_m"] - 0.5
    assert np.isfinite(error).mean() > 0.5
    assert 0.02 < np.nanstd(error) < 0.09  # noise of 0.05 m
    assert set(found) == set(expected)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-5, atol=1e-6, err_msg=name)


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
    with_it = scenario_loader.load("inspection", [*SECTION[:5]])
    assert scenario_digest(with_it) != scenario_digest(plain)
    assert scenario_loader.validate(with_it.model_dump()) == with_it


def test_a_linear_covariance_refuses_it() -> None:
    with pytest.raises(RpojaxError, match=r"^range_finder: found a section, expected none for a linear covariance$"):
        check_scenario(scenario_loader.load("inspection", SECTION))
