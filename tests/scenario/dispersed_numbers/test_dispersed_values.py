"""Values of the dispersed keys of a run depend on nothing but the run and the key, and arrive in the parameters."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from dispersed_samples import FIVE_SIGMA, LAST_DIGITS, ONE_OF_EACH, RUNS, draw
from scenario_variants import with_dispersions

from rpojax.core import random_streams
from rpojax.dispersions.kinds.choice import Choice
from rpojax.dispersions.kinds.normal import Normal
from rpojax.dispersions.kinds.uniform import Uniform
from rpojax.errors import ScenarioError
from rpojax.physics import equipment_faults
from rpojax.scenario import params
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.measurement_delays import KEYS as DELAY_KEYS
from rpojax.scenario.parameter_keys import nominal_of_key
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings


def test_a_fault_kind_chosen_by_name_affects_the_equipment_of_that_name(mission: ScenarioFile) -> None:
    names = ["thruster_weak", "gps_outage", "camera_blackout"]
    file = with_dispersions(mission, Choice(key="faults.fault.kind", kind="choice", values=names))
    drawn = draw(file, np.arange(RUNS))["faults.fault.kind"]
    codes = [equipment_faults.KINDS.index(name) for name in names]
    fractions = [np.mean(drawn == code) for code in codes]
    np.testing.assert_allclose(fractions, 1 / 3, atol=FIVE_SIGMA * np.sqrt(2.0) / 3.0)
    assert set(drawn) == set(codes)
    settings = static_settings(file)
    nominal = params.build_params(file.model_dump(), settings.width_px, settings.height_px)
    for code, name in zip(codes, names, strict=True):
        plant = dispersed_values.apply_to_params(nominal, {"faults.fault.kind": jnp.float64(code)}).plant
        health = equipment_faults.health_at(plant.faults, jnp.asarray(10.0))
        assert float(health.thrust_fraction) == (0.5 if name == "thruster_weak" else 1.0)
        assert bool(health.gps) is (name != "gps_outage")
        assert bool(health.camera) is (name != "camera_blackout")


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("faults.fault.kind", ["wheel_stuck", "no_such_fault"]),
        ("faults.fault.start_s", ["wheel_stuck"]),
        ("faults.fault.kind", [1.0, 2.0]),
    ],
    ids=["a name of no fault", "names for a number", "numbers for a name"],
)
def test_fault_kinds_are_chosen_by_name_and_other_keys_by_number(
    mission: ScenarioFile, key: str, values: list[Any]
) -> None:
    tables = mission.model_dump()
    with pytest.raises(ScenarioError):
        scenario_loader.validate(tables | {"dispersions": [{"key": key, "kind": "choice", "values": values}]})


def test_keys_and_seeds_have_independent_numbers(mission: ScenarioFile) -> None:
    keys = ("servicer.mass_kg", "thruster.force_n")
    file = with_dispersions(mission, *(Normal(key=key, kind="normal", sigma=1.0) for key in keys))
    first, second = draw(file, np.arange(RUNS)), draw(file, np.arange(RUNS), seed=4)
    mass, force, other = first[keys[0]], first[keys[1]], second[keys[0]]
    assert abs(np.corrcoef(mass, force)[0, 1]) < FIVE_SIGMA
    assert abs(np.corrcoef(mass, other)[0, 1]) < FIVE_SIGMA


def test_values_do_not_depend_on_other_dispersions_or_their_order(
    mission: ScenarioFile, samples: dict[str, np.ndarray]
) -> None:
    fewer = draw(with_dispersions(mission, *ONE_OF_EACH[::-2]), np.arange(50))
    for key, values in fewer.items():
        np.testing.assert_allclose(values, samples[key][:50], rtol=LAST_DIGITS, atol=LAST_DIGITS)


def test_values_do_not_depend_on_the_batch_or_the_order_of_runs(
    mission: ScenarioFile, samples: dict[str, np.ndarray]
) -> None:
    some = [3999, 17, 0]
    alone = draw(with_dispersions(mission, *ONE_OF_EACH), some)
    for key, values in alone.items():
        np.testing.assert_allclose(values, samples[key][some], rtol=LAST_DIGITS, atol=LAST_DIGITS)


def every_key(file: ScenarioFile) -> list[str]:
    """All keys that can be dispersed without a team."""
    sections = {name: type(getattr(file, name)) for name in type(file).model_fields}
    keys = [f"{name}.{key}" for name, cls in sections.items() for key in getattr(cls, "model_fields", {})]
    of_team = ("link.", "team.", "gps_differences.", "link_range.", "navigation.difference_")
    return [key for key in keys if nominal_of_key(file, key) is not None and not key.startswith(of_team)]


def _any_dispersion(key: str) -> Any:
    """A valid dispersion of the key."""
    if key == "faults.fault.kind":
        return Choice(key=key, kind="choice", values=["gps_outage"])
    if key == "faults.fault.wheel":
        return Choice(key=key, kind="choice", values=[2.0])
    if key in [f"camera.{each}" for each in DELAY_KEYS]:
        return Uniform(key=key, kind="uniform", low=0.01, high=0.02)
    return Normal(key=key, kind="normal", sigma=0.01)


def test_the_parameters_hold_the_drawn_value_of_every_key(mission: ScenarioFile) -> None:
    keys = every_key(mission)
    assert len(keys) > 60
    remembers = mission.navigation.model_copy(update={"delay_memory_s": 9.0})
    file = with_dispersions(mission.model_copy(update={"navigation": remembers}), *map(_any_dispersion, keys))
    static = static_settings(file)
    nominal = params.build_params(file.model_dump(), static.width_px, static.height_px)
    values = dispersed_values.draw(file, random_streams.fold_in(random_streams.master_key(0), 1), {})
    used = dispersed_values.read_back(dispersed_values.apply_to_params(nominal, values), keys)
    for key in keys:
        np.testing.assert_allclose(used[key], values[key], rtol=LAST_DIGITS, err_msg=key)
        assert not np.array_equal(used[key], np.asarray(nominal_of_key(file, key))), key
