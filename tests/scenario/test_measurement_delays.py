"""Delays of a scenario: slots and sensors, and what is refused."""

import pytest

import rpojax
from rpojax.analysis.linear_covariance.analysis_setup import AnalysisSetup
from rpojax.campaign.single_run import nominal_parameters
from rpojax.errors import RpojaxError, ScenarioError
from rpojax.flight.stages import Stages
from rpojax.interop.cosimulation.live_run import simulate_live
from rpojax.interop.cosimulation.live_settings import LiveSettings
from rpojax.scenario.loading.scenario_warnings import scenario_warnings
from rpojax.scenario.measurement_delays import KEYS, TIME_TAG, DelaySettings, delay_settings
from rpojax.simulation.tick import Loop
from tests.scenario_error_assertions import assert_one_line


def test_a_scenario_without_delays_has_none() -> None:
    assert delay_settings(rpojax.load("inspection")) is None


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (["camera.delay_s=0.5"], DelaySettings(("camera",), 3, True)),
        (["camera.delay_s=1.0", "camera.delay_jitter_s=1.5"], DelaySettings(("camera",), 5, True)),
        (["camera.processing_s=2.0", "navigation.delays=ignored"], DelaySettings(("camera",), 4, False)),
        (["camera.time_tag_error_s=-0.01"], DelaySettings(("camera",), 3, True)),
        (["camera.delay_s=0.2", "navigation.delay_memory_s=4.0"], DelaySettings(("camera",), 6, True)),
    ],
)
def test_slots_last_as_long_as_the_longest_delay(changes: list[str], expected: DelaySettings) -> None:
    assert delay_settings(rpojax.load("inspection", changes)) == expected


def test_each_ranging_sensor_is_late_by_its_own_keys() -> None:
    before, after = (delay_settings(rpojax.load("night_approach", each)) for each in ([], ["lidar.delay_s=0.3"]))
    assert before is not None
    assert after is not None
    assert set(after.sensors) - set(before.sensors) == {"lidar"}


def test_a_dispersed_delay_needs_a_memory() -> None:
    spread = "dispersions.camera.delay_s={kind = 'uniform', low = 0.1, high = 0.4}"
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [spread])
    assert_one_line(refused.value, "navigation.delay_memory_s", "dispersed")
    found = delay_settings(rpojax.load("inspection", [spread, "navigation.delay_memory_s=0.5"]))
    assert found == DelaySettings(("camera",), 3, True)


def test_a_time_tag_after_the_arrival_is_refused() -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", ["camera.time_tag_error_s=0.01"])
    assert_one_line(refused.value, "camera.time_tag_error_s", "least age")
    assert rpojax.load("inspection", ["camera.time_tag_error_s=0.01", "camera.delay_s=0.1"]).camera.delay_s == 0.1


@pytest.mark.parametrize("key", KEYS)
def test_a_late_team_is_refused_by_the_key_that_makes_it_late(key: str) -> None:
    value = -0.25 if key == TIME_TAG else 0.25
    dispersed = [f"dispersions.camera.{key}={{kind = 'uniform', low = 0.1, high = 0.2}}", "navigation.delay_memory_s=1"]
    for changes, found in (([f"camera.{key}={value}"], f"{value}"), (dispersed, "'a dispersed number'")):
        with pytest.raises(ScenarioError) as refused:
            rpojax.load("cooperative_inspection", changes)
        assert_one_line(refused.value, f"camera.{key}", "no late measurements in a team")
        assert f": found {found}, expected" in str(refused.value)


@pytest.mark.parametrize(
    ("scenario", "changes", "words"),
    [
        (
            "inspection",
            ["camera.delay_s=2.0", "navigation.delay_memory_s=1.0"],
            "at most navigation.delay_memory_s = 1",
        ),
        ("inspection", ["camera.delay_s=6.0", "camera.processing_s=5.0"], "at most 10 s"),
        ("cooperative_inspection", ["camera.delay_s=0.5"], "no late measurements in a team"),
        (
            "cooperative_inspection",
            ["dispersions.camera.delay_s={kind = 'uniform', low = 0.1, high = 0.4}", "navigation.delay_memory_s=0.5"],
            "no late measurements in a team",
        ),
    ],
)
def test_delays_that_no_one_takes_into_account_are_refused(scenario: str, changes: list[str], words: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load(scenario, changes)
    assert_one_line(refused.value, "camera.delay_s", words)


@pytest.mark.parametrize(
    ("changes", "longest"),
    [
        (["dispersions.camera.delay_s={kind = 'uniform', low = 0.1, high = 0.7}"], 0.7),
        (["dispersions.camera.delay_s={kind = 'choice', values = [0.1, 0.3]}", "camera.processing_s=0.4"], 0.7),
        (["dispersions.camera.delay_s={kind = 'truncated_normal', sigma = 0.1, limit_sigmas = 3.0}",
          "camera.delay_s=0.4"], 0.7),
        (["dispersions.camera.time_tag_error_s={kind = 'uniform', low = -0.4, high = 0.1}", "camera.delay_s=0.3"], 0.7),
        (["design={kind = 'grid', values = {'camera.delay_s' = [0.1, 0.7]}}"], 0.7),
    ],
)  # fmt: skip
def test_flight_software_remembers_the_longest_delay_that_is_drawn(changes: list[str], longest: float) -> None:
    assert rpojax.load("inspection", [*changes, f"navigation.delay_memory_s={longest}"])
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [*changes, "navigation.delay_memory_s=0.5"])
    assert_one_line(refused.value, "navigation.delay_memory_s", f"at least {longest:g}")


def test_a_delay_without_an_end_is_refused() -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load(
            "inspection", ["dispersions.camera.delay_s={kind = 'normal', sigma = 0.1}", "navigation.delay_memory_s=2.0"]
        )
    assert_one_line(refused.value, "dispersions.12.kind", "camera.delay_s")


def test_settings_of_delays_without_one_are_warned_of() -> None:
    def warned(*changes: str) -> list[str]:
        lines = scenario_warnings(rpojax.load("inspection", list(changes)))
        return [line.partition(":")[0] for line in lines if line.startswith("navigation.delay")]

    assert warned("navigation.delays=ignored", "navigation.delay_memory_s=2.0") == [
        "navigation.delays",
        "navigation.delay_memory_s",
    ]
    assert warned("navigation.delays=ignored", "navigation.delay_memory_s=2.0", "camera.delay_s=0.1") == []


def test_a_linear_covariance_and_a_live_run_refuse_late_measurements() -> None:
    late = rpojax.load("inspection", ["camera.delay_s=0.5"])
    with pytest.raises(ScenarioError) as refused:
        AnalysisSetup(late, 1, Stages())
    assert_one_line(refused.value, "camera.delay_s", "linear covariance")
    with pytest.raises(ScenarioError) as refused:
        simulate_live(late, 0, 0, LiveSettings(), lambda _: None)
    assert_one_line(refused.value, "navigation.delays", "live run")


def test_derivatives_to_delays_are_refused_where_they_would_be_zero() -> None:
    at_once, late = rpojax.load("inspection"), rpojax.load("inspection", ["camera.delay_s=0.5"])
    for file, key, words in (
        (late, "camera.delay_s", "decides the tick of an arrival"),
        (late, "camera.delay_jitter_s", "decides the tick of an arrival"),
        (at_once, "camera.time_tag_error_s", "measurements without an age"),
    ):
        with pytest.raises(RpojaxError, match=f"^{key}: found [^\n]*{words}"):
            rpojax.gradient(file, [key], runs=1, progress=False)


def test_an_orbit_filter_of_ones_own_says_what_it_does_with_late_measurements() -> None:
    scenario, params = nominal_parameters(rpojax.load("inspection", ["camera.delay_s=0.5"]))
    late = Stages(orbit_update=lambda estimate, gate, exposures: (estimate, gate, exposures))
    at_once = Stages(orbit_update=lambda estimate, gate: (estimate, gate, None))
    assert Loop(scenario, params, late)
    with pytest.raises(RpojaxError, match=r"^stages.orbit_update: found one without the argument `exposures`"):
        Loop(scenario, params, at_once)
    ignored, params = nominal_parameters(rpojax.load("inspection", ["camera.delay_s=0.5", "navigation.delays=ignored"]))
    assert Loop(ignored, params, at_once)
