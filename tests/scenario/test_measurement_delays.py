"""Delays of a scenario: slots and sensors, and what is refused."""

import pytest

import rpojax
from rpojax.errors import ScenarioError
from rpojax.scenario.measurement_delays import DelaySettings, delay_settings
from tests.scenario_error_assertions import assert_one_line


def test_a_scenario_without_delays_has_none() -> None:
    assert delay_settings(rpojax.load("inspection")) is None


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (["camera.delay_s=0.5"], DelaySettings(("camera",), 3, True)),
        (["camera.delay_s=1.0", "camera.delay_jitter_s=1.5"], DelaySettings(("camera",), 5, True)),
        (["camera.processing_s=2.0", "navigation.delays=ignored"], DelaySettings(("camera",), 4, False)),
        (["camera.time_tag_error_s=0.01"], DelaySettings(("camera",), 2, True)),
        (["camera.delay_s=0.2", "navigation.delay_memory_s=4.0"], DelaySettings(("camera",), 6, True)),
    ],
)
def test_slots_last_as_long_as_the_longest_delay(changes: list[str], expected: DelaySettings) -> None:
    assert delay_settings(rpojax.load("inspection", changes)) == expected


def test_ranging_sensors_may_be_late_alone() -> None:
    found = delay_settings(rpojax.load("night_approach", ["lidar.delay_s=0.3"]))
    assert found is not None
    assert found.sensors == ("lidar",)


def test_a_dispersed_delay_needs_a_memory() -> None:
    spread = "dispersions.camera.delay_s={kind = 'uniform', low = 0.1, high = 0.4}"
    with pytest.raises(ScenarioError) as refused:
        rpojax.load("inspection", [spread])
    assert_one_line(refused.value, "navigation.delay_memory_s", "dispersed")
    found = delay_settings(rpojax.load("inspection", [spread, "navigation.delay_memory_s=0.5"]))
    assert found == DelaySettings(("camera",), 3, True)


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
    ],
)
def test_delays_that_no_one_takes_into_account_are_refused(scenario: str, changes: list[str], words: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        rpojax.load(scenario, changes)
    assert_one_line(refused.value, "camera.delay_s", words)
