"""Settings of live runs."""

import pytest

from rpojax.errors import RpojaxError
from rpojax.interop.cosimulation import live_topics
from rpojax.interop.cosimulation.live_settings import ExternalStage, LiveSettings, parse_external_stages
from rpojax.interop.cosimulation.live_topics import command_topics, published_topics
from rpojax.interop.ros2 import topics


@pytest.mark.parametrize(
    ("text", "stages"),
    [
        ("none", frozenset()),
        ("all", frozenset(ExternalStage)),
        ("attitude", frozenset({ExternalStage.ATTITUDE})),
        ("formation, attitude", frozenset({ExternalStage.ATTITUDE, ExternalStage.FORMATION})),
    ],
)
def test_stages_are_parsed_from_a_list(text: str, stages: frozenset[ExternalStage]) -> None:
    assert parse_external_stages(text) == stages


@pytest.mark.parametrize("text", ["", "guidance", "all,attitude"])
def test_unknown_stages_are_refused(text: str) -> None:
    with pytest.raises(
        RpojaxError, match=r"^external_stages: found '[^\n]*', expected attitude, formation, navigation"
    ):
        parse_external_stages(text)


@pytest.mark.parametrize(
    ("changes", "option"),
    [
        ({"timeout_s": 0.0}, "timeout_s"),
        ({"timeout_s": float("nan")}, "timeout_s"),
        ({"patience_s": -1.0}, "patience_s"),
        ({"wait_s": float("inf")}, "wait_s"),
        ({"real_time_factor": 0.0}, "real_time_factor"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, float], option: str) -> None:
    with pytest.raises(RpojaxError, match=rf"^{option}: found [^\n]*, expected [^\n]*$"):
        LiveSettings(**changes)


def test_command_topics_are_not_published() -> None:
    stages = frozenset({ExternalStage.ATTITUDE})
    assert command_topics(stages) == (topics.WHEEL_COMMAND,)
    assert topics.WHEEL_COMMAND not in published_topics(stages)
    assert {topics.CLOCK, topics.THRUSTER_COMMAND, live_topics.ATTITUDE_REFERENCE} <= set(published_topics(stages))
