"""Topics that a live run receives and publishes, by the stages that are left to external nodes."""

from collections.abc import Set as AbstractSet

from rpojax.interop.cosimulation import live_topics
from rpojax.interop.cosimulation.live_settings import ExternalStage
from rpojax.interop.ros2 import topics
from rpojax.interop.ros2.topics import Topic

COMMAND_TOPICS: dict[ExternalStage, tuple[Topic, ...]] = {
    ExternalStage.ATTITUDE: (topics.WHEEL_COMMAND,),
    ExternalStage.FORMATION: (topics.THRUSTER_COMMAND, live_topics.ATTITUDE_TARGET),
    ExternalStage.NAVIGATION: (topics.SERVICER_ESTIMATE, topics.RELATIVE_ESTIMATE),
}
"""Topics that external nodes publish, by stage."""


def command_topics(external_stages: AbstractSet[ExternalStage]) -> tuple[Topic, ...]:
    """Topics of the commands that the simulator receives."""
    return tuple(topic for stage in ExternalStage if stage in external_stages for topic in COMMAND_TOPICS[stage])


def published_topics(external_stages: AbstractSet[ExternalStage]) -> tuple[Topic, ...]:
    """Topics that the simulator publishes."""
    attitude_topics = (live_topics.ATTITUDE_ESTIMATE, live_topics.ATTITUDE_REFERENCE)
    received = {topic.name for topic in command_topics(external_stages)}
    candidates = (*topics.ALL_TOPICS, *(attitude_topics if ExternalStage.ATTITUDE in external_stages else ()))
    return tuple(topic for topic in candidates if topic.name not in received and topic is not topics.COMPRESSED_IMAGE)
