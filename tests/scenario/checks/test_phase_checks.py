"""Missions that cannot be flown are refused in one line."""

from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scenario_error_assertions import assert_one_line

from rpojax.core.orbits.yamanaka_ankersen import TargetOrbit
from rpojax.core.pytree import replace
from rpojax.errors import ScenarioError
from rpojax.flight.guidance.references import relative_orbit
from rpojax.flight.guidance.references.phase_entry import PhaseEntry
from rpojax.flight.guidance.references.relative_orbit import RelativeOrbit
from rpojax.scenario.checks import phase_checks
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.schema import ScenarioFile


@pytest.fixture
def tables(inspection_file: ScenarioFile) -> dict[str, Any]:
    """Tables of the scenario `inspection`."""
    return inspection_file.model_dump()


FIRST = {"name": "far", "reference": {"kind": "hold", "position_m": [0.0, -60.0, 0.0]}, "until": {"time_s": 600.0}}
APPROACH = {
    "kind": "approach",
    "end_position_m": [0.0, -30.0, 0.0],
    "max_speed_m_s": 0.02,
    "time_constant_s": 500.0,
    "final_speed_m_s": 0.005,
}
TRANSFER = {"kind": "transfer", "position_m": [0.0, 40.0, 0.0], "duration_s": 600.0}
BEHIND = {"axis": [0.0, -1.0, 0.0], "half_angle_deg": 10.0, "width_m": 1.0}
LAST = {"name": "near", "reference": {"kind": "hold", "position_m": [0.0, -30.0, 0.0]}}

BAD: dict[str, tuple[list[dict[str, Any]], str, tuple[str, ...]]] = {
    "same name": ([FIRST, FIRST | {"until": None}], "phases.name", ("no other phase",)),
    "built-in name": ([LAST | {"name": "hold"}], "phases.name", ("aborted",)),
    "never ends": ([{k: v for k, v in FIRST.items() if k != "until"}, LAST], "phases.far", ("timeout_s",)),
    "ends after the run": ([FIRST | {"until": {"time_s": 1e5}}, LAST], "phases.far.until.time_s", ("6000",)),
    "no condition": ([FIRST | {"until": {}}, LAST], "phases.far.until", ("time_s",)),
    "duration without its limit": (
        [FIRST | {"until": {"arrival_for_s": 10.0}}, LAST],
        "phases.far.until.arrival_for_s",
        ("arrival_box_m",),
    ),
    "period too short": ([LAST | {"control_period_s": 100.0}], "phases.near.control_period_s", ("115",)),
    "period between decisions": ([LAST | {"control_period_s": 210.0}], "phases.near.control_period_s", ("20 s",)),
    "inside the keep-out zone": (
        [LAST | {"keep_out_m": [10.0, 40.0, 10.0]}],
        "phases.near.reference",
        ("keep-out zone", "42 m"),
    ),
    "inside the margin of the zone": (
        [LAST | {"keep_out_m": [10.0, 29.0, 10.0]}],
        "phases.near.reference",
        ("31 m", "abort_margin_m"),
    ),
    "zone smaller than the one that judges": (
        [LAST | {"keep_out_m": [3.0, 12.0, 12.0]}],
        "phases.near.keep_out_m",
        ("limits.keep_out_m = 10 m",),
    ),
    "start inside the first zone": (
        [LAST | {"keep_out_m": [12.0, 55.0, 12.0], "reference": TRANSFER | {"position_m": [0.0, -60.0, 0.0]}}],
        "initial.relative_position_m",
        ("phases.near.keep_out_m",),
    ),
    "times out before it may end": (
        [FIRST | {"timeout_s": 300.0}, LAST],
        "phases.far.timeout_s",
        ("until.time_s = 600",),
    ),
    "times out before it may have arrived": (
        [FIRST | {"until": {"arrival_box_m": [1.0, 1.0, 1.0], "arrival_for_s": 700.0}, "timeout_s": 600.0}, LAST],
        "phases.far.timeout_s",
        ("until.arrival_for_s = 700",),
    ),
    "leads nowhere": (
        [{k: v for k, v in FIRST.items() if k != "until"} | {"timeout_s": 600.0}, LAST],
        "phases.far.on_timeout",
        ("other phases follow",),
    ),
    "ends faster than it goes": (
        [LAST | {"reference": APPROACH | {"final_speed_m_s": 0.03}}],
        "phases.near.reference.final_speed_m_s",
        ("max_speed_m_s = 0.02",),
    ),
    "outside its corridor": (
        [LAST | {"corridor": {"axis": [0.0, 1.0, 0.0], "half_angle_deg": 10.0, "width_m": 1.0}}],
        "phases.near.reference",
        ("phases.near.corridor",),
    ),
    "walking ellipse through the target": (
        [LAST | {"reference": {"kind": "relative_orbit", "radial_m": 20.0, "drift_per_orbit_m": 100.0}}],
        "phases.near.reference",
        ("keep-out zone",),
    ),
    "impulse too large": (
        [LAST | {"reference": TRANSFER | {"position_m": [0.0, -500.0, 0.0]}}],
        "phases.near.reference.duration_s",
        ("36.6 mm/s", "pulses"),
    ),
    "pulse of a glide slope too large": (
        [
            LAST
            | {"reference": {"kind": "transfer", "position_m": [0.0, -500.0, 0.0], "duration_s": 600.0, "pulses": 4}}
        ],
        "phases.near.reference.duration_s",
        ("mm/s", "pulses"),
    ),
    "approach through the target": (
        [FIRST, LAST | {"reference": APPROACH | {"end_position_m": [0.0, 30.0, 0.0]}}],
        "phases.near.reference",
        ("keep-out zone",),
    ),
    "approach that begins outside its corridor": (
        [
            FIRST | {"reference": {"kind": "hold", "position_m": [30.0, -60.0, 0.0]}},
            LAST
            | {"reference": APPROACH, "corridor": {"axis": [0.0, -1.0, 0.0], "half_angle_deg": 10.0, "width_m": 1.0}},
        ],
        "phases.near.reference",
        ("phases.near.corridor",),
    ),
    "transfer through the target": (
        [
            FIRST | {"reference": {"kind": "hold", "position_m": [0.0, -40.0, 0.0]}},
            LAST
            | {"reference": {"kind": "transfer", "position_m": [0.0, 40.0, 0.0], "duration_s": 4000.0, "pulses": 12}},
        ],
        "phases.near.reference",
        ("keep-out zone",),
    ),
}


@pytest.mark.parametrize("eccentricity", [0.0, 0.7])
def test_places_of_a_relative_orbit_are_those_of_its_reference(tables: dict[str, Any], eccentricity: float) -> None:
    shape = {"radial": 40.0, "radial_phase": 0.4, "cross_track": 50.0, "cross_track_phase": 1.1, "along_track": -300.0}
    section = {"kind": "relative_orbit", "radial_m": 40.0, "cross_track_m": 50.0, "along_track_m": -300.0}
    section |= {"radial_phase_deg": float(np.degrees(0.4)), "cross_track_phase_deg": float(np.degrees(1.1))}
    orbit = tables["orbit"] | {"eccentricity": eccentricity, "semi_major_axis_m": 24.4e6}
    file = scenario_loader.validate(tables | {"orbit": orbit, "phases": [LAST | {"reference": section}]})
    places = phase_checks._relative_orbit_places(file, file.phases[0].reference, 1e4)  # pyright: ignore
    zero = jnp.asarray(0.0)
    reference = RelativeOrbit(**{k: jnp.asarray(v) for k, v in shape.items()}, drift_per_orbit=zero, join=zero)
    perigee = np.radians(file.orbit.argument_of_perigee_deg)
    ex, ey = (jnp.asarray(eccentricity * each(perigee)) for each in (np.cos, np.sin))
    target = TargetOrbit(argument_of_latitude=zero, ex=ex, ey=ey, semi_major_axis=jnp.asarray(24.4e6))
    entry = PhaseEntry(relative_state=jnp.zeros(6), orbit=target)
    for place, u in zip(places, np.linspace(0.0, 2.0 * np.pi, len(places)), strict=True):
        if round(np.degrees(u)) % 30 == 0:
            there = relative_orbit.state(reference, entry, replace(target, argument_of_latitude=jnp.asarray(u)), zero)
            np.testing.assert_allclose(place, there[:3], atol=1e-6)


def test_a_drift_that_does_not_reach_the_target_within_the_run_is_accepted(tables: dict[str, Any]) -> None:
    walk = {"kind": "relative_orbit", "radial_m": 20.0, "along_track_m": -500.0, "drift_per_orbit_m": 50.0}
    file = scenario_loader.validate(tables | {"phases": [LAST | {"reference": walk}]})
    assert file.phases[0].reference.model_dump(exclude_defaults=True) == walk
    # It comes 50 m nearer in each orbit: in ten of them it is there.
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables | {"duration_s": 60000.0, "phases": [LAST | {"reference": walk}]})
    assert_one_line(caught.value, "phases.near.reference", "keep-out zone")


@pytest.mark.parametrize("along_track_m", np.arange(-160.0, -150.0, 0.5).tolist())
def test_a_drift_through_the_zone_is_refused_wherever_it_begins(tables: dict[str, Any], along_track_m: float) -> None:
    walk = {"kind": "relative_orbit", "along_track_m": along_track_m, "drift_per_orbit_m": 55.0}
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables | {"duration_s": 30000.0, "phases": [LAST | {"reference": walk}]})
    assert_one_line(caught.value, "phases.near.reference", "keep-out zone")


def test_decisions_are_made_within_what_an_abort_looks_ahead(tables: dict[str, Any]) -> None:
    rates, mission = tables["rates"] | {"formation_period_s": 280.0}, tables["mission"] | {"decision_period_s": 70.0}
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables | {"rates": rates, "mission": mission, "phases": [LAST]})
    assert_one_line(caught.value, "mission.decision_period_s", "formation.lead_s = 60")


@pytest.mark.parametrize("name", BAD)
def test_a_mission_that_cannot_be_flown_is_refused(tables: dict[str, Any], name: str) -> None:
    phases, key, words = BAD[name]
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(
            tables | {"phases": [{k: v for k, v in each.items() if v is not None} for each in phases]}
        )
    assert_one_line(caught.value, key, *words)


def test_settings_of_the_mission_need_phases(tables: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError) as caught:
        scenario_loader.validate(tables | {"mission": {"abort_at_s": 100.0}})
    assert_one_line(caught.value, "mission", "phases")


def test_a_key_of_a_phase_is_set_by_the_name_of_the_phase(tmp_path: Any) -> None:
    path = tmp_path / "mission.toml"
    path.write_text(
        'extends = "inspection"\nname = "m"\n[[phases]]\nname = "near"\n'
        'reference = { kind = "hold", position_m = [0.0, -30.0, 0.0] }\n'
    )
    file = scenario_loader.load(
        path, ["phases.near.timeout_s=500", "phases.near.reference.position_m=[0.0, -40.0, 0.0]"]
    )
    near = file.phases[0]
    assert (near.timeout_s, near.reference.model_dump()["position_m"]) == (500.0, [0.0, -40.0, 0.0])
    with pytest.raises(ScenarioError, match="did you mean 'near'"):
        scenario_loader.load(path, ["phases.neer.timeout_s=500"])


def test_a_fault_of_the_schema_names_the_phase() -> None:
    with pytest.raises(ScenarioError, match=r"^phases.approach.timeout_s: found -1, expected greater than 0"):
        scenario_loader.load("vbar_approach", ["phases.approach.timeout_s=-1"])
