"""What a live run says first: what others decide by, and for who follows the reference, the reference before all."""

from typing import Any

import numpy as np
import pytest

from rpojax.interop.cosimulation import live_settings, live_topics
from rpojax.interop.cosimulation.compiled_stages import AttitudeValues, GuidedValues, NavigatedValues
from rpojax.interop.cosimulation.live_publisher import TickMessages
from rpojax.interop.cosimulation.live_settings import LiveSettings
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun

STEP_NS = 200_000_000
TURN = np.array([0.0, 0.0, 0.0, 1.0])


def names(said: Any) -> list[str]:
    return [topic.name for topic, _ in said]


@pytest.fixture
def sensed(flight: ReplayedRun[RosTickValues]) -> NavigatedValues:
    attitude = AttitudeValues(
        orientation=TURN,
        rate=np.zeros(3),
        covariance=np.eye(3),
        rate_covariance=np.eye(3),
        gyro=np.zeros(3),
        gyro_variance=np.float64(1.0),
        wheel_speed=np.zeros(3),
    )
    return NavigatedValues(tick=flight.tick(1), attitude=attitude)


def decided(sensed: NavigatedValues) -> GuidedValues:
    return GuidedValues(
        tick=sensed.tick, channels={}, attitude_reference=(TURN[None], np.zeros((1, 3)), np.zeros((1, 3)))
    )


@pytest.mark.parametrize("external", ["attitude", "attitude,formation", "formation", "none"])
def test_a_tick_is_said_once_and_what_others_decide_by_comes_first(sensed: NavigatedValues, external: str) -> None:
    words = TickMessages(LiveSettings(external_stages=live_settings.parse_external_stages(external)), STEP_NS)
    first = names(words.after_navigation(sensed))
    assert first[:4] == [each.name for each in (topics.CLOCK, topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE)] + [
        topics.WHEELS.name
    ]
    every = [
        *first,
        *names(words.attitude_reference(decided(sensed), sensed)),
        *names(words.after_guidance(decided(sensed))),
    ]
    assert len(set(every)) == len(every)
    assert (live_topics.ATTITUDE_ESTIMATE.name in every) == ("attitude" in external)


def test_who_only_points_hears_the_reference_before_the_first_attitude(sensed: NavigatedValues) -> None:
    words = TickMessages(LiveSettings(external_stages=live_settings.parse_external_stages("attitude")), STEP_NS)
    assert live_topics.ATTITUDE_ESTIMATE.name not in names(words.after_navigation(sensed))
    both = [live_topics.ATTITUDE_REFERENCE.name, live_topics.ATTITUDE_ESTIMATE.name]
    assert names(words.attitude_reference(decided(sensed), sensed)) == both


def test_who_decides_on_burns_too_hears_the_attitude_at_once(sensed: NavigatedValues) -> None:
    words = TickMessages(
        LiveSettings(external_stages=live_settings.parse_external_stages("attitude,formation")), STEP_NS
    )
    first = names(words.after_navigation(sensed))
    assert first.index(live_topics.ATTITUDE_ESTIMATE.name) < first.index(topics.TF.name)
