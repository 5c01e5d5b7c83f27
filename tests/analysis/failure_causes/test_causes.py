"""Each rule finds the failure that is planted in small arrays, with its numbers, and none where nothing is wrong."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from planted_evidence import FAILED, RUNS, file_of, phases_of, planted

from rpojax.analysis.failure_causes import mission_rules
from rpojax.analysis.failure_causes.belief_mends import belief_mend
from rpojax.analysis.failure_causes.present_values import with_present_values
from rpojax.analysis.failure_causes.ranking import all_findings, causes
from rpojax.analysis.failure_causes.run_evidence import RunEvidence
from rpojax.flight.mission.mission_state import AbortReason, Condition
from rpojax.flight.navigation_health import TESTS
from rpojax.physics.equipment_faults import KINDS
from rpojax.scenario.loading import scenario_loader
from rpojax.scenario.phases.phase_sections import CONDITION_KEYS
from rpojax.scenario.warnings.dispersed_reach import DispersedReach


def first(evidence: RunEvidence) -> tuple[str, int, str]:
    """Name of the first cause, number of runs that it explains, evidence and what mends it."""
    found = causes(evidence)
    chosen = found.explained_by(0)
    finding = found.findings[0]
    return finding.name, int(chosen.sum()), f"{finding.evidence(chosen)}; {finding.mend(chosen)}"


def frame() -> RunEvidence:
    return planted(file_of(camera={"field_of_view_deg": 2.0}), signs={"cut": 0.8})


def too_small() -> RunEvidence:
    return planted(file_of(camera={"field_of_view_deg": 75.0}), signs={"good_boxes": 0.1})


def out_of_view() -> RunEvidence:
    narrow = file_of(camera={"field_of_view_deg": 2.0})
    return planted(
        narrow, signs={"in_view": 0.0, "good_boxes": 0.0, "out_of_view": 1.0}, traces={"nav_relative_error_m": 2.0}
    )


def torque() -> RunEvidence:
    file = file_of(wheels={"torque_limit_n_m": [0.001, 0.001, 0.001]})
    return planted(file, signs={"in_view": 0.2, "good_boxes": 0.18, "out_of_view": 0.8})


def weak_torque() -> RunEvidence:
    """Wheels that lack so little that slower slews are in time, too."""
    file = file_of(wheels={"torque_limit_n_m": [0.015, 0.025, 0.025]})
    return planted(file, signs={"in_view": 0.2, "good_boxes": 0.18, "out_of_view": 0.8})


def pointing() -> RunEvidence:
    return planted(file_of(), signs={"in_view": 0.2, "good_boxes": 0.18, "out_of_view": 0.8})


def dark() -> RunEvidence:
    signs = {"dark": 0.6, "looking": 0.4, "in_view": 0.4, "good_boxes": 0.35}
    return planted(file_of(orbit={"raan_deg": 0.0}), signs=signs)


def misses() -> RunEvidence:
    return planted(file_of(), signs={"good_boxes": 0.1})


def false_boxes() -> RunEvidence:
    return planted(file_of(), signs={"false_boxes": 0.6, "good_boxes": 0.6})


def fault() -> RunEvidence:
    file = file_of(effects={"faults": True})
    drawn = {
        "faults.fault.kind": np.where(FAILED, KINDS.index("thruster_off"), KINDS.index("gps_outage")),
        "faults.fault.start_s": np.full(RUNS, 500.0),
    }
    return planted(file, drawn=drawn, signs={"good_boxes": 0.1})


def stuck_open() -> RunEvidence:
    """Twelve thrusters without isolation valves, of which one is stuck open."""
    file = file_of("final_approach", effects={"faults": True})
    drawn = {
        "faults.fault.kind": np.where(FAILED, KINDS.index("thruster_stuck_open"), KINDS.index("none")),
        "faults.fault.start_s": np.full(RUNS, 500.0),
    }
    return planted(file, "keep_out", drawn=drawn, phases=phases_of(file, 1))


def isolated() -> RunEvidence:
    """One is stuck open and isolated, and the run aborts."""
    file = file_of("thruster_failure")
    drawn = {
        "faults.fault.kind": np.where(FAILED, KINDS.index("thruster_stuck_open"), KINDS.index("thruster_off")),
        "faults.fault.start_s": np.where(FAILED, 500.0, 5000.0),
    }
    evidence = planted(file, "aborted", drawn=drawn, phases=phases_of(file, 1, abort_reason=AbortReason.TARGET_LOST))
    return replace(evidence, metrics={**evidence.metrics, "isolation_delay_s": np.where(FAILED, 1.0625, np.nan)})


def doubt() -> RunEvidence:
    """Aborts as confidence was lost, for a moment that is too short for a cause of its own."""
    file = file_of("vbar_approach")
    evidence = planted(file, "aborted", phases=phases_of(file, 1, abort_reason=AbortReason.CONFIDENCE_LOST))
    at_abort = int(2000.0 / evidence.interval_s)
    evidence.signs["failed_tests"][:, 3] = np.where(FAILED, bits("size"), 0)
    evidence.signs["failed_tests"][:, at_abort] = np.where(FAILED, bits("gps_variance", "box_bias"), 0)
    evidence.signs["failed_tests"][:, at_abort + 1] = np.where(FAILED, bits("unseen"), 0)
    return evidence


def wheels() -> RunEvidence:
    return planted(file_of(), traces={"wheel_speed_fraction": 1.0}, signs={"unconfident": 1.0})


def authority() -> RunEvidence:
    file = file_of(thruster={"force_n": 0.002})
    spent = 2e-5 * np.arange(0.0, file.duration_s, 10.0)
    return planted(file, "off_station", traces={"delta_v_m_s": spent, "formation_error_m": 40.0})


def coarse_burns() -> RunEvidence:
    file = file_of(formation={"dead_band_mm_s": 60.0})
    return planted(file, "off_station", traces={"formation_error_m": 40.0})


def long_burns() -> RunEvidence:
    file = file_of(thruster={"minimum_on_time_s": 45.0})
    return planted(file, "off_station", traces={"formation_error_m": 40.0})


def propellant() -> RunEvidence:
    return planted(file_of(limits={"propellant_kg": 0.001}), "out_of_propellant")


def star_tracker() -> RunEvidence:
    return planted(file_of(), signs={"no_star_tracker": 1.0})


def belief() -> RunEvidence:
    bits = 1 << TESTS.index("size")
    return planted(
        file_of(target={"scale": 1.6}), "diverged", metrics={"sigma3_coverage": 0.4}, signs={"failed_tests": bits}
    )


def sure_and_wrong() -> RunEvidence:
    return planted(file_of(), "diverged", metrics={"sigma3_coverage": 0.4, "nees_relative_mean": 40.0})


def gate() -> RunEvidence:
    return planted(file_of(), signs={"good_rejected": 0.7})


def unknown_range() -> RunEvidence:
    return planted(file_of(), traces={"nav_relative_sigma3_m": 40.0})


def confidence() -> RunEvidence:
    return planted(file_of(), signs={"unconfident": 1.0, "failed_tests": 1 << TESTS.index("range")})


def corridor() -> RunEvidence:
    file = file_of("vbar_approach")
    phases = phases_of(file, 1, abort_reason=AbortReason.CORRIDOR_LEFT)
    range_m = np.where(np.arange(0.0, file.duration_s, 10.0) < 2000.0, 24.3, 500.0)
    return planted(file, "aborted", phases=phases, traces={"range_m": range_m})


def phase() -> RunEvidence:
    file = file_of("vbar_approach")
    return planted(file, "unfinished", phases=phases_of(file, 0, unmet=Condition.RANGE_SIGMA))


def short() -> RunEvidence:
    file = file_of("vbar_approach").model_copy(update={"duration_s": 1500.0})
    return planted(file, "unfinished", phases=phases_of(file, 1, unmet=Condition.ARRIVAL))


def abort() -> RunEvidence:
    file = file_of("vbar_approach")
    return planted(file, "aborted", phases=phases_of(file, 1, abort_reason=AbortReason.KEEP_OUT_PREDICTED))


def keep_out() -> RunEvidence:
    return planted(file_of(), "keep_out")


PLANTS: dict[Callable[[], RunEvidence], tuple[str, tuple[str, ...]]] = {
    frame: ("frame", ("below 30 m (88 % of boxes cut)", "camera.field_of_view_deg: now 2 -> 5 deg")),
    too_small: ("too_small", ("px, boxes from 4 px on", "camera.field_of_view_deg: now 75 -> ")),
    out_of_view: ("out_of_view", ("in 100 % of the worst ten minutes", "view is 1 deg")),
    torque: (
        "wheels",
        (
            "takes 0.0168 N m of wheel 0, which gives 0.001",
            "at least 0.0168 N m",
            "slower slews leave no time for a burn",
        ),
    ),
    weak_torque: ("wheels", ("at least 0.0168 N m", "or pointing.slew_acceleration_mrad_s2: now 16 -> 14.3 mrad/s2")),
    pointing: ("pointing", ("80 % of the worst ten minutes", "knows its direction to 0.382 deg")),
    dark: ("dark", ("in 60 % of the time", "phase angle")),
    misses: ("misses", ("in 90 % of the frames", "(10 % believed)")),
    false_boxes: (
        "false_boxes",
        ("60 % of frames have a false box", "60 % of those that show the target have a true one"),
    ),
    fault: ("fault", ("thruster off", "from 500 s on")),
    stuck_open: (
        "fault",
        (
            "thruster stuck open acts from 500 s on, for 2500 s, and nothing shuts the thruster off",
            "chamber_pressure.enabled: now false -> true and isolation.enabled: now false -> true",
        ),
    ),
    isolated: ("fault", ("the thruster is shut off after 1.06 s", "equipment in reserve")),
    doubt: ("abort", ("confidence lost by the test box_bias, at 2000 s", "calibration of the camera's mounting")),
    wheels: ("wheels", ("100 % of 0.502 N m s", "wheels of 1 N m s")),
    authority: ("authority", ("burns took 4 mm/s", "thruster.force_n: now 0.002 -> 0.00602 N")),
    coarse_burns: (
        "authority",
        ("the dead band is too wide", "below 60 mm/s", "12 m in a burn period", "now 60, at most 25 mm/s"),
    ),
    long_burns: (
        "authority",
        ("the least burn is too long: 45 s give 45 mm/s", "leave 31.8 s", "now 45, at most 25 s"),
    ),
    propellant: ("propellant", ("0.001 kg is used up at 3000 s",)),
    star_tracker: ("star_tracker", ("in 100 % of the worst ten minutes",)),
    belief: ("belief", ("1.6 times too near", "hull of 0.8 x 2.56 x 0.96 m", "target_size_m: now 1.06 -> 1.7 m")),
    sure_and_wrong: ("sure_and_wrong", ("inside 3 sigma in 40 %", "NEES / 6 6.67")),
    gate: ("gate", ("4 sigma rejects 78 % of true boxes",)),
    unknown_range: ("unknown_range", ("known to 44 % only", "no burn is planned beyond 20 %")),
    confidence: ("confidence", ("by the test range", "100 % of the worst ten minutes")),
    corridor: ("corridor", ("approach is left at 24.3 m, 6 m from its axis", "5.73 m wide to each side")),
    phase: ("phase", ("hold_100 does not end in 9000 s", "range_sigma_m = 6")),
    short: ("short", ("the run of 1500 s ends in approach", "duration_s: now 1500 -> ")),
    abort: ("abort", ("keep-out zone ahead, at 2000 s and 30 m",)),
    keep_out: ("keep_out", ("of 10 m is entered at 3000 s", "0.2 m")),
}


@pytest.mark.parametrize("plant", PLANTS, ids=lambda each: each.__name__)
def test_the_first_cause_is_the_planted_one_with_its_numbers(plant: Callable[[], RunEvidence]) -> None:
    name, numbers = PLANTS[plant]
    found, runs, text = first(plant())
    assert (found, runs) == (name, int(FAILED.sum())), text
    assert [each for each in numbers if each not in text] == [], text


@pytest.mark.parametrize("reason", [each for each in AbortReason if each not in (0, AbortReason.CORRIDOR_LEFT)])
def test_an_abort_names_its_phase_and_reason_once(reason: AbortReason) -> None:
    file = file_of("vbar_approach")
    evidence = planted(file, "aborted", phases=phases_of(file, 1, abort_reason=reason))
    (finding,) = [each for each in all_findings(evidence) if each.name == "abort"]
    text = finding.evidence(FAILED)
    assert text.startswith(finding.title)
    assert [text.count(words) for words in (file.phases[1].name, reason.text)] == [1, 1]


def test_every_reason_and_condition_has_words_of_its_own() -> None:
    file = file_of("capture").model_copy(update={"duration_s": 9000.0})
    mends = {}
    for reason in set(AbortReason) - {AbortReason.NONE, AbortReason.CORRIDOR_LEFT}:
        evidence = planted(file, "aborted", phases=phases_of(file, 3, abort_reason=reason))
        (finding,) = [each for each in all_findings(evidence) if each.name == "abort"]
        mends[reason] = finding.mend(FAILED)
    assert all(mends.values()), mends
    assert "until.attitude_sigma_deg" in mends[AbortReason.ATTITUDE_LOST]
    for condition in Condition:
        evidence = planted(file, "unfinished", phases=phases_of(file, 3, unmet=condition))
        (finding,) = [each for each in all_findings(evidence) if each.name == "phase"]
        assert f"phases.port_approach.until.{CONDITION_KEYS[condition]} that the runs can meet" in finding.mend(FAILED)
    metrics = {"target_attitude_known_fraction": np.where(FAILED, 0.4, 1.0)}
    found = replace(evidence, metrics={**evidence.metrics, **metrics})
    (finding,) = [each for each in all_findings(found) if each.name == "phase"]
    text = finding.evidence(FAILED)
    assert "attitude_sigma_deg = 0.4 of the target's attitude, and it is known at all in 40 % of the time" in text


def test_no_way_between_two_frames_is_shorter_than_the_one_inwards() -> None:
    file = file_of("capture")
    straight = [*file.phases[:1], *file.phases[3:4]]
    evidence = planted(file.model_copy(update={"phases": straight}))
    # From 20 m in H to 1.5 m in T, at 5 cm/s.
    assert mission_rules._approach_s(evidence, 1) == pytest.approx((20.0 - 1.5) / 0.05)
    assert mission_rules._approach_s(planted(file), 3) == pytest.approx((8.0 - 1.5) / 0.05)


@pytest.mark.parametrize(
    ("of_burns", "of_health", "words"),
    [
        (0.35, 0.4, "no burn is planned beyond 35 %"),
        (0.4, 0.35, "navigation has no confidence beyond 35 %"),
        (0.1, 0.1, "no burn is planned beyond 10 %"),
    ],
)
def test_limits_of_the_range_are_those_of_the_scenario(of_burns: float, of_health: float, words: str) -> None:
    file = file_of(formation={"range_uncertainty_limit": of_burns}, health={"range_limit": of_health})
    name, _, text = first(planted(file, traces={"nav_relative_sigma3_m": 40.0}))
    assert name == "unknown_range"
    assert words in text


def test_a_range_within_both_limits_is_no_cause() -> None:
    file = file_of(formation={"range_uncertainty_limit": 0.6}, health={"range_limit": 0.6})
    assert causes(planted(file, traces={"nav_relative_sigma3_m": 40.0})).findings == []


@pytest.mark.parametrize("scenario", ["inspection", "vbar_approach", "inspection_faults"])
def test_nothing_is_found_in_runs_in_which_nothing_is_wrong(scenario: str) -> None:
    file = file_of(scenario)
    more: dict[str, Any] = {"phases": phases_of(file, len(file.phases) - 1)} if file.phases else {}
    evidence = planted(file, "completed", **more)
    assert [each.name for each in all_findings(evidence) if each.shown.any() and each.name != "fault"] == []
    assert causes(evidence).findings == []


def test_results_without_signs_traces_and_phases_give_no_cause() -> None:
    evidence = RunEvidence(file_of(), np.where(FAILED, "lost", "completed"), np.where(FAILED, 3000.0, np.nan))
    assert causes(evidence).findings == []


def test_runs_that_an_older_version_wrote_without_signs_show_none() -> None:
    evidence = misses()
    signs = {name: np.where(FAILED[:, None], -1, values) for name, values in evidence.signs.items()}
    assert causes(planted(file_of(), signs_of_run=signs)).findings == []


def test_what_happens_after_an_abort_is_no_cause() -> None:
    file = file_of("vbar_approach")
    evidence = abort()
    late = np.arange(evidence.signs["ticks"].shape[1]) * evidence.interval_s > 2000.0
    signs = {**evidence.signs, "good_boxes": np.where(late, 0, evidence.signs["good_boxes"])}
    phases = phases_of(file, 1, abort_reason=AbortReason.KEEP_OUT_PREDICTED)
    assert first(planted(file, "aborted", phases=phases, signs_of_run=signs))[0] == "abort"


def bits(*tests: str) -> int:
    return sum(1 << TESTS.index(test) for test in tests)


@pytest.mark.parametrize("tests", [("unseen", "range"), ("unseen", "box_bias", "size")])
def test_a_belief_that_no_failed_test_suspects_is_no_cause(tests: tuple[str, ...]) -> None:
    """The detector misses nine of ten targets, and the noise of boxes is ten times the believed one."""
    noisy = file_of(camera={"model": "geometric", "edge_noise_px": 10.0})
    evidence = planted(noisy, signs={"good_boxes": 0.1, "failed_tests": bits(*tests)})
    assert [each.name for each in causes(evidence).findings] == ["misses"]
    suspected = planted(noisy, signs={"failed_tests": bits("box_variance", *tests)})
    assert first(suspected)[:2] == ("belief", int(FAILED.sum()))


def test_the_hardware_of_a_wrong_belief_is_the_error_that_is_dispersed() -> None:
    dispersion = {"key": "star_tracker.misalignment_deg", "kind": "normal", "sigma": [2.0, 2.0, 2.0]}
    file = scenario_loader.validate(scenario_loader.load("inspection").model_dump() | {"dispersions": [dispersion]})
    words = "the filter believes 0.1 deg, and the truth is up to 6 by camera and star_tracker.misalignment_deg"
    found = belief_mend(file, DispersedReach(file), "navigation.bearing_bias_sigma_deg", words)
    assert "star_tracker.misalignment_deg: dispersed by up to 6, at most 0.1;" in found


def test_the_bias_of_boxes_suspects_a_wrong_size() -> None:
    evidence = planted(file_of(target={"scale": 1.6}), signs={"failed_tests": bits("box_bias")})
    assert "a wrong belief of navigation.target_size_m" in first(evidence)[2]


@pytest.mark.parametrize("metrics", [{}, {"sigma3_coverage": 0.4, "nees_relative_mean": 40.0}])
def test_a_belief_that_doubts_too_much_is_no_cause(metrics: dict[str, float]) -> None:
    file = file_of(navigation={"bearing_bias_sigma_deg": 5.0})
    evidence = planted(file, signs={"failed_tests": (1 << len(TESTS)) - 1}, metrics=metrics)
    assert [each.name for each in all_findings(evidence) if each.name == "belief"] == []


def test_a_belief_of_gps_is_a_cause_only_where_the_relative_estimate_is_wrong() -> None:
    file, failed = file_of(navigation={"gps_noise_m": 0.1}), bits("gps_variance")
    assert causes(planted(file, signs={"failed_tests": failed})).findings == []
    wrong = planted(file, signs={"failed_tests": failed}, metrics={"sigma3_coverage": 0.4})
    assert "a wrong belief of navigation.gps_noise_m" in first(wrong)[2]


def test_a_belief_acts_from_the_first_failed_test_on_that_suspects_it() -> None:
    evidence = belief()
    failed = evidence.signs["failed_tests"]
    failed[:, :4], failed[:, 4:9], failed[:, 9:] = 0, bits("unseen"), np.where(FAILED[:, None], bits("size"), 0)
    by_test = planted(evidence.file, "diverged", signs_of_run=evidence.signs)
    found = next(each for each in all_findings(by_test) if each.name == "belief")
    np.testing.assert_array_equal(found.at_s[FAILED], 9 * evidence.interval_s)


@pytest.mark.parametrize(("is_before", "name"), [(False, "corridor"), (True, "sure_and_wrong")])
def test_a_filter_is_wrong_by_what_it_believed_until_the_abort(is_before: bool, name: str) -> None:
    """The metrics are of the whole run, and half of the sample at the abort is of what comes after it."""
    file = file_of("vbar_approach")
    phases = phases_of(file, 1, abort_reason=AbortReason.CORRIDOR_LEFT)
    evidence = planted(file, phases=phases)
    ticks, time_s = evidence.signs["ticks"], evidence.time_s
    wrong_ticks = (np.arange(ticks.shape[1]) * evidence.interval_s > 2000.0) != is_before
    wrong_samples = (time_s >= 2000.0) != is_before
    found = planted(
        file,
        "aborted",
        phases=phases,
        signs_of_run={**evidence.signs, "outside_3_sigma": np.where(FAILED[:, None] & wrong_ticks, ticks, 0)},
        traces={"nees_relative": np.where(wrong_samples, 48.0, 6.0)},
        metrics={"sigma3_coverage": 0.4, "nees_relative_mean": 40.0},
    )
    assert first(found)[:2] == (name, int(FAILED.sum()))
    if is_before:
        assert "inside 3 sigma in 0 %, NEES / 6 8)" in first(found)[2]
        np.testing.assert_array_equal(next(each.at_s for each in causes(found).findings)[FAILED], 0.0)


def test_the_size_of_the_picture_after_an_abort_is_no_evidence() -> None:
    """The servicer drifts away after it has aborted, and the target gets small only then."""
    file = file_of("vbar_approach", camera={"field_of_view_deg": 30.0})
    phases = phases_of(file, 1, abort_reason=AbortReason.TARGET_LOST)
    range_m = np.where(np.arange(0.0, file.duration_s, 10.0) < 2000.0, 40.0, 140.0)
    evidence = planted(file, "aborted", phases=phases, traces={"range_m": range_m}, signs={"good_boxes": 0.1})
    assert np.nanmax(evidence.ranges_m[FAILED]) == 40.0


def test_without_the_place_in_a_corridor_the_range_alone_is_told() -> None:
    phases = {name: values for name, values in corridor().phases.items() if not name.startswith("corridor_")}
    assert (
        "approach is left at 30 m; phases.approach.corridor.half_angle_deg: now 10 -> 20 deg"
        in first(planted(corridor().file, "aborted", phases=phases))[2]
    )


@pytest.mark.parametrize(
    ("tables", "mend"),
    [
        (
            {"camera": {"model": "geometric", "misalignment_deg": [2.0, 2.0, 0.0]}},
            "either mend the hardware: camera.misalignment_deg: now [2, 2, 0], at most 0.1 deg; or believe the error: "
            "navigation.bearing_bias_sigma_deg: now 0.1 -> 2 deg, which makes the filter consistent and not",
        ),
        (
            {"thruster": {"force_scale": 1.6}},
            "thruster.force_scale: now 1.6 -> 1 (to within 0.0224); or believe the error: navigation.burn_scale_sigma: "
            "now 0.02 -> 0.6",
        ),
        ({"camera": {"model": "geometric", "edge_noise_px": 6.0}}, "camera.edge_noise_px: now 6, at most 1 px; or "),
    ],
)
def test_a_wrong_belief_is_mended_by_hardware_or_by_belief_with_present_values(
    tables: dict[str, Any], mend: str
) -> None:
    evidence = planted(file_of(**tables), "diverged", metrics={"sigma3_coverage": 0.4})
    assert mend in first(evidence)[2], first(evidence)[2]


def test_keys_without_a_value_in_a_text_get_their_present_one() -> None:
    text = "a longer pointing.look_away_limit_s, thruster.force_n: now 0.03 -> 1 N, or wheels.torque_limit_n_m[1], x.y"
    assert with_present_values(file_of(), text) == (
        "a longer pointing.look_away_limit_s (now 110 s), thruster.force_n: now 0.03 -> 1 N, or "
        "wheels.torque_limit_n_m[1] (now 0.025 N m), x.y"
    )
    assert with_present_values(file_of("vbar_approach"), "phases.approach.corridor.width_m, duration_s") == (
        "phases.approach.corridor.width_m (now 1.5 m), duration_s (now 9000 s)"
    )
