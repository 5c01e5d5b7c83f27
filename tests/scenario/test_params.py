"""Parameters of a run: every number of a scenario in its leaf, in SI units."""

import numpy as np
import pytest
from pydantic import BaseModel

from rpojax.errors import ScenarioError
from rpojax.physics import equipment_faults
from rpojax.scenario import params as parameters
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile

STATIC = {
    "field",
    "detector",
    "statistics",
    "sky_seed",
    "model",
    "width_px",
    "height_px",
    "gating",
    "zonal_degree",
    "luni_solar",
    "handover",
    "sharing",
    "period_s",
    "delay_s",
    "outages_s",
    "hears",
    "kind",
    "phasing",
    "enabled",
}
"""Keys of static settings, and of a section that may be absent."""


def numeric_keys() -> list[str]:
    """Every key of the schema that is a parameter."""
    keys = []
    for name, field in ScenarioFile.model_fields.items():
        section = field.annotation
        if (
            name not in ("rates", "effects", "safety", "coverage", "mission", "tuning")
            and isinstance(section, type)
            and issubclass(section, BaseModel)
        ):
            keys += [
                f"{name}.{key}" for key in section.model_fields if key not in STATIC or f"{name}.{key}" == "fault.kind"
            ]
    return keys


def factor(key: str) -> float:
    """Factor from the unit of a key to SI, from the words of the key."""
    words = key.partition(".")[2].split("_")
    named = {"deg": np.pi / 180.0, "mrad": 1e-3, "mm": 1e-3}
    if words[-2:] == ["deg", "h"]:
        return np.pi / 180.0 / 3600.0
    return next((named[word] for word in words if word in named), 1.0)


@pytest.mark.parametrize("key", numeric_keys())
def test_every_number_of_the_scenario_is_in_its_leaf_in_si_units(
    inspection_file: ScenarioFile, inspection_params: Params, key: str
) -> None:
    section, _, name = key.partition(".")
    value = getattr(getattr(inspection_file, section), name)
    value = np.asarray(equipment_faults.KINDS.index(value) if key == "fault.kind" else value, dtype=float)
    path, found_factor = parameters.leaf_path_and_factor(key)
    leaf = np.asarray(parameters.get_leaf(inspection_params, path))
    assert found_factor == pytest.approx(factor(key), rel=1e-15)
    assert leaf.dtype == np.float64
    np.testing.assert_allclose(leaf, value * factor(key), rtol=1e-15)


def test_every_number_has_its_own_leaf() -> None:
    paths = [parameters.leaf_path_and_factor(key)[0] for key in numeric_keys()]
    assert len(paths) > 90
    assert len(set(paths)) == len(paths)


@pytest.mark.parametrize("key", ["servicer.mass_g", "camera.width_px", "rates.plant_hz", "mass_kg", ""])
def test_an_unknown_or_static_key_has_no_leaf(key: str) -> None:
    with pytest.raises(ScenarioError):
        parameters.leaf_path_and_factor(key)


def test_the_name_of_a_leaf_is_its_key_in_si() -> None:
    assert parameters.leaf_path_and_factor("servicer.mass") == (("plant", "servicer", "mass"), 1.0)


def test_replacing_a_leaf_changes_that_leaf_only(inspection_params: Params) -> None:
    path = ("flight", "navigation", "gate_sigma")
    changed = parameters.replace_leaf(inspection_params, path, parameters.get_leaf(inspection_params, path) + 1.0)
    assert float(parameters.get_leaf(changed, path)) == float(parameters.get_leaf(inspection_params, path)) + 1.0
    assert changed.flight.navigation.edge_noise is inspection_params.flight.navigation.edge_noise
    assert changed.plant is inspection_params.plant


def test_the_vehicle_model_of_the_flight_software_is_nominal(
    inspection_file: ScenarioFile, inspection_params: Params
) -> None:
    vehicle, camera = inspection_params.flight.vehicle, inspection_file.camera
    assert float(vehicle.mass) == inspection_file.servicer.mass_kg
    assert float(vehicle.thrust) == inspection_file.thruster.force_n
    np.testing.assert_allclose(np.linalg.norm(vehicle.thrust_direction), 1.0, rtol=1e-15)
    half_angle = np.deg2rad(0.5 * camera.field_of_view_deg)
    np.testing.assert_allclose(vehicle.focal_px, 0.5 * camera.width_px / np.tan(half_angle), rtol=1e-14)
