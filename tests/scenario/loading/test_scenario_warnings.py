"""Keys that were given and have no effect: one line each, none about what a packaged scenario or a copy of it has."""

from pathlib import Path
from typing import Any, get_args

import pytest
import tomli_w

from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.loading.scenario_warnings import scenario_warnings, unused_key_warnings
from rpojax.scenario.phases.phase_sections import PhaseSection
from rpojax.scenario.phases.reference_sections import RelativeOrbitSection, TransferSection
from rpojax.scenario.schema import ScenarioFile
from rpojax.scenario.sections import FaultSection
from rpojax.scenario.warnings.key_uses import FAULT_USES, PHASE_USES, USES, keys_of

FAULTS = "effects.faults=true"
CASES: dict[str, tuple[str, list[str], str]] = {
    "faults.a.kind": ("inspection", ["faults.a.kind=gps_outage"], "found 'gps_outage', effects.faults = true"),
    "faults.a.severity": ("inspection", [FAULTS, "faults.a.kind=none", "faults.a.severity=0.1"], "other than 'none'"),
    "faults.a.wheel": ("inspection", [FAULTS, "faults.a.kind=gps_outage", "faults.a.wheel=1"], "'wheel_stuck'"),
    "faults.a.thruster": ("inspection", [FAULTS, "faults.a.kind=gps_outage", "faults.a.thruster=1"], "[[thrusters]]"),
    "a radio of nobody": ("inspection", [FAULTS, "faults.a.kind=radio_off"], "navigation.sharing"),
    "a fault after the end": (
        "inspection", [FAULTS, "faults.a.kind=gps_outage", "faults.a.start_s=7000"], "a longer duration_s"
    ),
    "the second of two faults": (
        "inspection",
        [FAULTS, "faults.a.kind=wheel_stuck", "faults.b.kind=gps_outage", "faults.b.wheel=1"],
        "faults.b.wheel: found 1, 'wheel_stuck'",
    ),
    "atmosphere.density_kg_m3": ("inspection", ["atmosphere.density_kg_m3=1e-12"], "effects.drag = true"),
    "sunlight.flux_w_m2": ("inspection", ["sunlight.flux_w_m2=1400"], "effects.solar_pressure = true"),
    "target.mass_kg": ("inspection", ["target.mass_kg=50"], "effects.solar_pressure or effects.plume = true"),
    "thruster.rise_time_s": ("inspection", ["thruster.rise_time_s=0.1"], "effects.thruster_ramps = true"),
    "thruster.tank_position_m": ("inspection", ["thruster.tank_position_m=[0,0,0]"], "center_of_mass_shift = true"),
    "wheels.torque_step_n_m": ("inspection", ["wheels.torque_step_n_m=1e-5"], "effects.wheel_torque_steps = true"),
    "wheels.stiction_speed_rad_s": ("inspection", ["wheels.stiction_speed_rad_s=2"], "or a fault of that kind"),
    "camera.edge_noise_px": (
        "inspection", ["camera.model=statistical", "camera.edge_noise_px=0.7"], "found 0.7, camera.model = 'geometric'"
    ),
    "camera.outlier_probability": (
        "inspection", ["camera.model=rendered", "camera.outlier_probability=0.1"], "camera.model = 'geometric'"
    ),
    "camera.outlier_size_max_px": (
        "inspection", ["camera.outlier_probability=0", "camera.outlier_size_max_px=32"], "outlier_probability above 0"
    ),
    "imaging.center_sigma_m": ("inspection", ["imaging.center_sigma_m=0.1"], "'rendered' or 'statistical'"),
    "imaging.sky_seed": ("inspection", ["camera.model=statistical", "imaging.sky_seed=3"], "camera.model = 'rendered'"),
    "coverage.facet_size_m": ("inspection", ["coverage.facet_size_m=0.2"], "coverage.enabled = true"),
    "coverage.mesh_units": ("safety_ellipse", ["coverage.mesh_units=mm"], "a mesh file as coverage.surface"),
    "navigation.tumble_sigma_deg_s": ("inspection", ["navigation.tumble_sigma_deg_s=2"], "camera.landmarks"),
    "navigation.network_turn_sigma_deg": (
        "pose_inspection",
        ["navigation.network_turn_sigma_deg=[2.0, 1.0]"],
        "camera.landmarks of camera.model = 'rendered' or 'statistical'",
    ),
    "navigation.network_place_sigma": (
        "pose_inspection",
        ["navigation.network_place_sigma=[0.001, 0.02]"],
        "camera.landmarks of camera.model = 'rendered' or 'statistical'",
    ),
    "navigation.network_angle_deg": (
        "pose_inspection",
        ["navigation.network_angle_deg=20.0"],
        "camera.landmarks of camera.model = 'rendered' or 'statistical'",
    ),
    "navigation.body_offset_sigma_m": ("inspection", ["navigation.body_offset_sigma_m=0.1"], "camera.landmarks"),
    "imaging.landmark_network": (
        "inspection", ["camera.model=rendered", "imaging.landmark_network=own.safetensors"], "camera.landmarks"
    ),
    "servicer.radius_m": ("inspection", ["servicer.radius_m=0.5"], "a last phase with frame"),
    "landmarks.noise_px": (
        "pose_inspection", ["camera.model=rendered", "landmarks.noise_px=1"], "camera.model = 'geometric': with others"
    ),
    "landmarks.swap_probability": (
        "pose_inspection", ["landmarks.swap_probability=0.1"], "landmarks of a body with a symmetry"
    ),
    "isolation.valve_s": (
        "thruster_failure", ["chamber_pressure.enabled=false", "isolation.valve_s=0.3"], "chamber_pressure.enabled"
    ),
    "isolation.samples": ("final_approach", ["isolation.samples=5"], "isolation.enabled and chamber_pressure.enabled"),
    "chamber_pressure.noise": ("inspection", ["chamber_pressure.noise=0.1"], "chamber_pressure.enabled = true"),
    "navigation.pressure_noise": ("inspection", ["navigation.pressure_noise=0.1"], "chamber_pressure.enabled = true"),
    "formation.thruster_retry_s": ("inspection", ["formation.thruster_retry_s=10"], "chamber_pressure.enabled = true"),
    "navigation.gate_sigma": ("inspection", ["navigation.gating=none", "navigation.gate_sigma=5"], "'covariance'"),
    "formation.desired_position_m": ("vbar_approach", ["formation.desired_position_m=[0,-20,0]"], "no [[phases]]"),
    "health.clearance": ("vbar_approach", ["health.clearance=0.1"], "no [[phases]]"),
    "mission.abort_at_s": ("vbar_approach", ["mission.abort_at_s=10000"], "a longer duration_s"),
    "mission.hold_at_s": (
        "vbar_approach", ["mission.hold_at_s=3000", "mission.abort_at_s=1000"], "a later mission.resume_at_s and"
    ),
    "a command to resume after an abort": (
        "vbar_approach",
        ["mission.hold_at_s=1000", "mission.resume_at_s=3000", "mission.abort_at_s=2000"],
        "mission.resume_at_s, a later mission.abort_at_s",
    ),
    "mission.resume_at_s": ("vbar_approach", ["mission.resume_at_s=5000"], "mission.hold_at_s or a phase with"),
    "gps.common_share": ("inspection", ["gps.common_share=0.5"], "[[servicers]]"),
    "navigation.difference_noise_m": ("inspection", ["navigation.difference_noise_m=1"], "[[servicers]] and"),
    "gps_differences.noise_m": (
        "cooperative_inspection", ["gps_differences={kind='code', noise_m=0.1}"], "gps_differences.kind = 'carrier'"
    ),
    "link.delay_s": (
        "cooperative_inspection", ["navigation.sharing=central", "link.delay_s=2"], "'boxes', 'estimates' or 'naive'"
    ),
    "link.burst_loss": ("cooperative_inspection", ["link.burst_loss=0.5"], "a link.burst_interval_s below 1e+09"),
    "link_range.noise_m": ("cooperative_inspection", ["link_range.noise_m=0.5"], "link_range.enabled = true"),
    "team.lost_after_s": ("cooperative_inspection", ["team.lost_after_s=10"], "'spread' or 'viewpoints'"),
    "team.view_memory_s": (
        "cooperative_inspection", ["team.phasing=spread", "team.view_memory_s=10"], "team.phasing = 'viewpoints'"
    ),
    "phases.hold_12.on_timeout": ("vbar_approach", ["phases.hold_12.on_timeout=abort"], "timeout_s"),
    "phases.behind.control_period_s": (
        "rendezvous", ["phases.behind.pointing=sun_safe", "phases.behind.control_period_s=400"], "pointing = 'target'"
    ),
    "phases.hold_100.reference.speed_ratio": (
        "rendezvous",
        ["phases.hold_100.reference={kind='transfer', position_m=[0,-100,0], duration_s=4000, speed_ratio=0.5}"],
        "reference.pulses above 2",
    ),
    "phases.behind.reference.radial_phase_deg": (
        "rendezvous",
        ["phases.behind.reference={kind='relative_orbit', along_track_m=-120, radial_phase_deg=20, join_s=6000}"],
        "a reference.radial_m above 0",
    ),
    "dispersions.faults.fault.duration_s": (
        "inspection_faults",
        ["effects.faults=false", "dispersions.faults.fault.duration_s={kind='uniform', low=1, high=10}"],
        "found 'uniform', effects.faults",
    ),
    "dispersions.gps.noise_m.common": (
        "inspection", ["dispersions.gps.noise_m={kind='normal', sigma=0.1, common=true}"], "[[servicers]]"
    ),
    "design.values.faults.fault.duration_s": (
        "inspection_faults",
        ["effects.faults=false", "design={kind='grid', values={'faults.fault.duration_s'=[0.1, 0.2]}}"],
        "found [0.1, 0.2], effects.faults",
    ),
    "servicers.second.faults.fault.severity": (
        "cooperative_faults", ["servicers.second.faults.fault.severity=0.1"], "kind = 'thruster_weak'"
    ),
    "a key that no servicer uses": ("cooperative_faults", ["faults.fault.severity=0.1"], "faults.fault.severity: "),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_a_key_that_was_given_and_has_no_effect_is_named(name: str) -> None:
    source, overrides, words = CASES[name]
    (line,) = unused_key_warnings(scenario_loader.load(source, overrides))
    assert ", which has no effect, expected " in line
    assert line.endswith(" beside it")
    assert all(word in line for word in words.split(", "))
    if "." in name and " " not in name:
        assert line.startswith(f"{name}: found ")


@pytest.mark.parametrize("name", scenario_loader.packaged_names())
def test_there_is_no_warning_about_a_packaged_scenario_or_a_complete_copy(name: str, tmp_path: Path) -> None:
    file = scenario_loader.load(name)
    assert scenario_warnings(file) == []
    copy = tmp_path / "copy.toml"
    copy.write_text(tomli_w.dumps(file.model_dump(mode="json", exclude_none=True)))
    assert scenario_warnings(scenario_loader.load(copy)) == []


@pytest.mark.parametrize(
    ("source", "overrides"),
    [
        # What the packaged scenario has, and the user did not give.
        ("inspection_faults", ["effects.faults=false"]),
        ("inspection_full", ["effects.drag=false", "effects.solar_pressure=false", "effects.wheel_friction=false"]),
        ("cooperative_faults", ["effects.faults=false", "chamber_pressure.enabled=false", "team.phasing=fixed"]),
        ("cooperative_inspection", ["navigation.sharing=none", "team.keep_out_m=0"]),
        ("safety_ellipse", ["coverage.enabled=false", "requirements=[]"]),
        ("inspection_abort", ["duration_s=600", "requirements=[]"]),
        # What the user gave, and is used.
        (
            "inspection",
            [
                "effects.faults=true",
                "faults.fault.kind=wheel_friction",
                "faults.fault.severity=0.1",
                "faults.fault.wheel=1",
            ],
        ),
        ("inspection", ["effects.drag=true", "target.mass_kg=50", "atmosphere.density_kg_m3=1e-12"]),
        ("inspection_faults", ["faults.fault.duration_s=100", "wheels.stiction_speed_rad_s=2"]),
        ("inspection", ["camera.edge_noise_px=0.7", "camera.outlier_size_max_px=32"]),
        ("inspection", ["chamber_pressure={enabled=true, noise=0.02}", "formation.thruster_retry_s=10"]),
        ("safety_ellipse", ["coverage.facet_size_m=0.2"]),
        ("cooperative_inspection", ["link.loss=0.1", "gps.common_share=0.5", "navigation.difference_noise_m=0.1"]),
        ("rendezvous", ["phases.behind.control_period_s=400", "phases.drift.on_timeout=abort"]),
        # A servicer's own fault is one of the team.
        (
            "cooperative_faults",
            ["faults.fault.start_s=100", "servicers.third.faults.fault={kind='gps_outage'}"],
        ),
        # The packaged value.
        ("inspection", ["imaging.center_sigma_m=0.016"]),
    ],
)
def test_there_is_no_warning_about_keys_that_are_used_or_were_not_given(source: str, overrides: list[str]) -> None:
    assert unused_key_warnings(scenario_loader.load(source, overrides)) == []


def test_a_command_to_resume_before_the_one_to_hold_leaves_both_without_effect() -> None:
    overrides = ["mission.hold_at_s=3000", "mission.resume_at_s={}"]
    for resume_s, keys in ((1000, ["mission.hold_at_s", "mission.resume_at_s"]), (4000, [])):
        file = scenario_loader.load("vbar_approach", [each.format(resume_s) for each in overrides])
        assert [line.partition(":")[0] for line in unused_key_warnings(file)] == keys


def test_keys_whose_numbers_a_replaced_stage_is_handed_are_not_judged() -> None:
    overrides = ["navigation.gating=none", "navigation.gate_sigma=3", "camera.model=rendered", "camera.edge_noise_px=2"]
    file = scenario_loader.load("inspection", overrides)
    keys = ["camera.edge_noise_px", "navigation.gate_sigma"]
    assert [line.partition(":")[0] for line in unused_key_warnings(file)] == keys
    assert [line.partition(":")[0] for line in unused_key_warnings(file, ["orbit_update"])] == keys[:1]
    assert [line.partition(":")[0] for line in unused_key_warnings(file, ["wheel_torque"])] == keys


def test_defaults_of_phases_of_your_own_are_not_given() -> None:
    tables: dict[str, Any] = scenario_loader.load("inspection").model_dump()
    tables["phases"] = [
        {
            "name": "drift",
            "reference": {"kind": "relative_orbit", "along_track_m": -50.0},
            "until": {"time_s": 1000.0},
            "pointing": "velocity",
        },
        {"name": "over", "reference": {"kind": "transfer", "position_m": [0.0, -30.0, 0.0], "duration_s": 3000.0}},
    ]
    assert unused_key_warnings(scenario_loader.validate(tables)) == []
    tables["phases"][0]["reference"]["radial_phase_deg"] = 20.0
    (line,) = unused_key_warnings(scenario_loader.validate(tables))
    assert line.startswith("phases.drift.reference.radial_phase_deg: found 20.0, ")


def test_a_copy_of_a_scenario_says_as_much_as_the_scenario(tmp_path: Path) -> None:
    file = scenario_loader.load(
        "cooperative_faults", ["effects.faults=false", "faults.fault.start_s=100", "atmosphere.density_kg_m3=1e-12"]
    )
    copy = tmp_path / "copy.toml"
    copy.write_text(tomli_w.dumps(file.model_dump(mode="json", exclude_none=True)))
    lines = unused_key_warnings(file)
    assert [line.partition(":")[0] for line in lines] == ["atmosphere.density_kg_m3", "faults.fault.start_s"]
    assert unused_key_warnings(scenario_loader.load(copy)) == lines


def test_a_number_that_was_tuned_without_effect_is_not_given() -> None:
    tables: dict[str, Any] = scenario_loader.load("inspection", ["navigation.gating=none"]).model_dump()
    tables["navigation"]["gate_sigma"] *= 1.0 + 1e-15
    assert unused_key_warnings(scenario_loader.validate(tables)) == []


def test_every_key_of_the_table_exists() -> None:
    named = [key for use in USES for pattern in use.keys for key in keys_of(pattern)]
    for key in named:
        section, _, name = key.partition(".")
        annotation: Any = ScenarioFile.model_fields[section].annotation
        model = next((each for each in get_args(annotation) if each is not type(None)), annotation)
        assert name in model.model_fields, key
    of_faults = {name for use in FAULT_USES for name in use.keys}
    assert {*FaultSection.model_fields} - of_faults == {"name"}
    of_phases = {name for use in PHASE_USES for name in use.keys}
    references = {f"reference.{name}" for each in (RelativeOrbitSection, TransferSection) for name in each.model_fields}
    assert of_phases <= {*PhaseSection.model_fields, *references}
