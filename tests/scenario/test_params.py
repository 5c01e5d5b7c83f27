"""Parameters of a run: every number of a scenario in its leaf, in SI units."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pydantic import BaseModel

import rpojax
from rpojax.core.pytree import replace
from rpojax.errors import ScenarioError
from rpojax.flight.navigation import burn_execution_error, shape_errors
from rpojax.flight.navigation.orbit_filter_tuning import OrbitFilterTuning
from rpojax.physics import equipment_faults
from rpojax.scenario import params as parameters
from rpojax.scenario.dispersed_numbers import dispersed_values
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.params import Params
from rpojax.scenario.schema import ScenarioFile

STATIC = {
    "field",
    "detector",
    "statistics",
    "landmark_network",
    "sky_seed",
    "model",
    "landmarks",
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
    "delays",
    "delay_memory_s",
    "distortion",
    "bloom",
    "exposure_time_s",
}
"""Keys of static settings, of a section that may be absent, and of optics that are so by default."""


def numeric_keys() -> list[str]:
    """Every key of the schema that is a parameter."""
    keys = []
    for name, field in ScenarioFile.model_fields.items():
        section = field.annotation
        if (
            name not in ("rates", "effects", "safety", "coverage", "mission", "tuning", "goal")
            and isinstance(section, type)
            and issubclass(section, BaseModel)
        ):
            keys += [
                f"{name}.{key}"
                for key in section.model_fields
                if key not in STATIC or f"{name}.{key}" in ("faults.fault.kind", "camera.delay_s")
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
    value = np.asarray(equipment_faults.KINDS.index(value) if key == "faults.fault.kind" else value, dtype=float)
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


FLIGHT = {
    *("navigation", "attitude_filter", "formation", "pointing", "attitude_control", "health", "mission", "phases"),
    *("team", "tuning", "isolation"),
}
"""Sections of the flight software, of the ground and of users."""
VEHICLE = "flight software is configured with the nominal vehicle, as its builder declares it; a dispersion is truth"
AIR = "flight software has a nominal model of the air, from which the true one is dispersed"
ON_PURPOSE = {
    "servicer.mass_kg": (".vehicle.mass", VEHICLE),
    "servicer.inertia_kg_m2": (".vehicle.inertia", VEHICLE),
    "thruster.force_n": (".vehicle.thrust", VEHICLE),
    "thruster.minimum_on_time_s": (".vehicle.minimum_on_time", VEHICLE),
    "thruster.direction": (".vehicle.thrust_direction", VEHICLE),
    "wheels.axes": (".vehicle.wheel_axes", VEHICLE),
    "wheels.inertia_kg_m2": (".vehicle.wheel_inertia", VEHICLE),
    "wheels.torque_limit_n_m": (".vehicle.wheel_torque_limit", VEHICLE),
    "camera.field_of_view_deg": (".vehicle.focal_px", VEHICLE),
    "camera.mounting": (".vehicle.camera_mounting", VEHICLE),
    "camera.phase_limit_deg": (".vehicle.phase_limit", VEHICLE),
    "camera.sun_exclusion_deg": (".vehicle.sun_exclusion", VEHICLE),
    "imaging.center_sigma_m": (".navigation.detector_center_sigma", "a belief alone, declared beside the detector"),
    "atmosphere.altitude_m": (".atmosphere.altitude", AIR),
    "atmosphere.density_kg_m3": (".atmosphere.density", AIR),
    "atmosphere.rotation_rad_s": (".atmosphere.rotation", AIR),
    "atmosphere.scale_height_m": (".atmosphere.scale_height", AIR),
    "plume.inhibit_within_m": (".plume_rule.inhibit_within", "a rule of flight software, declared beside the plume"),
    "plume.inhibit_angle_deg": (".plume_rule.inhibit_angle", "a rule of flight software, declared beside the plume"),
    "limits.keep_out_m": (".mission.keep_out", "the rule that outcomes judge is the one that flight software keeps"),
}
"""Key of a section of the truth -> leaf of the flight software that it sets, and why."""


BESIDE_THE_TRUTH = {
    "plume.inhibit_within_m",
    "plume.inhibit_angle_deg",
    "imaging.center_sigma_m",
    "wide_lens.switch_range_m",
    "wide_lens.return_range_m",
    "wide_lens.misalignment_sigma_deg",
}
"""Keys of the flight software in sections of the truth."""


def of_flight(tables: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Leaves of the flight software, without those of single phases."""
    flight = parameters.build_params(tables, 512, 512).flight
    leaves = {
        jax.tree_util.keystr(path): np.asarray(leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(flight)
    }
    return {name: leaf for name, leaf in leaves.items() if ".phases[" not in name}


def changed(value: Any) -> Any:
    """Another value of the same kind: of a switch, a number, or each number of a list."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return 1.07 * value + 0.013
    return [changed(each) for each in value] if isinstance(value, list | tuple) else value


def test_no_key_of_the_truth_sets_a_belief_but_those_that_both_read_on_purpose() -> None:
    tables = rpojax.load("rendezvous").model_dump()
    before, found, tried = of_flight(tables), {}, 0
    for section, table in tables.items():
        if section in FLIGHT or not isinstance(table, dict):
            continue
        for key, value in table.items():
            if changed(value) != value and key != "outages_s":
                tried += 1
                after = of_flight({**tables, section: {**table, key: changed(value)}})
                assert after.keys() == before.keys()
                names = [name for name in before if not np.array_equal(before[name], after[name])]
                if names:
                    found[f"{section}.{key}"] = names
    assert tried > 100
    assert found == {key: [leaf] for key, (leaf, _) in ON_PURPOSE.items()}


def test_a_dispersed_key_of_the_truth_changes_no_belief() -> None:
    of_truth = [key for key in numeric_keys() if key.partition(".")[0] not in FLIGHT and key not in BESIDE_THE_TRUTH]
    assert len(of_truth) > 80
    assert {parameters.leaf_path_and_factor(key)[0][0] for key in of_truth} & {"flight", "baseline"} == set()


def tuning_of(overrides: list[str], **values: float) -> OrbitFilterTuning:
    """Tuning of the filter of `inspection` with dispersed values; keys have `__` for a dot."""
    file = rpojax.load("inspection", overrides)
    params = parameters.build_params(file.model_dump(), 512, 512)
    drawn = {key.replace("__", "."): jnp.asarray(value) for key, value in values.items()}
    return dispersed_values.apply_to_params(params, drawn).flight.navigation


@pytest.mark.parametrize(("model", "of_detector"), [("geometric", 0.0), ("rendered", 0.03), ("statistical", 0.03)])
def test_both_dispersed_sigmas_of_the_centre_count_where_a_detector_finds_boxes(model: str, of_detector: float) -> None:
    tuning = tuning_of(
        [f"camera.model={model}", "navigation.center_perspective=0"],
        navigation__center_sigma_m=0.04,
        imaging__center_sigma_m=0.03,
    )
    found = shape_errors.center_variance(tuning, jnp.zeros(()), jnp.array([30.0, 0.0, 0.0]))
    assert float(found) == pytest.approx(0.04**2 + of_detector**2, rel=1e-14)


def test_both_dispersed_errors_of_burns_count_with_and_without_sharing() -> None:
    values = {"navigation__burn_magnitude_sigma": 0.03, "navigation__burn_scale_sigma": 0.02}
    alone = tuning_of([], **values)
    # Filters that are shared have no state for what lasts: twice of it counts as new in each burn.
    shared = replace(alone, burn_scale_as_new=team_tuning().burn_scale_as_new)
    assert (float(burn_execution_error.new_sigma(alone)), float(burn_execution_error.lasting_sigma(alone))) == (
        0.03,
        0.02,
    )
    assert float(burn_execution_error.new_sigma(shared)) == pytest.approx(0.05, rel=1e-14)
    assert float(burn_execution_error.lasting_sigma(shared)) == 0.0
    assert float(burn_execution_error.new_magnitude_sigma(shared, jnp.asarray(2.0))) == pytest.approx(0.1, rel=1e-14)


def test_gates_as_steps_change_the_width_of_their_slopes_alone() -> None:
    _, params, _ = rpojax.initialise_run(rpojax.load("inspection"), 0, 0)
    given, steps = params.flight, params.with_steps().flight
    assert (float(given.navigation.gate_slope_width), float(given.formation.dead_band_slope)) == (0.25, 0.05)
    assert np.isinf([float(steps.navigation.gate_slope_width), float(steps.formation.dead_band_slope)]).all()
    back = replace(
        steps,
        navigation=replace(steps.navigation, gate_slope_width=given.navigation.gate_slope_width),
        formation=replace(steps.formation, dead_band_slope=given.formation.dead_band_slope),
    )
    assert jax.tree.all(jax.tree.map(np.array_equal, back, given))


def team_tuning() -> OrbitFilterTuning:
    """Tuning of the filter of a servicer whose boxes are shared."""
    tables = rpojax.load("cooperative_inspection").model_dump()
    return parameters.build_params(tables, 512, 512).flight.navigation


@pytest.mark.parametrize("sigma", [0.0, 0.016, 0.032, 0.1, 1e-9])
@pytest.mark.parametrize("precision", [jnp.float32, jnp.float64])
def test_a_sigma_that_stands_alone_keeps_its_bits(sigma: float, precision: Any) -> None:
    tuning = jax.tree.map(lambda leaf: leaf.astype(precision), team_tuning())
    one = jnp.asarray(sigma, dtype=precision)
    tuning = replace(tuning, burn_magnitude_sigma=one, burn_scale_sigma=0.0 * one, center_sigma=one)
    tuning = replace(tuning, center_perspective=0.0 * one)
    assert float(jax.jit(burn_execution_error.new_sigma)(tuning)) == float(one)
    found = jax.jit(shape_errors.center_variance)(tuning, 0.0 * one, jnp.ones(3, dtype=precision))
    assert float(found) == float(one * one)


def epoch_of(change: str) -> float:
    """Epoch [s] in the parameters of a changed scenario."""
    file = scenario_loader.load("inspection", [change])
    return float(parameters.build_params(file.model_dump(), 512, 512).epoch.seconds)


@pytest.mark.parametrize(
    ("utc", "days", "leap_s"),
    [
        ("2000-01-01T12:00:00", 0.0, 32.0),
        ("2000-01-02T12:00", 1.0, 32.0),
        ("2010-06-01T12:00:00", 3804.0, 34.0),
        ("2026-03-20T14:46:00", 9575.0 + 2.0 / 24.0 + 46.0 / 1440.0, 37.0),
        ("2026-03-20T15:46:00+01:00", 9575.0 + 2.0 / 24.0 + 46.0 / 1440.0, 37.0),
        ("2026-03-20", 9574.5, 37.0),
    ],
)
def test_the_epoch_is_terrestrial_time_since_2000_01_01_noon(utc: str, days: float, leap_s: float) -> None:
    for written in (f'"{utc}"', utc):  # as text, and as the date that TOML knows
        begin = epoch_of(f"epoch_utc={written}")
        # IERS Bulletin C: TAI-UTC is 32 s in 2000, 34 s in 2010, 37 s since 2017; TT-TAI is 32.184 s.
        assert begin == pytest.approx(days * 86400.0 + leap_s + 32.184, abs=1e-6)


@pytest.mark.parametrize(
    ("utc", "seconds"),
    [
        ("2026-079T14:46:00Z", 827_289_960.0 + 69.184),
        ("2026-03-20T14:46:00.123456789012345", 827_289_960.123456789 + 69.184),
        # Midnight that follows is 17 years of 365 days, 5 leap days and 12 hours less after noon: 536500800 s of UTC.
        ("2016-12-31T23:59:60.5", 536_500_800.0 - 0.5 + 69.184),
        ("2017-01-01T02:59:60+03:00", 536_500_800.0 - 1.0 + 69.184),
        ("1972-01-01T00:00:00", -883_656_000.0 + 42.184),
    ],
)
def test_an_epoch_is_read_as_dates_of_messages_are(utc: str, seconds: float) -> None:
    assert epoch_of(f'epoch_utc="{utc}"') == pytest.approx(seconds, abs=2e-7)
