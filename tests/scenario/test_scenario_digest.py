"""Hash of a scenario: what changes it and what does not."""

import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
from scenario_variants import with_design

from rpojax.scenario import former_fault
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.scenario_digest import scenario_digest
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.static_settings import static_settings
from rpojax.vision.radiance_field import field_file
from rpojax.vision.surface import landmark_file


@pytest.fixture
def tables(inspection_file: ScenarioFile) -> dict[str, Any]:
    """Tables of the nominal scenario, free to be changed."""
    return inspection_file.model_dump()


def test_the_digest_depends_on_numbers_and_not_on_the_description(inspection_file: ScenarioFile) -> None:
    digest = scenario_digest(inspection_file)
    assert scenario_digest(scenario_loader.load("inspection", ["description=another"])) == digest
    assert scenario_digest(scenario_loader.load("inspection", ["gps.noise_m=2.5"])) != digest


def test_requirements_do_not_change_the_digest(tables: dict[str, Any]) -> None:
    with_requirements = scenario_loader.validate(tables)
    assert with_requirements.requirements
    del tables["requirements"]
    without = scenario_loader.validate(tables)
    assert without.requirements == []
    assert scenario_digest(without) == scenario_digest(with_requirements)
    assert static_settings(without) == static_settings(with_requirements)


@pytest.mark.parametrize("faults", [False, True])
def test_defaults_are_not_hashed(tables: dict[str, Any], faults: bool) -> None:
    tables["effects"]["faults"] = tables["chamber_pressure"]["enabled"] = faults
    file = scenario_loader.validate({**tables, "limits": {"keep_out_m": 10.0}})
    content = {**file.model_dump(mode="json"), "limits": {"keep_out_m": 10.0}}
    optional = (
        "safety",
        "coverage",
        "mission",
        "goal",
        "phases",
        "servicers",
        "thrusters",
        "link",
        "team",
        "gps_differences",
        "plume",
        "isolation",
    )
    del content["chamber_pressure"], content["link_range"]
    for key in ("name", "description", "requirements", "tuning", "design", "precision", "format_version", *optional):
        del content[key]
    assert content.pop("faults") == []
    content["fault"] = dict(former_fault.NOMINAL)
    del content["target"]["scale"], content["effects"]["plume"]
    del content["effects"]["inertia_change"], content["thruster"]["tank_radius_m"]
    del content["health"]["lasting_limit"], content["rates"]["command_delay_s"]
    del content["imaging"]["bloom_radius_px"], content["imaging"]["fill_light"]
    for key in ("delay_s", "delay_jitter_s", "processing_s", "time_tag_error_s"):
        del content["camera"][key]
    del content["camera"]["landmarks"], content["servicer"]["radius_m"], content["imaging"]["landmark_network"]
    network = ("network_turn_sigma_deg", "network_place_sigma", "network_angle_deg")
    for key in (
        "tumble_sigma_deg_s",
        "tumble_walk_deg_s_sqrt_s",
        "inertia_ratio_sigma",
        "body_offset_sigma_m",
        *network,
    ):
        del content["navigation"][key]
    for key in (
        "ballistic_sigma_m2_kg",
        "adaptation_limit",
        "thrust_walk_sqrt_s",
        "pressure_noise",
        "delays",
        "delay_memory_s",
    ):
        del content["navigation"][key]
    for key in (
        "minimum_size_px",
        "miss_probability",
        "center_perspective",
        "target_size_sigma",
        "largest_side_log",
        "sharing",
    ):
        del content["navigation"][key]
    for key in ("outline_time_constant_s", *(key for key in content["navigation"] if key.startswith("difference_"))):
        del content["navigation"][key]
    for key in ("nearest_surface", "nearest_surface_sigma", "centroid", "centroid_sigma"):
        del content["navigation"][key]
    del content["gps"]["common_share"]
    text = json.dumps(content, sort_keys=True)
    assert scenario_digest(file) == hashlib.sha256(text.encode()).hexdigest()
    single = file.model_copy(update={"precision": "single"})
    assert scenario_digest(single) != scenario_digest(file)
    larger = scenario_loader.validate({**tables, "target": {**tables["target"], "scale": 1.1}})
    assert scenario_digest(larger) != scenario_digest(file)


def test_a_key_with_a_default_is_hashed_unless_it_has_that_value(tables: dict[str, Any]) -> None:
    def digest(**limits: float) -> str:
        return scenario_digest(scenario_loader.validate({**tables, "limits": {"keep_out_m": 10.0, **limits}}))

    assert digest() == digest(lost_after_s=600.0, off_station_m=10.0)
    assert len({digest(), digest(lost_after_s=500.0), digest(off_station_m=20.0)}) == 3


def test_the_pressure_sensor_is_hashed_where_it_is_not_as_with_faults_before(tables: dict[str, Any]) -> None:
    def digest(faults: bool, **sensor: Any) -> str:
        effects = {**tables["effects"], "faults": faults}
        return scenario_digest(scenario_loader.validate({**tables, "effects": effects, "chamber_pressure": sensor}))

    assert len({digest(faults, enabled=enabled) for faults in (False, True) for enabled in (False, True)}) == 4
    assert len({digest(True, enabled=True, noise=noise) for noise in (0.03, 0.04, 0.05)}) == 3
    assert digest(True, enabled=True) == digest(True, enabled=True, noise=0.03)


def test_the_content_of_trained_files_is_hashed(tmp_path: Path) -> None:
    copy = tmp_path / "other.safetensors"
    copy.write_bytes(field_file.packaged_field_path().read_bytes() + b" ")
    one = scenario_loader.load("inspection", ["camera.model=rendered"])
    other = scenario_loader.load("inspection", ["camera.model=rendered", f"imaging.field={copy}"])
    assert scenario_digest(one) != scenario_digest(other)


def test_the_content_of_the_file_of_landmarks_is_hashed(tmp_path: Path) -> None:
    landmarks, card = landmark_file.load_landmarks()
    path, digests = tmp_path / "own.safetensors", []
    for count in (0, 1):
        landmark_file.save_landmarks(landmarks, path, {**card, "count": count})
        digests.append(scenario_digest(scenario_loader.load("pose_inspection", [f"camera.landmarks={path}"])))
    assert len({*digests, scenario_digest(scenario_loader.load("pose_inspection"))}) == 3


def test_the_section_of_landmarks_is_hashed_alike_given_or_left_out(tables: dict[str, Any]) -> None:
    def digest(**section: float) -> str:
        camera = {**tables["camera"], "landmarks": "packaged"}
        return scenario_digest(scenario_loader.validate({**tables, "camera": camera, "landmarks": section}))

    assert digest() == scenario_digest(scenario_loader.load("inspection", ["camera.landmarks=packaged"]))
    assert digest() == digest(delay_s=0.0, noise_px=0.7)
    assert digest() != digest(noise_px=0.8)


def test_the_order_of_the_keys_of_a_grid_is_hashed(mission: ScenarioFile) -> None:
    values = {"gps.noise_m": [1.0, 2.0], "servicer.mass_kg": [29.0, 31.0]}
    tables = mission.model_dump()
    free = tables | {"dispersions": []}
    there, back = (
        scenario_loader.validate(free | {"design": {"kind": "grid", "values": dict(items)}})
        for items in (values.items(), reversed(values.items()))
    )
    assert scenario_digest(there) != scenario_digest(back)
    tables.pop("design")
    assert scenario_digest(scenario_loader.validate(tables)) == scenario_digest(mission)
    assert scenario_digest(with_design(mission, kind="sobol")) != scenario_digest(mission)
