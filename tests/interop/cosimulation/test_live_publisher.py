"""Messages of live runs: each once a tick, first those from which external nodes compute their commands."""

import numpy as np
import pytest

from rpojax.interop.cosimulation import live_topics
from rpojax.interop.cosimulation.compiled_step_stages import AttitudeValues, GuidedValues, NavigatedValues
from rpojax.interop.cosimulation.live_publisher import LiveMessages
from rpojax.interop.cosimulation.live_settings import LiveSettings, parse_external_stages
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.message_builders import TopicMessages
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.run_replay import ReplayedRun

STEP_NS = 200_000_000
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def names(messages: TopicMessages) -> list[str]:
    return [topic.name for topic, _ in messages]


def live_messages(external: str) -> LiveMessages:
    return LiveMessages(LiveSettings(external_stages=parse_external_stages(external)), STEP_NS)


@pytest.fixture
def navigated(ros_run: ReplayedRun[RosTickValues]) -> NavigatedValues:
    attitude = AttitudeValues(
        orientation=IDENTITY,
        rate=np.zeros(3),
        covariance=np.eye(3),
        rate_covariance=np.eye(3),
        gyro=np.zeros(3),
        gyro_variance=np.float64(1.0),
        wheel_speed=np.zeros(3),
    )
    return NavigatedValues(tick=ros_run.tick(1), attitude=attitude)


def guided(navigated: NavigatedValues) -> GuidedValues:
    reference = (IDENTITY[None], np.zeros((1, 3)), np.zeros((1, 3)))
    return GuidedValues(tick=navigated.tick, channels={}, attitude_reference=reference)


@pytest.mark.parametrize("external", ["attitude", "attitude,formation", "formation", "none"])
def test_every_topic_has_one_message_and_awaited_ones_come_first(navigated: NavigatedValues, external: str) -> None:
    messages = live_messages(external)
    first = names(messages.after_navigation(navigated))
    awaited = (topics.CLOCK, topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE, topics.WHEELS)
    assert first[:4] == [topic.name for topic in awaited]
    every = [
        *first,
        *names(messages.attitude_reference(guided(navigated), navigated)),
        *names(messages.after_guidance(guided(navigated))),
    ]
    assert len(set(every)) == len(every)
    assert (live_topics.ATTITUDE_ESTIMATE.name in every) == ("attitude" in external)


def test_with_external_attitude_the_reference_precedes_the_first_attitude(navigated: NavigatedValues) -> None:
    messages = live_messages("attitude")
    assert live_topics.ATTITUDE_ESTIMATE.name not in names(messages.after_navigation(navigated))
    expected = [live_topics.ATTITUDE_REFERENCE.name, live_topics.ATTITUDE_ESTIMATE.name]
    assert names(messages.attitude_reference(guided(navigated), navigated)) == expected


def test_with_external_formation_too_the_attitude_is_among_the_first(navigated: NavigatedValues) -> None:
    first = names(live_messages("attitude,formation").after_navigation(navigated))
    assert first.index(live_topics.ATTITUDE_ESTIMATE.name) < first.index(topics.TF.name)
